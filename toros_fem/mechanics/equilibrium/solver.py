"""Stable equilibrium of a skin under a load, by continuation where one solve fails."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Unpack

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import MaterialWarning, ParameterError, UnitWarning
from toros_fem.base.mpi import (
    collective,
    require_alike,
    together,
    warn_together,
)
from toros_fem.base.validation import (
    require_callable,
    require_flag,
    require_kind,
)
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.assembly.make_model import Further, make_model
from toros_fem.mechanics.contact.sliding import Sliding
from toros_fem.mechanics.equilibrium.attempts import Attempts
from toros_fem.mechanics.equilibrium.equilibrium import (
    Equilibrium,
    EquilibriumError,
    numbers_read,
)
from toros_fem.mechanics.equilibrium.friction_solve import solve_with_friction
from toros_fem.mechanics.equilibrium.newton import Newton
from toros_fem.mechanics.equilibrium.newton_step import NewtonStep
from toros_fem.mechanics.equilibrium.options import NewtonOptions
from toros_fem.mechanics.equilibrium.prescribed import PrescribedDisplacement
from toros_fem.mechanics.equilibrium.settle import residual_at, settle, sliding_at
from toros_fem.mechanics.equilibrium.start import relaxed_start, require_apart, start_state
from toros_fem.mechanics.equilibrium.ways import Search
from toros_fem.mechanics.skin.load import Load, Pressure, load_of
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes.skin import Skin, sew
from toros_fem.meshes.transfer import Refinement

# Factor on the residual of a saved equilibrium up to which it is the same one.
SAME_RESIDUAL = 10.0
# Thickness over the skin's size from which a unit is in doubt.
THICK = 0.1

# Less of the smoothing of strains is not taken away, where more is not possible.
LEAST_PART = 1 / 64


class EquilibriumSolver:
    """Solver for stable equilibria of a skin, and for linear systems with the tangent there.

    Args:
        skin: The sewn skin.
        composite: Materials and stretch bounds.
        supports: Fixed components and directions.
        options: Tolerance and limits.
        log: Called with every row of a solve's history as it comes, and with a sentence where the
            equilibrium snapped, is near a limit point, blown up or folded; on every rank.
        further: `chambers`: pressure chambers. `weight`: the skin's own weight. `contact`: what it
            touches. `design`: what is designed, if not densities. None, or none given, leaves each
            out (`make_model.Further`).

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
        **further: Unpack[Further],
    ) -> None:
        self.model = make_model(skin, composite, supports, **further)
        require_alike(skin.comm, options=options)
        require_kind("options", options, (NewtonOptions, type(None)), "NewtonOptions, or None")
        if log is not None:
            require_callable("log", log, "a function of a Newton step, or None")
        _warn_of_odd_sheets(skin, composite)
        self.skin, self.log, self.contact = skin, log, further.get("contact")
        self._further = further
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
        self.forget()
        model.set_density(density)  # smoothed strains, and so what a start may be, are by it
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

    def refined(self, finer: Refinement, **changes: Any) -> EquilibriumSolver:
        """Return the solver of the skin with each triangle divided into four (collective).

        Supports and chambers are those of the divided triangles: the middle of an edge is fixed
        where both its ends are.

        Args:
            finer: The refined pattern.
            changes: Other arguments of the class, in place of these.
        """
        chambers = self._further.get("chambers")
        own = {
            "skin": sew(self.skin.comm, finer.pattern),
            "chambers": chambers and chambers.refined(finer),
            "log": None,
        }
        if changes.get("supports") is None:
            changes["supports"] = self.model.supports.refined(finer)
        return self.like(**{**own, **changes})

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

    def unsmoothed_step(self, at: Equilibrium) -> Floats:
        """Return Newton's first step from an equilibrium without its smoothed strains (collective).

        Where strains leave the stretch bounds without smoothing, or the skin is not stable, the
        step is that to less of smoothing, in proportion.

        Args:
            at: An equilibrium of this solver with smoothed strains.

        Returns:
            Owned unknowns.

        Raises:
            ParameterError: As of `tangent_at`.
        """
        self.tangent_at(at)
        self.forget()
        model, part = self.model, 1.0
        while part > LEAST_PART:
            with model.unsmoothed(part):
                if model.admits(at.state) and self._newton.stable(at.state):
                    return np.asarray(self._factor.solve(-model.residual(at.state)) / part)
            part /= 2
        return np.zeros_like(at.state)

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
        found = settle(search, begin, self.log)
        if found.complete:
            self._at = found
        return found


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
