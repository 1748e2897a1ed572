"""Phases whose stripes follow given directions and spacings on a sewn skin."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csc_array, csr_array, diags_array
from scipy.sparse.linalg import SuperLU

from toros_fem.base.array_types import Bools, Floats
from toros_fem.design.lines.line_mesh import Complexes, LineMesh, coordinates
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
