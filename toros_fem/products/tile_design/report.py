"""Files of a tile design: summary, profile, print file, fields and pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.files import write_json, write_table, write_together
from toros_fem.base.scene import Scene
from toros_fem.base.versions import versions
from toros_fem.making.options import ManufactureOptions
from toros_fem.making.panels.svg import write_svg
from toros_fem.making.sheets.write import FOLDER, if_possible, write_manufacture
from toros_fem.products.tile_design.as_printed import PrintMeasurement
from toros_fem.products.tile_design.case import TileCase, TileResult
from toros_fem.products.tiles.objectives import ProfileTarget
from toros_fem.products.tiles.printability import SIDE, repeated
from toros_fem.products.tiles.printed_tile import PrintedTile, write_tile
from toros_fem.products.tiles.sheet import swatch
from toros_fem.products.tiles.stiffness_profile import Profile
from toros_fem.results.files import write_fields
from toros_fem.results.writer import if_plotting


def write_tile_results(
    comm: MPI.Comm,
    folder: str | Path,
    case: TileCase,
    result: TileResult,
    measured: PrintMeasurement | None,
    printed_tile: PrintedTile,
    *,
    config: Scene | None = None,
    seconds: Mapping[str, float] | None = None,
) -> dict[str, Any]:
    """Write summary, pattern, tile.npz, fields and pictures of a design (collective).

    In the folder "manufacture" are the machine files of a swatch of 5 cm × 5 cm.

    Args:
        comm: Communicator of the whole run.
        folder: Output folder, made if missing.
        case: The tile and its target.
        result: Result of the design.
        measured: Measurement of the print; None if it has no equilibrium.
        printed_tile: The printed tile for `write_tile`.
        config: Configuration of the run, for "inputs" in the summary.
        seconds: Further wall times in s, those of the reporter for instance.

    Returns:
        The summary, as in summary.json; equal on all ranks.

    Raises:
        OutputError: A file cannot be written; on all ranks.
    """
    folder, printed, tile, skin = Path(folder), result.printed, case.tile, result.problem.skin
    summary = {
        **_summary(case, result, measured),
        "manufacture": result.printability.summary(),
        "ranks": comm.size,
        "seconds": {**result.result.seconds, **(seconds or {})},
        "versions": versions(),
        "inputs": None if config is None else config.as_dict(),
    }
    summary = dict(comm.bcast(summary, root=0))  # each rank has its own clock
    fields = {
        "rho": skin.gather_cells(result.result.density),
        "rho_projected": skin.gather_cells(result.result.final.projected),
        "printed": printed.cells.astype(np.float64),
    }

    def write() -> None:
        write_json(folder / "summary.json", summary)
        write_svg(folder / "pattern.svg", tile.pattern, printed.regions)
        write_fields(folder / "tile.vtu", tile.pattern, tile.pattern.points, fields)
        write_tile(folder, printed_tile)
        if measured is not None:
            write_table(folder / "profile.csv", _rows(measured.profile))
            rows = [row for profile in measured.curves for row in _rows(profile)]
            write_table(folder / "curves.csv", rows)
        if_plotting(draw)
        cloth, region = swatch(tile, printed.regions[0], printed.cells)
        high = ManufactureOptions(layer_height=printed_tile.composite.reinforcement.thickness)
        place = folder / FOLDER
        if_possible(lambda: write_manufacture(place, cloth, [region], high, summary=summary))

    def draw() -> None:
        from toros_fem.products.tiles import plots

        region = repeated(printed.regions[0], tile, SIDE, SIDE)
        plots.plot_tiles(folder / "pattern.png", tile, region, SIDE)
        plots.plot_history(folder / "convergence.png", result.result.history)
        if measured is not None:
            plots.plot_curves(folder / "curves.png", measured.curves)
            plots.plot_profile(
                folder / "profile.png",
                measured.profile,
                measured.fabric_stiffness,
                case.symmetry,
                case.angles,
                case.target,
            )
        if printed.evaluation is not None:
            state = printed.evaluation.equilibrium.state[0]
            plots.plot_deformed(
                folder / "deformed.png",
                tile,
                printed.cells,
                skin.gather_vertices(state.positions),
                state.gradient,
            )

    write_together(comm, folder, write)
    return summary


def _summary(
    case: TileCase, result: TileResult, measured: PrintMeasurement | None
) -> dict[str, Any]:
    """Return the entries of the summary on print, design and search."""
    target, profile, design = case.target, result.profile, result.result
    designed, last = design.final.equilibrium, design.history[-1]
    limits, widths = result.problem.length_scale, design.final.length_scale
    deviations = [100 * d if np.isfinite(d) else None for d in result.deviations]
    buckling = None if measured is None else measured.buckling
    worst = None
    if target is not None and profile is not None:
        worst = 100 * target.largest_deviation(profile)
    return {
        "objective_printed": profile and case.objective.forward(profile),
        "objective_designed": case.objective.forward(designed),
        "worst_percent": worst,
        "angles_deg": np.degrees(case.angles).tolist(),
        "strain": designed.strain,
        "target": target and _target_values(target),
        "printed": profile and _profile_values(profile),
        "design": _profile_values(designed),
        "blank_n_per_m": measured and measured.fabric_stiffness,
        "buckling": None if buckling is None else buckling.tolist(),
        "printed_failure": result.failure or result.printed.failure or None,
        "volume_fraction": last.volume_fraction,
        "grey_level": last.grey_level,
        "length_scale": None if limits is None or widths is None else limits.summary(widths),
        "trials": [asdict(trial) for trial in result.trials],
        "corrections_percent": deviations,
        "iterations": last.iteration,
        "newton_steps": sum(row.newton_steps for row in design.history),
        "triangles": len(case.tile.pattern.panel),
        "reason": design.reason,
    }


def _target_values(target: ProfileTarget) -> dict[str, Any]:
    return {
        name: None if values is None else [None if np.isnan(v) else float(v) for v in values]
        for name, values in (
            ("stiffness_n_per_m", target.stiffness),
            ("contraction", target.contraction),
        )
    }


def _profile_values(profile: Profile) -> dict[str, Any]:
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
