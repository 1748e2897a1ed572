"""A start outside the stretch bounds of its density comes inside."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.mechanics.skin.stretch_bounds import MixedBounds

if TYPE_CHECKING:
    from toros_fem.mechanics.equilibrium.newton import Newton

# Each round is solved for up to this residual over the load.
APPROACHED, ROUNDS = 0.1, 60


def into_bounds(newton: Newton, start: Floats, max_steps: int, *, near: bool) -> tuple[Floats, int]:
    """Return the start, or a state near it inside the bounds of the density (collective).

    Another density may have had wider bounds. The bounds of the triangles outside are widened,
    then narrowed in rounds: the tangent predicts the motion by it, and Newton's steps correct
    that, as in an interior point method. From afar (not `near`) all bounds begin wide: narrow
    ones would cap every step of the whole skin.

    Returns:
        The state, and how many of the steps are left.
    """
    model, bounds, state = newton.model, newton.model.bounds, start
    if not isinstance(bounds, MixedBounds):
        return start, max_steps
    if not bounds.loosen(model.corners(start), everywhere=not near):
        return start, max_steps
    for _ in range(ROUNDS):
        if not bounds.loosened:
            break
        first = near and state is start
        state, outcome = newton.minimise(state, APPROACHED, max_steps, near=first, finish=False)
        max_steps = max(1, max_steps - newton.steps)
        if outcome <= 0:
            break
        state = _narrowed(newton, state, bounds)
    bounds.update()
    return state, max_steps


def _narrowed(newton: Newton, state: Floats, bounds: MixedBounds) -> Floats:
    """Narrow loosened bounds, and return the state that goes with them."""
    model = newton.model
    if not newton.stable(state):
        bounds.narrow(model.corners(state), None)
        return state
    model.set_state(state)
    motion = -newton.factor.solve(bounds.push() * model.free)
    fraction = bounds.narrow(model.corners(state), model.corners(motion))
    return np.asarray(state + fraction * motion)
