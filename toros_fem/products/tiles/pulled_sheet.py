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
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
import shapely
from mpi4py import MPI

from toros_fem.base.errors import ParameterError
from toros_fem.base.files import guarded, if_plotting, if_possible, write_table
from toros_fem.base.keys import Count, Distance, Length, OneOf, Positive, Table, key
from toros_fem.base.scene import Scene
from toros_fem.making.panels.svg import write_svg
from toros_fem.making.sheets.write import FOLDER, write_manufacture
from toros_fem.measures.figures import Figure
from toros_fem.products.plausibility import Group, with_lengths
from toros_fem.products.tiles.printed_tile import (
    DIRECTIONS,
    PrintedTile,
    print_layout,
    read_tile,
    tile_sheet,
)
from toros_fem.products.tiles.pull_test import PulledSheet, pull_sheet
from toros_fem.results.console import print_step
from toros_fem.results.result import RunResult, write_summary

# Side of the simple tile in m, the number of edges along it, and the width of its lines in m.
SIDE, EDGES, LINE_WIDTH = 0.01, 14, 1e-3


@dataclass(frozen=True)
class SheetPull(Table):
    """Pull test."""

    direction: Annotated[str, OneOf((*DIRECTIONS, "both"))] = key("both", "direction of the pull")
    along: Count = key(20, "number of tiles along the pull")
    across: Count = key(5, "number of tiles across the pull")
    strain: Positive = key(0.1, "largest strain λ − 1 of the clamps' distance")
    strain_steps: Count = key(5, "number of equal steps up to this strain")
    margin: Distance = key(0.02, "length of unprinted cloth at both ends of the print")


@dataclass(frozen=True)
class SheetMesh(Table):
    """Sizes and mesh."""

    edge_length: Length | None = key(
        None, "edge length of the simulated sheet; none takes that of the tile, times edge_factor"
    )
    edge_factor: Positive = key(
        1.0, "edge length of the simulated sheet over that of the tile, where no length is given"
    )


@dataclass(frozen=True)
class TileSheetScene(Scene):
    """Sheet and pull test."""

    skin: SheetMesh = SheetMesh()
    pull: SheetPull = SheetPull()

    KIND: ClassVar = "tile-sheet"
    SIMULATION_FILES: ClassVar = {"tile": "output folder of a designed tile; none: a simple tile"}
    COARSE: ClassVar = {"edge_length": 2.0, "edge_factor": 2.0, "along": 3 / 5, "across": 3 / 5}
    FEW: ClassVar = ("direction", "along", "across", "strain", "edge_length")

    def groups(self) -> Iterator[Group]:
        """Yield the dimensionless groups of the scene: its lengths over the side of a tile."""
        return with_lengths(self, SIDE, ())

    def run_simulation(
        self,
        comm: MPI.Comm,
        output: Path | str,
        files: Mapping[str, Path] | None = None,
        *,
        verbose: bool = False,
    ) -> RunResult:
        """Write the print file, and pull the sheet of the "tile" or `cross_tile` (collective)."""
        scene = self.of_first_rank(comm)
        begin, folder, given = time.perf_counter(), Path(output), (files or {}).get("tile")
        pull, factor, edge = scene.pull, scene.skin.edge_factor, scene.skin.edge_length
        strains = np.asarray(np.linspace(0.0, pull.strain, pull.strain_steps + 1)[1:], np.float64)
        directions = DIRECTIONS if pull.direction == "both" else (pull.direction,)
        design = cross_tile() if given is None else read_tile(comm, given)
        bound = design.composite.widest_bounds[0] - 1
        if not pull.strain < bound:
            raise ParameterError(
                f"strain = {pull.strain} must be below c1 − 1 = {bound:.6g}, the largest of the "
                "tile's sheets. Give a smaller strain.",
                "strain",
            )
        design = replace(design, edge_length=edge or factor * design.edge_length)
        mesh, printed = design.tile(comm)
        sheets = [tile_sheet(mesh, name, pull.along, pull.across) for name in directions]
        cloth, regions = print_layout(sheets, design.region, pull.margin)
        log, composite = print_step(comm) if verbose else None, design.composite
        pulled = [pull_sheet(comm, sheet, printed, composite, strains, log) for sheet in sheets]
        areas = [float(region.area) for region in regions]
        inputs = {**scene.as_dict(), "tile": None if given is None else str(given)}
        seconds = time.perf_counter() - begin
        found = SheetResult(pulled, design.size, design.share, areas, inputs, seconds)
        summary = found.summary()

        def draw() -> None:
            from toros_fem.products.tiles.plots import plot_pulls, plot_sheet

            plot_pulls(folder / "curve.png", pulled)
            for one in pulled:
                direction, cells = one.sheet.direction, printed[one.sheet.cell]
                title = f"pulled by {100 * pull.strain:g} % along {direction}"
                path = folder / f"sheet_{direction}.png"
                plot_sheet(path, one.sheet.pattern, one.test.positions, cells, title)

        def write() -> None:
            write_svg(folder / "pattern.svg", cloth, regions)
            write_table(folder / "curve.csv", [row for one in pulled for row in one.rows()])
            if_plotting(draw)
            thickness = composite.reinforcement.thickness
            known = {**summary, "inputs": {**inputs, "reinforcement_thickness": thickness}}
            place = folder / FOLDER
            if_possible(
                "machine files", lambda: write_manufacture(place, cloth, regions, summary=known)
            )

        guarded(comm, folder, write)
        write_summary(comm, folder, found)  # last: a run with it has all its files
        return found


@dataclass(frozen=True, eq=False, repr=False)
class SheetResult(RunResult):
    """A sheet of tiles that was pulled in each direction.

    Attributes:
        tile: Sides of a tile in m.
        share: Printed part of its area.
        printed: Printed area of each panel in m².
        inputs: The scene's values, and the folder "tile" that the tile was read from, or None.
    """

    pulled: Sequence[PulledSheet]
    tile: tuple[float, float]
    share: float
    printed: Sequence[float]
    inputs: Mapping[str, Any]
    seconds: float

    @property
    def figures(self) -> tuple[Figure, ...]:
        """Stiffness and contraction of the middle at the largest strain, and as predicted."""
        return tuple(
            Figure(f"{name}_along_{one.sheet.direction}{word}", unit, value)
            for one in self.pulled
            for name, unit in (("stiffness", "n_per_m"), ("contraction", "fraction"))
            for word, value in zip(("", "_predicted"), getattr(one, name), strict=True)
        )

    def entries(self) -> dict[str, Any]:
        """Return the pull in each direction, shares of print, inputs and cost."""
        return {
            "directions": {one.sheet.direction: one.summary() for one in self.pulled},
            "tile_m": self.tile,
            "printed_share": self.share,
            "printed_m2": list(self.printed),
            "triangles": len(self.pulled[0].sheet.cell),
            "seconds": {"total": self.seconds},
            "inputs": dict(self.inputs),
        }

    def description(self) -> str:
        """Return it in a sentence."""
        told = []
        for one in self.pulled:
            f, strain = one.summary(), 100 * one.test.middle_strain[-1]
            clamped = f["between_clamps"]
            told.append(
                f"along {one.sheet.direction} at {strain:.1f} % in the middle: "
                f"{f['stiffness_n_per_m']:.0f} N/m, predicted "
                f"{f['stiffness_predicted_n_per_m']:.0f}; contraction {f['contraction']:.2f}, "
                f"predicted {f['contraction_predicted']:.2f}; by the distance of the clamps "
                f"{clamped['stiffness_n_per_m']:.0f} N/m at {100 * clamped['strain']:g} %"
            )
        return "; ".join(told)


def cross_tile() -> PrintedTile:
    """Return a square tile of the default materials with both diagonals printed."""
    low, high = -SIDE, 2 * SIDE
    ways = shapely.linestrings([[(low, low), (high, high)], [(low, high), (high, low)]])
    lines = shapely.buffer(ways, LINE_WIDTH / 2, cap_style="flat")
    region = shapely.union_all(lines) & shapely.box(0, 0, SIDE, SIDE)
    return PrintedTile(region, (SIDE, SIDE), SIDE / EDGES)
