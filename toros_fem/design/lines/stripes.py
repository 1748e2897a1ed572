"""Phases whose stripes follow given directions and spacings on a sewn skin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csc_array, diags_array
from scipy.sparse.linalg import SuperLU, splu

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.design.lines.transport import Complexes, LineMesh
from toros_fem.meshes.triangles import following, linked

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


@dataclass(frozen=True, eq=False)
class Stripes:
    """A phase on a sewn skin, 0 in the middle of each line, 2π from one line to the next.

    Attributes:
        phase: Phase at each vertex in (−π, π], (n,), which grows to the left of the direction.
        change: Change of the phase along each edge from its first end to its second, (e,), in the
            orientation of its first end. Where the second end's direction points the other way,
            the sum of both is minus its phase, modulo 2π.
        same: Whether the directions at both ends of each edge point the same way, (e,).
        wanted: The change that direction and spacing ask for, (e,).
    """

    phase: Floats
    change: Floats
    same: Bools
    wanted: Floats


@dataclass(frozen=True, eq=False)
class Image:
    """A symmetry of the mesh: vertices change places, (n,), and phases may change their sign."""

    vertex: Ints
    flips: Bools


@dataclass(frozen=True, eq=False)
class Waves:
    """What stripes are to follow: direction angle and phase per m at each vertex, (n,).

    Angles are in rad in the chart of the vertex's first corner.
    """

    mesh: LineMesh
    angle: Floats
    number: Floats

    @property
    def spacing(self) -> Floats:
        """Distance in m from line to line at each vertex, (n,)."""
        return np.asarray(2 * np.pi / self.number, dtype=np.float64)

    def corner_angles(self) -> Floats:
        """Return the direction in the chart of each corner, (t, 3), in rad."""
        return self.angle[self.mesh.vertex] + self.mesh.turn

    def edge_changes(self) -> tuple[Floats, Bools]:
        """Return the wanted change along each edge, and whether both ends point the same way.

        Both triangles of an edge see the same change, but for a skin that is no surface of flat
        pieces around a vertex; there it is their mean.
        """
        mesh, edges = self.mesh, self.mesh.edges
        along = (np.roll(mesh.corners, -1, axis=1) - mesh.corners).reshape(-1, 2)
        here = self.corner_angles().ravel()
        half = np.arange(len(here))
        there, number = here[following(half)], self.number[mesh.vertex].ravel()
        of_edge = mesh.edges.of_triangle.ravel()
        count = len(edges.ends)
        same = np.bincount(of_edge, np.cos(here - there), minlength=count) >= 0
        # Left of the direction (cos, sin) is (−sin, cos).
        across = [
            number[k] * (-np.sin(angle) * along[:, 0] + np.cos(angle) * along[:, 1])
            for k, angle in ((half, here), (following(half), there))
        ]
        sign = np.where(same, 1.0, -1.0)[of_edge]
        forward = mesh.vertex.ravel() == edges.ends[of_edge, 0]
        # In the orientation of the edge's first end, from there to the other.
        change = (across[0] + sign * across[1]) / 2
        change = np.where(forward, change, -sign * change)
        mean = np.bincount(of_edge, change, minlength=count) / edges.count
        return mean, same


@dataclass(frozen=True, eq=False)
class Layout:
    """Where the stripes of earlier waves lie: the waves and their phase at vertices, (n,)."""

    waves: Waves
    phase: Floats

    def on(self, waves: Waves) -> Complexes:
        """Return exp(i phase) in the orientation of other waves on the same mesh, (n,)."""
        z: Complexes = np.exp(1j * self.phase)
        return np.where(np.cos(waves.angle - self.waves.angle) >= 0, z, np.conj(z))


def find_stripes(
    waves: Waves,
    weight: Floats,
    images: Sequence[Image] = (),
    side: Floats | None = None,
    like: Layout | None = None,
) -> Stripes:
    """Return the stripes that fit directions and spacings best.

    A complex number z at each vertex has the phase as its argument. Its energy is
    Σ w |z_j − exp(i ω_ij) z_i|² over all edges, with z_j conjugated where the directions at i and j
    point opposite ways. The eigenvector of its least eigenvalue (Knöppel, Crane, Pinkall,
    Schröder 2015, eq. 9) is the start. Steps of diffusion, each scaled back to |z| = 1, then give
    all places the same say, and least squares with the whole turns that were found end it.

    Args:
        waves: Directions and phases per m.
        weight: How much stripes count at each vertex, (n,), greater than 0.
        images: Symmetries that the stripes shall have, a group without its identity.
        side: Sign of the phase at each vertex, (n,), where it is 0 but for rounding. None: +1.
        like: Stripes to start from instead of the eigenvector, so that no line comes or goes.
    """
    mesh = waves.mesh
    wanted, same = waves.edge_changes()
    i, j = mesh.edges.ends.T
    stiff = mesh.weights * (weight[i] + weight[j]) / 2
    mass = mesh.vertex_areas * weight
    sign = np.where(same, 1.0, -1.0)
    start = None if like is None else like.on(waves)
    z = _relaxed(mesh, wanted, sign, stiff, mass, images, start)
    phase: Floats = np.angle(z).astype(np.float64)
    turns = 2 * np.pi * np.round((sign * phase[j] - phase[i] - wanted) / (2 * np.pi))
    phase = phase + _correction(
        mesh, sign * phase[j] - phase[i] - turns - wanted, sign, stiff, mass
    )
    rest = phase - 2 * np.pi * np.round(phase / (2 * np.pi))
    off = NUDGE if side is None else NUDGE * side
    phase = phase + np.where(np.abs(rest) < NUDGE, off - rest, 0.0)
    change: Floats = sign * phase[j] - phase[i] - turns
    return Stripes(phase, change, same, wanted)


def line_ends(mesh: LineMesh, stripes: Stripes, present: Bools) -> int:
    """Return how many lines end in triangles, where the phase around them turns.

    Args:
        mesh: The mesh.
        stripes: The phase.
        present: Whether there are lines at each edge, (e,).
    """
    edge, start = mesh.edges.of_triangle, mesh.vertex
    total, sign = np.zeros(len(edge)), np.ones(len(edge))
    for side in range(3):
        flip = np.where(stripes.same[edge[:, side]], 1.0, -1.0)
        forward = mesh.edges.ends[edge[:, side], 0] == start[:, side]
        total += sign * np.where(forward, 1.0, -flip) * stripes.change[edge[:, side]]
        sign *= flip
    # Where directions turn by half a turn around the triangle, lines need not end.
    counted = present[edge].all(axis=1) & (sign > 0)
    return int(np.abs(np.round(total[counted] / (2 * np.pi))).sum())


def _relaxed(
    mesh: LineMesh,
    wanted: Floats,
    sign: Floats,
    stiff: Floats,
    mass: Floats,
    images: Sequence[Image],
    start: Complexes | None,
) -> Complexes:
    """Return complex numbers at vertices, (n,), of unit length and little energy."""
    matrix = _energy(mesh, wanted, sign, stiff)
    both = np.repeat(mass, 2)
    if start is None:
        shift = SHIFT * matrix.diagonal().sum() / both.sum()
        factor = _factor(matrix + shift * diags_array(both))
        z = np.exp(2j * np.pi * np.random.default_rng(0).random(mesh.size))
        part = connected(mesh)
        for _ in range(ITERATIONS):
            z = symmetric(_solve(factor, mass * z), images)
            # Parts of the skin without connection have an eigenvector each.
            z /= np.sqrt(np.bincount(part, mass * np.abs(z) ** 2) / np.bincount(part, mass))[part]
    else:
        z = start
    time = REACH**2 * both.sum() / matrix.diagonal().sum()
    factor = _factor(diags_array(both) + time * matrix)
    for _ in range(RELAXATIONS if start is None else KEPT_RELAXATIONS):
        z = z / np.maximum(np.abs(z), np.finfo(float).tiny)
        z = symmetric(_solve(factor, mass * z), images)
    return z


def symmetric(z: Complexes, images: Sequence[Image]) -> Complexes:
    """Return the mean of a field of complex numbers, (n,), and its images."""
    total = z.copy()
    for image in images:
        moved = z[image.vertex]
        total += np.where(image.flips, np.conj(moved), moved)
    return total / (1 + len(images))


def connected(mesh: LineMesh) -> Ints:
    """Return the number of the connected part that each vertex belongs to, (n,)."""
    i, j = mesh.edges.ends.T
    return linked(i, j, mesh.size)


def _correction(
    mesh: LineMesh, excess: Floats, sign: Floats, stiff: Floats, mass: Floats
) -> Floats:
    """Return changes of the phase, (n,), that make the excess of its change along edges least."""
    i, j = mesh.edges.ends.T
    size = mesh.size
    place = np.concatenate([i, j]), np.concatenate([j, i])
    pull = coo_array((np.tile(stiff * sign, 2), place), shape=(size, size))
    degree = np.bincount(i, stiff, size) + np.bincount(j, stiff, size)
    shift = SHIFT * degree.sum() / mass.sum()
    matrix = diags_array(degree + shift * mass) - pull
    right = np.bincount(i, stiff * excess, size) - np.bincount(j, stiff * sign * excess, size)
    return np.asarray(_factor(matrix).solve(right))


def _energy(mesh: LineMesh, wanted: Floats, sign: Floats, stiff: Floats) -> csc_array:
    """Return the matrix of the energy; unknowns are the real and imaginary parts in turn."""
    i, j = mesh.edges.ends.T
    c, s = np.cos(wanted), np.sin(wanted)
    # z_j = R z_i, where R turns by ω, and conjugates if the directions are opposite.
    block = [[c, -s], [sign * s, sign * c]]
    rows, columns, values = [], [], []
    for a in range(2):
        for b in range(2):
            rows += [2 * j + a, 2 * i + b]
            columns += [2 * i + b, 2 * j + a]
            values += [-stiff * block[a][b]] * 2
    size = 2 * mesh.size
    place = np.concatenate(rows), np.concatenate(columns)
    degree = sum(np.bincount(end, stiff, minlength=mesh.size) for end in (i, j))
    off = coo_array((np.concatenate(values), place), shape=(size, size))
    return csc_array(off + diags_array(np.repeat(degree, 2)))


def _factor(matrix: csc_array) -> SuperLU:
    return splu(
        csc_array(matrix),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )


def _solve(factor: SuperLU, z: Complexes) -> Complexes:
    x = factor.solve(np.ascontiguousarray(z).view(np.float64))
    return np.asarray(x).view(np.complex128)


def fitting_spacing(waves: Waves, weight: Floats, distance: float, spread: float) -> Waves:
    """Return waves whose spacing follows from line to line where directions spread or meet.

    Lines neither begin nor end where div(k d) = 0, with the direction d and 2π/k the spacing. The
    change u of log k is the least of ∫ (d·∇u + d·∇log k + div d)² + (u/distance)².

    Args:
        waves: Directions and phases per m.
        weight: How much stripes count at each vertex, (n,), greater than 0.
        distance: Distance in m over which spacings may be adapted.
        spread: Largest factor by which they may be.
    """
    mesh = waves.mesh
    angle = waves.corner_angles()
    double = np.exp(2j * angle).mean(axis=1)
    middle = np.exp(1j * np.angle(double) / 2)
    # Of both directions at a corner, that which fits the middle's.
    sign = np.where((np.exp(1j * angle) * np.conj(middle)[:, None]).real >= 0, 1.0, -1.0)
    direction = sign * np.exp(1j * angle)
    # Gradient of the shape function of corner c: the opposite side, turned, over twice the area.
    along = np.roll(mesh.corners, -2, axis=1) - np.roll(mesh.corners, -1, axis=1)
    gradient = np.stack([-along[..., 1], along[..., 0]], axis=2) / (2 * mesh.areas)[:, None, None]
    vector = np.stack([direction.real, direction.imag], axis=2)
    diverging = np.einsum("tcx,tcx->t", gradient, vector)
    mean = np.stack([middle.real, middle.imag], axis=1)
    slope = np.einsum("tcx,tx->tc", gradient, mean)
    count = len(mesh.areas)
    rows = np.repeat(np.arange(count), 3)
    shape = (count, mesh.size)
    matrix = csc_array(coo_array((slope.ravel(), (rows, mesh.vertex.ravel())), shape=shape))
    wanted = -(diverging + matrix @ np.log(waves.number))
    heavy = diags_array(mesh.areas * weight[mesh.vertex].mean(axis=1))
    mass = mesh.vertex_areas * weight
    normal = matrix.T @ heavy @ matrix + diags_array(mass / distance**2)
    change = _factor(normal).solve(matrix.T @ (heavy @ wanted))
    bound = np.log(spread)
    change = bound * np.tanh(change / bound)
    return Waves(mesh, waves.angle, waves.number * np.exp(change))
