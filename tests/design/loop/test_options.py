"""Stages and stop rules are checked on construction; rows of the history flatten to columns."""

from typing import Any

import pytest

from toros_fem import errors
from toros_fem.design.loop.options import DesignOptions, Iteration, Stage


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"stages": ()}, "stages is empty"),
        ({"retries": -1}, "retries = -1 must be a whole number, at least 0"),
        ({"retries": 1.5}, "retries = 1.5 must be a whole number"),
        ({"x_tol": 0.0}, "x_tol = 0.0"),
        ({"kkt_tol": -1e-3}, "kkt_tol = -0.001"),
        ({"target_objective": -1.0}, "target_objective = -1.0"),
        ({"min_relative_decrease": 2.0}, "min_relative_decrease = 2.0"),
        ({"seconds": 0.0}, "seconds = 0.0"),
        ({"descent": "steep"}, "descent = 'steep' must be one of 'merit', 'conservative'"),
        ({"pressure_move": 1.5}, "pressure_move = 1.5 .* at most 1"),
    ],
)
def test_bad_options(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(errors.ParameterError, match=message):
        DesignOptions(**changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"iterations": 0}, "iterations = 0 must be a whole number, at least 1"),
        ({"iterations": 2.0}, "iterations = 2.0 must be a whole number"),
        ({"iterations": 1, "beta": 0.0}, "beta = 0.0"),
    ],
)
def test_bad_stages(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(errors.ParameterError, match=message):
        Stage(**changes)


def test_iterations_of_all_stages() -> None:
    assert DesignOptions((Stage(3), Stage(4, constrained=True))).iterations == 7


def test_metrics_are_columns_of_their_own() -> None:
    numbers = {name: 0.5 for name in Iteration.__dataclass_fields__ if name != "metrics"}
    row = Iteration(**numbers, metrics={"angle_deg": 12.0})  # type: ignore[arg-type]
    assert row.columns() == {**numbers, "angle_deg": 12.0}
