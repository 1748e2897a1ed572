"""Options of the equilibrium solver."""

from __future__ import annotations

from typing import Annotated

from toros_fem.base.keys import Count, Fraction, In, Table, key


class NewtonOptions(Table):
    """Tolerance and limits of the equilibrium solver.

    Raises:
        ParameterError: An option is outside its bounds.
    """

    tolerance: Annotated[float, In(at_least=1e-15, at_most=1e-2)] = key(
        1e-10, "residual over the applied load at which a state counts as equilibrium"
    )
    max_steps: Count = key(240, "largest number of Newton steps for one load level")
    fraction_to_barrier: Annotated[float, In(above=0, at_most=0.99)] = key(
        0.5, "largest fraction of the distance to the stretch bounds that one step takes"
    )
    min_increment: Fraction = key(
        0.05, "smallest increment of a continuation, over the level reached, before it gives up"
    )
