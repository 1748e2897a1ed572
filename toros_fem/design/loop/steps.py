"""Design variables as one distributed vector, and steps of MMA in one stage."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from toros_fem.base.files import Archive
from toros_fem.base.mpi import largest
from toros_fem.base.validation import Floats
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.design.loop.problem import DesignProblem, Evaluation, Slopes
from toros_fem.design.mma.optimizer import MMA, Functions, MMAState
from toros_fem.meshes.skin import Skin

# MMA works best with functions of O(1) to O(100).
SCALE = 10.0
# The least T that is scaled up: below it, no improvement is needed.
LEAST = float(np.finfo(np.float64).eps) ** 2
# Final target of a constraint over its limit: steps end a few per cent off the target.
MARGIN = 0.8
# Least price of a violated constraint in the merit function, in MMA's scaled units.
PRICE = 1.0
# Part of its range to which a variable is rounded after each step, or KNOWN times `x_tol` if that
# is smaller. So runs that differ by rounding take the same steps: unrounded, the difference grows
# by a factor of up to ten in each.
RESOLUTION, KNOWN = 1e-3, 10.0
# What MMA carries from step to step: vectors of the variables, and small arrays.
MMA_VECTORS = ("previous", "before_previous", "distance")
MMA_SMALL = ("multipliers", "curvature")


class Variables:
    """Densities or shares, and on the first rank the designed pressures, as one vector.

    A pressure enters as the fraction of the way between the logarithms of its bounds, so that a
    step changes it by a factor.
    """

    def __init__(self, problem: DesignProblem, options: DesignOptions) -> None:
        skin, physics = problem.skin, problem.physics
        least, most = problem.fields.bounds
        self._comm, self._count, self._skin = skin.comm, len(least), skin
        self._pressures = np.array(physics.pressures, dtype=np.float64)
        ranges = physics.pressure_ranges
        self._which = [k for k, bounds in enumerate(ranges) if bounds is not None]
        self._low, self._high = (
            np.array([bounds for bounds in ranges if bounds is not None]).reshape(-1, 2).T
        )
        self._carried = len(self._which) if skin.comm.rank == 0 else 0
        low, high = self.vector(least), self.vector(most)
        high[self._count :] = 1.0
        self.bounds = (low, high)
        self.move = self.vector(np.full(self._count, options.mma.move))
        if self._carried:
            ways = np.log1p(options.pressure_move) / np.log(self._high / self._low)
            self.move[self._count :] = np.minimum(ways, 1.0)

    def vector(self, cells: Floats, pressures: Sequence[float] | None = None) -> Floats:
        """Return a vector of own variables and of all pressures in Pa (0 if None)."""
        out: Floats = np.append(cells, np.zeros(self._carried))
        if self._carried and pressures is not None:
            designed = np.array(pressures)[self._which]
            fractions = np.log(designed / self._low) / np.log(self._high / self._low)
            out[self._count :] = fractions
        return out

    def design(self, x: Floats) -> tuple[Floats, tuple[float, ...]]:
        """Return the density and the pressures of a vector (collective)."""
        density, pressures = x[: self._count].copy(), self._pressures.copy()
        if self._which:
            fractions = self._comm.bcast(x[self._count :] if self._carried else None, root=0)
            moved = self._low * (self._high / self._low) ** fractions
            pressures[self._which] = np.clip(moved, self._low, self._high)
        return density, tuple(float(p) for p in pressures)

    def gather(self, local: Floats) -> Floats:
        """Return the entries of all ranks, in an order that no partition changes (collective)."""
        cells = by_cell(self._skin, local[: self._count])
        pressures = self._comm.bcast(local[self._count :], root=0)
        return np.concatenate([cells.ravel(), pressures])

    def scatter(self, entries: Floats) -> Floats:
        """Return the entries of this rank from those of all, as of `gather`."""
        end = len(entries) - len(self._which)
        cells = entries[:end].reshape(len(self._skin.pattern.panel), -1)
        own = cells[self._skin.owned_cells].ravel()
        return np.concatenate([own, entries[end:][: self._carried]])

    def gradient(
        self, evaluation: Evaluation, scale: float, by_density: Floats, by_pressure: Floats | None
    ) -> Floats:
        """Return `scale` times a gradient by the variables, from those by ρ and by pressures."""
        out = self.vector(scale * by_density)
        if self._carried:
            assert by_pressure is not None
            factor = np.array(evaluation.equilibrium.pressures)[self._which]
            factor *= np.log(self._high / self._low)
            out[self._count :] = scale * by_pressure[self._which] * factor
        return out


def by_cell(skin: Skin, owned: Floats) -> Floats:
    """Return one row for each triangle on every rank, from owned rows or their entries in line.

    It is collective.
    """
    count = len(skin.owned_cells)
    width = int(largest(skin.comm, owned.size / max(count, 1)))
    return skin.gather_cells(owned.reshape(count, width))


def resolution_of(options: DesignOptions) -> float:
    """Return the part of its range to which a variable is rounded."""
    return min(RESOLUTION, KNOWN * options.x_tol)


class Steps:
    """MMA and the functions of one stage as it sees them.

    f₀ is T without the squares of the residuals, the constraints are g/target − 1. Scale and
    targets follow each accepted design; `here` is the first one.

    Attributes:
        mma: The optimiser.
        scale: Factor on T.
    """

    def __init__(
        self,
        problem: DesignProblem,
        variables: Variables,
        stage: Stage,
        options: DesignOptions,
        here: Evaluation,
        slopes: Slopes,
    ) -> None:
        self._variables, self._least = variables, max(options.target_objective or 0.0, LEAST)
        self._limits = problem.length_scale if stage.constrained else None
        self._targets: Floats = np.zeros(0)
        self._tighten = stage.tighten
        self._residuals: Callable[[Any], Floats] = slopes.residuals.values
        self.scale, self._count = self._scale_at(here), len(slopes.residuals.gradients)
        self.mma = MMA(
            problem.skin.comm,
            *variables.bounds,
            constraints=2 if stage.constrained else 0,
            options=options.mma,
            move=variables.move,
            residuals=self._count,
            resolution=resolution_of(options),
        )

    def at(self, design: Evaluation | None) -> Functions:
        """Return the values of a design; infinite where it has no equilibrium (collective)."""
        if design is None:
            infinite = [np.full(n, np.inf) for n in (len(self._targets), self._count)]
            return Functions(np.inf, values=infinite[0], residuals=infinite[1])
        roots: Floats = np.asarray(self.scale**0.5 * self._residuals(design.equilibrium))
        rest = self.scale * design.objective - float(roots @ roots)
        if self._limits is None:
            return Functions(rest, residuals=roots)
        widths = np.asarray(design.length_scale) / self._targets - 1
        return Functions(rest, values=widths, residuals=roots)

    def around(self, here: Evaluation, slopes: Slopes) -> Functions:
        """Take scale and targets from a design; return its values and gradients (collective).

        Squares fall by orders of magnitude in a few steps. They would become smaller than the term
        that keeps MMA's approximations convex. So the scale follows T if there are residuals.
        """
        before, self._residuals = self.scale, slopes.residuals.values
        if self._count:
            self.scale = self._scale_at(here)
        self.mma.rescale(self.scale / before)
        if self._limits is not None:
            epsilon = np.asarray(self._limits.epsilon, dtype=np.float64)
            self._targets = np.maximum(
                MARGIN * epsilon, self._tighten * np.asarray(here.length_scale)
            )
        values, near, root = self.at(here), slopes.residuals, self.scale**0.5
        gradient = partial(self._variables.gradient, here)
        pairs = zip(near.gradients, near.pressure_gradients, strict=True)
        rows = [gradient(root, *pair) for pair in pairs]
        # ∇f₀ = ∇T − 2 Σ r ∇r
        rest = gradient(self.scale, slopes.gradient, slopes.pressure_gradient)
        for residual, row in zip(values.residuals, rows, strict=True):
            rest -= 2 * residual * row
        widths = [
            self._variables.vector(part / target)
            for target, part in zip(self._targets, slopes.length_scale_gradients, strict=False)
        ]
        return replace(values, gradient=rest, jacobian=widths, residual_jacobian=rows)

    def merit(self) -> Callable[[Functions], float]:
        """Return a function: T, scaled, plus violated constraints at the last step's prices."""
        multipliers = np.asarray(self.mma.state.multipliers)[: len(self._targets)]
        prices = np.maximum(PRICE, 2 * multipliers)

        def of(functions: Functions) -> float:
            squares = float(np.dot(functions.residuals, functions.residuals))
            return functions.value + squares + float(prices @ np.maximum(functions.values, 0.0))

        return of

    def saved(self) -> tuple[dict[str, Floats], dict[str, Any]]:
        """Return what `restore` needs, as arrays and as JSON (collective)."""
        state, every = self.mma.state, self._variables.gather
        vectors = {name: getattr(state, name) for name in MMA_VECTORS}
        arrays = {f"mma_{name}": every(v) for name, v in vectors.items() if v is not None}
        small = {name: getattr(state, name) for name in MMA_SMALL}
        numbers = {name: None if v is None else v.tolist() for name, v in small.items()}
        return arrays, {"scale": self.scale, "mma": {**numbers, "unit": state.unit}}

    def restore(self, saved: Archive) -> None:
        """Take up what `saved` returned."""
        arrays, numbers = saved.arrays, saved.numbers["mma"]
        vectors = {
            name: self._variables.scatter(arrays[f"mma_{name}"])
            for name in MMA_VECTORS
            if f"mma_{name}" in arrays
        }
        small = {name: None if (v := numbers[name]) is None else np.array(v) for name in MMA_SMALL}
        self.mma.state = MMAState(**vectors, **small, unit=float(numbers["unit"]))
        self.scale = float(saved.numbers["scale"])

    def _scale_at(self, evaluation: Evaluation) -> float:
        return SCALE / max(evaluation.objective, self._least)
