"""Sequence of solves for one equilibrium."""

from __future__ import annotations

from toros_fem.base.array_types import Floats
from toros_fem.mechanics.equilibrium.newton import Newton
from toros_fem.mechanics.equilibrium.newton_step import NewtonResult, NewtonStep

# Kinds of steps near the end that cost little.
OLDER = ("modified", "coupled")


class Attempts:
    """Sequence of solves; each uses the factors of the one before if that converged.

    Attributes:
        history: Rows of all of them.
        last: Where the last one ended.
        definite: Whether none of them needed a shift or met a saddle.

    Args:
        solver: Newton's method.
        near: Whether the first start is the equilibrium of a neighbouring design or load.
    """

    def __init__(self, solver: Newton, *, near: bool = False) -> None:
        self._solver, self._near = solver, near
        self._factorisations = solver.factor.count
        self.history: list[NewtonStep] = []
        self.last: Floats | None = None
        self.definite = True

    def __call__(
        self, start: Floats, max_steps: int | None = None, *, trial: bool = False
    ) -> NewtonResult:
        """Solve once more; the arguments are those of `Newton` (collective)."""
        found = self._solver(start, near=self._near, max_steps=max_steps, trial=trial)
        self._near = found.converged
        self.history.extend(found.history)
        self.definite &= found.definite
        self.last = found.state
        return found

    @property
    def steps(self) -> int:
        """Number of Newton steps, each with the tangent at its state."""
        return sum(row.step > 0 and row.kind not in OLDER for row in self.history)

    @property
    def modified_steps(self) -> int:
        """Number of modified Newton steps, with older factors and no more than a few products."""
        return sum(row.kind in OLDER for row in self.history)

    @property
    def factorisations(self) -> int:
        """Number of factorisations so far, retries with a shift included."""
        return self._solver.factor.count - self._factorisations
