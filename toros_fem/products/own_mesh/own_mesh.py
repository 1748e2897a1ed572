"""A skin of your own from a mesh file: its supports, its print, its target and its metrics."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import (
    Count,
    Distance,
    In,
    Length,
    Number,
    OneOf,
    Place,
    Positive,
    Table,
    key,
)
from toros_fem.measures.body_axis import DIRECTIONS, BodyAxis, body_axis
from toros_fem.measures.cross_sections import CrossSections
from toros_fem.measures.metrics import Metric, distance
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes import read_surface, unwrap
from toros_fem.meshes.chart import METHODS
from toros_fem.meshes.deformed import from_copy, from_mesh
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.pattern_file import NAME, read_pattern
from toros_fem.meshes.refine import refine
from toros_fem.meshes.topology import half_edges
from toros_fem.products.actuators.case import ActuatorCase
from toros_fem.products.actuators.problem import CaseMaker
from toros_fem.products.actuators.run import design_actuator
from toros_fem.products.actuators.scene import ActuatorScene
from toros_fem.products.actuators.simulate import FILES, simulate_actuator
from toros_fem.products.own_mesh.regions import Region
from toros_fem.products.tables.loads import SectionWeights
from toros_fem.products.tables.steps import Designing

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
class MeshFile(Table):
    """Sizes and mesh."""

    scale: Length = key(1e-3, "length of the mesh file's unit; a pattern is in m")
    component: Number | None = key(
        None, "connected component of the file, 0 for the largest; none: it holds only one"
    )
    refinements: Annotated[int, In(at_least=0, at_most=6)] = key(
        0, "how often each triangle of the file is divided into four"
    )
    cuts: Annotated[str, OneOf(("given", "auto"))] = key(
        "given",
        "where the surface is cut into panels: at the lines and parts of the file, found "
        "if it has none, or always found",
    )
    method: Annotated[str, OneOf(METHODS)] = key("auto", "how panels are laid flat")
    crease_angle: Annotated[float, In("deg", above=0, at_most=180)] = key(
        45.0, "angle between normals above which a found cut follows an edge"
    )
    max_stretch: Positive | None = key(
        None, "largest stretch of a panel; none: 0.15 with found cuts, no bound with given ones"
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


@dataclass(frozen=True)
class OwnMeshScene(ActuatorScene):
    """A skin of your own."""

    target: Deformed = Deformed()
    skin: MeshFile = MeshFile()
    held: tuple[Held, ...] = ()
    printed: tuple[Printed, ...] = ()
    plain: tuple[Plain, ...] = ()
    objective: OwnWeights = OwnWeights()
    design: OwnDesigning = OwnDesigning()

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

    @property
    def _most_levels(self) -> int:
        return 1 + self.skin.refinements

    def at_level(self, level: int) -> Self:
        """Return the configuration of one mesh alone, as of `ActuatorScene`."""
        coarser = self.level_count - 1 - level
        return super().at_level(level).updated(refinements=self.skin.refinements - coarser)

    @property
    def of_relaxed(self) -> Self:
        """The configuration of the relaxed design, on the mesh of the file."""
        return super().of_relaxed.updated(refinements=0)


def coarse(config: OwnMeshScene) -> OwnMeshScene:
    """Return the same design on the mesh of the file, with few steps."""
    radius = config.design.filter_radius
    return config.updated(
        filter_radius=None if radius is None else radius * 2.0**config.skin.refinements,
        levels=1,
        refinements=0,
        iterations=min(config.design.iterations, 30),
        constrained_iterations=min(config.design.constrained_iterations, 20),
        corrections=min(config.design.corrections, 1),
        polish_iterations=min(config.design.polish_iterations, 10),
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
    pattern = unwrap(
        comm,
        read_surface(comm, path, config.skin.scale, config.skin.component),
        "auto" if config.skin.cuts == "auto" else None,
        config.skin.method,
        crease_angle=np.radians(config.skin.crease_angle),
        max_stretch=config.skin.max_stretch,
    ).pattern
    if target is None:
        return OwnSkin(pattern)
    return OwnSkin(pattern, from_copy(comm, path, Path(target), pattern, config.skin.scale))


def own_case(comm: MPI.Comm, config: OwnMeshScene, skin: OwnSkin) -> ActuatorCase:
    """Return the case of a skin on its mesh, refined as the configuration says.

    Args:
        comm: Communicator; not used, since all ranks have the whole skin.
        config: Regions, target, weights and metrics.
        skin: The skin on the mesh of its file.

    Raises:
        ParameterError: A region holds nothing, nothing is held, or there is no target, or two.
        PanelError: There is no panel of a name.
    """
    del comm
    pattern = _refined(skin, config.skin.refinements)[0]
    axis = body_axis(
        skin.pattern,
        config.target.axis,
        config.target.toward,
        config.target.begin,
        config.target.end,
    )
    target = _target(config, skin, axis)
    goal = target(pattern)
    case = ActuatorCase(
        pattern=pattern,
        target=goal,
        supports=_supports(config, pattern),
        metrics=_metrics(config, skin, axis, target),
        passive=_passive(config, pattern),
    )
    if config.objective.counted == "cross-sections":
        return _with_cross_sections(case, config, axis)
    return _with_weights(case, config, axis)


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


def _with_weights(case: ActuatorCase, config: OwnMeshScene, axis: BodyAxis) -> ActuatorCase:
    """Return the case with weights of the tip's position and orientation, as those of the tube."""
    if not (config.objective.tip_weight or config.objective.orientation_length):
        return case
    pattern, tip = case.pattern, axis.tip(case.pattern)
    area, weights = pattern.vertex_areas, np.ones(len(pattern.points))
    weights[tip] += config.objective.tip_weight * area.sum() / area[tip].sum()
    if not config.objective.orientation_length:
        return replace(case, weights=weights)
    # Turned by a small angle about a diameter a tip moves by angle · radius/√2 in root mean square.
    arm = pattern.points[tip] - np.average(pattern.points[tip], axis=0, weights=area[tip])
    radius = float(np.sqrt(np.average((arm**2).sum(axis=1), weights=area[tip])))
    relative = np.zeros(len(pattern.points))
    ratio = np.sqrt(2) * config.objective.orientation_length / radius
    relative[tip] = ratio**2 * (area @ weights) / area[tip].sum()
    return replace(case, weights=weights, relative=relative)


def _with_cross_sections(case: ActuatorCase, config: OwnMeshScene, axis: BodyAxis) -> ActuatorCase:
    """Return the case with an objective of cross-sections, weighted as those of the tube."""
    labels, count = (
        axis.labels(case.pattern, config.objective.cross_sections),
        config.objective.cross_sections,
    )
    if axis.flat_tip:
        fraction = np.append(np.full(count, 1 / count), config.objective.tip_weight)
    else:
        fraction = np.append(
            np.full(count - 1, 1 / count), max(1 / count, config.objective.tip_weight)
        )
    along = np.abs(axis.along) > 0.5
    components = np.where(along, config.objective.axial_weight, 1.0)
    ratio = config.objective.orientation_length / case.pattern.size
    orientation = np.full(len(fraction), len(fraction) * fraction[-1] * ratio**2)
    sections = CrossSections(labels, np.outer(fraction, components), orientation)
    return replace(case, cross_sections=sections)


def _resolved(config: OwnMeshScene, skin: OwnSkin) -> OwnMeshScene:
    """Return the configuration with a filter radius."""
    if config.design.filter_radius is not None:
        return config
    points, ends = skin.pattern.points, half_edges(skin.pattern.triangles)
    edge = float(np.linalg.norm(points[ends[:, 1]] - points[ends[:, 0]], axis=1).mean())
    return config.updated(filter_radius=FILTER_EDGES * edge / 2.0**config.skin.refinements)


def cases(
    comm: MPI.Comm,
    config: OwnMeshScene,
    *,
    mesh: Path | str | None = None,
    target: Path | str | None = None,
) -> tuple[CaseMaker[OwnMeshScene], OwnMeshScene]:
    """Return what makes the case of a skin of your own, and the configuration with its radius.

    Args:
        comm: Communicator (collective).
        config: Numbers of the design.
        mesh: Mesh file; or a pattern file, or the folder that it lies in.
        target: Mesh file of the target; None takes that of the configuration.

    Raises:
        TorosError: A file cannot be read, or does not fit.
    """
    if mesh is None:
        raise ParameterError("there is no mesh: name a mesh file.")
    skin = read_skin(comm, config, mesh, target)
    return (lambda comm, config: own_case(comm, config, skin)), _resolved(config, skin)


def run(
    comm: MPI.Comm,
    output: Path | str,
    config: OwnMeshScene,
    *,
    mesh: Path | str | None = None,
    target: Path | str | None = None,
    verbose: bool = False,
) -> dict[str, Any]:
    """Design the print of a skin of your own and write all results; return the summary.

    Args:
        comm: Communicator.
        output: Folder for the results.
        config: Numbers of this design.
        mesh: Mesh file; or a pattern file, or the folder that it lies in.
        target: Mesh file of the target; None takes that of the configuration.
        verbose: Whether to print every Newton step.

    Raises:
        TorosError: A file cannot be read, or numbers, regions and mesh do not fit.
    """
    case, config = cases(comm, config, mesh=mesh, target=target)
    return design_actuator(comm, output, case, config, verbose=verbose).summary


def simulate(
    comm: MPI.Comm,
    output: Path | str,
    config: OwnMeshScene,
    *,
    mesh: Path | str | None = None,
    target: Path | str | None = None,
    pattern: Path | str | None = None,
    verbose: bool = False,
) -> dict[str, Any]:
    """Inflate a skin of your own without designing it, as `simulate_actuator`.

    Args:
        comm, output, config, mesh, target, verbose: As of `run`.
        pattern: Output folder of a design of this skin; None: only what is always printed is.
    """
    case, config = cases(comm, config, mesh=mesh, target=target)
    return simulate_actuator(comm, output, case, config, pattern=pattern, verbose=verbose)


DESIGN_FILES = {**MESH, **TARGET}
SIMULATION_FILES = {**MESH, **TARGET, **FILES}
# What a new scene file shows: a body that stands on z = 0 and bends.
EXAMPLE = OwnMeshScene.of(
    held=(Held(where="z < 5 mm"),),
    bend=60.0,
    design_pressure=True,
)
