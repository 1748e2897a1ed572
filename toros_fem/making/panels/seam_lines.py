"""Seams as lines on both panels, from the vertices that are sewn together."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.validation import require_kind
from toros_fem.meshes.pattern import Pattern


@dataclass(frozen=True, eq=False)
class SewnSeam:
    """A seam: two lines of flat points, vertex by vertex sewn together.

    The first line runs counter-clockwise along its panel, the second clockwise along its own.

    Attributes:
        number: Number of the seam, from 1.
        panels: Numbers of both panels; equal where a panel is sewn to itself.
        lines: Flat points of both lines, (2, n, 2), in m.
    """

    number: int
    panels: tuple[int, int]
    lines: Floats

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
        """Return unit vectors across one side, out of its panel, at arc lengths (k,) in m, (k, 2).

        The direction of the line is taken over a reach in m: steps of the mesh do not turn it.
        """
        begin, end = np.maximum(arc - reach / 2, 0), np.minimum(arc + reach / 2, self.length)
        along = self.at(side, end) - self.at(side, begin)
        # A panel lies on the left of the first line, and on the right of the second.
        normal = np.column_stack([along[:, 1], -along[:, 0]]) * (1.0 if side == 0 else -1.0)
        return np.asarray(normal / np.linalg.norm(normal, axis=1)[:, None])


def sewn_seams(pattern: Pattern) -> list[SewnSeam]:
    """Return the seams of a pattern of flat panels, numbered from 1 by their panels.

    A seam ends where other seams or a free border meet it, or at the tip of a dart. One that closes
    on itself starts at its lowest point on the first panel.

    Raises:
        ParameterError: The pattern is something else.
        PatternError: The skin is moulded.
    """
    require_kind("pattern", pattern, Pattern, "a Pattern, by meshes.cylinder for instance")
    pattern.require_flat_panels("a seam line")
    point_panel, found = pattern.panel_of_point, []
    for chain in _chains(pattern):
        one, two = chain.T
        panels = int(point_panel[one[0]]), int(point_panel[two[0]])
        centre = pattern.flat_points[chain].mean(axis=0)
        if (panels[0], *centre[0]) > (panels[1], *centre[1]):
            one, two, panels = two[::-1], one[::-1], panels[::-1]
        if one[0] == one[-1] and two[0] == two[-1]:
            x, y = pattern.flat_points[one[:-1]].T
            turn = int(np.lexsort([x, y.round(9)])[0])
            one, two = (np.append(np.roll(ring[:-1], -turn), ring[turn]) for ring in (one, two))
        lines = pattern.flat_points[np.stack([one, two])]
        found.append((panels, tuple(lines.mean(axis=(0, 1)).round(9)), lines))
    found.sort(key=lambda seam: seam[:2])
    return [SewnSeam(number, panels, lines) for number, (panels, _, lines) in enumerate(found, 1)]


def edges_of(seams: Sequence[SewnSeam], panel: int) -> list[tuple[SewnSeam, int]]:
    """Return the seams of a panel, with the side of each that it is."""
    return [(seam, side) for seam in seams for side in (0, 1) if seam.panels[side] == panel]


def _chains(pattern: Pattern) -> list[Ints]:
    """Return runs of seam edges as pairs of flat points, (n, 2), the first counter-clockwise."""
    edges = np.swapaxes(pattern.seams, 1, 2)  # by edge, end and side
    vertex = pattern.sewn[edges[..., 0]]
    passed = np.bincount(vertex.ravel(), minlength=len(pattern.points)) == 2
    passed[pattern.free_edges] = False
    joints: dict[frozenset[int], list[tuple[int, int]]] = defaultdict(list)
    for edge, end in zip(*np.nonzero(passed[vertex]), strict=True):
        joints[frozenset(edges[edge, end].tolist())].append((int(edge), int(end)))
    left = set(range(len(edges)))

    def run(edge: int, end: int) -> list[Ints]:
        """Return the pairs from the end of an edge on, as far as its seam goes."""
        pairs = [edges[edge, end]]
        while True:
            joint = joints[frozenset(pairs[-1].tolist())]
            onward = [(other, near) for other, near in joint if other in left]
            if not onward:
                return pairs
            edge, near = onward[0]
            left.discard(edge)
            far = edges[edge, 1 - near]
            pairs.append(far if edges[edge, near, 0] == pairs[-1][0] else far[::-1])

    chains = []
    for start in range(len(edges)):
        if start in left:
            left.discard(start)
            forward = run(start, 1)
            chains.append(np.array(run(start, 0)[::-1] + forward))
    return chains
