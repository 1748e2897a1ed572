"""Checks of single values name the value and the bound."""

import numpy as np

from toros_fem.base.validation import (
    require_between,
    require_choice,
    require_count,
    require_positive,
)


def test_good_values() -> None:
    require_positive(a=1e-59, b=np.float64(2.0), c=3)
    require_positive(at_most=2.0, a=2.0)
    require_between(0.0, 1.0, a=0.0, b=1.0)
    require_count(2, a=2, b=np.int64(7))  # type: ignore[arg-type]
    require_choice("way", "up", ("up", "down"))
