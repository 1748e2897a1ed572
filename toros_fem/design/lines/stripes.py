"""Phases whose stripes follow given directions and spacings on a sewn skin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csc_array, csr_array, diags_array
from scipy.sparse.linalg import SuperLU

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.design.lines.line_mesh import Complexes, LineMesh, coordinates, in_plane
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
        of_edge, count = edges.of_triangle.ravel(), len(edges.ends)
        along = in_plane(np.roll(mesh.corners, -1, axis=1) - mesh.corners).ravel()
        here = self.corner_angles().ravel()
        half = np.arange(len(here))
        there, number = here[following(half)], self.number[mesh.vertex].ravel()
        same = np.bincount(of_edge, np.cos(here - there), minlength=count) >= 0
        sign = np.where(same, 1.0, -1.0)[of_edge]
        # The phase grows to the left of the direction.
        begin, end = (
            number[k] * (np.exp(-1j * angle) * along).imag
            for k, angle in ((half, here), (following(half), there))
        )
        change = (begin + sign * end) / 2
        # In the orientation of the edge's first end, from there to the other.
        forward = mesh.vertex.ravel() == edges.ends[of_edge, 0]
        change = np.where(forward, change, -sign * change)
        return np.bincount(of_edge, change, minlength=count) / edges.count, same


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

    def on(self, waves: Waves) -> Complexes:
        """Return exp(i phase) in the orientation of other waves on the same mesh, (n,)."""
        z: Complexes = np.exp(1j * self.phase)
        return np.where(np.cos(waves.angle - self.waves.angle) >= 0, z, np.conj(z))

    def line_ends(self, present: Bools) -> int:
        """Return how many lines end in triangles, where the phase around them turns.

        Args:
            present: Whether there are lines at each edge, (e,).
        """
        mesh = self.waves.mesh
        edge = mesh.edges.of_triangle
        flip = np.where(self.same, 1.0, -1.0)[edge]
        forward = mesh.edges.ends[edge, 0] == mesh.vertex
        # In the orientation of the first corner; `sign` is that of the corner before each side.
        sign = np.cumprod(np.insert(flip, 0, 1.0, axis=1), axis=1)
        turn = (sign[:, :3] * np.where(forward, 1.0, -flip) * self.change[edge]).sum(axis=1)
        # Where directions turn by half a turn around the triangle, lines need not end.
        counted = present[edge].all(axis=1) & (sign[:, 3] > 0)
        return int(np.abs(np.round(turn[counted] / (2 * np.pi))).sum())


@dataclass(frozen=True, eq=False)
class Image:
    """A symmetry of the mesh: vertices change places, (n,), and phases may change their sign."""

    vertex: Ints
    flips: Bools


def find_stripes(
    waves: Waves,
    weight: Floats,
    images: Sequence[Image] = (),
    side: Floats | None = None,
    like: Stripes | None = None,
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
    sign = np.where(same, 1.0, -1.0)
    i, j = mesh.edges.ends.T
    stiff = mesh.weights * (weight[i] + weight[j]) / 2
    mass = mesh.vertex_areas * weight
    energy = _energy(mesh, wanted, sign, stiff)
    z = _eigenvector(mesh, energy, mass, images) if like is None else like.on(waves)
    both = np.repeat(mass, 2)
    factor = spd_factor(
        diags_array(both) + REACH**2 * both.sum() / energy.diagonal().sum() * energy
    )
    for _ in range(RELAXATIONS if like is None else KEPT_RELAXATIONS):
        z = z / np.maximum(np.abs(z), np.finfo(float).tiny)
        z = symmetric(_solve(factor, mass * z), images)
    phase: Floats = np.angle(z)
    turns = 2 * np.pi * np.round((sign * phase[j] - phase[i] - wanted) / (2 * np.pi))
    # The least Σ w (sign_ij φ_j − φ_i − turns − ω_ij)², for the change of φ.
    excess = stiff * (sign * phase[j] - phase[i] - turns - wanted)
    matrix = mesh.laplacian(stiff, sign)
    shift = SHIFT * matrix.diagonal().sum() / mass.sum()
    right = np.bincount(i, excess, mesh.size) - np.bincount(j, sign * excess, mesh.size)
    phase = phase + spd_factor(matrix + shift * diags_array(mass)).solve(right)
    rest = phase - 2 * np.pi * np.round(phase / (2 * np.pi))
    off = NUDGE if side is None else NUDGE * side
    phase = phase + np.where(np.abs(rest) < NUDGE, off - rest, 0.0)
    return Stripes(waves, phase, sign * phase[j] - phase[i] - turns, same, wanted)


def _eigenvector(
    mesh: LineMesh, energy: csc_array, mass: Floats, images: Sequence[Image]
) -> Complexes:
    """Return the complex numbers at vertices, (n,), of unit norm and least energy."""
    both = np.repeat(mass, 2)
    shift = SHIFT * energy.diagonal().sum() / both.sum()
    factor = spd_factor(energy + shift * diags_array(both))
    z: Complexes = np.exp(2j * np.pi * np.random.default_rng(0).random(mesh.size))
    # Parts of the skin without connection have an eigenvector each.
    part = linked(*mesh.edges.ends.T, mesh.size)
    for _ in range(ITERATIONS):
        z = symmetric(_solve(factor, mass * z), images)
        z /= np.sqrt(np.bincount(part, mass * np.abs(z) ** 2) / np.bincount(part, mass))[part]
    return z


def symmetric(z: Complexes, images: Sequence[Image]) -> Complexes:
    """Return the mean of a field of complex numbers, (n,), and its images."""
    total = z.copy()
    for image in images:
        moved = z[image.vertex]
        total += np.where(image.flips, np.conj(moved), moved)
    return total / (1 + len(images))


def _energy(mesh: LineMesh, wanted: Floats, sign: Floats, stiff: Floats) -> csc_array:
    """Return the matrix of the energy; unknowns are the real and imaginary parts in turn."""
    i, j = mesh.edges.ends.T
    c, s = np.cos(wanted), np.sin(wanted)
    # z_j = R z_i, where R turns by ω, and conjugates if the directions are opposite.
    turn = np.array([[c, -s], [sign * s, sign * c]])
    a, b = np.indices((2, 2, len(i)))[:2]
    pull = coo_array(
        ((stiff * turn).ravel(), ((2 * j + a).ravel(), (2 * i + b).ravel())),
        shape=(2 * mesh.size, 2 * mesh.size),
    )
    return csc_array(diags_array(np.repeat(mesh.around(stiff), 2)) - (pull + pull.T))


def _solve(factor: SuperLU, z: Complexes) -> Complexes:
    return np.asarray(factor.solve(np.ascontiguousarray(z).view(np.float64))).view(np.complex128)


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
    direction = np.exp(1j * waves.corner_angles())
    middle = np.sqrt((direction**2).mean(axis=1))
    # Of both directions at a corner, that which fits the middle's.
    direction *= np.where((direction * np.conj(middle)[:, None]).real >= 0, 1.0, -1.0)
    gradient = gradients(mesh.corners)
    diverging = np.einsum("tcx,tcx->t", gradient, coordinates(direction))
    slope = np.einsum("tcx,tx->tc", gradient, coordinates(middle / np.abs(middle)))
    rows = np.repeat(np.arange(len(mesh.areas)), 3)
    matrix = csr_array((slope.ravel(), (rows, mesh.vertex.ravel())), (len(slope), mesh.size))
    wanted = -(diverging + matrix @ np.log(waves.number))
    heavy = diags_array(mesh.areas * weight[mesh.vertex].mean(axis=1))
    mass = diags_array(mesh.vertex_areas * weight / distance**2)
    change = spd_factor(matrix.T @ heavy @ matrix + mass).solve(matrix.T @ (heavy @ wanted))
    bound = np.log(spread)
    return Waves(mesh, waves.angle, waves.number * np.exp(bound * np.tanh(change / bound)))
