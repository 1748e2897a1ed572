"""Numbers of the relaxed design."""

from typing import Any

import pytest

from toros_fem.errors import ParameterError
from toros_fem.relaxed.find import RelaxedOptions


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"iterations": (40, 0)}, "^iterations = 0"),
        ({"more_iterations": 0}, "more_iterations = 0"),
        ({"move": (0.1, 1.5)}, "move = 1.5"),
        ({"radius": 0.0}, "radius = 0.0"),
        ({"share_weight": 0.0}, "share_weight = 0.0"),
        ({"width_ratio": -1.0}, "width_ratio = -1.0"),
        ({"directions": 1}, "directions = 1"),
        ({"share_limit": 0.95}, "limit = 0.95"),
        ({"family_limits": (0.5, 0.5)}, "sum_of_limits = 1.0"),
    ],
)
def test_bad_values(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        RelaxedOptions(**wrong)


def test_stages() -> None:
    options = RelaxedOptions(iterations=(7, 9), move=(0.3, 0.2), min_decrease=None)
    for number in range(2):
        rules = options.stage(number)
        assert [stage.iterations for stage in rules.stages] == [options.iterations[number]]
        assert rules.mma.move == options.move[number]
        assert rules.min_relative_decrease is None
