"""Periodic tiles: their stiffness, sheets of them, and pull tests (Fig. 7)."""

from toros_fem.products.tiles.objectives import Contrast, ProfileObjective, ProfileTarget
from toros_fem.products.tiles.printability import TilePrintability, island_areas, tile_printability
from toros_fem.products.tiles.printed_tile import PrintedTile, read_tile, write_tile
from toros_fem.products.tiles.pull_test import (
    PullCurve,
    PulledSheet,
    PullTest,
    predict,
    pull,
    pull_sheet,
)
from toros_fem.products.tiles.sheet import TileSheet, print_layout, remesh, tile_sheet
from toros_fem.products.tiles.solver import TileSolver, TileState
from toros_fem.products.tiles.stiffness_profile import (
    Profile,
    ProfileSolver,
    effective_tensor,
    merge_profiles,
    profiles,
)

__all__ = [
    "Contrast",
    "PrintedTile",
    "Profile",
    "ProfileObjective",
    "ProfileSolver",
    "ProfileTarget",
    "PullCurve",
    "PullTest",
    "PulledSheet",
    "TilePrintability",
    "TileSheet",
    "TileSolver",
    "TileState",
    "effective_tensor",
    "island_areas",
    "merge_profiles",
    "predict",
    "print_layout",
    "profiles",
    "pull",
    "pull_sheet",
    "read_tile",
    "remesh",
    "tile_printability",
    "tile_sheet",
    "write_tile",
]
