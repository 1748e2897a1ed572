"""The public names of meshes, which `toros_fem.meshes` hands on once one of them is asked for."""

from toros_fem.meshes.border_mesh import bordered
from toros_fem.meshes.files import from_mesh, read_pattern, read_surface, write_pattern
from toros_fem.meshes.outlines import (
    GRIPPER,
    WALKER,
    Star,
    finger,
    gripper,
    plane_centroids,
    rounded,
    two_panels,
    walker,
)
from toros_fem.meshes.pattern import Mirrored, Pattern, mirrored
from toros_fem.meshes.seams import Remeshed, remeshed
from toros_fem.meshes.sheets import cylinder, disc, moulded, rectangle
from toros_fem.meshes.skin import Skin, sew
from toros_fem.meshes.surface import Surface
from toros_fem.meshes.targets import Deformer, bend, compose, contract, curl, stand, twist
from toros_fem.meshes.tiles import SYMMETRIES, Repeated, Tile, tile
from toros_fem.meshes.triangles import triangle_limit
from toros_fem.meshes.unwrapped import Unwrapped, unwrap

__all__ = [
    "GRIPPER", "SYMMETRIES", "WALKER", "Deformer", "Mirrored", "Pattern", "Remeshed", "Repeated",
    "Skin", "Star", "Surface", "Tile", "Unwrapped", "bend", "bordered", "compose", "contract",
    "curl", "cylinder", "disc", "finger", "from_mesh", "gripper", "mirrored", "moulded",
    "plane_centroids", "read_pattern", "read_surface", "rectangle", "remeshed", "rounded", "sew",
    "stand", "tile", "triangle_limit", "twist", "two_panels", "unwrap", "walker", "write_pattern",
]  # fmt: skip
