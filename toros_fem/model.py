"""A skin's energy, forces and tangent, assembled: the forms meet the mesh here."""

from __future__ import annotations

from typing import Any

import basix.ufl
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, la

from toros_fem._mpi import dot, total
from toros_fem.feasibility import StretchBounds
from toros_fem.forms.energy import Section, SkinForms, skin_forms
from toros_fem.forms.interpolation import interpolate
from toros_fem.meshes.skin import Skin
from toros_fem.parameters import Composite, Material
from toros_fem.patch import patch_space
from toros_fem.supports import Supports

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int32]


class SkinModel:
    """Energy, first variation, tangent and density sensitivity of one scene.

    Only what the scene needs is compiled: no pressure term on an open skin, three instead of six
    points a triangle without bending.

    States are owned position dofs, a flat array (x, y, z of each owned node); densities are owned
    values of the projected density. All methods are collective.

    Attributes:
        held: Held dofs among the local ones, ghosts included.
        free: Those owned dofs that are not held.

    Args:
        skin: The sewn skin.
        composite: The two materials and the stretch bounds.
        supports: Held components.

    Raises:
        ParameterError: The supports leave a rigid motion, or are made for another pattern.
    """

    def __init__(self, skin: Skin, composite: Composite, supports: Supports) -> None:
        supports.require_no_rigid_motion(skin.pattern)
        self.skin = skin
        self.composite = composite
        self.closed = supports.close(skin.pattern)
        self.space, self._has_flap = patch_space(skin, flaps=composite.bending)
        self.q = fem.Function(self.space, name="positions")
        self.adjoint = fem.Function(self.space, name="adjoint")
        self.density = fem.Function(skin.density_space, name="projected density")

        cells = skin.density_space.dofmap.list[:, 0]
        flap_indicator = []
        if composite.bending:
            for i in range(3):
                indicator = fem.Function(skin.density_space)
                indicator.x.array[cells] = self._has_flap[:, i]
                flap_indicator.append(indicator)
        domain = skin.mesh
        size = self.space.element.space_dimension
        entry = basix.ufl.element("DG", "triangle", 0, shape=(size * (size + 1) // 2,))
        self._entry_space = fem.functionspace(domain, entry)
        self._pressure = fem.Constant(domain, 0.0)
        self._geometric = fem.Constant(domain, 1.0)
        self.ufl_forms: SkinForms = skin_forms(
            self.q,
            self.adjoint,
            ufl.TestFunction(self._entry_space),
            self.density,
            _section(domain, composite.fabric),
            _section(domain, composite.reinforcement),
            (fem.Constant(domain, composite.c1), fem.Constant(domain, composite.c2)),
            self._pressure if self.closed else None,
            self._geometric,
            flap_indicator,
        )
        self._energy = fem.form(self.ufl_forms.energy)
        self._residual = fem.form(self.ufl_forms.residual)
        self._tangent = fem.form(self.ufl_forms.tangent)
        self._volume = fem.form(self.ufl_forms.volume) if self.closed else None
        self._load = fem.form(self.ufl_forms.load) if self.closed else None
        self._force = _work_vector(self.space)
        self._sensitivity: Any = None  # compiled when a gradient is first asked for

        index_map = self.space.dofmap.index_map
        self.size_local: int = index_map.size_local
        self.held = supports.held[skin.vertex].ravel()
        self.free = ~self.held[: self.size_local]

        # Owned triangles come first in the mesh, each with flat corners of its own.
        owned = domain.topology.index_map(2).size_local
        self._corner = skin.position_space.dofmap.list[:owned]
        flat = domain.geometry.x[: 3 * owned].reshape(owned, 3, 3)[:, :, :2]
        chart = np.stack([flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]], axis=2)
        self.bounds = StretchBounds(skin.comm, np.linalg.inv(chart), composite.c1, composite.c2)
        self._areas = skin.pattern.areas[skin.owned_cells]

    @property
    def assembled(self) -> Floats:
        """The assembled positions of the pattern as a state."""
        return self.skin.pattern.points[self.skin.owned_vertices].ravel().copy()

    def set_pressure(self, pressure: float) -> None:
        """Set the pressure in Pa."""
        self._pressure.value = pressure

    def set_density(self, density: Floats) -> None:
        """Set the projected density from owned values."""
        self.density.x.array[: len(density)] = density
        self.density.x.scatter_forward()

    def set_state(self, state: Floats) -> None:
        """Set the positions from owned dofs."""
        self.q.x.array[: self.size_local] = state
        self.q.x.scatter_forward()

    def corners(self, state: Floats) -> Floats:
        """Corner positions (n, 3, 3) of the owned triangles; also sets the state."""
        self.set_state(state)
        return self.q.x.array.reshape(-1, 3)[self._corner]

    def folds(self, state: Floats, angle: float) -> int:
        """How many hinges of triangles fold by more than an angle in rad; 0 without bending."""
        self.set_state(state)
        dofs = self.space.dofmap.list[: len(self._corner)]
        patch = self.q.x.array[dofs].reshape(len(dofs), -1, 3)
        count = 0
        if patch.shape[1] == 6:
            own = np.cross(patch[:, 1] - patch[:, 0], patch[:, 2] - patch[:, 0])
            for i in range(3):
                j, k = patch[:, (i + 1) % 3], patch[:, (i + 2) % 3]
                other = np.cross(j - k, patch[:, 3 + i] - k)
                cosine = np.einsum("ij,ij->i", own, other)
                cosine /= np.linalg.norm(own, axis=1) * np.linalg.norm(other, axis=1)
                folded = (cosine < np.cos(angle)) & (self._has_flap[: len(dofs), i] > 0)
                count += int(folded.sum())
        return int(total(self.skin.comm, count))

    def energy(self, state: Floats) -> float:
        """E of eq. (8) in J; infinite where eq. (1) does not admit the stretches."""
        if not self.bounds.worst(self.corners(state)) < 1:
            return np.inf
        return total(self.skin.comm, fem.assemble_scalar(self._energy))

    def residual(self, state: Floats) -> Floats:
        """First variation of E in N, zero at held components."""
        self.set_state(state)
        return _assembled(self._residual, self._force) * self.free

    def reaction(self, state: Floats) -> Floats:
        """Force in N by which the supports pull at the skin, zero at free components."""
        self.set_state(state)
        return _assembled(self._residual, self._force) * ~self.free

    def load(self, state: Floats) -> Floats:
        """Force of a unit pressure in m², zero at held components."""
        self.set_state(state)
        if self._load is None:
            return np.zeros(self.size_local)
        return _assembled(self._load, self._force) * self.free

    def volume(self, state: Floats) -> float:
        """Enclosed volume in m³; 0 for an open skin."""
        self.set_state(state)
        if self._volume is None:
            return 0.0
        return total(self.skin.comm, fem.assemble_scalar(self._volume))

    @property
    def tangent_layout(self) -> tuple[Ints, Ints, npt.NDArray[np.bool_]]:
        """Where `tangent_entries` puts what.

        Returns:
            For each owned triangle its row among the entries; its local dofs, shape (n, 9) or
            (n, 18); and which of these there are (a flap may be missing).
        """
        owned = len(self._corner)
        dofs = self.space.dofmap.list[:owned]
        present = np.ones(dofs.shape, dtype=bool)
        if self._has_flap.any():
            present[:, 9:] = np.repeat(self._has_flap[:owned] > 0, 3, axis=1)
        return self._entry_space.dofmap.list[:owned, 0], dofs, present

    def tangent_entries(self, state: Floats, out: Floats, geometric: float = 1.0) -> None:
        """Upper triangles of the element matrices of the second variation of E, in N/m.

        Args:
            state: Owned position dofs.
            out: Its first entries receive them, a row of 45 or 171 for each owned triangle.
        """
        self.set_state(state)
        self._geometric.value = geometric
        out[: len(self._corner) * self._entry_space.dofmap.bs] = 0
        fem.assemble_vector(out, self._tangent)

    def density_sensitivity(self, state: Floats, adjoint: Floats) -> Floats:
        """∂(residual · adjoint)/∂ρ̄ at owned triangles, in J."""
        if self._sensitivity is None:
            self._sensitivity = fem.form(self.ufl_forms.sensitivity)
            self._gradient = _work_vector(self.skin.density_space)
        self.set_state(state)
        self.adjoint.x.array[: self.size_local] = adjoint
        self.adjoint.x.scatter_forward()
        return _assembled(self._sensitivity, self._gradient)

    def energy_rounding(self) -> float:
        """Bound in J on what rounding adds to the stretching energy.

        The logarithms of eq. (1) round at 1 whatever the strain, and are multiplied by a and b:
        wide bounds cost digits.
        """
        c1, c2 = self.composite.c1, self.composite.c2
        widest = max(1.0, (c1 - 1) ** 2, (c2 - 1) ** 2)
        return 1e-14 * widest * self.mean_modulus() * float(self.skin.pattern.areas.sum())

    def mean_modulus(self) -> float:
        """Mean over the flat area of h (2μ + λ), in N/m."""
        mixed = _membrane_modulus(self.composite, self.density.x.array[: len(self._areas)])
        area = float(self.skin.pattern.areas.sum())
        return dot(self.skin.comm, mixed, self._areas) / area


def _work_vector(space: fem.FunctionSpace) -> Any:
    """A vector to assemble into, made once: to plan its exchange between ranks is dear."""
    return la.vector(space.dofmap.index_map, space.dofmap.index_map_bs)


def _assembled(form: Any, vector: Any) -> Floats:
    """Owned entries of an assembled linear form."""
    vector.array[:] = 0
    fem.assemble_vector(vector.array, form)
    vector.scatter_reverse(la.InsertMode.add)
    return np.array(vector.array[: vector.index_map.size_local * vector.block_size])


def _section(domain: Any, material: Material) -> Section:
    h = material.thickness
    values = (h * material.mu, h * material.lam, h**3 / 12 * material.mu, h**3 / 12 * material.lam)
    return Section(*(fem.Constant(domain, value) for value in values))


def _membrane_modulus(composite: Composite, density: Floats) -> Floats:
    fabric, reinforcement = composite.fabric, composite.reinforcement
    values = [m.thickness * (2 * m.mu + m.lam) for m in (fabric, reinforcement)]
    return np.asarray(interpolate(density, *values))
