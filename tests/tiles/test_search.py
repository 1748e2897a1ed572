"""The design of a tile from start to files: starts, print, corrections, report."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

from demos import tile as demo
from toros_fem import errors
from toros_fem.design.loop import optimize
from toros_fem.meshes import SYMMETRIES, tile
from toros_fem.tiles import search as tile_search
from toros_fem.tiles.case import TileConfig, TileResult, wavy
from toros_fem.tiles.islands import loose_pieces
from toros_fem.tiles.plots import around
from toros_fem.tiles.printed_tile import read_tile
from toros_fem.tiles.search import design_tile

# T of the first start after its trial, the same on any number of ranks.
FIRST_TRIAL = 0.19989329212699072

SMALL_MESH: dict[str, Any] = {"edge_length": 0.8e-3}
SMALL_LOOP: dict[str, Any] = {
    "radius": 2e-3,
    "starts": 2,
    "trial": 2,
    "iterations": 2,
    "finish": 2,
    "retry": 2,
}
SMALL: dict[str, Any] = {**SMALL_MESH, **SMALL_LOOP, "correct": 1}


def test_demo(comm: MPI.Comm, tmp_path: Path) -> None:
    folder = comm.bcast(tmp_path, root=0) / "tile"
    summary = demo.run(comm, folder, **SMALL)
    comm.barrier()
    written = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assert written["ranks"] == comm.size
    assert written["printed"] == summary["printed"]
    assert len(summary["trials"]) == 2
    assert len(summary["corrections_percent"]) in (1, 2)
    assert summary["worst_percent"] == pytest.approx(min(summary["corrections_percent"]))
    asked = np.array(summary["asked"]["stiffness_n_per_m"])
    assert asked[[0, -1]] == pytest.approx([2000, 400])
    printed = np.array(summary["printed"]["stiffness_n_per_m"])
    assert summary["worst_percent"] == pytest.approx(100 * np.abs(printed / asked - 1).max())
    assert summary["trials"][0]["objective"] == pytest.approx(FIRST_TRIAL, rel=1e-6)
    with (folder / "profile.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    angles = [float(row["angle_deg"]) for row in rows]
    assert angles == pytest.approx(np.linspace(0, 45, 7), abs=1e-9)
    values = [float(row["stiffness_n_per_m"]) for row in rows]
    assert values[::2] == pytest.approx(printed, rel=1e-9)
    # What lies between was solved for by itself.
    assert np.abs(np.diff(values, 2)).max() < 0.2 * np.ptp(values)
    assert len(summary["buckling"]) == len(asked)
    assert summary["blank_n_per_m"] == pytest.approx(50.5, rel=1e-3)
    made = read_tile(comm, folder)
    cells = made.tile(comm).pattern.areas[made.printed].sum() / 1e-4
    assert 0 < cells < 1
    with (folder / "curves.csv").open(encoding="utf-8") as file:
        curves = list(csv.DictReader(file))
    assert len(curves) == 4 * len(asked)
    assert float(curves[-1]["strain"]) == 0.1
    assert float(curves[-1]["stiffness_n_per_m"]) == pytest.approx(printed[-1], rel=1e-8)
    for name in ("profile", "pattern", "deformed", "convergence", "curves"):
        assert (folder / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    assert (folder / "tile.vtu").exists()
    assert (folder / "pattern.svg").exists()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"target": "softest"}, "target = 'softest'"),
        ({"strain": -1.5}, "strain = -1.5"),
        ({"starts": 0}, "starts = 0"),
        ({"finish": 0}, "finish = 0"),
        ({"radius": 6e-3}, "wider than twice the radius"),
        ({"edge_length": 3e-3}, "edge_length = 0.003"),
        ({"stiffness_45": -3.0}, "stiffness_45 = -3"),
        ({"presure": 1.0}, "'presure' is no parameter"),
    ],
)
def test_bad_input(comm: MPI.Comm, tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(errors.ParameterError, match=message):
        demo.run(comm, tmp_path / "out", **{**SMALL, **changes})


def test_search_passes_over_starts_that_fail(
    comm: MPI.Comm, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without an equilibrium, with islands; and it ends where all that is asked is done."""
    wanted = demo.scene(comm, {**demo.DEFAULTS, **SMALL_MESH})
    settings = TileConfig(
        **{**SMALL_LOOP, "starts": 4, "trial": 1, "iterations": 1, "finish": 1},
        constrained=0,
        correct=0,
        tolerance=20.0,
    )
    counts = iter([0, 0, 3, 2, 0])
    monkeypatch.setattr(tile_search, "loose_pieces", lambda *_: [1.0] * next(counts, 0))
    done = design_tile(comm, wanted, settings)
    assert len(done.trials) == 1
    run, broken = optimize, iter([False, True])

    def failing(*args: Any, **kwargs: Any) -> Any:
        if next(broken, False):
            raise errors.NoEquilibriumError("made to fail")
        return run(*args, **kwargs)

    monkeypatch.setattr(tile_search, "optimize", failing)
    found = design_tile(comm, wanted, settings)
    assert [islands for _, islands in found.trials] == [3, 2, 0]
    assert found.trials[0] == (done.trials[0][0], 3)
    assert found.result.history[0].objective != done.result.history[0].objective


def test_no_start_has_an_equilibrium(comm: MPI.Comm, monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = demo.scene(comm, {**demo.DEFAULTS, **SMALL_MESH})

    def failing(*args: Any, **kwargs: Any) -> Any:
        raise errors.NoEquilibriumError("made to fail")

    monkeypatch.setattr(tile_search, "optimize", failing)
    with pytest.raises(errors.NoEquilibriumError, match="made to fail"):
        design_tile(comm, wanted, TileConfig(starts=2, radius=2e-3))


def test_the_other_draft_gets_its_turn(comm: MPI.Comm, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the print of the better one is far off, or it has no equilibrium on its own mesh."""
    wanted = demo.scene(comm, {**demo.DEFAULTS, "edge_length": 1e-3})
    settings = TileConfig(starts=3, radius=2.5e-3, trial=1, iterations=1, constrained=0)
    islands = iter([1, 2, 0])
    monkeypatch.setattr(tile_search, "loose_pieces", lambda *_: [1.0] * next(islands, 0))
    run = tile_search._best_starts
    ends: list[float | None] = []
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
        return TileResult(problem, drafted, None, None, "", np.zeros(0), (), (end,))

    monkeypatch.setattr(tile_search, "_best_starts", once)
    monkeypatch.setattr(tile_search, "_made", made)
    cases: list[tuple[list[float | None], float]] = [
        ([0.03], 0.03),
        ([0.3, 0.1], 0.1),
        ([0.2, 0.3], 0.2),
        ([None, 0.3], 0.3),
    ]
    for case, chosen in cases:
        drafts.clear()
        ends[:] = case
        found = design_tile(comm, wanted, settings)
        assert min(found.corrections) == chosen
        assert found.result is drafts[ends.index(chosen)]
        assert [count for _, count in found.trials] == [1, 2, 0]
        assert len(drafts) == len(ends)
    drafts.clear()
    ends[:] = [None, None]
    with pytest.raises(errors.NoEquilibriumError, match="made to fail"):
        design_tile(comm, wanted, settings)
    assert len(drafts) == 2


@pytest.mark.parametrize("name", list(demo.TARGETS))
def test_targets(comm: MPI.Comm, name: str) -> None:
    made = demo.scene(comm, {**demo.DEFAULTS, "edge_length": 1e-3, "target": name})
    assert made.coarse is not None
    assert made.fine is not None
    assert 4 * len(made.coarse.pattern.panel) == len(made.tile.pattern.panel)
    assert len(made.fine.pattern.panel) == 4 * len(made.tile.pattern.panel)
    assert made.angles[0] == 0
    assert len(made.tile.symmetry_maps(made.symmetry)) == len(SYMMETRIES[made.symmetry])


def test_linear_profile() -> None:
    angles = np.radians([0, 45, 90])
    assert demo.linear_profile(angles, 5.0, 2.0, 1.0) == pytest.approx([5, 2, 1])
    assert demo.linear_profile(np.linspace(0, 1, 5), 3.0, 3.0, 3.0) == pytest.approx(3.0)


def test_islands_of_a_tile(comm: MPI.Comm) -> None:
    """A line through the border is none, a spot is one, also across the border."""
    patch = tile(comm, 0.01, 1e-3)
    x, y = 1e3 * patch.pattern.centroids.T
    line = np.abs(y - 5) < 1
    spot = np.hypot(x - 5, y - 9) < 0.9
    corner = np.hypot((x + 5) % 10 - 5, (y + 5) % 10 - 5) < 2
    assert len(loose_pieces(patch, line)) == 0
    assert len(loose_pieces(patch, np.abs((x + y) % 10 - 5) < 1)) == 0
    areas = patch.pattern.areas
    assert loose_pieces(patch, line | spot) == pytest.approx([areas[spot].sum()])
    assert loose_pieces(patch, corner) == pytest.approx([areas[corner].sum()])
    assert loose_pieces(patch, corner | line | spot) == pytest.approx(
        [areas[corner].sum(), areas[spot].sum()]
    )
    assert len(loose_pieces(patch, np.ones(len(x), dtype=bool))) == 0
    assert len(loose_pieces(patch, np.zeros(len(x), dtype=bool))) == 0


def test_starts_are_periodic(comm: MPI.Comm) -> None:
    patch = tile(comm, 0.01, 0.25e-3)
    density = wavy(patch, 3)
    assert density.min() >= 0.1
    assert density.max() <= 0.9
    x, y = patch.pattern.centroids.T
    low, high = (x < 0.2e-3), (x > 9.8e-3)
    left = density[low][np.argsort(y[low], kind="stable")]
    right = density[high][np.argsort(y[high], kind="stable")]
    assert np.abs(left - right).mean() < 0.05
    assert np.abs(left - right[::-1]).mean() > 0.1, "borders do not agree by chance"
    assert np.ptp(density) > 0.5


def test_profile_all_around() -> None:
    angles = np.radians([0.0, 22.5, 45.0])
    turn, value = around(angles, np.array([3.0, 2.0, 1.0]), (True, True))
    assert len(turn) == 17
    assert np.diff(turn) == pytest.approx(np.pi / 8)
    assert value == pytest.approx([3, 2, 1, 2] * 4 + [3])
