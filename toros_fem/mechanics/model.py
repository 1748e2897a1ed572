"""A skin's energy, forces and tangent, assembled: the forms meet the mesh here."""

from __future__ import annotations

from typing import Any

import basix.ufl
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, la

from toros_fem._mpi import dot, total
from toros_fem._types import Floats, LocalInts
from toros_fem.forms.energy import SkinForms, skin_forms
from toros_fem.forms.interpolation import interpolate
from toros_fem.materials import Composite
from toros_fem.mechanics.chambers import Chambers
from toros_fem.mechanics.coefficients import (
    assembled,
    edge_coefficients,
    masses,
    sheet_stiffness,
    work_vector,
)
from toros_fem.mechanics.dead_loads import Weight
from toros_fem.mechanics.hinges import edge_angles, find_hinges
from toros_fem.mechanics.patch_space import make_patch
from toros_fem.mechanics.periodicity import Periodic, PeriodicImages
from toros_fem.mechanics.pressure import PressureLoad
from toros_fem.mechanics.stretch_bounds import StretchBounds
from toros_fem.mechanics.supports import Supports
from toros_fem.meshes.skin import Skin


class SkinModel:
    """Energy, first variation, tangent and density sensitivity of one scene.

    Only what the scene needs is compiled: no pressure term on an open skin, three instead of six
    points a triangle without bending, rotations only for the curvature that has them.

    States are owned unknowns, a flat array: x, y, z of each owned node, then the rotation of each
    owned edge, a length, if the edges have any. Densities are owned values of the projected
    density. All methods are collective.

    Attributes:
        held: Held unknowns among the local ones, ghosts included.
        free: Those owned unknowns that are not held.
        loaded: Whether there are dead forces.
        displaced: Whether supports are moved, so that their pull is part of the load.
        pressures: Pressure of each chamber in Pa, (k,).

    Args:
        skin: The sewn skin.
        composite: The two materials and the stretch bounds.
        supports: Held components and directions.
        chambers: Pressure chambers; None for one.
        weight: The skin's own weight; None for none.
        periodic: How a tile repeats; None for a skin that does not. The columns of its mean
            deformation gradient, times its length, are the last unknowns of the first rank.

    Raises:
        ParameterError: The supports leave a rigid motion, or are made for another pattern; or the
            walls between the chambers are not known.
    """

    def __init__(
        self,
        skin: Skin,
        composite: Composite,
        supports: Supports,
        chambers: Chambers | None = None,
        weight: Weight | None = None,
        periodic: Periodic | None = None,
    ) -> None:
        if periodic is None:
            supports.require_no_rigid_motion(skin.pattern, bends=composite.bending is not None)
        self.skin = skin
        self.composite = composite
        self.supports = supports
        self.closed = periodic is None and supports.close(skin.pattern)
        self._hinges, rotations = None, False
        if composite.bending is not None:
            poisson = composite.reinforcement.poisson
            self._hinges = find_hinges(skin, composite.bending, supports, poisson)
            rotations = composite.bending.curvature == "midedge"
        self.periodic, self.periodic_images = periodic, None
        if periodic is not None:
            self.periodic_images = PeriodicImages(skin, periodic, bends=self._hinges is not None)
        self._patch = make_patch(
            skin, self._hinges, rotations=rotations, lattice=periodic is not None
        )
        self.space = self._patch.space
        self.q = fem.Function(self.space, name="state")
        self.adjoint = fem.Function(self.space, name="adjoint")
        self.density = fem.Function(skin.density_space, name="projected density")

        domain = skin.mesh
        # The lattice's columns have no entries of their own: they follow from those of the nodes.
        size = self.space.element.space_dimension - self._patch.lattice_dofs.size
        entry = basix.ufl.element("DG", "triangle", 0, shape=(size * (size + 1) // 2,))
        self._entry_space = fem.functionspace(domain, entry)
        nodes = self._patch.position_count
        numbers = self.space.dofmap.index_map.local_range[0] + np.arange(nodes).reshape(-1, 3)
        self.chambers, self.weight = chambers, weight
        self._gravity = fem.Constant(domain, np.zeros(3))
        bladder = composite.bladder
        self._pressure = PressureLoad(skin, chambers, supports, numbers)
        self._geometric = fem.Constant(domain, 1.0)
        self.ufl_forms: SkinForms = skin_forms(
            self.q,
            self.adjoint,
            ufl.TestFunction(self._entry_space),
            self.density,
            sheet_stiffness(domain, composite.fabric),
            sheet_stiffness(domain, composite.reinforcement),
            (fem.Constant(domain, composite.c1), fem.Constant(domain, composite.c2)),
            self._pressure.coefficient if self.closed else None,
            self._pressure.chosen,
            self._geometric,
            None if self._hinges is None else edge_coefficients(skin, self._hinges, rotations),
            None if bladder is None else fem.Constant(domain, bladder.membrane_stiffness / 3),
            None if weight is None else masses(domain, weight, self._gravity),
            None if self.periodic_images is None else self.periodic_images.coefficients,
        )
        self._energy = fem.form(self.ufl_forms.energy)
        self._residual = fem.form(self.ufl_forms.residual)
        self._tangent = fem.form(self.ufl_forms.tangent)
        self._buffer = work_vector(self.space)
        if self.closed:
            self._pressure.compile(self.ufl_forms, self._buffer)
        self._weight = None if weight is None else fem.form(self.ufl_forms.weight)
        self._sensitivity: Any = None  # compiled when a gradient is first asked for

        index_map = self.space.dofmap.index_map
        self.size_local: int = index_map.size_local
        self.loaded, self._force = False, np.zeros(self.size_local)
        self.displaced = False
        self.fixed = np.zeros(index_map.size_local + index_map.num_ghosts, dtype=bool)
        self.fixed[self._patch.position_dofs] = supports.fixed[skin.vertex]
        if self._hinges is not None and rotations:
            self.fixed[self._patch.rotation_dofs] = self._without_rotation()
        if periodic is not None:
            self.fixed[self._patch.lattice_dofs] = np.array(periodic.prescribed).T
        self.free = ~self.fixed[: self.size_local]

        # Owned triangles come first in the mesh, each with flat corners of its own.
        owned = domain.topology.index_map(2).size_local
        self._dofs = self.space.dofmap.list[:owned, :size].reshape(owned, size // 3, 3)
        flat = domain.geometry.x[: 3 * owned].reshape(owned, 3, 3)[:, :, :2]
        chart = np.stack([flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]], axis=2)
        self.bounds = StretchBounds(skin.comm, np.linalg.inv(chart), composite.c1, composite.c2)
        self._areas = skin.pattern.areas[skin.owned_cells]

    def _without_rotation(self) -> npt.NDArray[np.bool_]:
        """Local edges that have no rotation: free, hinged or mirrored, told by their owners."""
        assert self._hinges is not None
        turns = la.vector(self.space.dofmap.index_map, 1)
        owned = self.skin.mesh.topology.index_map(2).size_local
        dofs = self.space.dofmap.list[:owned, 18:21]
        np.maximum.at(turns.array, dofs, np.abs(self._hinges.rotation[:owned]))
        turns.scatter_reverse(la.InsertMode.add)
        turns.scatter_forward()
        return np.asarray(turns.array[self._patch.rotation_dofs] == 0)

    @property
    def assembled(self) -> Floats:
        """The assembled positions of the pattern as a state, without rotations."""
        state = np.zeros(self.size_local)
        self.positions(state)[:] = self.skin.pattern.points[self.skin.owned_vertices]
        if self.periodic is not None:
            self.set_columns(state, np.eye(3)[:, :2])
        return state

    def set_columns(self, state: Floats, gradient: Floats) -> None:
        """Write a mean deformation gradient F̄, (3, 2), into the owned unknowns of a state."""
        assert self.periodic is not None
        owned = self._patch.lattice_dofs < self.size_local
        values = self.periodic.length * np.asarray(gradient).T
        state[self._patch.lattice_dofs[owned]] = values[owned]

    @property
    def lattice_dofs(self) -> LocalInts:
        """Local unknowns of F̄n and F̄t, (2, 3), known on every rank."""
        return self._patch.lattice_dofs

    def columns_force(self, state: Floats) -> Floats:
        """First variation of E in N by `columns`, (2, 3), on every rank."""
        owned = self._patch.lattice_dofs[self._patch.lattice_dofs < self.size_local]
        force = self._variation(state)[owned].reshape(-1, 3)
        return np.asarray(self.skin.comm.bcast(force, root=0))

    def columns(self, state: Floats) -> Floats:
        """F̄n and F̄t of a state times the tile's length, (2, 3), on every rank; sets the state."""
        self.set_state(state)
        return np.asarray(self.q.x.array[self._patch.lattice_dofs])

    def positions(self, state: Floats) -> Floats:
        """Positions (n, 3) of the owned nodes in a state, as a view; also of forces."""
        return state[: self._patch.position_count].reshape(-1, 3)

    @property
    def pressures(self) -> Floats:
        """Pressure of each chamber in Pa, (k,)."""
        return self._pressure.values

    def set_pressure(self, pressure: float | Floats) -> None:
        """Set the pressure in Pa, of all chambers or of each, (k,)."""
        values = np.broadcast_to(np.asarray(pressure, dtype=np.float64), self.pressures.shape)
        self._pressure.set(np.array(values))

    def set_force(self, force: Floats | None) -> None:
        """Set dead forces in N on all assembled vertices, (n, 3); None for none."""
        self.loaded = force is not None
        self._force[:] = 0
        if force is not None:
            self.positions(self._force)[:] = force[self.skin.owned_vertices]

    def set_weight(self, share: float) -> None:
        """Let a share of the skin's own weight act, if it has one."""
        if self.weight is not None:
            self._gravity.value[:] = share * np.asarray(self.weight.gravity)

    def set_density(self, density: Floats) -> None:
        """Set the projected density from owned values."""
        self.density.x.array[: len(density)] = density
        self.density.x.scatter_forward()

    def set_state(self, state: Floats) -> None:
        """Set the state from owned unknowns."""
        self.q.x.array[: self.size_local] = state
        self.q.x.scatter_forward()

    def corners(self, state: Floats) -> Floats:
        """Corner positions (n, 3, 3) of the owned triangles; also sets the state."""
        self.set_state(state)
        return self._seen(3)

    def _seen(self, nodes: int) -> Floats:
        """Positions of the first corners and flaps of owned triangles where these see them."""
        seen = self.q.x.array[self._dofs[:, :nodes]]
        if self.periodic_images is not None:
            seen = (
                seen
                + self.periodic_images.added(self.q.x.array[self._patch.lattice_dofs])[:, :nodes]
            )
        return np.asarray(seen)

    def folds(self, state: Floats, angle: float) -> int:
        """How many hinges of triangles fold by more than an angle in rad; 0 without bending."""
        self.set_state(state)
        count = 0
        if self._hinges is not None:
            patch = self._seen(6)
            cells = slice(0, len(patch))
            inside = self._hinges.has_moment[cells] & ~self._hinges.mirror[cells].any(axis=2)
            angles = edge_angles(patch[:, :3], patch[:, 3:], np.zeros_like(patch[:, 3:]))
            count = int(((np.abs(angles) > angle) & inside).sum())
        return int(total(self.skin.comm, count))

    def energy(self, state: Floats) -> float:
        """E of eq. (8) in J, less what dead forces do from the assembled positions on.

        Infinite where eq. (1) does not admit the stretches.
        """
        if not self.bounds.worst(self.corners(state)) < 1:
            return np.inf
        work = self._force @ (state - self.assembled) if self.loaded else 0.0
        whole = total(self.skin.comm, fem.assemble_scalar(self._energy) - work)
        return whole - self._pressure.wall_volume(self.positions(state), self.pressures)

    def residual(self, state: Floats) -> Floats:
        """First variation of E in N, zero at held components."""
        return self._variation(state) * self.free

    def reaction(self, state: Floats) -> Floats:
        """Force in N by which the supports pull at the skin, zero at free components."""
        return self._variation(state) * ~self.free

    def _variation(self, state: Floats) -> Floats:
        self.set_state(state)
        out = assembled(self._residual, self._buffer) - self._force
        self.positions(out)[:] -= self._pressure.wall_load(self.positions(state), self.pressures)
        return np.asarray(out)

    def load(self, state: Floats, chamber: int | None = None) -> Floats:
        """Force of a unit pressure in m², in one chamber or in all, zero at held components."""
        weights = np.ones(len(self.pressures))
        if chamber is not None:
            weights = np.eye(len(weights))[chamber]
        return self._weighted_load(state, weights)

    def _weighted_load(self, state: Floats, weights: Floats) -> Floats:
        self.set_state(state)
        if not self.closed:
            return np.zeros(self.size_local)
        return self._pressure.load(self.positions(state), weights) * self.free

    def applied_load(self, state: Floats) -> Floats:
        """Force of pressure, dead forces and weight in N, zero at held components."""
        load = self._force * self.free
        if self.pressures.any():
            load = load + self._weighted_load(state, self.pressures)
        return load + self._weight_force() * self.free

    def _weight_force(self) -> Floats:
        if self._weight is None:
            return np.zeros(self.size_local)
        return -assembled(self._weight, self._buffer)

    def work(self, state: Floats) -> float:
        """Size in J of what pressure, forces and weight add to the energy, for its rounding."""
        parts = np.abs(self._force) * np.abs(state - self.assembled)
        by_force = total(
            self.skin.comm, float((parts + np.abs(self._weight_force() * state)).sum())
        )
        return float(self.pressures @ np.abs(self.volumes(state))) + by_force

    def volume(self, state: Floats) -> float:
        """Enclosed volume in m³; 0 for an open skin."""
        return float(self.volumes(state).sum())

    def volumes(self, state: Floats) -> Floats:
        """Volume of each chamber in m³, (k,), of closed bodies; 0 for an open skin."""
        self.set_state(state)
        if not self.closed:
            return np.zeros(len(self.pressures))
        nodes, each = self.positions(state), np.eye(len(self.pressures))
        return np.array([self._pressure.volume(nodes, weights) for weights in each])

    @property
    def tangent_layout(self) -> tuple[LocalInts, LocalInts, npt.NDArray[np.bool_]]:
        """Where `tangent_entries` puts what.

        Returns:
            For each owned triangle its row among the entries; its local dofs, shape (n, 9),
            (n, 18) or (n, 21); and which of these there are (a flap may be missing).
        """
        owned = len(self._dofs)
        dofs = self._dofs.reshape(owned, -1)
        present = np.ones(dofs.shape, dtype=bool)
        if self._hinges is not None:
            present[:, 9:18] = np.repeat(self._hinges.has_moment[:owned], 3, axis=1)
        return self._entry_space.dofmap.list[:owned, 0], dofs, present

    def tangent_entries(self, state: Floats, out: Floats, geometric: float = 1.0) -> None:
        """Upper triangles of the element matrices of the second variation of E, in N/m.

        Args:
            state: Owned unknowns.
            out: Its first entries receive them, a row of 45, 171 or 231 for each owned triangle;
                then follow those of `wall_pairs`.
            geometric: 1 for the tangent, 0 for its material part, which no pressure is in.
        """
        self.set_state(state)
        self._geometric.value = geometric
        cells = len(self._dofs) * self._entry_space.dofmap.bs
        out[:cells] = 0
        fem.assemble_vector(out, self._tangent)
        walls = self._pressure.wall_tangent(self.positions(state))
        out[cells : cells + len(walls)] = geometric * walls

    @property
    def wall_pairs(self) -> npt.NDArray[np.int64]:
        """Global rows and columns, (2, p), of what the walls between chambers add."""
        return self._pressure.pairs

    def density_sensitivity(self, state: Floats, adjoint: Floats) -> Floats:
        """∂(residual · adjoint)/∂ρ̄ at owned triangles, in J."""
        if self._sensitivity is None:
            self._sensitivity = fem.form(self.ufl_forms.sensitivity)
            self._gradient = work_vector(self.skin.density_space)
        self.set_state(state)
        self.adjoint.x.array[: self.size_local] = adjoint
        self.adjoint.x.scatter_forward()
        return assembled(self._sensitivity, self._gradient)

    def energy_rounding(self) -> float:
        """Bound in J on what rounding adds to the stretching energy.

        The logarithms of eq. (1) round at 1 whatever the strain, and are multiplied by a and b:
        wide bounds cost digits.
        """
        c1, c2 = self.composite.c1, self.composite.c2
        widest = max(1.0, (c1 - 1) ** 2, (c2 - 1) ** 2)
        return 1e-14 * widest * self.mean_modulus() * float(self.skin.pattern.areas.sum())

    def mean_modulus(self) -> float:
        """Mean over the flat area of h (2μ + λ), the bladder's included, in N/m."""
        mixed = _membrane_modulus(self.composite, self.density.x.array[: len(self._areas)])
        area = float(self.skin.pattern.areas.sum())
        bladder = self.composite.bladder  # μ = E/3, λ = 2 μ
        rubber = 0.0 if bladder is None else 4 / 3 * bladder.membrane_stiffness
        return dot(self.skin.comm, mixed, self._areas) / area + rubber


def _membrane_modulus(composite: Composite, density: Floats) -> Floats:
    fabric, reinforcement = composite.fabric, composite.reinforcement
    values = [m.thickness * (2 * m.mu + m.lam) for m in (fabric, reinforcement)]
    return np.asarray(interpolate(density, *values))
