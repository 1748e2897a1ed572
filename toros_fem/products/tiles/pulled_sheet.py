"""A sheet of tiles: a file to print, and a pull test beside its prediction.

A designed tile is read from the output folder of `demos/tile.py` and laid side by side: 10 along
the pull and 5 across. The print file shows the whole sheet in true scale. The lines of neighbouring
tiles are joined, and there is unprinted cloth for clamps at both ends. The simulated sheet is as
long as the print, since the cloth inside a clamp does not stretch. Both its ends are fixed in all
components and one of them moves, in the plane. The prediction is that of the periodic tile on the
same mesh: its stiffness and its lateral contraction. Without a tile the demo takes a simple one,
with its diagonals as lines of 1 mm.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from mpi4py import MPI

from toros_fem.base.files import write_json, write_table, write_together
from toros_fem.base.keys import Count, Distance, Length, OneOf, Positive, Table, key
from toros_fem.base.scene import Scene
from toros_fem.base.versions import versions
from toros_fem.making.options import ManufactureOptions
from toros_fem.making.panels.svg import write_svg
from toros_fem.making.sheets.write import FOLDER, if_possible, write_manufacture
from toros_fem.meshes import tile
from toros_fem.products.tiles.printed_tile import PrintedTile, read_tile
from toros_fem.products.tiles.pull_test import pull_sheet
from toros_fem.products.tiles.sheet import DIRECTIONS, print_layout, remesh, tile_sheet
from toros_fem.results.console import print_step
from toros_fem.results.writer import if_plotting

# Side of the simple tile in m, the number of edges along it, and the width of its lines in m.
SIDE, EDGES, LINE_WIDTH = 0.01, 28, 1e-3


@dataclass(frozen=True)
class SheetPull(Table):
    """Pull test."""

    direction: Annotated[str, OneOf((*DIRECTIONS, "both"))] = key("both", "direction of the pull")
    along: Count = key(10, "number of tiles along the pull")
    across: Count = key(5, "number of tiles across the pull")
    strain: Positive = key(0.1, "largest strain λ − 1 of the clamps' distance")
    strain_steps: Count = key(5, "number of equal steps up to this strain")
    margin: Distance = key(0.02, "length of unprinted cloth at both ends of the print")


@dataclass(frozen=True)
class SheetMesh(Table):
    """Sizes and mesh."""

    edge_length: Length | None = key(
        None, "edge length of the simulated sheet; none takes the tile's own mesh"
    )


@dataclass(frozen=True)
class TileSheetScene(Scene):
    """Sheet and pull test."""

    skin: SheetMesh = SheetMesh()
    pull: SheetPull = SheetPull()

    KIND: ClassVar[str] = "tile-sheet"
    SIMULATION_FILES: ClassVar[Mapping[str, str]] = {
        "tile": "output folder of a designed tile; none: a simple tile"
    }
    FEW: ClassVar[tuple[str, ...]] = ("direction", "along", "across", "strain", "edge_length")

    def coarse(self) -> Self:
        """Return the quick variant: a small sheet on a coarse mesh."""
        return self.updated(edge_length=0.72e-3, along=6, across=3)

    def run_simulation(
        self,
        comm: MPI.Comm,
        output: Path | str,
        files: Mapping[str, Path] | None = None,
        *,
        verbose: bool = False,
    ) -> dict[str, Any]:
        """Write the print file, pull the sheet, and return the summary (collective).

        Args:
            comm: Communicator.
            output: Folder for print file, summary, curves and pictures.
            files: Folder of the printed "tile"; without it `cross_tile` is taken.
            verbose: Whether to print every step of the equilibrium solver.
        """
        begin, folder, given = time.perf_counter(), Path(output), (files or {}).get("tile")
        strains = np.asarray(
            np.linspace(0.0, self.pull.strain, self.pull.strain_steps + 1), dtype=np.float64
        )[1:]
        directions = DIRECTIONS if self.pull.direction == "both" else (self.pull.direction,)
        design = cross_tile(comm) if given is None else read_tile(comm, given)
        simulated = design
        if self.skin.edge_length is not None:
            simulated = remesh(comm, design, self.skin.edge_length)
        designed_mesh, mesh = design.tile(comm), simulated.tile(comm)
        counts = (self.pull.along, self.pull.across)
        sheets = [tile_sheet(designed_mesh, direction, *counts) for direction in directions]
        cloth, regions = print_layout(sheets, design.printed, self.pull.margin)
        log = print_step(comm) if verbose else None
        pulled = [
            pull_sheet(comm, tile_sheet(mesh, direction, *counts), mesh, simulated, strains, log)
            for direction in directions
        ]
        area = float(np.prod(design.size))
        summary = {
            "directions": {one.sheet.direction: one.summary() for one in pulled},
            "tile_m": design.size,
            "printed_share": float(designed_mesh.pattern.areas[design.printed].sum()) / area,
            "printed_share_simulated": float(mesh.pattern.areas[simulated.printed].sum()) / area,
            "printed_m2": [region.area for region in regions],
            "triangles": len(pulled[0].sheet.cell),
            "ranks": comm.size,
            "seconds": {"total": time.perf_counter() - begin},
            "versions": versions(),
            "inputs": {**self.as_dict(), "tile": None if given is None else str(given)},
        }

        def draw() -> None:
            from toros_fem.products.tiles.plots import plot_pulls, plot_sheet

            plot_pulls(folder / "curve.png", pulled)
            for one in pulled:
                direction, printed = one.sheet.direction, simulated.printed[one.sheet.cell]
                title = f"pulled by {100 * self.pull.strain:g} % along {direction}"
                path = folder / f"sheet_{direction}.png"
                plot_sheet(path, one.sheet.pattern, one.test.positions, printed, title)

        def write() -> None:
            write_svg(folder / "pattern.svg", cloth, regions)
            write_table(folder / "curve.csv", [row for one in pulled for row in one.rows()])
            write_json(folder / "summary.json", summary)
            if_plotting(draw)
            high = ManufactureOptions(layer_height=design.composite.reinforcement.thickness)
            place = folder / FOLDER
            if_possible(lambda: write_manufacture(place, cloth, regions, high, summary=summary))

        write_together(comm, folder, write)
        return summary

    def told_simulation(self, summary: Mapping[str, Any]) -> str:
        """Return the result in a sentence."""
        strain, told = 100 * summary["inputs"]["strain"], []
        for name, f in summary["directions"].items():
            middle = f["middle"]
            told.append(
                f"along {name} at {strain:g} %: {f['stiffness_n_per_m']:.0f} N/m, predicted "
                f"{f['stiffness_predicted_n_per_m']:.0f}; contraction {f['contraction']:.2f}, "
                f"predicted {f['contraction_predicted']:.2f}; in the middle "
                f"{middle['contraction']:.2f}, predicted {middle['contraction_predicted']:.2f} at "
                f"{100 * middle['strain']:.1f} %"
            )
        return "; ".join(told)


def cross_tile(comm: MPI.Comm) -> PrintedTile:
    """Return a square tile of the default materials with both diagonals printed (collective)."""
    x, y = tile(comm, SIDE, SIDE / EDGES).pattern.centroids.T
    distances = [np.abs((d + SIDE / 2) % SIDE - SIDE / 2) for d in (x - y, x + y)]
    printed = np.minimum(*distances) < LINE_WIDTH / np.sqrt(2)
    return PrintedTile(printed, (SIDE, SIDE), SIDE / EDGES, symmetry="tetragonal")
