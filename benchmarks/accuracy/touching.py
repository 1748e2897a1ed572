"""Scenes of contact: a sheet against a plate, in a fold, between plates, on a drum.

Middle surfaces of sheets have thickness around them, which contact keeps: half of it from bodies
and ground. Lengths are in m, forces in N.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.optimize import brentq

from benchmarks.accuracy.known import Measured, timed
from benchmarks.accuracy.membrane import DISC, THICKNESS, clamped_disc
from benchmarks.accuracy.references import BALL
from benchmarks.accuracy.scenes import COMM, Floats, Solved, membrane, table_a
from benchmarks.accuracy.sheets import line_force
from toros_fem.materials.sheet import Bending, Composite
from toros_fem.mechanics.contact.bodies import Ground, RigidBody
from toros_fem.mechanics.contact.contact import Contact
from toros_fem.mechanics.contact.solids import rigid_sphere
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Supports, symmetry_plane
from toros_fem.meshes import Pattern, rectangle, sew

# Pressure and height of the plate above the border, of the membrane blown against it.
PLATE_PRESSURE, PLATE_HEIGHT = 1000.0, 6e-3
# Force of the ball on the same membrane.
BALL_FORCE = 0.1
# Its first height above the sheet: corners of its facets lie outside of its radius.
BALL_START = 1e-4
# The flattened tube: radius, distance of the middle surfaces when pressed, length, pressure.
TUBE_RADIUS, TUBE_HEIGHT, TUBE_LENGTH, TUBE_PRESSURE = 0.01, 0.008, 0.002, 2000.0
# The pad on a slope: side, thickness, weight per area, friction.
PAD, PAD_THICKNESS, PAD_WEIGHT, PAD_FRICTION = 0.02, 0.5e-3, 200.0, 0.5
# The belt: radius of the drum, width, free length at both ends, thickness, pull, friction, and the
# turn of the drum in rad, by far enough to let all of the belt slip.
DRUM, BELT_WIDTH, BELT_FREE, BELT_THICKNESS = 0.02, 0.005, 0.01, 0.5e-3
BELT_PULL, BELT_FRICTION, BELT_TURN, BELT_STIFFNESS = 0.25, 0.3, 0.3, 1e5
DRUM_SIDES = 360
# The folded sheet: lengths of the lower and the upper half, width, thickness, pressure on the
# upper half.
FOLD_LOWER, FOLD_UPPER, FOLD_WIDTH, FOLD_THICKNESS, FOLD_PRESSURE = 0.03, 0.02, 0.01, 0.5e-3, 200.0


@dataclass(frozen=True, eq=False)
class Touched(Solved):
    """An equilibrium in contact; `reactions` leave out what supports carry of the pressure.

    That part depends on how a missing wall is closed.

    Attributes:
        touch: Forces of contact on all assembled vertices, friction included, (n, 3), in N.
    """

    touch: Floats


class Touching:
    """A skin in contact.

    Args:
        pattern: Flat panels and where to start, free of contact.
        composite: Materials.
        supports: What is held.
        contact: What it may touch.
    """

    def __init__(
        self, pattern: Pattern, composite: Composite, supports: Supports, contact: Contact
    ) -> None:
        self.pattern = pattern
        self.skin = sew(COMM, pattern)
        self.solver = EquilibriumSolver(self.skin, composite, supports, contact=contact)
        self._fabric = np.zeros(len(self.skin.owned_cells))

    def solve(
        self,
        pressure: float = 0.0,
        *,
        force: Floats | None = None,
        displacement: Floats | None = None,
        poses: Floats | None = None,
        start: Equilibrium | None = None,
        trial: bool = False,
    ) -> Touched:
        """Return the equilibrium; only the solve is timed.

        Args:
            pressure, force, displacement, poses, start: As of `EquilibriumSolver.solve`.
            trial: Whether to try once, and to return what was found if that is no equilibrium.
        """
        result, seconds = timed(
            lambda: self.solver.solve(
                self._fabric,
                Load(pressure, force=force, displacement=displacement, poses=poses),
                after=start,
                trial=trial,
                raise_on_failure=not trial,
            )
        )
        model, gather = self.solver.model, self.skin.gather_vertices
        assert model.contact is not None
        push = np.zeros(model.size_local)
        model.contact.add_gradient(result.state, push)
        load = model.load
        model.set_load(replace(load, pressure=0 * load.pressures))
        pulls = gather(model.positions(model.reaction(result.state)))
        model.set_load(load)
        points = gather(result.positions)
        return Touched(self.pattern, points, pulls, result, seconds, -gather(model.positions(push)))


@cache
def against_plate(mesh: str, count: int, parts: int) -> Touched:
    """The clamped disc of material A, blown against a plate.

    Args:
        mesh: As for `disc`.
        count: Edges along the radius.
        parts: Thickness over the distance from which on contact acts.
    """
    pattern, supports = clamped_disc(mesh, count)
    plate = Ground((0.0, 0.0, PLATE_HEIGHT + THICKNESS / 2), (0.0, 0.0, -1.0))
    contact = Contact(plate, self_contact=False, distance=THICKNESS / parts)
    return Touching(pattern, table_a(), supports, contact).solve(PLATE_PRESSURE)


def pressure_forces(found: Solved) -> Floats:
    """Force in N of the pressure on each vertex, (n, 3): a third of that on its triangles."""
    triangles = found.pattern.triangles
    a, b, c = (found.points[corner] for corner in triangles.T)
    shares = found.result.pressure / 6 * np.cross(b - a, c - a)
    out = np.zeros_like(found.points)
    for corner in triangles.T:
        np.add.at(out, corner, shares)
    return out


def plate_force(found: Solved) -> float:
    """Force of a plate above, as what the pressure lifts and the supports do not hold."""
    free = found.reactions[:, 2] == 0
    return float(pressure_forces(found)[free, 2].sum() + found.reactions[:, 2].sum())


def contact_radius(found: Solved) -> Measured:
    """Radius of the part on the plate, over that of the disc: there the plate carries p."""
    return found.measured(np.sqrt(plate_force(found) / (np.pi * PLATE_PRESSURE)) / DISC)


def pole_stretch(found: Solved) -> Measured:
    """Stretch of the part on the plate, by the flat part within half of it."""
    flat = np.zeros((len(found.points), 2))
    flat[found.pattern.sewn] = found.pattern.flat_points
    near = np.linalg.norm(flat, axis=1) < 0.25 * DISC
    return found.measured(
        float((flat[near] * found.points[near, :2]).sum() / (flat[near] ** 2).sum())
    )


def plate_volume(found: Solved) -> Measured:
    """Enclosed volume over the cube of the radius."""
    return found.measured(found.result.volume / DISC**3)


def pole_height(found: Solved) -> Measured:
    """Height of the part on the plate over that without a distance."""
    near = np.linalg.norm(found.points[:, :2], axis=1) < 0.25 * DISC
    return found.measured(found.points[near, 2].mean() / PLATE_HEIGHT)


@cache
def under_ball(mesh: str, count: int, parts: int) -> Touched:
    """The clamped disc of material A under a ball that presses on its middle by a given force.

    Args:
        mesh, count, parts: As in `against_plate`.
    """
    pattern, supports = clamped_disc(mesh, count)
    distance = THICKNESS / parts
    height = BALL + THICKNESS / 2 + BALL_START
    ball = rigid_sphere("ball", BALL, (0.0, 0.0, height), edge_length=DISC / (2 * count))
    contact = Contact(bodies=[ball], self_contact=False, distance=distance)
    touching = Touching(pattern, table_a(), supports, contact)
    # A plain sheet without a pull has no stiffness: a pressure holds it until the ball does.
    at = touching.solve(PLATE_PRESSURE / 10)
    seconds, depths, forces = at.seconds, [0.4 * DISC, 0.41 * DISC], []
    for pressure in (PLATE_PRESSURE / 10, 0.0):
        at = touching.solve(pressure, poses=lowered(depths[0]), start=at.result)
        seconds += at.seconds
    while len(forces) < len(depths):
        at = touching.solve(poses=lowered(depths[len(forces)]), start=at.result)
        seconds += at.seconds
        forces.append(-float(at.touch[:, 2].sum()))
        if len(forces) > 1 and abs(forces[-1] - BALL_FORCE) > 1e-9 * BALL_FORCE:
            slope = (forces[-1] - forces[-2]) / (depths[-1] - depths[-2])
            depths.append(depths[-1] + (BALL_FORCE - forces[-1]) / slope)
    return replace(at, seconds=seconds)


def lowered(depth: float) -> Floats:
    """Return the pose of the only body, moved down."""
    return np.array([[0.0, 0.0, -depth, 0.0, 0.0, 0.0]])


def ball_depth(found: Touched) -> Measured:
    """Depth of the ball over the radius of the disc."""
    assert found.result.poses is not None
    return found.measured(-(BALL_START + found.result.poses[0][2]) / DISC)


@dataclass(frozen=True)
class Stadium:
    """Cross section of a flattened tube: two half circles and two straight lines.

    Attributes:
        radius: Of the half circles.
        flat: Length of each straight line.
    """

    radius: float
    flat: float

    def upper(self, share: Floats) -> Floats:
        """Return x and z of its upper half, (n, 2), by the share of its length from −x to x."""
        quarter = np.pi * self.radius / 2
        at = share * (2 * quarter + self.flat)
        along = np.clip(at - quarter, 0, self.flat) - self.flat / 2
        turn = (
            np.clip(at, 0, quarter) + np.clip(at - quarter - self.flat, 0, quarter)
        ) / self.radius
        return np.column_stack([along - self.radius * np.cos(turn), self.radius * np.sin(turn)])


def flattened(composite: Composite) -> tuple[float, float]:
    """Return the exact stretch around the tube, and the length of each flat part in m.

    Nothing drags at the wall, and so the pull around it is p H/2 everywhere, with H the distance
    of the middle surfaces: a half circle spans it. It gives the stretch by eq. (1), and this the
    circumference 2π R λ = π H + 2 b.
    """
    sheet = composite.fabric
    one, two = (composite.c1 - 1) ** 2, (composite.c2 - 1) ** 2

    def surplus(stretch: float) -> float:
        e = stretch - 1
        pull = 2 * sheet.mu * e / (1 - e**2 / one) + sheet.lam * e / (1 - e**2 / two)
        return sheet.thickness * pull - TUBE_PRESSURE * TUBE_HEIGHT / 2

    bound = min(composite.c1, composite.c2)
    stretch = float(brentq(surplus, 1.0, bound - 1e-9, xtol=1e-15))
    return stretch, np.pi * (TUBE_RADIUS * stretch - TUBE_HEIGHT / 2)


@cache
def pressed_tube(mesh: str, count: int, parts: int) -> Touched:
    """A section of a long tube between two plates, its upper half.

    Args:
        mesh: As for `rectangle`.
        count: Edges of half the circumference.
        parts: As in `against_plate`.
    """
    composite = table_a()
    length = np.pi * TUBE_RADIUS
    low = TUBE_HEIGHT / 2 - 2 * THICKNESS / parts
    shape = Stadium(low, length - np.pi * low)
    width = max(TUBE_LENGTH, length / count)

    def place(flat: Floats) -> Floats:
        x, z = shape.upper(flat[:, 0] / length).T
        return np.column_stack([x, flat[:, 1], z])

    pattern = rectangle(COMM, length, width, length / count, mesh, place)
    supports = symmetry_plane(pattern, 2)
    for at in (0.0, width):
        supports = supports | symmetry_plane(pattern, 1, at)
    fixed = supports.fixed.copy()
    fixed[:, 1] = True
    fixed[np.argmin(np.abs(pattern.points[:, 0]) - pattern.points[:, 2]), 0] = True
    plate = Ground((0.0, 0.0, TUBE_HEIGHT / 2 + THICKNESS / 2), (0.0, 0.0, -1.0))
    contact = Contact(plate, self_contact=False, distance=THICKNESS / parts)
    touching = Touching(pattern, composite, replace(supports, fixed=fixed), contact)
    return touching.solve(TUBE_PRESSURE)


def flat_width(found: Solved) -> Measured:
    """Force of the plate over pressure and length: the width of the flat part, in m."""
    return found.measured(plate_force(found) / (TUBE_PRESSURE * np.ptp(found.points[:, 1])))


@cache
def closed_fold(count: int, parts: int) -> Touched:
    """A sheet folded over, one half held flat, the other pressed onto it.

    Args:
        count: Edges across the width.
        parts: As in `against_plate`.
    """
    composite = replace(membrane(1e6, 0.3, FOLD_THICKNESS, 1.8, 2.0), bending=Bending())
    radius = 2 * FOLD_THICKNESS
    turn = np.pi * radius
    length = FOLD_LOWER + turn + FOLD_UPPER

    def place(flat: Floats) -> Floats:
        u = flat[:, 0]
        angle = np.clip(u - FOLD_LOWER, 0, turn) / radius
        x = np.minimum(u, FOLD_LOWER) - np.maximum(u - FOLD_LOWER - turn, 0)
        return np.column_stack(
            [x + radius * np.sin(angle), flat[:, 1], radius * (1 - np.cos(angle))]
        )

    pattern = rectangle(COMM, length, FOLD_WIDTH, FOLD_WIDTH / count, "right", place)
    u = np.zeros(len(pattern.points))
    u[pattern.sewn] = pattern.flat_points[:, 0]
    held = u < FOLD_LOWER + 1e-9
    upper = u > FOLD_LOWER + turn - 1e-9
    force = np.zeros((len(u), 3))
    force[upper, 2] = -FOLD_PRESSURE * pattern.vertex_areas[upper]
    contact = Contact(distance=FOLD_THICKNESS / parts)
    touching = Touching(pattern, composite, Supports(np.repeat(held[:, None], 3, axis=1)), contact)
    return touching.solve(force=force)


def gap(found: Solved) -> Measured:
    """Distance of the middle surfaces over the thickness, away from the fold."""
    far = (found.pattern.points[:, 2] > FOLD_THICKNESS) & (found.points[:, 0] < FOLD_LOWER / 2)
    return found.measured(found.points[far, 2].mean() / FOLD_THICKNESS)


def drum(sides: int) -> RigidBody:
    """A cylinder about the y axis with triangles of its whole length, the corners on its radius."""
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = np.column_stack([DRUM * np.sin(angle), np.zeros(sides), DRUM * np.cos(angle)])
    low, high = np.array([[0.0, -0.1, 0.0], [0.0, 1.1, 0.0]]) * BELT_WIDTH
    k, n = np.arange(sides), (np.arange(sides) + 1) % sides
    end = np.full(sides, 2 * sides)
    triangles = [(k, n, n + sides), (k, n + sides, k + sides), (n, k, end)]
    triangles.append((k + sides, n + sides, end + 1))
    return RigidBody(
        "drum",
        np.concatenate([ring + low, ring + high, [low, high]]),
        np.concatenate([np.stack(corners, axis=1) for corners in triangles]),
    )


def belt(
    count: int, sides: int, parts: int, friction: float | None, turn: float = BELT_TURN
) -> Touched:
    """A belt over half a drum, one end held, the other pulled down; the drum turns under it.

    The belt does not narrow, and has no bending.

    Args:
        count: Edges of the belt along half the drum.
        sides: Of the drum.
        parts: As in `against_plate`.
        friction: Coefficient; None for none, where the drum keeps still.
        turn: Of the drum in rad, towards the pulled end.
    """
    distance = BELT_THICKNESS / parts
    body = drum(sides)
    # The belt's chords start outside of the drum's corners.
    outer = np.linalg.norm(body.points[:, [0, 2]], axis=1).max()
    radius = (outer + BELT_THICKNESS / 2 + distance) / np.cos(np.pi / (2 * count))
    arc = np.pi * radius
    edge = arc / count

    def place(flat: Floats) -> Floats:
        u = flat[:, 0] - free
        angle = np.clip(u, 0, arc) / radius
        x, z = -radius * np.cos(angle), radius * np.sin(angle)
        return np.column_stack([x, flat[:, 1], z + np.minimum(u, 0) - np.maximum(u - arc, 0)])

    free = edge * np.ceil(BELT_FREE / edge)
    pattern = rectangle(COMM, arc + 2 * free, BELT_WIDTH, min(edge, BELT_WIDTH), "right", place)
    u = np.zeros(len(pattern.points))
    u[pattern.sewn] = pattern.flat_points[:, 0]
    fixed = np.zeros((len(u), 3), dtype=bool)
    fixed[:, 1] = True
    fixed[u < 1.5 * edge] = True
    pulled = u > arc + 2 * free - 1e-9
    force = line_force(pattern, pulled, np.array([0.0, 0.0, -BELT_PULL / BELT_WIDTH]))
    contact = Contact(
        bodies=[body], self_contact=False, friction=friction,
        distance=distance, stiffness=BELT_STIFFNESS,
    )  # fmt: skip
    composite = membrane(20e6, 0.0, BELT_THICKNESS, 1.5, 1.5)
    touching = Touching(pattern, composite, Supports(fixed), contact)
    found = touching.solve(force=force)
    if friction is None:
        return found
    pose = np.array([[0.0, 0.0, 0.0, 0.0, turn, 0.0]])
    return touching.solve(force=force, poses=pose, start=found.result)


def pull_ratio(found: Solved) -> Measured:
    """Pull of the held end over that of the other."""
    held = found.pattern.points[:, 0] < -DRUM
    return found.measured(-found.reactions[held, 2].sum() / BELT_PULL)


def on_slope(count: int, parts: int, slope: float, *, dragged: bool) -> Touched:
    """A pad on a slope, in its own frame: its weight is tilted in the place of the ground.

    Args:
        count: Edges along a side.
        parts: As in `against_plate`.
        slope: Tangent of the slope's angle; downhill is +x.
        dragged: Whether its uphill border is moved downhill until all of it slips.
    """
    distance = PAD_THICKNESS / parts

    def place(flat: Floats) -> Floats:
        height = (PAD_THICKNESS + distance) / 2
        return np.column_stack([flat, np.full(len(flat), height)])

    pattern = rectangle(COMM, PAD, PAD, PAD / count, "crossed", place)
    steep = np.array([slope, 0.0, -1.0]) / np.hypot(slope, 1.0)
    force = PAD_WEIGHT * pattern.vertex_areas[:, None] * steep
    fixed = np.zeros((len(pattern.points), 3), dtype=bool)
    fixed[:, 0] = dragged & (pattern.points[:, 0] < 1e-9)
    contact = Contact(Ground(), self_contact=False, friction=PAD_FRICTION, distance=distance)
    composite = membrane(1e6, 0.0, PAD_THICKNESS, 1.5, 1.5)
    pad = Touching(pattern, composite, Supports(fixed), contact)
    shift = np.where(fixed, 10 * distance, 0.0) if dragged else None
    return pad.solve(force=force, displacement=shift, trial=not dragged)


def sliding_slope(count: int, parts: int, slope: float) -> Measured:
    """Tangent at which a pad slides by itself: that of the slope, less the pull on a sliding pad.

    The pull is taken over the weight's part across the slope.
    """
    found = on_slope(count, parts, slope, dragged=True)
    across = PAD_WEIGHT * PAD**2 / np.hypot(slope, 1.0)
    return found.measured(slope + found.reactions[:, 0].sum() / across)


def holds(count: int, parts: int, slope: float) -> bool:
    """Return whether a free pad keeps its place on a slope."""
    return on_slope(count, parts, slope, dragged=False).result.converged


def steepest(halvings: int) -> Measured:
    """Tangent of the steepest slope on which a free pad keeps its place, by bisection.

    Args:
        halvings: Of an interval of half the reference.
    """
    low, width = 0.8 * PAD_FRICTION, 0.5 * PAD_FRICTION
    found = on_slope(2, 4, low, dragged=False)
    for _ in range(halvings):
        width /= 2
        if holds(2, 4, low + width):
            low += width
    return replace(found.measured(low + width / 2), length=width)
