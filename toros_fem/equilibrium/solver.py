"""Equilibrium of a pressurised skin: cold by continuation in the load, or warm."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from toros_fem._mpi import norm
from toros_fem._types import Floats
from toros_fem.density.field import check_density
from toros_fem.equilibrium.continuation import ContinuationResult, run_continuation
from toros_fem.equilibrium.diagnostics import failure, success
from toros_fem.equilibrium.load_case import check_start, make_load_case
from toros_fem.equilibrium.newton import NewtonStep
from toros_fem.equilibrium.options import NewtonOptions
from toros_fem.equilibrium.prescribed import PrescribedDisplacement
from toros_fem.equilibrium.snes import SnesSolver
from toros_fem.errors import NoEquilibriumError, ParameterError
from toros_fem.materials import Composite
from toros_fem.mechanics.chambers import Chambers
from toros_fem.mechanics.dead_loads import Weight
from toros_fem.mechanics.load_case import LoadCase
from toros_fem.mechanics.model import SkinModel
from toros_fem.mechanics.supports import Supports
from toros_fem.meshes.skin import Skin

# First step of a continuation from one design to another, as a share of the way.
FIRST_SHARE = 1 / 16
# How many steps a solve takes that need not be patient.
HASTE = 60
# How many times `max_steps` the last attempt may take, from where the first cold one stopped.
PATIENCE = 6


@dataclass(frozen=True, eq=False)
class EquilibriumResult:
    """What a solve found.

    Attributes:
        converged: Whether `state` is a stable equilibrium under the asked load.
        load_factor: Fraction of the requested load that acts on `state`.
        reason: Why the solve ended, as a sentence.
        pressure: Pressure of `state` in Pa, the largest of all chambers.
        pressures: Of each chamber.
        state: Owned unknowns in m, a flat array, as `SkinModel` has them.
        positions: Positions of the owned nodes in m, (n, 3), a view of `state`.
        energy: Energy of eq. (8) in J, less what dead forces do from the assembled positions on.
        volume: Enclosed volume in m³.
        volumes: Of each chamber.
        stretch_use: Largest share of the stretch bounds that a triangle uses, < 1.
        residual: Norm of the first variation over the applied load.
        steps: Newton steps, each with a factorisation of its own.
        chords: Steps with a factorisation that was at hand.
        factorisations: Factorisations of the tangent, retries with a shift included.
        history: One row a Newton step.
    """

    converged: bool
    load_factor: float
    reason: str
    pressure: float
    pressures: tuple[float, ...]
    state: Floats
    positions: Floats
    energy: float
    volume: float
    volumes: tuple[float, ...]
    stretch_use: float
    residual: float
    steps: int
    modified_steps: int
    factorisations: int
    history: tuple[NewtonStep, ...]


class EquilibriumError(NoEquilibriumError):
    """No equilibrium was found; `result` holds the last good state and the history."""

    def __init__(self, message: str, result: EquilibriumResult) -> None:
        super().__init__(message)
        self.result = result

    @property
    def steps(self) -> int:
        """Newton steps that it took."""
        return self.result.steps

    @property
    def factorisations(self) -> int:
        """Factorisations that it took."""
        return self.result.factorisations


class EquilibriumSolver:
    """Finds stable equilibria of a skin, and solves with the tangent there.

    Args:
        skin: The sewn skin.
        composite: Materials and stretch bounds.
        supports: What is held.
        options: How hard to try.
        log: Called with every row of a solve's history as it comes, on every rank.
        chambers: Pressure chambers; None for one.
        weight: The skin's own weight; None for none.
    """

    def __init__(
        self,
        skin: Skin,
        composite: Composite,
        supports: Supports,
        options: NewtonOptions | None = None,
        log: Callable[[NewtonStep], None] | None = None,
        *,
        chambers: Chambers | None = None,
        weight: Weight | None = None,
    ) -> None:
        self.skin = skin
        self.model = SkinModel(skin, composite, supports, chambers, weight)
        self.options = options or NewtonOptions()
        self._minimise = SnesSolver(self.model, self.options, log)
        self._factor, self._newton = self._minimise.factor, self._minimise.newton
        self._place = PrescribedDisplacement(self.model)
        self._factorised_at: EquilibriumResult | None = None
        self._density: Floats = np.zeros(0)  # of that equilibrium
        self._load = LoadCase(0.0, None)  # of that equilibrium

    def solve(
        self,
        density: Floats,
        pressure: float | Sequence[float],
        *,
        force: Floats | None = None,
        displacement: Floats | None = None,
        start: Floats | None = None,
        raise_on_failure: bool = True,
        allow_continuation: bool = True,
    ) -> EquilibriumResult:
        """The stable equilibrium at a density, a pressure and dead forces (collective).

        Args:
            density: Projected density of the owned triangles, in [0, 1].
            pressure: Pressure in Pa, ≥ 0, of all chambers or of each.
            force: Dead forces in N on all assembled vertices, (n, 3).
            displacement: Where supports are held instead of by their own `displacement`, (n, 3).
            start: Owned unknowns to start from at the full load, a neighbouring equilibrium's
                say, or positions of the owned nodes, (n, 3), as with another bending term; held
                components are put where they belong. Without it the solve starts from
                the assembled positions. Where the full load at once fails, it is raised in steps
                that shrink where they fail; where that fails too, the plain fabric is solved for
                and then stiffened.
            patient: Whether to go all these ways; False tries the full load at once and no more,
                for trials that are easily replaced by a more cautious one.
            raise_on_failure: Whether to raise if no equilibrium is found, or to return the last
                good state with `converged` False.

        Raises:
            ParameterError: The pressure is negative or not finite, or an array does not fit.
            DensityError: The density does not fit, or leaves [0, 1].
            OpenSkinError: Pressure on a skin with free edges that no symmetry plane closes.
            EquilibriumError: No equilibrium was found; the error holds the last good state.
        """
        load = make_load_case(self.model, pressure, force, displacement)
        check_density(self.skin, density)
        check_start(self.model, start)
        self.model.set_density(density)
        newton = self._newton
        last, self._factorised_at = self._factorised_at, None
        near = last if last is not None and start is last.state else None
        # The factors of the start's own equilibrium predict how it changes.
        newton.reuse_factors = near is not None
        newton.history = []
        before = self._factor.count
        state = self.model.assembled
        if start is not None and start.ndim == 2:
            self.model.positions(state)[:] = start
        elif start is not None:
            state = start
        use = self.model.bounds.worst(self.model.corners(state))
        if not use < 1:
            raise ParameterError(
                f"the start leaves the stretch bounds: a triangle uses {use:.3g} of them, the "
                "bound is 1. Start from the assembled positions, or raise c1 and c2."
            )
        end = self._continue(
            state, density, load, near, cold=start is None, allow_continuation=allow_continuation
        )
        state, load_factor = end.state, end.load_factor
        converged = load_factor == 1.0
        self._apply(load.scaled(load_factor or 0.0))
        state.setflags(write=False)
        volumes = tuple(float(v) for v in self.model.volumes(state))
        result = EquilibriumResult(
            converged=converged,
            load_factor=load_factor or 0.0,
            reason=self._reason(end, load, volumes),
            pressure=newton.pressure,
            pressures=tuple(float(p) for p in self.model.pressures),
            state=state,
            positions=self.model.positions(state),
            energy=self.model.energy(state),
            volume=sum(volumes),
            volumes=volumes,
            stretch_use=self.model.bounds.worst(self.model.corners(state)),
            residual=self._residual_over_load(state),
            steps=sum(row.step > 0 and not row.modified for row in newton.history),
            modified_steps=sum(row.modified for row in newton.history),
            factorisations=self._factor.count - before,
            history=tuple(newton.history),
        )
        if converged:
            self._factorised_at, self._density, self._load = result, density.copy(), load
        elif raise_on_failure:
            raise EquilibriumError(result.reason, result)
        return result

    def solve_tangent(self, rhs: Floats, at: EquilibriumResult) -> Floats:
        """Solve K y = rhs with the tangent at an equilibrium, zero at held components.

        Args:
            rhs: Owned unknowns.
            at: The last equilibrium this solver found: its tangent is still factorised.

        Raises:
            ParameterError: The solver has solved for something else since.
        """
        self._require_last(at)
        return self._factor.solve(rhs * self.model.free)

    def reactions(self, at: EquilibriumResult) -> Floats:
        """Forces in N by which the supports pull at all assembled vertices (collective).

        Args:
            at: The last equilibrium this solver found.

        Returns:
            Shape (n, 3), zero at free components, on every rank.

        Raises:
            ParameterError: The solver has solved for something else since.
        """
        self._require_last(at)
        return self.skin.gather_vertices(self.model.positions(self.model.reaction(at.state)))

    def _require_last(self, at: EquilibriumResult) -> None:
        if at is not self._factorised_at:
            raise ParameterError(
                "the tangent is that of another state: the solver has been used since. Solve for "
                "this state again, then ask for its tangent, gradient or reactions."
            )

    def _continue(
        self,
        state: Floats,
        density: Floats,
        load: LoadCase,
        near: EquilibriumResult | None,
        *,
        cold: bool,
        allow_continuation: bool,
    ) -> ContinuationResult:
        """At once, from the near equilibrium, by the load, by the stiffness, patiently.

        Returns:
            Which share of the load was reached at the asked density.
        """
        most = self._minimise.max_steps
        few = most if allow_continuation else min(HASTE, most)
        found, outcome, _ = self._attempt(state, density, load, few)
        if outcome > 0:
            return ContinuationResult(found, 1.0, outcome)
        if not allow_continuation:
            return ContinuationResult(state, None, outcome)
        least = self.options.min_increment
        if near is not None:
            there, load_there = self._density, self._load

            def walk(x: Floats, share: float) -> tuple[Floats, int, int]:
                mixed = there + share * (density - there)
                return self._attempt(x, mixed, load_there.towards(load, share))

            begin = ContinuationResult(state, 0.0, outcome)
            walked = run_continuation(walk, begin, 1.0, FIRST_SHARE, least)
            if walked.load_factor == 1.0:
                return walked
        if not cold:
            found, outcome, _ = self._attempt(self.model.assembled, density, load)
            if outcome > 0:
                return ContinuationResult(found, 1.0, outcome)
        unfinished = found
        # A pressure that strains by a few per cent.
        small = 0.1 * self.model.composite.least_stiffness / self.skin.pattern.size
        increment = min(small / load.largest, 1 / 4) if load.largest else FIRST_SHARE

        def raise_load(of: Floats) -> ContinuationResult:
            begin = ContinuationResult(self.model.assembled, None, outcome)
            return run_continuation(
                lambda x, share: self._attempt(x, of, load.scaled(share)), begin, 1.0, increment,
                least,
            )  # fmt: skip

        by_load = ContinuationResult(state, None, outcome)
        if load:
            by_load = raise_load(density)
            if by_load.load_factor == 1.0:
                return by_load
            if by_load.load_factor is None:
                by_load = ContinuationResult(state, None, by_load.outcome)
        plain = np.zeros_like(density)
        found, outcome, _ = self._attempt(self.model.assembled, plain, load)
        soft = ContinuationResult(found, 1.0, outcome)
        if outcome <= 0 and load:
            soft = raise_load(plain)
        if soft.outcome > 0:
            stiffened = run_continuation(
                lambda x, share: self._attempt(x, share * density, load),
                ContinuationResult(soft.state, 0.0, soft.outcome), 1.0, FIRST_SHARE, least,
            )  # fmt: skip
            if stiffened.load_factor == 1.0:
                return stiffened
        found, outcome, _ = self._attempt(unfinished, density, load, PATIENCE * most)
        if outcome > 0:
            return ContinuationResult(found, 1.0, outcome)
        return by_load

    def _attempt(
        self, start: Floats, density: Floats, load: LoadCase, max_steps: int | None = None
    ) -> tuple[Floats, int, int]:
        """One solve of the SNES: the state, its converged reason, and how many steps it took."""
        self.model.set_density(density)
        self._apply(load)
        return self._minimise(self._place(start, load.displacement), max_steps)

    def _apply(self, load: LoadCase) -> None:
        self.model.set_pressure(load.pressure)
        self.model.set_force(load.force)
        self.model.set_weight(load.weight)
        self.model.displaced = load.displacement is not None
        self._newton.pressure = load.largest

    def _reason(self, end: ContinuationResult, load: LoadCase, volumes: Sequence[float]) -> str:
        if end.load_factor == 1.0:
            return success(self.model, load, self._residual_over_load(end.state), volumes)
        tried = self._minimise.tried
        return failure(
            self.model, self.options, end.outcome, load, end.load_factor, end.state, tried
        )

    def _residual_over_load(self, state: Floats) -> float:
        return norm(self.skin.comm, self.model.residual(state)) / self._newton.reference(state)
