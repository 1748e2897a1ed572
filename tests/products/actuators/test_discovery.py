"""Designs from noise by line families: rounds, what is asked next, and the files at the end."""

import gc
import weakref
from dataclasses import dataclass
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.designs import DESIGN_ALONE
from mpi4py import MPI

from toros_fem.base.errors import NoEquilibriumError
from toros_fem.design.lines.widths import width_changes
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.design.loop.shape_problem import ShapeProblem
from toros_fem.making.print.regions import regions_on
from toros_fem.mechanics.equilibrium.equilibrium import EquilibriumError
from toros_fem.products.actuators import discovery, space_mapping
from toros_fem.products.actuators.discovery import (
    Discovery,
    densities_from,
    discover,
)
from toros_fem.products.actuators.job import Job
from toros_fem.products.actuators.line_print import LinePrint, print_of_lines
from toros_fem.products.actuators.line_widths import LARGEST, mended_widths
from toros_fem.products.tubes import twist

pytestmark = pytest.mark.usefixtures("without_pictures")

TINY = twist.TwistScene().updated(
    start="relaxed",
    length=0.06,
    relaxed_edge_length=5e-3,
    relaxed_iterations=5,
    directions=6,
    print_edge_length=2.2e-3,
    laid_width=2.5e-3,
    corrections=1,
    density_iterations=2,
    cross_sections=4,
    twist=60.0,
    pressure=8e3,
    **DESIGN_ALONE,
)


PROBLEMS: list[weakref.ref[ShapeDesign]] = []


@pytest.fixture(scope="module")
def found(alone: MPI.Comm) -> Discovery:
    def printed(*given: Any) -> LinePrint:
        made = print_of_lines(*given)
        PROBLEMS.append(weakref.ref(made.problem))
        return made

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(discovery, "print_of_lines", printed)
        return discover(Job(alone, TINY))


@pytest.mark.slow
def test_a_round_asks_for_what_the_print_missed(found: Discovery) -> None:
    first, second = found.rounds
    assert first.asked == {"twist_deg": 60.0}
    missed = 60.0 - first.metrics["twist_deg"]
    step = np.clip(missed / 60, -space_mapping.LARGEST_STEP, space_mapping.LARGEST_STEP)
    assert second.asked["twist_deg"] == pytest.approx(60 * (1 + step))
    assert first.error == pytest.approx(abs(missed) / 60)
    assert found.best.error == min(first.error, second.error)
    # The relaxed design goes on from the first one's families.
    assert len(second.relaxed.history) > len(first.relaxed.history)
    assert second.relaxed.history[: len(first.relaxed.history)] == first.relaxed.history


@pytest.mark.slow
def test_only_the_best_print_is_kept(found: Discovery) -> None:
    """Each other one would keep its factors: 0.8 GB a round on the coarse mesh of the demo."""
    gc.collect()
    kept = [problem() for problem in PROBLEMS if problem() is not None]
    assert len(PROBLEMS) == len(found.rounds) == 2
    assert len(kept) == 1
    assert kept[0] is found.made.problem


@pytest.mark.slow
def test_widths_mend_what_a_print_misses(found: Discovery) -> None:
    best, ratio = found.best, 1.01
    aim = space_mapping.Aim(ratio * best.metrics["twist_deg"], 60.0)
    wider = mended_widths(found.made, best.laid, {"twist_deg": aim})
    assert [f.length for f in wider.families] == [f.length for f in best.laid.families]
    assert wider.area != pytest.approx(best.laid.area, rel=1e-3)
    # The print's tangent tells what these widths do, on its own mesh.
    pattern, cells = found.made.problem.skin.pattern, found.made.problem.skin.owned_cells
    under = [regions_on(best.laid.pattern, f.under, pattern) for f in best.laid.families]
    changes = width_changes(best.laid.mesh, pattern, under, 1)
    families = zip(wider.families, best.laid.families, strict=True)
    change = np.array([np.log(new.radius / old.radius) for new, old in families])
    assert np.abs(change).max() <= np.log1p(LARGEST) + 1e-12
    density = changes.density(cells, change)
    evaluation = found.made.printed.evaluation
    assert evaluation is not None
    rate = found.made.problem.metric_derivatives(evaluation, [density])["twist_deg"][0]
    assert rate == pytest.approx((ratio - 1) * best.metrics["twist_deg"], rel=1e-6)
    far = space_mapping.Aim(3 * best.metrics["twist_deg"], 60.0)
    assert mended_widths(found.made, best.laid, {"twist_deg": far}) is None, "widths cannot do that"


@pytest.mark.slow
def test_densities_go_on_from_the_lines(alone: MPI.Comm, found: Discovery) -> None:
    designed = densities_from(Job(alone, TINY), found)
    rows = [row for row in designed.history if row.level == 1]
    assert len(rows) == 1 + TINY.lines.density_iterations
    assert rows[0].g_r > 0, "the widths are constrained"


@dataclass(frozen=True)
class Untold(twist.TwistScene):
    """Numbers of a tube whose targets are in no field."""

    @classmethod
    def targets(cls) -> dict[str, str]:
        return {}


@pytest.mark.slow
def test_targets_that_cannot_be_asked_for_end_after_a_round(alone: MPI.Comm) -> None:
    config = Untold.of(**TINY.updated(relaxed_iterations=1, corrections=3).as_dict())
    assert len(discover(Job(alone, config)).rounds) == 1


def test_without_any_print_in_equilibrium_the_reason_is_told(
    alone: MPI.Comm, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object, **__: object) -> None:
        raise EquilibriumError("made to fail.", None)  # type: ignore[arg-type]

    monkeypatch.setattr(ShapeProblem, "simulate_binary", fails)
    with pytest.raises(NoEquilibriumError, match=r"made to fail\. Ask for less"):
        discover(Job(alone, TINY.updated(relaxed_iterations=1)))


def test_what_is_asked_next_solves_a_linear_response() -> None:
    """Two metrics that disturb each other: Broyden's steps end at what gives the targets."""
    targets = {"a": 10.0, "b": -2.0}
    aims = {key: space_mapping.Aim(target, abs(target)) for key, target in targets.items()}
    response = np.array([[0.7, 0.1], [-0.4, 0.9]])
    size, rounds = np.array([10.0, 2.0]), []
    asked = dict(targets)
    for _ in range(8):
        scaled = np.array(list(asked.values())) / size
        metrics = dict(zip(targets, size * (response @ scaled + [0.0, 0.1]), strict=True))
        rounds.append(SimpleNamespace(asked=asked, metrics=metrics))
        asked = space_mapping.asked_next(rounds, aims)
    last = rounds[-1].metrics
    assert last == pytest.approx(targets, rel=1e-4)
    for before, after in pairwise(rounds):
        change = np.array([after.asked[k] - before.asked[k] for k in targets]) / size
        assert np.abs(change).max() <= space_mapping.LARGEST_STEP + 1e-12


def test_distance_from_targets() -> None:
    aims = {"a": space_mapping.Aim(2.0, 4.0), "b": space_mapping.Aim(0.0, 1.0)}
    assert space_mapping.largest_error({"a": 4.0, "b": -0.25, "c": 9.0}, aims) == 0.5
    assert space_mapping.largest_error({}, aims) == np.inf
    assert space_mapping.largest_error({"c": 9.0}, {}) == 0.0
