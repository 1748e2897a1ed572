"""Centre lines of stripes: phases that follow directions and spacings, and their level lines."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csc_array, csr_array, diags_array
from scipy.sparse.linalg import SuperLU
from shapely.geometry.base import BaseGeometry

from toros_fem.base.validation import Bools, Floats, Ints
from toros_fem.design.lines.field import Complexes, LineMesh, coordinates
from toros_fem.meshes.triangles import following, gradients, linked, spd_factor

# Steps of the inverse iteration, and of the relaxation of vectors of unit length after it.
ITERATIONS = 12
RELAXATIONS = 40
# Steps of the relaxation from an earlier phase, few, so that it keeps its lines.
KEPT_RELAXATIONS = 5
# Shift of the matrix, relative to its mean diagonal: it is singular where all stripes fit.
SHIFT = 1e-8
# A phase this close to the middle of a line is moved off it: no line passes through a vertex.
NUDGE = 1e-7
# Distance over which a step of relaxation averages, in mean lengths of edges.
REACH = 3.0
# What an end of a line lies at; `PRINTED` is a printed triangle, `PLANE` one of symmetry.
OPEN, LINE, BORDER, PRINTED, PLANE = "open", "line", "border", "printed", "plane"
# Steps shorter than this fraction of an edge count as that long.
SHORT = 1e-5
# Crossings keep away from the ends of edges by this fraction.
EDGE = 1e-4
# A line by its crossings with edges, (m + 1,), and the triangles between them, (m,).
Chain = tuple[Ints, Ints]


@dataclass(frozen=True, eq=False)
class Waves:
    """What stripes are to follow.

    Attributes:
        mesh: The mesh.
        angle: Direction at each vertex in rad, in the chart of its first corner, (n,).
        number: Phase per m at each vertex, (n,).
    """

    mesh: LineMesh
    angle: Floats
    number: Floats

    @property
    def spacing(self) -> Floats:
        """Distance in m from line to line at each vertex, (n,)."""
        return np.asarray(2 * np.pi / self.number)

    def corner_angles(self) -> Floats:
        """Return the direction in the chart of each corner, (t, 3), in rad."""
        return self.angle[self.mesh.vertex] + self.mesh.turn

    def edge_changes(self) -> tuple[Floats, Bools]:
        """Return the wanted change along each edge, and whether both ends point the same way.

        Both triangles of an edge see the same change, but for a skin that is no surface of flat
        pieces around a vertex; there it is their mean.
        """
        mesh, count = self.mesh, len(self.mesh.edges.ends)
        of_edge = mesh.edges.of_triangle.ravel()
        along, here = mesh.sides.ravel(), self.corner_angles().ravel()
        number = self.number[mesh.vertex].ravel()
        end = following(np.arange(len(here)))
        same = np.bincount(of_edge, np.cos(here - here[end]), minlength=count) >= 0
        sign = np.where(same, 1.0, -1.0)[of_edge]
        # The phase grows to the left of the direction.
        change_here = number * (np.exp(-1j * here) * along).imag
        change_end = number[end] * (np.exp(-1j * here[end]) * along).imag
        change = (change_here + sign * change_end) / 2
        # In the orientation of the edge's first end, from there to the other.
        change = np.where(mesh.forward.ravel(), change, -sign * change)
        return np.bincount(of_edge, change, minlength=count) / mesh.edges.count, same


@dataclass(frozen=True, eq=False)
class Stripes:
    """A phase on a sewn skin, 0 in the middle of each line, 2π from one line to the next.

    Attributes:
        waves: What the stripes follow.
        phase: Phase at each vertex, (n,), which grows to the left of the direction.
        change: Change of the phase along each edge from its first end to its second, (e,), in the
            orientation of its first end. Where the second end's direction points the other way,
            the sum of both is minus its phase, modulo 2π.
        same: Whether the directions at both ends of each edge point the same way, (e,).
        wanted: The change that direction and spacing ask for, (e,).
    """

    waves: Waves
    phase: Floats
    change: Floats
    same: Bools
    wanted: Floats

    def line_ends(self, present: Bools) -> int:
        """Return how many lines end in triangles whose edges all have lines, (e,).

        There the phase around the triangle turns.
        """
        mesh = self.waves.mesh
        edge = mesh.edges.of_triangle
        flip = np.where(self.same, 1.0, -1.0)[edge]
        # In the orientation of the first corner: `sign` is that of the corner before each side.
        sign = np.cumprod(np.insert(flip, 0, 1.0, axis=1), axis=1)
        turn = (sign[:, :3] * np.where(mesh.forward, 1.0, -flip) * self.change[edge]).sum(axis=1)
        # Where directions turn by half a turn around the triangle, lines need not end.
        counted = present[edge].all(axis=1) & (sign[:, 3] > 0)
        return int(np.abs(np.round(turn[counted] / (2 * np.pi))).sum())


def find_stripes(
    waves: Waves,
    weight: Floats,
    symmetric: Callable[[Complexes], Complexes] | None = None,
    side: Floats | float = 1.0,
    like: Stripes | None = None,
) -> Stripes:
    """Return the stripes that fit directions and spacings best.

    A complex number z at each vertex has the phase as its argument. Its energy is
    Σ w |z_j − exp(i ω_ij) z_i|² over all edges, with z_j conjugated where the directions at i and j
    point opposite ways. The eigenvector of its least eigenvalue (Knöppel, Crane, Pinkall,
    Schröder 2015, eq. 9) is the start. Steps of diffusion, each scaled back to |z| = 1, then give
    all places the same say, and least squares with the whole turns that were found end it.

    Stripes count by a weight at each vertex, (n,), greater than 0. What `symmetric` does makes z
    symmetric; a phase of 0 but for rounding gets the sign `side`, (n,). Earlier stripes are the
    start instead of the eigenvector, so that no line comes or goes.
    """
    mesh = waves.mesh
    i, j = mesh.edges.ends.T
    wanted, same = waves.edge_changes()
    sign = np.where(same, 1.0, -1.0)
    stiff = mesh.weights * (weight[i] + weight[j]) / 2
    mass = mesh.vertex_areas * weight
    energy, both = _energy(mesh, wanted, sign, stiff), diags_array(np.repeat(mass, 2))
    size = energy.diagonal().sum() / both.diagonal().sum()

    def smoothed(factor: SuperLU, z: Complexes) -> Complexes:
        found: Complexes = factor.solve((mass * z).view(np.float64)).view(np.complex128)
        return found if symmetric is None else symmetric(found)

    if like is None:
        factor = spd_factor(energy + SHIFT * size * both)
        z: Complexes = np.exp(2j * np.pi * np.random.default_rng(0).random(mesh.size))
        # Parts of the skin without connection have an eigenvector each.
        part = linked(i, j, mesh.size)
        for _ in range(ITERATIONS):
            z = smoothed(factor, z)
            z /= np.sqrt(np.bincount(part, mass * np.abs(z) ** 2) / np.bincount(part, mass))[part]
    else:
        z = np.exp(1j * like.phase)
        z = np.where(np.cos(waves.angle - like.waves.angle) >= 0, z, np.conj(z))
    factor = spd_factor(both + REACH**2 / size * energy)
    for _ in range(RELAXATIONS if like is None else KEPT_RELAXATIONS):
        z = smoothed(factor, z / np.maximum(np.abs(z), np.finfo(float).tiny))
    phase = np.angle(z).astype(np.float64)
    turns = 2 * np.pi * np.round((sign * phase[j] - phase[i] - wanted) / (2 * np.pi))
    # The change of φ that makes Σ w (sign_ij φ_j − φ_i − turns_ij − ω_ij)² least.
    excess = stiff * (sign * phase[j] - phase[i] - turns - wanted)
    matrix = mesh.laplacian(stiff, sign)
    shift = SHIFT * matrix.diagonal().sum() / mass.sum()
    right = np.bincount(i, excess, mesh.size) - np.bincount(j, sign * excess, mesh.size)
    phase = phase + spd_factor(matrix + shift * diags_array(mass)).solve(right)
    rest = phase - 2 * np.pi * np.round(phase / (2 * np.pi))
    phase = phase + np.where(np.abs(rest) < NUDGE, NUDGE * side - rest, 0.0)
    return Stripes(waves, phase, sign * phase[j] - phase[i] - turns, same, wanted)


def _energy(mesh: LineMesh, wanted: Floats, sign: Floats, stiff: Floats) -> csc_array:
    """Return the matrix of the energy; unknowns are the real and imaginary parts in turn."""
    i, j = mesh.edges.ends.T
    c, s = np.cos(wanted), np.sin(wanted)
    # z_j = R z_i, where R turns by ω, and conjugates if the directions are opposite.
    turn = stiff * np.array([[c, -s], [sign * s, sign * c]])
    row, column = np.indices((2, 2, len(i)))[:2]
    place = (2 * j + row).ravel(), (2 * i + column).ravel()
    pull = coo_array((turn.ravel(), place), shape=(2 * mesh.size, 2 * mesh.size))
    return csc_array(diags_array(np.repeat(mesh.around(stiff), 2)) - (pull + pull.T))


def fitting_spacing(waves: Waves, weight: Floats, distance: float, spread: float) -> Waves:
    """Return waves whose spacing follows from line to line where directions spread or meet.

    Lines neither begin nor end where div(k d) = 0, with the direction d and 2π/k the spacing. The
    change u of log k is the least of ∫ (d·∇u + d·∇log k + div d)² + (u/distance)², with a weight
    (n,) > 0 at vertices. Spacings change by a factor of `spread` at most.
    """
    mesh = waves.mesh
    direction = np.exp(1j * waves.corner_angles())
    middle = np.sqrt((direction**2).mean(axis=1))
    # Of both directions at a corner, that which fits the middle's.
    direction *= np.where((direction * np.conj(middle)[:, None]).real >= 0, 1.0, -1.0)
    gradient = gradients(mesh.corners)
    diverging = np.einsum("tcx,tcx->t", gradient, coordinates(direction))
    slope = np.einsum("tcx,tx->tc", gradient, coordinates(middle / np.abs(middle)))
    place = np.repeat(np.arange(len(slope)), 3), mesh.vertex.ravel()
    matrix = csr_array((slope.ravel(), place), shape=(len(slope), mesh.size))
    wanted = -(diverging + matrix @ np.log(waves.number))
    heavy = diags_array(mesh.areas * weight[mesh.vertex].mean(axis=1))
    mass = diags_array(mesh.vertex_areas * weight / distance**2)
    change = spd_factor(matrix.T @ heavy @ matrix + mass).solve(matrix.T @ (heavy @ wanted))
    bound = np.log(spread)
    return Waves(mesh, waves.angle, waves.number * np.exp(bound * np.tanh(change / bound)))


@dataclass(frozen=True, eq=False)
class CentreLine:
    """A line as segments through triangles, each in the chart of its triangle.

    A segment starts where the one before ends: at the same place of the sewn skin.

    Attributes:
        cell: Triangle of each segment, in the order of the line mesh, (m,).
        places: Start and end of each segment on the flat panel, x + iy in m, (m, 2).
        ends: What start and end lie at: "line", "border", "printed" (a printed triangle), "plane"
            (of symmetry) or "open"; none if the last segment ends where the first begins.
    """

    cell: Ints
    places: Complexes
    ends: tuple[str, ...] = (OPEN, OPEN)

    @property
    def points(self) -> Floats:
        """Start and end of each segment on the flat panel in m, (m, 2, 2)."""
        return coordinates(self.places)

    @property
    def ways(self) -> Complexes:
        """The way from start to end of each segment in m, (m,)."""
        return np.asarray(self.places[:, 1] - self.places[:, 0])

    @property
    def closed(self) -> bool:
        """Whether the line is a ring."""
        return not self.ends

    @property
    def length(self) -> float:
        """Length in m."""
        return float(np.abs(self.ways).sum())

    @property
    def to_end(self) -> Floats:
        """Length in m from the start of each segment to the end of the line, (m,)."""
        return np.cumsum(np.abs(self.ways)[::-1])[::-1]

    @property
    def reversed(self) -> CentreLine:
        """The same line from its end to its start."""
        return CentreLine(self.cell[::-1], self.places[::-1, ::-1], self.ends[::-1])


@dataclass(frozen=True, eq=False)
class LinesOfFamily:
    """The lines of one family.

    Attributes:
        width: Width asked, in m.
        lines: Centre lines.
        angles: Direction at each corner of the mesh, (t, 3), in rad, modulo π.
        spacing: Distance from line to line at each vertex, (n,), in m.
        radius: Half the width at each vertex, (n,), in m.
        bounds: Least half width, and the largest one at each vertex, (n,), in m.
        share: Part of the area, without that printed before, that the field asks for.
        laid: Part of it that the lines cover.
        under: Region of each panel under them, before lines and gaps that are too thin are mended.
    """

    width: float
    lines: list[CentreLine]
    angles: Floats
    spacing: Floats
    radius: Floats
    bounds: tuple[float, Floats]
    share: float = 0.0
    laid: float = 0.0
    under: tuple[BaseGeometry, ...] = ()

    @property
    def length(self) -> float:
        """Total length of the lines in m."""
        return float(sum(line.length for line in self.lines))

    @property
    def ends(self) -> dict[str, int]:
        """How many ends lie at what."""
        return dict(sorted(Counter(kind for line in self.lines for kind in line.ends).items()))


def trace(stripes: Stripes, present: Bools, stiffness: float | None = None) -> list[CentreLine]:
    """Return the lines where the phase is a multiple of 2π.

    A line crosses edges; in each triangle its crossings are linked around the corners. Where the
    turns of the phase around a triangle do not add up to 0 some crossings stay without a partner:
    there lines end, and their neighbours bend towards the gap. A stiffness evens this out: the
    crossings move along their edges to the least of ∫ (shift² + stiffness⁴ curvature²), so that
    lines do not wind below a distance of `stiffness`, in m. Each edge may have lines or none, (e,).
    """
    mesh = stripes.waves.mesh
    edge, fraction, first, count = _crossings(stripes, present)
    chains = _chained(len(edge), *_links(mesh, first, count))
    if stiffness is not None and chains:
        fraction = _stiffened(mesh, edge, fraction, chains, stiffness)
    places, lines = _places(mesh, edge, fraction), []
    for nodes, cells in chains:
        own = [places[k, _sides(mesh, edge[k], cells)] for k in (nodes[:-1], nodes[1:])]
        ends = () if nodes[0] == nodes[-1] else (OPEN, OPEN)
        lines.append(CentreLine(cells, np.stack(own, axis=1), ends))
    return lines


def _sides(mesh: LineMesh, edge: Ints, cell: Ints) -> Ints:
    """Return which side of edges triangles are on, 0 or 1."""
    return np.where(mesh.edges.sides[edge, 0] == cell, 0, 1)


def _crossings(stripes: Stripes, present: Bools) -> tuple[Ints, Floats, Ints, Ints]:
    """Return the edge of each crossing and the fraction along it from the edge's first end.

    Crossings of an edge follow each other; also its first crossing and their number, (e,).
    """
    begin = stripes.phase[stripes.waves.mesh.edges.ends[:, 0]] / (2 * np.pi)
    end = begin + stripes.change / (2 * np.pi)
    low, high = np.floor(np.minimum(begin, end)), np.floor(np.maximum(begin, end))
    count = np.where(present, high - low, 0).astype(np.int64)
    first = np.cumsum(count) - count
    edge = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(edge)) - first[edge]
    level = np.where((end > begin)[edge], low[edge] + 1 + number, high[edge] - number)
    fraction = (level - begin[edge]) / (end - begin)[edge]
    return edge, np.clip(fraction, 0.0, 1.0), first, count


def _links(mesh: LineMesh, first: Ints, count: Ints) -> tuple[Ints, Ints]:
    """Return pairs of crossings that are linked in a triangle, (k, 2), and the triangle, (k,).

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
    pairs = []
    for side, begins in ((corner, True), ((corner + 2) % 3, False)):
        edge = edges.of_triangle[cell, side]
        # The k-th crossing counted from the corner.
        from_first = mesh.forward[cell, side] == begins
        pairs.append(first[edge] + np.where(from_first, k, count[edge] - 1 - k))
    return np.stack(pairs, axis=1), cell


def _places(mesh: LineMesh, edge: Ints, fraction: Floats) -> Complexes:
    """Return the flat place of each crossing in the charts of both triangles, (k, 2)."""
    half = mesh.edges.twins[edge]
    at = np.where(mesh.forward.ravel()[half], fraction[:, None], 1 - fraction[:, None])
    return mesh.flat.ravel()[half] + at * mesh.sides.ravel()[half]


def _chained(count: int, pairs: Ints, cell: Ints) -> list[Chain]:
    """Return chains of linked crossings; those with ends come first."""
    near: list[list[int]] = [[] for _ in range(count)]
    for link, ends in enumerate(pairs):
        for end in ends:
            near[int(end)].append(link)
    total, done = pairs.sum(axis=1), np.zeros(len(pairs), dtype=bool)
    chains = []
    for start in [*(k for k, links in enumerate(near) if len(links) == 1), *range(count)]:
        nodes: list[int] = [start]
        links: list[int] = []
        while free := [link for link in near[nodes[-1]] if not done[link]]:
            done[free[0]] = True
            links.append(free[0])
            nodes.append(int(total[free[0]]) - nodes[-1])
        if links:
            chains.append((np.array(nodes), cell[links]))
    return chains


def _stiffened(
    mesh: LineMesh, edge: Ints, fraction: Floats, chains: list[Chain], stiffness: float
) -> Floats:
    """Return the fractions at which lines of some stiffness cross the edges.

    No crossing moves further than half way to the next one on its edge.
    """
    place = _places(mesh, edge, fraction)
    step = _places(mesh, edge, np.ones(len(edge))) - _places(mesh, edge, np.zeros(len(edge)))
    size = np.abs(step[:, 0])
    # Each crossing with those before and after it, and the triangles between.
    before, here, after, back, ahead = map(np.concatenate, zip(*map(_threes, chains), strict=True))
    at_before, at_back = (_sides(mesh, edge[k], back) for k in (before, here))
    at_ahead, at_after = (_sides(mesh, edge[k], ahead) for k in (here, after))
    # The chart ahead turned to the one behind.
    turn = np.exp(1j * np.where(at_back == 0, -1, 1) * mesh.edge_turns[edge[here]])
    one = place[here, at_back] - place[before, at_before]
    two = turn * (place[after, at_after] - place[here, at_ahead])
    least = SHORT * size[here]
    h_one, h_two = np.maximum(np.abs(one), least), np.maximum(np.abs(two), least)
    mean = (h_one + h_two) / 2
    # Bending is across the line: along it, crossings may come nearer to each other.
    across = 1j * (one + two) / np.maximum(np.abs(one + two), least)

    def slope(way: Complexes, length: Floats) -> Floats:
        return np.asarray((np.conj(across) * way).real / length)

    bend = slope(two, h_two) - slope(one, h_one)
    rates = [
        slope(step[before, at_before], h_one),
        -slope(step[here, at_back], h_one) - slope(turn * step[here, at_ahead], h_two),
        slope(turn * step[after, at_after], h_two),
    ]
    place_of = np.tile(np.arange(len(here)), 3), np.concatenate([before, here, after])
    matrix = csr_array((np.concatenate(rates), place_of), shape=(len(here), len(edge)))
    heavy = stiffness**4 / mean
    weight = np.bincount(here, mean, minlength=len(edge))
    weight = np.maximum(weight, SHORT * size) * size**2
    normal = matrix.T @ diags_array(heavy) @ matrix + diags_array(weight)
    shift = -spd_factor(normal).solve(matrix.T @ (heavy * bend))
    same = edge[1:] == edge[:-1]
    middle = (fraction[1:] + fraction[:-1]) / 2
    low = np.concatenate([[EDGE], np.where(same, middle, EDGE)])
    high = np.concatenate([np.where(same, middle, 1 - EDGE), [1 - EDGE]])
    return np.clip(fraction + shift, np.minimum(low, fraction), np.maximum(high, fraction))


def _threes(chain: Chain) -> tuple[Ints, Ints, Ints, Ints, Ints]:
    """Return crossings before, at and after each inner crossing; triangles before and after it."""
    nodes, cells = chain
    if nodes[0] == nodes[-1]:
        nodes, cells = np.append(nodes, nodes[1]), np.append(cells, cells[0])
    return nodes[:-2], nodes[1:-1], nodes[2:], cells[:-1], cells[1:]
