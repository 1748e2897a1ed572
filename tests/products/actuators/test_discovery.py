"""Designs from noise by line families: rounds, what is asked next, and the files at the end."""

import gc
import weakref
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers.designs import DESIGN_ALONE
from mpi4py import MPI

from toros_fem.base.errors import NoEquilibriumError
from toros_fem.design.lines.field import LineField, LineOptions
from toros_fem.design.lines.laid_lines import changed
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.miss import Aim, residuals_of
from toros_fem.design.loop.shape_design import ShapeDesign, ShapeProblem
from toros_fem.mechanics.equilibrium.equilibrium import EquilibriumError
from toros_fem.meshes.sheets import rectangle
from toros_fem.products import tubes
from toros_fem.products.actuators import corrections, discovery
from toros_fem.products.actuators.corrections import (
    StrainResponse,
    strains_beyond,
    strains_to_ask,
    with_strains,
)
from toros_fem.products.actuators.discovery import Discovery, densities_from, discover
from toros_fem.products.actuators.estimates import Job, MeshValues, values_on
from toros_fem.products.actuators.printed_lines import (
    WIDER,
    LinePrint,
    farthest,
    mending,
    print_of_lines,
)
from toros_fem.products.tubes import BendTwistScene, ContractScene

pytestmark = pytest.mark.usefixtures("without_pictures")

SHORT: dict[str, Any] = {
    "start": "relaxed",
    "length": 0.06,
    "relaxed_edge_length": 6e-3,
    "print_edge_length": 2e-3,
    "laid_width": 2.5e-3,
    **DESIGN_ALONE,
}
TINY = tubes.TwistScene().updated(
    relaxed_iterations=3, directions=6, corrections=1, density_iterations=2, cross_sections=4,
    twist=60.0, pressure=8e3, **SHORT,
)  # fmt: skip
LENGTH = 0.06
PROBLEMS: list[weakref.ref[ShapeDesign]] = []


@pytest.fixture(scope="module")
def found(alone: MPI.Comm) -> Discovery:
    def printed(*given: Any, **others: Any) -> LinePrint:
        made = print_of_lines(*given, **others)
        PROBLEMS.append(weakref.ref(made.problem))
        return made

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(discovery, "print_of_lines", printed)
        patch.setattr(discovery, "mending", lambda *_: None)
        return discover(Job(alone, TINY))


@pytest.mark.slow
def test_a_round_asks_for_what_the_print_missed(found: Discovery) -> None:
    """The print turns by less than the target: the next one is asked for a tube that turns more."""
    first, second = found.rounds
    assert first.asked == {"twist_deg": 60.0}
    missed = 60.0 - first.metrics["twist_deg"]
    step = np.clip(missed / 60, -corrections.LARGEST_STEP, corrections.LARGEST_STEP)
    assert second.asked["twist_deg"] == pytest.approx(60 * (1 + step))
    assert first.of_metrics == pytest.approx(abs(missed) / 60)
    assert found.best.missed == min(first.missed, second.missed)
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
def test_lines_mend_what_a_print_misses(alone: MPI.Comm, found: Discovery) -> None:
    """What a change of widths and a warp promise is what the print of the changed lines has."""
    best, made = found.best, found.made
    # New meshes alone change the twist by 0.5 %.
    aim = Aim(0.97 * best.metrics["twist_deg"], 60.0)
    residuals = replace(residuals_of(made.case), aims={"twist_deg": aim}, labels=None)
    step = mending(made, best.laid, residuals)
    assert step.promised < 0.2 * step.before
    assert np.abs(step.change.widths).max() <= np.log1p(WIDER) + 1e-12
    assert np.abs(step.change.warp).max() <= farthest(best.laid) + 1e-12
    assert step.halved.promised == pytest.approx((step.before + step.promised) / 2)
    laid = changed(step.lines, step.change)
    job = Job(alone, TINY)
    plain = TINY.case(alone, TINY.print_level)
    after = print_of_lines(job, TINY.print_level, plain, laid, made.shape, best.relaxed.pressures)
    there = replace(residuals_of(after.case), aims={"twist_deg": aim}, labels=None)
    assert np.linalg.norm(there(after.shape[1])) < 0.5 * step.before
    far = Aim(9 * best.metrics["twist_deg"], 60.0)
    assert mending(made, best.laid, replace(residuals, aims={"twist_deg": far})) is None


@pytest.mark.parametrize(("before", "after", "misled"), [
    (0.02, 0.04, True),
    (0.04, 0.045, False),  # what the print's own mesh misses, all rounds have tried to mend
    (0.02, 0.025, False),
])  # fmt: skip
def test_only_a_finer_mesh_that_misses_asks_for_more(
    monkeypatch: pytest.MonkeyPatch, before: float, after: float, misled: bool
) -> None:
    def compared(search: Any) -> Any:
        if search.judged is None:
            search.best = search.judged = (SimpleNamespace(error=after),)
        return search.best[0]

    search: Any = object.__new__(discovery._Search)
    search.best, search.judged = (SimpleNamespace(error=before),), None
    monkeypatch.setattr(discovery._Search, "_compared", compared)
    assert search.misled() is misled
    assert search.judged is not None
    assert not search.misled(), "one print is judged once"


class Judged:
    """Prints of a search and the twist that their finer mesh tells, by the number of its answer."""

    def __init__(self, answers: dict[int, Any]) -> None:
        self.prints: list[LinePrint] = []
        self.told: list[float] = []
        self.answers = answers

    def printed(self, *given: Any, **others: Any) -> LinePrint:
        self.prints.append(print_of_lines(*given, **others))
        return self.prints[-1]

    def finer(self, *given: Any) -> MeshValues:
        number = len(self.told)
        self.told.append(np.nan)
        answer = self.answers.get(number)
        if isinstance(answer, Exception):
            raise answer
        values = values_on(*given)
        if answer is not None:  # the print does not turn at all
            flat, known = values.pattern.points, {**values.values, "twist_deg": answer}
            values = replace(values, positions=flat, values=known)
        self.told[number] = values.values["twist_deg"]
        return values


def judged(
    alone: MPI.Comm, patch: pytest.MonkeyPatch, answers: dict[int, Any]
) -> tuple[Judged, Discovery]:
    """A search of two rounds whose prints are all near enough for the finer mesh."""
    spy = Judged(answers)
    patch.setattr(discovery, "print_of_lines", spy.printed)
    patch.setattr(discovery, "values_on", spy.finer)
    patch.setattr(discovery, "mending", lambda *_: None)
    patch.setattr(discovery, "FINE", np.inf)
    patch.setattr(discovery._Search, "enough", lambda *_: False)
    scene = TINY.updated(check_refinement=1.5, estimate_error=True)
    return spy, discover(Job(alone, scene))


@pytest.mark.slow
@pytest.mark.parametrize("worse", [False, True])
def test_prints_are_judged_by_a_finer_mesh(
    alone: MPI.Comm, monkeypatch: pytest.MonkeyPatch, worse: bool
) -> None:
    """The first print near the targets is; the next has what that mesh told beyond."""
    spy, found = judged(alone, monkeypatch, {1: 0.0} if worse else {})
    first, second = found.rounds
    own = [made.printed.metrics["twist_deg"] for made in spy.prints]
    beyond = spy.told[0] - own[0]
    # Read off on the mesh of the print, at its vertices.
    assert first.metrics["twist_deg"] == pytest.approx(spy.told[0], rel=3e-3)
    assert second.metrics["twist_deg"] - own[1] == pytest.approx(beyond, rel=0.2)
    assert abs(beyond) > 1e-4
    assert first.compared
    assert second.compared
    # Each is judged by its own finer mesh, and the better one is taken.
    best, value = (first, spy.told[0]) if worse else (second, spy.told[1])
    assert found.best.laid is best.laid
    assert found.made.regions is spy.prints[int(not worse)].regions
    assert found.best.metrics["twist_deg"] == pytest.approx(value, rel=3e-3)


@pytest.mark.slow
@pytest.mark.parametrize("fails", [0, 1])
def test_a_finer_mesh_may_have_no_equilibrium(
    alone: MPI.Comm, monkeypatch: pytest.MonkeyPatch, fails: int
) -> None:
    """Of the first print: it judges the next one. Of the best print: this counts as it is."""
    failure = NoEquilibriumError("none there.")
    spy, found = judged(alone, monkeypatch, {fails: failure})
    first, second = found.rounds
    assert (first.compared, len(spy.told)) == (fails == 1, 2)
    assert found.best.laid is second.laid
    assert found.best.compared or found.best is second


def test_rounds_with_and_without_a_finer_mesh_are_not_compared() -> None:
    rounds: Any = [SimpleNamespace(compared=one) for one in (False, True, False, True)]
    assert discovery._like_last(rounds) == rounds[1::2]
    assert discovery._like_last(rounds[:3]) == rounds[:3:2]


@pytest.mark.slow
def test_densities_go_on_from_the_lines(alone: MPI.Comm, found: Discovery) -> None:
    designed = densities_from(Job(alone, TINY), found)
    rows = [row for row in designed.history if row.level == 1]
    assert len(rows) == 1 + TINY.lines.density_iterations
    assert rows[0].g_r > 0, "the widths are constrained"


class Untold(tubes.BendScene):
    """Numbers of a tube whose targets are in no field, and whose whole shape counts."""

    @classmethod
    def targets(cls) -> dict[str, str]:
        return {}


@pytest.mark.slow
def test_targets_that_cannot_be_asked_for_end_after_a_round(
    alone: MPI.Comm, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(discovery, "mending", lambda *_: None)
    few = {"relaxed_iterations": 1, "directions": 4, "corrections": 3, "angle": 60.0}
    scene = Untold().updated(**few, **SHORT)
    assert len(discover(Job(alone, scene)).rounds) == 1


@pytest.mark.parametrize(
    ("share", "kept"), [(0.24, True), (0.17, True), (0.26, False), (0.1, False)]
)
def test_lines_keep_their_number_while_widths_take_up_the_shares(share: float, kept: bool) -> None:
    """Widths grow or fall by the root of 1.5; caps do not count."""
    sheet = rectangle(MPI.COMM_SELF, 0.02, 0.01, 5e-3)
    families = [SimpleNamespace(share=0.2), SimpleNamespace(share=0.1)]
    like: Any = SimpleNamespace(families=families, options=LineOptions(spread=1.5))
    printed = np.arange(len(sheet.panel)) < 3
    shares = np.where(printed[:, None], 0.9, [share, 0.1])
    field = LineField(sheet, shares, np.zeros_like(shares))
    assert discovery._widths_suffice(like, field, printed) is kept


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
    aims = {key: Aim(target, abs(target)) for key, target in targets.items()}
    response = np.array([[0.7, 0.1], [-0.4, 0.9]])
    size, rounds = np.array([10.0, 2.0]), []
    asked = dict(targets)
    for _ in range(8):
        scaled = np.array(list(asked.values())) / size
        metrics = dict(zip(targets, size * (response @ scaled + [0.0, 0.1]), strict=True))
        rounds.append(SimpleNamespace(asked=asked, metrics=metrics))
        asked = corrections.asked_next([r.metrics for r in rounds], [r.asked for r in rounds], aims)
    last = rounds[-1].metrics
    assert last == pytest.approx(targets, rel=1e-4)
    for before, after in pairwise(rounds):
        change = np.array([after.asked[k] - before.asked[k] for k in targets]) / size
        assert np.abs(change).max() <= corrections.LARGEST_STEP + 1e-12


def case_of(kind: type[Any] = BendTwistScene, **asked: Any) -> Case:
    """A short tube of a kind, on the mesh of its relaxed design."""
    scene = kind().updated(length=LENGTH, relaxed_edge_length=4e-3, **asked)
    found: Case = scene.case(MPI.COMM_SELF, scene.relaxed_level)
    return found


@pytest.mark.parametrize("kind", [BendTwistScene, ContractScene])
def test_an_asked_shape_has_the_strains_that_are_asked(kind: type[Any]) -> None:
    """Of the whole tube, and of one that is designed by halves."""
    case = case_of(kind)
    residuals = residuals_of(case)
    rod = residuals.rod(case.goal)
    more = np.zeros_like(rod.strains)
    more[:, 1], more[:, 5] = np.linspace(3.0, 6.0, len(more)), 0.04
    asked = residuals.rod(with_strains(residuals, more).goal)
    assert asked.strains == pytest.approx(rod.strains + more, abs=1e-6)
    assert strains_beyond(asked, rod)[1:-1] == pytest.approx(more[1:-1], abs=1e-6)
    # A print that has all of it is asked for the target next.
    answer = StrainResponse(more, more)
    size = np.abs(more).max(axis=0, keepdims=True) + 1e-9
    assert strains_to_ask(rod, [answer]) / size == pytest.approx(0.0, abs=1e-3)


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
