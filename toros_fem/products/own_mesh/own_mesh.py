"""A skin of your own from a mesh file: its supports, its print, its target and its metrics."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, ClassVar, Self

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import (
    Count,
    Distance,
    In,
    Length,
    OneOf,
    Place,
    Table,
    key,
)
from toros_fem.base.scene import NO_TABLE
from toros_fem.design.loop.case import Case
from toros_fem.measures.body_axis import DIRECTIONS, BodyAxis, body_axis
from toros_fem.measures.cross_sections import CrossSections
from toros_fem.measures.metrics import Metric, distance
from toros_fem.measures.shape import Part, ShapePart
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes.deformed import from_copy, from_mesh
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.pattern_file import NAME, read_pattern
from toros_fem.meshes.refine import refine
from toros_fem.meshes.topology import half_edges
from toros_fem.products.actuators.scene import ActuatorScene, Level
from toros_fem.products.actuators.simulate import FILES
from toros_fem.products.own_mesh.metrics import Measured, judged_by
from toros_fem.products.own_mesh.regions import Region
from toros_fem.products.tables.loads import SectionWeights
from toros_fem.products.tables.steps import Designing
from toros_fem.products.tables.unwrapping import Unwrapping

COMPONENTS = ("x", "y", "z", "xy", "xz", "yz", "xyz")
COUNTED = ("shape", "cross-sections")
METRICS = ("distance", "angle", "twist", "shortening")
# Filter radius over the mean edge length, where none is given.
FILTER_EDGES = 1.5
MESH = {"mesh": f"mesh file (STL, OBJ, PLY, MSH, VTU), or a {NAME} with its panels"}
TARGET = {
    "target": "the same mesh deformed to the target, its triangles in the same order; none: the "
    "target is that of the table [target]"
}


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


@dataclass(frozen=True)
class MeshFile(Unwrapping):
    """Sizes and mesh."""

    refinements: Annotated[int, In(at_least=0, at_most=6)] = key(
        0, "how often each triangle of the file is divided into four"
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
                raise ParameterError(
                    f"metrics = {self.metrics!r} names {name!r}; known are {', '.join(METRICS)}.",
                    "metrics",
                )

    @property
    def metric_names(self) -> tuple[str, ...] | None:
        """Names of the metrics; None for those of the target."""
        if self.metrics is None:
            return None
        return tuple(dict.fromkeys(name.strip() for name in self.metrics.split(",")))


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
        pattern: Panels and seams on the mesh of the file.
        target: Target positions of its vertices, (n, 3), in m; None where the configuration
            describes the target.
    """

    pattern: Pattern
    target: Floats | None = None

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
    ABOUT: ClassVar[str] = "a skin of your own, from a mesh file"
    DESIGN_FILES: ClassVar[Mapping[str, str]] = {**MESH, **TARGET}
    SIMULATION_FILES: ClassVar[Mapping[str, str]] = {**MESH, **TARGET, **FILES}
    EXAMPLE_FILES: ClassVar[Mapping[str, str]] = {"mesh": "my.stl"}
    FEW: ClassVar[tuple[str, ...]] = (
        "bend",
        "twist",
        "shorten",
        "axis",
        "toward",
        "scale",
        "cuts",
        "pressure",
        "design_pressure",
        "seed",
    )

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
        radius, design = self.design.filter_radius, self.design
        return self.updated(
            filter_radius=None if radius is None else radius * 2.0**self.skin.refinements,
            levels=1,
            refinements=0,
            iterations=min(design.iterations, 30),
            constrained_iterations=min(design.constrained_iterations, 20),
            corrections=min(design.corrections, 1),
            polish_iterations=min(design.polish_iterations, 10),
        )

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
        skin, asked = self.own_skin, self.target
        pattern = _refined(skin, level.refinements)[0]
        axis = body_axis(skin.pattern, asked.axis, asked.toward, asked.begin, asked.end)
        target = _target(self, skin, axis)
        return Case(
            pattern,
            target(pattern),
            _supports(self, pattern),
            self.pressure.pressure,
            self.pressure.bounds,
            self.material.composite,
            parts=[_part(self, pattern, axis)],
            metrics=judged_by(self.metric, axis, _metrics(self, skin, axis, target)),
            passive=_passive(self, pattern),
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
    comm: MPI.Comm, config: OwnMeshScene, mesh: Path | str, target: Path | str | None = None
) -> OwnSkin:
    """Read a mesh, cut it into flat panels, and read its target (collective).

    Args:
        comm: Communicator.
        config: Scale and cuts.
        mesh: Mesh file; or a pattern file, or the folder that it lies in.
        target: Mesh file of the target; None for none.

    Raises:
        TorosError: A file cannot be read, or does not fit.
    """
    path = Path(mesh)
    if comm.bcast(path.is_dir()):
        path = path / NAME
    if path.suffix == ".npz":
        pattern = read_pattern(comm, path)
        return OwnSkin(pattern, None if target is None else from_mesh(comm, Path(target), pattern))
    pattern = config.skin.unwrapped(comm, config.skin.surface(comm, path)).pattern
    if target is None:
        return OwnSkin(pattern)
    return OwnSkin(pattern, from_copy(comm, path, Path(target), pattern, config.skin.scale))


def _refined(skin: OwnSkin, times: int) -> tuple[Pattern, Floats | None]:
    """Return a refined pattern and the target on it."""
    pattern, target = skin.pattern, skin.target
    for _ in range(times):
        finer = refine(pattern)
        pattern, target = finer.pattern, None if target is None else finer.at_vertices(target)
    return pattern, target


def _target(config: OwnMeshScene, skin: OwnSkin, axis: BodyAxis) -> Callable[[Pattern], Floats]:
    """Return the target positions of the vertices of the pattern, or of a refined one."""
    asked = {
        "bend": config.target.bend,
        "twist": config.target.twist,
        "shorten": config.target.shorten,
    }
    given = [name for name, value in asked.items() if value is not None]
    if skin.target is None:
        if not given:
            raise ParameterError(
                "there is no target: give bend, twist or shorten, or a target file of the deformed "
                "mesh."
            )
        deform = axis.deformer(
            None if config.target.bend is None else float(np.radians(config.target.bend)),
            None if config.target.twist is None else float(np.radians(config.target.twist)),
            None if config.target.shorten is None else config.target.shorten / 100,
            axis.half_width if config.target.neutral is None else config.target.neutral,
        )
        return lambda pattern: deform(pattern.points)
    if given:
        raise ParameterError(
            f"there are two targets: a file, and {given[0]} = {asked[given[0]]:g}. Leave one out."
        )

    def of_file(pattern: Pattern) -> Floats:
        times = 0
        while len(skin.pattern.panel) * 4**times < len(pattern.panel):
            times += 1
        target = _refined(skin, times)[1]
        assert target is not None
        return target

    return of_file


def _supports(config: OwnMeshScene, pattern: Pattern) -> Supports:
    if not config.held:
        raise ParameterError(
            'nothing holds the skin: give held, with where = "z < 5 mm" for instance.'
        )
    fixed = np.zeros((len(pattern.points), 3), dtype=bool)
    for held in config.held:
        columns = np.array([letter in held.components for letter in "xyz"])
        fixed |= held.vertices(pattern)[:, None] & columns
    if fixed.all():
        raise ParameterError(
            "held holds every vertex, so that nothing can move. Check its unit: a plain number is "
            "in m."
        )
    return Supports(fixed)


def _passive(config: OwnMeshScene, pattern: Pattern) -> Floats | None:
    """Return the prescribed density of all triangles, (t,), NaN where it is designed."""
    if not (config.printed or config.plain):
        return None
    found = np.full(len(pattern.panel), np.nan)
    for region in config.printed:
        found[region.cells(pattern)] = 1.0
    for bare in config.plain:
        cells = bare.cells(pattern)
        if (found[cells] == 1).any():
            raise ParameterError("a triangle is both in printed and in plain; keep them apart.")
        found[cells] = 0.0
    if not np.isnan(found).any():
        raise ParameterError("printed and plain leave nothing to design; make them smaller.")
    return found


def _metrics(
    config: OwnMeshScene, skin: OwnSkin, axis: BodyAxis, target: Callable[[Pattern], Floats]
) -> tuple[Metric, ...]:
    """Return the metrics, their targets measured on a target that comes as a file."""
    asked = {
        "angle": config.target.bend,
        "twist": config.target.twist,
        "shortening": config.target.shorten,
    }
    names = config.objective.metric_names
    if names is None:
        names = tuple(name for name, value in asked.items() if value is not None)
        if config.objective.counted == "shape":
            names = (*names, "distance")
    makers = {
        "angle": axis.angle_metric,
        "twist": axis.twist_metric,
        "shortening": axis.shortening_metric,
    }
    found = []
    for name in names:
        if name == "distance":
            found.append(Metric("distance", "mm", 0.0, _distance(target), 1e3 * axis.length))
            continue
        metric = makers[name](asked[name])
        if skin.target is not None:
            metric = makers[name](metric.measure(skin.pattern, skin.target))
        found.append(metric)
    return tuple(found)


def _distance(target: Callable[[Pattern], Floats]) -> Callable[[Pattern, Floats], float]:
    return lambda pattern, positions: 1e3 * distance(pattern, positions, target(pattern))


def _part(config: OwnMeshScene, pattern: Pattern, axis: BodyAxis) -> Part:
    """Return what counts: the shape with weights of its tip, or cross-sections, as of a tube."""
    goal = config.objective
    if goal.counted == "cross-sections":
        return _sections(goal, pattern, axis)
    if not (goal.tip_weight or goal.orientation_length):
        return ShapePart()
    tip, area, weights = axis.tip(pattern), pattern.vertex_areas, np.ones(len(pattern.points))
    weights[tip] += goal.tip_weight * area.sum() / area[tip].sum()
    if not goal.orientation_length:
        return ShapePart(weights)
    # Turned by a small angle about a diameter a tip moves by angle · radius/√2 in root mean square.
    arm = pattern.points[tip] - np.average(pattern.points[tip], axis=0, weights=area[tip])
    radius = float(np.sqrt(np.average((arm**2).sum(axis=1), weights=area[tip])))
    relative = np.zeros(len(pattern.points))
    ratio = np.sqrt(2) * goal.orientation_length / radius
    relative[tip] = ratio**2 * (area @ weights) / area[tip].sum()
    return ShapePart(weights, relative)


def _sections(goal: OwnWeights, pattern: Pattern, axis: BodyAxis) -> CrossSections:
    """Return cross-sections, weighted as those of the tube."""
    labels, count = axis.labels(pattern, goal.cross_sections), goal.cross_sections
    if axis.flat_tip:
        fraction = np.append(np.full(count, 1 / count), goal.tip_weight)
    else:
        fraction = np.append(np.full(count - 1, 1 / count), max(1 / count, goal.tip_weight))
    along = np.abs(axis.along) > 0.5
    components = np.where(along, goal.axial_weight, 1.0)
    ratio = goal.orientation_length / pattern.size
    orientation = np.full(len(fraction), len(fraction) * fraction[-1] * ratio**2)
    return CrossSections(labels, np.outer(fraction, components), orientation)
