"""The axis of a slender body of any shape: targets along it, its cross-sections, and metrics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import Floats, Ints
from toros_fem.measures.cross_sections import label_cross_sections, section_vertices
from toros_fem.measures.metrics import Metric, turn_about, turn_angle
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.surface import Surface
from toros_fem.meshes.targets import Deformer, bend, compose, contract
from toros_fem.meshes.targets import twist as turned

DIRECTIONS = ("x", "y", "z", "-x", "-y", "-z")
# A tip is flat if so many vertices lie at the far end, within this fraction of the length.
FLAT_VERTICES, FLAT = 6, 1e-9
# Part of the length that counts as the tip where it is not flat.
TIP = 1 / 12
# Cross-sections by which metrics follow the body, and the least number of vertices of each.
SECTIONS, LEAST = 24, 6
# A length that is off by so much, in per cent, counts like a turn that is not there at all.
LENGTH_SCALE = 20.0


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
