"""Stable equilibrium of a skin under a load, by continuation where one solve fails."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from petsc4py import PETSc

from toros_fem.base.errors import NoEquilibriumError, ParameterError, TorosWarning
from toros_fem.base.mpi import norm, on_first_rank, smallest, together, warn_together
from toros_fem.base.validation import Bools, Floats, require_callable, require_flag, require_kind
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.equilibrium.equilibrium import (
    Equilibrium,
    EquilibriumError,
    PathPoint,
    motion_to,
    numbers_read,
)
from toros_fem.mechanics.equilibrium.iteration import NewtonStep
from toros_fem.mechanics.equilibrium.linear_solver import ShiftedCholesky
from toros_fem.mechanics.equilibrium.newton import Newton, NewtonOptions
from toros_fem.mechanics.equilibrium.search import (
    PrescribedDisplacement,
    Search,
    relaxed_start,
    require_apart,
    residual_at,
    settle,
    sliding_at,
    start_state,
)
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.designs import Densities
from toros_fem.mechanics.skin.load import Load, Pressure, load_of
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.mechanics.terms.loads import Weight
from toros_fem.mechanics.terms.model import SkinModel, make_model
from toros_fem.mechanics.terms.periodic import Periodic
from toros_fem.meshes.skin import Skin

if TYPE_CHECKING:  # who has contact has imported it
    from toros_fem.mechanics.contact.contact import Contact

# Factor on the residual of a saved equilibrium up to which it is the same one.
SAME_RESIDUAL = 10.0
# Thickness over the skin's size from which a unit is in doubt.
THICK = 0.1
# With friction, residual over the right-hand side at which GMRES ends, that is enough, and its
# largest number of iterations.
TOLERANCE, ALLOWED, ITERATIONS = 1e-11, 1e-8, 200


class TangentSolver:
    """Solver for linear systems with the tangent at equilibria of a skin.

    Attributes:
        skin, model: The skin, and its model.
    """

    def __init__(
        self, model: SkinModel, options: NewtonOptions, log: Callable[[NewtonStep], None] | None
    ) -> None:
        self.skin, self.model = model.skin, model
        self._newton = Newton(model, options, log)
        self._factor = self._newton.factor
        self._at: Equilibrium | None = None  # where the tangent is factorised

    def tangent_at(self, at: Equilibrium) -> None:
        """Factorise the tangent at an equilibrium, if it is not that already (collective).

        Raises:
            ParameterError: It is not complete; or its tangent is not positive definite, as that of
                another solver.
        """
        require_kind("at", at, Equilibrium, "an Equilibrium of this solver")
        if at is self._at:
            return
        fits = at.complete and at.state.shape == (self.model.size_local,)
        stable = smallest(self.skin.comm, fits) > 0
        if stable:
            self._set(at.density, at.load, at.begin, at.state)
            stable = self._newton.stable(at.state)
        if not stable:
            raise ParameterError(
                "the state is no stable equilibrium of this solver: finish a trial first, and ask "
                "the solver that found it."
            )
        self._at = at

    def forget(self) -> None:
        """Forget where the tangent is factorised: the model is used for something else now."""
        self._at = None

    @property
    def linear_solver(self) -> str:
        """What factorises the tangent, on which ranks or threads."""
        return self._factor.describe()

    def solve_tangent(self, rhs: Floats, at: Equilibrium, *, adjoint: bool = False) -> Floats:
        """Solve K y = rhs with the tangent at an equilibrium, zero at fixed components.

        This is the adjoint solve of eq. (19). Without friction K is symmetric. With friction GMRES
        solves, with the factors of the symmetric part; `adjoint` solves with the transpose, since
        normal forces change friction, and friction does not change them. The tangent is factorised
        again if another solve came between.

        Raises:
            ParameterError: As of `tangent_at`; or an adjoint through friction on free bodies is
                asked for.
            NoEquilibriumError: With friction: the iteration does not converge.
        """
        self.tangent_at(at)
        rhs, model = rhs * self.model.free, self.model
        if not model.slides:
            return self._factor.solve(rhs)
        if adjoint and model.free_bodies:
            raise ParameterError(
                "there is no adjoint through friction on free bodies; hold or move the bodies, or "
                "leave the friction out."
            )
        return self._solve_with_friction(rhs, at.state, transposed=adjoint)

    def stretch(self, at: Equilibrium, change: Floats) -> tuple[Floats, Floats]:
        """Return the derivatives of force in N and state in m by a tile's F̄ (collective).

        The force is that of all unknowns, the state constant; the state follows in equilibrium.
        `change` is that of the prescribed components of F̄, (3, 2).
        """
        self.tangent_at(at)
        images, tangent = self.model.images, self._factor.periodic
        assert images is not None
        assert tangent is not None
        change = np.where(np.array(images.periodic.prescribed), change, 0.0)
        force, state = tangent.force(change), np.zeros_like(at.state)
        images.set_mean_gradient(state, change)
        return force, state - self._factor.solve(force * self.model.free)

    def stable(self, density: Floats, load: Load, state: Floats) -> bool:
        """Return whether an equilibrium without friction is stable (collective)."""
        self._set(density, load, None, state)
        return self._newton.stable(state)

    def _solve_with_friction(self, rhs: Floats, state: Floats, *, transposed: bool) -> Floats:
        """Solve J y = rhs or its transpose, J the tangent and friction's derivative (collective).

        J is not symmetric. GMRES solves, with the factors of the tangent on its right, so that the
        residual is the true one (Saad & Schultz 1986).
        """
        comm, factor, ladder = self.skin.comm, self._factor, self._newton.ladder
        factor.fill()
        factor.couple(state, transposed=transposed)
        ladder.renew = False
        ksp = PETSc.KSP().create(comm)
        ksp.setOperators(factor.matrix)
        ksp.setType(PETSc.KSP.Type.GMRES)
        ksp.setGMRESRestart(ITERATIONS)
        ksp.setPCSide(PETSc.PC.Side.RIGHT)
        ksp.setTolerances(rtol=TOLERANCE, atol=0.0, max_it=ITERATIONS)
        ksp.getPC().setType(PETSc.PC.Type.PYTHON)
        ksp.getPC().setPythonContext(ShiftedCholesky(ladder))
        right, solution = factor.matrix.createVecs()
        right.array[:] = rhs
        ksp.solve(right, solution)
        factor.couple(None)
        found, whole = np.array(solution.array_r), norm(comm, rhs)
        left = ksp.getResidualNorm() / whole if whole > 0 else 0.0
        for held in (ksp, right, solution):
            held.destroy()
        if not left <= ALLOWED:
            raise NoEquilibriumError(
                f"the linear solve with friction leaves {left:.1g} of its right-hand side after "
                f"{ITERATIONS} iterations: the equilibrium is near to slipping as a whole. "
                "Shorten the step of the path, or lower the friction."
            )
        return found

    def motion_to(self, density: Floats, load: Load, at: Equilibrium) -> Floats:
        """Return the motion to another design and load that the tangent predicts (collective).

        Supports and bodies stay, and there is no friction. It is 0 where the equilibrium is outside
        the stretch bounds of the other design.
        """
        self.tangent_at(at)
        return motion_to(self.model, self._factor, at.point, PathPoint(density, load, at.state))

    def positions(self, at: Equilibrium) -> Floats:
        """Return the positions of all vertices in m, (n, 3), in the pattern's order (collective).

        Those of an `Equilibrium` itself are of this rank's nodes, in an order of their own.
        """
        require_kind("at", at, Equilibrium, "an Equilibrium of this solver")
        return self.skin.gather_vertices(at.positions)

    def reactions(self, at: Equilibrium) -> Floats:
        """Return the forces in N by which the supports pull at all vertices, (n, 3) (collective).

        They are zero at free components.
        """
        self.tangent_at(at)
        return self.skin.gather_vertices(self.model.positions(self.model.reaction(at.state)))

    def _set(self, density: Floats, load: Load, begin: Floats | None, state: Floats) -> None:
        """Let the model have density, load and friction of a state."""
        self.forget()
        self.model.set_density(density)
        self.model.set_load(load)
        contact = self.model.contact
        if contact is not None:
            contact.begin_step(begin, load)
            contact.lag_friction(state)


class EquilibriumSolver(TangentSolver):
    """Solver for stable equilibria of a skin, and for linear systems with the tangent there.

    Args:
        skin: The sewn skin.
        composite: Materials and stretch bounds.
        supports: Fixed components and directions.
        options: Tolerance and limits.
        log: Called with every row of a solve's history as it comes, and with a sentence where the
            equilibrium may have snapped, is near a limit point, blown up or folded; on every rank.
        chambers: Pressure chambers; None for one.
        weight: The skin's own weight; None for none.
        contact: What it touches: itself, the ground, bodies; None for nothing.
        design: Makes of skin and composite what is designed; None for densities. A
            `functools.partial` of `LineDesign` makes line families.
        quadratic: Whether the displacement in the plane of each triangle, (t,), is quadratic, as it
            is in printed lines; None for none.
        periodic: The tile that repeats; None for a skin that does not.

    Raises:
        ParameterError: An argument is of another type, or does not fit the skin.
    """

    def __init__(
        self,
        skin: Skin,
        composite: Composite,
        supports: Supports,
        options: NewtonOptions | None = None,
        log: Callable[[NewtonStep | str], None] | None = None,
        *,
        chambers: Chambers | None = None,
        weight: Weight | None = None,
        contact: Contact | None = None,
        design: Callable[[Skin, Composite], Densities] | None = None,
        quadratic: Bools | None = None,
        periodic: Periodic | None = None,
    ) -> None:
        further: dict[str, Any] = {
            "chambers": chambers,
            "weight": weight,
            "contact": contact,
            "design": design,
            "quadratic": quadratic,
            "periodic": periodic,
        }
        model = make_model(skin, composite, supports, **further)
        if log is not None:
            require_callable("log", log, "a function of a Newton step, or None")
        _warn_of_odd_sheets(skin, composite)
        self.options = on_first_rank(skin.comm, lambda: _settings(options))
        super().__init__(model, self.options, log)
        self.log, self.contact, self._further = log, contact, further
        self._prescribed = PrescribedDisplacement(model)

    def solve(
        self,
        density: Floats,
        load: Load | Pressure,
        start: Floats | Equilibrium | None = None,
        *,
        after: Equilibrium | None = None,
        sliding: Floats | None = None,
        raise_on_failure: bool = True,
        trial: bool = False,
        once: bool = False,
    ) -> Equilibrium:
        """Solve for the stable equilibrium at a density and a load (collective).

        Where the full load at once fails, the ways of `ways` are tried one after the other.

        Args:
            density: Projected density of the owned triangles, in [0, 1]; with line families the
                rows of a relaxed design.
            load: What acts; a number is a pressure in Pa, several are those of the chambers.
            start: Where the iteration starts: an equilibrium of a neighbouring design or load;
                owned unknowns; or positions of the owned nodes, (n, 3). Where triangles leave the
                stretch bounds it is relaxed until they are inside. Fixed components are moved to
                their prescribed positions. None starts from the assembled positions; with contact,
                layers that touch there are moved apart first.
            after: The step before this one on a path: friction goes on from it, and so does the
                iteration if there is no start.
            sliding: Where the skin sticks at the begin of the step; None takes that of `after`,
                else the skin begins at rest at the assembled positions, wherever the iteration
                starts.
            raise_on_failure: Whether to raise if no equilibrium is found, or to return the last
                good state with `converged` False.
            trial: Whether the result may be rejected: the full load is tried once, with few steps
                and a large tolerance, and without proof that the state is stable; see `finish`.
            once: Whether to try the full load once only, as in a trial.

        Raises:
            ParameterError: The start cannot be relaxed into the stretch bounds (of two materials
                the wider ones), or surfaces overlap or cross there that may touch.
            PatternError: Pressure on a skin with free edges that no symmetry plane closes.
            EquilibriumError: No equilibrium was found; the error holds the last good state.
        """
        comm, model = self.skin.comm, self.model
        given = load_of(load)
        require_flag(raise_on_failure=raise_on_failure, trial=trial, once=once)
        with together(comm):
            acting = given.on(model)
        density = model.design.check(density)
        start = after if start is None else start
        if after is not None and sliding is None:
            sliding = after.sliding
        near, cold = None, start is None
        if isinstance(start, Equilibrium):
            if start.density.shape[1:] == density.shape[1:]:  # not of a relaxed design and another
                near = start
            start = start.state
        self.forget()
        model.set_density(density)
        model.set_load(acting)  # it turns the axes of a tile
        state = start_state(model, start)
        with together(comm):
            if near is not None and len(near.density) != len(density):
                raise ParameterError("start is an equilibrium of another skin; give its positions.")
        if near is None and not trial:  # a trial may fail
            require_apart(model, state, acting, cold=cold)
        search = Search(
            self._newton,
            self._prescribed,
            density.copy(),
            acting,
            state,
            near,
            cold=cold,
            trial=trial,
            direct=trial or once,
        )
        result = self._solve(search, sliding)
        if raise_on_failure and not result.converged:
            raise EquilibriumError(result.reason, result)
        return result

    def start_at(self, positions: Floats) -> Floats | None:
        """Return positions of the owned nodes that a solve can start from (collective).

        They are the given ones of all vertices, (n, 3) in m, of a coarser mesh for example, relaxed
        where they leave the stretch bounds or nearly so; None if that does not help, or if surfaces
        overlap or cross that may touch.
        """
        model = self.model
        found = relaxed_start(model, positions)
        if found is None:
            return None
        owned = found[self.skin.owned_vertices]
        return owned if model.refusal(model.state_of(owned)) is None else None

    def finish(self, trial: Equilibrium) -> Equilibrium:
        """Complete a trial: the tolerance of the options, and a stable state (collective).

        Steps and factorisations are those of the completion alone. What is complete stays as it is.

        Raises:
            EquilibriumError: There is no stable equilibrium near.
        """
        require_kind("trial", trial, Equilibrium, "an Equilibrium of this solver")
        if trial.complete:
            return trial
        at = trial.density, trial.load, trial.state
        search = Search(self._newton, self._prescribed, *at, trial, direct=True)
        found = self._solve(search, trial.begin)
        if not found.converged:
            raise EquilibriumError(found.reason, found)
        return found

    def save(self, at: Equilibrium) -> tuple[Floats, dict[str, Any]]:
        """Return what `restore` needs: all unknowns by original index, and numbers (collective).

        From the last equilibrium of this solver a restored run goes on to the bit.
        """
        numbers = {**at.numbers(), "first_shift": self._newton.ladder.first}
        return self.model.patch.gather(at.state), numbers

    def restore(
        self,
        density: Floats,
        unknowns: Floats,
        numbers: Mapping[str, Any],
        load: Load | None = None,
    ) -> Equilibrium:
        """Return an equilibrium as if it had just been solved for (collective).

        On as many ranks as before, all that follows is the same to the last bit: what one solve
        leaves to the next is the tangent at its end, factorised again here, and its first shift.
        Unknowns and numbers, which may have been written as JSON, are those of `save`; forces and
        displacement are of the load. Where it is no equilibrium any more one near is solved for.
        """
        model, newton = self.model, self._newton
        given = replace(
            load or Load(),
            pressure=numbers["pressures"],
            poses=numbers["poses"],
            weight_fraction=numbers["weight_fraction"],
        )
        acting, density = given.on(model), model.design.check(density)
        state, read = model.patch.scatter(unknowns), numbers_read(numbers)
        self._set(density, acting, read["begin"], state)
        residual = residual_at(model, newton, state)
        # Another machine may round otherwise, and another load leaves a residual.
        known = residual <= max(self._newton.tolerance, SAME_RESIDUAL * read["residual"])
        if not (known and newton.stable(state)):
            return self.solve(density, acting, start=state, sliding=read["begin"])
        newton.ladder.first = numbers["first_shift"]
        state.setflags(write=False)
        found = Equilibrium(
            **read,
            density=density.copy(),
            load=acting,
            state=state,
            positions=model.positions(state),
            sliding=sliding_at(model, state),
        )
        self._at = found
        return found

    def like(self, **changes: Any) -> EquilibriumSolver:
        """Return another solver, which differs in some arguments of the class (collective)."""
        model = self.model
        own = {
            "skin": self.skin,
            "composite": model.composite,
            "supports": model.supports,
            "options": self.options,
            "log": self.log,
            **self._further,
        }
        return EquilibriumSolver(**{**own, **changes})

    def _solve(self, search: Search, begin: Floats | None) -> Equilibrium:
        self.forget()
        found = settle(search, begin, self.log)
        if found.complete:
            self._at = found
        return found


def _settings(options: NewtonOptions | None) -> NewtonOptions:
    """Return the options, checked."""
    require_kind("options", options, (NewtonOptions, type(None)), "NewtonOptions, or None")
    return options or NewtonOptions()


def _warn_of_odd_sheets(skin: Skin, composite: Composite) -> None:
    thickness = max(composite.fabric.thickness, composite.reinforcement.thickness)
    if thickness > THICK * skin.pattern.size:
        warn_together(
            skin.comm,
            f"the sheet is {thickness:.3g} m thick and the skin {skin.pattern.size:.3g} m across. "
            "Is the thickness in millimetres? Give it in m: 0.5 mm are 0.5e-3.",
            TorosWarning,
        )
    printed, fabric = (
        sheet.membrane_stiffness for sheet in (composite.reinforcement, composite.fabric)
    )
    if printed < fabric:
        warn_together(
            skin.comm,
            f"the reinforcement, E h = {printed:.3g} N/m, is softer than the fabric, {fabric:.3g} "
            "N/m: a print would weaken it. Are the two exchanged?",
            TorosWarning,
        )
    if composite.widest_bounds != composite.fabric_bounds:
        warn_together(
            skin.comm,
            f"the stretch bounds are {composite.stated_bounds}: fabric with a print on it "
            "stretches no further than without. Give the reinforcement narrower bounds, or none "
            "of its own.",
            TorosWarning,
        )
