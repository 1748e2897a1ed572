"""Loads with a potential: pressure in chambers, eq. (7), the skin's weight; and dead forces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, override

import numpy as np
from dolfinx import fem, la

from toros_fem.base.mpi import sum_over_ranks, total
from toros_fem.base.validation import Floats, Ints, LocalInts, checked_floats, require_between
from toros_fem.forms.jets import Jet, cross, dot
from toros_fem.forms.kinematics import Triangle, flat_area, interpolate
from toros_fem.mechanics.skin.chambers import Chambers, Fan, find_lids, find_walls
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.patch_space import Patch, constants, positions
from toros_fem.mechanics.skin.supports import Planes, Supports
from toros_fem.mechanics.terms.term import Compiled, PotentialTerm, Term
from toros_fem.meshes.skin import Skin

GRAVITY = 9.81  # m/s²


@dataclass(frozen=True)
class Weight:
    """Weight of the skin itself, which changes with the design.

    Attributes:
        fabric, reinforcement: Mass per flat area in kg/m², ≥ 0, of the plain and of the reinforced
            fabric; linear in ρ̄ between them, as the stiffness is.
        gravity: Acceleration in m/s², (gx, gy, gz).
    """

    fabric: float
    reinforcement: float
    gravity: tuple[float, float, float] = (0.0, 0.0, -GRAVITY)

    def __post_init__(self) -> None:
        require_between(0.0, np.inf, fabric=self.fabric, reinforcement=self.reinforcement)
        what = "a finite vector of three components, in m/s²"
        gravity = checked_floats("gravity", self.gravity, what, (3,))
        object.__setattr__(self, "gravity", (gravity[0], gravity[1], gravity[2]))
        object.__setattr__(self, "fabric", float(self.fabric))  # forms take no integers
        object.__setattr__(self, "reinforcement", float(self.reinforcement))


class OwnWeight(PotentialTerm):
    """Potential of the skin's own weight, of which the load says how much acts."""

    def __init__(self, skin: Skin, weight: Weight) -> None:
        self._skin, self._full = skin, np.asarray(weight.gravity)
        self._gravity = fem.Constant(skin.mesh, np.zeros(3))
        self._masses = constants(skin, weight.fabric, weight.reinforcement)
        self.symbols = self._gravity, self._masses

    @override
    def of_place(self, t: Triangle) -> Jet | None:
        a, b, c = t.corners
        middle = [(a[k] + b[k] + c[k]) * (1 / 3) for k in range(3)]
        potential: Jet = dot(middle, [self._gravity[k] for k in range(3)])
        return potential * (-interpolate(t.printed, *self._masses))

    @override
    def set_load(self, load: Load) -> None:
        self._gravity.value[:] = load.weight * self._full

    @override
    def add_applied(self, x: Floats, out: Floats) -> None:
        out -= self.variation()

    @override
    def load_energy(self, x: Floats) -> float:
        return total(self._skin.comm, float(np.abs(self.variation() * x).sum()))


class DeadForce(Term):
    """Dead forces on the vertices; their work counts from the assembled positions."""

    symbols = ()

    def __init__(self, skin: Skin) -> None:
        self._skin = skin
        self._force = np.zeros((len(skin.owned_vertices), 3))

    @override
    def set_load(self, load: Load) -> None:
        self._force[:] = 0 if load.force is None else load.force[self._skin.owned_vertices]

    def _work(self, x: Floats) -> Floats:
        skin = self._skin
        moved = positions(skin, x) - skin.pattern.points[skin.owned_vertices]
        return np.asarray(self._force * moved)

    @override
    def energy(self, x: Floats) -> float:
        return -total(self._skin.comm, float(self._work(x).sum()))

    @override
    def add_gradient(self, x: Floats, out: Floats) -> None:
        positions(self._skin, out)[:] -= self._force

    @override
    def add_applied(self, x: Floats, out: Floats) -> None:
        positions(self._skin, out)[:] += self._force

    @override
    def load_energy(self, x: Floats) -> float:
        return total(self._skin.comm, float(np.abs(self._work(x)).sum()))


class Pressure(PotentialTerm):
    """−Σ P V over the chambers of a closed skin, P the pressures, V the volumes.

    The pressure of a single chamber is a constant of the forms; several chambers have one value a
    triangle. The walls between chambers, and the lids in symmetry planes, are the same on all
    ranks: each rank computes them whole, from positions summed over the ranks, and keeps the
    entries of the unknowns that it owns.

    Attributes:
        chambers: As given; None for one.
        values: Pressure of each chamber in Pa, (k,).
    """

    def __init__(
        self, skin: Skin, supports: Supports, planes: Planes, chambers: Chambers | None
    ) -> None:
        pattern = skin.pattern
        self._skin, self.chambers, self._supports = skin, chambers, supports
        self.values: Floats = np.zeros(1 if chambers is None else chambers.count)
        self._walls = find_lids(pattern, chambers, planes)
        if chambers is None:
            self._pressure: Any = fem.Constant(skin.mesh, 0.0)
        else:
            self._pressure = fem.Function(skin.density_space, name="pressure")
            self._walls = find_walls(pattern, chambers, planes) + self._walls
            self._of_cell = chambers.of_cell[skin.cell]
        # The cones of eq. (7) are taken from a point in the symmetry planes.
        self._origin = planes.origin
        self._point = fem.Constant(skin.mesh, self._origin) if self._origin.any() else None
        self.symbols = self._pressure, self._point
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
        # The sum of x₀·(x₁ × x₂)/6 over a closed skin oriented outwards is its volume, eq. (7).
        six: Jet = dot(arms[0], cross(arms[1], arms[2]))
        return six * (1 / 6) * (-self._pressure / flat_area(t.jacobian))

    @override
    def number(self, patch: Patch, dofs: LocalInts) -> None:
        self._entries: list[tuple[Ints, Ints]] = []
        if not self._walls:
            return
        whole = self._summed(patch.numbers[self._own].astype(np.float64)).astype(np.int64)
        owned = np.zeros(len(self._vertices), dtype=bool)
        owned[self._place] = True
        pairs = []
        for wall, at in zip(self._walls, self._at, strict=True):
            free = ~self._supports.fixed[wall.vertices].ravel()
            number, mine = whole[at].ravel(), np.repeat(owned[at], 3) & free
            linked = np.repeat(np.repeat(wall.linked, 3, axis=0), 3, axis=1)
            upper = linked & (number[:, None] <= number[None, :])
            rows, columns = np.nonzero(upper & mine[:, None] & free[None, :])
            self._entries.append((rows, columns))
            pairs.append(np.stack([number[rows], number[columns]]))
        self.pairs = np.concatenate(pairs, axis=1)

    @property
    def wall_vertices(self) -> Ints:
        """Vertices of the walls between chambers and of the lids that are counted, (k,)."""
        return self._vertices if self._walls else np.zeros(0, dtype=np.int64)

    def beyond_skin(self, x: Floats) -> Floats:
        """Return the part of the first variation in N that is no pressure on the skin, (n, 3).

        A pressure P gives each corner of a triangle a third of its force. The derivatives of the
        cones of eq. (7) do so inside the skin, and lack P a × b/6 at both ends of a free edge from
        a to b; lids have a part at their vertices (collective).
        """
        pattern, out = self._skin.pattern, np.zeros_like(positions(self._skin, x))
        ends = pattern.free_edges  # as their triangles run
        if not len(ends) or not self.values.any():
            return out
        places = self._skin.gather_vertices(positions(self._skin, x)) - self._origin
        acting: Any = self.values[0]
        if self.chambers is not None:
            cells = pattern.edges.twins[pattern.edges.border, 0] // 3
            acting = self.values[self.chambers.of_cell[cells], None]
        at_border = np.zeros_like(places)
        turned = acting * np.cross(*places[ends].transpose(1, 0, 2)) / 6
        np.add.at(at_border, ends[:, 0], turned)
        np.add.at(at_border, ends[:, 1], turned)
        lids = self._wall_gradient(x, self.values, lids_alone=True)
        return at_border[self._skin.owned_vertices] - lids

    @override
    def take_forms(self, number: int, compiled: Compiled, work: la.Vector) -> None:
        super().take_forms(number, compiled, work)
        self._potential = compiled("volume", lambda forms: forms.loads[number][0])

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
        if definite or not self._walls:
            return np.zeros(self.pairs.shape[1])
        parts = [
            -jump * wall.hessian(places, *entries)
            for (wall, _, places, jump), entries in zip(
                self._placed(x, self.values), self._entries, strict=True
            )
        ]
        return np.concatenate(parts)

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
        whole = -total(self._skin.comm, fem.assemble_scalar(self._potential))
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
        placed = self._placed(x, weights)
        return float(sum(jump * wall.volume(places) for wall, _, places, jump in placed))

    def _wall_gradient(self, x: Floats, weights: Floats, *, lids_alone: bool = False) -> Floats:
        """Return it at the owned nodes, (n, 3)."""
        out = np.zeros_like(positions(self._skin, x))
        if self._walls:
            whole = np.zeros((len(self._vertices), 3))
            for wall, at, places, jump in self._placed(x, weights):
                if wall.sides[1] < 0 or not lids_alone:
                    np.add.at(whole, at, jump * wall.gradient(places))
            out[self._own] = whole[self._place]
        return out

    def _placed(self, x: Floats, weights: Floats) -> list[tuple[Fan, Ints, Floats, float]]:
        """Each wall, its vertices among `_vertices`, their places, and the weights' jump across it.

        A wall lies against the triangles of its first side. Outside the skin the weight is 0.
        """
        if not self._walls:
            return []
        places = self._summed(positions(self._skin, x)[self._own]) - self._origin
        both = np.append(weights, 0.0)
        return [
            (wall, at, places[at], float(both[wall.sides[1]] - both[wall.sides[0]]))
            for wall, at in zip(self._walls, self._at, strict=True)
        ]

    def _set(self, values: Floats) -> None:
        if self.chambers is None:
            self._pressure.value = values[0]
        else:
            self._pressure.x.array[:] = values[self._of_cell]

    def _summed(self, own: Floats) -> Floats:
        """Rows of the walls' vertices, (u, 3), on all ranks, from those this rank owns."""
        whole = np.zeros((len(self._vertices), 3))
        whole[self._place] = own
        return sum_over_ranks(self._skin.comm, whole)
