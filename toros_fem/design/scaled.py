"""What MMA is given of a problem: T scaled, its squares apart, constraints tightened by steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc

from toros_fem._types import Floats
from toros_fem.design.problem import DesignChain, Evaluation
from toros_fem.design.variables import Variables

# MMA wants functions of O(1) to O(100).
SCALE = 10.0
# The least T that is scaled up: where it is less, or 0, nothing is left to improve.
LEAST = float(np.finfo(np.float64).eps) ** 2
# A constraint far from being met asks for this share of its value, step by step.
TIGHTEN = 0.5
# What is asked for in the end, over the limit: steps end a few per cent off it.
MARGIN = 0.8


@dataclass(frozen=True)
class Values:
    """Functions of a design, scaled.

    Attributes:
        objective: T.
        rest: T without the squares of `residuals`.
        constraints: g/target − 1, (m,).
        residuals: What T holds the squares of, (j,).
    """

    objective: float
    rest: float
    constraints: Floats
    residuals: Floats

    @property
    def missing(self) -> Values:
        """Those of a design without an equilibrium: infinite."""
        widths, squared = (np.full_like(a, np.inf) for a in (self.constraints, self.residuals))
        return Values(np.inf, np.inf, widths, squared)


@dataclass(frozen=True, eq=False)
class Gradients:
    """Their gradients by the variables, as distributed vectors."""

    objective: PETSc.Vec
    rest: PETSc.Vec
    constraints: list[PETSc.Vec]
    residuals: list[PETSc.Vec]


class Scaled:
    """Scales and targets of one stage, taken anew from each design that is stepped from.

    Args:
        problem: The problem of the stage.
        variables: What it is solved for.
        constrained: Whether its constraints on widths hold.
        enough: T that needs no improving, and no weight either.
        start: The design that the stage starts from.
    """

    def __init__(
        self,
        problem: DesignChain,
        variables: Variables,
        *,
        constrained: bool,
        enough: float,
        start: Evaluation,
    ) -> None:
        self._variables, self._limits = variables, problem.length_scale
        self._least = max(enough, LEAST)
        self._scale = self._wanted(start)
        self._constrained = constrained
        self._targets: Floats = np.zeros(0)

    def refer(self, evaluation: Evaluation) -> float:
        """Take scale and targets from a design; returns the factor by which the scale changes.

        Squares fall by orders of magnitude in a few steps, and would come to lie under what MMA
        adds to keep its approximations convex: with these the scale follows T.
        """
        before = self._scale
        if len(evaluation.residuals):
            self._scale = self._wanted(evaluation)
        if self._constrained:
            assert self._limits is not None
            assert evaluation.length_scale is not None
            epsilon = np.asarray(self._limits.epsilon, dtype=np.float64)
            self._targets = np.maximum(MARGIN * epsilon, TIGHTEN * evaluation.length_scale)
        return self._scale / before

    def values(self, evaluation: Evaluation) -> Values:
        """Of a design."""
        residuals = self._scale**0.5 * evaluation.residuals
        objective = self._scale * evaluation.objective
        constraints: Floats = np.zeros(0)
        if self._constrained:
            assert evaluation.length_scale is not None
            constraints = np.asarray(evaluation.length_scale / self._targets - 1)
        return Values(objective, objective - float(residuals @ residuals), constraints, residuals)

    def gradients(self, evaluation: Evaluation) -> Gradients:
        """At a design that was differentiated."""
        vector, rows = self._variables.vector, evaluation.residual_gradients
        widths = evaluation.length_scale_gradients if self._constrained else []
        assert rows is not None
        assert widths is not None
        whole, root = self._variables.gradient(evaluation, self._scale), self._scale**0.5
        slopes = [vector(root * row) for row in rows]
        rest = whole.copy()
        for residual, slope in zip(evaluation.residuals, slopes, strict=True):
            rest.axpy(-2 * root * residual, slope)
        constraints = [
            vector(np.asarray(part / target))
            for target, part in zip(self._targets, widths, strict=True)
        ]
        return Gradients(whole, rest, constraints, slopes)

    def _wanted(self, evaluation: Evaluation) -> float:
        return SCALE / max(evaluation.objective, self._least)
