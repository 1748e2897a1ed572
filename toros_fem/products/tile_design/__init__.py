"""Tiles designed towards a profile of stiffness (Fig. 7)."""

from toros_fem.products.tile_design.as_printed import (
    PrintMeasurement,
    PrintSimulation,
    measure_print,
)
from toros_fem.products.tile_design.case import TileCase, TileDesignScene, TileResult, tile_problem
from toros_fem.products.tile_design.problem import TileProblem
from toros_fem.products.tile_design.report import write_tile_results
from toros_fem.products.tile_design.search import design_tile
from toros_fem.products.tile_design.starts import LineFamily, random_lines, random_waves

__all__ = [
    "LineFamily",
    "PrintMeasurement",
    "PrintSimulation",
    "TileCase",
    "TileDesignScene",
    "TileProblem",
    "TileResult",
    "design_tile",
    "measure_print",
    "random_lines",
    "random_waves",
    "tile_problem",
    "write_tile_results",
]
