"""Smoothed step from filtered to projected density, eq. (12)."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from toros_fem.base.keys import In, Table, key
from toros_fem.base.validation import Floats

Steepness = Annotated[float, In(above=0, at_most=300)]
# At 0 everything would be printed, at 1 nothing.
Threshold = Annotated[float, In(above=0, below=1)]
Power = Annotated[float, In(at_least=1, at_most=10)]


class Projection(Table):
    """Projection ρ̄ = [(tanh βη + tanh β(ρ̃−η)) / (tanh βη + tanh β(1−η))]^q, eq. (12).

    With q = 1, as in the paper, a reinforcement that is hundreds of times stiffer than the fabric
    makes lines of ρ̄ = 0.05 stiff, which no print has. A power, as of SIMP (Bendsøe 1989), takes
    that away from a design.
    """

    beta: Steepness = key(20.0, "steepness of the projection")
    eta: Threshold = key(0.5, "threshold of the projection; 0.5 keeps areas")
    power: Power = key(1.0, "power q of the projection; 1 in the paper")

    @property
    def _scale(self) -> float:
        return float(np.tanh(self.beta * self.eta) + np.tanh(self.beta * (1 - self.eta)))

    def _step(self, filtered: Floats) -> Floats:
        """Return ρ̄ of q = 1."""
        low = np.tanh(self.beta * self.eta)
        raised = (low + np.tanh(self.beta * (filtered - self.eta))) / self._scale
        return np.asarray(np.clip(raised, 0.0, 1.0))  # rounding may leave [0, 1]

    def forward(self, filtered: Floats) -> Floats:
        """Return ρ̄ from ρ̃, both in [0, 1]."""
        step = self._step(filtered)
        return step if self.power == 1 else step**self.power

    def backward(self, filtered: Floats, gradient: Floats) -> Floats:
        """Return ∂T/∂ρ̃ from ∂T/∂ρ̄."""
        # Where `forward` clips, on obtuse meshes, the derivative is 0; rounding does not count.
        inside = (filtered > -1e-9) & (filtered < 1 + 1e-9)
        slope = inside * self.beta / np.cosh(self.beta * (filtered - self.eta)) ** 2 / self._scale
        if self.power != 1:
            slope = slope * self.power * self._step(filtered) ** (self.power - 1)
        return np.asarray(slope * gradient)
