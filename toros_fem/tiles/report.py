"""What a design of a tile shows while it runs, and leaves behind when it ends."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from mpi4py import MPI
from shapely.affinity import translate
from shapely.geometry.base import BaseGeometry

from toros_fem.design.options import Iteration
from toros_fem.design.problem import Evaluation
from toros_fem.fabrication.printability import printability
from toros_fem.fabrication.svg import write_svg
from toros_fem.meshes.tile import Tile
from toros_fem.output.files import HistoryFile, versions, write_fields, write_json, write_table
from toros_fem.output.writer import if_plotting, write_together
from toros_fem.tiles.as_printed import TileFindings
from toros_fem.tiles.case import TileCase, TileResult
from toros_fem.tiles.objectives import ProfileTarget
from toros_fem.tiles.printed_tile import PrintedTile, write_tile
from toros_fem.tiles.stiffness_profile import Profile

# How many tiles a side are looked at for lines and gaps, the middle one among neighbours.
SIDE = 3
# Contours of neighbouring tiles meet to rounding, over the tile.
SNAP = 1e-7


class TileReporter:
    """One line an iteration, and the history on disk.

    Args:
        comm: Communicator of the whole run.
        folder: Output folder, made if missing.
        target: What is asked of stiffness, if anything is; its worst deviation is shown.
    """

    def __init__(self, comm: MPI.Comm, folder: Path, target: ProfileTarget | None) -> None:
        self._comm, self._folder, self._target = comm, folder, target
        self._file = HistoryFile(folder / "history.csv")
        self.begin = time.perf_counter()

        def start() -> None:
            folder.mkdir(parents=True, exist_ok=True)
            print(
                "  it  stage   objective  worst/%   volume   grey   g_r      g_t     rejected"
                "  newton  seconds",
                flush=True,
            )

        write_together(comm, folder, start)

    def __call__(self, row: Iteration, evaluation: Evaluation[Profile]) -> None:
        """Callback of the design loop (collective)."""
        worst = 0.0 if self._target is None else 100 * self._target.worst(evaluation.equilibrium)

        def show() -> None:
            self._file.write(row, worst_percent=worst)
            print(
                f"{row.iteration:4d}  {row.stage:5d}  {row.objective:10.4e}  {worst:7.2f}"
                f"  {row.volume_fraction:7.3f}  {row.grey_level:5.3f}  {row.g_r:7.1e}"
                f"  {row.g_t:7.1e}  {row.rejected:8d}  {row.newton_steps:6d}"
                f"  {row.seconds:7.2f}",
                flush=True,
            )

        write_together(self._comm, self._folder, show)


def repeated(region: BaseGeometry, tile: Tile, along: int, across: int) -> BaseGeometry:
    """A region of one tile in so many tiles, joined where it meets its copies."""
    size = float(np.abs(tile.lattice).max())
    copies = [
        translate(region, *(i * tile.lattice[0] + j * tile.lattice[1]))
        for i in range(along)
        for j in range(across)
    ]
    return shapely.union_all(copies, grid_size=SNAP * size)


def write_tile_design(
    comm: MPI.Comm,
    folder: Path,
    scene: TileCase,
    outcome: TileResult,
    findings: TileFindings | None,
    made: PrintedTile,
    inputs: dict[str, Any],
    begin: float,
) -> dict[str, Any]:
    """Write summary, pattern, tile.npz, fields and pictures (collective); the summary is returned.

    Args:
        comm: Communicator of the whole run.
        folder: Output folder, which exists.
        scene: What was to be designed.
        outcome: What it came to.
        findings: What was measured of the print; None if that has no equilibrium.
        made: The printed tile as it is filed.
        inputs: Everything that went in.
        begin: `time.perf_counter()` at the start of the whole run.

    Raises:
        OutputError: A file cannot be written.
    """
    printed, result, tile = outcome.printed, outcome.result, scene.tile
    assert printed is not None
    wanted = scene.objective if isinstance(scene.objective, ProfileTarget) else None
    reached, designed = outcome.profile, result.final.equilibrium
    last = result.history[-1]
    limits, widths = outcome.problem.length_scale, result.final.length_scale
    summary: dict[str, Any] = {
        "objective_printed": reached and scene.objective.forward(reached),
        "objective_designed": scene.objective.forward(designed),
        "worst_percent": None if wanted is None or reached is None else 100 * wanted.worst(reached),
        "angles_deg": np.degrees(scene.angles).tolist(),
        "strain": designed.strain,
        "asked": _listed(wanted),
        "printed": reached and _measured(reached),
        "design": _measured(designed),
        "blank_n_per_m": findings and findings.blank,
        "buckling": None
        if findings is None or findings.buckling is None
        else findings.buckling.tolist(),
        "printed_failure": outcome.failure or printed.failure or None,
        "volume_fraction": last.volume_fraction,
        "grey_level": last.grey_level,
        "length_scale": None if limits is None or widths is None else limits.summary(widths),
        "islands": len(outcome.loose),
        "island_areas_mm2": (1e6 * outcome.loose).tolist(),
        "trials": [{"objective": t, "islands": n} for t, n in outcome.trials],
        "corrections_percent": [100 * d if np.isfinite(d) else None for d in outcome.corrections],
        "iterations": last.iteration,
        "newton_steps": sum(row.newton_steps for row in result.history),
        "triangles": len(tile.pattern.panel),
        "ranks": comm.size,
        "reason": result.reason,
        "versions": versions(),
        "inputs": inputs,
    }
    skin = outcome.problem.skin
    fields = {
        "rho": skin.gather_cells(result.density),
        "rho_projected": skin.gather_cells(result.final.projected),
        "printed": printed.cells.astype(np.float64),
    }

    def write() -> None:
        sheet, _ = tile.sheet(SIDE, SIDE)
        region = repeated(printed.regions[0], tile, SIDE, SIDE)
        measured = printability(sheet, [region], printed.limits)
        summary["smallest_width_mm"] = _width(measured.smallest_width)
        summary["smallest_gap_mm"] = _width(measured.smallest_gap)
        summary["seconds"] = {**result.seconds, "total": time.perf_counter() - begin}
        write_json(folder / "summary.json", summary)
        write_svg(folder / "pattern.svg", tile.pattern, printed.regions)
        write_fields(folder / "tile.vtu", tile.pattern, tile.pattern.points, fields)
        write_tile(folder, made)
        if findings is not None:
            write_table(folder / "profile.csv", _rows(findings.profile))
            rows = [row for profile in findings.curves for row in _rows(profile)]
            write_table(folder / "curves.csv", rows)

        def draw() -> None:
            from toros_fem.tiles import plots as profile_plot

            profile_plot.plot_tiles(folder / "pattern.png", tile, region, SIDE)
            profile_plot.plot_history(folder / "convergence.png", result.history)
            if findings is not None:
                profile_plot.plot_curves(folder / "curves.png", findings.curves)
                profile_plot.plot_polar(
                    folder / "profile.png",
                    findings.profile,
                    findings.blank,
                    findings.mirrored,
                    scene.angles,
                    wanted,
                )
            if printed.evaluation is not None:
                state = printed.evaluation.equilibrium.state[0]
                profile_plot.plot_deformed(
                    folder / "deformed.png",
                    tile,
                    printed.cells,
                    skin.gather_vertices(state.positions),
                    state.gradient,
                )

        if_plotting(draw)

    write_together(comm, folder, write)
    # What rank 0 alone has measured.
    return dict(comm.bcast(summary, root=0))


def _width(place: Any) -> float | None:
    return None if place is None else 1e3 * float(place.width)


def _listed(wanted: ProfileTarget | None) -> dict[str, Any] | None:
    if wanted is None:
        return None
    return {
        name: None if values is None else [None if np.isnan(v) else float(v) for v in values]
        for name, values in (
            ("stiffness_n_per_m", wanted.stiffness),
            ("contraction", wanted.contraction),
        )
    }


def _measured(profile: Profile) -> dict[str, Any]:
    return {
        "stiffness_n_per_m": profile.stiffness.tolist(),
        "tangent_n_per_m": profile.tangent.tolist(),
        "contraction": profile.contraction.tolist(),
    }


def _rows(profile: Profile) -> Sequence[dict[str, float]]:
    return [
        {
            "angle_deg": float(np.degrees(profile.angles[k])),
            "strain": profile.strain,
            "stress_n_per_m": float(profile.stress[k]),
            "stiffness_n_per_m": float(profile.stiffness[k]),
            "tangent_n_per_m": float(profile.tangent[k]),
            "contraction": float(profile.contraction[k]),
        }
        for k in range(len(profile.angles))
    ]
