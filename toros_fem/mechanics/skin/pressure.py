"""Pressures of a skin's chambers: coefficients of the forms, and contributions of the walls."""

from __future__ import annotations

from typing import Any

import numpy as np
from dolfinx import fem

from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.compiled_forms import compiled
from toros_fem.base.mpi import sum_over_ranks, total
from toros_fem.forms.energy import SkinForms
from toros_fem.mechanics.skin.chambers import Chambers, Lid, Wall, find_lids, find_walls
from toros_fem.mechanics.skin.coefficients import assembled
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes.skin import Skin


class PressureLoad:
    """Σ P V over the chambers of a closed skin, P the pressures, V the volumes, and derivatives.

    The pressure of a single chamber is a constant of the forms; several chambers have one value a
    triangle. The walls between chambers, and the lids in symmetry planes, are the same on all
    ranks: each rank computes them whole, from positions summed over the ranks, and keeps the
    entries of the unknowns that it owns. All methods are collective.

    Attributes:
        values: Pressure of each chamber in Pa, (k,).
        coefficient: Pressure in the forms.
        origin: Point from which the cones of eq. (7) are taken, (3,), in m: in symmetry planes.
        chosen: Weight of each triangle's chamber in the forms of volume and its variation; None
            with one chamber.
        pairs: Global rows and columns, row ≤ column, of the entries that the walls add to the
            rows of the tangent that this rank owns; (2, p).

    Args:
        skin: The sewn skin.
        chambers: None for one.
        supports: Fixed components and symmetry planes.
        numbers: Global numbers of the owned nodes' position unknowns, (n, 3).
    """

    def __init__(
        self, skin: Skin, chambers: Chambers | None, supports: Supports, numbers: Ints
    ) -> None:
        pattern = skin.pattern
        self._skin, self._chambers = skin, chambers
        self.chosen: Any = None
        self.values: Floats = np.zeros(1 if chambers is None else chambers.count)
        self.origin = supports.closure(pattern).origin
        lids = find_lids(pattern, chambers, supports)
        self._walls: list[Wall | Lid] = [*lids]
        if chambers is None:
            self.coefficient: Any = fem.Constant(skin.mesh, 0.0)
        else:
            self.coefficient = fem.Function(skin.density_space, name="pressure")
            self.chosen = fem.Function(skin.density_space, name="chosen chambers")
            self._walls = [*find_walls(pattern, chambers, supports), *lids]
            self._of_cell = chambers.of_cell[skin.cell]
        self.pairs: Ints = np.zeros((2, 0), dtype=np.int64)
        if self._walls:
            vertices = np.unique(np.concatenate([wall.vertices for wall in self._walls]))
            self._vertices = vertices
            self._at = [np.searchsorted(vertices, wall.vertices) for wall in self._walls]
            self._own = np.flatnonzero(np.isin(skin.owned_vertices, vertices))
            self._place = np.searchsorted(vertices, skin.owned_vertices[self._own])
            self._set_entries(numbers, supports)

    def _set_entries(self, numbers: Ints, supports: Supports) -> None:
        whole = self._spread(numbers[self._own].astype(np.float64)).astype(np.int64)
        owned = np.zeros(len(self._vertices), dtype=bool)
        owned[self._place] = True
        self._entries = []
        pairs = [self.pairs]
        for wall, at in zip(self._walls, self._at, strict=True):
            free = ~supports.fixed[wall.vertices].ravel()
            number, mine = whole[at].ravel(), np.repeat(owned[at], 3) & free
            linked = np.repeat(np.repeat(wall.linked, 3, axis=0), 3, axis=1)
            upper = linked & (number[:, None] <= number[None, :])
            rows, columns = np.nonzero(upper & mine[:, None] & free[None, :])
            self._entries.append((rows, columns))
            pairs.append(np.stack([number[rows], number[columns]]))
        self.pairs = np.concatenate(pairs, axis=1)

    def compile(self, forms: SkinForms, buffer: Any) -> None:
        """Compile volume and its variation; `buffer` is a work vector of the unknowns."""
        self._volume, self._variation = compiled(forms.volume), compiled(forms.volume_variation)
        self._buffer = buffer

    def set(self, values: Floats) -> None:
        """Set the pressures in Pa, (k,)."""
        self.values = values
        if self._chambers is None:
            self.coefficient.value = values[0]
        else:
            self.coefficient.x.array[:] = values[self._of_cell]

    def volume(self, nodes: Floats, weights: Floats) -> float:
        """Return the weighted sum of the chambers' volumes in m³ at the state that is set.

        Args:
            nodes: Positions of the owned nodes, (n, 3), in that state.
            weights: Of each chamber, (k,).
        """
        self._choose(weights)
        whole = total(self._skin.comm, fem.assemble_scalar(self._volume))
        if self._chambers is None:
            whole *= float(weights[0])
        return whole + self.wall_volume(nodes, weights)

    def gradient(self, nodes: Floats, weights: Floats) -> Floats:
        """Return the first variation of `volume` in m², at the owned unknowns."""
        self._choose(weights)
        out = assembled(self._variation, self._buffer)
        if self._chambers is None:
            out *= weights[0]
        out[: nodes.size] += self.wall_gradient(nodes, weights).ravel()
        return out

    def wall_volume(self, nodes: Floats, weights: Floats) -> float:
        """Return the walls' part of `volume`."""
        if not self._walls:
            return 0.0
        x = self._spread(nodes[self._own]) - self.origin
        parts = zip(self._walls, self._at, self._jumps(weights), strict=True)
        return float(sum(jump * wall.volume(x[at]) for wall, at, jump in parts))

    def wall_gradient(self, nodes: Floats, weights: Floats) -> Floats:
        """Return the walls' part of `gradient` at the owned nodes, (n, 3)."""
        out = np.zeros_like(nodes)
        if self._walls:
            x = self._spread(nodes[self._own]) - self.origin
            whole = np.zeros_like(x)
            for wall, at, jump in zip(self._walls, self._at, self._jumps(weights), strict=True):
                np.add.at(whole, at, jump * wall.gradient(x[at]))
            out[self._own] = whole[self._place]
        return out

    def wall_tangent(self, nodes: Floats) -> Floats:
        """Return the walls' entries of the second variation of −Σ P V at `pairs`, in N/m."""
        if not self._walls:
            return np.zeros(0)
        x = self._spread(nodes[self._own]) - self.origin
        parts: list[Floats] = [np.zeros(0)]
        for wall, at, jump, (rows, columns) in zip(
            self._walls, self._at, self._jumps(self.values), self._entries, strict=True
        ):
            parts.append(-jump * wall.hessian(x[at])[rows, columns])
        return np.concatenate(parts)

    def _jumps(self, weights: Floats) -> list[float]:
        """Jump of a weight across each wall, which lies against its first side's triangles."""
        both = np.append(weights, 0.0)  # the last is that of the outside
        return [float(both[wall.sides[1]] - both[wall.sides[0]]) for wall in self._walls]

    def _choose(self, weights: Floats) -> None:
        if self._chambers is not None:
            self.chosen.x.array[:] = weights[self._of_cell]

    def _spread(self, own: Floats) -> Floats:
        """Rows of the walls' vertices, (u, 3), on all ranks, from those this rank owns."""
        whole = np.zeros((len(self._vertices), 3))
        whole[self._place] = own
        return sum_over_ranks(self._skin.comm, whole)
