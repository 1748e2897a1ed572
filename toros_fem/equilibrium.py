"""Equilibrium of a pressurised skin: cold by continuation in the pressure, or warm."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from toros_fem._mpi import norm, raise_together
from toros_fem.continuation import Climb, climb
from toros_fem.density import check_density
from toros_fem.errors import ParameterError, TorosError
from toros_fem.factor import PREFIX, Factor
from toros_fem.meshes.skin import Skin
from toros_fem.model import SkinModel
from toros_fem.newton import NewtonStep, RegularisedNewton
from toros_fem.parameters import Composite, NewtonOptions
from toros_fem.supports import Supports

Floats = npt.NDArray[np.float64]

# First step of a continuation from one design to another, as a share of the way.
FIRST_SHARE = 1 / 16
# How many times `max_steps` the last attempt may take, from where the first cold one stopped.
PATIENCE = 6
# A hinge folded by so much, in rad, is near the angle where its energy jumps.
FOLDED = math.radians(170)


@dataclass(frozen=True, eq=False)
class EquilibriumResult:
    """What a solve found.

    Attributes:
        converged: Whether `state` is a stable equilibrium at the asked pressure.
        reason: Why the solve ended, as a sentence.
        pressure: Pressure of `state` in Pa.
        state: Owned position dofs in m, a flat array.
        energy: Energy of eq. (8) in J.
        volume: Enclosed volume in m³.
        stretch_use: Largest share of the stretch bounds that a triangle uses, < 1.
        residual: Norm of the first variation over the applied load.
        steps: Newton steps, each with a factorisation of its own.
        chords: Steps with a factorisation that was at hand.
        factorisations: Factorisations of the tangent, retries with a shift included.
        history: One row a Newton step.
    """

    converged: bool
    reason: str
    pressure: float
    state: Floats
    energy: float
    volume: float
    stretch_use: float
    residual: float
    steps: int
    chords: int
    factorisations: int
    history: tuple[NewtonStep, ...]


class EquilibriumError(TorosError, RuntimeError):
    """No equilibrium was found; `result` holds the last good state and the history."""

    def __init__(self, message: str, result: EquilibriumResult) -> None:
        super().__init__(message)
        self.result = result


class EquilibriumSolver:
    """Finds stable equilibria of a skin, and solves with the tangent there.

    Args:
        skin: The sewn skin.
        composite: Materials and stretch bounds.
        supports: What is held.
        options: How hard to try.
        log: Called with every row of a solve's history as it comes, on every rank.
    """

    def __init__(
        self,
        skin: Skin,
        composite: Composite,
        supports: Supports,
        options: NewtonOptions | None = None,
        log: Callable[[NewtonStep], None] | None = None,
    ) -> None:
        self.skin = skin
        self.model = SkinModel(skin, composite, supports)
        self.options = options or NewtonOptions()
        self._factor = Factor(self.model)
        self._newton = RegularisedNewton(self.model, self._factor, self.options, log)
        self._x, residual = self._factor.matrix.createVecs()
        snes = PETSc.SNES().create(skin.comm)
        snes.setOptionsPrefix(PREFIX)
        snes.setObjective(lambda _, x: self.model.energy(x.array_r))
        snes.setFunction(self._residual, residual)
        snes.setJacobian(self._tangent, self._factor.matrix)
        snes.setKSP(self._factor.ksp)
        snes.setTolerances(rtol=self.options.tolerance, max_it=self.options.max_steps)
        snes.setType(PETSc.SNES.Type.PYTHON)
        snes.setPythonContext(self._newton)
        snes.setFromOptions()
        self._snes = snes
        self._factorised_at: EquilibriumResult | None = None
        self._density: Floats = np.zeros(0)  # of that equilibrium

    def solve(
        self,
        density: Floats,
        pressure: float,
        *,
        start: Floats | None = None,
        raise_on_failure: bool = True,
    ) -> EquilibriumResult:
        """The stable equilibrium at a density and a pressure (collective).

        Args:
            density: Projected density of the owned triangles, in [0, 1].
            pressure: Pressure in Pa, ≥ 0.
            start: Owned position dofs to start from at the full pressure, a neighbouring
                equilibrium say; held components are put where they belong. Without it the solve
                starts from the assembled positions. Where the full pressure at once fails, it
                is raised in steps that shrink where they fail; where that fails too, the plain
                fabric is solved for and then stiffened.
            raise_on_failure: Whether to raise if no equilibrium is found, or to return the last
                good state with `converged` False.

        Raises:
            ParameterError: The pressure is negative or not finite, or the start does not fit.
            DensityError: The density does not fit, or leaves [0, 1].
            OpenSkinError: Pressure on a skin with free edges that no symmetry plane closes.
            EquilibriumError: No equilibrium was found; the error holds the last good state.
        """
        self._check(density, pressure, start)
        self.model.set_density(density)
        newton = self._newton
        last, self._factorised_at = self._factorised_at, None
        near = last if last is not None and start is last.state else None
        # The factors of the start's own equilibrium predict how it changes.
        newton.held = near is not None
        newton.history = []
        before = self._factor.count
        held = ~self.model.free
        state = self.model.assembled
        if start is not None:
            state = np.where(held, state, start)
        use = self.model.bounds.worst(self.model.corners(state))
        if not use < 1:
            raise ParameterError(
                f"the start leaves the stretch bounds: a triangle uses {use:.3g} of them, the "
                "bound is 1. Start from the assembled positions, or raise c1 and c2."
            )
        end = self._continue(state, density, pressure, near, cold=start is None)
        state, reached = end.state, end.reached
        converged = reached == pressure
        here = reached or 0.0
        self.model.set_pressure(here)
        newton.pressure = here
        result = EquilibriumResult(
            converged=converged,
            reason=self._sentence(end.outcome, pressure, reached, state),
            pressure=here,
            state=state,
            energy=self.model.energy(state),
            volume=self.model.volume(state),
            stretch_use=self.model.bounds.worst(self.model.corners(state)),
            residual=norm(self.skin.comm, self.model.residual(state)) / newton.reference(state),
            steps=sum(row.step > 0 and not row.chord for row in newton.history),
            chords=sum(row.chord for row in newton.history),
            factorisations=self._factor.count - before,
            history=tuple(newton.history),
        )
        if converged:
            self._factorised_at, self._density = result, density.copy()
        elif raise_on_failure:
            raise EquilibriumError(result.reason, result)
        return result

    def solve_tangent(self, rhs: Floats, at: EquilibriumResult) -> Floats:
        """Solve K y = rhs with the tangent at an equilibrium, zero at held components.

        Args:
            rhs: Owned dofs.
            at: The last equilibrium this solver found: its tangent is still factorised.

        Raises:
            ParameterError: The solver has solved for something else since.
        """
        if at is not self._factorised_at:
            raise ParameterError(
                "the tangent is that of another state: the solver has been used since. Solve for "
                "this state again, then ask for its tangent or gradient."
            )
        return self._factor.solve(rhs * self.model.free)

    def _continue(
        self,
        state: Floats,
        density: Floats,
        pressure: float,
        near: EquilibriumResult | None,
        *,
        cold: bool,
    ) -> Climb:
        """At once, from the near equilibrium, by the pressure, by the stiffness, patiently.

        Returns:
            How far the pressure came at the asked density.
        """
        found, outcome, _ = self._attempt(state, density, pressure)
        if outcome > 0:
            return Climb(found, pressure, outcome)
        least = self.options.min_increment
        if near is not None:
            there, pressure_there = self._density, near.pressure

            def walk(x: Floats, share: float) -> tuple[Floats, int, int]:
                mixed = there + share * (density - there)
                return self._attempt(x, mixed, pressure_there + share * (pressure - pressure_there))

            begin = Climb(state, 0.0, outcome)
            walked = climb(walk, begin, 1.0, FIRST_SHARE, least)
            if walked.reached == 1.0:
                return Climb(walked.state, pressure, walked.outcome)
        if not cold:
            found, outcome, _ = self._attempt(self.model.assembled, density, pressure)
            if outcome > 0:
                return Climb(found, pressure, outcome)
        unfinished = found
        # One that strains by a few per cent.
        small = 0.1 * self.model.composite.fabric.membrane_stiffness / self.skin.pattern.size

        def raise_pressure(of: Floats) -> Climb:
            begin = Climb(self.model.assembled, None, outcome)
            increment = min(small, pressure / 4)
            return climb(lambda x, p: self._attempt(x, of, p), begin, pressure, increment, least)

        by_pressure = Climb(state, None, outcome)
        if pressure > 0:
            by_pressure = raise_pressure(density)
            if by_pressure.reached == pressure:
                return by_pressure
            if by_pressure.reached is None:
                by_pressure = Climb(state, None, by_pressure.outcome)
        plain = np.zeros_like(density)
        found, outcome, _ = self._attempt(self.model.assembled, plain, pressure)
        soft = Climb(found, pressure, outcome)
        if outcome <= 0 and pressure > 0:
            soft = raise_pressure(plain)
        if soft.outcome > 0:
            stiffened = climb(
                lambda x, share: self._attempt(x, share * density, pressure),
                Climb(soft.state, 0.0, soft.outcome), 1.0, FIRST_SHARE, least,
            )  # fmt: skip
            if stiffened.reached == 1.0:
                return Climb(stiffened.state, pressure, stiffened.outcome)
        most = self._snes.getTolerances()[3]
        self._snes.setTolerances(max_it=PATIENCE * most)
        found, outcome, _ = self._attempt(unfinished, density, pressure)
        self._snes.setTolerances(max_it=most)
        if outcome > 0:
            return Climb(found, pressure, outcome)
        return by_pressure

    def _attempt(self, start: Floats, density: Floats, pressure: float) -> tuple[Floats, int, int]:
        """One solve of the SNES: the state, its converged reason, and how many steps it took."""
        self.model.set_density(density)
        state, rows = start.copy(), len(self._newton.history)
        outcome = self._newton_solve(state, pressure)
        return state, outcome, len(self._newton.history) - rows

    def _newton_solve(self, state: Floats, pressure: float) -> int:
        self.model.set_pressure(pressure)
        self._newton.pressure = pressure
        self._x.array[:] = state
        rows = len(self._newton.history)
        self._snes.solve(None, self._x)
        state[:] = self._x.array
        outcome = int(self._snes.getConvergedReason())
        if outcome > 0 and len(self._newton.history) == rows and not self._newton.stable(state):
            # Another type of SNES, chosen by an option, may have stopped at a saddle.
            return int(PETSc.SNES.ConvergedReason.DIVERGED_INNER)
        return outcome

    def _residual(self, _: PETSc.SNES, x: PETSc.Vec, f: PETSc.Vec) -> None:
        f.array_w[:] = self.model.residual(x.array_r)

    def _tangent(self, _: PETSc.SNES, x: PETSc.Vec, __: PETSc.Mat, ___: PETSc.Mat) -> None:
        self._factor.assemble(x.array_r)
        self._factor.fill(0.0)

    def _sentence(self, outcome: int, pressure: float, reached: float | None, state: Floats) -> str:
        if reached == pressure:
            return f"A stable equilibrium was found at {pressure:g} Pa."
        why = {
            int(PETSc.SNES.ConvergedReason.DIVERGED_MAX_IT): (
                f"Newton's method took {self.options.max_steps} steps without converging"
            ),
            int(PETSc.SNES.ConvergedReason.DIVERGED_INNER): "what was found is not stable",
        }.get(outcome, "no step lowered the energy any more")
        bounds = f"c1 = {self.model.composite.c1:g}, c2 = {self.model.composite.c2:g}"
        begin = f"No equilibrium inside the stretch bounds ({bounds}) was found at pressure = "
        begin += f"{pressure:g} Pa, at once, by raising the pressure, or by stiffening the plain "
        begin += f"fabric: {why}."
        folds = self.model.folds(self._x.array_r.copy(), FOLDED)
        if folds:  # each edge is seen from both sides
            begin += (
                f" Where the last attempt ended {folds // 2} edges are folded by more than "
                f"{math.degrees(FOLDED):.0f} degrees: the skin collapses onto itself there, and "
                "contact is not modelled."
            )
        if reached is None:
            return (
                f"{begin} Nor was there any at a lower one; the state is the one started from. "
                "Check materials and supports, start from a neighbouring equilibrium, allow more "
                "steps, or refine the mesh."
            )
        use = self.model.bounds.worst(self.model.corners(state))
        return (
            f"{begin} The last equilibrium is at {reached:g} Pa, where the most stretched "
            f"triangle uses {100 * use:.1f} % of the bounds. Lower the pressure to about "
            f"{reached:.3g} Pa, stiffen the skin, or refine the mesh where it is most stretched."
        )

    def _check(self, density: Floats, pressure: float, start: Floats | None) -> None:
        if not (math.isfinite(pressure) and pressure >= 0):
            raise ParameterError(f"pressure = {pressure} Pa must be finite and at least 0.")
        if pressure > 0 and not self.model.closed:
            self.skin.pattern.require_closed()
        check_density(self.skin, density)
        error = None
        if start is not None and start.shape != (self.model.size_local,):
            error = ParameterError(
                f"start has shape {start.shape}; this rank owns {self.model.size_local} dofs."
            )
        raise_together(self.skin.comm, error)
