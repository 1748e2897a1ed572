"""Test of the stretches that eq. (1) admits, and limit of a step by them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np
import ufl
from dolfinx import fem, la
from mpi4py import MPI

from toros_fem.base.fenicsx import assembled
from toros_fem.base.mpi import largest, smallest
from toros_fem.base.validation import Bools, Floats, Ints
from toros_fem.forms.bubbles import POINTS, gradient_at
from toros_fem.forms.kinematics import interpolate
from toros_fem.materials.sheet import Composite

# Below this smaller stretch a triangle counts as collapsed: there det C is not smooth.
COLLAPSED = 1e-6
# From the fraction OUTSIDE of its bounds a triangle of a start is outside. Its bounds are loosened,
# so that it uses the fraction LOOSENED of them. Later they keep the fraction KEPT of its distance.
OUTSIDE, LOOSENED, KEPT = 0.999, 0.5, 0.1
# All triangles.
EVERY = slice(None)
# Least fraction of the way back that is gone with a predicted motion.
SHORTEST = 1 / 16


def singular_values(matrices: Floats) -> tuple[Floats, Floats]:
    """Return the larger and the smaller singular value of k×2 matrices, shape (n, k, 2)."""
    u, v = matrices.T
    uu, vv, uv = (u * u).sum(axis=0), (v * v).sum(axis=0), (u * v).sum(axis=0)
    # λ₁ λ₂ by all minors (Cauchy-Binet): uu vv − uv² would cancel.
    rows = combinations(range(len(u)), 2)
    p = np.sqrt(sum((u[i] * v[j] - u[j] * v[i]) ** 2 for i, j in rows))
    s = np.sqrt(uu + vv + 2 * p)
    # λ₁ − λ₂ = (λ₁² − λ₂²)/s: the difference tr C − 2p would cancel.
    difference = np.hypot(uu - vv, 2 * uv) / np.maximum(s, COLLAPSED)
    return (s + difference) / 2, (s - difference) / 2


def _product(u: Floats, v: Floats, matrix: Floats) -> Floats:
    """Return the columns of (u, v) times 2×2 matrices, (2, 3, n)."""
    (a, b), (c, d) = matrix
    return np.stack([u * a + v * c, u * b + v * d])


def reference_gradients(one: Floats, two: Floats, held: Floats, scales: Floats) -> list[Any]:
    """Return the matrices G of `Bubbles` at its points, each 2×2 with entries (n,).

    Edges of the triangles from the first corner, (3, n), unknowns of all edges, (6, n), and their
    scales, (3, n).
    """
    a, b, c = (one * one).sum(axis=0), (two * two).sum(axis=0), (one * two).sum(axis=0)
    return [gradient_at(point, (a, b, c), [*held], scales, np.sqrt) for point in POINTS]


class StretchBounds:
    """Feasibility of eq. (1), tested by the stretches themselves.

    The sign of the logarithm's argument is no test: it turns positive again far outside the bounds.
    Where a sheet wrinkles instead of taking compression, only the upper bounds count: the natural
    width keeps the other ones by itself. Corners are those of the owned triangles, (n, 3, 3), in m,
    and `flat` their places on the flat panels, (n, 3, 2). All methods are collective.

    Attributes:
        bubbles: Number of the first of two nodes of a triangle that hold the unknowns of its edges,
            as of `forms.bubbles.Bubbles`; they are given after the corners, (n, 5, 3), and three
            points of each triangle are tested. None without.
    """

    bubbles: int | None = None

    def __init__(
        self,
        comm: MPI.Comm,
        flat: Floats,
        c1: float,
        c2: float,
        *,
        wrinkles: bool = False,
    ) -> None:
        self._comm = comm
        chart = np.stack([flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]], axis=2)
        self._inverse_chart = np.ascontiguousarray(np.linalg.inv(chart).transpose(1, 2, 0))
        # Largest |λᵢ − 1| and |λ₁ + λ₂ − 2| of each triangle, (2, n).
        self._room = np.repeat([[c1 - 1], [c2 - 1]], len(flat), axis=1)
        self._least = 0.0 if wrinkles else -np.inf

    def take_bubbles(self, first: int, scales: Floats) -> None:
        """Take the place of the unknowns of edges, and the scales of those of `flat`, (n, 3)."""
        self.bubbles, self._scales = first, np.ascontiguousarray(scales.T)

    def gradient(self, corners: Floats) -> Floats:
        """Return deformation gradients (n, 3, 2) from corner positions (n, 3 corners, 3)."""
        # Components first: each is then one array without gaps.
        first, second, third = np.ascontiguousarray(corners[:, :3].transpose(1, 2, 0))
        return _product(second - first, third - first, self._inverse_chart).T

    def _factors(self, nodes: Floats, cells: Ints | slice = EVERY) -> Floats:
        """Matrices A with AᵀA = C, (n, 3, 2), or of three parts of a triangle, (n, 3, k, 2).

        The nodes are those of some of the triangles.
        """
        at, chart = np.ascontiguousarray(nodes.transpose(1, 2, 0)), self._inverse_chart[..., cells]
        one, two = at[1] - at[0], at[2] - at[0]
        if self.bubbles is not None:
            matrices = reference_gradients(one, two, at[3:].reshape(6, -1), self._scales[:, cells])
            parts = [
                _product(G[0][0] * one + G[1][0] * two, G[0][1] * one + G[1][1] * two, chart)
                for G in matrices
            ]
            return np.stack(parts, axis=2).T
        return _product(one, two, chart).T

    def _strains(self, F: Floats) -> tuple[Floats, Bools]:
        """What is bounded, max |λᵢ − 1| and |λ₁ + λ₂ − 2|, (2, n); and what has collapsed."""
        big, small = singular_values(F)
        strains = (np.maximum(strain, self._least) for strain in (big - 1, small - 1))
        joint = np.maximum(big + small - 2, self._least)
        found = np.stack([np.maximum(*map(np.abs, strains)), np.abs(joint)])
        collapsed = ~(small > COLLAPSED)
        if F.ndim == 3:
            return found, collapsed
        return found.max(axis=1), np.asarray(collapsed.any(axis=0))  # of all thirds

    def _use(self, F: Floats, room: Floats | None = None) -> Floats:
        """Fraction of the admissible range that each triangle uses: < 1 inside, ≥ 1 outside."""
        strains, collapsed = self._strains(F)
        used = strains / (self._room if room is None else room)
        return np.where(collapsed, np.inf, used.max(axis=0))

    def use(self, corners: Floats) -> Floats:
        """Return the fraction of the bounds that each triangle uses."""
        return self._use(self._factors(corners))

    def worst(self, corners: Floats) -> float:
        """Return the largest fraction of the bounds that any triangle uses: < 1 means feasible."""
        return self._worst(self.use(corners))

    def worst_of_start(self, corners: Floats) -> float:
        """Return the same for a start: what a solve can bring inside the bounds counts as < 1."""
        return self.worst(corners)

    def _worst(self, use: Floats) -> float:
        # A NaN must count as outside, and `max` would let it through on some ranks only.
        return largest(self._comm, np.max(np.where(np.isfinite(use), use, np.inf), initial=0.0))

    def largest_step(self, corners: Floats, direction: Floats, fraction: float) -> float:
        """Return a factor ≤ 1 on a step that keeps every triangle inside the bounds, 1 if possible.

        Every triangle of a feasible state may use up a fraction of its distance to the bounds. The
        upper bounds are convex in x, so that they also hold during the step. The lower ones are
        tested at its end only, and the energy there decides.
        """
        use = self._use(self._factors(corners))
        limit = use + fraction * (1 - use)
        beyond = np.flatnonzero(~(self._use(self._factors(corners + direction)) <= limit))
        step = 1.0
        if len(beyond):
            limit, room = limit[beyond], self._room[:, beyond]
            begin, way = corners[beyond], direction[beyond]
            inside: Floats = np.zeros(len(beyond))
            outside: Floats = np.ones(len(beyond))
            for _ in range(20):
                middle = (inside + outside) / 2
                at = begin + middle[:, None, None] * way
                good = self._use(self._factors(at, beyond), room) <= limit
                inside, outside = np.where(good, middle, inside), np.where(good, outside, middle)
            step = float(inside.min())
        return smallest(self._comm, step)


class MixedBounds(StretchBounds):
    """Bounds of two materials, linear in ρ̄ between them: each triangle has its own.

    A start may lie outside of them, since another density had wider ones. `loosen` then widens the
    bounds of its triangles until it lies inside; `narrow` narrows them again.
    """

    def __init__(
        self,
        density: fem.Function,
        flat: Floats,
        composite: Composite,
    ) -> None:
        space = density.function_space
        domain = space.mesh
        wrinkles = composite.membrane.relaxed
        widest = composite.widest_bounds
        super().__init__(domain.comm, flat, *widest, wrinkles=wrinkles)
        self._density, self._widest = density, self._room
        self._place = space.dofmap.list[: len(flat), 0]  # of each triangle among owned values
        self._ends = list(zip(composite.fabric_bounds, composite.reinforcement_bounds, strict=True))
        self._values = [[fem.Constant(domain, end) for end in pair] for pair in self._ends]
        self._slack = [fem.Function(space) if one != two else None for one, two in self._ends]
        self._change = [fem.Function(space) for _ in self._ends]
        self.update()

    @property
    def symbols(self) -> Any:
        """Functions and constants of `coefficients` and `narrowed`."""
        return self._density, self._values, self._slack, self._change

    @property
    def coefficients(self) -> tuple[Any, Any]:
        """c₁ and c₂ in UFL, functions of ρ̄ where they differ, with what loosens them."""
        c1, c2 = (
            one if slack is None else interpolate(self._density, one, two) + slack
            for (one, two), slack in zip(self._values, self._slack, strict=True)
        )
        return c1, c2

    def update(self) -> None:
        """Take the bounds of the density; none is loosened."""
        density = self._density.x.array[self._place]
        self._true = np.stack([interpolate(density, *pair) - 1 for pair in self._ends])
        self._set(self._true)

    def _set(self, room: Floats) -> None:
        self._room = room
        self._fill(self._slack, room - self._true)

    def _fill(self, functions: Sequence[fem.Function | None], values: Floats) -> None:
        for function, row in zip(functions, values, strict=True):
            if function is not None:
                function.x.array[self._place] = row
                function.x.scatter_forward()

    def narrowed(self, residual: Any) -> Any:
        """Return the change of a residual by the bounds, in UFL."""
        pairs = zip(self._slack, self._change, strict=True)
        parts = [ufl.derivative(residual, slack, by) for slack, by in pairs if slack is not None]
        return sum(parts[1:], start=parts[0])

    def take_narrowed(self, form: fem.Form, work: la.Vector) -> None:
        """Take the same form, compiled, and a vector to assemble into."""
        self._narrowed = form, work

    def push(self) -> Floats:
        """Return the change of the residual by narrowing loosened bounds, in N, to first order.

        The state is the one that is set; fixed components have their part too (collective).
        """
        self._fill(self._change, self._true - self._room)
        return assembled(*self._narrowed)

    def narrow(self, corners: Floats, motion: Floats | None) -> float:
        """Narrow loosened bounds, along a predicted motion if that helps.

        The motion is the change of the corners by narrowing all the way, to first order, None if it
        is not known. Returned is the fraction of it that is to be gone; equal on all ranks.
        """
        fraction = 0.0 if motion is None else self._follow(corners, motion)
        if fraction == 0:
            strains, _ = self._strains(self._factors(corners))
            near = strains + KEPT * (self._room - strains)
            self._set(np.maximum(self._true, np.minimum(self._room, near)))
        return fraction

    def _follow(self, corners: Floats, motion: Floats) -> float:
        """Narrow loosened bounds with a motion, as far as all triangles stay inside; 0 if not."""
        whole = self._true - self._room
        limit = 1 - KEPT * (1 - self._use(self._factors(corners)))
        fraction = 1.0
        while fraction >= SHORTEST:
            room = self._room + fraction * whole if fraction < 1 else self._true
            there = self._factors(corners + fraction * motion)
            inside = bool((self._use(there, room) <= limit).all())
            if smallest(self._comm, float(inside)) > 0:
                self._set(room)
                return fraction
            fraction /= 2
        return 0.0

    @property
    def loosened(self) -> bool:
        """Whether any triangle has wider bounds than those of the density."""
        return largest(self._comm, float((self._room > self._true).any())) > 0

    def worst_of_start(self, corners: Floats) -> float:
        """Return the largest fraction of the wider bounds of the two materials that is used."""
        return self._worst(self._use(self._factors(corners), self._widest))

    def loosen(self, corners: Floats, *, everywhere: bool = False) -> bool:
        """Widen the bounds of triangles outside of them; return whether there are any.

        With `everywhere` all bounds are widened first to those of the wider material.
        """
        strains, _ = self._strains(self._factors(corners))
        if everywhere:
            self._set(self._widest)
        outside = ~(strains < OUTSIDE * self._room)
        outside[[slack is None for slack in self._slack]] = False
        if not everywhere and largest(self._comm, float(outside.any())) == 0:
            return False
        self._set(np.where(outside, strains / LOOSENED, self._room))
        return True
