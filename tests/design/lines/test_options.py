from typing import Any

import pytest

from toros_fem.base.errors import ParameterError
from toros_fem.design.lines.options import LineOptions


def test_one_width_counts_for_all_families() -> None:
    assert LineOptions(widths=[1e-3]).width_of(1, 2) == 1e-3
    assert LineOptions(widths=(4e-3, 1e-3)).width_of(1, 2) == 1e-3
    with pytest.raises(ParameterError, match="2 widths for 3 families"):
        LineOptions(widths=(4e-3, 1e-3)).width_of(0, 3)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"widths": ()}, "empty"),
        ({"widths": (1e-3, float("nan"))}, r"widths\[1\] = nan"),
        ({"widths": (0.5e-3,)}, "under print_width"),
        ({"print_width": 0.0}, "print_width"),
        ({"least_share": 1.5}, "least_share"),
        ({"even": 0.0}, "even"),
        ({"spread": 0.9}, "spread"),
    ],
)
def test_values_out_of_their_bounds_are_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        LineOptions(**settings)
