"""Centre lines of stripes: level lines of the phase, from triangle to triangle across seams."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from toros_fem._types import Bools, Floats, Ints
from toros_fem.meshes.topology import following
from toros_fem.relaxed.stripes import Stripes
from toros_fem.relaxed.transport import LineMesh


@dataclass(frozen=True, eq=False)
class CentreLine:
    """A line as segments through triangles, each in the chart of its triangle.

    A segment starts where the one before ends: at the same place of the sewn skin.

    Attributes:
        cell: Triangle of each segment, (m,).
        points: Start and end of each segment on the flat panel, (m, 2, 2), in m.
        closed: Whether the last segment ends where the first begins.
        ends: What start and end lie at: "line", "border", "printed" (a printed triangle) or
            "plane" (of symmetry); None where it is not known, or the line is closed.
    """

    cell: Ints
    points: Floats
    closed: bool
    ends: tuple[str, str] | None = None

    @property
    def length(self) -> float:
        """Length in m."""
        return float(np.linalg.norm(self.points[:, 1] - self.points[:, 0], axis=1).sum())


def trace(mesh: LineMesh, stripes: Stripes, present: Bools) -> list[CentreLine]:
    """Return the lines where the phase is a multiple of 2π.

    A line crosses edges; in each triangle its crossings are linked around the corners. Where the
    turns of the phase around a triangle do not add up to 0 some crossings stay without a partner:
    there lines end.

    Args:
        mesh: The line mesh.
        stripes: The phase.
        present: Whether there are lines at each edge, (e,).
    """
    edge, fraction, first, count = _crossings(mesh, stripes, present)
    one, two, cell = _links(mesh, first, count)
    places = _places(mesh, edge, fraction)
    return _chained(mesh, edge, one, two, cell, places)


def _crossings(mesh: LineMesh, stripes: Stripes, present: Bools) -> tuple[Ints, Floats, Ints, Ints]:
    """Return the edge of each crossing and the fraction along it from the edge's first end.

    Crossings of an edge follow each other; also its first crossing and their number, (e,).
    """
    begin = stripes.phase[mesh.edges.ends[:, 0]] / (2 * np.pi)
    end = begin + stripes.change / (2 * np.pi)
    low, high = np.floor(np.minimum(begin, end)), np.floor(np.maximum(begin, end))
    count = np.where(present, high - low, 0).astype(np.int64)
    first = np.cumsum(count) - count
    edge = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(edge)) - first[edge]
    upwards = (end > begin)[edge]
    level = np.where(upwards, low[edge] + 1 + number, high[edge] - number)
    fraction = (level - begin[edge]) / (end - begin)[edge]
    return edge, np.clip(fraction, 0.0, 1.0), first, count


def _links(mesh: LineMesh, first: Ints, count: Ints) -> tuple[Ints, Ints, Ints]:
    """Return pairs of crossings that are linked in a triangle, and the triangle.

    With a, b and c crossings on its sides, (a + b − c)/2 lines go around the corner between the
    first two (as for normal curves). If one side has more than the other two together, all of
    theirs end on it, and the rest of its own are ends.
    """
    edges = mesh.edges
    n = count[edges.of_triangle]  # of the side c … c + 1
    before = np.roll(n, 1, axis=1)  # of the side c − 1 … c
    opposite = np.roll(n, -1, axis=1)
    around = np.clip((n + before - opposite) // 2, 0, np.minimum(n, before))
    cell, corner = np.nonzero(around)
    number = around[cell, corner]
    cell, corner = np.repeat(cell, number), np.repeat(corner, number)
    k = np.arange(len(cell)) - np.repeat(np.cumsum(number) - number, number)
    start = mesh.vertex[cell, corner]
    sides = []
    for side in (corner, (corner + 2) % 3):
        edge = edges.of_triangle[cell, side]
        # The k-th crossing counted from the corner.
        forward = edges.ends[edge, 0] == start
        sides.append(first[edge] + np.where(forward, k, count[edge] - 1 - k))
    return sides[0], sides[1], cell


def _places(mesh: LineMesh, edge: Ints, fraction: Floats) -> Floats:
    """Return the flat place of each crossing in the charts of both triangles, (k, 2, 2)."""
    twins = mesh.edges.twins[edge]
    flat, vertex = mesh.corners.reshape(-1, 2), mesh.vertex.ravel()
    places = []
    for side in range(2):
        half = twins[:, side]
        begin, end = flat[half], flat[following(half)]
        forward = vertex[half] == mesh.edges.ends[edge, 0]
        at = np.where(forward, fraction, 1 - fraction)[:, None]
        places.append(begin + at * (end - begin))
    return np.stack(places, axis=1)


def _chained(
    mesh: LineMesh, edge: Ints, one: Ints, two: Ints, cell: Ints, places: Floats
) -> list[CentreLine]:
    """Return lines made of linked crossings, ordered by their first link."""
    near: list[list[int]] = [[] for _ in range(len(edge))]
    pairs = np.stack([one, two], axis=1)
    for link, ends in enumerate(pairs):
        for end in ends:
            near[int(end)].append(link)
    done = np.zeros(len(one), dtype=bool)
    lines = []
    ends_first = [k for k, links in enumerate(near) if len(links) == 1]
    for start in [*ends_first, *range(len(near))]:
        links, at = [], start
        nodes = [start]
        while True:
            following_links = [link for link in near[at] if not done[link]]
            if not following_links:
                break
            link = following_links[0]
            done[link] = True
            at = int(pairs[link].sum()) - at
            links.append(link)
            nodes.append(at)
        if not links:
            continue
        where = cell[links]
        points = np.empty((len(links), 2, 2))
        for k, node in enumerate((nodes[:-1], nodes[1:])):
            crossed = edge[node]
            side = np.where(mesh.edges.sides[crossed, 0] == where, 0, 1)
            points[:, k] = places[node, side]
        lines.append(CentreLine(where, points, nodes[0] == nodes[-1]))
    return lines
