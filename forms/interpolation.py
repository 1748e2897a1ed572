"""Stiffness between fabric and reinforcement, eqs. (2, 3)."""

from __future__ import annotations

from typing import Any


def interpolate(density: Any, fabric: Any, reinforcement: Any) -> Any:
    """Return the linear mix (1 − ρ̄) fabric + ρ̄ reinforcement, eqs. (2, 3).

    Linear as in the paper: the projection, not a penalty exponent, drives ρ̄ to 0 and 1.
    """
    return fabric + density * (reinforcement - fabric)
