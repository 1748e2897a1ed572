"""Design variables as one distributed vector, and the scaled functions that MMA minimises."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.mpi import largest
from toros_fem.design.loop.options import DesignOptions
from toros_fem.design.loop.problem import DesignProblem, Evaluation
from toros_fem.design.mma.optimizer import Functions
from toros_fem.meshes.skin import Skin


class Variables:
    """Densities or shares, and on the first rank the designed pressures, as one vector.

    A pressure enters as the fraction of the way between the logarithms of its bounds, so that a
    step changes it by a factor.
    """

    def __init__(self, problem: DesignProblem, options: DesignOptions) -> None:
        skin = problem.skin
        least, most = problem.variable_bounds
        self._comm, self._count, self._skin = skin.comm, len(least), skin
        self._pressures = np.array(problem.pressures, dtype=np.float64)
        ranges = problem.pressure_ranges
        self._which = [k for k, bounds in enumerate(ranges) if bounds is not None]
        self._low, self._high = (
            np.array([bounds for bounds in ranges if bounds is not None]).reshape(-1, 2).T
        )
        self._carried = len(self._which) if skin.comm.rank == 0 else 0
        low, high = self.vector(least), self.vector(most)
        high[self._count :] = 1.0
        self.bounds = (low, high)
        self.move = self.vector(np.full(self._count, options.mma.move))
        self.move[self._count :] = options.pressure_move

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


# MMA works best with functions of O(1) to O(100).
SCALE = 10.0
# The least T that is scaled up: below it, no improvement is needed.
LEAST = float(np.finfo(np.float64).eps) ** 2
# Target of a constraint that is far from satisfied, as a fraction of its value, in each step.
TIGHTEN = 0.5
# Final target of a constraint over its limit: steps end a few per cent off the target.
MARGIN = 0.8


@dataclass(frozen=True)
class Values:
    """Functions of a design, scaled.

    Attributes:
        objective: T.
        rest: T without the squares of `residuals`.
        constraints: g/target − 1, (m,).
        residuals: Numbers whose squares are a part of T, (j,).
    """

    objective: float
    rest: float
    constraints: Floats
    residuals: Floats

    @property
    def functions(self) -> Functions:
        """What MMA compares with its approximations."""
        return Functions(self.rest, values=self.constraints, residuals=self.residuals)

    @property
    def missing(self) -> Values:
        """Values of a design without an equilibrium: infinite."""
        widths, squared = (np.full_like(a, np.inf) for a in (self.constraints, self.residuals))
        return Values(np.inf, np.inf, widths, squared)


@dataclass(frozen=True, eq=False)
class Gradients:
    """Gradients of the scaled functions by the owned variables."""

    objective: Floats
    rest: Floats
    constraints: list[Floats]
    residuals: list[Floats]


class Scaled:
    """Scales and targets of one stage, set again at each accepted design.

    Args:
        problem: The problem of the stage.
        variables: The design variables.
        constrained: Whether its constraints on widths hold.
        target_objective: T that needs no improvement, and therefore no scaling.
        start: The design that the stage starts from.

    Attributes:
        scale: Factor on T.
    """

    def __init__(
        self,
        problem: DesignProblem,
        variables: Variables,
        *,
        constrained: bool,
        target_objective: float,
        start: Evaluation,
    ) -> None:
        self._variables, self._limits = variables, problem.length_scale
        self._least = max(target_objective, LEAST)
        self.scale = self._scale_at(start)
        self._constrained = constrained
        self._targets: Floats = np.zeros(0)
        self._residuals: Callable[[Any], Floats] = lambda _: np.zeros(0)

    def refer(self, evaluation: Evaluation) -> float:
        """Take scale and targets from a design; return the factor by which the scale changes.

        Squares fall by orders of magnitude in a few steps. They would become smaller than the term
        that keeps MMA's approximations convex. So the scale follows T if there are residuals.
        """
        before = self.scale
        assert evaluation.residuals is not None
        self._residuals = evaluation.residuals.values
        if len(evaluation.residuals.gradients):
            self.scale = self._scale_at(evaluation)
        if self._constrained:
            assert self._limits is not None
            assert evaluation.length_scale is not None
            epsilon = np.asarray(self._limits.epsilon, dtype=np.float64)
            self._targets = np.maximum(MARGIN * epsilon, TIGHTEN * evaluation.length_scale)
        return self.scale / before

    def values(self, evaluation: Evaluation) -> Values:
        """Return the scaled functions of a design."""
        residuals = self.scale**0.5 * self._residuals(evaluation.equilibrium)
        objective = self.scale * evaluation.objective
        constraints: Floats = np.zeros(0)
        if self._constrained:
            assert evaluation.length_scale is not None
            constraints = np.asarray(evaluation.length_scale / self._targets - 1)
        return Values(objective, objective - float(residuals @ residuals), constraints, residuals)

    def gradients(self, evaluation: Evaluation) -> Gradients:
        """Return the scaled gradients of a design that was differentiated."""
        vector, near = self._variables.vector, evaluation.residuals
        widths = evaluation.length_scale_gradients if self._constrained else []
        assert near is not None
        assert widths is not None
        gradient, root = self._variables.gradient, self.scale**0.5
        assert evaluation.gradient is not None
        whole = gradient(evaluation, self.scale, evaluation.gradient, evaluation.pressure_gradient)
        rows = zip(near.gradients, near.pressure_gradients, strict=True)
        slopes = [gradient(evaluation, root, *row) for row in rows]
        rest = whole.copy()
        for residual, slope in zip(near.values(evaluation.equilibrium), slopes, strict=True):
            rest -= 2 * root * residual * slope
        constraints = [
            vector(np.asarray(part / target))
            for target, part in zip(self._targets, widths, strict=True)
        ]
        return Gradients(whole, rest, constraints, slopes)

    def _scale_at(self, evaluation: Evaluation) -> float:
        return SCALE / max(evaluation.objective, self._least)
