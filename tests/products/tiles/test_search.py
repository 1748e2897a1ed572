"""Search for a tile: starts, drafts, corrections for the print."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers.tiles import SMALL, small_case
from mpi4py import MPI

from toros_fem import errors
from toros_fem.design.loop.loop import optimize
from toros_fem.making.contours import Widths
from toros_fem.products.tiles import search
from toros_fem.products.tiles.printability import TilePrintability
from toros_fem.products.tiles.problem import TileResult, simulated_print
from toros_fem.products.tiles.search import design_tile, random_lines, random_waves
from toros_fem.products.tiles.stiffness_profile import Contrast, Profile

SHORT = SMALL.updated(
    filter_radius=2.5e-3, trial_iterations=1, draft_iterations=1, finish_iterations=1,
    constrained=False, corrections=0,
)  # fmt: skip


def with_flaws(islands: int, narrow: int = 0) -> TilePrintability:
    """Return the printability of a print with numbers of islands and of narrow lines."""
    places: Any = narrow * (None,)
    return TilePrintability(np.ones(islands), Widths(None, places), Widths(None, ()))


@pytest.mark.slow
def test_design(alone: MPI.Comm, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two trials, two drafts and the last design with a correction; the best print is returned."""
    case, runs, prints = small_case(alone, 1.25e-3), [], []

    def run(problem: Any, options: Any, **given: Any) -> Any:
        result = optimize(problem, options, **given)
        runs.append((problem, options, given.get("start"), result))
        return result

    def printed(*given: Any) -> TileResult:
        prints.append(simulated_print(*given))
        return prints[-1]

    monkeypatch.setattr(search, "optimize", run)
    monkeypatch.setattr(search, "simulated_print", printed)
    found = design_tile(case, SHORT.updated(corrections=1, correction_iterations=1))
    stages = [[(s.iterations, s.beta) for s in options.stages] for _, options, _, _ in runs]
    trial, draft = [(1, 20.0), (1, 80.0)], [(1, 80.0)]
    assert stages[:6] == [trial, trial, draft, draft, [(1, 80.0)], [(1, None)]]
    # Families of lines whose T is the smallest of eight pairs, then waves.
    problem, _, start, result = runs[0]
    rng, owned = np.random.default_rng(SMALL.design.seed), problem.skin.owned_cells
    pairs = [random_lines(case.coarse.tile, rng, case.symmetry, 2.5e-3)[owned] for _ in range(8)]
    objectives = [problem.simulate(density, trial=True).objective for density in pairs]
    assert (start == pairs[int(np.argmin(objectives))]).all()
    waves = random_waves(case.coarse.tile, SMALL.design.seed + 1)
    assert (runs[1][2] == waves[owned]).all()
    assert [trial["start"] for trial in found.trials] == ["lines", "waves"]
    assert found.trials[0]["objective"] == result.final.objective
    # What a print loses is asked on top: a design that meets it loses as much again.
    target, designed, first = case.target, runs[4][3].final.equilibrium, prints[0].profile
    asked = target.stiffness * designed.stiffness / first.stiffness
    assert runs[5][0].objective.stiffness == pytest.approx(asked)
    worst = [target.largest_deviation(made.profile) for made in prints if made.profile]
    assert list(found.deviations) in (worst[:2], worst[2:])
    assert found.deviation == min(found.deviations)
    assert found.problem.fields.projection.beta == 80.0


def test_contrast_needs_no_correction(alone: MPI.Comm) -> None:
    case = small_case(alone, 1.25e-3)
    stiff = np.array([True, False, False, False])
    found = design_tile(replace(case, objective=Contrast(~stiff, stiff)), SHORT.updated(starts=1))
    assert found.deviations == ()
    assert found.profile is not None
    assert found.result.history[-1].metrics == {}


def test_starts_without_equilibrium_or_with_flaws(
    alone: MPI.Comm, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The one is left out, the other rated worse; a start that reaches the target is the last."""
    case, config = small_case(alone, 1e-3), SHORT.updated(starts=5, tolerance=90.0)
    broken: list[bool] = []

    def failing(*args: Any, **kwargs: Any) -> Any:
        if broken.pop(0) if broken else False:
            raise errors.NoEquilibriumError("made to fail")
        return optimize(*args, **kwargs)

    monkeypatch.setattr(search, "optimize", failing)
    for broke, flaws, islands, narrow in (
        ([], [(0, 0)], [0], [0]),
        ([False, True], [(0, 3), (2, 0), (0, 0)], [0, 2, 0], [3, 0, 0]),
    ):
        counts = iter(flaws)
        monkeypatch.setattr(
            search, "tile_printability", lambda *_, at=counts: with_flaws(*next(at, (0, 0)))
        )
        broken[:] = broke
        found = design_tile(case, config)
        assert [trial["islands"] for trial in found.trials] == islands
        assert [trial["narrow"] for trial in found.trials] == narrow
    broken[:] = 9 * [True]
    with pytest.raises(errors.NoEquilibriumError, match="made to fail"):
        design_tile(case, config)


def test_second_draft(alone: MPI.Comm, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is tried if the print of the first is far off, has flaws, or has no equilibrium."""
    case, config = small_case(alone, 1.25e-3), SHORT.updated(starts=2)
    kept: list[Any] = []
    prints: list[tuple[float | None, int]] = []
    target = case.target

    def once(*args: Any, **kwargs: Any) -> Any:
        """The first run for all: only their prints differ here."""
        kept[:] = kept or [optimize(*args, **kwargs)]
        return kept[0]

    def simulate(case: Any, config: Any, problem: Any, result: Any) -> TileResult:
        off, islands = prints.pop(0)
        if off is None:
            raise errors.NoEquilibriumError("made to fail")
        ones, nothing, unknown = np.ones(4), (), 3 * (None,)
        stress = 0.1 * (1 + off) * target.stiffness
        profile = Profile(case.angles, 0.1, stress, ones, ones, ones, nothing, nothing, 0, 0)
        made = None if np.isinf(off) else profile
        flaws = with_flaws(islands)
        return TileResult(case, config, problem, result, *unknown, made, "", flaws)  # type: ignore[arg-type]

    monkeypatch.setattr(search, "optimize", once)
    monkeypatch.setattr(search, "simulated_print", simulate)
    rows: list[tuple[list[tuple[float | None, int]], float]] = [
        ([(0.03, 0)], 0.03),
        ([(0.3, 0), (0.1, 0)], 0.1),
        ([(0.2, 0), (0.3, 0)], 0.2),
        ([(None, 0), (0.3, 0)], 0.3),
        ([(0.01, 1), (0.04, 0)], 0.04),
        ([(0.01, 1), (0.07, 0)], 0.01),
    ]
    for made, chosen in rows:
        prints[:] = made
        found = design_tile(case, config)
        assert found.deviation == pytest.approx(chosen)
        assert not prints
    contrast = replace(case, objective=Contrast(case.angles > 0, case.angles == 0))
    kept[:], prints[:] = [], [(np.inf, 0), (0.0, 0)]
    assert design_tile(contrast, config).profile is not None
    kept[:], prints[:] = [], [(None, 0), (None, 0)]
    with pytest.raises(errors.NoEquilibriumError, match="made to fail"):
        design_tile(case, config)
    assert not prints
