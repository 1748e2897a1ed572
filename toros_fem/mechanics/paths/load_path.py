"""A sequence of loads on one design, and gradients of functionals of the whole path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import collective, dot
from toros_fem.base.validation import require_kind
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load, Pressure, load_of


@dataclass(frozen=True, eq=False)
class PathGradient:
    """Gradient of a functional of a path.

    Attributes:
        density: By ρ̄ at owned triangles, (cells,).
        pressures: By the pressure of each chamber at each step, in 1/Pa, (steps, chambers).
    """

    density: Floats
    pressures: Floats


class LoadPath:
    """Equilibria of one design under one load after the other, and their adjoint.

    With friction an equilibrium depends on those before it. The path begins with a skin at rest at
    its assembled positions, whatever the density: two solves of one design give one result.

    Gradients are the discrete adjoint's, by one linear solve a step, from the last step back to
    the first. The tangent of each step is factorised anew.

    Attributes:
        solver: As given.
        steps: Loads in the order in which they act; numbers are pressures in Pa.
    """

    @collective("solver.skin.comm")
    def __init__(self, solver: EquilibriumSolver, steps: Sequence[Load | Pressure]) -> None:
        require_kind("solver", solver, EquilibriumSolver, "an EquilibriumSolver")
        if not isinstance(steps, list | tuple) or not steps:
            raise ParameterError(f"steps = {steps!r} must be a list of loads, at least one.")
        self.solver = solver
        self.steps = tuple(load_of(step).on(solver.model) for step in steps)

    @collective("self.solver.skin.comm", owned=("density",))
    def solve(
        self,
        density: Floats,
        pressures: Floats | None = None,
        near: Sequence[Equilibrium] | None = None,
    ) -> tuple[Equilibrium, ...]:
        """Return the equilibrium of each step at a density (collective).

        Args:
            density: As of `EquilibriumSolver.solve`.
            pressures: Pressure in Pa of each chamber at each step, (steps, chambers), in the place
                of those of the steps; None takes these.
            near: Path of a neighbouring design, at whose states the iterations start; None starts
                each at the step before. It does not change the path that is solved for.
        """
        if near is not None and len(near) != len(self.steps):
            raise ParameterError(
                f"near has {len(near)} equilibria; the path has {len(self.steps)} steps."
            )
        found: list[Equilibrium] = []
        for number, load in enumerate(self._loads(pressures)):
            after = found[-1] if found else None
            start = None if near is None else near[number]
            found.append(self.solver.solve(density, load, start, after=after))
        return tuple(found)

    @collective("self.solver.skin.comm", owned=("density", "slopes"))
    def gradient(
        self,
        density: Floats,
        equilibria: Sequence[Equilibrium],
        slopes: Sequence[Floats | None],
    ) -> PathGradient:
        """Return the gradient of a functional T of the path, eq. (19) at each step (collective).

        The equilibria are those that `solve` returned. The slopes are dT/dx by the positions of
        owned nodes at each step, (n, 3); None where T does not depend on a step.
        """
        if not len(equilibria) == len(slopes) == len(self.steps):
            raise ParameterError(
                f"there are {len(equilibria)} equilibria and {len(slopes)} slopes; the path has "
                f"{len(self.steps)} steps."
            )
        solver, model = self.solver, self.solver.model
        by_density = np.zeros(len(density))
        by_pressure = np.zeros((len(self.steps), len(model.load.pressures)))
        carried: Floats | None = None  # dT by the anchors that a step hands to the next
        for number in reversed(range(len(self.steps))):
            at, slope = equilibria[number], slopes[number]
            if slope is None and carried is None:
                continue
            rhs = np.zeros_like(at.state)
            if slope is not None:
                model.positions(rhs)[:] = slope
            solver.tangent_at(at)
            through: Floats | None = None
            if carried is not None:
                assert model.contact is not None
                by_state, through = model.contact.end_step_backward(at.state, carried)
                rhs += by_state
            adjoint = solver.solve_tangent(rhs, at, adjoint=True)
            by_density -= model.density_sensitivity(at.state, adjoint)
            for k in range(by_pressure.shape[1]):
                change = model.volume_gradient(at.state, k)
                by_pressure[number, k] = dot(solver.skin.comm, adjoint, change)
            if model.contact is not None and model.slides:
                carried = -model.contact.begin_step_backward(at.state, adjoint)
                carried += 0.0 if through is None else through
        return PathGradient(by_density, by_pressure)

    def _loads(self, pressures: Floats | None) -> Sequence[Load]:
        if pressures is None:
            return self.steps
        chambers = self.solver.model.chamber_count
        if np.shape(pressures) != (len(self.steps), chambers):
            raise ParameterError(
                f"pressures have shape {np.shape(pressures)}; they must be "
                f"({len(self.steps)}, {chambers}): one for each step and chamber, in Pa."
            )
        rows = zip(self.steps, pressures, strict=True)
        return [replace(step, pressure=row) for step, row in rows]
