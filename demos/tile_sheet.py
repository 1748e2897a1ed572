"""A tile becomes a sheet: a file to print, and its pull test beside what is predicted.

    python demos/sample.py --coarse
    python demos/sample.py --tile output/tile

A designed tile, read from the folder that `demos/tile.py` has written, is laid side by side: 10
along the pull and 5 across. The print file shows the whole sheet true to scale, the lines of
neighbouring tiles joined, with plain cloth to clamp at both ends. The simulated sheet is as long as
the print, since what a clamp holds does not stretch; both its ends are held in all components and
one of them is moved, in the plane. Beside it stands what is predicted of the tile that repeats for
ever, on the same mesh: how stiff it is, and by how much it narrows. Without a tile the demo
takes one drawn by hand, its diagonals as lines of 1 mm.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem._validate import require_choice, require_count, require_positive
from toros_fem.command_line import parsed, run_guarded
from toros_fem.design.config import known_inputs
from toros_fem.fabrication.svg import write_svg
from toros_fem.meshes import tile
from toros_fem.output.console import print_step
from toros_fem.output.files import versions, write_json, write_table
from toros_fem.output.writer import if_plotting, write_together
from toros_fem.tiles.printed_tile import PrintedTile, read_tile
from toros_fem.tiles.pull_test import pull_sheet
from toros_fem.tiles.sheet import print_layout, resampled, sheet_of

DEFAULTS: dict[str, Any] = {
    "direction": "both",  # x, y or both
    "along": 10,  # tiles
    "across": 5,
    "strain": 0.1,
    "levels": 5,  # strains up to that one
    "margin": 0.02,  # m of plain cloth to clamp at either end of the print
    "edge_length": 0.0,  # m, of the sheet that is pulled; 0: that of the tile's own mesh
}
COARSE = {"edge_length": 0.72e-3, "along": 6, "across": 3}
# The tile drawn by hand: lines of four of its mesh's strips, 1.01 mm.
SIZE, EDGES, LINE = 0.01, 28, 1e-3


def cross_lines(comm: MPI.Comm) -> PrintedTile:
    """A square tile of the default materials with its two diagonals printed (collective)."""
    x, y = tile(comm, SIZE, SIZE / EDGES).pattern.centroids.T
    away = [np.abs((d + SIZE / 2) % SIZE - SIZE / 2) for d in (x - y, x + y)]
    printed = np.minimum(*away) < LINE / np.sqrt(2)
    return PrintedTile(printed, (SIZE, SIZE), SIZE / EDGES, symmetry="tetragonal")


def run(
    comm: MPI.Comm,
    output: Path,
    *,
    tile_folder: Path | None = None,
    verbose: bool = False,
    **inputs: Any,
) -> dict[str, Any]:
    """Print and pull the sheet; returns the summary that is also written to `output`.

    Args:
        comm: Communicator.
        output: Folder for print file, summary, curves and pictures.
        tile_folder: Where the tile is; None takes the one drawn by hand.
        verbose: Whether to print every step of the equilibrium solver.
        inputs: What differs from `DEFAULTS`.
    """
    begin = time.perf_counter()
    o = known_inputs(None, DEFAULTS, inputs)
    require_choice("direction", o["direction"], ("x", "y", "both"))
    require_positive(strain=o["strain"])
    require_count(1, levels=o["levels"])
    strains = np.linspace(0.0, o["strain"], o["levels"] + 1)[1:]
    names = "xy" if o["direction"] == "both" else o["direction"]
    design = cross_lines(comm) if tile_folder is None else read_tile(comm, tile_folder)
    simulated = resampled(comm, design, o["edge_length"]) if o["edge_length"] else design
    fine, mesh = design.tile(comm), simulated.tile(comm)
    counts = (o["along"], o["across"])
    sheets = [sheet_of(fine, name, *counts) for name in names]
    cloth, regions = print_layout(sheets, design.printed, o["margin"])
    log = print_step(comm) if verbose else None
    pulled = [
        pull_sheet(comm, sheet_of(mesh, name, *counts), mesh, simulated, strains, log)
        for name in names
    ]
    area = float(np.prod(design.size))
    summary = {
        "directions": {one.sheet.name: one.metrics() for one in pulled},
        "tile_m": design.size,
        "printed_share": float(fine.pattern.areas[design.printed].sum()) / area,
        "printed_share_simulated": float(mesh.pattern.areas[simulated.printed].sum()) / area,
        "printed_m2": [region.area for region in regions],
        "triangles": len(pulled[0].sheet.cell),
        "ranks": comm.size,
        "versions": versions(),
        "inputs": {**o, "tile": None if tile_folder is None else str(tile_folder)},
    }

    def write() -> None:
        output.mkdir(parents=True, exist_ok=True)
        write_svg(output / "pattern.svg", cloth, regions)
        write_table(output / "curve.csv", [row for one in pulled for row in one.rows()])

        def draw() -> None:
            from toros_fem.tiles.plots import plot_pulls, plot_sheet

            curves = [(one.sheet.name, one.test, one.predicted) for one in pulled]
            plot_pulls(output / "curve.png", curves)
            for one in pulled:
                name, pattern = one.sheet.name, one.sheet.pattern
                printed = simulated.printed[one.sheet.cell]
                title = f"pulled by {100 * o['strain']:g} % along {name}"
                plot_sheet(
                    output / f"sheet_{name}.png", pattern, one.test.positions, printed, title
                )

        if_plotting(draw)
        summary["seconds"] = {"total": time.perf_counter() - begin}
        write_json(output / "summary.json", summary)

    write_together(comm, output, write)
    return summary


def sentence(summary: dict[str, Any]) -> str:
    """The result in words."""
    strain = 100 * summary["inputs"]["strain"]
    return "; ".join(
        f"along {name} at {strain:g} %: {f['stiffness_n_per_m']:.0f} N/m of "
        f"{f['stiffness_predicted_n_per_m']:.0f} predicted, contraction {f['contraction']:.2f} of "
        f"{f['contraction_predicted']:.2f}; in the middle {f['middle']['contraction']:.2f} of "
        f"{f['middle']['contraction_predicted']:.2f} at {100 * f['middle']['strain']:.1f} %"
        for name, f in summary["directions"].items()
    )


def main(comm: MPI.Comm) -> int:
    """Run with what the command line says; the exit code is returned."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    folder = Path("output/sample")
    parser.add_argument("--tile", type=Path, help="folder of demos/tile.py; none: drawn by hand")
    parser.add_argument("--coarse", action="store_true", help="a small sheet on a coarse mesh")
    parser.add_argument("--verbose", action="store_true", help="show every Newton step")
    parser.add_argument("--output", type=Path, default=folder, help=f"folder, default {folder}")
    options = parsed(parser, DEFAULTS)
    source = options.pop("tile", None)
    output, small, verbose = (options.pop(name) for name in ("output", "coarse", "verbose"))
    inputs = {**COARSE, **options} if small else options

    def action() -> str:
        summary = run(comm, output, tile_folder=source, verbose=verbose, **inputs)
        return f"{sentence(summary)}; see {output}/"

    return run_guarded(comm, action)


if __name__ == "__main__":
    sys.exit(main(MPI.COMM_WORLD))
