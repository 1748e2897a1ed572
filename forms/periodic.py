"""A tile that repeats: what a triangle sees across its border is moved by the lattice."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


def placed(patch: Sequence[Any], shares: Sequence[Any]) -> list[Any]:
    """Positions of a patch's nodes, those of periodic images moved to where the triangle sees them.

    With x = F̄ x̄ + w and w periodic, a node and its image a flat vector s away lie F̄ s apart. F̄ is
    known by its columns along two directions n and t, two nodes of their own: F̄ s = (s·n) F̄n +
    (s·t) F̄t.

    Args:
        patch: Positions of the corners, of the flaps, the rotations, if there are any, and last
            F̄n and F̄t; or the parts of a variation.
        shares: (s·n, s·t) in m of each corner and flap, zero inside the tile.

    Returns:
        The patch without F̄n and F̄t.
    """
    *nodes, along, across = patch
    moved = [
        node + share[0] * along + share[1] * across
        for node, share in zip(nodes, shares, strict=False)
    ]
    return moved + nodes[len(shares) :]
