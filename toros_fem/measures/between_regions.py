"""How a region of a skin has turned and moved, seen from another one or from space.

Each region turns by its best rigid rotation R, each vertex by its flat area. Q = RₐᵀRₒ is the
turn of a region o seen from a region a that stays as it was assembled; without a, Q = Rₒ.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import Bools, Floats, checked_floats, require_kind, shown, vector
from toros_fem.measures.metrics import swing_free
from toros_fem.measures.rotation import DETERMINED, axial, polar_rotation
from toros_fem.meshes.pattern import Pattern

UP = (0.0, 0.0, 1.0)


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
