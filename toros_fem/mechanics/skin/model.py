"""Energy, forces and tangent of a skin, assembled: the forms meet the mesh here."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import basix.ufl
import numpy as np
import ufl
from dolfinx import fem, la

from toros_fem.base.array_types import Bools, Floats, Ints, LocalInts
from toros_fem.base.compiled_forms import compiled
from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import dot, gather_by_index, largest, total
from toros_fem.forms.energy import SkinForms, skin_forms
from toros_fem.forms.interpolation import interpolate
from toros_fem.forms.lines import Lines
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.contact.settings import Contact
from toros_fem.mechanics.contact.skin_contact import SkinContact
from toros_fem.mechanics.contact.sliding import Sliding
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.coefficients import (
    assembled,
    check_density,
    courses,
    edge_coefficients,
    masses,
    print_offset,
    sheet_stiffness,
    work_vector,
)
from toros_fem.mechanics.skin.dead_loads import Weight
from toros_fem.mechanics.skin.hinges import edge_angles, find_hinges
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.patch_space import make_patch, pattern_edges
from toros_fem.mechanics.skin.pressure import PressureLoad
from toros_fem.mechanics.skin.stretch_bounds import MixedBounds, StretchBounds
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes.skin import Skin

# Rounding of the stretching energy over modulus times area: about a hundred units in the last
# place of a stretch of 1.
ENERGY_ROUNDING = 2.5e-14
# Way of a free body over the size of the skin at which it is taken to fall without end.
FALLEN = 3.0


class SkinModel:
    """Energy, first variation, tangent and density sensitivity of one skin.

    Only the terms that the skin has are compiled: no pressure term on an open skin, three instead
    of six nodes a triangle without bending, rotations only for the curvature that has them.

    A state is a flat array of the owned unknowns: x, y, z of each owned node, then the rotation of
    each owned edge, a length, if the edges have any. Densities are owned values of the projected
    density. All methods are collective.

    UFL derives the first variations of membrane, pressure and weight, and the density sensitivity.
    Written by hand, in `toros_fem.forms`, are the first variations of bending and of fibres and the
    whole second variation; tests/forms ties them to `ufl.derivative`. Force and tangent of the
    walls between chambers are written by hand too (`toros_fem.mechanics.skin.chambers`), tested by
    differences.

    Attributes:
        skin, composite, supports, chambers, weight: As given.
        closed: Whether a pressure can act: the skin is closed, or symmetry planes close it.
        fixed: Fixed unknowns among the local ones, ghosts included.
        free: Owned unknowns that are not fixed.
        load: The load case that acts; set by `set_load`.
        bounds: Test of the stretch bounds.
        size_local: Number of owned unknowns.

    Args:
        skin: The sewn skin.
        composite: The two materials and the stretch bounds.
        supports: Fixed components and directions.
        chambers: Pressure chambers; None for one.
        weight: The skin's own weight; None for none.
        contact: What the skin touches; None for nothing.

    Raises:
        ParameterError: The supports leave a rigid motion, or are made for another pattern; or the
            walls between the chambers cannot be found.
    """

    def __init__(
        self,
        skin: Skin,
        composite: Composite,
        supports: Supports,
        chambers: Chambers | None = None,
        weight: Weight | None = None,
        contact: Contact | None = None,
    ) -> None:
        if contact is None or not contact.holds:
            supports.require_no_rigid_motion(skin.pattern, bends=composite.bending is not None)
        closed = supports.close(skin.pattern)
        self._set_up(skin, composite, supports, chambers, weight, closed=closed, contact=contact)

    def _set_up(
        self,
        skin: Skin,
        composite: Composite,
        supports: Supports,
        chambers: Chambers | None,
        weight: Weight | None,
        *,
        closed: bool,
        lattice_shifts: Sequence[Any] | None = None,
        lines: Lines | None = None,
        contact: Contact | None = None,
    ) -> None:
        """Make space and forms.

        Args:
            skin, composite, supports, chambers, weight: As for the class.
            closed: Whether a pressure can act.
            lattice_shifts: Coefficients of `forms.periodic.placed`; None for a skin that does not
                repeat.
            lines: Coefficients of line families; None for a skin without.
            contact: As for the class.
        """
        self.skin, self.composite, self.supports = skin, composite, supports
        self.chambers, self.weight, self.closed = chambers, weight, closed
        self._hinges, rotations = None, False
        if composite.bending is not None:
            poisson = composite.reinforcement.poisson
            # Membrane strain bends an offset print up to its free edges.
            coupled = composite.print_side is not None
            self._hinges = find_hinges(
                skin, composite.bending, supports, poisson, turn_free=coupled
            )
            rotations = composite.bending.curvature == "midedge"
        self._patch = make_patch(
            skin,
            self._hinges,
            rotations=rotations,
            lattice=lattice_shifts is not None,
            bodies=0 if contact is None else len(contact.free_bodies),
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
        self._gravity = fem.Constant(domain, np.zeros(3))
        # Owned triangles come first in the mesh, each with flat corners of its own.
        owned = domain.topology.index_map(2).size_local
        flat = domain.geometry.x[: 3 * owned].reshape(owned, 3, 3)[:, :, :2]
        self.bounds: StretchBounds
        if composite.shares_bounds:
            shared, wrinkles = composite.fabric_bounds, composite.membrane.relaxed
            self.bounds = StretchBounds(skin.comm, flat, *shared, wrinkles=wrinkles)
        else:
            self.bounds = MixedBounds(self.density, flat, composite)
        bladder = composite.bladder
        self._pressure = PressureLoad(skin, chambers, supports, numbers)
        self._geometric = fem.Constant(domain, 1.0)
        self.ufl_forms: SkinForms = skin_forms(
            self.q,
            self.adjoint,
            ufl.TestFunction(self._entry_space),
            self.density,
            sheet_stiffness(domain, composite.fabric),
            sheet_stiffness(domain, composite.reinforcement, composite.eccentricity),
            self._stretch_limits(),
            self._pressure.coefficient if closed else None,
            self._pressure.chosen,
            self._geometric,
            None if self._hinges is None else edge_coefficients(skin, self._hinges, rotations),
            None if bladder is None else fem.Constant(domain, bladder.membrane_stiffness / 3),
            None if weight is None else masses(domain, weight, self._gravity),
            lattice_shifts,
            lines,
            courses(skin, composite),
            fem.Constant(domain, self._pressure.origin) if self._pressure.origin.any() else None,
            fem.Constant(domain, composite.membrane.residual_stiffness)
            if composite.membrane.relaxed
            else None,
            print_offset(domain, composite),
        )
        self._energy = compiled(self.ufl_forms.energy)
        self._residual = compiled(self.ufl_forms.residual)
        self._tangent = compiled(self.ufl_forms.tangent)
        self._buffer = work_vector(self.space)
        if closed:
            self._pressure.compile(self.ufl_forms, self._buffer)
        self._weight = None if weight is None else compiled(self.ufl_forms.weight)
        self._sensitivity: Any = None  # compiled for the first gradient
        self._variation_by_density: Any = None  # and for the first one of metrics
        self._variation_by_bounds: Any = None  # and for the first start outside its bounds
        self._density_change = fem.Function(skin.density_space)

        index_map = self.space.dofmap.index_map
        self.size_local: int = index_map.size_local
        self.load = Load(self._pressure.values)
        self._force = np.zeros(self.size_local)
        self.fixed: Bools = np.zeros(index_map.size_local + index_map.num_ghosts, dtype=bool)
        self.fixed[self._patch.position_dofs] = supports.fixed[skin.vertex]
        if self._hinges is not None and rotations:
            self.fixed[self._patch.rotation_dofs] = self._without_rotation()
        self.free: Bools = ~self.fixed[: self.size_local]

        self._dofs = self.space.dofmap.list[:owned, :size].reshape(owned, size // 3, 3)
        self._areas = skin.pattern.areas[skin.owned_cells]
        self.contact: SkinContact | None = None
        if contact is not None:
            self.contact = SkinContact(
                skin,
                contact,
                contact.sizes(composite),
                supports.fixed,
                supports.in_symmetry_planes(skin.pattern),
                numbers,
                index_map.local_to_global(self._patch.body_dofs.ravel()).reshape(-1, 6),
                index_map.size_global,
            )

    def _stretch_limits(self) -> tuple[Any, Any]:
        """c₁ and c₂ as the forms take them."""
        if isinstance(self.bounds, MixedBounds):
            return self.bounds.coefficients
        c1, c2 = self.composite.fabric_bounds
        return fem.Constant(self.skin.mesh, c1), fem.Constant(self.skin.mesh, c2)

    def _without_rotation(self) -> Bools:
        """Whether each local edge has no rotation (free, hinged, mirrored), as its owner knows."""
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
        """Assembled positions as a state, without rotations; touching layers are moved apart."""
        points = self.skin.pattern.points if self.contact is None else self.contact.assembled
        state = np.zeros(self.size_local)
        self.positions(state)[:] = points[self.skin.owned_vertices]
        return state

    def state_of(self, positions: Floats) -> Floats:
        """Return the state with given positions of the owned nodes, (n, 3), without rotations."""
        state = self.assembled
        self.positions(state)[:] = positions
        return state

    def with_short_turns(self, state: Floats) -> Floats:
        """Return the same places, with rotations of free bodies of at most π."""
        state = state.copy()
        if self.contact is not None and self.skin.comm.rank == 0:
            dofs = self._patch.body_dofs
            state[dofs] = self.contact.shortest(state[dofs])
        return state

    def positions(self, state: Floats) -> Floats:
        """Return the positions (n, 3) of the owned nodes in a state, as a view; also of forces."""
        return state[: self._patch.position_count].reshape(-1, 3)

    def gather(self, state: Floats) -> Floats:
        """Return all unknowns of a state on every rank, in an order that no partition changes.

        It is that of the pattern: positions of the vertices, rotations of the edges, columns of
        the mean deformation gradient, motions of free bodies.
        """
        skin, begin = self.skin, self._patch.position_count
        parts: list[Floats] = [skin.gather_vertices(self.positions(state)).ravel()]
        if len(self._patch.rotation_dofs):
            edges, count = pattern_edges(skin)
            owned = edges[self._patch.rotation_dofs < self.size_local]
            rotations = state[begin : begin + len(owned)]
            parts.append(gather_by_index(skin.comm, owned, rotations, count))
        shared = self._patch.shared_dofs
        if len(shared):
            parts.append(skin.comm.bcast(state[shared] if skin.comm.rank == 0 else None, root=0))
        return np.concatenate(parts)

    def scatter(self, unknowns: Floats) -> Floats:
        """Return the state of this rank from all unknowns, as of `gather`.

        Raises:
            ParameterError: Their number is that of another skin.
        """
        skin, places = self.skin, 3 * len(self.skin.pattern.points)
        edges, count = pattern_edges(skin) if len(self._patch.rotation_dofs) else (None, 0)
        shared = self._patch.shared_dofs
        expected = places + count + len(shared)
        if unknowns.shape != (expected,):
            raise ParameterError(
                f"the unknowns have shape {unknowns.shape}; this skin has ({expected},)."
            )
        state = np.zeros(self.size_local)
        vertices = unknowns[:places].reshape(-1, 3)
        self.positions(state)[:] = vertices[skin.owned_vertices]
        if edges is not None:
            owned = edges[self._patch.rotation_dofs < self.size_local]
            begin = self._patch.position_count
            state[begin : begin + len(owned)] = unknowns[places:][owned]
        if skin.comm.rank == 0:
            state[shared] = unknowns[places + count :]
        return state

    def set_load(self, load: Load) -> None:
        """Let a load act; where it moves the supports, the state must already be moved.

        Raises:
            ParameterError: The load has another number of chambers.
        """
        if load.pressures.shape != self._pressure.values.shape:
            raise ParameterError(
                f"the load has pressures of shape {load.pressures.shape}; this skin needs "
                f"{self._pressure.values.shape}, one for each chamber."
            )
        self.load = load
        self._pressure.set(load.pressures)
        self._force[:] = 0
        if load.force is not None:
            self.positions(self._force)[:] = load.force[self.skin.owned_vertices]
        if self.weight is not None:
            self._gravity.value[:] = load.weight * np.asarray(self.weight.gravity)
        if self.contact is not None:
            self.contact.poses[:] = 0.0 if load.poses is None else load.poses

    def check(self, density: Floats) -> Floats:
        """Return owned densities as an array, with one result on all ranks.

        Raises:
            DensityError: The density does not fit, or leaves [0, 1].
        """
        return check_density(self.skin, density)

    def set_density(self, density: Floats) -> None:
        """Set the projected density from owned values."""
        self.density.x.array[: len(density)] = density
        self.density.x.scatter_forward()
        self.restore_bounds()

    def set_state(self, state: Floats) -> None:
        """Set the state from owned unknowns."""
        self.q.x.array[: self.size_local] = state
        self.q.x.scatter_forward()

    def corners(self, state: Floats) -> Floats:
        """Return corner positions (n, 3, 3) of the owned triangles; also sets the state."""
        self.set_state(state)
        return self._patch_positions(3)

    def _patch_positions(self, nodes: int) -> Floats:
        """Positions of the first corners and flaps of owned triangles where these see them."""
        return np.asarray(self.q.x.array[self._dofs[:, :nodes]])

    def loosen_bounds(self, start: Floats, *, everywhere: bool = False) -> bool:
        """Widen the stretch bounds of triangles that a start leaves; return whether there are any.

        Where both materials have the same bounds nothing is done. `set_density` restores them.

        Args:
            start: Owned unknowns.
            everywhere: Whether to widen first all bounds to those of the wider material.
        """
        bounds = self.bounds
        return isinstance(bounds, MixedBounds) and bounds.loosen(
            self.corners(start), everywhere=everywhere
        )

    def push_of_bounds(self, state: Floats) -> Floats:
        """Return the change of the residual by narrowing loosened bounds, in N, to first order."""
        assert isinstance(self.bounds, MixedBounds)
        if self._variation_by_bounds is None:
            self._variation_by_bounds = compiled(self.bounds.variation(self.ufl_forms.residual))
        self.set_state(state)
        self.bounds.point_back()
        return assembled(self._variation_by_bounds, self._buffer) * self.free

    def narrow_bounds(self, state: Floats, motion: Floats | None) -> Floats:
        """Narrow loosened bounds, along a predicted motion if that helps; return the state there.

        Args:
            state: Owned unknowns, inside the bounds.
            motion: Their change by narrowing all the way, to first order; None if it is not known.
        """
        assert isinstance(self.bounds, MixedBounds)
        corners = self.corners(state)
        if motion is not None:
            fraction = self.bounds.follow(corners, self.corners(motion))
            if fraction > 0:
                return np.asarray(state + fraction * motion)
        self.bounds.tighten(corners)
        return state

    @property
    def loosened(self) -> bool:
        """Whether stretch bounds are wider than those of the density."""
        return isinstance(self.bounds, MixedBounds) and self.bounds.loosened

    def restore_bounds(self) -> None:
        """Restore the bounds of the density, if any is loosened."""
        if isinstance(self.bounds, MixedBounds):
            self.bounds.update()

    def count_folds(self, state: Floats, angle: float) -> int:
        """Return how many hinges of triangles fold by more than an angle in rad.

        Each edge inside the skin has two. Without bending the count is 0.
        """
        self.set_state(state)
        count = 0
        if self._hinges is not None:
            patch = self._patch_positions(6)
            cells = slice(0, len(patch))
            inside = self._hinges.has_moment[cells] & ~self._hinges.mirror[cells].any(axis=2)
            angles = edge_angles(patch[:, :3], patch[:, 3:], np.zeros_like(patch[:, 3:]))
            count = int(((np.abs(angles) > angle) & inside).sum())
        return int(total(self.skin.comm, count))

    def energy(self, state: Floats) -> float:
        """Return E of eq. (8) in J, less the work of dead forces from the assembled positions.

        It is infinite where eq. (1) does not admit the stretches.
        """
        if not self.bounds.worst(self.corners(state)) < 1:
            return np.inf
        loaded = self.load.force is not None
        work = self._force @ (state - self.assembled) if loaded else 0.0
        whole = total(self.skin.comm, fem.assemble_scalar(self._energy) - work)
        whole -= self._pressure.wall_volume(self.positions(state), self.load.pressures)
        if self.contact is not None:
            fraction = self.load.weight_of_bodies
            whole += self.contact.energy(self.positions(state), self.motions(state), fraction)
        return whole

    def residual(self, state: Floats) -> Floats:
        """Return the first variation of E in N, zero at fixed components."""
        return self._variation(state) * self.free

    def reaction(self, state: Floats) -> Floats:
        """Return the force in N by which the supports pull at the skin, zero at free components."""
        return self._variation(state) * ~self.free

    def _variation(self, state: Floats) -> Floats:
        self.set_state(state)
        out = assembled(self._residual, self._buffer) - self._force
        nodes = self.positions(state)
        self.positions(out)[:] -= self._pressure.wall_gradient(nodes, self.load.pressures)
        if self.contact is not None:
            fraction = self.load.weight_of_bodies
            by_nodes, by_bodies = self.contact.gradient(nodes, self.motions(state), fraction)
            self.positions(out)[:] += by_nodes
            if self.skin.comm.rank == 0:
                out[self._patch.body_dofs.ravel()] += by_bodies.ravel()
        return np.asarray(out)

    def motions(self, state: Floats) -> Floats:
        """Return the unknowns of the free bodies in m, (f, 6); zero on all ranks but the first."""
        dofs = self._patch.body_dofs
        return state[dofs] if self.skin.comm.rank == 0 else np.zeros(dofs.shape)

    def largest_step(
        self,
        state: Floats,
        direction: Floats,
        fraction: float,
        carried: Floats | None = None,
    ) -> float:
        """Return a factor ≤ 1 on a step that keeps to the stretch bounds and meets nothing.

        Args:
            state: Owned unknowns of a feasible state.
            direction: Their change by the full step.
            fraction: Fraction of the distance to the stretch bounds that may be used up.
            carried: Change of the poses of held bodies by the full step; None leaves them.
        """
        corners = self.corners(state)
        factor = self.bounds.largest_step(corners, self.corners(direction), fraction)
        if self.contact is None:
            return factor
        return self.contact.largest_step(
            self.positions(state),
            self.motions(state),
            self.positions(direction),
            self.motions(direction),
            factor,
            carried,
        )

    def gap(self, state: Floats) -> float | None:
        """Return the smallest distance of faces in m, as of `SkinContact.gap`; None without."""
        if self.contact is None:
            return None
        return self.contact.gap(self.positions(state), self.motions(state))

    @property
    def slides(self) -> bool:
        """Whether there is friction, by which the residual has no potential."""
        return self.contact is not None and self.contact.friction is not None

    def begin_step(self, sliding: Sliding | None, load: Load) -> None:
        """Begin a step of a path with friction; without friction nothing is done.

        Args:
            sliding: End of the step before; None for a skin at rest at its assembled positions.
            load: Load of the step.
        """
        if self.contact is not None:
            self.contact.begin_step(sliding, load.poses)

    def lag_friction(self, state: Floats) -> None:
        """Let friction have the normal forces of a state; energy and residual are by these."""
        if self.contact is not None:
            self.contact.lag_friction(self.positions(state), self.motions(state))

    def end_step(self, state: Floats) -> Sliding | None:
        """Return where the skin sticks at the end of a step; None without friction."""
        self.lag_friction(state)
        if self.contact is None:
            return None
        return self.contact.end_step(self.positions(state), self.motions(state))

    def friction_coupling(
        self, state: Floats, change: Floats, *, transposed: bool = False
    ) -> Floats:
        """Return the derivative of friction by its normal forces times a change of the state.

        It is the part of the residual's derivative that the tangent leaves out, in N.

        Args:
            state: State of the last `lag_friction`.
            change: Owned unknowns.
            transposed: Whether to multiply by the transpose.
        """
        assert self.contact is not None
        product = self.contact.coupling_transposed if transposed else self.contact.coupling
        change = change * self.free
        nodes, motions = product(
            self.positions(state),
            self.motions(state),
            self.positions(change),
            self.motions(change),
        )
        return self.joined(nodes, motions) * self.free

    def begin_step_backward(self, state: Floats, adjoint: Floats) -> Floats:
        """Return the derivative of Σ adjoint · residual by the anchors at the begin of a step."""
        assert self.contact is not None
        nodes, motions = self.positions(state), self.motions(state)
        return self.contact.begin_step_backward(nodes, motions, self.positions(adjoint))

    def end_step_backward(self, state: Floats, slope: Floats) -> tuple[Floats, Floats]:
        """Return the derivatives of Σ slope · anchors at the end, by state and by the begin."""
        assert self.contact is not None
        nodes, motions = self.positions(state), self.motions(state)
        by_nodes, by_begin = self.contact.end_step_backward(nodes, motions, slope)
        return self.joined(by_nodes, np.zeros((len(self._patch.body_dofs), 6))), by_begin

    def joined(self, nodes: Floats, motions: Floats) -> Floats:
        """Return numbers at the owned nodes, (n, 3), and at the free bodies, (f, 6), as a state.

        Those of edges are zero; on all ranks but the first, those of bodies are not read.
        """
        out = np.zeros(self.size_local)
        self.positions(out)[:] = nodes
        if self.skin.comm.rank == 0:
            out[self._patch.body_dofs.ravel()] = motions.ravel()
        return out

    @property
    def chamber_count(self) -> int:
        """Number of pressure chambers."""
        return len(self._pressure.values)

    @property
    def free_bodies(self) -> int:
        """Number of free bodies."""
        return len(self._patch.body_dofs)

    def falls(self, state: Floats) -> bool:
        """Return whether a free body is so far away that nothing will hold it any more."""
        if not self.free_bodies:
            return False
        way = largest(self.skin.comm, float(np.abs(self.motions(state)[:, :3]).max()))
        return way > FALLEN * self.skin.pattern.size

    def refusal(self, state: Floats) -> str | None:
        """Return where contact forbids a state as a start, as a sentence; None if nowhere."""
        if self.contact is None:
            return None
        return self.contact.refusal(self.positions(state), self.motions(state))

    def crossed(self, state: Floats) -> bool:
        """Return whether surfaces that may touch pass through each other."""
        if self.contact is None:
            return False
        return self.contact.crossed(self.positions(state), self.motions(state))

    def admits(self, state: Floats) -> bool:
        """Return whether a solve can start from a state: stretch bounds and contact allow it."""
        return self.bounds.worst(self.corners(state)) < 1 and self.refusal(state) is None

    def grow_pairs(self, state: Floats) -> None:
        """Let `further_pairs` cover what is in contact at a state."""
        if self.contact is not None:
            self.contact.grow(self.positions(state), self.motions(state))

    def volume_gradient(self, state: Floats, chamber: int | None = None) -> Floats:
        """Return the first variation of a chamber's volume in m², zero at fixed components.

        It is the force of a unit pressure. None sums over all chambers.
        """
        weights = np.ones(len(self.load.pressures))
        if chamber is not None:
            weights = np.eye(len(weights))[chamber]
        return self._weighted_gradient(state, weights)

    def _weighted_gradient(self, state: Floats, weights: Floats) -> Floats:
        self.set_state(state)
        if not self.closed:
            return np.zeros(self.size_local)
        return self._pressure.gradient(self.positions(state), weights) * self.free

    def applied_load(self, state: Floats) -> Floats:
        """Return the force of pressure, dead forces and weight in N, zero at fixed components."""
        load = self._force * self.free
        if self.load.pressures.any():
            load = load + self._weighted_gradient(state, self.load.pressures)
        return load + (self._weight_force() + self._weight_of_bodies()) * self.free

    def _weight_force(self) -> Floats:
        if self._weight is None:
            return np.zeros(self.size_local)
        return -assembled(self._weight, self._buffer)

    def _weight_of_bodies(self) -> Floats:
        force = np.zeros(self.size_local)
        if self.contact is not None and self.skin.comm.rank == 0:
            force[self._patch.body_dofs] = self.load.weight_of_bodies * self.contact.weight
        return force

    def load_energy(self, state: Floats) -> float:
        """Return the size in J of the load's part in the energy, to bound its rounding."""
        parts = np.abs(self._force) * np.abs(state - self.assembled)
        weight = self._weight_force() + self._weight_of_bodies()
        by_force = total(self.skin.comm, float((parts + np.abs(weight * state)).sum()))
        return float(self.load.pressures @ np.abs(self.volumes(state))) + by_force

    def volume(self, state: Floats) -> float:
        """Return the enclosed volume in m³; 0 for an open skin."""
        return float(self.volumes(state).sum())

    def volumes(self, state: Floats) -> Floats:
        """Return the volume of each chamber in m³, (k,), as a closed body; 0 for an open skin."""
        self.set_state(state)
        count = len(self.load.pressures)
        if not self.closed:
            return np.zeros(count)
        nodes = self.positions(state)
        return np.array([self._pressure.volume(nodes, weights) for weights in np.eye(count)])

    @property
    def tangent_layout(self) -> tuple[LocalInts, LocalInts, Bools]:
        """Meaning of the numbers that `tangent_entries` returns.

        Returns:
            For each owned triangle its row among the entries; its local dofs, shape (n, 9),
            (n, 18) or (n, 21); and whether each of them exists (a flap may be missing).
        """
        owned = len(self._dofs)
        dofs = self._dofs.reshape(owned, -1)
        present = np.ones(dofs.shape, dtype=bool)
        if self._hinges is not None:
            present[:, 9:18] = np.repeat(self._hinges.has_moment[:owned], 3, axis=1)
        return self._entry_space.dofmap.list[:owned, 0], dofs, present

    def tangent_entries(self, state: Floats, out: Floats, geometric: float = 1.0) -> None:
        """Compute upper triangles of the element matrices of the second variation of E, in N/m.

        Args:
            state: Owned unknowns.
            out: Its first entries receive them, a row of 45, 171 or 231 for each owned triangle;
                those of `further_pairs` follow.
            geometric: 1 for the tangent, 0 for its material part, which has no pressure.
        """
        self.set_state(state)
        self._geometric.value = geometric
        cells = len(self._dofs) * self._entry_space.dofmap.bs
        out[:cells] = 0
        fem.assemble_vector(out, self._tangent)
        walls = self._pressure.wall_tangent(self.positions(state))
        out[cells : cells + len(walls)] = geometric * walls
        if self.contact is not None:
            cells += len(walls)
            nodes, motions = self.positions(state), self.motions(state)
            touching = self.contact.tangent(nodes, motions, definite=geometric == 0)
            out[cells : cells + len(touching)] = touching

    def convexity_gap(self, state: Floats) -> Floats | None:
        """Return what makes the contact's part of the tangent positive semidefinite, in N/m.

        Returns:
            Entries at the last of `further_pairs`; None where nothing is in contact.
        """
        if self.contact is None:
            return None
        return self.contact.convexity_gap(self.positions(state), self.motions(state))

    @property
    def further_pairs(self) -> Ints:
        """Global rows and columns, (2, p), of entries of walls between chambers and of contact."""
        walls = self._pressure.pairs
        return walls if self.contact is None else np.hstack([walls, self.contact.pairs])

    def density_variation(self, state: Floats, change: Floats) -> Floats:
        """Return the derivative of the residual along a change of ρ̄ at owned triangles, in N.

        Args:
            state: Owned unknowns.
            change: Change of ρ̄; the density that is set may leave [0, 1] by it.
        """
        if self._variation_by_density is None:
            form = ufl.derivative(self.ufl_forms.residual, self.density, self._density_change)
            self._variation_by_density = compiled(form)
        self.set_state(state)
        self._density_change.x.array[: len(change)] = change
        self._density_change.x.scatter_forward()
        return assembled(self._variation_by_density, self._buffer) * self.free

    def density_sensitivity(self, state: Floats, adjoint: Floats) -> Floats:
        """Return ∂(residual · adjoint)/∂ρ̄ at owned triangles, in J.

        This is the mechanical part of the adjoint gradient, eq. (19). UFL derives it from the
        residual. All later steps back, through projection, filter and objective, are written by
        hand, each tested against finite differences (Taylor tests).
        """
        if self._sensitivity is None:
            self._sensitivity = compiled(self.ufl_forms.sensitivity)
            self._gradient = work_vector(self.skin.density_space)
        self.set_state(state)
        self.adjoint.x.array[: self.size_local] = adjoint
        self.adjoint.x.scatter_forward()
        return assembled(self._sensitivity, self._gradient)

    def energy_rounding(self) -> float:
        """Return a bound in J on the rounding of the stretching energy.

        Stretches are rounded at 1, whatever the strain. The bounds of eq. (1) do not matter: the
        energy is formed without the rounding of 1 inside its logarithms.
        """
        return ENERGY_ROUNDING * self.mean_modulus() * float(self.skin.pattern.areas.sum())

    def mean_modulus(self) -> float:
        """Return the mean over the flat area of h (2μ + λ), the bladder's included, in N/m."""
        area = float(self.skin.pattern.areas.sum())
        return dot(self.skin.comm, self._moduli(), self._areas) / area + self._rubber

    def soft_modulus(self) -> float:
        """Return the harmonic mean over the flat area of h (2μ + λ), in N/m: the soft parts count.

        The bladder's is included.
        """
        area = float(self.skin.pattern.areas.sum())
        return area / dot(self.skin.comm, 1 / (self._moduli() + self._rubber), self._areas)

    @property
    def _rubber(self) -> float:
        bladder = self.composite.bladder  # μ = E/3, λ = 2 μ
        return 0.0 if bladder is None else 4 / 3 * bladder.membrane_stiffness

    def _moduli(self, sheet: Floats | float = 1.0, courses: Floats | float = 1.0) -> Floats:
        """Return h (2μ + λ) of the owned triangles in N/m, without the bladder's.

        Args:
            sheet: Factor of the isotropic part.
            courses: Factor of the courses of a knit.
        """
        density = self.density.x.array[: len(self._areas)]
        composite = self.composite
        values = [
            m.thickness * (2 * m.mu + m.lam) for m in (composite.fabric, composite.reinforcement)
        ]
        knitted = interpolate(density, composite.course_stiffness, 0.0)
        return np.asarray(sheet * interpolate(density, *values) + courses * knitted)
