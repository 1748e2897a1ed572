"""Fabrics with designed stiffness: periodic tiles, their profiles, design and pull tests."""

from toros_fem.mechanics.periodicity import ALL_PRESCRIBED, UNIAXIAL, Periodic
from toros_fem.tiles.as_printed import PrintMeasurement, PrintSimulation, measure_print
from toros_fem.tiles.case import TileCase, TileConfig, TileResult, tile_problem
from toros_fem.tiles.objectives import Contrast, ProfileObjective, ProfileTarget
from toros_fem.tiles.printability import TilePrintability, island_areas, tile_printability
from toros_fem.tiles.printed_tile import PrintedTile, read_tile, write_tile
from toros_fem.tiles.problem import TileProblem
from toros_fem.tiles.pull_test import (
    PullCurve,
    PulledSheet,
    PullTest,
    predict,
    pull,
    pull_sheet,
)
from toros_fem.tiles.report import write_tile_results
from toros_fem.tiles.search import design_tile
from toros_fem.tiles.sheet import TileSheet, print_layout, remesh, tile_sheet
from toros_fem.tiles.solver import TileSolver, TileState
from toros_fem.tiles.starts import LineFamily, random_lines, random_waves
from toros_fem.tiles.stiffness_profile import (
    Profile,
    ProfileSolver,
    effective_tensor,
    merge_profiles,
    profiles,
)

__all__ = [
    "ALL_PRESCRIBED",
    "UNIAXIAL",
    "Contrast",
    "LineFamily",
    "Periodic",
    "PrintMeasurement",
    "PrintSimulation",
    "PrintedTile",
    "Profile",
    "ProfileObjective",
    "ProfileSolver",
    "ProfileTarget",
    "PullCurve",
    "PullTest",
    "PulledSheet",
    "TileCase",
    "TileConfig",
    "TilePrintability",
    "TileProblem",
    "TileResult",
    "TileSheet",
    "TileSolver",
    "TileState",
    "design_tile",
    "effective_tensor",
    "island_areas",
    "measure_print",
    "merge_profiles",
    "predict",
    "print_layout",
    "profiles",
    "pull",
    "pull_sheet",
    "random_lines",
    "random_waves",
    "read_tile",
    "remesh",
    "tile_printability",
    "tile_problem",
    "tile_sheet",
    "write_tile",
    "write_tile_results",
]
