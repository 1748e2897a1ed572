"""The pressures of a skin's chambers: as coefficients, and what their walls add to the forms."""

from __future__ import annotations

from typing import Any

import numpy as np
from dolfinx import fem

from toros_fem._mpi import sum_over_ranks, total
from toros_fem._types import Floats, Ints
from toros_fem.forms.energy import SkinForms
from toros_fem.mechanics.chambers import Chambers, find_walls
from toros_fem.mechanics.coefficients import assembled
from toros_fem.mechanics.supports import Supports
from toros_fem.meshes.skin import Skin


class PressureLoad:
    """Σ P V over the chambers of a closed skin, P the pressures and V the volumes; its derivatives.

    One chamber's pressure is a constant of the forms; of several it is one value a triangle. The
    walls between chambers are the same on all ranks: each computes them whole, from positions
    summed over the ranks, and keeps what belongs to its own unknowns. All methods are collective.

    Attributes:
        values: Pressure of each chamber in Pa, (k,).
        coefficient: Pressure in the forms.
        chosen: In the forms, how much a chamber counts in volume and load; None with one chamber.
        pairs: Global rows and columns, row ≤ column, of the entries the walls add to the tangent,
            of rows that this rank owns; (2, p).

    Args:
        skin: The sewn skin.
        chambers: None for one.
        supports: Held components and symmetry planes.
        numbers: Global numbers of the owned nodes' position unknowns, (n, 3).
    """

    def __init__(
        self, skin: Skin, chambers: Chambers | None, supports: Supports, numbers: Ints
    ) -> None:
        self._skin, self._chambers = skin, chambers
        self.chosen: Any = None
        self.values: Floats = np.zeros(1 if chambers is None else chambers.count)
        self.pairs: Ints = np.zeros((2, 0), dtype=np.int64)
        if chambers is None:
            self.coefficient: Any = fem.Constant(skin.mesh, 0.0)
            self._walls = []
            return
        self.coefficient = fem.Function(skin.density_space, name="pressure")
        self.chosen = fem.Function(skin.density_space, name="chosen chambers")
        self._of_cell = chambers.of_cell[skin.cell]
        self._walls = find_walls(skin.pattern, chambers, supports)
        none: Ints = np.zeros(0, dtype=np.int64)
        vertices = np.unique(np.concatenate([none, *(wall.vertices for wall in self._walls)]))
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
            upper = number[:, None] <= number[None, :]
            rows, columns = np.nonzero(upper & mine[:, None] & free[None, :])
            self._entries.append((rows, columns))
            pairs.append(np.stack([number[rows], number[columns]]))
        self.pairs = np.concatenate(pairs, axis=1)

    def compile(self, forms: SkinForms, buffer: Any) -> None:
        """Compile volume and load; `buffer` is a work vector of the unknowns."""
        self._volume, self._load, self._buffer = (
            fem.form(forms.volume),
            fem.form(forms.load),
            buffer,
        )

    def set(self, values: Floats) -> None:
        """Set the pressures in Pa, (k,)."""
        self.values = values
        if self._chambers is None:
            self.coefficient.value = values[0]
        else:
            self.coefficient.x.array[:] = values[self._of_cell]

    def volume(self, nodes: Floats, weights: Floats) -> float:
        """Sum of the chambers' volumes in m³, weighted, at the state set.

        Args:
            nodes: Positions of the owned nodes, (n, 3), of that state.
            weights: Of each chamber, (k,).
        """
        self._choose(weights)
        whole = total(self._skin.comm, fem.assemble_scalar(self._volume))
        if self._chambers is None:
            return float(weights[0]) * whole
        return whole + self.wall_volume(nodes, weights)

    def load(self, nodes: Floats, weights: Floats) -> Floats:
        """The first variation of `volume`, owned unknowns."""
        self._choose(weights)
        out = assembled(self._load, self._buffer)
        if self._chambers is None:
            return np.asarray(weights[0] * out)
        out[: nodes.size] += self.wall_load(nodes, weights).ravel()
        return out

    def wall_volume(self, nodes: Floats, weights: Floats) -> float:
        """What the walls have in `volume`."""
        if not self._walls:
            return 0.0
        x = self._spread(nodes[self._own])
        parts = zip(self._walls, self._at, self._jumps(weights), strict=True)
        return float(sum(jump * wall.volume(x[at]) for wall, at, jump in parts))

    def wall_load(self, nodes: Floats, weights: Floats) -> Floats:
        """What the walls have in `load`, at the owned nodes, (n, 3)."""
        out = np.zeros_like(nodes)
        if self._walls:
            x = self._spread(nodes[self._own])
            whole = np.zeros_like(x)
            for wall, at, jump in zip(self._walls, self._at, self._jumps(weights), strict=True):
                np.add.at(whole, at, jump * wall.gradient(x[at]))
            out[self._own] = whole[self._place]
        return out

    def wall_tangent(self, nodes: Floats) -> Floats:
        """The walls' entries of the second variation of −Σ P V at `pairs`, in N/m."""
        if not self._walls:
            return np.zeros(0)
        x = self._spread(nodes[self._own])
        parts: list[Floats] = [np.zeros(0)]
        for wall, at, jump, (rows, columns) in zip(
            self._walls, self._at, self._jumps(self.values), self._entries, strict=True
        ):
            parts.append(-jump * wall.hessian(x[at])[rows, columns])
        return np.concatenate(parts)

    def _jumps(self, weights: Floats) -> list[float]:
        """The wall is run through as the first side's triangles are: it lies against them."""
        return [float(weights[wall.sides[1]] - weights[wall.sides[0]]) for wall in self._walls]

    def _choose(self, weights: Floats) -> None:
        if self._chambers is not None:
            self.chosen.x.array[:] = weights[self._of_cell]

    def _spread(self, own: Floats) -> Floats:
        """Rows of the walls' vertices, (u, 3), on all ranks, from those this rank owns."""
        whole = np.zeros((len(self._vertices), 3))
        whole[self._place] = own
        return sum_over_ranks(self._skin.comm, whole)
