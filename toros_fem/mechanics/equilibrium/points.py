"""States whose energy and residual are known: a line search and what follows it ask twice."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.mpi import norm, smallest
from toros_fem.mechanics.assembly.model import SkinModel

# States that are kept: the begin of a step, and the last trials.
KEPT = 3


@dataclass(frozen=True, eq=False)
class Point:
    """A state, its energy in J, and its residual in N with its norm."""

    state: Floats
    energy: float
    residual: Floats
    size: float


@dataclass(eq=False)
class _Known:
    state: Floats
    energy: float | None = None
    residual: Floats | None = None


class Points:
    """Energy and residual of a model, evaluated once at each of the last states.

    All methods are collective.

    Args:
        model: The skin's model, at the load and density that are set.
    """

    def __init__(self, model: SkinModel) -> None:
        self._model = model
        self._known: list[_Known] = []

    def forget(self) -> None:
        """Forget all: the model has another load, design or friction now."""
        self._known.clear()

    def same(self, one: Floats, two: Floats) -> bool:
        """Return whether two states are equal to the last bit, on all ranks."""
        return smallest(self._model.skin.comm, np.array_equal(one, two)) > 0

    def energy(self, state: Floats) -> float:
        """Return the energy, infinite outside the stretch bounds."""
        known = self._find(state)
        if known.energy is None:
            known.energy = self._model.energy(known.state)
        return known.energy

    def residual(self, state: Floats) -> Floats:
        """Return the first variation, zero at fixed components."""
        known = self._find(state)
        if known.residual is None:
            known.residual = self._model.residual(known.state)
        return known.residual

    def at(self, state: Floats) -> Point:
        """Return both."""
        energy, residual = self.energy(state), self.residual(state)
        known = self._known[-1]
        return Point(known.state, energy, residual, norm(self._model.skin.comm, residual))

    def _find(self, state: Floats) -> _Known:
        for place, known in enumerate(reversed(self._known), start=1):
            if self.same(known.state, state):
                self._known.append(self._known.pop(-place))
                return known
        self._known.append(_Known(np.array(state)))
        del self._known[:-KEPT]
        return self._known[-1]
