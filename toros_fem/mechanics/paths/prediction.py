"""Prediction of the next equilibrium of a path by the last ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import norm
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.equilibrium.ways import same_design
from toros_fem.mechanics.skin.load import Load

# Largest number of equilibria that the polynomial passes through.
POINTS = 3
# Distance from the line of loads, over the distance of the loads, that is rounding.
ON_LINE = 1e-9


@dataclass(frozen=True, eq=False)
class Tangent:
    """Direction of a path at one of its equilibria.

    Attributes:
        motion: Motion of the owned unknowns that the tangent predicts.
        along: Change of `_amounts` by which they move so.
    """

    motion: Floats
    along: Floats

    def scaled(self, along: Floats) -> Floats | None:
        """Return the motion by another change of the load; None if it is not in proportion."""
        factor = float(along @ self.along) / float(self.along @ self.along or 1.0)
        off = np.linalg.norm(along - factor * self.along)
        return None if off > ON_LINE * np.linalg.norm(along) else factor * self.motion


@dataclass(frozen=True, eq=False)
class Known:
    """An equilibrium of a path, with its tangent; None where that is not known."""

    at: Equilibrium
    tangent: Tangent | None

    def slope(self, along: Floats) -> Floats | None:
        """Return the motion by a change of the load, to first order; None if it is not known."""
        return None if self.tangent is None else self.tangent.scaled(along)


class Prediction:
    """Equilibria of a path, and where the next one is expected.

    A polynomial of pressures and weights passes through the last equilibria for which these lie on
    a line with the next ones, with the tangents there (Hermite interpolation). After a jump the
    prediction begins anew.
    """

    def __init__(self, solver: EquilibriumSolver, first: Equilibrium) -> None:
        self._solver = solver
        self._points = [Known(first, None)]

    @property
    def last(self) -> Equilibrium:
        """The last equilibrium."""
        return self._points[-1].at

    def add(self, found: Equilibrium) -> None:
        """Add the next equilibrium (collective).

        Its tangent costs one solution while its factors are at hand.
        """
        before = self.last
        same = same_design(self._solver.model, before.density, found.density)
        kept = self._points if same and not found.condition.snapped else []
        along = same and _on_a_line(before.load, found.load)
        tangent = self._tangent(found, found.density, before.load) if along else None
        self._points = [*kept, Known(found, tangent)][-POINTS:]

    def motion(self, density: Floats, load: Load) -> float:
        """Return how far the skin is expected to move to a load (collective).

        It is the root of the sum of squares over all vertices, in m; 0 where nothing is predicted.
        """
        positions = self._solver.model.positions
        step = self._step(self._slope(density, load), load)
        return 0.0 if step is None else norm(self._solver.skin.comm, positions(step))

    def start(self, density: Floats, load: Load) -> Equilibrium:
        """Return what a solve under a load starts from (collective).

        It is a trial at the predicted state, or the last equilibrium where the prediction leaves
        the stretch bounds, meets anything, or has more energy.
        """
        last, model, slope = self.last, self._solver.model, self._slope(density, load)
        step = self._step(slope, load)
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
        return replace(last, state=state, complete=False, before=replace(last.point, motion=slope))

    def _step(self, slope: Floats | None, load: Load) -> Floats | None:
        """Return the predicted change of the unknowns from the last tangent; None without one.

        Where supports or bodies move they carry the skin along. Friction makes a path of steps.
        """
        if self._solver.model.slides:
            return None
        places = self._places(load)
        if len(places) < 2:
            return slope
        points, along = self._points[-len(places) :], _amounts(load) - _amounts(self.last.load)
        slopes = [*(point.slope(along) for point in points[:-1]), slope]
        values, of_slopes = _hermite(places, [one is not None for one in slopes])
        step: Floats = np.zeros_like(self.last.state)
        for weight, point in zip(values, points, strict=True):
            step += weight * (point.at.state - self.last.state)
        known = (one for one in slopes if one is not None)
        for weight, one in zip(of_slopes, known, strict=True):
            step += weight * one
        return step

    def _slope(self, density: Floats, load: Load) -> Floats | None:
        """Return the motion to a load by the tangent at the last equilibrium, or None."""
        last = self._points[-1]
        same = same_design(self._solver.model, last.at.density, density)
        kept = same and _on_a_line(last.at.load, load)
        found = last.slope(_amounts(load) - _amounts(last.at.load)) if kept else None
        if found is not None:
            return found
        tangent = self._tangent(last.at, density, load)
        if kept:
            self._points[-1] = replace(last, tangent=tangent)
        return None if tangent is None else tangent.motion

    def _tangent(self, at: Equilibrium, density: Floats, load: Load) -> Tangent | None:
        """Return the direction of the path at an equilibrium; None where it is not known."""
        model = self._solver.model
        if load.moves_from(at.load) or model.slides or at.density.shape[1:] != density.shape[1:]:
            return None
        try:
            motion = self._solver.motion_to(density, load, at)
        except ParameterError:  # raised by all ranks or by none: a trial, or of another solver
            return None
        return Tangent(motion, _amounts(load) - _amounts(at.load))

    def _places(self, load: Load) -> list[float]:
        """Return where the last loads are on the line from the last one, at 0, to a load, at 1."""
        last = _amounts(self.last.load)
        along = _amounts(load) - last
        length = float(np.linalg.norm(along))
        places: list[float] = []
        for point in reversed(self._points):
            there = _amounts(point.at.load) - last
            place = float(there @ along) / length**2 if length > 0 else 0.0
            off = np.linalg.norm(there - place * along) > ON_LINE * length
            again = any(abs(place - other) < ON_LINE for other in places)
            if off or again or not _on_a_line(point.at.load, load):
                break
            places.insert(0, place)
        return places


def _amounts(load: Load) -> Floats:
    """Return the pressures in Pa, and the fraction of the weight."""
    return np.array([*load.pressures, load.weight])


def _on_a_line(one: Load, other: Load) -> bool:
    """Return whether two loads differ by pressures and weights alone."""
    if other.moves_from(one):
        return False
    if one.force is None or other.force is None:
        return one.force is other.force
    return np.array_equal(one.force, other.force)


def _hermite(places: Sequence[float], sloped: Sequence[bool]) -> tuple[Floats, Floats]:
    """Return the weights of values at places, and of slopes at some of them, for the value at 1.

    The polynomial of least degree through all of them is evaluated.
    """
    at, slopes = np.array(places), np.array(places)[np.array(sloped)]
    powers = np.arange(len(at) + len(slopes))
    of_slopes = powers * slopes[:, None] ** np.maximum(powers - 1, 0)
    weights = np.linalg.solve(np.vstack([at[:, None] ** powers, of_slopes]).T, np.ones(len(powers)))
    return weights[: len(at)], weights[len(at) :]
