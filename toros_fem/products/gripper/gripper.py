"""A gripper whose fingers close on an object when inflated, and lift it (paper Fig. 1).

Each finger is flat, made of two panels, and clamped at its root in a mount. The mount also carries
the inner panel on a stem: held in a flat line alone the finger would turn about it like a hinge.
Three fingers stand around a sphere, four around a box. Half a finger is designed, by symmetry, in
contact with the object, which is held in its place. A line along the inner panel is always printed,
so that this panel keeps its length. The target shape goes around the object. The objective also
asks for a holding force, that of the normal forces upwards and of the friction that they allow.

The printed gripper then lifts the object from a thin post. The object slides until the fingers bear
its weight. The summary gives the largest mass that they bear, the sliding at the object's own mass,
contact area and pressure, and the force of each finger.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Bools, Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import Count, Distance, Factor, In, Length, OneOf, Positive, Table, key
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.measures.figures import Figure
from toros_fem.measures.gap import SHAPES, Body, GapObjective, mean_gap
from toros_fem.measures.metrics import Metric
from toros_fem.measures.shape import Nodes, Objective, Part
from toros_fem.mechanics.contact.bodies import RigidBody
from toros_fem.mechanics.contact.settings import Contact, Ground
from toros_fem.mechanics.contact.solids import rigid_mesh
from toros_fem.mechanics.equilibrium.equilibrium import EquilibriumError
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.pull_out import PullPoint, largest_force, pull_out, slip_under
from toros_fem.mechanics.readings.holding import HoldingObjective
from toros_fem.mechanics.skin.supports import Supports, symmetry_plane
from toros_fem.meshes import Mirrored, Pattern, curl, finger, plane_centroids, sew
from toros_fem.products.actuators.designer import design_actuator
from toros_fem.products.actuators.legs import leg_cross_sections, tip_angle_metric
from toros_fem.products.actuators.result import ActuatorResult
from toros_fem.products.actuators.scene import ActuatorScene, Level
from toros_fem.products.gripper.lift import LiftShape, from_room, in_room, solid, write_lift
from toros_fem.products.tables.loads import Contacts, Orientation, Pressing
from toros_fem.products.tables.sheets import SkinSheets
from toros_fem.products.tables.steps import Designing
from toros_fem.results.frames.record import repeated
from toros_fem.results.result import RunResult, write_summary

ALONG, TOWARD = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
WRAP_ANGLE = {"sphere": 90.0, "box": 60.0}  # in degrees
FINGERS = {"sphere": 3, "box": 4}  # as many as its sides, so that each finger does the same
TOUCHING_WIDTH = 1 / 3  # of the finger's width, which is to lie on the object
TOUCHING_GAP = 0.5e-3  # m; where the target is nearer to a box, the finger is to touch it
TIP_TWELFTHS = 3  # of the finger beyond its root, whose angle is measured
GRAVITY = 9.81  # m/s²
# Steps of the lift while the object slides by up to the limit, and from there on.
NEAR_STEPS, FAR_STEPS = 8, 8


@dataclass(frozen=True)
class GripTarget(Table):
    """Shape that is asked for."""

    wrap_angle: Annotated[float, In("deg", above=0, at_most=360)] | None = key(
        None,
        "angle by which a finger goes around the object; none takes 90 at a sphere and 60 at a box",
    )
    tip_angle: Annotated[float, In("deg", above=0, at_most=360)] | None = key(
        None, "angle by which the finger's outer quarter is to turn; none takes that at the object"
    )
    edge_bend_radius: Length = key(
        0.03, "radius around which a finger bends at a box, whose edges are sharper"
    )
    edge_angle: Annotated[float, In("deg", above=0, at_most=180)] = key(
        45.0, "angle by which a finger has turned where it touches a box's edge"
    )
    tail_length: Distance = key(0.01, "length of a finger that is straight below a box")
    inflated_depth: Distance = key(
        0.016, "depth of the inflated finger where it is straight, a first guess"
    )


@dataclass(frozen=True)
class Gripped(Table):
    """What is gripped."""

    shape: Annotated[str, OneOf(SHAPES)] = key("sphere", "shape of the object")
    size: Length = key(0.04, "diameter of the sphere or edge of the box")
    mass: Annotated[float, In("kg", above=0)] = key(0.1, "mass of the object")
    object_mesh: str | None = key(
        None,
        "mesh file of an object to be lifted in the place of the shape that is designed for, its z "
        "upwards; none lifts that shape",
    )
    object_scale: Length = key(1e-3, "length of the mesh file's unit")
    lift_distance: Length | None = key(
        0.05, "distance by which the mounts move up; none leaves the lift out"
    )
    slip_limit: Length = key(5e-3, "sliding of the object up to which it counts as held")


@dataclass(frozen=True)
class FingerSizes(Table):
    """Sizes and mesh."""

    finger_length: Length = key(0.09, "length of a finger")
    finger_width: Length = key(0.025, "width of a finger")
    root_length: Length = key(0.015, "length of a finger in the mount")
    stem_length: Length = key(
        0.025, "length of a finger whose inner panel the mount's stem carries"
    )
    backbone_width: Distance = key(
        6e-3, "width of the line along the inner panel that is always printed"
    )
    edge_length: Length = key(1.2e-3, "edge length of the mesh")


@dataclass(frozen=True)
class GripWeights(Orientation):
    """What counts in the objective."""

    cross_sections: Count = key(4, "number of cross-sections of a finger")
    centreline_weight: Factor = key(
        0.05, "weight of the finger's centre line over that of its orientation"
    )
    contact_weight: Factor = key(5.0, "weight of the inner panel's distance from the object")
    holding_factor: Positive = key(
        4.0, "holding force that the design asks for, over the object's weight"
    )
    holding_weight: Factor = key(1.0, "weight of the holding force that is missing")


@dataclass(frozen=True)
class GripperScene(ActuatorScene):
    """The gripper.

    Raises:
        ParameterError: As in `ActuatorScene`, the finger would bend inside its mount, or the stem
            ends before the root or beyond the finger.
    """

    target: GripTarget = GripTarget()
    object: Gripped = Gripped()
    skin: FingerSizes = FingerSizes()
    material: SkinSheets = SkinSheets(seams="hinged")
    # The paper states none.
    pressure: Pressing = Pressing(pressure=10e3, design_pressure=True, pressure_max=15e3)
    contact: Contacts = Contacts(friction=0.6)
    objective: GripWeights = GripWeights(orientation_length=0.02)
    # Steps that only raise the holding force are small.
    design: Designing = Designing(levels=1, min_decrease=None, polish_iterations=40)

    KIND: ClassVar[str] = "gripper"
    FEW: ClassVar[tuple[str, ...]] = (
        "shape",
        "size",
        "mass",
        "finger_length",
        "finger_width",
        "pressure_max",
        "friction",
        "seed",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.skin.root_length <= self.skin.stem_length < self.skin.finger_length:
            raise ParameterError(
                f"stem_length = {self.skin.stem_length} m must be at least root_length = "
                f"{self.skin.root_length} m and less than finger_length = "
                f"{self.skin.finger_length} m.",
                "stem_length",
            )
        if self.bend_start < self.skin.root_length:
            raise ParameterError(
                f"the finger starts to bend at {self.bend_start:.3g} m, inside its mount, which "
                f"ends at root_length = {self.skin.root_length:.3g} m. Give a longer finger, a "
                "smaller object or wrap_angle, or around a box a smaller edge_bend_radius or "
                "tail_length."
            )

    COARSE: ClassVar[Mapping[str, float]] = {"edge_length": 2.0, "filter_radius": 74 / 43}
    TARGETS: ClassVar[Mapping[str, str]] = {"angle_deg": "tip_angle"}

    @property
    def coarsest_edge(self) -> float:
        """Longest edge length in m of a useful mesh: four edges across half a finger."""
        return self.skin.finger_width / 8

    @property
    def bend_angle(self) -> float:
        """Angle in rad by which a finger goes around the object."""
        return float(np.radians(self.target.wrap_angle or WRAP_ANGLE[self.object.shape]))

    @property
    def bend_radius(self) -> float:
        """Radius in m around which the inner panel bends."""
        return self.target.edge_bend_radius if self.object.shape == "box" else self.object.size / 2

    @property
    def bend_start(self) -> float:
        """Distance in m from the root at which a finger starts to bend.

        The inner panel keeps its length and goes around the object; its tip ends where it should.
        """
        tail = self.target.tail_length if self.object.shape == "box" else 0.0
        return float(self.skin.finger_length - tail - self.bend_angle * self.bend_radius)

    @property
    def body(self) -> Body:
        """The object inside the bend; a box touches with its edge."""
        free = Body(self.object.shape, self.object.size, (0.0, 0.0, 0.0))
        # The edge's arc touches the bend from inside; a sphere fills it.
        turn, inside = np.radians(self.target.edge_angle), self.bend_radius - free.radius
        core = self.object.size / 2 - free.radius
        x = self.bend_start + inside * np.sin(turn) - core
        z = self.target.inflated_depth / 2 + self.bend_radius - inside * np.cos(turn) + core
        return Body(self.object.shape, self.object.size, (float(x), 0.0, float(z)))

    @property
    def fingers(self) -> int:
        """Number of fingers around the object."""
        return FINGERS[self.object.shape]

    @property
    def held_contact(self) -> Contact:
        """Contact with the object, which is held, and with the next finger, without friction.

        By symmetry fingers meet in planes through the object's axis.
        """
        body, half = self.body, np.pi / self.fingers
        between = Ground((0.0, 0.0, body.centre[2]), (0.0, -np.cos(half), -np.sin(half)))
        return Contact(
            ground=between,
            bodies=[solid(body)],
            self_contact=False,
            distance=self.contact.contact_distance,
        )

    def touching(self, edge: float) -> tuple[float, float]:
        """Return from where to where the inner panel is to touch, in m from the root.

        Args:
            edge: Edge length of the mesh in m, which a short way is not under.
        """
        if self.object.shape == "sphere":
            return self.bend_start, self.skin.finger_length - self.skin.finger_width / 4
        middle = self.bend_start + np.radians(self.target.edge_angle) * self.bend_radius
        # An arc leaves another one of radius r by s²/2 (1/r − 1/R) at the distance s.
        sharper = 1 / self.body.radius - 1 / self.bend_radius
        half = max(np.sqrt(2 * TOUCHING_GAP / sharper), edge)
        return float(middle - half), float(middle + half)

    def case(self, comm: MPI.Comm, level: Level) -> Case:
        """Return half a finger and its target (collective)."""
        assert level.edge_length is not None
        self.require_symmetric_knit((1,))
        root, goal = self.skin.root_length, self.objective
        pattern = finger(
            comm,
            level.edge_length,
            length=self.skin.finger_length,
            width=self.skin.finger_width,
            root=root,
            planes=(1,),
        )
        target, tip_angle = self._bent(pattern)
        inner = pattern.panel == pattern.panel_index("top")
        off_middle = np.abs(plane_centroids(pattern)[:, 1])
        supports = Supports(mounted(pattern, self)) | symmetry_plane(pattern, 1)
        sections = leg_cross_sections(
            pattern,
            ALONG,
            root,
            goal.cross_sections,
            goal.centreline_weight,
            goal.orientation_length,
        )
        return Case(
            pattern,
            target,
            supports,
            self.pressure.pressure,
            self.pressure.bounds,
            self.material.composite,
            parts=[sections, *self._touching_and_holding(pattern, level.edge_length, supports)],
            metrics=(gap_metric(self, level.edge_length), tip_angle),
            passive=np.where(inner & (off_middle < self.skin.backbone_width / 2), 1.0, np.nan),
            # The outer panel is to stretch; without this hint the start is the same in and out.
            start=np.where(inner, 0.65, 0.35),
            symmetry=(1,),
            contact=self.held_contact,
        )

    def _bent(self, pattern: Pattern) -> tuple[Floats, Metric]:
        """Return the target positions of half a finger, and the angle of its tip."""
        tip_angle = tip_angle_metric(
            0.0, ALONG, TOWARD, self.skin.root_length, outer_count=TIP_TWELFTHS
        )

        def around(turn: float) -> Floats:
            deform = curl(
                turn,
                self.bend_angle * self.bend_radius,
                origin=(self.bend_start, 0, self.target.inflated_depth / 2),
                along=ALONG,
                toward=TOWARD,
            )
            return deform(pattern.points)

        target = around(self.bend_angle)
        tip = tip_angle.measure(pattern, target)
        if self.target.tip_angle is not None:
            # The outer quarter turns by a fixed part of the whole angle; the object stays.
            target, tip = (
                around(self.bend_angle * self.target.tip_angle / tip),
                self.target.tip_angle,
            )
        return target, replace(tip_angle, target=tip)

    def _touching_and_holding(
        self, pattern: Pattern, edge: float, supports: Supports
    ) -> tuple[Part, Part]:
        """Return the distance from the object and the missing force as parts of the objective."""
        weights = touching_vertices(pattern, self, edge).astype(np.float64)
        contact, goal = self.held_contact, self.objective
        sizes = contact.sizes(self.material.composite)
        # Upwards, and towards the object's axis as far as friction makes use of it.
        direction = (self.contact.friction or 0.0) * np.asarray(TOWARD) - np.asarray(ALONG)
        force = goal.holding_factor * self.object.mass * GRAVITY / (2 * self.fingers)

        def touching(nodes: Nodes, target: Floats) -> Objective:
            return GapObjective(nodes, self.body, weights, goal.contact_weight)

        def holding(nodes: Nodes, target: Floats) -> Objective:
            return HoldingObjective(
                nodes, contact, sizes, supports.fixed, direction, force, goal.holding_weight
            )

        return touching, holding

    def run_design(
        self,
        comm: MPI.Comm,
        output: Path | str,
        files: Mapping[str, Path] | None = None,
        *,
        verbose: bool = False,
    ) -> RunResult:
        """Design the finger and lift the object (collective)."""
        made = design_actuator(comm, output, self, verbose=verbose)
        if self.object.lift_distance is None:
            return made
        found = replace(made, trial=lift(comm, Path(output), self, made))
        write_summary(comm, output, found)
        return found


@dataclass(frozen=True)
class LiftFigures:
    """What one design does to the object; None where this has no meaning.

    Attributes:
        held_mass_kg: The largest mass that the fingers bear.
        slip_mm: The sliding at which they bear the object; None if they do not.
        smallest_distance_mm: Smallest distance between faces.
        finger_force_n: Force of a finger on the object, where the sliding ends.
        contact_area_mm2, contact_pressure_kpa: Area that touches it, and the mean pressure there.
        failure: Why the pull ended early; None if it did not.
    """

    held_mass_kg: float | None = None
    slip_mm: float | None = None
    smallest_distance_mm: float | None = None
    finger_force_n: float | None = None
    contact_area_mm2: float | None = None
    contact_pressure_kpa: float | None = None
    failure: str | None = None


@dataclass(frozen=True)
class Load:
    """An object that is lifted, by the print and by the initial design.

    Attributes:
        mass_kg, friction, fingers: Mass of the object, its friction, and the number of fingers.
        printed, initial: What print and initial design do.
    """

    mass_kg: float
    friction: float | None
    fingers: int
    printed: LiftFigures
    initial: LiftFigures

    NAME: ClassVar[str] = "load"

    @property
    def figures(self) -> tuple[Figure, ...]:
        """The most important figures of the print."""
        return (
            Figure("held_mass", "kg", self.printed.held_mass_kg),
            Figure("slip", "mm", self.printed.slip_mm),
            Figure("smallest_distance", "mm", self.printed.smallest_distance_mm),
        )

    @property
    def words(self) -> str:
        """It in words."""
        made, initial = self.printed, self.initial.held_mass_kg
        lifted = "are dropped" if made.slip_mm is None else f"slide by {made.slip_mm:.1f} mm"
        if made.slip_mm is None and made.held_mass_kg is None and made.failure:
            lifted = f"are not lifted: {made.failure}"
        found = f"{1e3 * self.mass_kg:.0f} g {lifted}"
        if made.held_mass_kg is not None:
            found += f", at most {1e3 * made.held_mass_kg:.0f} g are held"
        return found if initial is None else f"{found}, {1e3 * initial:.0f} g by the initial design"


def touching_vertices(pattern: Pattern, config: GripperScene, edge: float) -> Bools:
    """Return which vertices are to touch: a strip along the inner panel's middle, (n,)."""
    inner = np.zeros(len(pattern.points), dtype=bool)
    inner[pattern.vertices_of("top")] = True
    x, y, _ = pattern.points.T
    begin, end = config.touching(edge)
    middle = np.abs(y) < TOUCHING_WIDTH * config.skin.finger_width / 2
    return np.asarray(inner & (x > begin) & (x < end) & middle)


def mounted(pattern: Pattern, config: GripperScene) -> Bools:
    """Return the components of the vertices that the mount holds, (n, 3): root and stem."""
    held = pattern.points[:, 0] <= config.skin.root_length * (1 + 1e-9)
    inner = pattern.vertices_of("top")
    held[inner[pattern.points[inner, 0] <= config.skin.stem_length * (1 + 1e-9)]] = True
    return np.repeat(held[:, None], 3, axis=1)


def gap_metric(config: GripperScene, edge: float) -> Metric:
    """Return the mean distance in mm of the touching strip from the object, inside or outside."""

    def measure(pattern: Pattern, positions: Floats) -> float:
        touching = touching_vertices(pattern, config, edge)
        return 1e3 * mean_gap(config.body, pattern, positions, touching)

    return Metric("gap", "mm", 0.0, measure, scale=1e3 * config.object.size)


def lift(comm: MPI.Comm, output: Path, config: GripperScene, design: ActuatorResult) -> Load:
    """Let the printed gripper lift its object, and the initial design too.

    Seen from the mounts the post goes down by the distance of the lift, and the object with it
    until the fingers hold its weight. It moves along its axis alone, by symmetry, or where it is a
    mesh as on a guide. Nothing moves it back, so that one curve of the holding force over its depth
    tells what becomes of each mass. Fingers close without friction, which acts from then on.

    Args:
        comm: Communicator.
        output: Folder for pictures and frames.
        config: Numbers of the gripper.
        design: The designed finger.
    """
    problem, printed = design.problem, design.printed
    assert isinstance(problem, ShapeDesign)
    shown = printed.evaluation or design.design.final
    _, initial = problem.fields(problem.with_passive(problem.start_density(design.search.seed)))
    grip = _grip(comm, problem, config)
    lifts, rows = {}, []
    for name, owned in (("initial design", initial), ("as printed", shown.projected)):
        density = problem.skin.gather_cells(owned)
        # A finger may have several equilibria: that of the print is known.
        known = owned is shown.projected and grip.fingers is None
        near = shown.equilibrium.positions if known else None
        made = _lifted(grip, density, shown.equilibrium.pressures, config, near)
        lifts[name] = _figures(made, grip, config)
        if made.points:
            rows.append((grip.shown_density(density), _shapes(name, made, grip, config)))
    if rows:
        regions = list(printed.regions) * (config.fingers // grip.copies)
        write_lift(comm, output, grip.shown_pattern, rows, regions, grip.body, grip.copies)
    mass, friction = config.object.mass, config.contact.friction
    return Load(mass, friction, config.fingers, lifts["as printed"], lifts["initial design"])


@dataclass(frozen=True, eq=False)
class _Grip:
    """What is simulated of a gripper that lifts: half a finger, or all fingers.

    Attributes:
        closing, pulling: Solvers without and with friction.
        body: The object.
        mirror: The whole finger that the designed half is a part of.
        fingers: Number of fingers that are simulated; None for half of one.
        copies: Number of equal copies of what is shown: fingers, or all of them as one.
        parts: Number of equal parts of the gripper, of which one is simulated.
    """

    closing: EquilibriumSolver
    pulling: EquilibriumSolver
    body: RigidBody
    mirror: Mirrored
    fingers: int | None
    copies: int
    parts: int

    @property
    def shown_pattern(self) -> Pattern:
        """Pattern of what is shown."""
        return self.mirror.pattern if self.fingers is None else self.closing.skin.pattern

    def shown_density(self, density: Floats) -> Floats:
        """Return the density of all triangles that are shown, from those of half a finger."""
        whole = self.mirror.at_cells(density)
        return whole if self.fingers is None else np.tile(whole, self.fingers)

    def simulated(self, density: Floats) -> Floats:
        """Return the density of owned triangles, from those of half a finger, (t,)."""
        whole = density if self.fingers is None else self.shown_density(density)
        return np.asarray(whole[self.closing.skin.owned_cells])

    def shown_positions(self, positions: Floats) -> Floats:
        """Return positions of all vertices that are shown, from those that are simulated."""
        return self.mirror.at_vertices(positions) if self.fingers is None else positions


def _grip(comm: MPI.Comm, problem: ShapeDesign, config: GripperScene) -> _Grip:
    """Return half a finger and the designed object, or all fingers and the object's mesh."""
    model, mirror, count = problem.solver.model, problem.whole, config.fingers
    assert mirror is not None
    contact, skin, supports = config.held_contact, problem.skin, model.supports
    body, all_fingers = contact.bodies[0], config.object.object_mesh is not None
    if config.object.object_mesh is not None:
        body = _placed_mesh(comm, config.object.object_mesh, config)
        contact = Contact(
            bodies=[body], self_contact=False, distance=config.contact.contact_distance
        )
        axis = config.body.centre[2]
        turned = [
            from_room(in_room(mirror.pattern.points, axis, angle), axis)
            for angle in 2 * np.pi * np.arange(count) / count
        ]
        pattern = replace(repeated(mirror.pattern, [], count)[0], points=np.concatenate(turned))
        skin = sew(comm, pattern)
        supports = Supports(np.tile(mounted(mirror.pattern, config), (count, 1)))
    options = problem.solver.options
    closing, pulling = (
        EquilibriumSolver(
            skin, model.composite, supports, options, contact=replace(contact, friction=friction)
        )
        for friction in (None, config.contact.friction)
    )
    return _Grip(
        closing,
        pulling,
        body,
        mirror,
        count if all_fingers else None,
        1 if all_fingers else count,
        1 if all_fingers else 2 * count,
    )


def _placed_mesh(comm: MPI.Comm, path: str, config: GripperScene) -> RigidBody:
    """Return the object of a mesh file, upright, in the frame of the first finger."""
    read = rigid_mesh(comm, "object", path, scale=config.object.object_scale)
    centre = config.body.centre
    points = from_room(read.points - read.centre, 0.0) + [centre[0], 0.0, centre[2]]
    return RigidBody("object", points, read.triangles)


@dataclass(frozen=True, eq=False)
class _Lift:
    """What one design does: its pull, and why this ended early; empty at its end."""

    points: tuple[PullPoint, ...]
    failure: str

    def slip(self, grip: _Grip, config: GripperScene) -> float | None:
        """Return the sliding in m at which the fingers bear the object; None if they do not."""
        found = slip_under(self.points, config.object.mass * GRAVITY / grip.parts)
        return None if found is None or found > config.object.slip_limit else found


def _lifted(
    grip: _Grip,
    density: Floats,
    pressures: Sequence[float],
    config: GripperScene,
    start: Floats | None = None,
) -> _Lift:
    """Pull the object out of the fingers: to the limit, and all the way if it drops."""
    limit, end = config.object.slip_limit, config.object.lift_distance or 0.0
    near = limit * np.linspace(0.0, 1.0, NEAR_STEPS + 1) ** 2
    far = np.linspace(limit, max(end, limit), FAR_STEPS + 1)[1:]
    depths = [*near, *(depth for depth in far if depth > limit)]
    owned, points = grip.simulated(density), list[PullPoint]()
    try:
        closed = grip.closing.solve(owned, pressures, start)
        for point in pull_out(grip.pulling, owned, pressures, depths, ALONG, closed.positions):
            points.append(point)
            held = _Lift(tuple(points), "").slip(grip, config) is not None
            if held and point.depth >= limit:
                break
    except EquilibriumError as caught:  # raised by all ranks or by none
        return _Lift(tuple(points), str(caught))
    return _Lift(tuple(points), "")


def _figures(lifted: _Lift, grip: _Grip, config: GripperScene) -> LiftFigures:
    """Return the figures of a lift; those of fingers are at the end of the object's sliding."""
    if not lifted.points:
        return LiftFigures(failure=lifted.failure)
    slip, pattern = lifted.slip(grip, config), grip.closing.skin.pattern
    depths = np.array([point.depth for point in lifted.points])
    at = lifted.points[int(np.argmin(np.abs(depths - (slip or 0.0))))]
    corners = at.positions[pattern.triangles]
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    thirds = np.repeat(np.linalg.norm(crosses, axis=1) / 6, 3)
    areas = np.bincount(pattern.triangles.ravel(), thirds, minlength=len(pattern.points))
    normal, share = np.linalg.norm(at.normals, axis=1), grip.parts / config.fingers
    area, force = share * float(areas[normal > 0].sum()), share * float(normal.sum())
    held = grip.parts * largest_force(lifted.points, config.object.slip_limit) / GRAVITY
    return LiftFigures(
        held_mass_kg=max(held, 0.0),
        slip_mm=None if slip is None else 1e3 * slip,
        smallest_distance_mm=1e3 * min(p.result.smallest_distance or 0.0 for p in lifted.points),
        finger_force_n=force,
        contact_area_mm2=1e6 * area,
        contact_pressure_kpa=1e-3 * force / area if area else None,
        failure=lifted.failure or None,
    )


def _shapes(name: str, lifted: _Lift, grip: _Grip, config: GripperScene) -> list[LiftShape]:
    """Return fingers and object as they close, half-way up, and at the end of a lift."""
    slip, found = lifted.slip(grip, config), []
    depths = np.array([point.depth for point in lifted.points])
    for part, word in ((0.0, "closed"), (0.5, "half-way up"), (1.0, "lifted")):
        raised = part * (config.object.lift_distance or 0.0)
        sunk = raised if slip is None else min(slip, raised)
        nearest = lifted.points[int(np.argmin(np.abs(depths - sunk)))]
        positions = grip.shown_positions(nearest.positions)
        found.append(LiftShape(f"{name}, {word}", positions, sunk, raised))
    return found
