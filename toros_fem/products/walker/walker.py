"""An X-shaped walker that stands up or crawls when inflated (paper Figs. 9, 10).

A quarter with one leg is designed, by symmetry: for the shape of its legs, or for the stride of its
gait. The whole robot is printed. Half of it, front and rear leg on one side, then walks on the
ground, with its own weight, friction and self-contact, through cycles of a gait: chambers are
filled and emptied fully. A gait is a path of equilibria, without inertia.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from toros_fem.base.array_types import Bools, Floats
from toros_fem.base.keys import (
    Count,
    Factor,
    In,
    Length,
    OneOf,
    Place,
    Positive,
    Table,
    key,
)
from toros_fem.design.loop.case import Case
from toros_fem.measures.cross_sections import CrossSections, label_cross_sections
from toros_fem.measures.metrics import Metric
from toros_fem.mechanics.contact.library import ipctk
from toros_fem.mechanics.contact.pads import Pads
from toros_fem.mechanics.contact.settings import Contact, Ground
from toros_fem.mechanics.equilibrium.equilibrium import EquilibriumError
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.trace import trace
from toros_fem.mechanics.paths.trace_point import TracePoint
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.dead_loads import Weight
from toros_fem.mechanics.skin.supports import symmetry_plane
from toros_fem.meshes import Pattern, Star, compose, plane_centroids, sew, stand, walker
from toros_fem.meshes.mirror import Mirrored, mirrored
from toros_fem.products.actuators.designer import design_actuator
from toros_fem.products.actuators.legs import (
    leg_cross_sections,
    leg_vertices,
    rest_on_body,
    tip_angle_metric,
)
from toros_fem.products.actuators.scene import ActuatorScene, Level
from toros_fem.products.tables.loads import Contacts, Orientation, Pressing, Results
from toros_fem.products.tables.sheets import SkinSheets
from toros_fem.products.tables.steps import Designing
from toros_fem.products.walker.gait import (
    Gait,
    GaitFigures,
    Walk,
    flat_on_ground,
    gait_figures,
    walk_of,
    write_gait,
)
from toros_fem.results.result import RunResult, write_summary
from toros_fem.results.summary import PrintedResult

AIMS = ("shape", "stride")
ANGLE = {"stand": 90.0, "crawl": 60.0}  # of the legs, in degrees
CHAMBERS = ("body", "front", "rear")
# Phases of the gait: pressure of each chamber at their ends, over the full one.
PHASES = {
    # Bent legs draw the rear feet up to the front ones; emptied, these push the front ones ahead.
    "one-way": np.array([[1, 1, 1], [1, 0, 0]]),
    # Rear feet grip, the body reaches out, front feet grip, rear feet let go, the body draws in.
    "nonslip": np.array([[0, 0, 1], [1, 0, 1], [1, 1, 1], [1, 1, 0], [0, 1, 0], [0, 1, 1]]),
}
# Part of the shape in the objective of a stride: it tells down from up.
SHAPE_IN_STRIDE = 0.1
DOWN = (0.0, 0.0, -1.0)
# Fig. 10 of the paper: distance in m by which the crawling robot gets ahead in a cycle.
MEASURED_STRIDE = ("paper, measured", 0.025)


@dataclass(frozen=True)
class LegTarget(Table):
    """Shape that is asked for."""

    motion: Annotated[str, OneOf(tuple(ANGLE))] = key("stand", "what the legs are designed for")
    aim: Annotated[str, OneOf(AIMS)] = key(
        "shape", "what is designed: the shape of the legs, or the stride"
    )
    angle: Annotated[float, In("deg", above=0)] | None = key(
        None, "angle by which legs bend; none takes 90 to stand and 60 to crawl"
    )
    reach: Place = key(
        6e-3, "distance along x by which the body reaches out to either side if it crawls"
    )
    bent_length: Length = key(
        0.03, "length of a leg that bends, from its root; the rest stays straight"
    )


@dataclass(frozen=True)
class WalkerSizes(Table):
    """Sizes and mesh."""

    leg_length: Length = key(0.06, "length of a leg from the body's circle")
    leg_width: Length = key(0.024, "width of a leg")
    body_radius: Length = key(0.02, "radius of the body")
    fillet: Length = key(6e-3, "radius of the fillets between body and legs")
    foot_length: Length | None = key(
        None, "length of a leg's end that is printed; none leaves it to the design"
    )
    edge_length: Length = key(1.8e-3, "edge length of the mesh")


@dataclass(frozen=True)
class WalkerSheets(SkinSheets):
    """Fabric, print and bladder."""

    fabric_mass: Annotated[float, In("kg/m²", at_least=0)] = key(
        0.25, "mass of the fabric and of a bladder, by area"
    )
    print_mass: Annotated[float, In("kg/m²", at_least=0)] = key(0.6, "mass of the print, by area")


@dataclass(frozen=True)
class Feet(Contacts):
    """Contact and friction."""

    feet: Annotated[str, OneOf(tuple(PHASES))] = key(
        "one-way", "feet with pads that slide forwards, or without"
    )
    pad_friction: Positive = key(
        0.2,
        "coefficient of friction of the pads that slide forwards; backwards it is that of "
        "all faces",
    )
    pad_length: Length = key(0.015, "length of a leg's end that carries pads")


@dataclass(frozen=True)
class LegWeights(Orientation):
    """What counts in the objective."""

    cross_sections: Count = key(6, "number of cross-sections of the leg")
    centreline_weight: Factor = key(
        0.02, "weight of the leg's centre line over that of its orientation"
    )


@dataclass(frozen=True)
class WalkerResults(Results):
    """What is simulated of the print."""

    gait_steps: Count | None = key(
        8, "number of equilibria in each phase of the gait; none leaves the gait out"
    )


@dataclass(frozen=True)
class WalkerScene(ActuatorScene):
    """The walker."""

    target: LegTarget = LegTarget()
    skin: WalkerSizes = WalkerSizes()
    material: WalkerSheets = WalkerSheets(seams="hinged")
    pressure: Pressing = Pressing(pressure=20e3)
    contact: Feet = Feet(friction=0.8)
    objective: LegWeights = LegWeights()
    design: Designing = Designing(levels=1, filter_radius=2.75e-3)
    results: WalkerResults = WalkerResults()

    KIND: ClassVar[str] = "walker"
    FEW: ClassVar[tuple[str, ...]] = (
        "motion",
        "aim",
        "leg_length",
        "leg_width",
        "body_radius",
        "pressure",
        "feet",
        "friction",
        "seed",
    )

    COARSE: ClassVar[Mapping[str, float]] = {
        "edge_length": 14 / 9,
        "filter_radius": 86 / 55,
        "iterations": 2 / 3,
        "constrained_iterations": 3 / 4,
    }
    TARGETS: ClassVar[Mapping[str, str]] = {"angle_deg": "angle"}

    def coarse_values(self) -> dict[str, Any]:
        """Return the values of the quick variant by key, with feet that are printed."""
        # T hardly depends on the print in the feet: few steps leave holes and blobs there.
        feet = self.skin.foot_length or self.skin.leg_length / 4
        return {**super().coarse_values(), "foot_length": feet}

    @property
    def leg_angle(self) -> float:
        """Angle in degrees by which legs are to bend."""
        return ANGLE[self.target.motion] if self.target.angle is None else self.target.angle

    @property
    def coarsest_edge(self) -> float:
        """Longest edge length in m of a useful mesh: six edges across a leg."""
        return self.skin.leg_width / 6

    @property
    def star(self) -> Star:
        """Outline of the robot."""
        return Star(
            4,
            self.skin.leg_length,
            self.skin.leg_width,
            self.skin.body_radius,
            self.skin.fillet,
            np.pi / 4,
        )

    def case(self, comm: MPI.Comm, level: Level) -> Case:
        """Return a quarter of the robot and its target (collective)."""
        assert level.edge_length is not None
        self.require_symmetric_knit((0, 1))
        star, angle, goal = self.star, self.leg_angle, self.objective
        pattern = walker(comm, level.edge_length, star, planes=(0, 1))
        along, root = np.append(star.directions[0], 0.0), star.root
        deform = stand(
            np.radians(angle), self.target.bent_length, directions=star.directions[:1], root=root
        )
        if self.target.motion == "crawl":
            deform = compose(deform, lambda points: points + [self.target.reach, 0, 0])
        sections = leg_cross_sections(
            pattern,
            along,
            root,
            goal.cross_sections,
            goal.centreline_weight,
            goal.orientation_length,
        )
        target = deform(pattern.points)
        metric, apart = tip_angle_metric(angle, along, DOWN, root), None
        if self.target.aim == "stride":
            nearest = self.skin.leg_width / 2
            sections, target = stride_sections(sections, target, nearest)
            metric = foot_metric(nearest, along, root, goal.cross_sections)
            if self.pressure.design_pressure:
                apart = body_and_leg(pattern, star)
        return Case(
            pattern,
            target,
            rest_on_body(pattern, star.body_radius, (0, 1)),
            self.pressure.pressure,
            self.pressure.bounds,
            self.material.composite,
            parts=[sections],
            metrics=(metric,),
            passive=foot_density(pattern, self),
            # The top is to stretch; without this hint the start does not tell up from down.
            start=np.where(pattern.panel == pattern.panel_index("top"), 0.35, 0.65),
            symmetry=(0, 1),
            chambers=apart,
        )

    def run_design(
        self,
        comm: MPI.Comm,
        output: Path | str,
        files: Mapping[str, Path] | None = None,
        *,
        verbose: bool = False,
    ) -> RunResult:
        """Design the walker and let it walk (collective)."""
        steps = self.results.gait_steps
        if steps is not None:
            ipctk()  # what is missing is told before the design, not after it
        made = design_actuator(comm, output, self, verbose=verbose)
        if steps is None:
            return made
        found = replace(made, trial=walk(comm, Path(output), self, steps, made.made))
        write_summary(comm, output, found)
        return found


def stride_sections(
    sections: CrossSections, target: Floats, nearest: float
) -> tuple[CrossSections, Floats]:
    """Return the cross-sections whose objective is the stride of the gait, and their target.

    An emptied leg lies flat whatever its print, so that the stride of feet that do not slide
    backwards is twice the way along x by which a full leg draws its foot in. The foot, the last
    cross-section, is to come as near to the plane between front and rear legs as these are wide.

    Args:
        sections: Those of the leg's shape, which count less now: they tell down from up.
        target: Target positions of the shape, (n, 3), in m.
        nearest: Distance of the foot from the plane x = 0 in m, at which front and rear feet meet.
    """
    positions = SHAPE_IN_STRIDE * sections.position_weights
    positions[-1, 0] = 1.0
    foot = sections.labels == len(positions) - 1
    target = target.copy()
    target[foot, 0] += nearest - target[foot, 0].mean()
    weights = SHAPE_IN_STRIDE * sections.orientation_weights
    return CrossSections(sections.labels, positions, weights), target


def foot_metric(nearest: float, along: Floats, root: float, count: int) -> Metric:
    """Return the distance in mm of the foot from the plane between front and rear legs.

    Args:
        nearest: Target in m.
        along: Unit vector along the leg, (3,).
        root: Where the leg begins, in m along it.
        count: Number of its cross-sections, of which the last is the foot.
    """

    def measure(pattern: Pattern, positions: Floats) -> float:
        vertices = leg_vertices(pattern, along, root)
        labels = label_cross_sections(pattern, vertices, along, count, border=False)
        return 1e3 * float(positions[labels == count - 1, 0].mean())

    return Metric("foot", "mm", 1e3 * nearest, measure)


def body_and_leg(pattern: Pattern, star: Star) -> Chambers:
    """Return two chambers of a quarter, whose full pressures are designed for the gait."""
    leg = plane_centroids(pattern) @ star.directions[0] > star.root
    return Chambers(("body", "leg"), leg.astype(np.int64))


def foot_density(pattern: Pattern, config: WalkerScene) -> npt.NDArray[np.float64] | None:
    """Return the prescribed density of all triangles, (t,): 1 in the feet, NaN elsewhere.

    Without feet there is none.
    """
    if config.skin.foot_length is None:
        return None
    star = config.star
    reach = (plane_centroids(pattern) @ star.directions.T).max(axis=1)
    return np.where(reach > star.reach - config.skin.foot_length, 1.0, np.nan)


def chambers(pattern: Pattern, star: Star) -> Chambers:
    """Return three chambers: the body, the legs at x > 0, and those at x < 0."""
    centroids = plane_centroids(pattern)
    leg = (centroids @ star.directions.T > star.root).any(axis=1)
    return Chambers(CHAMBERS, np.where(leg, np.where(centroids[:, 0] > 0, 1, 2), 0))


def contact_of(pattern: Pattern, config: WalkerScene, height: float) -> Contact:
    """Return ground, friction and pads of a walker, and the contact of its layers.

    Args:
        pattern: The walker, or half of it.
        config: Its numbers.
        height: Height of the ground in m.
    """
    star, pads = config.star, None
    if config.contact.feet == "one-way":
        reach = (pattern.points[:, :2] @ star.directions.T).max(axis=1)
        backward = (
            config.contact.pad_friction
            if config.contact.friction is None
            else config.contact.friction
        )
        on_feet = reach > star.reach - config.contact.pad_length
        pads = Pads(on_feet, (1.0, 0.0, 0.0), config.contact.pad_friction, backward)
    return Contact(
        Ground((0.0, 0.0, height)),
        friction=config.contact.friction,
        pads=pads,
        distance=config.contact.contact_distance,
    )


def follow_gait(
    comm: MPI.Comm,
    config: WalkerScene,
    gait: Gait,
    pattern: Pattern,
    whole: Mirrored,
    printed: Bools,
    pressures: Sequence[float],
) -> tuple[list[TracePoint], Walk | None, str]:
    """Simulate half of a robot on the ground through one cycle of a gait (collective).

    It begins flat on the ground, and fills what the end of the last phase has filled. The other
    half is its mirror image.

    Args:
        comm: Communicator.
        config: Numbers of the walker.
        gait: The cycle.
        pattern: Half of the robot, at y ≥ 0.
        whole: The whole of it.
        printed: Whether each triangle of the whole is printed, (t,).
        pressures: Full pressure of each chamber in Pa, (3,).

    Returns:
        The equilibria, what the robot does, and why the path ends before the cycle does; empty
        where it does not. Without any equilibrium the second is None.
    """
    skin, supports, star = sew(comm, pattern), symmetry_plane(pattern, 1), config.star
    sizes = contact_of(pattern, config, 0.0).sizes(config.material.composite)
    start, height = flat_on_ground(comm, pattern, supports, sizes)
    solver = EquilibriumSolver(
        skin,
        config.material.composite,
        supports,
        chambers=chambers(pattern, star),
        weight=Weight(
            config.material.fabric_mass, config.material.fabric_mass + config.material.print_mass
        ),
        contact=contact_of(pattern, config, height),
    )
    legs = [
        tip_angle_metric(config.leg_angle, np.append(d, 0), DOWN, star.root, name=f"leg_{k}")
        for k, d in enumerate(star.directions)
        if d[1] > 0
    ]
    density = printed[: len(pattern.triangles)].astype(np.float64)[skin.owned_cells]
    levels = [[float(p) for p in row] for row in np.asarray(pressures) * gait.pressure_fractions]
    points: list[TracePoint] = []
    failure = ""
    try:
        points.extend(trace(solver, density, levels, legs, start[skin.owned_vertices]))
    except EquilibriumError as caught:  # raised by all ranks or by none
        failure = str(caught)
    if not points:
        return points, None, failure
    reach = sizes.thickness / 2 + sizes.distance
    return points, walk_of(points, whole, star.directions, height, reach), failure


def walk(
    comm: MPI.Comm, output: Path, config: WalkerScene, steps: int, design: PrintedResult
) -> GaitFigures:
    """Simulate the printed robot on the ground through its gait, and write table and pictures.

    Args:
        comm: Communicator.
        output: Folder for table and pictures.
        config: Numbers of the walker.
        steps: Number of equilibria in each phase.
        design: The designed robot.
    """
    printed = design.printed
    shown = printed.evaluation or design.design.final
    # The triangles and vertices of the half come first, as in the whole that is printed.
    half = mirrored(design.problem.skin.pattern, (0,)).pattern
    whole = mirrored(half, (1,))
    full = [shown.equilibrium.pressures[k] for k in (0, -1, -1)]
    gait = Gait(CHAMBERS, PHASES[config.contact.feet].astype(np.float64), steps)
    points, found, failure = follow_gait(comm, config, gait, half, whole, printed.cells, full)
    if found is None:
        return GaitFigures(CHAMBERS, tuple(full), failure)
    measured = MEASURED_STRIDE if config.target.motion == "crawl" else None
    write_gait(comm, output, gait, found, points, (whole, printed.regions), measured)
    return gait_figures(gait, full, found, points, failure or None, measured)
