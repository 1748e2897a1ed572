"""What a gripper bears: its fingers close, and its object is pulled out of them.

Seen from the mounts the post goes down by the distance of the lift, and the object with it until
the fingers hold its weight. It moves along its axis alone, by symmetry, or where it is a mesh as on
a guide. Nothing moves it back, so that one curve of the holding force over its depth tells what
becomes of each mass. Fingers close without friction, which acts from then on.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from mpi4py import MPI

from toros_fem.base.files import guarded, if_plotting
from toros_fem.base.validation import Floats
from toros_fem.design.loop.problem import Evaluation
from toros_fem.design.loop.shape_design import ShapeDesign, ShapeProblem
from toros_fem.measures.figures import Figure
from toros_fem.measures.regions import Body
from toros_fem.mechanics.contact.bodies import RigidBody
from toros_fem.mechanics.contact.contact import Contact
from toros_fem.mechanics.contact.solids import rigid_box, rigid_mesh, rigid_sphere
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.pull_out import PullPoint, largest_force, pull_out, slip_under
from toros_fem.mechanics.paths.trace_point import until_failure
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.mechanics.terms.loads import GRAVITY
from toros_fem.meshes.pattern import Mirrored, Pattern, Regions
from toros_fem.meshes.skin import sew
from toros_fem.meshes.transfer import make_transfer
from toros_fem.meshes.triangles import normals
from toros_fem.products.actuators.estimates import OnOtherMesh, trial_intervals
from toros_fem.products.actuators.result import SkinDesign
from toros_fem.results.runs.frames import Frame, ShownSkin
from toros_fem.results.runs.record import repeated, write_series

if TYPE_CHECKING:
    from toros_fem.products.gripper import GripperScene

# Directions of a finger's frame: from the mount to the tip, and towards the object.
ALONG, TOWARD = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
# Rays on which a body's surface is found, over its size: it lies no further out.
FARTHEST = 2.0
# Half the width of the post and its distance from the object in pictures, over the object's size.
POST, BELOW = 0.06, 0.01
VIEW = (12.0, 25.0)
LiftShape = tuple[str, Floats, float, float]
# Steps of the lift while the object slides by up to the limit, and from there on.
NEAR_STEPS, FAR_STEPS = 8, 8
"""Fingers and object at one moment of a lift: a title, positions of the vertices of one whole
finger in its frame, (n, 3), by how far the object has moved down, seen from the mounts, and by how
far the mounts have moved up, all in m."""


def solid(body: Body) -> RigidBody:
    """Return a sphere, or a box with rounded edges, as a rigid body."""
    if body.shape == "sphere":
        return rigid_sphere("object", body.size / 2, body.centre)
    ball = rigid_sphere("object", 1.0)
    rays = ball.points / np.linalg.norm(ball.points, axis=1)[:, None]
    low: Floats = np.zeros(len(rays))
    high: Floats = np.full(len(rays), FARTHEST * body.size)
    for _ in range(50):  # each ray from the centre leaves the body once
        middle = (low + high) / 2
        outside = body.distance(body.centre + middle[:, None] * rays)[0] > 0
        low, high = np.where(outside, low, middle), np.where(outside, middle, high)
    return RigidBody("object", body.centre + low[:, None] * rays, ball.triangles)


def write_lift(
    comm: MPI.Comm,
    folder: Path,
    pattern: Pattern,
    rows: Sequence[tuple[Floats, Sequence[LiftShape]]],
    regions: Regions,
    body: RigidBody,
    fingers: int,
    title: str,
) -> None:
    """Write frames, and a picture of all fingers around the object (collective).

    Args:
        pattern: The pattern of one whole finger.
        rows: Density of its triangles, (t,), and shapes of a lift, a row of the picture each; the
            last one is that of the print.
        regions: Print on each of its panels, polygons in m.
        body: The object before the lift, in the finger's frame.
        fingers: Number of fingers around it.
        title: A sentence with the result.

    Raises:
        OutputError: A file cannot be written.
    """
    axis, post = float(body.centre[2]), _post(body)
    angles = 2 * np.pi * np.arange(fingers) / fingers
    every, prints = repeated(pattern, regions, fingers)

    def fingers_of(positions: Floats, raised: float) -> Floats:
        up = [0.0, 0.0, raised]
        return np.concatenate([in_room(positions, axis, angle) + up for angle in angles])

    def object_of(height: float) -> Floats:
        return in_room(body.points, axis, 0.0) + [0.0, 0.0, height]

    def draw() -> None:
        from toros_fem.results.pictures.raster import DrawnSurface, View
        from toros_fem.results.pictures.shapes import plot_states
        from toros_fem.results.pictures.shown import DrawnSkin
        from toros_fem.results.pictures.style import BODY

        stand = DrawnSurface(post.triangles, post.points, BODY, closed=True)
        states = []
        for density, row in rows:
            # The print itself is drawn where there is one.
            printed = density is rows[-1][0]
            drawn = DrawnSkin(
                ShownSkin(every, regions=prints if printed else None), np.tile(density, fingers)
            )
            states.append(
                [
                    (
                        name,
                        [
                            *drawn.surfaces(fingers_of(positions, raised)),
                            DrawnSurface(
                                body.triangles, object_of(raised - sunk), BODY, closed=True
                            ),
                            stand,
                        ],
                    )
                    for name, positions, sunk, raised in row
                ]
            )
        plot_states(folder / "lift.png", states, View(*VIEW), title)

    def write() -> None:
        _, positions, sunk, raised = rows[-1][1][-1]
        skin = ShownSkin(every, regions=prints, body=(object_of(raised - sunk), body.triangles))
        write_series(folder, skin, [Frame("load", 0, "", fingers_of(positions, raised), None, {})])
        if_plotting(draw)

    guarded(comm, folder, write)


def in_room(points: Floats, axis: float, angle: float) -> Floats:
    """Return points of a finger's frame in the room: z up, the object's axis at x = y = 0.

    Args:
        points: Points, (n, 3), in m.
        axis: Distance in m of the object's axis from the flat finger.
        angle: Angle in rad of the finger around the axis.
    """
    out = axis - points[:, 2]
    c, s = np.cos(angle), np.sin(angle)
    y = -points[:, 1]  # mirrored like z, since otherwise the skin would be inside out
    return np.column_stack([c * out - s * y, s * out + c * y, -points[:, 0]])


def from_room(points: Floats, axis: float) -> Floats:
    """Return points of the room in the frame of the finger at the angle 0, as of `in_room`."""
    x, y, z = points.T
    return np.column_stack([-z, -y, axis - x])


def _post(body: RigidBody) -> RigidBody:
    """Return a post below the object, in the room."""
    low, high = body.points.min(axis=0), body.points.max(axis=0)
    size = float((high - low).max())
    half = np.array([POST * size, POST * size, size / 2])
    return rigid_box("post", 2 * half, (0.0, 0.0, -high[0] - BELOW * size - half[2]))


@dataclass(frozen=True)
class LiftFigures:
    """What one design does to the object; None where this has no meaning.

    Attributes:
        held_mass_kg: The largest mass that the fingers bear.
        slip_mm: The sliding at which they bear the object; None if they do not.
        smallest_distance_mm: Smallest distance between faces.
        finger_force_n: Force of a finger on the object, where the sliding ends.
        contact_area_mm2, contact_pressure_kpa: Area that touches it, and the mean pressure there.
        failure: Why the pull ended before the limit of sliding; None if it did not.
    """

    held_mass_kg: float | None = None
    slip_mm: float | None = None
    smallest_distance_mm: float | None = None
    finger_force_n: float | None = None
    contact_area_mm2: float | None = None
    contact_pressure_kpa: float | None = None
    failure: str | None = None


@dataclass(frozen=True)
class LiftResult:
    """An object that is lifted, by the print and by the initial design.

    Attributes:
        intervals: Half-width of the interval of each figure of the print, by key, as far as they
            are known.
    """

    mass_kg: float
    friction: float | None
    fingers: int
    printed: LiftFigures
    initial: LiftFigures
    intervals: Mapping[str, float] = field(default_factory=dict)

    NAME: ClassVar[str] = "load"
    notes: ClassVar[Sequence[str]] = ()

    @property
    def figures(self) -> tuple[Figure, ...]:
        """The most important figures of the print."""
        return lift_figures(self.printed, self.intervals)

    @property
    def words(self) -> str:
        """It in words."""
        made, initial = self.printed, self.initial.held_mass_kg
        lifted, most = "falls", "at least" if made.failure else "at most"
        if made.slip_mm is not None:
            lifted = f"is lifted and slips by {made.slip_mm:.1f} mm"
        elif made.failure:
            lifted = f"is not lifted: {made.failure.rstrip('.')}"
        found = f"An object of {1e3 * self.mass_kg:.0f} g {lifted}"
        if made.held_mass_kg is None:
            return found
        before = "" if initial is None else f", the initial design {1e3 * initial:.0f} g"
        times = made.held_mass_kg / self.mass_kg
        held = f"{self.figures[0].shown} ({times:.2g} times as much)"
        return f"{found}; the print holds {most} {held}{before}"

    def entries(self) -> dict[str, Any]:
        """Return it as summaries hold it."""
        found = asdict(self)
        del found["intervals"]  # they are with the figures
        return found


def lift_figures(made: LiftFigures, intervals: Mapping[str, float]) -> tuple[Figure, ...]:
    """Return the most important figures of a lift, with half-widths of intervals by their keys."""
    values = asdict(made)
    names = {"held_mass": "kg", "slip": "mm", "smallest_distance": "mm"}
    keys = {f"{name}_{unit}": (name, unit) for name, unit in names.items()}
    return tuple(Figure(*one, values[key], intervals.get(key)) for key, one in keys.items())


@dataclass(frozen=True, eq=False)
class Grip:
    """Fingers around their object, as they are simulated.

    Attributes:
        closing, pulling: Solvers without and with friction.
        finger: The whole finger of which half is simulated; None where all fingers are.
    """

    scene: GripperScene
    closing: EquilibriumSolver
    pulling: EquilibriumSolver
    body: RigidBody
    finger: Mirrored | None

    @property
    def parts(self) -> int:
        """Number of equal parts of the gripper, of which one is simulated."""
        return 1 if self.finger is None else 2 * self.scene.fingers

    def slip(self, points: Sequence[PullPoint]) -> float | None:
        """Return the sliding in m at which the fingers bear the object; None if they do not."""
        wanted = self.scene.object
        found = slip_under(points, wanted.mass * GRAVITY / self.parts)
        return None if found is None or found > wanted.slip_limit else found

    def every(self, problem: ShapeProblem, density: Floats) -> Floats:
        """Return the density of all triangles that are simulated, from that of half a finger."""
        if self.finger is not None:
            return density
        return np.tile(problem.whole.at_cells(density), self.scene.fingers)

    def pull_of(self, made: Evaluation[Equilibrium]) -> ObjectPull:
        """Pull the object out of fingers with the print of a simulation."""
        problem, at = made.problem, made.equilibrium
        assert isinstance(problem, ShapeDesign)
        density = self.every(problem, problem.skin.gather_cells(made.projected))
        # A finger may have several equilibria: this one is known.
        start = None if self.finger is None else at.state
        return self.pull(density, at.pressures, start)

    def pull(self, density: Floats, pressures: Sequence[float], start: Floats | None) -> ObjectPull:
        """Pull the object out of the fingers: to the limit, and all the way if it drops.

        Args:
            density: Density of all triangles that are simulated, (t,).
            pressures: In Pa.
            start: Where closing begins, a state of the solver; None: flat.
        """
        owned, wanted = density[self.closing.skin.owned_cells], self.scene.object
        limit, end = wanted.slip_limit, wanted.lift_distance or 0.0
        near = limit * np.linspace(0.0, 1.0, NEAR_STEPS + 1) ** 2
        far = np.linspace(limit, max(end, limit), FAR_STEPS + 1)[1:]
        depths = [*near, *far[far > limit]]

        def path() -> Iterator[PullPoint]:
            closed, points = self.closing.solve(owned, pressures, start=start), list[PullPoint]()
            for point in pull_out(self.pulling, owned, pressures, depths, ALONG, closed):
                points.append(point)
                yield point
                if point.depth >= limit and self.slip(points) is not None:
                    return

        return ObjectPull(self, density, *until_failure(path()))


@dataclass(frozen=True, eq=False)
class ObjectPull:
    """What one design does to the object.

    Attributes:
        density: Density of all triangles that are simulated, (t,).
        points: The equilibria; none where the fingers do not close.
        failure: Why the pull ended early; empty if it did not.
    """

    grip: Grip
    density: Floats
    points: Sequence[PullPoint]
    failure: str

    def at(self, depth: float) -> PullPoint:
        """Return the equilibrium nearest to a depth in m."""
        return min(self.points, key=lambda point: abs(point.depth - depth))

    @property
    def figures(self) -> LiftFigures:
        """Its figures; those of fingers are at the end of the object's sliding."""
        if not self.points:
            return LiftFigures(failure=self.failure)
        grip, scene, slip = self.grip, self.grip.scene, self.grip.slip(self.points)
        at, triangles = self.at(slip or 0.0), grip.closing.skin.pattern.triangles
        thirds = np.repeat(np.linalg.norm(normals(at.positions, triangles), axis=1) / 6, 3)
        areas = np.bincount(triangles.ravel(), thirds, minlength=len(at.positions))
        normal, share = np.linalg.norm(at.normals, axis=1), grip.parts / scene.fingers
        area, force = share * float(areas[normal > 0].sum()), share * float(normal.sum())
        held = grip.parts * largest_force(self.points, scene.object.slip_limit) / GRAVITY
        early = self.points[-1].depth < scene.object.slip_limit
        distances = [point.result.smallest_distance or 0.0 for point in self.points]
        return LiftFigures(
            held_mass_kg=max(held, 0.0),
            slip_mm=None if slip is None else 1e3 * slip,
            smallest_distance_mm=1e3 * min(distances),
            finger_force_n=force,
            contact_area_mm2=1e6 * area,
            contact_pressure_kpa=1e-3 * force / area if area else None,
            failure=(self.failure or None) if early else None,
        )

    def row(self, name: str) -> tuple[Floats, list[LiftShape]]:
        """Return density and shapes to show: closed, half-way up, and at the end of the lift."""
        whole, slip, shapes = self.grip.finger, self.grip.slip(self.points), []
        for part, word in ((0.0, "closed"), (0.5, "half-way up"), (1.0, "lifted")):
            raised = part * (self.grip.scene.object.lift_distance or 0.0)
            sunk = raised if slip is None else min(slip, raised)
            x = self.at(sunk).positions
            x = x if whole is None else whole.at_vertices(x)
            shapes.append((f"{name}, {word}", x, sunk, raised))
        return self.density if whole is None else whole.at_cells(self.density), shapes


def grip_of(comm: MPI.Comm, problem: ShapeDesign, scene: GripperScene) -> Grip:
    """Return half a finger and the designed object, or all fingers and the object's mesh."""
    model, skin = problem.solver.model, problem.skin
    whole: Mirrored | None = problem.whole
    quadratic = problem.case.quadratic
    contact, supports, path = scene.held_contact, model.supports, scene.object.object_mesh
    if path is not None:
        pattern, axis, count = problem.whole.pattern, scene.body.centre[2], scene.fingers
        read = rigid_mesh(comm, "object", path, scale=scene.object.object_scale)
        # Upright, in the frame of the first finger.
        points = from_room(read.points - read.centre, 0.0) + [scene.body.centre[0], 0.0, axis]
        body = RigidBody("object", points, read.triangles)
        distance = scene.contact.contact_distance
        contact = Contact(bodies=[body], self_contact=False, distance=distance)
        turned = [
            from_room(in_room(pattern.points, axis, angle), axis)
            for angle in 2 * np.pi * np.arange(count) / count
        ]
        every, _ = repeated(pattern, [], count)
        skin = sew(comm, replace(every, points=np.concatenate(turned)))
        if quadratic is not None:
            quadratic = np.tile(quadratic[problem.whole.cell], count)
        supports = Supports(np.tile(scene.mounted(pattern).fixed, (count, 1)))
        whole = None
    closing, pulling = (
        EquilibriumSolver(
            skin,
            model.composite,
            supports,
            problem.solver.options,
            contact=replace(contact, friction=friction),
            quadratic=quadratic,
        )
        for friction in (None, scene.contact.friction)
    )
    return Grip(scene, closing, pulling, contact.bodies[0], whole)


def lift(
    comm: MPI.Comm,
    output: Path,
    scene: GripperScene,
    design: SkinDesign,
    other: OnOtherMesh | None,
) -> LiftResult:
    """Let the printed gripper lift its object, and the initial design too (collective).

    `other` is that of `ActuatorScene.trial`.
    """
    designed, printed = design.problem, design.printed
    assert isinstance(designed, ShapeDesign)
    shown = printed.evaluation or design.design.final
    problem = shown.problem
    assert isinstance(problem, ShapeDesign)
    drawn = designed.fields.start(design.search.seed)
    _, initial = designed.fields.forward(designed.fields.with_passive(drawn))
    grip = grip_of(comm, problem, scene)
    # On the mesh of the print, so that both are seen alike.
    there = make_transfer(designed.skin.pattern, problem.skin.pattern)
    begun = grip.every(problem, there.at_cells(designed.skin.gather_cells(initial)))
    first, pull = grip.pull(begun, shown.equilibrium.pressures, None), grip.pull_of(shown)
    figures = pull.figures
    intervals = {}  # where the pull ends early the held mass is a lower bound
    if not figures.failure:
        intervals = trial_intervals(comm, scene, lift_figures(figures, {}), other)
    who = scene.object.mass, scene.contact.friction, scene.fingers
    lifted = LiftResult(*who, figures, first.figures, intervals)
    pulls = {"initial design": first, "as printed": pull}
    if rows := [each.row(name) for name, each in pulls.items() if each.points]:
        pattern, copies, regions = problem.whole.pattern, scene.fingers, list(printed.regions)
        if grip.finger is None:
            pattern, copies, regions = grip.closing.skin.pattern, 1, regions * copies
        write_lift(comm, output, pattern, rows, regions, grip.body, copies, lifted.words)
    return lifted
