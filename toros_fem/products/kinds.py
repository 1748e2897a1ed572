"""All kinds of scenes by name."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from toros_fem.base.scene import Scene
from toros_fem.products.gripper.gripper import GripperScene
from toros_fem.products.own_mesh.own_mesh import OwnMeshScene
from toros_fem.products.tile_design.tile import TileScene
from toros_fem.products.tiles.pulled_sheet import TileSheetScene
from toros_fem.products.tubes.bend import BendScene
from toros_fem.products.tubes.bend_twist import BendTwistScene
from toros_fem.products.tubes.contract import ContractScene
from toros_fem.products.tubes.inflate import InflateScene
from toros_fem.products.tubes.twist import TwistScene
from toros_fem.products.walker.walker import WalkerScene

_SCENES: tuple[type[Scene], ...] = (
    BendScene,
    BendTwistScene,
    ContractScene,
    TwistScene,
    InflateScene,
    WalkerScene,
    GripperScene,
    TileScene,
    TileSheetScene,
    OwnMeshScene,
)
KINDS: Mapping[str, type[Scene]] = MappingProxyType({scene.KIND: scene for scene in _SCENES})
