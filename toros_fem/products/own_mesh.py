"""A skin of your own from a mesh file: its supports, its print, its target and its metrics."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, ClassVar, Self

import numpy as np
from mpi4py import MPI
from pydantic import InstanceOf

from toros_fem.base.errors import ParameterError, PatternError, SurfaceError
from toros_fem.base.keys import Count, Distance, In, Length, OneOf, Place, Table, Text, key
from toros_fem.base.scene import NO_TABLE
from toros_fem.base.validation import Floats
from toros_fem.design.loop.case import Case
from toros_fem.measures.metrics import Metric, distance
from toros_fem.measures.regions import DIRECTIONS, BodyAxis, body_axis
from toros_fem.measures.shape import Part, ShapePart
from toros_fem.mechanics.skin.supports import Supports, symmetry_planes
from toros_fem.meshes.files import PATTERN_FILE, from_copy, from_mesh, gap_hint, read_pattern
from toros_fem.meshes.pattern import Pattern, mirrored, require_symmetric_map
from toros_fem.meshes.surface import (
    NEAR,
    Surface,
    cut_at_planes,
    holes,
    require_symmetric,
    straightened,
    volume,
)
from toros_fem.meshes.targets import Deformer
from toros_fem.meshes.transfer import refine
from toros_fem.meshes.triangles import half_edges, lengths
from toros_fem.products.actuators.scene import SOURCE, ActuatorScene, Level
from toros_fem.products.actuators.simulate import FILES
from toros_fem.products.common.options import Unwrapping
from toros_fem.products.common.plausibility import Group, Inflated, bend_strain
from toros_fem.products.common.tables import (
    BendAngle,
    DesignTable,
    SectionWeights,
    Shortening,
    TwistAngle,
    bend_key,
    shortening_key,
    twist_key,
)
from toros_fem.products.own_metrics import MetricTable, Region, judged_by

COMPONENTS = ("x", "y", "z", "xy", "xz", "yz", "xyz")
SYMMETRIES = (*COMPONENTS[:-1], "auto")
METRICS = ("distance", "angle", "twist", "shortening")
# Filter radius over the mean edge length, where none is given.
FILTER_EDGES = 1.5
# Part of an edge within which a vertex moves into a plane where the part is meshed anew.
EXACT = 1e-3
MESH = {"mesh": f"mesh file (STL, OBJ, PLY, MSH, XDMF), or a {PATTERN_FILE} with its panels"}
TARGET = {
    "target": "the same mesh deformed to the target, its triangles in the same order; none: the "
    "target is that of the table [target]"
}
log = logging.getLogger(__name__)


class Held(Region):
    """Where the skin is held."""

    components: Annotated[str, OneOf(COMPONENTS)] = key(
        "xyz", "components of the position that are held, of the others the skin is free"
    )


class Printed(Region):
    """Where it is printed all over."""


class Plain(Region):
    """Where nothing is printed."""


class OwnTarget(Table):
    """Shape that is asked for."""

    bend: BendAngle | None = bend_key(None)
    twist: TwistAngle | None = twist_key(None)
    shorten: Shortening | None = shortening_key(None)
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
        """What is given of the targets of metrics, by the names of these, in deg and %."""
        values = {one.metric: getattr(self, name) for name, one in self.described().items()}
        return {name: value for name, value in values.items() if name and value is not None}

    def of_body(self, body: Pattern | Surface) -> BodyAxis:
        """Return the axis of a whole body."""
        return body_axis(body, self.axis, self.toward, self.begin, self.end)

    def outer(self, axis: BodyAxis) -> float:
        """Return the distance in m of a bend's outer side from the line that keeps its length."""
        return axis.half_width + (axis.half_width if self.neutral is None else self.neutral)

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
        bend, twist = np.radians(self.bend or 0.0), np.radians(self.twist or 0.0)
        neutral = axis.half_width if self.neutral is None else self.neutral
        return axis.deformer(bend, twist, (self.shorten or 0.0) / 100, neutral)


class MeshFile(Unwrapping):
    """Sizes and mesh."""

    refinements: Annotated[int, In(at_least=0, at_most=6)] = key(
        0,
        "how often each triangle of the file is divided into four; with 0 only check_refinement "
        "gives intervals",
    )
    symmetry: Annotated[str, OneOf(SYMMETRIES)] | None = key(
        None,
        "planes that mesh, regions and target are symmetric about, x for x = 0: the part at x >= 0 "
        "is designed, and the print is symmetric; auto finds them; none designs the whole",
    )


class OwnWeights(SectionWeights):
    """What counts in the objective.

    Raises:
        ParameterError: A metric is unknown.
    """

    counted: Annotated[str, OneOf(("shape", "cross-sections"))] = key(
        "shape", "what counts: the whole shape, or cross-sections only, which may swell freely"
    )
    metrics: Text | None = key(
        None,
        f"numbers to judge by, of {', '.join(METRICS)}, with commas between them; none takes those "
        "of the target",
    )
    cross_sections: Count = key(12, "number of cross-sections")

    def __post_init__(self) -> None:
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

    def part(self, whole: Pattern, axis: BodyAxis) -> Part:
        """Return the objective of a whole body: its shape or its cross-sections."""
        if self.counted == "cross-sections":
            labels, along = axis.labels(whole, self.cross_sections), np.argmax(np.abs(axis.along))
            return self.sections_part(whole, labels, int(along), border=axis.flat_tip)
        if not (self.tip_weight or self.orientation_length):
            return ShapePart()
        tip = axis.tip(whole)
        area, points = whole.vertex_areas[tip], whole.points[tip]
        arm = points - np.average(points, axis=0, weights=area)
        radius = np.sqrt(np.average((arm**2).sum(axis=1), weights=area))
        return self.shape_part(whole, tip, tip, float(radius))


class OwnDesignTable(DesignTable):
    """Steps, filter and start of the design."""

    filter_radius: Length | None = key(  # type: ignore[assignment]
        None, "radius R of the filter on the finest mesh; none takes one and a half edge lengths"
    )


@dataclass(frozen=True, eq=False)
class OwnSkin:
    """What the files of a scene hold, the same on all ranks.

    Attributes:
        pattern: Panels and seams on the mesh of the file, or of its part at the planes.
        target: Target positions of its vertices, (n, 3), in m; None where the scene tells it.
        planes: Axes of the symmetry planes that it is cut at.
    """

    pattern: Pattern
    target: Floats | None = None
    planes: tuple[int, ...] = ()

    @property
    def whole(self) -> Pattern:
        """The whole skin on the mesh of the file."""
        return mirrored(self.pattern, self.planes).pattern

    def refined(self, times: int) -> OwnSkin:
        """Return the same skin after each triangle was divided into four so often."""
        skin = self
        for _ in range(times):
            finer = refine(skin.pattern)
            target = None if skin.target is None else finer.at_vertices(skin.target)
            skin = replace(skin, pattern=finer.pattern, target=target)
        return skin

    def goal(self, whole: Pattern) -> Floats:
        """Return the target of the file on the whole skin, refined as this one is, (n, 3)."""
        times = round(np.log(len(whole.panel) / len(self.whole.panel)) / np.log(4))
        skin = self.refined(times)
        assert skin.target is not None
        return mirrored(skin.pattern, self.planes).at_vertices(skin.target)

    @property
    def edge_length(self) -> float:
        """Mean edge length of the mesh of the file in m."""
        return float(lengths(self.pattern.points, half_edges(self.pattern.triangles)).mean())


class OwnMeshScene(ActuatorScene):
    """A skin of your own."""

    target: OwnTarget = OwnTarget()
    skin: MeshFile = MeshFile()
    held: tuple[Held, ...] = ()
    printed: tuple[Printed, ...] = ()
    plain: tuple[Plain, ...] = ()
    objective: OwnWeights = OwnWeights()
    metric: tuple[MetricTable, ...] = ()
    design: OwnDesignTable = OwnDesignTable()

    KIND: ClassVar = "own-mesh"
    # A section that is not round resists the pressure too. From less, designs climb to the pressure
    # too late, and end in traps with much print.
    START_STRAIN: ClassVar = 1.9
    DESIGN_FILES: ClassVar = {**MESH, **TARGET, **SOURCE}
    SIMULATION_FILES: ClassVar = {**MESH, **TARGET, **FILES}
    EXAMPLE_FILES: ClassVar = {"mesh": "my.stl"}
    COARSE: ClassVar = {
        "iterations": 2 / 3,
        "constrained_iterations": 3 / 4,
        "polish_iterations": 1 / 2,
    }
    FEW: ClassVar = (
        "bend", "twist", "shorten", "axis", "toward", "scale", "remesh", "refinements",
        "symmetry", "pressure", "seed",
    )  # fmt: skip

    NEEDS: ClassVar = {
        "neutral": ("bend", ()),
        **dict.fromkeys(("cross_sections", "axial_weight"), ("counted", ("cross-sections",))),
    }

    # What the files hold, once they are read.
    read: InstanceOf[OwnSkin] | None = field(
        default=None, repr=False, compare=False, metadata=NO_TABLE
    )

    @classmethod
    def example(cls) -> Self:
        """Return what a new scene file holds: a body that stands on z = 0 and bends."""
        return cls.of(held=(Held(where="z < 5 mm"),), bend=60.0)

    def coarse(self) -> Self:
        """Return the same design on the mesh of the file, with few steps."""
        values, radius = self.coarse_values(), self.design.filter_radius
        values |= {"levels": 1, "refinements": 0}
        if radius is not None:
            values["filter_radius"] = radius * 2.0**self.skin.refinements
        return self.updated(**values)

    def with_files(self, comm: MPI.Comm, files: Mapping[str, Path]) -> Self:
        """Return the scene with its skin, and a filter radius if none is given (collective).

        They are the "mesh", a pattern file or its folder too, and the "target".

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

    @property
    def own_skin(self) -> OwnSkin:
        """What the files hold, after `with_files`."""
        assert self.read is not None
        return self.read

    @property
    def radius(self) -> float | None:
        """Radius in m of a round body of the same volume and area; None before it is read."""
        if self.read is None:
            return None
        whole = self.read.whole
        return abs(2 * volume(whole.points, whole.triangles)) / float(whole.areas.sum())

    @property
    def needed_strain(self) -> float | None:
        """Strain of the outer side of a bend; None of other targets and without the mesh."""
        asked = self.target
        if self.read is None or self.read.target is not None or set(asked.asked) != {"angle"}:
            return None
        body = asked.of_body(self.read.whole)
        assert asked.bend is not None
        return bend_strain(asked.bend, body.end - body.begin, asked.outer(body))

    def groups_of(self, skin: Inflated) -> Iterator[Group]:
        """Yield the dimensionless groups of the scene."""
        yield from super().groups_of(skin)
        read, asked = self.own_skin, self.target
        edge = read.edge_length / 2.0**self.skin.refinements
        yield Group("size", "scale", float(np.ptp(read.whole.points, axis=0).max()))
        yield Group("edges", "refinements", skin.girth / edge)
        if self.design.start != "relaxed" and self.design.filter_radius is not None:
            yield Group("filter", "filter_radius", self.design.filter_radius / edge)
        if read.target is not None:
            return
        body = asked.of_body(read.whole)
        length = body.end - body.begin
        if asked.bend is not None:
            yield from skin.bend("bend", asked.bend, length, asked.outer(body))
        if asked.twist is not None:
            yield from skin.twist("twist", asked.twist, length)
        if asked.shorten:
            yield from skin.shortening("shorten", asked.shorten / 100)

    def case(self, comm: MPI.Comm, level: Level) -> Case:
        """Return the case of the skin on its mesh, refined as the level says.

        Raises:
            ParameterError: A region holds nothing, nothing is held, or there is no target, or two.
            PanelError: There is no panel of a name.
        """
        del comm  # all ranks have the whole skin
        skin, hinged = self.own_skin, self.material.seams == "hinged"
        pattern = skin.refined(level.refinements).pattern
        whole, axis = mirrored(pattern, skin.planes).pattern, self.target.of_body(skin.whole)
        goal = self._goal(axis)
        supports = self._supports(pattern) | symmetry_planes(pattern, skin.planes, hinged=hinged)
        target = goal(whole)[: len(pattern.points)]  # those of the part come first
        metrics = judged_by(self.metric, axis, self._metrics(axis, goal))
        return replace(
            self.loaded(pattern, target, supports, skin.planes),
            parts=[self.objective.part(whole, axis)],
            metrics=[metric.of_whole(skin.planes) for metric in metrics],
            passive=self._passive(pattern),
            parts_of_whole=True,
        )

    def _goal(self, axis: BodyAxis) -> Callable[[Pattern], Floats]:
        """Return the target positions of the vertices of the whole pattern, or of a refined one."""
        skin = self.own_skin
        if skin.target is None:
            deform = self.target.deformer(axis)
            return lambda whole: deform(whole.points)
        for name in self.targets().values():
            if (value := getattr(self.target, name)) is not None:
                raise ParameterError(
                    f"there are two targets: a file, and {name} = {value:g}. Leave one out."
                )
        return skin.goal

    def _supports(self, pattern: Pattern) -> Supports:
        fixed = np.zeros((len(pattern.points), 3), dtype=bool)
        for held in self.held:
            columns = np.array([letter in held.components for letter in "xyz"])
            fixed |= held.vertices(pattern)[:, None] & columns
        if fixed.all() or not fixed.any():
            every = (
                "held holds every vertex, so that nothing can move. Check its unit: a plain number "
                "is in m."
            )
            none = 'nothing holds the skin: give held, with where = "z < 5 mm" for instance.'
            raise ParameterError(every if fixed.all() else none)
        return Supports(fixed)

    def _passive(self, pattern: Pattern) -> Floats | None:
        """Return the prescribed density of all triangles, (t,), NaN where it is designed."""
        if not (self.printed or self.plain):
            return None
        found, both = np.full(len(pattern.panel), np.nan), False
        for region in self.printed:
            found[region.cells(pattern)] = 1.0
        for bare in self.plain:
            cells = bare.cells(pattern)
            both = both or bool((found[cells] == 1).any())
            found[cells] = 0.0
        if both or not np.isnan(found).any():
            why = "have a triangle in both; keep them apart" if both else "leave nothing to design"
            raise ParameterError(f"printed and plain {why}. Make them smaller.")
        return found

    def _metrics(self, axis: BodyAxis, goal: Callable[[Pattern], Floats]) -> list[Metric]:
        """Return the metrics of the objective, their targets measured on one that is a file."""
        asked, skin, found = self.target.asked, self.own_skin, []
        of_target = (*asked, "distance") if self.objective.counted == "shape" else tuple(asked)

        def off(pattern: Pattern, positions: Floats) -> float:
            return 1e3 * distance(pattern, positions, goal(pattern))

        for name in self.objective.metric_names or of_target:
            if name == "distance":
                # Beside an angle it is only watched: the skin swells.
                wanted = None if asked and self.objective.metric_names is None else 0.0
                found.append(Metric("distance", "mm", wanted, off, 1e3 * axis.length))
                continue
            metric = axis.metric(name, asked.get(name))
            if skin.target is not None:
                metric = replace(metric, target=metric.measure(skin.whole, goal(skin.whole)))
            found.append(metric)
        return found

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

    def coarser(self, level: Level) -> tuple[float, Level]:
        """Return 2, and the mesh that was refined once less.

        Raises:
            ParameterError: The mesh is that of the file.
        """
        if level.refinements == 0:
            raise ParameterError(
                "the print is simulated on the mesh of the file, and there is no coarser one to "
                "compare with. Set refinements = 1 or check_refinement = 2, or give a coarser file "
                "and refine it."
            )
        return 2.0, replace(level, refinements=level.refinements - 1)

    def finer(self, level: Level, refinement: float) -> tuple[float, Level]:
        """Return the mesh that is refined more often: by the nearest power of 2, at least 2."""
        ratio = 0.5 ** max(1, round(np.log2(refinement)))
        return ratio, level.scaled(ratio)

    def _lines_on(self, refinements: int) -> Level:
        edge = self.own_skin.edge_length / 2.0**refinements
        return replace(self._of_lines(edge), edge_length=None, refinements=refinements)

    def require_symmetric(self, body: Surface | Pattern, goal: Floats | None, axis: int) -> None:
        """Check that a body, its regions, its knit and its target are symmetric about a plane.

        Args:
            body: The whole body.
            goal: Target positions of its vertices, (n, 3), in m; None where the scene tells it.
            axis: Normal of the plane, 0 for x, …

        Raises:
            TorosError: One is not; the message names it.
        """
        self.material.require_symmetric((axis,))
        if isinstance(body, Surface):
            require_symmetric(body, axis)
        for name in ("held", "printed", "plain"):
            for region in getattr(self, name):
                region.require_symmetric(name, body.points, axis)
        if goal is None:
            deform = self.target.deformer(self.target.of_body(body))
            require_symmetric_map(body.points, (axis,), deform)
        elif isinstance(body, Surface):
            require_symmetric(replace(body, points=goal), axis, "the target")


def read_skin(
    comm: MPI.Comm, scene: OwnMeshScene, mesh: Path, target: Path | None = None
) -> OwnSkin:
    """Read a mesh, cut it into flat panels, and read its target (collective).

    Args:
        scene: Scale, new mesh, cuts and symmetry.
        mesh: Mesh file; or a pattern file, or the folder that it lies in.
        target: Mesh file of the target; None for none.

    Raises:
        TorosError: A file cannot be read, or does not fit, or is not symmetric.
    """
    symmetry = scene.skin.symmetry
    axes = tuple(map("xyz".index, symmetry)) if symmetry not in (None, "auto") else ()
    if comm.bcast(mesh.is_dir()):
        mesh = mesh / PATTERN_FILE
    if mesh.suffix == ".npz":
        pattern = read_pattern(comm, mesh)
        if axes and not len(pattern.free_edges):
            raise ParameterError(
                f"symmetry = {symmetry!r} needs the mesh file, or the pattern of a part that was "
                f"cut there: {mesh} is that of a whole skin.",
                "symmetry",
            )
        if scene.skin.remesh is not None:
            raise ParameterError(f"remesh needs the mesh file; {mesh} has flat panels.", "remesh")
        goal = from_mesh(comm, target, pattern) if target else None
        for axis in axes:
            scene.require_symmetric(mirrored(pattern, axes).pattern, goal, axis)
        return OwnSkin(pattern, goal, axes)
    surface, found = scene.skin.surface(comm, mesh), []
    if not surface.closed:
        raise PatternError(
            f"{mesh} is open, and a pressure needs a closed skin: {holes(surface)}. "
            f"{gap_hint(surface.points, surface.triangles) or 'Fill the holes. '}"
            "If flat panels are still to be sewn, sew them in Python (meshes.sew)."
        )
    goal = from_copy(comm, mesh, target, surface, scene.skin.scale) if target else None
    for axis in range(3) if symmetry == "auto" else axes:
        try:
            scene.require_symmetric(surface, goal, axis)
        except (ParameterError, SurfaceError) as error:
            if symmetry != "auto":
                raise
            log.info("not cut at %s = 0: %s", "xyz"[axis], error)
        else:
            found.append(axis)
    near = NEAR if scene.skin.remesh is None else EXACT  # a new mesh needs no good triangles here
    part, of_part = cut_at_planes(surface, found, near)
    part, weights = scene.skin.meshed(comm, part)
    pattern = straightened(scene.skin.unwrapped(comm, part).pattern, found)
    return OwnSkin(pattern, None if goal is None else weights @ (of_part @ goal), tuple(found))
