"""Nodes of a tile that repeats: those across its border are moved by the lattice."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


def placed(patch: Sequence[Any], shifts: Sequence[Any]) -> list[Any]:
    """Return the positions of a patch's nodes, with periodic images where the triangle sees them.

    With x = F̄ x̄ + w and w periodic, a node and its image a flat vector s away lie F̄ s apart. F̄
    is given by its columns along two directions n and t, two further nodes: F̄ s = (s·n) F̄n +
    (s·t) F̄t.

    Args:
        patch: Positions of the corners, of the flaps, the rotations, if there are any, and last
            F̄n and F̄t; or the parts of a variation.
        shifts: (s·n, s·t) in m of each corner and flap, zero inside the tile.

    Returns:
        The patch without F̄n and F̄t.
    """
    *nodes, along, across = patch
    moved = [
        node + shift[0] * along + shift[1] * across
        for node, shift in zip(nodes, shifts, strict=False)
    ]
    return moved + nodes[len(shifts) :]
