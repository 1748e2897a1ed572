"""Prediction of the next equilibrium of a path by the last ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import norm
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.equilibrium.ways import same_design
from toros_fem.mechanics.skin.load import Load

# Largest number of equilibria that the polynomial passes through.
POINTS = 4
# Distance from the line of loads, over the distance of the loads, that is rounding.
ON_LINE = 1e-9


class Prediction:
    """Equilibria of a path, and where the next one is expected.

    A polynomial of pressures and weights passes through the last equilibria for which these lie on
    a line with the next ones. One equilibrium alone is continued along its tangent, if it is a
    stable one of this solver. After a jump the prediction begins anew.
    """

    def __init__(self, solver: EquilibriumSolver, first: Equilibrium) -> None:
        self._solver = solver
        self._points = [first]

    @property
    def last(self) -> Equilibrium:
        """The last equilibrium."""
        return self._points[-1]

    def add(self, found: Equilibrium) -> None:
        """Add the next equilibrium."""
        same = same_design(self._solver.model, self.last.density, found.density)
        kept = self._points if same and not found.condition.snapped else []
        self._points = [*kept, found][-POINTS:]

    def motion(self, density: Floats, load: Load) -> float:
        """Return how far the skin is expected to move to a load (collective).

        It is the root of the sum of squares over all vertices, in m; 0 where nothing is predicted.
        """
        positions, step = self._solver.model.positions, self._step(density, load)
        return 0.0 if step is None else norm(self._solver.skin.comm, positions(step))

    def start(self, density: Floats, load: Load) -> Equilibrium:
        """Return what a solve under a load starts from (collective).

        It is a trial at the predicted state, or the last equilibrium where the prediction leaves
        the stretch bounds, meets anything, or has more energy.
        """
        last, step, model = self.last, self._step(density, load), self._solver.model
        if step is None:
            return last
        self._solver.forget()  # the tangent at the last one: the model has another load now
        model.set_density(density)
        model.set_load(load)
        state = last.state + step
        if model.largest_step(last.state, step, 1.0) < 1 or not model.admits(state):
            return last
        if not model.energy(state) < model.energy(last.state):
            return last
        return replace(last, state=state, complete=False, before=last.point)

    def _step(self, density: Floats, load: Load) -> Floats | None:
        """Return the predicted change of the unknowns; None where there is none.

        Where supports or bodies move they carry the skin along. Friction makes a path of steps.
        """
        last, model = self.last, self._solver.model
        if load.moves_from(last.load) or model.slides:
            return None
        places = self._places(load)
        if len(places) > 1:
            step: Floats = np.zeros_like(last.state)
            points = self._points[-len(places) :]
            for weight, point in zip(_lagrange(places, 1.0), points, strict=True):
                step += weight * (point.state - last.state)
            return step
        if last.density.shape[1:] != density.shape[1:]:
            return None
        try:
            return self._solver.motion_to(density, load, last)
        except ParameterError:  # raised by all ranks or by none: a trial, or of another solver
            return None

    def _places(self, load: Load) -> list[float]:
        """Return where the last loads are on the line from the last one, at 0, to a load, at 1."""
        last = _amounts(self.last.load)
        along = _amounts(load) - last
        length = float(np.linalg.norm(along))
        places: list[float] = []
        for point in reversed(self._points):
            there = _amounts(point.load) - last
            place = float(there @ along) / length**2 if length > 0 else 0.0
            off = np.linalg.norm(there - place * along) > ON_LINE * length
            again = any(abs(place - other) < ON_LINE for other in places)
            if off or again or not _same_force(point.load, load):
                break
            places.insert(0, place)
        return places


def _amounts(load: Load) -> Floats:
    """Return the pressures in Pa, and the fractions of weights."""
    return np.array([*load.pressures, load.weight, load.weight_of_bodies])


def _same_force(one: Load, other: Load) -> bool:
    if one.force is None or other.force is None:
        return one.force is other.force
    return np.array_equal(one.force, other.force)


def _lagrange(places: list[float], at: float) -> list[float]:
    """Return the weights of values at places in the polynomial through them, at another place."""
    return [float(np.prod([(at - b) / (a - b) for b in places if b != a])) for a in places]
