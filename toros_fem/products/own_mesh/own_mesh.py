"""A skin of your own from a mesh file: its supports, its print, its target and its metrics."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, ClassVar, Self

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError, SurfaceError, TargetError
from toros_fem.base.keys import Count, Distance, In, Length, OneOf, Place, Table, key
from toros_fem.base.scene import NO_TABLE
from toros_fem.design.loop.case import Case
from toros_fem.measures.body_axis import DIRECTIONS, BodyAxis, body_axis
from toros_fem.measures.metrics import Metric, distance
from toros_fem.measures.shape import Part, ShapePart
from toros_fem.mechanics.skin.supports import Supports, symmetry_planes
from toros_fem.meshes.cut_at_planes import cut_at_planes, require_symmetric, straightened
from toros_fem.meshes.deformed import from_copy, from_mesh
from toros_fem.meshes.mirror import mirrored, require_symmetric_map
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.pattern_file import NAME, read_pattern
from toros_fem.meshes.refine import refine
from toros_fem.meshes.surface import Surface
from toros_fem.meshes.targets import Deformer
from toros_fem.meshes.topology import half_edges
from toros_fem.products.actuators.scene import ActuatorScene, Level
from toros_fem.products.actuators.simulate import FILES
from toros_fem.products.own_mesh.metrics import Measured, judged_by
from toros_fem.products.own_mesh.regions import Region
from toros_fem.products.tables.loads import SectionWeights
from toros_fem.products.tables.steps import Designing
from toros_fem.products.tables.unwrapping import Unwrapping

COMPONENTS = ("x", "y", "z", "xy", "xz", "yz", "xyz")
SYMMETRIES = (*COMPONENTS[:-1], "auto")
COUNTED = ("shape", "cross-sections")
METRICS = ("distance", "angle", "twist", "shortening")
# Filter radius over the mean edge length, where none is given.
FILTER_EDGES = 1.5
MESH = {"mesh": f"mesh file (STL, OBJ, PLY, MSH, VTU), or a {NAME} with its panels"}
TARGET = {
    "target": "the same mesh deformed to the target, its triangles in the same order; none: the "
    "target is that of the table [target]"
}
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Held(Region):
    """Where the skin is held."""

    components: Annotated[str, OneOf(COMPONENTS)] = key(
        "xyz", "components of the position that are held, of the others the skin is free"
    )


@dataclass(frozen=True)
class Printed(Region):
    """Where it is printed all over."""


@dataclass(frozen=True)
class Plain(Region):
    """Where nothing is printed."""


@dataclass(frozen=True)
class Deformed(Table):
    """Shape that is asked for."""

    bend: Annotated[float, In("deg", at_least=-720, at_most=720)] | None = key(
        None, "bend angle of the target"
    )
    twist: Annotated[float, In("deg", at_least=-2160, at_most=2160)] | None = key(
        None, "twist of the target, positive if counter-clockwise seen from the tip"
    )
    shorten: Annotated[float, In("%", below=100)] | None = key(None, "shortening of the target")
    neutral: Place | None = key(
        None,
        "distance of the line that keeps its length from the axis, towards the inner side; none "
        "takes the inner side itself",
    )
    axis: Annotated[str, OneOf(DIRECTIONS)] = key("z", "direction from root to tip")
    toward: Annotated[str, OneOf(DIRECTIONS)] = key("x", "direction that a bend goes to")
    begin: Distance = key(
        0.0, "distance from the near end at which the target begins to deform the body"
    )
    end: Length | None = key(
        None, "distance at which it ends; none takes the far end, or where a round tip begins"
    )

    @property
    def asked(self) -> dict[str, float]:
        """What is given of the metrics of a target, by their names, in deg and %."""
        values = {"angle": self.bend, "twist": self.twist, "shortening": self.shorten}
        return {name: value for name, value in values.items() if value is not None}

    def of_body(self, body: Pattern | Surface) -> BodyAxis:
        """Return the axis of a whole body."""
        return body_axis(body, self.axis, self.toward, self.begin, self.end)

    def deformer(self, axis: BodyAxis) -> Deformer:
        """Return the target as a map of positions.

        Raises:
            ParameterError: None is asked for.
        """
        if not self.asked:
            raise ParameterError(
                "there is no target: give bend, twist or shorten, or a target file of the deformed "
                "mesh."
            )
        return axis.deformer(
            np.radians(self.bend or 0.0),
            np.radians(self.twist or 0.0),
            (self.shorten or 0.0) / 100,
            axis.half_width if self.neutral is None else self.neutral,
        )


@dataclass(frozen=True)
class MeshFile(Unwrapping):
    """Sizes and mesh."""

    refinements: Annotated[int, In(at_least=0, at_most=6)] = key(
        0, "how often each triangle of the file is divided into four"
    )
    symmetry: Annotated[str, OneOf(SYMMETRIES)] | None = key(
        None,
        "planes that mesh, regions and target are symmetric about, x for x = 0: the part at x >= 0 "
        "is designed, and the print is symmetric; auto finds them; none designs the whole",
    )


@dataclass(frozen=True)
class OwnWeights(SectionWeights):
    """What counts in the objective.

    Raises:
        ParameterError: A metric is unknown.
    """

    counted: Annotated[str, OneOf(COUNTED)] = key(
        "shape", "what counts: the whole shape, or cross-sections only, which may swell freely"
    )
    metrics: str | None = key(
        None,
        f"numbers to judge by, of {', '.join(METRICS)}, with commas between them; none takes those "
        "of the target",
    )
    cross_sections: Count = key(12, "number of cross-sections")

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in self.metric_names or ():
            if name not in METRICS:
                known = ", ".join(METRICS)
                raise ParameterError(
                    f"metrics = {self.metrics!r} names {name!r}; known are {known}.", "metrics"
                )

    @property
    def metric_names(self) -> tuple[str, ...] | None:
        """Names of the metrics; None for those of the target."""
        if self.metrics is None:
            return None
        return tuple(dict.fromkeys(map(str.strip, self.metrics.split(","))))


@dataclass(frozen=True)
class OwnDesigning(Designing):
    """Steps, filter and start of the design."""

    filter_radius: Length | None = key(  # type: ignore[assignment]
        None, "radius R of the filter on the finest mesh; none takes one and a half edge lengths"
    )


@dataclass(frozen=True, eq=False)
class OwnSkin:
    """What the files of a scene hold, the same on all ranks.

    Attributes:
        pattern: Panels and seams on the mesh of the file, or of its part at the planes.
        target: Target positions of its vertices, (n, 3), in m; None where the configuration
            describes the target.
        planes: Axes of the symmetry planes that it is cut at.
    """

    pattern: Pattern
    target: Floats | None = None
    planes: tuple[int, ...] = ()

    @property
    def whole(self) -> Pattern:
        """The whole skin on the mesh of the file."""
        return mirrored(self.pattern, self.planes).pattern

    def refined(self, times: int) -> tuple[Pattern, Floats | None]:
        """Return pattern and target after each triangle was divided into four so often."""
        pattern, target = self.pattern, self.target
        for _ in range(times):
            finer = refine(pattern)
            pattern, target = finer.pattern, None if target is None else finer.at_vertices(target)
        return pattern, target

    def goal(self, whole: Pattern) -> Floats:
        """Return the target of the file on the whole skin, refined as this one is, (n, 3)."""
        times = round(np.log(len(whole.panel) / len(self.whole.panel)) / np.log(4))
        part, target = self.refined(times)
        assert target is not None
        return mirrored(part, self.planes).at_vertices(target)

    @property
    def edge_length(self) -> float:
        """Mean edge length of the mesh of the file in m."""
        points, ends = self.pattern.points, half_edges(self.pattern.triangles)
        return float(np.linalg.norm(points[ends[:, 1]] - points[ends[:, 0]], axis=1).mean())


@dataclass(frozen=True)
class OwnMeshScene(ActuatorScene):
    """A skin of your own."""

    target: Deformed = Deformed()
    skin: MeshFile = MeshFile()
    held: tuple[Held, ...] = ()
    printed: tuple[Printed, ...] = ()
    plain: tuple[Plain, ...] = ()
    objective: OwnWeights = OwnWeights()
    metric: tuple[Measured, ...] = ()
    design: OwnDesigning = OwnDesigning()

    KIND: ClassVar[str] = "own-mesh"
    DESIGN_FILES: ClassVar[Mapping[str, str]] = {**MESH, **TARGET}
    SIMULATION_FILES: ClassVar[Mapping[str, str]] = {**MESH, **TARGET, **FILES}
    EXAMPLE_FILES: ClassVar[Mapping[str, str]] = {"mesh": "my.stl"}
    COARSE: ClassVar[Mapping[str, float]] = {
        "iterations": 1 / 2,
        "constrained_iterations": 1 / 2,
        "corrections": 1 / 3,
        "polish_iterations": 1 / 2,
    }
    FEW: ClassVar[tuple[str, ...]] = (
        "bend", "twist", "shorten", "axis", "toward", "scale", "cuts", "symmetry", "pressure",
        "design_pressure", "seed",
    )  # fmt: skip

    TARGETS: ClassVar[Mapping[str, str]] = {
        "angle_deg": "bend",
        "twist_deg": "twist",
        "shortening_percent": "shorten",
    }

    # What the files hold, once they are read.
    read: OwnSkin | None = field(default=None, repr=False, compare=False, metadata=NO_TABLE)

    @classmethod
    def example(cls) -> Self:
        """Return what a new scene file holds: a body that stands on z = 0 and bends."""
        return cls.of(held=(Held(where="z < 5 mm"),), bend=60.0, design_pressure=True)

    def coarse(self) -> Self:
        """Return the same design on the mesh of the file, with few steps."""
        values, radius = self.coarse_values(), self.design.filter_radius
        values |= {"levels": 1, "refinements": 0}
        if radius is not None:
            values["filter_radius"] = radius * 2.0**self.skin.refinements
        return self.updated(**values)

    def with_files(self, comm: MPI.Comm, files: Mapping[str, Path]) -> Self:
        """Return the scene with its skin, and a filter radius if none is given (collective).

        Args:
            comm: Communicator.
            files: Paths of the "mesh", a pattern file or its folder too, and of the "target".

        Raises:
            TorosError: There is no mesh, or a file cannot be read, or does not fit.
        """
        if "mesh" not in files:
            raise ParameterError("there is no mesh: name a mesh file.")
        skin = read_skin(comm, self, files["mesh"], files.get("target"))
        radius = self.design.filter_radius
        if radius is None:
            radius = FILTER_EDGES * skin.edge_length / 2.0**self.skin.refinements
        return replace(self.updated(filter_radius=radius), read=skin)

    def case(self, comm: MPI.Comm, level: Level) -> Case:
        """Return the case of the skin on its mesh, refined as the level says.

        Args:
            comm: Communicator; not used, since all ranks have the whole skin.
            level: How often its triangles are divided.

        Raises:
            ParameterError: A region holds nothing, nothing is held, or there is no target, or two.
            PanelError: There is no panel of a name.
        """
        del comm
        skin, goal = self.own_skin, self.objective
        pattern = skin.refined(level.refinements)[0]
        whole = mirrored(pattern, skin.planes).pattern
        axis = self.target.of_body(skin.whole)
        target = _target(self, skin, axis)
        if goal.counted == "cross-sections":
            labels = axis.labels(whole, goal.cross_sections)
            along = int(np.argmax(np.abs(axis.along)))
            part: Part = goal.sections_part(whole, labels, along, border=axis.flat_tip)
        elif goal.tip_weight or goal.orientation_length:
            tip = axis.tip(whole)
            area = whole.vertex_areas[tip]
            arm = whole.points[tip] - np.average(whole.points[tip], axis=0, weights=area)
            radius = float(np.sqrt(np.average((arm**2).sum(axis=1), weights=area)))
            part = goal.shape_part(whole, tip, tip, radius)
        else:
            part = ShapePart()
        metrics = judged_by(self.metric, axis, _metrics(self, axis, target))
        hinged = self.material.seams == "hinged"
        return Case(
            pattern,
            target(whole)[: len(pattern.points)],  # those of the part come first
            _supports(self, pattern) | symmetry_planes(pattern, skin.planes, hinged=hinged),
            self.pressure.pressure,
            self.pressure.bounds,
            self.material.composite,
            parts=[part],
            metrics=[metric.of_whole(skin.planes) for metric in metrics],
            passive=_passive(self, pattern),
            symmetry=skin.planes,
            parts_of_whole=True,
        )

    @property
    def own_skin(self) -> OwnSkin:
        """What the files hold.

        Raises:
            ParameterError: They are not read.
        """
        if self.read is None:
            raise ParameterError("the mesh is not read yet: call with_files first.")
        return self.read

    @property
    def _most_levels(self) -> int:
        return 1 + self.skin.refinements

    @property
    def finest_level(self) -> Level:
        """The finest mesh of a design of densities."""
        return Level(None, self.design.regularisation, self.skin.refinements)

    @property
    def relaxed_level(self) -> Level:
        """The mesh of the file: a relaxed design has no thin lines."""
        return self._lines_on(0)

    @property
    def print_level(self) -> Level:
        """The finest mesh, for the print of lines too."""
        return self._lines_on(self.skin.refinements)

    def coarser_print_level(self) -> tuple[float, Level]:
        """Return 2, and the mesh that was refined once less.

        Raises:
            ParameterError: The mesh is that of the file.
        """
        times = self.skin.refinements
        if times == 0:
            raise ParameterError(
                "the print is simulated on the mesh of the file, and there is no coarser one to "
                "compare with. Set refinements = 1, or give a coarser file and refine it."
            )
        return 2.0, self._lines_on(times - 1)

    def require_fine_print(self) -> None:
        """Check that the finest mesh is fine enough for the lines that are laid.

        Raises:
            ParameterError: Its edges are longer than lines are wide.
        """
        if self.read is None:
            return
        width, times = min(self.laid_widths), self.skin.refinements
        edge = self.read.edge_length / 2.0**times
        if edge > width:
            more = times + int(np.ceil(np.log2(edge / width)))
            raise ParameterError(
                f"the finest mesh has edges of {edge:.3g} m, which are over {width} m, the width "
                f"of the lines: their print cannot be simulated. Set refinements = {more}, or lay "
                "wider lines (laid_width).",
                "refinements",
            )

    def _lines_on(self, refinements: int) -> Level:
        edge = self.own_skin.edge_length / 2.0**refinements
        return replace(self._of_lines(edge), edge_length=None, refinements=refinements)


def read_skin(
    comm: MPI.Comm, scene: OwnMeshScene, mesh: Path | str, target: Path | str | None = None
) -> OwnSkin:
    """Read a mesh, cut it into flat panels, and read its target (collective).

    Args:
        comm: Communicator.
        scene: Scale, cuts and symmetry.
        mesh: Mesh file; or a pattern file, or the folder that it lies in.
        target: Mesh file of the target; None for none.

    Raises:
        TorosError: A file cannot be read, or does not fit, or is not symmetric.
    """
    path, given, symmetry = Path(mesh), target and Path(target), scene.skin.symmetry
    axes = tuple(map("xyz".index, symmetry)) if symmetry not in (None, "auto") else ()
    if comm.bcast(path.is_dir()):
        path = path / NAME
    if path.suffix == ".npz":
        pattern = read_pattern(comm, path)
        if axes and not len(pattern.free_edges):
            raise ParameterError(
                f"symmetry = {symmetry!r} needs the mesh file, or the pattern of a part that was "
                f"cut there: {path} is that of a whole skin.",
                "symmetry",
            )
        goal = from_mesh(comm, given, pattern) if given else None
        for axis in axes:
            _require_symmetric(scene, mirrored(pattern, axes).pattern, goal, axis)
        return OwnSkin(pattern, goal, axes)
    surface = scene.skin.surface(comm, path)
    goal = from_copy(comm, path, given, surface, scene.skin.scale) if given else None
    found = []
    for axis in range(3) if symmetry == "auto" else axes:
        try:
            _require_symmetric(scene, surface, goal, axis)
        except (ParameterError, SurfaceError, TargetError) as error:
            if symmetry != "auto":
                raise
            log.info("not cut at %s = 0: %s", "xyz"[axis], error)
        else:
            found.append(axis)
    part = cut_at_planes(surface, found)
    pattern = straightened(scene.skin.unwrapped(comm, part.surface).pattern, found)
    return OwnSkin(pattern, None if goal is None else part.at_vertices(goal), tuple(found))


def _require_symmetric(
    scene: OwnMeshScene, body: Surface | Pattern, goal: Floats | None, axis: int
) -> None:
    """Check that a body, its regions and its target are symmetric about a plane.

    Raises:
        TorosError: One is not; the message names it.
    """
    scene.require_symmetric_knit((axis,))
    if isinstance(body, Surface):
        require_symmetric(body, axis)
    for name in ("held", "printed", "plain"):
        for region in getattr(scene, name):
            region.require_symmetric(name, body.points, axis)
    if goal is None:
        deform = scene.target.deformer(scene.target.of_body(body))
        require_symmetric_map(body.points, (axis,), deform)
    elif isinstance(body, Surface):
        require_symmetric(replace(body, points=goal), axis, "the target")


def _target(scene: OwnMeshScene, skin: OwnSkin, axis: BodyAxis) -> Callable[[Pattern], Floats]:
    """Return the target positions of the vertices of the whole pattern, or of a refined one."""
    if skin.target is None:
        deform = scene.target.deformer(axis)
        return lambda whole: deform(whole.points)
    for name in ("bend", "twist", "shorten"):
        if (value := scene.target.value(name)) is not None:
            raise ParameterError(
                f"there are two targets: a file, and {name} = {value:g}. Leave one out."
            )
    return skin.goal


def _supports(scene: OwnMeshScene, pattern: Pattern) -> Supports:
    if not scene.held:
        raise ParameterError(
            'nothing holds the skin: give held, with where = "z < 5 mm" for instance.'
        )
    fixed = np.zeros((len(pattern.points), 3), dtype=bool)
    for held in scene.held:
        columns = np.array([letter in held.components for letter in "xyz"])
        fixed |= held.vertices(pattern)[:, None] & columns
    if fixed.all():
        raise ParameterError(
            "held holds every vertex, so that nothing can move. Check its unit: a plain number is "
            "in m."
        )
    return Supports(fixed)


def _passive(scene: OwnMeshScene, pattern: Pattern) -> Floats | None:
    """Return the prescribed density of all triangles, (t,), NaN where it is designed."""
    if not (scene.printed or scene.plain):
        return None
    found = np.full(len(pattern.panel), np.nan)
    for region in scene.printed:
        found[region.cells(pattern)] = 1.0
    for bare in scene.plain:
        cells = bare.cells(pattern)
        if (found[cells] == 1).any():
            raise ParameterError("a triangle is both in printed and in plain; keep them apart.")
        found[cells] = 0.0
    if not np.isnan(found).any():
        raise ParameterError("printed and plain leave nothing to design; make them smaller.")
    return found


def _metrics(
    scene: OwnMeshScene, axis: BodyAxis, target: Callable[[Pattern], Floats]
) -> list[Metric]:
    """Return the metrics of the objective, their targets measured on one that comes as a file."""
    asked, names, found = scene.target.asked, scene.objective.metric_names, []
    if names is None:
        names = (*asked, *(["distance"] if scene.objective.counted == "shape" else []))

    def off(pattern: Pattern, positions: Floats) -> float:
        return 1e3 * distance(pattern, positions, target(pattern))

    for name in names:
        if name == "distance":
            found.append(Metric("distance", "mm", 0.0, off, 1e3 * axis.length))
            continue
        metric, skin = axis.metric(name, asked.get(name)), scene.own_skin
        if skin.target is not None:
            metric = replace(metric, target=metric.measure(skin.whole, target(skin.whole)))
        found.append(metric)
    return found
