"""Figures say how sure they are, and are reached only where their whole interval is."""

from dataclasses import replace

import pytest

from toros_fem.measures.figures import (
    Figure,
    State,
    Tolerances,
    formatted,
    largest_part,
    overall,
    split_key,
    verdict_of,
    worst_of,
)
from toros_fem.measures.metrics import Metric

REACHED, MISSED, NOT_CERTAIN = State


@pytest.mark.parametrize(
    ("value", "interval", "state"),
    [
        (179.0, 1.0, REACHED),
        (176.0, 1.5, NOT_CERTAIN),
        (172.0, 1.5, MISSED),
        (185.3, 0.0, REACHED),
        (179.0, None, NOT_CERTAIN),
        (172.0, None, MISSED),
        (None, None, MISSED),
    ],
)
def test_states(value: float | None, interval: float | None, state: State) -> None:
    """Nothing whose error is unknown is reached."""
    figure = Metric("angle", "deg", 180.0, lambda of, x: 0.0).figure(value, interval)
    assert figure.tolerance == pytest.approx(5.4)
    assert figure.state is state
    told = figure.as_dict()
    assert told["state"] == state
    reached = {REACHED: True, MISSED: False, NOT_CERTAIN: None}[state]
    assert told["reached"] is reached


def test_without_target_or_tolerance_there_is_no_state() -> None:
    assert Metric("gap", "mm", None, lambda of, x: 0.0).figure(1.0).state is None
    assert Figure("tip_distance", "mm", 3.0, 0.1, 0.0).state is None
    assert overall([Figure("angle", "deg", 90.0)]) is None
    assert verdict_of([Figure("angle", "deg", 90.0)]) == ""


@pytest.mark.parametrize(
    ("unit", "target", "scale", "tolerance"),
    [
        ("mm", 0.0, 30.0, 0.9),
        ("mm", 0.1, 30.0, 0.9),  # next to nothing: 3 % of it would be 3 µm
        ("mm", 5.0, 30.0, 0.15),
        ("deg", 0.0, None, 3.0),
        ("deg", -60.0, None, 3.0),  # nobody can tell less apart
        ("deg", 180.0, None, 5.4),
        ("percent", 8.0, None, 0.5),
        ("mm", 0.0, None, None),  # nobody knows what it is small against
    ],
)
def test_tolerances_of_small_targets(
    unit: str, target: float, scale: float | None, tolerance: float | None
) -> None:
    metric = Metric("number", unit, target, lambda of, x: 0.0, scale)
    assert metric.figure(1.0).tolerance == (tolerance and pytest.approx(tolerance))
    wider = metric.figure(1.0, tolerance=0.06).tolerance
    assert wider == (tolerance and pytest.approx(2 * tolerance))
    assert Tolerances().figure == 0.03


def test_words() -> None:
    angle = Figure("angle", "deg", 178.812, 0.4671, 180.0, 5.4)
    assert (angle.key, angle.words) == ("angle_deg", "angle 178.81 ± 0.47° of 180°")
    assert angle.asked == "180 ± 5.4°"
    assert Figure("held_mass", "kg", 0.1, 0.012).words == "held mass 100 ± 12 g"
    assert Figure("turn", "rounds", 2.0).shown == "2 rounds"
    assert Figure("angle", "deg", None, None, 180.0, 5.4).words == "angle no equilibrium of 180°"
    gap = Figure("gap", "mm", 2.0445, 0.467, 0.0, 1.2)
    assert (gap.words, gap.asked) == ("gap 2.04 ± 0.47 mm (at most 1.2 mm)", "at most 1.2 mm")
    assert (formatted(None, "pa"), formatted(5e3, "pa")) == ("–", "5 kPa")
    assert split_key("stress_n_per_m") == ("stress", "n_per_m")
    assert split_key("objective") is None


def test_digits_end_with_the_error() -> None:
    """Where it is unknown, with what the tolerance needs."""
    assert Figure("distance", "mm", 3.763, None, 0.0, 2.7).shown == "3.8 mm"
    assert Figure("angle", "deg", 89.6123, 16.2, 90.0, 2.7).shown == "90 ± 16°"
    assert Figure("angle", "deg", 89.6123, 0.0).shown == "89.612 ± 0.000°"


def test_a_miss_has_a_sign_and_a_reason() -> None:
    figure = Figure("angle", "deg", 95.0, 4.0, 90.0, 2.7)
    assert figure.miss == 5.0
    assert Figure("angle", "deg", None, None, 90.0, 2.7).miss is None
    assert Figure("angle", "deg", 90.0).miss is None
    assert figure.why == "angle 5.0° beyond 90° (± 4.0°; within 2.7° is reached)"
    back = Figure("angle", "deg", -55.0, 1.0, -60.0, 1.8)
    assert back.off() == "5.0° short of -60°"
    assert back.off(with_error=True) == "5.0 ± 1.0° short of -60°"
    part = Figure("shortening", "percent", 8.1, 2.0, 8.0, 0.24)
    assert part.off(with_error=True) == "0.1 ± 2.0 percentage points beyond 8 %"
    shape = Figure("shape_distance", "percent", 9.71, 0.4, 0.0, 3.0)
    assert shape.why == "shape distance 9.71 % (± 0.40 %; within 3 % is reached)"
    unknown = Figure("angle", "deg", 88.9, None, 90.0, 2.7)
    assert unknown.why == "angle 1.1° short of 90° (its error is unknown; within 2.7° is reached)"


def test_the_worst_figure_decides() -> None:
    good, bad = (Figure("angle", "deg", value, 0.5, 90.0, 2.7) for value in (90.0, 80.0))
    unsure = Figure("twist", "deg", 58.0, 1.0, 60.0, 1.8)
    far = [Figure(f"angle_{k}", "deg", 80.0 - k, 0.5, 90.0, 2.7) for k in range(5)]
    assert (overall([good]), verdict_of([good])) == (REACHED, "Reached")
    assert overall([good, unsure]) is NOT_CERTAIN
    assert verdict_of([good, unsure]).startswith("Not certain: twist 2.0° short of 60°")
    assert overall([good, unsure, bad]) is MISSED
    assert verdict_of([good, unsure, bad]) == f"Missed: {bad.why}"
    tip = Figure("tip_direction", "deg", 60.0, 0.5, 0.0, 5.0)
    assert worst_of([tip, bad]) is bad, "what was asked for by a number comes first"
    assert worst_of([tip, unsure]) is tip
    assert verdict_of([Figure("angle", "deg", None, None, 90.0, 2.7)]).endswith("no equilibrium")
    told = verdict_of(far)
    assert told.startswith("Missed: angle 4 ")
    assert told.endswith("; and 2 more")


@pytest.mark.parametrize(
    ("figure", "why"),
    [
        (
            Figure("angle", "deg", 60.3, 25.0, 60.0, 3.0),
            "angle as asked, 60° (± 25°; within 3° is reached)",
        ),
        (
            Figure("shape", "percent", 3.04, None, 0.0, 3.0),
            "shape 3.04 % (its error is unknown; within 3 % is reached)",
        ),
        (
            Figure("angle", "deg", 54.45, 3.0, 60.0, 2.5),
            "angle 5.55° short of 60° (± 3.00°; within 2.5° is reached)",
        ),
    ],
)
def test_rounded_numbers_agree_with_their_state(figure: Figure, why: str) -> None:
    """They are not off by nothing, and not within the tolerance where the state says missed."""
    assert figure.why == why


@pytest.mark.parametrize(
    ("value", "interval", "state"),
    [
        (1.5, 0.2, State.REACHED),
        (1.5, None, State.NOT_CERTAIN),
        (0.99, 0.01, State.REACHED),
        (0.99, 0.1, State.NOT_CERTAIN),
        (0.9, 0.02, State.MISSED),
        (0.9, None, State.MISSED),
    ],
)
def test_a_least_value_has_one_side(value: float, interval: float | None, state: State) -> None:
    """More is as good; what lacks counts over the tolerance."""
    figure = Figure("force", "n", value, interval, 1.0, 0.05, at_least=True)
    assert figure.state is state
    assert figure.asked == "at least 0.95 N"
    assert largest_part([figure]) == pytest.approx(max(0.0, (1 - value) / 0.05))
    assert figure.as_dict()["at_least"]
    assert "at_least" not in replace(figure, at_least=False).as_dict()
