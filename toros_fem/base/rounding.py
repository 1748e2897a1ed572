"""Rounding of what one step of a design hands on to the next.

Runs on other kernels, or on another number of ranks, differ by 1e-12 after one step. The next step
may amplify that tenfold, or without limit where it asks for a sign. Where a step hands on rounded
numbers, these are the same in all runs, and so is all that follows.
"""

from __future__ import annotations

import numpy as np

from toros_fem.base.array_types import Floats


def rounded(values: Floats, unit: float | Floats) -> Floats:
    """Return the nearest multiples of a unit; values stay where the unit is 0."""
    by = np.where(np.asarray(unit) > 0, unit, 1.0)
    return np.where(np.asarray(unit) > 0, np.round(values / by) * by, values)
