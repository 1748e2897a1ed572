"""Energy, forces and tangent of a skin, summed over the terms of its energy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
import ufl
from dolfinx import fem

from toros_fem.base.errors import ParameterError
from toros_fem.base.fenicsx import SharedForms, assembled, work_vector
from toros_fem.base.mpi import dot, total
from toros_fem.base.validation import Bools, Floats, require_callable, require_kind
from toros_fem.forms.energy import SkinForms, skin_forms
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.designs import Densities, LineDesign
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.patch_space import cell_space, make_patch, positions
from toros_fem.mechanics.skin.stretch_bounds import StretchBounds
from toros_fem.mechanics.skin.supports import Planes, Supports
from toros_fem.mechanics.terms.loads import DeadForce, OwnWeight, Pressure, Weight
from toros_fem.mechanics.terms.periodic import Images, Periodic
from toros_fem.mechanics.terms.sheet import (
    Bend,
    FabricThreads,
    LineFamilies,
    OffsetPrint,
    QuadraticEdges,
    RubberLayer,
    Sheet,
)
from toros_fem.mechanics.terms.term import ContactSettings, ContactTerm, Term
from toros_fem.meshes.skin import Skin

# Rounding of the stretching energy over modulus times area: about a hundred units in the last
# place of a stretch of 1.
ENERGY_ROUNDING = 2.5e-14

Kind = TypeVar("Kind", bound=Term)


class SkinModel:
    """Energy, first variation, tangent and sensitivity of one skin.

    A state is a flat array of the owned unknowns: x, y, z of each owned node, then those of the
    terms: the rotation of each owned edge, a length, and on the first rank the columns of a tile's
    mean deformation gradient and the motions of free bodies. Designs are owned rows. All methods
    are collective. `make_model` makes the terms of a skin.

    Attributes:
        skin, composite, supports: As given.
        terms: Terms of the energy, asked in this order.
        design: What is designed.
        sheet, bend, contact, pressure, weight, images: The terms of these kinds; None without.
        patch: The unknowns, and how triangles see them.
        entry_space: Space of the entries of the triangles' matrices; `geometric` has the factors
            of a part of it, as of `skin_forms`.
        bounds: Test of the stretch bounds.
        fixed: Fixed unknowns among the local ones, ghosts included.
        free: Owned unknowns that are not fixed.
        load: The load that acts; set by `set_load`.
        size_local: Number of owned unknowns.
    """

    def __init__(
        self,
        skin: Skin,
        composite: Composite,
        supports: Supports,
        terms: Sequence[Term],
        design: Densities,
    ) -> None:
        self.skin, self.composite, self.supports = skin, composite, supports
        self.terms, self.design = terms, design
        self.contact = next((term for term in terms if isinstance(term, ContactTerm)), None)
        self.pressure, self.weight = self._of(Pressure), self._of(OwnWeight)
        self.images = self._of(Images)
        self.sheet, self.bend = self._of(Sheet), self._of(Bend)
        (bounds,) = (term.bounds for term in terms if term.bounds is not None)
        self.bounds: StretchBounds = bounds

        flaps = None if self.bend is None else self.bend.hinges.flap
        unknowns = [term.unknowns for term in terms if term.unknowns is not None]
        self.patch = make_patch(skin, flaps, unknowns)
        dofs, none = iter(self.patch.dofs), np.zeros((0, 0), dtype=np.int32)
        for term in terms:
            term.number(self.patch, none if term.unknowns is None else next(dofs))
        self.space = self.patch.space
        index_map = self.space.dofmap.index_map
        self.size_local: int = index_map.size_local
        self.fixed: Bools = np.zeros(index_map.size_local + index_map.num_ghosts, dtype=bool)
        self.fixed[self.patch.position_dofs] = supports.fixed[skin.vertex]
        for own, more in zip(self.patch.dofs, unknowns, strict=True):
            self.fixed[own] = more.fixed
        self.free: Bools = ~self.fixed[: self.size_local]
        self.load = Load(np.zeros(self.chamber_count))
        self._make_forms()

    def _of(self, kind: type[Kind]) -> Kind | None:
        return next((term for term in self.terms if isinstance(term, kind)), None)

    def _make_forms(self) -> None:
        """Make and compile the forms, but those of gradients, which wait for the first one."""
        skin, owned, size = self.skin, len(self.skin.owned_cells), self.patch.components
        self.q = fem.Function(self.space, name="state")
        self._adjoint = fem.Function(self.space, name="adjoint")
        self.entry_space = cell_space(skin, size * (size + 1) // 2)
        self.geometric = fem.Constant(skin.mesh, (1.0, 1.0))
        design, entries = self.design, ufl.TestFunction(self.entry_space)
        read = design.density, design.lines
        self._symbols = self.q, self._adjoint, entries, read, self.geometric
        of_terms = [(type(one), one.symbols, one.edges, one.bubbles) for one in self.terms]
        self._shared = SharedForms(skin.mesh, (self._symbols, of_terms))
        self._energy = self.compiled("energy", lambda forms: forms.energy)
        self._residual = self.compiled("residual", lambda forms: forms.residual)
        self._buffer = work_vector(self.space)
        for number, term in enumerate(self.terms):
            term.take_forms(number, self.compiled, self._buffer)
        self._dofs = self.space.dofmap.list[:owned, :size].reshape(owned, size // 3, 3)
        self._areas = skin.pattern.areas[skin.owned_cells]

    @cached_property
    def forms(self) -> SkinForms:
        """The forms in UFL."""
        return skin_forms(*self._symbols, self.terms)

    def compiled(self, name: str, of: Callable[[SkinForms], Any]) -> fem.Form:
        """Return one of `forms`, compiled; skins of one kind share it by its name (collective)."""
        return self._shared.compiled(name, lambda: of(self.forms))

    @cached_property
    def _sensitivities(self) -> list[tuple[Any, Any]]:
        """Compiled forms of the gradient, with vectors to assemble into."""

        def one(number: int, by: fem.Function) -> tuple[Any, Any]:
            of = self.compiled(f"by {number}", lambda forms: forms.sensitivities[number])
            return of, work_vector(by.function_space)

        return [one(*pair) for pair in enumerate(self.design.functions)]

    @property
    def assembled(self) -> Floats:
        """State at rest: assembled positions, without rotations; layers that touch are apart."""
        state = self.state_of(self.skin.pattern.points[self.skin.owned_vertices])
        for term in self.terms:
            term.add_rest(state)
        return state

    def state_of(self, nodes: Floats) -> Floats:
        """Return the state with given positions of the owned nodes, (n, 3), and no more."""
        state = np.zeros(self.size_local)
        self.positions(state)[:] = nodes
        return state

    def positions(self, state: Floats) -> Floats:
        """Return the positions (n, 3) of the owned nodes in a state, as a view; also of forces."""
        return positions(self.skin, state)

    def set_load(self, load: Load) -> None:
        """Let a load act; where it moves the supports, the state must already be moved."""
        self.load = load
        for term in self.terms:
            term.set_load(load)

    def set_density(self, design: Floats) -> None:
        """Set the design from owned rows."""
        self.design.set(design)
        for term in self.terms:
            term.after_design()

    def set_state(self, state: Floats) -> None:
        """Set the state from owned unknowns."""
        self.q.x.array[: self.size_local] = state
        self.q.x.scatter_forward()

    def corners(self, state: Floats) -> Floats:
        """Return the corners by which bounds test owned triangles, (n, 3, 3); sets the state too.

        Where edges have unknowns, those follow, (n, 5, 3).
        """
        self.set_state(state)
        first, corners = self.bounds.bubbles, self._seen(3)
        if first is None:
            return corners
        return np.concatenate([corners, self.q.x.array[self._dofs[:, first : first + 2]]], axis=1)

    def _seen(self, nodes: int) -> Floats:
        """Positions of the first corners and flaps of owned triangles where these see them."""
        q = self.q.x.array
        seen = np.asarray(q[self._dofs[:, :nodes]])
        for term in self.terms:
            seen = term.moved(seen, q)
        return seen

    def count_folds(self, state: Floats, angle: float) -> int:
        """Return how many hinges of triangles fold by more than an angle in rad; see `Bend`."""
        self.set_state(state)
        count = 0 if self.bend is None else self.bend.folds(self._seen(6), angle)
        return int(total(self.skin.comm, count))

    def energy(self, state: Floats) -> float:
        """Return E of eq. (8) in J, less the work of dead forces from the assembled positions.

        It is infinite where eq. (1) does not admit the stretches.
        """
        if not self.bounds.worst(self.corners(state)) < 1:
            return np.inf
        whole = total(self.skin.comm, fem.assemble_scalar(self._energy))
        return whole + sum(term.energy(state) for term in self.terms)

    def variation(self, state: Floats) -> Floats:
        """Return the first variation of E in N."""
        self.set_state(state)
        out = assembled(self._residual, self._buffer)
        for term in self.terms:
            term.add_gradient(state, out)
        return out

    def residual(self, state: Floats) -> Floats:
        """Return the first variation of E in N, zero at fixed components."""
        return self.variation(state) * self.free

    def reaction(self, state: Floats) -> Floats:
        """Return the force in N by which the supports pull at the skin, zero at free components.

        What closes a free border is no part of the skin: the pressure on it is none of the force.
        """
        force = self.variation(state)
        if self.pressure is not None:
            self.positions(force)[:] -= self.pressure.beyond_skin(state)
        return force * ~self.free

    def largest_step(
        self, state: Floats, step: Floats, fraction: float, carried: Floats | None = None
    ) -> float:
        """Return a factor ≤ 1 on a step that keeps to the stretch bounds and meets nothing.

        The state is feasible; `fraction` of its distance to the stretch bounds may be used up, and
        `carried` is the change of the poses of held bodies by the full step, (k, 6), on all ranks.
        """
        corners = self.corners(state)
        factor = self.bounds.largest_step(corners, self.corners(step), fraction)
        for term in self.terms:
            factor = term.largest_step(state, step, factor, carried)
        return factor

    @property
    def slides(self) -> bool:
        """Whether there is friction, by which the residual has no potential."""
        return self.contact is not None and self.contact.slides

    @property
    def chamber_count(self) -> int:
        """Number of pressure chambers."""
        return 1 if self.pressure is None else len(self.pressure.values)

    @property
    def free_bodies(self) -> int:
        """Number of free bodies."""
        return 0 if self.contact is None else self.contact.free_bodies

    def refusal(self, state: Floats) -> str | None:
        """Return why a state can be no start, as a sentence; None where it can."""
        found = (term.refusal(state) for term in self.terms)
        return next((sentence for sentence in found if sentence is not None), None)

    def admits(self, state: Floats) -> bool:
        """Return whether a solve can start from a state: stretch bounds and contact allow it."""
        return self.bounds.worst(self.corners(state)) < 1 and self.refusal(state) is None

    def volume_gradient(self, state: Floats, chamber: int | None = None) -> Floats:
        """Return the first variation of a chamber's volume in m², zero at fixed components.

        It is the force of a unit pressure. None sums over all chambers.
        """
        if self.pressure is None:
            return np.zeros(self.size_local)
        self.set_state(state)
        every = np.eye(self.chamber_count)
        weights = every.sum(axis=0) if chamber is None else every[chamber]
        return self.pressure.gradient(state, weights) * self.free

    def applied_load(self, state: Floats) -> Floats:
        """Return the force of pressure, dead forces and weight in N, zero at fixed components."""
        self.set_state(state)
        out = np.zeros(self.size_local)
        for term in self.terms:
            term.add_applied(state, out)
        return out * self.free

    def load_energy(self, state: Floats) -> float:
        """Return the size in J of the load's part in the energy, to bound its rounding."""
        self.set_state(state)
        return sum(term.load_energy(state) for term in self.terms)

    def volumes(self, state: Floats) -> Floats:
        """Return the volume of each chamber in m³, (k,), as a closed body; 0 for an open skin."""
        self.set_state(state)
        return np.zeros(1) if self.pressure is None else self.pressure.volumes(state)

    def density_sensitivity(self, state: Floats, adjoint: Floats) -> Floats:
        """Return ∂(residual · adjoint) by the owned design, in J.

        This is the mechanical part of the adjoint gradient, eq. (19). UFL derives it from the
        residual. All later steps back, through projection, filter and objective, are written by
        hand, each tested against finite differences (Taylor tests).
        """
        self.set_state(state)
        self._adjoint.x.array[: self.size_local] = adjoint
        self._adjoint.x.scatter_forward()
        return self.design.backward([assembled(*pair) for pair in self._sensitivities])

    def energy_rounding(self) -> float:
        """Return a bound in J on the rounding of the stretching energy.

        Stretches are rounded at 1, whatever the strain. The bounds of eq. (1) do not matter: the
        energy is formed without the rounding of 1 inside its logarithms.
        """
        return ENERGY_ROUNDING * self.mean_modulus() * float(self.skin.pattern.areas.sum())

    def mean_modulus(self) -> float:
        """Return the mean over the flat area of h (2μ + λ), the bladder's included, in N/m."""
        area = float(self.skin.pattern.areas.sum())
        return dot(self.skin.comm, self._moduli(), self._areas) / area

    def soft_modulus(self) -> float:
        """Return the harmonic mean over the flat area of h (2μ + λ), in N/m: the soft parts count.

        The bladder's is included.
        """
        area = float(self.skin.pattern.areas.sum())
        return area / dot(self.skin.comm, 1 / self._moduli(), self._areas)

    def _moduli(self) -> Floats:
        """Return h (2μ + λ) of the owned triangles in N/m."""
        parts = (term.moduli(self.design) for term in self.terms)
        return np.asarray(sum(parts, start=np.zeros(len(self._dofs))))


def make_model(
    skin: Skin,
    composite: Composite,
    supports: Supports,
    *,
    chambers: Chambers | None = None,
    weight: Weight | None = None,
    contact: ContactSettings | None = None,
    design: Callable[[Skin, Composite], Densities] | None = None,
    quadratic: Bools | None = None,
    periodic: Periodic | None = None,
) -> SkinModel:
    """Return the model of a skin with the terms that it has (collective).

    The supports, with the prescribed ones of a tile's mean deformation, must leave no rigid motion.

    Args:
        skin, composite, supports: As of `EquilibriumSolver`, and so are those that follow.
        chambers, weight, contact, design, quadratic: What the skin has besides.
        periodic: The tile that the skin is; None for one that does not repeat.

    Raises:
        ParameterError: They leave one, or are made for another pattern; an argument is of another
            type; the walls between the chambers cannot be found; or a relaxed design is to touch
            something.
        PatternError: Chambers of a skin with free edges that no symmetry plane closes.
    """
    require_kind("skin", skin, Skin, "a Skin, by sew(comm, pattern)")
    require_kind("composite", composite, Composite, "a Composite, by Composite(fabric, …)")
    require_kind("supports", supports, Supports, "Supports, by clamp(pattern, panels) for instance")
    for name, given, kind, wanted in (
        ("chambers", chambers, Chambers, "Chambers, or None for one"),
        ("weight", weight, Weight, "a Weight, or None for none"),
        ("contact", contact, ContactSettings, "a Contact, or None for none"),
        ("periodic", periodic, Periodic, "a Periodic, or None for a skin that does not repeat"),
    ):
        require_kind(name, given, (kind, type(None)), wanted)
    if design is not None:
        require_callable("design", design, "a function of skin and composite, or None")
    designed = Densities(skin) if design is None else design(skin, composite)
    if isinstance(designed, LineDesign) and contact is not None:
        raise ParameterError("relaxed designs know no contact; leave contact out, or families.")
    pattern, bending = skin.pattern, composite.bending
    if periodic is None and (contact is None or not contact.holds):
        supports.require_no_rigid_motion(pattern, bends=bending is not None)
    planes = Planes(pattern, supports)

    terms: list[Term] = [Sheet(skin, composite, designed)]
    if composite.bladder is not None:
        terms.append(RubberLayer(skin, composite.bladder))
    if isinstance(designed, LineDesign):
        terms.append(LineFamilies(skin, composite, designed))
    if composite.knit is not None:
        terms.append(FabricThreads(skin, composite, composite.knit))
    if bending is not None:
        repeats = periodic is not None
        terms.append(Bend(skin, composite, bending, supports, repeats=repeats))
    if quadratic is not None:
        cells = np.asarray(quadratic)
        if cells.dtype != np.bool_ or cells.shape != (len(pattern.panel),):
            raise ParameterError(
                f"quadratic has shape {cells.shape} and type {cells.dtype}; it must be "
                f"{len(pattern.panel)} truth values, one for each triangle."
            )
        sheet, first = terms[0].bounds, 3
        if bending is not None:  # flaps, and rotations as one more vector, come before
            first = 7 if bending.curvature == "midedge" else 6
        assert sheet is not None
        terms.append(QuadraticEdges(skin, supports, sheet, quadratic, first))
    if composite.print_side is not None:
        terms.append(OffsetPrint(skin, composite))
    if periodic is not None:
        terms.append(Images(skin, periodic, bends=bending is not None))
    if periodic is None and planes.close:  # a pressure can act
        terms.append(Pressure(skin, supports, planes, chambers))
    elif chambers is not None:
        pattern.require_closed()
    if weight is not None:
        terms.append(OwnWeight(skin, weight))
    terms.append(DeadForce(skin))
    if contact is not None:
        terms.append(contact.term(skin, composite, supports))
    return SkinModel(skin, composite, supports, terms, designed)
