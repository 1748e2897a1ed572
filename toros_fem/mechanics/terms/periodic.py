"""Tile that repeats: x = F̄ x̄ + w with a periodic w; triangles see images across the border."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, override

import numpy as np
from dolfinx import fem

from toros_fem.base.validation import Bools, Floats, Ints, LocalInts
from toros_fem.mechanics.skin.load import UNSTRETCHED, Load
from toros_fem.mechanics.skin.patch_space import (
    Patch,
    Unknowns,
    blocks_of_first_rank,
    cell_space,
    positions,
    set_cells,
)
from toros_fem.mechanics.terms.term import Term
from toros_fem.meshes.skin import Skin

if TYPE_CHECKING:  # who makes a tile has imported it
    from toros_fem.meshes.tiles import Tile

# Components of F̄, rows n, t, z and columns n, t: a sheet that is pulled along n and free across.
UNIAXIAL = ((True, False), (True, False), (True, True))
# All components prescribed.
ALL_PRESCRIBED = ((True, True), (True, True), (True, True))


@dataclass(frozen=True, eq=False)
class Periodic:
    """A tile and the prescribed components of its mean deformation gradient F̄.

    F̄ is part of the state. Its components belong to the directions n (along), t (across), both in
    the flat sheet and in space, and z (out of the plane).

    Attributes:
        tile: The tile.
        prescribed: Whether each component of F̄ is prescribed, rows n, t, z, columns n, t. The mean
            force of the others is zero. The prescribed ones must keep the tile from turning.
        flat: Whether the sheet stays in its plane; otherwise it may buckle.
    """

    tile: Tile
    prescribed: tuple[tuple[bool, bool], ...] = UNIAXIAL
    flat: bool = True

    @property
    def length(self) -> float:
        """Length in m by which F̄ becomes unknowns in m: that of the tile."""
        return float(np.sqrt(abs(np.linalg.det(self.tile.lattice))))


class Images(Term):
    """Images of a tile's nodes, and the mean deformation gradient F̄ that places them.

    The columns of F̄, times the tile's length, are unknowns of the first rank. Positions and F̄ are
    in axes n, t, z. The term has no energy.

    Attributes:
        periodic: The tile and the prescribed components of F̄.
        shifts: Distance of each node that a triangle sees from the node's own place, in columns of
            F̄ over the tile's length, (cells, nodes, 2).
        images: Whether each node of the owned triangles is an image, (k, nodes).
        dofs: Local unknowns of F̄n and F̄t, (2, 3), on every rank.
    """

    def __init__(self, skin: Skin, periodic: Periodic, *, bends: bool) -> None:
        self.periodic, self._skin = periodic, skin
        tile = periodic.tile
        wraps = tile.wraps[skin.cell]
        if bends:
            wraps = np.concatenate([wraps, _wraps_of_flaps(skin, wraps)], axis=1)
        self._steps = (wraps @ tile.lattice) / periodic.length
        self.images: Bools = np.any(wraps[: len(skin.owned_cells)] != 0, axis=2)
        space = cell_space(skin, 2)
        self.symbols = self._coefficients = [fem.Function(space) for _ in range(wraps.shape[1])]
        self.shifts: Floats = np.zeros_like(self._steps)
        self.turn(0.0)
        columns = np.tile(np.arange(2, dtype=np.int32), (len(wraps), 1))
        blocks, fixed = blocks_of_first_rank(skin.comm, 2), np.array(periodic.prescribed).T
        self.unknowns = Unknowns(blocks, fixed, columns, placed=True)

    def turn(self, angle: float) -> None:
        """Set the angle in rad between n and the first axis of the flat sheet."""
        self._angle = angle
        c, s = np.cos(angle), np.sin(angle)
        self._axes = np.array([[c, -s], [s, c]])
        self.shifts = self._steps @ self._axes
        for k, coefficient in enumerate(self._coefficients):
            set_cells(coefficient, self.shifts[:, k])

    @override
    def place(self, patch: Sequence[Any]) -> Sequence[Any]:
        # F̄ s = (s·n) F̄n + (s·t) F̄t lies between a node and its image a flat vector s away.
        *nodes, along, across = patch
        shifts = self._coefficients
        moved = [
            node + s[0] * along + s[1] * across for node, s in zip(nodes, shifts, strict=False)
        ]
        return moved + nodes[len(shifts) :]

    @override
    def number(self, patch: Patch, dofs: LocalInts) -> None:
        self.dofs = dofs
        self._size = patch.space.dofmap.index_map.size_local

    @override
    def set_load(self, load: Load) -> None:
        if load.angle != self._angle:
            self.turn(load.angle)

    @override
    def add_rest(self, x: Floats) -> None:
        positions(self._skin, x)[:, :2] = self.flat
        self.set_mean_gradient(x, UNSTRETCHED)

    @override
    def moved(self, nodes: Floats, q: Floats) -> Floats:
        moves = self.shifts[: len(self.images), : nodes.shape[1]] @ q[self.dofs]
        return np.asarray(nodes + moves)

    @property
    def flat(self) -> Floats:
        """Positions of the owned nodes in the flat sheet, axes n, t, in m, (k, 2)."""
        places = self._skin.pattern.points[self._skin.owned_vertices, :2]
        return np.asarray(places @ self._axes)

    def stretched(self, x: Floats, load: Load) -> Floats:
        """Return a state with the prescribed F̄ of a load, changed by a homogeneous deformation.

        The first vertex keeps its place (collective).
        """
        wanted = UNSTRETCHED if load.gradient is None else load.gradient
        change = np.where(np.array(self.periodic.prescribed), wanted - self.mean_gradient(x), 0.0)
        added = np.zeros_like(x)
        moved = positions(self._skin, added)
        moved[:] = self.flat @ change.T
        self.set_mean_gradient(added, change)
        moved -= self._skin.comm.allreduce(moved[self._skin.owned_vertices == 0].sum(axis=0))
        return x + added

    def set_mean_gradient(self, x: Floats, gradient: Floats) -> None:
        """Write a mean deformation gradient F̄, (3, 2), into the owned unknowns of a state."""
        owned = self.dofs < self._size
        values = self.periodic.length * np.asarray(gradient).T
        x[self.dofs[owned]] = values[owned]

    def mean_gradient(self, x: Floats) -> Floats:
        """Return F̄ of a state, (3, 2), on every rank (collective)."""
        return np.asarray(self._columns(x).T / self.periodic.length)

    def mean_force(self, variation: Floats) -> Floats:
        """Return ∂E/∂F̄ in J, (3, 2), on every rank, from the first variation of E (collective)."""
        return np.asarray(self.periodic.length * self._columns(variation).T)

    def _columns(self, x: Floats) -> Floats:
        first = self._skin.comm.rank == 0
        return np.asarray(self._skin.comm.bcast(x[self.dofs] if first else None, root=0))


def _wraps_of_flaps(skin: Skin, wraps: Ints) -> Ints:
    """Wraps of the flaps as the triangle sees them, (cells, 3, 2)."""
    corner = skin.position_space.dofmap.list
    neighbour, opposite = skin.neighbours
    first = np.roll(corner, -1, axis=1)
    there = np.argmax(corner[neighbour] == first[:, :, None], axis=2)
    own = np.roll(wraps, -1, axis=1)
    # Both triangles of an edge see its first end. Where they see it at different places, the whole
    # neighbour is shifted by the difference.
    return np.asarray(wraps[neighbour, opposite] + own - wraps[neighbour, there])
