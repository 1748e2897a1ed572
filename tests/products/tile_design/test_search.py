"""Search for a tile: starts, drafts, corrections for the print."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers.tiles import SMALL, small_case
from mpi4py import MPI

from toros_fem import errors
from toros_fem.design.loop.loop import DesignResult, optimize
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.products.tile_design import search
from toros_fem.products.tile_design.case import TileCase, TileResult, Trial, tile_problem
from toros_fem.products.tile_design.problem import TileProblem
from toros_fem.products.tile_design.search import design_tile
from toros_fem.products.tile_design.starts import random_lines
from toros_fem.products.tiles.objectives import Contrast
from toros_fem.products.tiles.printability import TilePrintability
from toros_fem.products.tiles.stiffness_profile import Profile


def with_islands(count: int) -> TilePrintability:
    """Return the printability of a print with a number of islands and no other flaw."""
    return TilePrintability(np.ones(count), None, None, (), ())


def test_lines_that_start(comm: MPI.Comm, monkeypatch: pytest.MonkeyPatch) -> None:
    """The pair of families with the smallest T is taken; one without an equilibrium is left out."""
    case = small_case(comm, 1.6e-3)
    problem = tile_problem(MPI.COMM_SELF, case, SMALL)
    rng, owned = np.random.default_rng(5), problem.skin.owned_cells
    every = [random_lines(case.tile, rng, case.symmetry, 2e-3)[owned] for _ in range(8)]
    objectives = [problem.simulate(density, trial=True).objective for density in every]
    order = np.argsort(objectives)
    assert (search._lines(problem, case, 5) == every[order[0]]).all()
    run, broken = TileProblem.simulate, [every[order[0]]]

    def failing(self: TileProblem, density: np.ndarray, **kwargs: Any) -> Any:
        if any((density == one).all() for one in broken):
            raise errors.NoEquilibriumError("made to fail")
        return run(self, density, **kwargs)

    monkeypatch.setattr(TileProblem, "simulate", failing)
    assert (search._lines(problem, case, 5) == every[order[1]]).all()
    broken.extend(every)
    with pytest.raises(errors.NoEquilibriumError, match="made to fail"):
        search._lines(problem, case, 5)


def test_charge_for_flaws(comm: MPI.Comm) -> None:
    """T counts fivefold for islands, and fivefold for lines or gaps that cannot be printed."""
    case = small_case(comm)
    config = SMALL.updated(constrained=False)
    problem = tile_problem(MPI.COMM_SELF, case, config)
    x, y = case.tile.pattern.centroids.T
    net = (np.abs(x - 0.005) < 0.002) | (np.abs(y - 0.005) < 0.002)
    spot = np.hypot(x - 0.005, y - 0.005) < 0.003
    for printed, width, islands, factor in (
        (net, 0.6e-3, 0, 1),
        (net, 9e-3, 0, 5),
        (spot, 0.6e-3, 1, 5),
        (spot, 9e-3, 1, 25),
    ):
        density = printed[problem.skin.owned_cells].astype(np.float64)
        result = DesignResult(problem, density, problem.simulate(density), (), "", {})
        limited = config.updated(print_width=width)
        rating, made = search._rated(problem, case.tile, limited, DesignOptions(), result)
        assert len(made.island_areas) == islands
        assert rating == pytest.approx(factor * result.final.objective)


@pytest.mark.slow
def test_design(comm: MPI.Comm) -> None:
    """The first trial is a run of the design loop; the chosen print is the best of all."""
    case = small_case(comm)
    rows: list[Any] = []
    found = design_tile(comm, case, SMALL, lambda row, _: rows.append(row))
    assert case.target is not None
    assert len(found.trials) == 2
    assert case.coarse is not None
    # On each rank alone, from the same seed.
    coarse = TileCase(case.coarse, case.angles, case.objective, case.symmetry)
    stages = (Stage(2, 20.0, constrained=True), Stage(2, 80.0, constrained=True))
    options = DesignOptions(stages, target_objective=1e-4, min_relative_decrease=0.05)
    problem = tile_problem(MPI.COMM_SELF, coarse, SMALL)
    start = search._lines(problem, coarse, SMALL.seed)
    alone = optimize(problem, options, start=start)
    assert found.trials[0].objective == pytest.approx(alone.final.objective, rel=1e-6)
    assert [row.objective for row in rows[: len(alone.history)]] == pytest.approx(
        [row.objective for row in alone.history], rel=1e-6
    )
    assert [trial.start for trial in found.trials] == ["lines", "waves"]
    # One print before and one after the correction; one of them is returned.
    assert len(found.deviations) == 2
    assert found.profile is not None
    worst = case.target.largest_deviation(found.profile)
    assert worst == pytest.approx(found.deviation, rel=1e-12)
    assert found.deviation in found.deviations
    assert found.problem.projection.beta == 160.0
    last = found.result.history[-1]
    designed = found.result.final.equilibrium
    assert last.metrics["worst_percent"] == pytest.approx(
        100 * case.target.largest_deviation(designed), rel=1e-9
    )


def test_correction_of_the_target(comm: MPI.Comm) -> None:
    """A design that meets the corrected target loses as much by printing, and meets the target."""
    case = small_case(comm)
    target = case.target
    assert target is not None
    assert target.stiffness is not None
    angles, ones = case.angles, np.ones(4)
    designed, printed = (
        Profile(angles, 0.1, s * ones, ones, c * ones, ones, (), (), 0, 0)
        for s, c in ((60.0, 0.3), (48.0, 0.2))
    )
    both = replace(target, contraction=np.array([0.1, np.nan, 0.2, 0.3]))
    corrected = search._corrected(both, designed, printed)
    assert corrected.stiffness == pytest.approx(1.25 * target.stiffness)
    assert corrected.contraction == pytest.approx([0.2, np.nan, 0.3, 0.4], nan_ok=True)
    assert search._corrected(target, designed, printed).contraction is None


def test_contrast_needs_no_correction(comm: MPI.Comm) -> None:
    case = small_case(comm, 1e-3)
    stiff = np.array([True, False, False, False])
    case = replace(case, objective=Contrast(~stiff, stiff))
    config = SMALL.updated(filter_radius=2.5e-3, starts=1, trial_iterations=1, draft_iterations=1,
                           finish_iterations=1, constrained=False)  # fmt: skip
    found = design_tile(comm, case, config)
    assert found.deviations == ()
    assert found.profile is not None
    assert found.result.history[-1].metrics == {}


def test_failed_starts_are_left_out(comm: MPI.Comm, monkeypatch: pytest.MonkeyPatch) -> None:
    """A start without an equilibrium is left out; one that reaches the target ends the search."""
    case = small_case(comm)
    config = SMALL.updated(
        starts=4,
        trial_iterations=1,
        draft_iterations=1,
        finish_iterations=1,
        constrained=False,
        corrections=0,
        tolerance=20.0,
    )
    counts = iter([0, 0, 3, 2, 0])
    monkeypatch.setattr(search, "tile_printability", lambda *_: with_islands(next(counts, 0)))
    done = design_tile(comm, case, config)
    assert len(done.trials) == 1
    run, broken = optimize, iter([False, True])

    def failing(*args: Any, **kwargs: Any) -> Any:
        if next(broken, False):
            raise errors.NoEquilibriumError("made to fail")
        return run(*args, **kwargs)

    monkeypatch.setattr(search, "optimize", failing)
    found = design_tile(comm, case, config)
    assert [trial.islands for trial in found.trials] == [3, 2, 0]
    assert found.trials[0] == Trial("lines", done.trials[0].objective, 3, 0)
    assert found.result.history[0].objective != done.result.history[0].objective


def test_no_start_has_an_equilibrium(comm: MPI.Comm, monkeypatch: pytest.MonkeyPatch) -> None:
    case = small_case(comm)

    def failing(*args: Any, **kwargs: Any) -> Any:
        raise errors.NoEquilibriumError("made to fail")

    monkeypatch.setattr(search, "optimize", failing)
    with pytest.raises(errors.NoEquilibriumError, match="made to fail"):
        design_tile(comm, case, SMALL)


def test_second_draft(comm: MPI.Comm, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is tried if the print of the first is far off, has flaws, or has no equilibrium."""
    case = small_case(comm, 1e-3)
    config = SMALL.updated(starts=3, filter_radius=2.5e-3, trial_iterations=1, draft_iterations=1,
                           constrained=False)  # fmt: skip
    islands = iter([1, 2, 0])
    monkeypatch.setattr(search, "tile_printability", lambda *_: with_islands(next(islands, 0)))
    run = search._best_starts
    ends: list[float | None] = []
    flaws: list[int] = []
    kept: list[Any] = []
    drafts: list[Any] = []

    def once(*args: Any) -> Any:
        if not kept:
            kept.append(run(*args))
        return kept[0]

    def made(problem: Any, drafted: Any, *_: Any) -> TileResult:
        drafts.append(drafted)
        end = ends[len(drafts) - 1]
        if end is None:
            raise errors.NoEquilibriumError("made to fail")
        printed: Any = None
        measured = with_islands(flaws[len(drafts) - 1])
        return TileResult(problem, drafted, printed, None, "", measured, (), end, (end,))

    monkeypatch.setattr(search, "_best_starts", once)
    monkeypatch.setattr(search, "_finished", made)
    cases: list[tuple[list[float | None], list[int], float]] = [
        ([0.03], [0], 0.03),
        ([0.3, 0.1], [0, 0], 0.1),
        ([0.2, 0.3], [0, 0], 0.2),
        ([None, 0.3], [0, 0], 0.3),
        ([0.01, 0.04], [1, 0], 0.04),
        ([0.01, 0.07], [1, 0], 0.01),
    ]
    for expected, numbers, chosen in cases:
        drafts.clear()
        ends[:], flaws[:] = expected, numbers
        found = design_tile(comm, case, config)
        assert min(found.deviations) == chosen
        assert found.result is drafts[ends.index(chosen)]
        assert [trial.islands for trial in found.trials] == [1, 2, 0]
        assert len(drafts) == len(ends)
    drafts.clear()
    ends[:] = [None, None]
    with pytest.raises(errors.NoEquilibriumError, match="made to fail"):
        design_tile(comm, case, config)
    assert len(drafts) == 2
