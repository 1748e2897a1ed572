"""How far a shape is from its target, as a person sees it: by points, sections, and its tip.

Objectives behind a motion say what is compared: of the skin fitted to the target, and of a whole
that is mirrored.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from toros_fem.base.mpi import sum_over_ranks
from toros_fem.base.validation import Bools, Floats, Ints
from toros_fem.measures.cross_sections import (
    CrossSectionObjective,
    label_cross_sections,
    section_vertices,
)
from toros_fem.measures.figures import DEFAULT, Figure, Tolerances
from toros_fem.measures.shape import (
    Nodes,
    Objective,
    ShapeObjective,
    SumObjective,
    best_rotation,
    checked_target,
    polar_rotation,
    require_determined,
    require_objective,
    weighted_areas,
)
from toros_fem.meshes.pattern import Mirrored, Pattern
from toros_fem.meshes.skin import Skin

# A body is slender if it is this many times longer than wide; so many cross-sections are compared.
SLENDER, SECTIONS = 1.8, 12
# Vertices this near to an end, over the length, lie in it; a flat end has so many on its border.
END, LEAST_OF_RING = 1e-9, 6
# A body whose centre line stays this near to a line, over the length, has no plane of its bend.
STRAIGHT = 1e-3
# Names and units of the figures of a shape. Two of them decide whether it is reached.
DISTANCE, DIRECTION = ("shape_distance", "percent"), ("tip_direction", "deg")
SHAPE_FIGURES = (
    DISTANCE,
    DIRECTION,
    ("shape_distance", "mm"),
    ("largest_distance", "mm"),
    ("tip_distance", "mm"),
    ("tip_direction_in_plane", "deg"),
    ("tip_direction_out_of_plane", "deg"),
)


@dataclass(frozen=True, eq=False)
class Tip:
    """The far end of a slender body, and where it should be.

    Attributes:
        at, asked: Its centre, and that of the target, (3,), in m.
        along, asked_along: Unit vectors along the body there, (3,).
        in_plane: Angle in rad from the target's direction to this one in the plane of the target's
            bend, positive where it bends more; None for a straight target.
        lean: The angle out of that plane in rad; None for a straight target.
    """

    at: Floats
    asked: Floats
    along: Floats
    asked_along: Floats
    in_plane: float | None
    lean: float | None

    @property
    def distance(self) -> float:
        """Distance of the centres in m."""
        return float(np.linalg.norm(self.at - self.asked))

    @property
    def direction(self) -> float:
        """Angle between the directions in rad."""
        across = np.linalg.norm(np.cross(self.along, self.asked_along))
        return float(np.arctan2(across, self.along @ self.asked_along))


@dataclass(frozen=True, eq=False)
class Miss:
    """How far a shape is from its target.

    Attributes:
        asked: Target positions of all vertices, (n, 3), in m, moved with the shape along axes that
            do not count.
        each: Distance of each vertex from these, (n,), in m.
        rms, largest: Root mean square and largest distance in m: of the centres of 12
            cross-sections along a slender body, which may swell freely, and of its tip; else of
            all points, by their area.
        length: Largest extent of the assembled skin in m.
        tip: The far end of a slender body; None of another.
    """

    asked: Floats
    each: Floats
    rms: float
    largest: float
    length: float
    tip: Tip | None

    @property
    def by_sections(self) -> bool:
        """Whether cross-sections are compared."""
        return self.tip is not None

    def values(self) -> dict[str, float]:
        """Return the values of the figures of the shape, by key."""
        tip = self.tip
        found = {
            "shape_distance_percent": 100 * self.rms / self.length,
            "tip_direction_deg": None if tip is None else np.degrees(tip.direction),
            "shape_distance_mm": 1e3 * self.rms,
            "largest_distance_mm": 1e3 * self.largest,
            "tip_distance_mm": None if tip is None else 1e3 * tip.distance,
        }
        if tip is not None and tip.in_plane is not None and tip.lean is not None:
            found["tip_direction_in_plane_deg"] = np.degrees(tip.in_plane)
            found["tip_direction_out_of_plane_deg"] = np.degrees(tip.lean)
        return {key: float(value) for key, value in found.items() if value is not None}


def compared_axes(objective: Objective) -> tuple[bool, bool, bool]:
    """Return whether an objective compares positions with the target along x, y and z."""
    if isinstance(objective, AlignedObjective | MirroredObjective):
        return compared_axes(objective.objective)
    if isinstance(objective, SumObjective):
        found = np.any([compared_axes(part) for part in objective.parts], axis=0)
    elif isinstance(objective, ShapeObjective | CrossSectionObjective):
        found = objective.compared
    else:
        return False, False, False
    x, y, z = (bool(one) for one in found)
    return x, y, z


def is_aligned(objective: Objective) -> bool:
    """Return whether an objective compares positions after a rigid motion onto the target.

    A sum does where all of its parts do that compare positions.
    """
    if isinstance(objective, MirroredObjective):
        return is_aligned(objective.objective)
    if isinstance(objective, SumObjective):
        compared = [part for part in objective.parts if any(compared_axes(part))]
        return bool(compared) and all(map(is_aligned, compared))
    return isinstance(objective, AlignedObjective)


def placed_on(pattern: Pattern, positions: Floats, target: Floats) -> Floats:
    """Return positions of all vertices, (n, 3), in m, after the best rigid motion onto a target."""
    weights = pattern.vertex_areas / pattern.vertex_areas.sum()
    centre, goal = weights @ positions, weights @ target
    moment = ((target - goal) * weights[:, None]).T @ (positions - centre)
    rotation, _ = polar_rotation(moment)
    return np.asarray((positions - centre) @ rotation.T + goal)


def shape_figures(
    values: Mapping[str, float],
    intervals: Mapping[str, float] | None = None,
    tolerances: Tolerances = DEFAULT,
) -> tuple[Figure, ...]:
    """Return the figures of a shape, of values and half-widths of intervals by `Miss.values`' keys.

    Their targets are 0. The root mean square distance over the length and the direction of the tip
    have a tolerance: they decide. The others tell more. The names of further poses come before
    their keys.
    """
    known = {DISTANCE: 100 * tolerances.shape, DIRECTION: tolerances.direction}
    first = "_".join(SHAPE_FIGURES[0])
    prefixes = [key.removesuffix(first) for key in values if key.endswith(first)]
    widths = intervals or {}
    return tuple(
        Figure(f"{before}{name}", unit, values[key], widths.get(key), 0.0, known.get((name, unit)))
        for before in prefixes
        for name, unit in SHAPE_FIGURES
        if (key := f"{before}{name}_{unit}") in values
    )


def is_of_shape(figure: Figure) -> bool:
    """Return whether a figure is one of a shape."""
    return any(figure.key.endswith("_".join(one)) for one in SHAPE_FIGURES)


def miss_of(
    pattern: Pattern,
    positions: Floats,
    target: Floats,
    compared: tuple[bool, bool, bool] = (True, True, True),
) -> Miss:
    """Return how far positions of all vertices, (n, 3) in m, are from their target.

    `compared` tells whether distances along x, y and z count. Along others the target moves with
    the shape: a skin that is to twist may lengthen.
    """
    axis, sections = _of_slender(pattern)
    length, areas = float(np.ptp(pattern.points[:, axis])), pattern.vertex_areas
    if len(sections) < 2:
        away = (positions - target) * compared
        each = np.linalg.norm(away, axis=1)
        rms = float(np.sqrt(areas @ each**2 / areas.sum()))
        asked = np.where(compared, target, positions)
        return Miss(asked, each, rms, float(each.max()), length, None)

    def centres(points: Floats) -> Floats:
        return _centres(pattern, sections, points)

    drift = (centres(positions) - centres(target)) * ~np.asarray(compared)
    asked = target + _smooth(pattern, axis, sections, drift)
    gaps = np.linalg.norm(centres(positions) - centres(asked), axis=1)
    each = np.linalg.norm(positions - asked, axis=1)
    tip = _tip(pattern, positions, asked, axis, centres(asked), sections[-1])
    rms, largest = float(np.sqrt((gaps**2).mean())), max(float(gaps.max()), tip.distance)
    return Miss(asked, each, rms, largest, length, tip)


def way_of_sections(pattern: Pattern, positions: Floats, target: Floats) -> Floats:
    """Return the way to a target of the centres of cross-sections, at all vertices, (n, 3), in m.

    It is 0 of a body that is not slender. Positions are those of all vertices, (n, 3), in m.
    """
    axis, sections = _of_slender(pattern)
    if len(sections) < 2:
        return np.zeros_like(positions)
    return _smooth(pattern, axis, sections, _centres(pattern, sections, target - positions))


def _of_slender(pattern: Pattern) -> tuple[int, list[Ints]]:
    """Return the axis of a body and its cross-sections; without a slender one there are none."""
    extents = np.ptp(pattern.points, axis=0)
    axis = int(np.argmax(extents))
    slender = extents[axis] > SLENDER * np.sort(extents)[1]
    return axis, _sections(pattern, axis) if slender else []


def _centres(pattern: Pattern, sections: list[Ints], points: Floats) -> Floats:
    areas = pattern.vertex_areas
    return np.array([areas[one] @ points[one] / areas[one].sum() for one in sections])


def _smooth(pattern: Pattern, axis: int, sections: list[Ints], ways: Floats) -> Floats:
    """Return ways of the centres of cross-sections, (k, 3), at all vertices, (n, 3)."""
    at = _centres(pattern, sections, pattern.points)[:, axis]
    height = pattern.points[:, axis]
    return np.stack([_along(height, at, values) for values in ways.T], axis=1)


def _sections(pattern: Pattern, axis: int) -> list[Ints]:
    """Return the vertices of the cross-sections along an axis, without the walls of the ends."""
    wall = np.unique(pattern.triangles[~_in_ends(pattern, axis).all(axis=1)])
    return section_vertices(
        label_cross_sections(pattern, wall, np.eye(3)[axis], SECTIONS, border=False)
    )


def _in_ends(pattern: Pattern, axis: int) -> Bools:
    """Return whether each corner of each triangle, (t, 3), lies in one end of the body."""
    height = pattern.points[:, axis]
    room = END * float(np.ptp(height))
    ends = height < height.min() + room, height > height.max() - room
    corners = [end[pattern.triangles] for end in ends]
    return np.where(corners[0].all(axis=1, keepdims=True), corners[0], corners[1])


def _along(height: Floats, at: Floats, values: Floats) -> Floats:
    """Return values between those at some heights, and on straight lines beyond them."""
    found = np.interp(height, at, values)
    for beyond, k, j in ((height < at[0], 0, 1), (height > at[-1], -1, -2)):
        slope = (values[k] - values[j]) / (at[k] - at[j])
        found = np.where(beyond, values[k] + slope * (height - at[k]), found)
    return found


def _tip(
    pattern: Pattern, positions: Floats, asked: Floats, axis: int, line: Floats, last: Ints
) -> Tip:
    """Return the far end of a slender body: the border of a flat end, else the last section.

    `line` are the centres of the target's cross-sections, (12, 3), in m.
    """
    height, along = pattern.points[:, axis], np.eye(3)[axis]
    end = height[last] > height.max() - END * float(np.ptp(height))
    ring = last[end] if end.sum() >= LEAST_OF_RING else last
    areas = pattern.vertex_areas[ring]
    at, goal = (areas @ points[ring] / areas.sum() for points in (positions, asked))
    n, m = (
        best_rotation(pattern.points[ring], points[ring]) @ along for points in (positions, asked)
    )
    # The plane of the target's bend holds the body's axis at rest and the middle of its target.
    line = np.vstack([line, goal])
    side = line - line[0]
    side -= np.outer(side @ along, along)
    far = side[np.argmax(np.linalg.norm(side, axis=1))]
    width = float(np.linalg.norm(far))
    if width < STRAIGHT * float(np.ptp(height)):
        return Tip(at, goal, n, m, None, None)
    toward = far / width
    across = np.cross(along, toward)

    def turned(direction: Floats) -> float:
        return float(np.arctan2(direction @ toward, direction @ along))

    in_plane = (turned(n) - turned(m) + np.pi) % (2 * np.pi) - np.pi
    lean = float(np.arcsin(np.clip(n @ across, -1, 1)) - np.arcsin(np.clip(m @ across, -1, 1)))
    return Tip(at, goal, n, m, in_plane, lean)


# --------------------------------------------------------------------- objectives behind a motion


class AlignedObjective:
    """Objective of the skin after a rigid motion onto the target: T(R(x − x̄) + x̄*).

    R and the means minimise the sum of squares (Kabsch 1976), in which each vertex counts by its
    flat area, times its weight, (n,). Their dependence on x is part of the gradient, so that T may
    be any objective. A skin or target on a line, whose best rotation is not unique, is a
    ParameterError on use.

    Attributes:
        objective: T, as it is evaluated after the motion.
    """

    def __init__(
        self, skin: Nodes, target: Floats, objective: Objective, weights: Floats | None = None
    ) -> None:
        target = checked_target(skin, target)
        require_objective("objective", objective)
        weight = weighted_areas(skin, "weights", weights, 1.0)[:, 0]
        weight, owned = weight / weight.sum(), skin.owned_vertices
        self._comm, self.objective = skin.comm, objective
        self._centre = weight @ target
        self._target = target[owned] - self._centre
        self._weight = weight[owned, None]

    def forward(self, positions: Floats) -> float:
        """Return T at positions of the owned nodes, (n, 3) (collective)."""
        return self.objective.forward(self.aligned(positions))

    def aligned(self, positions: Floats) -> Floats:
        """Return the positions moved rigidly onto the target, (n, 3) (collective)."""
        arm, rotation, _ = self._fit(positions)
        return np.asarray(arm @ rotation.T + self._centre)

    def backward(self, positions: Floats) -> Floats:
        """Return ∂T/∂x at the owned nodes, (n, 3), in 1/m (collective)."""
        arm, rotation, matrix = self._fit(positions)
        aligned = arm @ rotation.T + self._centre
        by_arm = self.objective.backward(aligned) @ rotation
        torque = sum_over_ranks(self._comm, np.cross(arm, by_arm).sum(axis=0))
        reach = np.linalg.solve(matrix, torque)
        by_arm += self._weight * np.cross(self._target @ rotation, reach)
        return np.asarray(by_arm - self._weight * sum_over_ranks(self._comm, by_arm.sum(axis=0)))

    def _fit(self, positions: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the arms from the mean, (n, 3), the rotation, and B of `polar_rotation`."""
        mean = sum_over_ranks(self._comm, (self._weight * positions).sum(axis=0))
        arm = positions - mean
        moment = sum_over_ranks(self._comm, (self._weight * self._target).T @ arm)
        rotation, matrix = polar_rotation(moment)
        require_determined(matrix[None], ["the skin"], "Do not align.")
        return arm, rotation, matrix


@dataclass(frozen=True, eq=False)
class ImageNodes:
    """Vertices of a whole skin, each on the rank that owns the vertex it is an image of."""

    pattern: Pattern
    comm: MPI.Comm
    owned_vertices: Ints


class MirroredObjective:
    """Objective T of the whole skin at the positions of a part and its mirror images.

    T is the same number as on the whole skin, to rounding. ∂T/∂x at a vertex of the part is the sum
    over its images, each mirrored back: all of them move together. `objective` makes T from the
    nodes of the whole; arrays by vertex are in the order of `whole.pattern.points`.

    Attributes:
        objective: T, as it is evaluated on the whole.
    """

    def __init__(
        self, skin: Skin, whole: Mirrored, objective: Callable[[Nodes], Objective]
    ) -> None:
        place = np.full(len(skin.pattern.points), -1)
        place[skin.owned_vertices] = np.arange(len(skin.owned_vertices))
        node = place[whole.vertex]
        here = np.flatnonzero(node >= 0)
        self._node, self._signs = node[here], whole.signs[here]
        self.objective = objective(ImageNodes(whole.pattern, skin.comm, here))

    def forward(self, positions: Floats) -> float:
        """Return T at positions of the part's owned nodes, (n, 3) (collective)."""
        return self.objective.forward(self._signs * positions[self._node])

    def backward(self, positions: Floats) -> Floats:
        """Return ∂T/∂x at the part's owned nodes, (n, 3), in 1/m (collective)."""
        by_image = self._signs * self.objective.backward(self._signs * positions[self._node])
        count = len(positions)
        sums = [np.bincount(self._node, column, minlength=count) for column in by_image.T]
        return np.stack(sums, axis=1)
