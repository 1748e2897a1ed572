"""Panels, seams and the sewn skin; ready-made patterns; target shapes."""

from toros_fem.meshes.cylinder import cylinder
from toros_fem.meshes.deformed import from_mesh
from toros_fem.meshes.mirror import Mirrored, mirrored
from toros_fem.meshes.moulded import moulded
from toros_fem.meshes.outline import plane_centroids, two_panels
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.pattern_file import read_pattern, write_pattern
from toros_fem.meshes.planar import rounded
from toros_fem.meshes.robots import GRIPPER, WALKER, Star, finger, gripper, walker
from toros_fem.meshes.sheet import disc, rectangle
from toros_fem.meshes.skin import Skin, sew
from toros_fem.meshes.surface import Surface
from toros_fem.meshes.surface_file import read_surface
from toros_fem.meshes.targets import Deformer, bend, compose, contract, curl, stand, twist
from toros_fem.meshes.tile import Repeated, Tile, tile
from toros_fem.meshes.tile_symmetry import SYMMETRIES
from toros_fem.meshes.triangle_limit import triangle_limit
from toros_fem.meshes.unwrap import Unwrapped, unwrap

__all__ = [
    "GRIPPER",
    "SYMMETRIES",
    "WALKER",
    "Deformer",
    "Mirrored",
    "Pattern",
    "Repeated",
    "Skin",
    "Star",
    "Surface",
    "Tile",
    "Unwrapped",
    "bend",
    "compose",
    "contract",
    "curl",
    "cylinder",
    "disc",
    "finger",
    "from_mesh",
    "gripper",
    "mirrored",
    "moulded",
    "plane_centroids",
    "read_pattern",
    "read_surface",
    "rectangle",
    "rounded",
    "sew",
    "stand",
    "tile",
    "triangle_limit",
    "twist",
    "two_panels",
    "unwrap",
    "walker",
    "write_pattern",
]
