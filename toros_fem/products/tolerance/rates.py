"""First-order changes of a skin's shape, metrics and objective, by its own tangent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.mpi import dot
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.design.loop.shape_problem import carried_along
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.skin.load import Load
from toros_fem.meshes.pattern import Pattern
from toros_fem.products.tolerance.result import OBJECTIVE

# Step of differences of the residual by a stiffness, as a fraction of it.
STEP = 1e-3


@dataclass(frozen=True, eq=False)
class Rate:
    """Derivatives by one quantity.

    Attributes:
        motion: That of the state, at owned unknowns.
        values: Those of objective and metrics, by key.
    """

    motion: Floats
    values: dict[str, float]


class TangentRates:
    """Derivatives of an equilibrium by what its skin is made of (all methods are collective).

    With the residual f = ∂E/∂x and the tangent K, a change of f is followed by the motion
    y = −K⁻¹ δf; metrics are differenced along it. The objective's derivative is −λ · δf with
    K λ = ∂T/∂x: the adjoint of eq. (19).

    Args:
        density: Density of the owned triangles.
        equilibrium: The last equilibrium of its solver.
    """

    def __init__(self, problem: ShapeDesign, density: Floats, equilibrium: Equilibrium) -> None:
        self.problem, self.density, self.equilibrium = problem, density, equilibrium
        self.model = problem.solver.model
        self.load = self.model.load
        gradient = np.zeros_like(equilibrium.state)
        self.model.positions(gradient)[:] = problem.objective.backward(equilibrium.positions)
        self._adjoint = problem.solver.solve_tangent(gradient, equilibrium, adjoint=True)

    def by_pressure(self) -> Rate:
        """Return the derivatives by the pressure, over the pressure."""
        model, state = self.model, self.equilibrium.state
        force = np.zeros_like(state)
        for chamber, pressure in enumerate(self.load.pressures):
            force -= pressure * model.volume_gradient(state, chamber)
        return self._rate(force)

    def by_composite(self, changed: Callable[[float], Composite]) -> Rate:
        """Return the derivatives by the factor that materials are changed by."""
        force = self._residual(changed(1 + STEP)) - self._residual(changed(1 - STEP))
        return self._rate(np.asarray(force / (2 * STEP)))

    def by_borders(self, less: MovedSkin, more: MovedSkin, density: Floats, step: float) -> Rate:
        """Return the derivatives by the width of lines, from skins with less and more of it, per m.

        They are those of places of the sheet: what goes along with the mesh is left out.
        """
        ends = [skin.residual(density, self.load) for skin in (less, more)]
        return self._rate(np.asarray(self.model.patch.scatter(ends[1] - ends[0]) / (2 * step)))

    def _residual(self, composite: Composite) -> Floats:
        model = self.problem.solver.like(composite=composite, log=None).model
        model.set_density(self.density)
        model.set_load(self.load)
        return model.residual(self.equilibrium.state)

    def _rate(self, force: Floats) -> Rate:
        """Return the derivatives for one of the residual."""
        problem, equilibrium = self.problem, self.equilibrium
        motion = problem.solver.solve_tangent(-force, equilibrium)
        slope = -dot(problem.comm, self._adjoint, force)
        return Rate(motion, {OBJECTIVE: slope, **problem.metrics_along(equilibrium, motion)})


class MovedSkin:
    """The same skin with its print's borders moved (all methods are collective).

    Attributes:
        problem: Its design problem.
        unknowns: Where the equilibrium's unknowns go with the mesh, by original index.

    Args:
        problem: The problem on the moved pattern.
        nominal: The pattern before.
        motion: Way of the flat points, (m, 2), in m.
        unknowns: Unknowns of the equilibrium before, as of `Patch.gather`.
    """

    def __init__(
        self, problem: ShapeDesign, nominal: Pattern, motion: Floats, unknowns: Floats
    ) -> None:
        self.problem, self._nominal, self._motion = problem, nominal, motion
        count = 3 * len(nominal.points)
        places = unknowns[:count].reshape(-1, 3)
        moved = places + self._carried(nominal, places)
        self.unknowns = np.concatenate([moved.ravel(), unknowns[count:]])

    def state(self, change: Floats | float = 0.0) -> Floats:
        """Return the state of this rank, with a change of all unknowns added."""
        return self.problem.solver.model.patch.scatter(self.unknowns + change)

    def residual(self, density: Floats, load: Load) -> Floats:
        """Return the residual of all unknowns; the density is that of all triangles, (t,)."""
        model, skin = self.problem.solver.model, self.problem.skin
        model.set_density(density[skin.owned_cells])
        model.set_load(load)
        return model.patch.gather(model.residual(self.state()))

    def before(self, owned: Floats) -> Floats:
        """Return where all vertices' places before the move are in a shape, (n, 3), in m.

        Metrics and objectives sort vertices by their places; so these stay the same ones. Ranks may
        own others than those of the skin before the move.
        """
        skin = self.problem.skin
        positions = skin.gather_vertices(owned)
        return np.asarray(positions - self._carried(skin.pattern, positions))

    def _carried(self, pattern: Pattern, positions: Floats) -> Floats:
        """Return the way of all vertices with the deformed mesh, (n, 3)."""
        way = carried_along(pattern, positions, self._motion)
        # What is held stays where the supports have it.
        held = self.problem.skin.pattern.points - self._nominal.points
        fixed = self.problem.solver.model.supports.fixed
        return np.where(fixed, held, way)


def values_at(problem: ShapeDesign, owned: Floats) -> dict[str, float]:
    """Return objective and metrics at positions of the owned nodes, by key (collective)."""
    return {OBJECTIVE: problem.objective.forward(owned), **problem.metrics_at(owned)}
