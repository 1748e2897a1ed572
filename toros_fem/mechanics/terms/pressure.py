"""Pressure in a skin's chambers, eq. (7), and what the walls between them contribute."""

from __future__ import annotations

from typing import Any, override

import numpy as np
from dolfinx import fem

from toros_fem.base.array_types import Floats, Ints, LocalInts
from toros_fem.base.mpi import sum_over_ranks, total
from toros_fem.forms.jets import Jet
from toros_fem.forms.kinematics import Triangle, flat_area
from toros_fem.forms.pressure import enclosed_volume
from toros_fem.mechanics.skin.chambers import Chambers, Lid, Wall, find_lids, find_walls
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.patch_space import Patch, positions
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.mechanics.terms.term import PotentialTerm
from toros_fem.meshes.skin import Skin


class Pressure(PotentialTerm):
    """−Σ P V over the chambers of a closed skin, P the pressures, V the volumes.

    The pressure of a single chamber is a constant of the forms; several chambers have one value a
    triangle. The walls between chambers, and the lids in symmetry planes, are the same on all
    ranks: each rank computes them whole, from positions summed over the ranks, and keeps the
    entries of the unknowns that it owns.

    Attributes:
        chambers: As given.
        values: Pressure of each chamber in Pa, (k,).

    Args:
        skin: The sewn skin.
        supports: Fixed components and symmetry planes.
        chambers: None for one.
    """

    def __init__(self, skin: Skin, supports: Supports, chambers: Chambers | None) -> None:
        pattern = skin.pattern
        self._skin, self.chambers, self._supports = skin, chambers, supports
        self.values: Floats = np.zeros(1 if chambers is None else chambers.count)
        # The cones of eq. (7) are taken from a point in the symmetry planes.
        self._origin = supports.closure(pattern).origin
        lids = find_lids(pattern, chambers, supports)
        self._walls: list[Wall | Lid] = [*lids]
        if chambers is None:
            self._pressure: Any = fem.Constant(skin.mesh, 0.0)
        else:
            self._pressure = fem.Function(skin.density_space, name="pressure")
            self._walls = [*find_walls(pattern, chambers, supports), *lids]
            self._of_cell = chambers.of_cell[skin.cell]
        self._point = fem.Constant(skin.mesh, self._origin) if self._origin.any() else None
        if self._walls:
            vertices = np.unique(np.concatenate([wall.vertices for wall in self._walls]))
            self._vertices = vertices
            self._at = [np.searchsorted(vertices, wall.vertices) for wall in self._walls]
            self._own = np.flatnonzero(np.isin(skin.owned_vertices, vertices))
            self._place = np.searchsorted(vertices, skin.owned_vertices[self._own])

    @override
    def of_place(self, t: Triangle) -> Jet | None:
        arms, point = t.corners, self._point
        if point is not None:
            arms = [(at[0] - point[0], at[1] - point[1], at[2] - point[2]) for at in arms]
        return enclosed_volume(arms) * (-self._pressure / flat_area(t.jacobian))

    @override
    def number(self, patch: Patch, dofs: LocalInts) -> None:
        if self._walls:
            self._set_entries(patch.numbers, self._supports)

    def _set_entries(self, numbers: Ints, supports: Supports) -> None:
        whole = self._summed(numbers[self._own].astype(np.float64)).astype(np.int64)
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

    @override
    def set_load(self, load: Load) -> None:
        self.values = load.pressures
        self._set(self.values)

    @override
    def energy(self, x: Floats) -> float:
        return -self._wall_volume(x, self.values)

    @override
    def add_gradient(self, x: Floats, out: Floats) -> None:
        positions(self._skin, out)[:] -= self._wall_gradient(x, self.values)

    @override
    def entries(self, x: Floats, *, definite: bool) -> Floats:
        found = self._wall_tangent(x)
        return np.zeros_like(found) if definite else found

    @override
    def add_applied(self, x: Floats, out: Floats) -> None:
        if self.values.any():
            out += self.gradient(x, self.values)

    @override
    def load_energy(self, x: Floats) -> float:
        return float(self.values @ np.abs(self.volumes(x)))

    def volumes(self, x: Floats) -> Floats:
        """Return the volume of each chamber in m³, (k,), as a closed body (collective)."""
        return np.array([self._volume(x, weights) for weights in np.eye(len(self.values))])

    def _volume(self, x: Floats, weights: Floats) -> float:
        """Return the weighted sum of the chambers' volumes: the potential by such pressures."""
        self._set(weights)
        whole = -total(self._skin.comm, self.potential())
        self._set(self.values)
        return whole + self._wall_volume(x, weights)

    def gradient(self, x: Floats, weights: Floats) -> Floats:
        """Return the first variation of the weighted sum of the volumes in m² (collective)."""
        self._set(weights)
        out = -self.variation()
        self._set(self.values)
        positions(self._skin, out)[:] += self._wall_gradient(x, weights)
        return out

    def _wall_volume(self, x: Floats, weights: Floats) -> float:
        if not self._walls:
            return 0.0
        places = self._spread(x)
        parts = zip(self._walls, self._at, self._jumps(weights), strict=True)
        return float(sum(jump * wall.volume(places[at]) for wall, at, jump in parts))

    def _wall_gradient(self, x: Floats, weights: Floats) -> Floats:
        """Return it at the owned nodes, (n, 3)."""
        out = np.zeros_like(positions(self._skin, x))
        if self._walls:
            places = self._spread(x)
            whole = np.zeros_like(places)
            for wall, at, jump in zip(self._walls, self._at, self._jumps(weights), strict=True):
                np.add.at(whole, at, jump * wall.gradient(places[at]))
            out[self._own] = whole[self._place]
        return out

    def _wall_tangent(self, x: Floats) -> Floats:
        """Return the walls' entries of the second variation of −Σ P V at `pairs`, in N/m."""
        if not self._walls:
            return np.zeros(0)
        places = self._spread(x)
        parts: list[Floats] = [np.zeros(0)]
        for wall, at, jump, (rows, columns) in zip(
            self._walls, self._at, self._jumps(self.values), self._entries, strict=True
        ):
            parts.append(-jump * wall.hessian(places[at])[rows, columns])
        return np.concatenate(parts)

    def _jumps(self, weights: Floats) -> list[float]:
        """Jump of a weight across each wall, which lies against its first side's triangles."""
        both = np.append(weights, 0.0)  # the last is that of the outside
        return [float(both[wall.sides[1]] - both[wall.sides[0]]) for wall in self._walls]

    def _set(self, values: Floats) -> None:
        if self.chambers is None:
            self._pressure.value = values[0]
        else:
            self._pressure.x.array[:] = values[self._of_cell]

    def _spread(self, x: Floats) -> Floats:
        """Positions of the walls' vertices from the origin, (u, 3), on all ranks."""
        return self._summed(positions(self._skin, x)[self._own]) - self._origin

    def _summed(self, own: Floats) -> Floats:
        """Rows of the walls' vertices, (u, 3), on all ranks, from those this rank owns."""
        whole = np.zeros((len(self._vertices), 3))
        whole[self._place] = own
        return sum_over_ranks(self._skin.comm, whole)
