"""Options of the equilibrium solver."""

from __future__ import annotations

from dataclasses import dataclass

from toros_fem.base.validation import require_count, require_positive


@dataclass(frozen=True)
class NewtonOptions:
    """Tolerance and limits of the equilibrium solver.

    Attributes:
        tolerance: Residual over the applied load at which a state counts as equilibrium.
        max_steps: Largest number of Newton steps for one load level.
        fraction_to_barrier: Largest fraction of the distance to the stretch bounds that one step
            takes.
        min_increment: Smallest increment of a continuation, over the level reached, before it
            gives up.

    Raises:
        ParameterError: An option is outside its bounds.
    """

    tolerance: float = 1e-10
    max_steps: int = 240
    fraction_to_barrier: float = 0.5
    min_increment: float = 0.05

    def __post_init__(self) -> None:
        require_positive(tolerance=self.tolerance, at_most=1e-2)
        require_count(1, max_steps=self.max_steps)
        require_positive(fraction_to_barrier=self.fraction_to_barrier, at_most=0.99)
        require_positive(min_increment=self.min_increment, at_most=1.0)
