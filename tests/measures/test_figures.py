"""Figures say how sure they are, and are reached only where their whole interval is."""

import pytest

from toros_fem.measures.figures import Figure, formatted, split_key
from toros_fem.measures.metrics import Metric


@pytest.mark.parametrize(
    ("value", "interval", "reached"),
    [(179.0, 1.0, True), (176.0, 1.5, None), (172.0, 1.5, False), (179.0, None, None),
     (None, None, False), (185.3, 0.0, True)],
)  # fmt: skip
def test_reached(value: float | None, interval: float | None, reached: bool | None) -> None:
    figure = Metric("angle", "deg", 180.0, lambda of, x: 0.0).figure(value, interval)
    assert figure.tolerance == pytest.approx(5.4)
    assert figure.as_dict()["reached"] is figure.reached is reached


def test_words() -> None:
    angle = Figure("angle", "deg", 178.812, 0.4671, 180.0, 5.4)
    assert (angle.key, angle.words) == ("angle_deg", "angle 178.81 ± 0.47° of 180°")
    assert Figure("held_mass", "kg", 0.1, 0.012).words == "held mass 100 ± 12 g"
    assert Figure("turn", "rounds", 2.0).shown == "2 rounds"
    assert Figure("angle", "deg", None, None, 180.0, 5.4).words == "angle no equilibrium of 180°"
    assert (formatted(None, "pa"), formatted(5e3, "pa")) == ("–", "5 kPa")
    assert split_key("stress_n_per_m") == ("stress", "n_per_m")
    assert split_key("objective") is None
    assert Metric("gap", "mm", 0.0, lambda of, x: 0.0, 30.0).figure(1.0).tolerance == 0.03 * 30.0
    assert Metric("gap", "mm", None, lambda of, x: 0.0).figure(1.0).reached is None


def test_a_miss_has_a_sign() -> None:
    figure = Figure("angle", "deg", 95.0, 4.0, 90.0, 2.7)
    assert figure.miss == 5.0
    assert figure.misses
    assert not Figure("angle", "deg", 92.0, None, 90.0, 2.7).misses
    assert Figure("angle", "deg", None, None, 90.0, 2.7).miss is None
    assert Figure("angle", "deg", 90.0).miss is None
    assert not Figure("angle", "deg", 90.0).misses
