"""Stable equilibrium of a skin under a load, by continuation where one solve fails."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import MaterialWarning, ParameterError, UnitWarning
from toros_fem.base.mpi import (
    collective,
    largest,
    norm,
    require_alike,
    together,
    warn_together,
)
from toros_fem.base.validation import (
    require_between,
    require_callable,
    require_flag,
    require_kind,
)
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.assembly.make_model import make_model
from toros_fem.mechanics.contact.settings import Contact
from toros_fem.mechanics.contact.sliding import Sliding
from toros_fem.mechanics.equilibrium.attempts import Attempts
from toros_fem.mechanics.equilibrium.continuation import ContinuationResult
from toros_fem.mechanics.equilibrium.diagnostics import condition_of, failure, success
from toros_fem.mechanics.equilibrium.equilibrium import (
    Equilibrium,
    EquilibriumError,
    numbers_read,
    readings,
)
from toros_fem.mechanics.equilibrium.friction_solve import solve_with_friction
from toros_fem.mechanics.equilibrium.newton import Newton
from toros_fem.mechanics.equilibrium.newton_step import NewtonStep
from toros_fem.mechanics.equilibrium.options import NewtonOptions
from toros_fem.mechanics.equilibrium.path import PathPoint, connect, critical_load
from toros_fem.mechanics.equilibrium.prescribed import PrescribedDisplacement
from toros_fem.mechanics.equilibrium.start import relaxed_start, require_apart, start_state
from toros_fem.mechanics.equilibrium.ways import Search, search_equilibrium
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.dead_loads import Weight
from toros_fem.mechanics.skin.designs import CROSSING, LineDesign
from toros_fem.mechanics.skin.load import Load, Pressure, load_of
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes.refine import Refinement
from toros_fem.meshes.skin import Skin, sew

# Factor on the residual of a saved equilibrium up to which it is the same one.
SAME_RESIDUAL = 10.0
# Thickness over the skin's size from which a unit is in doubt.
THICK = 0.1


class EquilibriumSolver:
    """Solver for stable equilibria of a skin, and for linear systems with the tangent there.

    Args:
        skin: The sewn skin.
        composite: Materials and stretch bounds.
        supports: Fixed components and directions.
        options: Tolerance and limits.
        log: Called with every row of a solve's history as it comes, and with a sentence where the
            equilibrium snapped, is near a limit point, blown up or folded; on every rank.
        chambers: Pressure chambers; None for one.
        weight: The skin's own weight; None for none.
        families: Number of line families of relaxed designs, which then take the place of
            densities (`LineDesign`); None for none.
        crossing: Factor of their bonded crossings, as for `LineDesign`.
        contact: What the skin touches: itself, the ground, bodies; None for nothing.
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
        families: int | None = None,
        crossing: float = CROSSING,
        contact: Contact | None = None,
    ) -> None:
        require_kind("skin", skin, Skin, "a Skin, by sew(comm, pattern)")
        require_kind("contact", contact, (Contact, type(None)), "a Contact, or None for none")
        given = {
            "composite": composite,
            "supports": supports,
            "options": options,
            "chambers": chambers,
            "weight": weight,
            "families": families,
            "crossing": crossing,
            "contact": contact,
        }
        require_alike(skin.comm, **given)
        self._given: dict[str, Any] = {**given, "skin": skin, "log": log}
        require_between(0.0, np.inf, crossing=crossing)
        _require_kinds(composite, supports, options, log, chambers, weight)
        _warn_of_odd_sheets(skin, composite)
        self.skin, self.log, self.contact = skin, log, contact
        design = None
        if families is not None:
            if contact is not None:
                raise ParameterError(
                    "relaxed designs know no contact; leave contact out, or families."
                )
            design = LineDesign(skin, composite, families, crossing)
        self.model = make_model(
            skin,
            composite,
            supports,
            chambers=chambers,
            weight=weight,
            contact=contact,
            design=design,
        )
        self.options = options or NewtonOptions()
        self._newton = Newton(self.model, self.options, log)
        self._factor = self._newton.factor
        self._prescribed = PrescribedDisplacement(self.model)
        self._at: Equilibrium | None = None  # where the tangent is factorised

    @collective("self.skin.comm", owned=("density", "start", "after", "sliding"))
    def solve(
        self,
        density: Floats,
        load: Load | Pressure,
        start: Floats | Equilibrium | None = None,
        *,
        after: Equilibrium | None = None,
        sliding: Sliding | None = None,
        raise_on_failure: bool = True,
        trial: bool = False,
    ) -> Equilibrium:
        """Solve for the stable equilibrium at a density and a load (collective).

        Where the full load at once fails, the ways of `ways` are tried one after the other.

        Args:
            density: Projected density of the owned triangles, in [0, 1]; with line families the
                rows of a relaxed design.
            load: What acts; a number is a pressure in Pa, several are those of the chambers.
            start: Where the iteration starts: an equilibrium of a neighbouring design or load;
                owned unknowns; or positions of the owned nodes, (n, 3), for example of a solver
                with another bending term. Where triangles leave the stretch bounds it is relaxed
                until they are inside. Fixed components are moved to their prescribed positions.
                None starts from the assembled positions; with contact, layers that touch there are
                moved apart first, and displacements count from where they then are.
            after: The step before this one on a path: friction goes on from it, and so does the
                iteration if there is no start.
            sliding: Where the skin sticks at the begin of the step; None takes that of `after`,
                else the skin begins at rest at the assembled positions, wherever the iteration
                starts.
            raise_on_failure: Whether to raise if no equilibrium is found, or to return the last
                good state with `converged` False.
            trial: Whether the result may be rejected: the full load is tried once, with few steps
                and a large tolerance, and without proof that the state is stable. `finish`
                completes it.

        Raises:
            ParameterError: The load does not fit, the start leaves the stretch bounds (of two
                materials the wider ones) and cannot be relaxed into them, or surfaces overlap or
                cross there that may touch.
            DensityError: The density does not fit, or leaves [0, 1].
            OpenSkinError: Pressure on a skin with free edges that no symmetry plane closes.
            EquilibriumError: No equilibrium was found; the error holds the last good state.
        """
        comm, model = self.skin.comm, self.model
        given = load_of(load)
        require_flag(raise_on_failure=raise_on_failure, trial=trial)
        acting, density = given.on(model), model.check(density)
        start = after if start is None else start
        if after is not None and sliding is None:
            sliding = after.sliding
        near, cold = None, start is None
        if isinstance(start, Equilibrium):
            if start.density.shape[1:] == density.shape[1:]:  # not of a relaxed design and another
                near = start
            start = start.state
        state = start_state(model, start)
        with together(comm):
            if near is not None and len(near.density) != len(density):
                raise ParameterError("start is an equilibrium of another skin; give its positions.")
        if near is None and not trial:  # a trial may fail
            require_apart(model, state, acting, cold=cold)
        search = self._search(density.copy(), acting, state, near, trial=trial, direct=trial)
        search.cold = cold
        result = self._solve(search, sliding)
        if raise_on_failure and not result.converged:
            raise EquilibriumError(result.reason, result)
        return result

    def start_at(self, positions: Floats) -> Floats | None:
        """Return positions of the owned nodes that a solve can start from (collective).

        Args:
            positions: Positions of all assembled vertices, (n, 3), in m, for example of a coarser
                mesh.

        Returns:
            These positions, relaxed where they leave the stretch bounds or nearly so; None if that
            does not help, or if surfaces overlap or cross that may touch.
        """
        model = self.model
        found = relaxed_start(model, positions)
        if found is None:
            return None
        owned = found[self.skin.owned_vertices]
        return owned if model.refusal(model.state_of(owned)) is None else None

    @collective("self.skin.comm", owned=("trial",))
    def finish(self, trial: Equilibrium) -> Equilibrium:
        """Complete a trial: the tolerance of the options, and a stable state (collective).

        Args:
            trial: A result of this solver; one that is complete is returned as it is.

        Returns:
            The equilibrium; steps and factorisations are those of the completion alone.

        Raises:
            EquilibriumError: There is no stable equilibrium near.
        """
        require_kind("trial", trial, Equilibrium, "an Equilibrium of this solver")
        if trial.complete:
            return trial
        start = trial.state.copy()
        search = self._search(trial.density, trial.load, start, trial, trial=False, direct=True)
        found = self._solve(search, trial.begin)
        if not found.converged:
            raise EquilibriumError(found.reason, found)
        return found

    def save(self, at: Equilibrium) -> tuple[Floats, dict[str, Any]]:
        """Return what `restore` needs: all unknowns by original index, and numbers (collective).

        Args:
            at: An equilibrium of this solver; of the last one a restored run goes on to the bit.
        """
        numbers = {**at.numbers(), "first_shift": self._newton.ladder.first}
        return self.model.patch.gather(at.state), numbers

    @collective("self.skin.comm", owned=("density", "numbers"))
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

        Args:
            density: As of `solve`.
            unknowns, numbers: As of `save`; the numbers may have been written as JSON.
            load: Forces and displacement of the load, which the numbers do not hold; None for none.

        Raises:
            ParameterError: The unknowns are those of another skin.
            EquilibriumError: It is no equilibrium any more, and there is none near.
        """
        model, newton = self.model, self._newton
        given = replace(
            load or Load(),
            pressure=numbers["pressures"],
            poses=numbers["poses"],
            weight_fraction=numbers["weight_fraction"],
            bodies_fraction=numbers["bodies_fraction"],
        )
        acting, density, state = (
            given.on(model),
            model.check(density),
            model.patch.scatter(unknowns),
        )
        read = numbers_read(numbers)
        self._set(density, acting, read["begin"], state)
        residual = self._residual_at(state)
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
            sliding=self._sliding_at(state),
        )
        self._at = found
        return found

    def like(self, **changes: Any) -> EquilibriumSolver:
        """Return another solver, which differs in some arguments of the class (collective)."""
        return EquilibriumSolver(**{**self._given, **changes})

    def refined(
        self,
        finer: Refinement,
        *,
        supports: Supports | None = None,
        options: NewtonOptions | None = None,
    ) -> EquilibriumSolver:
        """Return the solver of the skin with each triangle divided into four (collective).

        Args:
            finer: The refined pattern.
            supports: Its supports; None fixes the middle of an edge where both its ends are.
            options: Its tolerance and limits; None takes those of this solver.
        """
        chambers = self._given["chambers"]
        return self.like(
            skin=sew(self.skin.comm, finer.pattern),
            supports=self.model.supports.refined(finer) if supports is None else supports,
            chambers=chambers and chambers.refined(finer),
            options=options or self.options,
            log=None,
        )

    def tangent_at(self, at: Equilibrium) -> None:
        """Factorise the tangent at an equilibrium, if it is not that already (collective).

        Raises:
            ParameterError: It is not complete; or its tangent is not positive definite, as that of
                another solver.
        """
        require_kind("at", at, Equilibrium, "an Equilibrium of this solver")
        if at is self._at:
            return
        refusal = ParameterError(
            "the state is no stable equilibrium of this solver: finish a trial first, and ask the "
            "solver that found it."
        )
        with together(self.skin.comm):
            if not at.complete or at.state.shape != (self.model.size_local,):
                raise refusal
        self._set(at.density, at.load, at.begin, at.state)
        if not self._newton.stable(at.state):
            raise refusal
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
        solves, with the factors of the symmetric part.

        Args:
            rhs: Owned unknowns.
            at: An equilibrium of this solver; its tangent is factorised again if another solve came
                between.
            adjoint: Whether to solve with the transpose, which differs with friction: normal forces
                change it, and it does not change them.

        Raises:
            ParameterError: As of `tangent_at`; or an adjoint through friction on free bodies is
                asked for.
            NoEquilibriumError: With friction: the iteration does not converge.
        """
        self.tangent_at(at)
        rhs, model, factor = rhs * self.model.free, self.model, self._factor
        if not model.slides:
            return factor.solve(rhs)
        if adjoint and self.contact is not None and self.contact.free_bodies:
            raise ParameterError(
                "there is no adjoint through friction on free bodies; hold or move the bodies, or "
                "leave the friction out."
            )
        return solve_with_friction(model, factor, at.state, rhs, transposed=adjoint)

    def reactions(self, at: Equilibrium) -> Floats:
        """Return the forces in N by which the supports pull at all vertices (collective).

        Args:
            at: An equilibrium of this solver.

        Returns:
            Shape (n, 3), zero at free components, on every rank.
        """
        self.tangent_at(at)
        return self.skin.gather_vertices(self.model.positions(self.model.reaction(at.state)))

    def _set(self, density: Floats, load: Load, begin: Sliding | None, state: Floats) -> None:
        """Let the model have density, load and friction of a state."""
        self.forget()
        self.model.set_density(density)
        self.model.set_load(load)
        contact = self.model.contact
        if contact is not None:
            contact.begin_step(begin, load)
            contact.lag_friction(state)

    def _sliding_at(self, state: Floats) -> Sliding | None:
        """Return where the skin sticks at the end of a step; None without friction."""
        contact = self.model.contact
        return None if contact is None else contact.end_step(state)

    def _search(
        self,
        density: Floats,
        load: Load,
        start: Floats,
        near: Equilibrium | None,
        *,
        trial: bool,
        direct: bool,
    ) -> Search:
        return Search(
            self.model,
            self._newton,
            Attempts(self._newton, near=near is not None),
            self._prescribed,
            density,
            load,
            start,
            near,
            self.options.min_increment,
            trial=trial,
            direct=direct,
        )

    def _solve(self, search: Search, begin: Sliding | None) -> Equilibrium:
        """Solve for an equilibrium (collective)."""
        self.forget()
        density, load, near, attempts = search.density, search.load, search.near, search.attempts
        if self.model.contact is not None:
            self.model.contact.begin_step(begin, load)
        end = search_equilibrium(search)
        origin = None if near is None else near.origin
        # Between two designs there is no path that a skin takes. Where bodies or supports push it
        # along, the path has been taken step by step. A path with friction is made of its steps.
        if origin is not None and (
            not self._same_design(origin.density, density)
            or (self.contact is not None and load.moves_from(origin.load))
            or self.model.slides
        ):
            origin = None
        definite = attempts.definite and (near is None or near.definite)
        snapped = critical = None
        if end.load_factor == 1.0 and not search.trial:
            point = PathPoint(density, load, end.state)
            if origin is not None:
                snapped, point = connect(
                    self.model,
                    self._newton,
                    lambda start, at: attempts(self._prescribed(start, at.displacement)),
                    origin,
                    point,
                    definite=definite,
                )
                end = ContinuationResult(point.state, 1.0, end.outcome)
            if origin is not None or not search.direct:
                critical = critical_load(self.model, self._factor, point)
        found = replace(
            self._result(search, end, snapped, critical),
            begin=begin,
            before=origin if search.trial else None,
            definite=attempts.definite,
        )
        if found.converged and not search.trial:
            self._at = found
        return found

    def _residual_at(self, state: Floats) -> float:
        """Return the norm of the first variation over the applied load (collective)."""
        size = norm(self.skin.comm, self.model.residual(state))
        return size / self._newton.reference(state)

    def _same_design(self, one: Floats, two: Floats) -> bool:
        return largest(self.skin.comm, float(np.abs(one - two).max(initial=0.0))) == 0

    def _result(
        self,
        search: Search,
        end: ContinuationResult,
        snapped: bool | None,
        critical: float | None,
    ) -> Equilibrium:
        """Return the result at the last state, under its fraction of the load (collective)."""
        model, state, load, attempts = self.model, end.state, search.load, search.attempts
        load_factor = end.load_factor or 0.0
        model.set_load(load.scaled(load_factor))
        state.setflags(write=False)
        seen, residual = readings(model, state), self._residual_at(state)
        condition = condition_of(model, state, snapped, critical)
        if load_factor == 1.0 and condition.sentences and self.log is not None:
            self.log(condition.sentences)
        if load_factor == 1.0 and search.trial:
            reason = f"A state near an equilibrium was found at {load}; `finish` completes it."
        elif load_factor == 1.0:
            reason = success(model, load, residual, seen["volumes"], condition)
        else:
            assert attempts.last is not None
            steps, once = search.max_steps, search.direct
            reason = failure(model, end, load, attempts.last, max_steps=steps, once=once)
        return Equilibrium(
            **seen,
            density=search.density,
            load=load,
            converged=load_factor == 1.0,
            complete=load_factor == 1.0 and not search.trial,
            load_factor=load_factor,
            reason=reason,
            residual=residual,
            condition=condition,
            steps=attempts.steps,
            modified_steps=attempts.modified_steps,
            factorisations=attempts.factorisations,
            history=tuple(attempts.history),
            sliding=self._sliding_at(state),
        )


def _require_kinds(
    composite: Any, supports: Any, options: Any, log: Any, chambers: Any, weight: Any
) -> None:
    """Check the types of what a solver is made of.

    Raises:
        ParameterError: Naming the one that is of another type.
    """
    nothing = type(None)
    require_kind("composite", composite, Composite, "a Composite, by Composite(fabric, …)")
    require_kind("supports", supports, Supports, "Supports, by clamp(pattern, panels) for instance")
    require_kind("options", options, (NewtonOptions, nothing), "NewtonOptions, or None")
    require_kind("chambers", chambers, (Chambers, nothing), "Chambers, or None for one")
    require_kind("weight", weight, (Weight, nothing), "a Weight, or None for none")
    if log is not None:
        require_callable("log", log, "a function of a Newton step, or None")


def _warn_of_odd_sheets(skin: Skin, composite: Composite) -> None:
    thickness = max(composite.fabric.thickness, composite.reinforcement.thickness)
    if thickness > THICK * skin.pattern.size:
        warn_together(
            skin.comm,
            f"the sheet is {thickness:.3g} m thick and the skin {skin.pattern.size:.3g} m across. "
            "Is the thickness in millimetres? Give it in m: 0.5 mm are 0.5e-3.",
            UnitWarning,
        )
    printed, fabric = (
        sheet.membrane_stiffness for sheet in (composite.reinforcement, composite.fabric)
    )
    if printed < fabric:
        warn_together(
            skin.comm,
            f"the reinforcement, E h = {printed:.3g} N/m, is softer than the fabric, {fabric:.3g} "
            "N/m: a print would weaken it. Are the two exchanged?",
            MaterialWarning,
        )
    if composite.widest_bounds != composite.fabric_bounds:
        warn_together(
            skin.comm,
            f"the stretch bounds are {composite.stated_bounds}: fabric with a print on it "
            "stretches no further than without. Give the reinforcement narrower bounds, or none "
            "of its own.",
            MaterialWarning,
        )
