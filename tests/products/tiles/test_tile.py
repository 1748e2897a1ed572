"""The tile as a product, its search, and its starts."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.tiles import EDGES, SIDE, SMALL, small_case, tile_of
from mpi4py import MPI
from scipy.spatial import cKDTree

from toros_fem import errors
from toros_fem.base.errors import NoEquilibriumError
from toros_fem.design.loop.loop import optimize
from toros_fem.making.contours import Widths
from toros_fem.meshes import SYMMETRIES
from toros_fem.products.tiles import tile as demo
from toros_fem.products.tiles.problem import TilePrintability, TileResult, simulated_print
from toros_fem.products.tiles.stiffness_profile import Contrast, Profile
from toros_fem.products.tiles.tile import (
    LineFamily,
    design_tile,
    random_families,
    random_lines,
    random_waves,
)

SHORT = SMALL.updated(
    filter_radius=2.5e-3, trial_iterations=1, draft_iterations=1, finish_iterations=1,
    constrained=False, corrections=0,
)  # fmt: skip


@pytest.mark.parametrize("target", list(demo.TARGETS))
def test_targets(alone: MPI.Comm, target: str) -> None:
    case = demo.tile_case(alone, demo.TileScene.of(target=target, edge_length=1e-3))
    coarse, own = (len(one.tile.wraps) for one in (case.coarse, case))
    assert 4 * coarse == own
    assert case.angles[0] == 0
    assert len(case.tile.symmetry_maps(case.symmetry)) == len(SYMMETRIES[case.symmetry])
    assert (case.target is None) == (target == "anisotropic")


def test_own_stiffnesses(alone: MPI.Comm) -> None:
    """Options override the target's own values."""
    config = demo.TileScene.of(target="orthotropic", edge_length=1e-3, stiffness_90=900.0)
    case = demo.tile_case(alone, config)
    assert case.target.stiffness[[0, 3, 6]] == pytest.approx([4000, 1000, 900])


def test_coarse_variant() -> None:
    small = demo.TileScene.of(target="auxetic", seed=5).coarse()
    found = (small.target.target, small.design.seed, small.skin.edge_length)
    assert found == ("auxetic", 5, 0.2e-3)


def test_linear_profile() -> None:
    angles = np.radians([0, 45, 90])
    assert demo.linear_profile(angles, 5.0, 2.0, 1.0) == pytest.approx([5, 2, 1])
    assert demo.linear_profile(np.linspace(0, 1, 5), 3.0, 3.0, 3.0) == pytest.approx(3.0)


def test_doubts_are_told_before_a_design(
    alone: MPI.Comm,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    def stop(*_: object) -> None:
        raise NoEquilibriumError("far enough.")

    monkeypatch.setattr(demo, "design_tile", stop)
    scene = demo.TileScene.of(target="anisotropic", edge_length=1e-3, stiffness_90=100.0)
    with pytest.raises(NoEquilibriumError, match="far enough"):
        scene.run_design(alone, tmp_path)
    assert "stiffness_90" in caplog.text
    assert "does not count" in caplog.text


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

    monkeypatch.setattr(demo, "optimize", run)
    monkeypatch.setattr(demo, "simulated_print", printed)
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

    monkeypatch.setattr(demo, "optimize", failing)
    for broke, flaws, islands, narrow in (
        ([], [(0, 0)], [0], [0]),
        ([False, True], [(0, 3), (2, 0), (0, 0)], [0, 2, 0], [3, 0, 0]),
    ):
        counts = iter(flaws)
        monkeypatch.setattr(
            demo, "tile_printability", lambda *_, at=counts: with_flaws(*next(at, (0, 0)))
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

    monkeypatch.setattr(demo, "optimize", once)
    monkeypatch.setattr(demo, "simulated_print", simulate)
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


def test_random_waves() -> None:
    """Waves are periodic, within bounds, and differ by seed."""
    tile = tile_of(EDGES)
    one, other = random_waves(tile, 1), random_waves(tile, 2)
    for density in (one, other):
        assert density.min() >= 0.1
        assert density.max() <= 0.9
        assert np.ptp(density) > 0.4
    assert np.abs(one - other).max() > 0.1
    x, y = 2 * np.pi * tile.pattern.centroids.T / SIDE
    # Waves of at most three periods along each side span 49 functions.
    waves = [f(i * x) * g(j * y) for i in range(4) for j in range(4)
             for f in (np.cos, np.sin) for g in (np.cos, np.sin)]  # fmt: skip
    inside = (one > 0.1) & (one < 0.9)
    fit = np.transpose(waves)[inside]
    rest = one[inside] - fit @ np.linalg.lstsq(fit, one[inside], rcond=None)[0]
    assert np.abs(rest).max() < 1e-12


@pytest.mark.parametrize("normal", [(0, 1), (1, 0), (1, -1)])
def test_straight_lines(normal: tuple[int, int]) -> None:
    """The depth inside straight lines is exact, on an oblong tile too."""
    tile = tile_of(EDGES, shape=(1.0, 1.5))
    sides = np.diagonal(tile.lattice)
    depth = LineFamily(normal, 2e-3, offset=0.25).depth(tile)
    across = np.array(normal) / sides
    height = tile.pattern.centroids @ across + 0.25
    distance = np.abs(height - np.rint(height)) / np.linalg.norm(across)
    assert depth == pytest.approx(1e-3 - distance, abs=1e-15)


def test_wavy_lines() -> None:
    """A wavy line has its width across the wave, to a few per cent."""
    tile = tile_of(8 * EDGES)
    family = LineFamily((0, 1), 2e-3, offset=-0.5, amplitude=0.1, waves=2, shift=0.25)
    t = np.linspace(-0.2, 1.2, 20001)
    centres = SIDE * np.column_stack([t, 0.5 - 0.1 * np.sin(2 * np.pi * 2 * t)])
    away, _ = cKDTree(centres).query(tile.pattern.centroids)
    depth = family.depth(tile)
    near = away < 1.2e-3
    assert depth[near] == pytest.approx(1e-3 - away[near], abs=1.5e-4)
    assert (depth[~near] < 0).all()


@pytest.mark.parametrize("symmetry", sorted(SYMMETRIES))
def test_lines_fit_the_symmetry(symmetry: str) -> None:
    """Lines are symmetric, and do not cross their own images, but for a family turned across."""
    tile = tile_of(4 * EDGES, symmetry=symmetry)
    maps = tile.symmetry_maps(symmetry)
    rng, again = np.random.default_rng(3), np.random.default_rng(3)
    drawn = [random_lines(tile, rng, symmetry, SIDE / 14) for _ in range(12)]
    for density in drawn:
        assert (density[maps] == density).all()
        assert density.min() == 0.1
        assert density.max() > 0.8
    families = [family for _ in drawn for family in random_families(again, symmetry, SIDE / 14)]
    assert {family.amplitude > 0 for family in families} == {True, False}
    assert {np.abs(family.normal).sum() for family in families} == {1, 2}
    for one, other in zip(families[::2], families[1::2], strict=True):
        assert np.dot(one.normal, other.normal) == 0
    for family in families:
        inside = family.depth(tile) > 0
        for operation, image in zip(SYMMETRIES[symmetry], maps, strict=True):
            if abs(operation @ family.normal @ family.normal) > 0:
                moved = inside[image]
                assert (moved == inside).all() or not (moved & inside).any()
