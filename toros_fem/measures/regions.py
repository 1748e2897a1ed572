"""Regions of a skin: how they have turned and moved, a slender body's axis, the gap to a body.

Each region turns by its best rigid rotation R, each vertex by its flat area. Q = RₐᵀRₒ is the
turn of a region o seen from a region a that stays as it was assembled; without a, Q = Rₒ.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import dot
from toros_fem.base.validation import (
    Bools,
    Floats,
    Ints,
    checked_floats,
    require_choice,
    require_kind,
    require_positive,
    shown,
    vector,
)
from toros_fem.measures.cross_sections import label_cross_sections, section_vertices
from toros_fem.measures.metrics import Metric, swing_free, turn_about, turn_angle
from toros_fem.measures.shape import DETERMINED, Nodes, axial, polar_rotation
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.surface import Surface
from toros_fem.meshes.targets import Deformer, bend, compose, contract
from toros_fem.meshes.targets import twist as turned

UP = (0.0, 0.0, 1.0)
DIRECTIONS = ("x", "y", "z", "-x", "-y", "-z")
# A tip is flat if so many vertices lie at the far end, within this fraction of the length.
FLAT_VERTICES, FLAT = 6, 1e-9
# Part of the length that counts as the tip where it is not flat.
TIP = 1 / 12
# Cross-sections by which metrics follow the body, and the least number of vertices of each.
SECTIONS, LEAST = 24, 6
# A length that is off by so much, in per cent, counts like a turn that is not there at all.
LENGTH_SCALE = 20.0
SHAPES = ("sphere", "box")


@dataclass(frozen=True, eq=False)
class TipFrame:
    """Where a region is, and where its axis points to.

    Attributes:
        displacement: Of its mean, (3,), in m.
        direction: Unit vector that the axis of the assembled region has become, (3,).
        lean: Angle between the axis before and after, in rad.
    """

    displacement: Floats
    direction: Floats
    lean: float


def bend_between(
    pattern: Pattern,
    positions: Floats,
    of: Bools,
    against: Bools | None = None,
    *,
    along: npt.ArrayLike = UP,
    toward: npt.ArrayLike | None = None,
) -> float:
    """Return the angle in rad by which a region has turned, in a plane or in all.

    Args:
        pattern: The pattern.
        positions: Deformed positions of all assembled vertices, (n, 3), in m.
        of: Whether each vertex belongs to the region, (n,); on a line its rotation is not known.
        against: The same of the region that it is seen from; None: it is seen from space.
        along: Direction of the assembled region, (3,), a unit vector.
        toward: Direction of the bend, (3,), a unit vector perpendicular to `along`. The angle is
            atan2(Qa·toward, Qa·along), within ±π. None: the angle of the rotation Q itself, from 0
            to π, whatever its axis.
    """
    turn = _turn(pattern, positions, of, against)
    if toward is None:
        return float(np.arctan2(np.linalg.norm(axial(turn)), np.trace(turn) - 1))
    plane = np.stack([vector("toward", toward), vector("along", along)])
    return float(np.arctan2(*(plane @ turn @ plane[1])))


def twist_between(
    pattern: Pattern,
    positions: Floats,
    of: Bools,
    against: Bools | None = None,
    *,
    along: npt.ArrayLike = UP,
) -> float:
    """Return the angle in rad by which a region has turned about an axis `along`, within ±π.

    It is the twist of Q = swing · twist, as of `twist_angle`: the swing, which tilts the axis, does
    not count. The arguments are of `bend_between`.
    """
    axis = vector("along", along)
    angle = 2 * np.arctan2(*swing_free(_turn(pattern, positions, of, against), axis))
    return float(np.pi - (np.pi - angle) % (2 * np.pi))


def length_between(pattern: Pattern, positions: Floats, of: Bools, against: Bools) -> float:
    """Return the distance between the means of two regions over the assembled one."""
    ends, roots = (_means(pattern, positions, region) for region in (of, against))
    before, after = (float(np.linalg.norm(a - b)) for a, b in zip(ends, roots, strict=True))
    if before <= 1e-9 * pattern.size:
        raise ParameterError("the two regions have one mean, so that their distance has no ratio.")
    return after / before


def tip_frame(
    pattern: Pattern,
    positions: Floats,
    of: Bools,
    against: Bools | None = None,
    *,
    along: npt.ArrayLike = UP,
) -> TipFrame:
    """Return where a region's mean has moved, and where its axis `along` points to.

    The arguments are of `bend_between`.
    """
    axis = vector("along", along)
    before, after = _means(pattern, positions, of)
    if against is not None:
        root, moved = _means(pattern, positions, against)
        after = (after - moved) @ _rotation(pattern, positions, against) + root
    direction = _turn(pattern, positions, of, against) @ axis
    lean = np.arctan2(np.linalg.norm(np.cross(axis, direction)), axis @ direction)
    return TipFrame(after - before, direction, float(lean))


def _turn(pattern: Pattern, positions: Floats, of: Bools, against: Bools | None) -> Floats:
    turn = _rotation(pattern, positions, of)
    return turn if against is None else _rotation(pattern, positions, against).T @ turn


def _rotation(pattern: Pattern, positions: Floats, region: Bools) -> Floats:
    """Return the rotation, (3, 3), that best maps the assembled region onto the deformed one."""
    before, after = _means(pattern, positions, region)
    a, b = pattern.points[region] - before, positions[region] - after
    rotation, matrix = polar_rotation((pattern.vertex_areas[region, None] * b).T @ a)
    least, _, most = np.linalg.eigvalsh(matrix)
    if not least > DETERMINED * most:
        raise ParameterError(
            f"the turn of a region is not known: its {np.count_nonzero(region)} vertices lie on a "
            "line, or have become their mirror image. Take a larger region."
        )
    return rotation


def _means(pattern: Pattern, positions: Floats, region: Bools) -> tuple[Floats, Floats]:
    """Return the mean of a region before and after, (3,), in m."""
    require_kind("pattern", pattern, Pattern, "a Pattern")
    shape = pattern.points.shape
    checked_floats("positions", positions, f"{shape}, in m", shape, finite=False)
    chosen = np.asarray(region)
    if chosen.dtype != bool or chosen.shape != shape[:1] or not chosen.any():
        raise ParameterError(
            f"a region is {shown(region)}; it must be True or False for each of the {shape[0]} "
            "vertices, and True for some."
        )
    weights = pattern.vertex_areas[chosen]
    before, after = (
        np.average(x[chosen], axis=0, weights=weights) for x in (pattern.points, positions)
    )
    return before, after


# ------------------------------------------------------------------------- axis of a slender body


@dataclass(frozen=True, eq=False)
class BodyAxis:
    """Where a body lies along an axis, which runs through the middle of its bounding box.

    Attributes:
        origin: Point of the axis at the body's near end, (3,), in m.
        frame: Rows are the direction that bends go to, the one that makes the frame right-handed,
            and the axis, (3, 3).
        begin, end: Distances from the origin in m between which a target deforms the body.
        length: Length of the body in m.
        half_width: Half of its width in m, in the direction that bends go to.
        flat_tip: Whether the far end is flat.
    """

    origin: Floats
    frame: Floats
    begin: float
    end: float
    length: float
    half_width: float
    flat_tip: bool

    @property
    def along(self) -> Floats:
        """Unit vector along the axis, (3,)."""
        return self.frame[2]

    def local(self, points: Floats) -> Floats:
        """Return points (n, 3) in the frame, z along the axis, in m."""
        return (points - self.origin) @ self.frame.T

    def in_space(self, local: Floats) -> Floats:
        """Return points in space from those in the frame."""
        return local @ self.frame + self.origin

    def labels(self, pattern: Pattern, count: int) -> Ints:
        """Return the cross-section of each vertex, (n,), −1 before `begin`.

        They have equal lengths; a flat tip is one more.
        """
        beyond = np.flatnonzero(self.local(pattern.points)[:, 2] >= self.begin)
        return label_cross_sections(pattern, beyond, self.along, count, border=self.flat_tip)

    def tip(self, pattern: Pattern) -> Ints:
        """Return the vertices of the tip: the flat end, or the last twelfth."""
        away = self.local(pattern.points)[:, 2]
        near = (FLAT if self.flat_tip else TIP) * self.length
        return np.flatnonzero(away > away.max() - near)

    def deformer(
        self, angle: float | None, twist: float | None, shortening: float | None, neutral: float
    ) -> Deformer:
        """Return the target that shortens the body, then twists it, then bends it.

        Angles are in rad; a twist is positive if counter-clockwise seen from the tip, `shortening`
        is a fraction of the length, and `neutral` the distance in m from the axis, towards the
        inner side, of the line that keeps its length in a bend. Each is spread evenly between
        `begin` and `end`. Before, the body stays; beyond, it goes on straight.
        """
        length, ratio = self.end - self.begin, 1 - (shortening or 0.0)
        slender = compose(contract(ratio), turned(twist or 0.0, ratio * length))
        bent = bend(angle or 0.0, ratio * length, neutral=neutral)

        def deform(points: Floats) -> Floats:
            found = self.local(points) - [0, 0, self.begin]
            outside = found[:, 2] - np.clip(found[:, 2], 0, length)
            along = np.outer(outside, [0, 0, 1])
            return self.in_space(bent(slender(found - along) + along) + [0, 0, self.begin])

        return deform

    def metric(self, name: str, target: float | None) -> Metric:
        """Return a number that a target along the axis is judged by, or only watched.

        Names are "angle", by which the tip bends in the plane of the target, in degrees; "twist" of
        the tip about the axis in degrees; "shortening", the decrease in per cent of the distance
        between the mean vertices of the tip and of the section at `begin`.
        """

        def measure(pattern: Pattern, positions: Floats) -> float:
            rings = self._rings(pattern)
            if name == "angle":
                turn = turn_angle(pattern, positions, rings, self.along, self.frame[0])
                return float(np.degrees(turn))
            if name == "twist":
                return float(np.degrees(turn_about(pattern, positions, rings, self.along)))
            before, after = (
                np.linalg.norm(x[rings[-1]].mean(axis=0) - x[rings[0]].mean(axis=0))
                for x in (pattern.points, positions)
            )
            return float(100 * (1 - after / before))

        if name == "shortening":
            return Metric(name, "percent", target, measure, LENGTH_SCALE)
        return Metric(name, "deg", target, measure)

    def _rings(self, pattern: Pattern) -> list[Ints]:
        """Return the vertices of each cross-section, the tip as the last."""
        labels, tip = self.labels(pattern, SECTIONS), self.tip(pattern)
        labels[tip] = SECTIONS
        return section_vertices(labels, least=LEAST)


def body_axis(
    pattern: Pattern | Surface, along: str, toward: str, begin: float, end: float | None
) -> BodyAxis:
    """Return the axis of a body.

    The perpendicular directions, of `DIRECTIONS`, are from root to tip and where bends go to. A
    target deforms the body between `begin` and `end`, in m from its near end; None takes the far
    end, or where a tip that is not flat begins.
    """
    axis, side = (unit_vector(word) for word in (along, toward))
    if abs(axis @ side) > 0.5:
        raise ParameterError(
            f"toward = {toward!r} must be perpendicular to axis = {along!r}; give another one."
        )
    frame = np.stack([side, np.cross(axis, side), axis])
    local = pattern.points @ frame.T
    low, high = local.min(axis=0), local.max(axis=0)
    middle, length = (low + high) / 2, float(high[2] - low[2])
    flat = int((local[:, 2] > high[2] - FLAT * length).sum()) >= FLAT_VERTICES
    last = (length if flat else (1 - TIP) * length) if end is None else end
    if not 0 <= begin < last <= length * (1 + FLAT):
        raise ParameterError(
            f"begin = {begin:.6g} m and end = {last:.6g} m must lie in this order on the axis, "
            f"between 0 and {length:.6g} m, the length of the body along {along}."
        )
    return BodyAxis(
        origin=np.array([middle[0], middle[1], low[2]]) @ frame,
        frame=frame,
        begin=begin,
        end=last,
        length=length,
        half_width=float(high[0] - low[0]) / 2,
        flat_tip=flat,
    )


def unit_vector(word: str) -> Floats:
    """Return one of `DIRECTIONS` as a vector, (3,)."""
    sign = -1.0 if word.startswith("-") else 1.0
    return sign * np.eye(3)["xyz".index(word[-1])]


# ---------------------------------------------------------------------------------- gap to a body


@dataclass(frozen=True)
class Body:
    """Sphere, or box along the axes with rounded edges.

    Attributes:
        shape: "sphere" or "box".
        size: Diameter or edge length in m.
        centre: Centre in m.
        rounding: Radius of a box's edges over half its size, in (0, 1].
    """

    shape: str
    size: float
    centre: tuple[float, float, float]
    rounding: float = 0.25

    def __post_init__(self) -> None:
        require_choice("shape", self.shape, SHAPES)
        require_positive(size=self.size)
        require_positive(rounding=self.rounding, at_most=1.0)
        x, y, z = checked_floats("centre", self.centre, "three finite numbers, in m", (3,))
        object.__setattr__(self, "centre", (float(x), float(y), float(z)))

    @property
    def radius(self) -> float:
        """Radius of the sphere, or of the box's edges, in m."""
        return self.size / 2 * (1.0 if self.shape == "sphere" else self.rounding)

    def distance(self, points: Floats) -> tuple[Floats, Floats]:
        """Return the signed distance from the surface, (n,), in m, and its gradient, (n, 3).

        The distance is positive outside. Inside a box, where two sides are equally near, the
        gradient is that of one of them; at the centre of a body it is 0.
        """
        arm = points - self.centre
        # A sphere is a box whose flat sides have no width.
        core = self.size / 2 - self.radius
        over = np.abs(arm) - core
        out = np.maximum(over, 0.0)
        reach = np.linalg.norm(out, axis=1)
        deepest = over.max(axis=1)
        inside = np.minimum(deepest, 0.0)
        gradient = np.sign(arm) * out / np.maximum(reach, np.finfo(float).tiny)[:, None]
        deep = reach == 0
        side = np.argmax(over[deep], axis=1)
        gradient[deep] = np.sign(arm[deep]) * np.eye(3)[side]
        return reach + inside - self.radius, gradient


def mean_gap(body: Body, pattern: Pattern, positions: Floats, touching: Bools) -> float:
    """Return the mean distance in m of touching vertices, (n,), from a body, inside as outside.

    They count by their flat areas; the positions are those of all vertices, (n, 3), in m.
    """
    distance, _ = body.distance(positions[touching])
    return float(np.average(np.abs(distance), weights=pattern.vertex_areas[touching]))


class GapObjective:
    """T = ½ w Σᵥ wᵥ dᵥ² / (L² Σᵥ wᵥ), d the distance from a body's surface.

    wᵥ is a weight ≥ 0 times the flat area of a vertex, w the factor, and L the diagonal of the
    assembled skin's bounding box. Distances inside the body count as much as those outside:
    without contact a vertex may lie inside, where it would press on the body.
    """

    def __init__(self, skin: Nodes, body: Body, weights: Floats, factor: float = 1.0) -> None:
        pattern = skin.pattern
        areas = pattern.vertex_areas * weights
        self._comm, self._body = skin.comm, body
        self._weight = factor * areas[skin.owned_vertices] / (areas.sum() * pattern.size**2)

    def forward(self, positions: Floats) -> float:
        """Return T at positions of the owned nodes, (n, 3) (collective)."""
        distance, _ = self._body.distance(positions)
        return 0.5 * dot(self._comm, distance, self._weight * distance)

    def backward(self, positions: Floats) -> Floats:
        """Return ∂T/∂x at the owned nodes, (n, 3), in 1/m."""
        distance, gradient = self._body.distance(positions)
        return np.asarray((self._weight * distance)[:, None] * gradient)
