"""All kinds of scenes by name; the class of a kind is loaded when it is asked for."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping
from types import MappingProxyType

from toros_fem.base.scene import Scene

# Where the class of each kind is, under toros_fem.products, and what it is.
_SCENES = {
    "bend": ("tubes.BendScene", "a tube that bends"),
    "bend-twist": ("tubes.BendTwistScene", "a tube that bends and twists at once"),
    "contract": ("tubes.ContractScene", "a tube that shortens"),
    "twist": ("tubes.TwistScene", "a tube that twists"),
    "inflate": ("inflate.InflateScene", "a tube without reinforcement that swells"),
    "walker": ("walker.WalkerScene", "an X-shaped robot that stands up or crawls"),
    "gripper": ("gripper.GripperScene", "a gripper whose fingers close on an object"),
    "tile": ("tiles.tile.TileScene", "a periodic fabric of designed stiffness"),
    "own-mesh": ("own_mesh.OwnMeshScene", "a skin of your own, from a mesh file"),
}
ABOUT: Mapping[str, str] = MappingProxyType({name: about for name, (_, about) in _SCENES.items()})


class _Kinds(Mapping[str, type[Scene]]):
    """The kinds by name. Under MPI all ranks ask together, since PETSc starts on all of them."""

    def __getitem__(self, name: str) -> type[Scene]:
        module, _, of = _SCENES[name][0].rpartition(".")
        found: type[Scene] = getattr(importlib.import_module(f"toros_fem.products.{module}"), of)
        return found

    def __iter__(self) -> Iterator[str]:
        return iter(_SCENES)

    def __len__(self) -> int:
        return len(_SCENES)


KINDS: Mapping[str, type[Scene]] = _Kinds()
