"""Centre lines of stripes: level lines of the phase, from triangle to triangle across seams."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csc_array, csr_array, diags_array
from scipy.sparse.linalg import splu

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.design.lines.stripes import Stripes
from toros_fem.design.lines.transport import LineMesh
from toros_fem.meshes.triangles import chart_turns, following

# Steps shorter than this fraction of an edge count as that long.
SHORT = 1e-5
# Crossings keep away from the ends of edges by this fraction.
EDGE = 1e-4


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


@dataclass(frozen=True, eq=False)
class _Chain:
    """Crossings along a line, and the triangles between them."""

    nodes: Ints
    cells: Ints

    @property
    def closed(self) -> bool:
        return bool(self.nodes[0] == self.nodes[-1])


def trace(
    mesh: LineMesh, stripes: Stripes, present: Bools, stiffness: float | None = None
) -> list[CentreLine]:
    """Return the lines where the phase is a multiple of 2π.

    A line crosses edges; in each triangle its crossings are linked around the corners. Where the
    turns of the phase around a triangle do not add up to 0 some crossings stay without a partner:
    there lines end, and their neighbours bend towards the gap. A stiffness evens this out: the
    crossings move along their edges to the least of ∫ (shift² + stiffness⁴ curvature²).

    Args:
        mesh: The line mesh.
        stripes: The phase.
        present: Whether there are lines at each edge, (e,).
        stiffness: Distance in m below which lines do not wind; None for level lines as they are.
    """
    edge, fraction, first, count = _crossings(mesh, stripes, present)
    one, two, cell = _links(mesh, first, count)
    chains = _chained(len(edge), one, two, cell)
    if stiffness is not None and chains:
        fraction = _stiffened(mesh, edge, fraction, chains, stiffness)
    places = _places(mesh, edge, fraction)
    lines = []
    for chain in chains:
        points = [
            places[nodes, _sides(mesh, edge[nodes], chain.cells)]
            for nodes in (chain.nodes[:-1], chain.nodes[1:])
        ]
        lines.append(CentreLine(chain.cells, np.stack(points, axis=1), chain.closed))
    return lines


def _sides(mesh: LineMesh, edge: Ints, cell: Ints) -> Ints:
    """Return which side of edges triangles are on, 0 or 1."""
    return np.where(mesh.edges.sides[edge, 0] == cell, 0, 1)


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


def _chained(count: int, one: Ints, two: Ints, cell: Ints) -> list[_Chain]:
    """Return chains of linked crossings; those with ends come first."""
    near: list[list[int]] = [[] for _ in range(count)]
    pairs = np.stack([one, two], axis=1)
    for link, ends in enumerate(pairs):
        for end in ends:
            near[int(end)].append(link)
    done = np.zeros(len(one), dtype=bool)
    chains = []
    ends_first = [k for k, links in enumerate(near) if len(links) == 1]
    for start in [*ends_first, *range(count)]:
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
        if links:
            chains.append(_Chain(np.array(nodes), cell[links]))
    return chains


def _stiffened(
    mesh: LineMesh, edge: Ints, fraction: Floats, chains: list[_Chain], stiffness: float
) -> Floats:
    """Return the fractions at which lines of some stiffness cross the edges.

    No crossing moves further than half way to the next one on its edge.
    """
    places = _places(mesh, edge, fraction)
    step = _places(mesh, edge, np.ones(len(edge))) - _places(mesh, edge, np.zeros(len(edge)))
    size = np.linalg.norm(step[:, 0], axis=1)
    turn = chart_turns(mesh.corners, mesh.edges)[edge]
    # Each crossing with those before and after it, and the triangles between.
    before, here, after, back, ahead = (
        np.concatenate(part) for part in zip(*map(_threes, chains), strict=True)
    )
    at_before, at_back = (_sides(mesh, edge[k], back) for k in (before, here))
    at_ahead, at_after = (_sides(mesh, edge[k], ahead) for k in (here, after))
    one = places[here, at_back] - places[before, at_before]
    two = places[after, at_after] - places[here, at_ahead]
    # The chart ahead turned to the one behind.
    angle = np.where(at_back == 0, -turn[here], turn[here])
    c, s = np.cos(angle), np.sin(angle)
    turns = np.stack([np.stack([c, -s], axis=1), np.stack([s, c], axis=1)], axis=1)
    least = SHORT * size[here]
    h_one, h_two = (np.maximum(np.linalg.norm(v, axis=1), least) for v in (one, two))
    mean = (h_one + h_two) / 2
    two = np.einsum("kij,kj->ki", turns, two)
    # Bending is across the line: along it, crossings may come nearer to each other.
    way = one + two
    across = np.stack([-way[:, 1], way[:, 0]], axis=1)
    across /= np.maximum(np.linalg.norm(way, axis=1), least)[:, None]
    over = np.einsum("ki,kij->kj", across, turns)
    bend = np.einsum("ki,ki->k", across, two / h_two[:, None] - one / h_one[:, None])
    back_step = np.einsum("ki,ki->k", across, step[here, at_back]) / h_one
    ahead_step = np.einsum("ki,ki->k", over, step[here, at_ahead]) / h_two
    parts = [
        (before, np.einsum("ki,ki->k", across, step[before, at_before]) / h_one),
        (here, -back_step - ahead_step),
        (after, np.einsum("ki,ki->k", over, step[after, at_after]) / h_two),
    ]
    count = len(here)
    columns = np.concatenate([node for node, _ in parts])
    values = np.concatenate([value for _, value in parts])
    place = np.tile(np.arange(count), 3), columns
    matrix = csr_array(coo_array((values, place), shape=(count, len(edge))))
    heavy = stiffness**4 / mean
    weight = np.bincount(here, mean, minlength=len(edge))
    weight = np.maximum(weight, SHORT * size) * size**2
    normal = matrix.T @ diags_array(heavy) @ matrix + diags_array(weight)
    shift = -splu(csc_array(normal)).solve(matrix.T @ (heavy * bend))
    same = edge[1:] == edge[:-1]
    middle = (fraction[1:] + fraction[:-1]) / 2
    low = np.concatenate([[EDGE], np.where(same, middle, EDGE)])
    high = np.concatenate([np.where(same, middle, 1 - EDGE), [1 - EDGE]])
    return np.clip(fraction + shift, np.minimum(low, fraction), np.maximum(high, fraction))


def _threes(chain: _Chain) -> tuple[Ints, Ints, Ints, Ints, Ints]:
    """Return crossings before, at and after each inner crossing; triangles before and after it."""
    nodes, cells = chain.nodes, chain.cells
    if chain.closed:
        nodes, cells = np.append(nodes, nodes[1]), np.append(cells, cells[0])
    return nodes[:-2], nodes[1:-1], nodes[2:], cells[:-1], cells[1:]
