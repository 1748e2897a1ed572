"""Checks of single values name the value and the bound."""

from collections.abc import Callable

import numpy as np
import pytest

from toros_fem.base.errors import ParameterError
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


@pytest.mark.parametrize(
    ("check", "message"),
    [
        (lambda: require_positive(a=1.0, b=0.0), "b = 0.0 must be a finite number greater than 0"),
        (lambda: require_positive(a=np.nan), "a = nan"),
        (lambda: require_positive(at_most=2.0, a=2.1), "a = 2.1 .* at most 2"),
        (lambda: require_between(0.0, 1.0, a=1.1), "a = 1.1 must be .* between 0 and 1"),
        (lambda: require_between(0.0, np.inf, a=-1.0), "a = -1.0 must be .* at least 0"),
        (lambda: require_between(0.0, np.inf, a=np.inf), "a = inf"),
        (lambda: require_count(2, a=1), "a = 1 must be a whole number, at least 2"),
        (lambda: require_count(1, a=2.0), "a = 2.0 must be a whole number"),  # type: ignore[arg-type]
        (lambda: require_choice("way", "left", ("up", "down")), "way = 'left' .* 'up', 'down'"),
    ],
)
def test_bad_values(check: Callable[[], None], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        check()
