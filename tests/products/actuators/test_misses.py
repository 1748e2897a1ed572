"""What a shape misses of its target, and shapes that are asked for in its place."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from scipy.spatial.transform import Rotation

from toros_fem.design.loop.case import Case
from toros_fem.measures.figures import TOLERANCE
from toros_fem.products.actuators import discovery
from toros_fem.products.actuators.misses import StrainResponse, misses_of
from toros_fem.products.tubes.bend import BendScene
from toros_fem.products.tubes.bend_twist import BendTwistScene
from toros_fem.products.tubes.contract import ContractScene
from toros_fem.products.tubes.twist import TwistScene

LENGTH = 0.06


def case_of(kind: type[Any] = BendTwistScene, **asked: Any) -> Case:
    """A short tube of a kind, on the mesh of its relaxed design."""
    scene = kind().updated(length=LENGTH, relaxed_edge_length=4e-3, **asked)
    found: Case = scene.case(MPI.COMM_SELF, scene.relaxed_level)
    return found


def turned(positions: np.ndarray, axis: str, degrees: float) -> np.ndarray:
    """A shape that is turned about an axis."""
    return np.asarray(Rotation.from_euler(axis, degrees, degrees=True).apply(positions))


def test_a_target_misses_nothing_and_a_tip_that_leans_counts() -> None:
    case = case_of()
    misses = misses_of(case)
    assert misses.of_shape(case.goal) < 1e-9
    assert misses.of_metrics(case.goal) < 0.1 * TOLERANCE  # angles of a coarse mesh
    # The tip of a bend by 90° looks along x: about x it keeps its direction, and both angles.
    shape = turned(case.goal, "x", 10.0)
    assert misses.of_metrics(shape) < TOLERANCE
    off = misses.rod(shape).centres - misses.rod(case.goal).centres
    rms = float(np.sqrt((off**2).sum(axis=1).mean())) / LENGTH
    assert misses.of_shape(shape) == pytest.approx(rms)
    last = misses.labels == misses.labels.max()
    middle = misses.rod(case.goal).centres[-1]
    shape = case.goal.copy()
    shape[last] = turned(shape[last] - middle, "y", 5.0) + middle
    assert misses.of_shape(shape) == pytest.approx(TOLERANCE, rel=0.01)


def test_a_whole_shape_is_judged_by_its_metrics_alone() -> None:
    misses = misses_of(case_of(BendScene))
    assert misses.labels is None
    shape = misses.case.pattern.points
    assert misses.of_shape(shape) == 0
    assert misses.of_metrics(shape) == pytest.approx(1.0, abs=0.02)  # nothing of the bend


def test_a_length_may_be_off_by_the_tolerance_that_the_verdict_has() -> None:
    misses = misses_of(case_of(TwistScene, keep_length=True))
    longer = misses.case.goal * [1.0, 1.0, 1.0 + TOLERANCE]
    assert misses.of_metrics(longer) == pytest.approx(TOLERANCE, rel=1e-6)


@pytest.mark.parametrize("kind", [BendTwistScene, ContractScene])
def test_an_asked_shape_has_the_strains_that_are_asked(kind: type[Any]) -> None:
    """Of the whole tube, and of one that is designed by halves."""
    case = case_of(kind)
    misses = misses_of(case)
    rod = misses.rod(case.goal)
    more = np.zeros_like(rod.strains)
    more[:, 1], more[:, 5] = np.linspace(3.0, 6.0, len(more)), 0.04
    found = misses.rod(misses.asking(more).goal)
    assert found.strains == pytest.approx(rod.strains + more, abs=1e-6)
    assert misses.strains_beyond(case.goal) == pytest.approx(0.0, abs=1e-9)
    # A print that has all of it is asked for the target next.
    answer = StrainResponse(more, more)
    size = np.abs(more).max(axis=0, keepdims=True) + 1e-9
    assert misses.strains_to_ask([answer]) / size == pytest.approx(0.0, abs=1e-3)


def test_a_change_that_does_not_help_is_halved_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Then other lines are asked for; so they are where no change promises enough."""
    search: Any = object.__new__(discovery._Search)
    step = SimpleNamespace(
        whole=True, before=10.0, promised=1.0, halved=SimpleNamespace(whole=False)
    )
    made: list[Any] = []
    monkeypatch.setattr(search, "_mended", lambda best, step: made.append(step), raising=False)
    monkeypatch.setattr(search, "_asked_again", lambda _: made.append("asked"), raising=False)
    monkeypatch.setattr(search, "_mending", lambda _: step, raising=False)

    def a_round(missed: float, mended: Any = None) -> Any:
        return SimpleNamespace(missed=missed, mended=mended, error=0.03 * missed)

    def again(rounds: list[Any]) -> None:
        search.best = min(rounds, key=lambda one: one.missed), made
        search.again(rounds)

    first = a_round(10.0)
    for rounds in (
        [first],
        [first, a_round(4.0, step)],
        [first, a_round(12.0, step)],
        [first, a_round(12.0, step), a_round(11.0, step.halved)],
    ):
        again(rounds)
    assert made == [step, step, step.halved, "asked"]
    small = SimpleNamespace(before=10.0, promised=6.0)
    monkeypatch.setattr(search, "_mending", lambda _: small)
    again([first])
    assert made[-1] == "asked", "far from the target"
    again([a_round(1.0)])
    assert made[-1] is small, "near it"
    monkeypatch.setattr(search, "_mending", lambda _: None)
    again([a_round(1.0)])
    assert made[-1] == "asked"


def test_two_rounds_without_progress_end_a_search() -> None:
    search = object.__new__(discovery._Search)

    def ends(*errors: float) -> bool:
        rounds: list[Any] = [
            SimpleNamespace(
                error=error, of_metrics=error, of_shape=error, failure="", mended=None,
                compared=False,
            )
            for error in errors
        ]  # fmt: skip
        return search.enough(rounds)

    assert not ends(1.0)
    assert not ends(1.0, 0.9)
    assert ends(1.0, 0.9, 0.8)
    assert not ends(1.0, 0.9, 0.65), "progress decides, not the number of rounds"
    assert not ends(1.0, 0.65, 0.6, 0.44, 0.41)
    assert ends(1.0, 0.65, 0.6, 0.44, 0.43, 0.42)
    assert ends(1.0, 0.004), "it is reached"
