"""Seams as lines on both panels, from the vertices that are sewn together."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.validation import require_kind
from toros_fem.meshes.pattern import Pattern

Pair = tuple[int, int]


@dataclass(frozen=True, eq=False)
class SewnSeam:
    """A seam: two lines of flat points, vertex by vertex sewn together.

    The first line runs counter-clockwise along its panel, the second clockwise along its own.

    Attributes:
        number: Number of the seam, from 1.
        panels: Numbers of both panels; equal where a panel is sewn to itself.
        lines: Flat points of both lines, (2, n, 2), in m.
        closed: Whether the seam ends where it starts, on both panels.
    """

    number: int
    panels: tuple[int, int]
    lines: Floats
    closed: bool

    @property
    def arc(self) -> Floats:
        """Arc length at each vertex in m, (n,): the mean of both sides, so the same for both."""
        steps = np.linalg.norm(np.diff(self.lines, axis=1), axis=2).mean(axis=0)
        return np.concatenate([[0.0], np.cumsum(steps)])

    @property
    def length(self) -> float:
        """Length in m."""
        return float(self.arc[-1])

    def at(self, side: int, arc: Floats) -> Floats:
        """Return the points of one side at arc lengths (k,) in m, (k, 2)."""
        x, y = (np.interp(arc, self.arc, self.lines[side, :, axis]) for axis in (0, 1))
        return np.column_stack([x, y])

    def outward(self, side: int, arc: Floats, reach: float) -> Floats:
        """Return unit vectors across one side, out of its panel, at arc lengths (k,), (k, 2).

        Args:
            side: 0 or 1.
            arc: Arc lengths in m.
            reach: Length in m over which the direction of the line is taken, so that steps of the
                mesh do not turn it.
        """
        begin, end = np.maximum(arc - reach / 2, 0), np.minimum(arc + reach / 2, self.length)
        along = self.at(side, end) - self.at(side, begin)
        # A panel lies on the left of the first line, and on the right of the second.
        normal = np.column_stack([along[:, 1], -along[:, 0]]) * (1.0 if side == 0 else -1.0)
        return np.asarray(normal / np.linalg.norm(normal, axis=1)[:, None])


def sewn_seams(pattern: Pattern) -> list[SewnSeam]:
    """Return the seams of a pattern, numbered from 1 by their panels.

    A seam ends where other seams or a free border meet it, or at the tip of a dart. One that closes
    on itself starts at its lowest point on the first panel.

    Args:
        pattern: A pattern of flat panels.

    Raises:
        ParameterError: The pattern is something else.
        PatternError: The skin is moulded.
    """
    require_kind("pattern", pattern, Pattern, "a Pattern, by meshes.cylinder for instance")
    pattern.require_flat_panels("a seam line")
    point_panel = np.zeros(len(pattern.flat_points), dtype=np.int64)
    point_panel[pattern.flat_triangles] = pattern.panel[:, None]
    found = []
    for chain in _chains(pattern):
        one, two = chain[:, 0], chain[:, 1]
        panels = int(point_panel[one[0]]), int(point_panel[two[0]])
        centre = pattern.flat_points[chain].mean(axis=0)
        if (panels[0], *centre[0]) > (panels[1], *centre[1]):
            one, two, panels = two[::-1], one[::-1], panels[::-1]
        closed = bool(one[0] == one[-1] and two[0] == two[-1])
        if closed:
            x, y = pattern.flat_points[one[:-1]].T
            turn = int(np.lexsort([x, y.round(9)])[0])
            one, two = (np.append(np.roll(ring[:-1], -turn), ring[turn]) for ring in (one, two))
        lines = pattern.flat_points[np.stack([one, two])]
        found.append((panels, tuple(lines.mean(axis=(0, 1)).round(9)), lines, closed))
    found.sort(key=lambda seam: seam[:2])
    return [
        SewnSeam(number, panels, lines, closed)
        for number, (panels, _, lines, closed) in enumerate(found, 1)
    ]


def _chains(pattern: Pattern) -> list[Ints]:
    """Return runs of seam edges as pairs of flat points, (n, 2) each.

    The first point of each pair runs counter-clockwise along its panel.
    """
    # Both ends of each sewn edge as pairs of flat points; the first side is counter-clockwise.
    seams: list[list[Pair]] = [
        [(int(one), int(two)) for one, two in edge.T] for edge in pattern.seams
    ]
    at: dict[int, list[int]] = defaultdict(list)
    for edge, ends in enumerate(seams):
        for point, _ in ends:
            at[int(pattern.sewn[point])].append(edge)
    free = {int(vertex) for vertex in pattern.free_edges.ravel()}
    left = set(range(len(seams)))

    def onward(edge: int, head: Pair) -> tuple[int, Pair] | None:
        """Return the next edge of a seam, and its far end, as a pair of flat points."""
        vertex = int(pattern.sewn[head[0]])
        if vertex in free or len(at[vertex]) != 2:
            return None
        other = at[vertex][0] if at[vertex][1] == edge else at[vertex][1]
        if other not in left:
            return None
        for near, far in (seams[other], seams[other][::-1]):
            if near == head:
                return other, far
            if near == head[::-1]:
                return other, (far[1], far[0])
        return None

    chains = []
    for start in range(len(seams)):
        if start not in left:
            continue
        left.discard(start)
        pairs = list(seams[start])
        for forward in (True, False):
            edge = start
            while (step := onward(edge, pairs[-1] if forward else pairs[0])) is not None:
                edge, pair = step
                left.discard(edge)
                pairs.insert(len(pairs) if forward else 0, pair)
        chains.append(np.array(pairs))
    return chains
