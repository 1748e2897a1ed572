"""Prescribed motion of fixed components and held bodies, which the free components follow."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.mpi import largest
from toros_fem.mechanics.assembly.model import SkinModel
from toros_fem.mechanics.equilibrium.newton import Newton
from toros_fem.mechanics.skin.load import Load
from toros_fem.meshes.mirror import FLAT
from toros_fem.meshes.triangles import harmonic_extension

# Motion in differences of the residual, over the distance of contact or the thickness.
PROBE = 1e-3
# Fraction of the distance to the stretch bounds that a step may use up.
USED = 0.9


class PrescribedDisplacement:
    """Displacement of the fixed components of a state to their prescribed positions.

    Moved alone, they would stretch the triangles next to them by the whole displacement. So the
    free components follow by the harmonic extension over the flat panels, each component by itself:
    on a strip that is pulled this is the exact solution. The pattern is whole on every rank, so
    that each computes the same.
    """

    def __init__(self, model: SkinModel) -> None:
        self._model = model
        self._solvers: list[Callable[[Floats], Floats]] = []  # made when something first moves

    def __call__(self, state: Floats, load: Load) -> Floats:
        """Return the state with its fixed components where a load has them (collective).

        A tile follows its mean deformation as a whole.
        """
        model, skin = self._model, self._model.skin
        fixed = ~model.free
        if model.images is not None:
            state = model.images.stretched(state, load)
        placed = np.where(fixed, self.goal(load), state)
        jump = model.positions(placed - state)
        distance = largest(skin.comm, float(np.abs(jump).max(initial=0.0)))
        if distance > FLAT * skin.pattern.size:
            spread = self._extension(skin.gather_vertices(jump))
            along = np.zeros_like(state)
            model.positions(along)[:] = spread[skin.owned_vertices]
            placed += np.where(fixed, 0.0, along)
        return placed

    def goal(self, load: Load) -> Floats:
        """Return the assembled state with all vertices displaced, and with the load's F̄."""
        model = self._model
        goal = model.assembled
        if load.displacement is not None:
            model.positions(goal)[:] += load.displacement[model.skin.owned_vertices]
        if model.images is not None and load.gradient is not None:
            model.images.set_mean_gradient(goal, load.gradient)
        return goal

    def follow(
        self,
        newton: Newton,
        state: Floats,
        end: Load,
        longest: float,
    ) -> tuple[Floats, float]:
        """Return a state in which bodies and supports have moved as far as nothing meets.

        They move straight, at most the part `longest` of the way to the load `end`; the part that
        is gone is returned too. The free components follow as the tangent predicts: what is in
        contact is pushed along (collective).
        """
        model, skin = self._model, self._model.skin
        contact, fixed = model.contact, ~model.free
        jump = np.where(fixed, self.goal(end) - state, 0.0)
        reach = largest(skin.comm, float(np.abs(jump).max(initial=0.0)))
        distance = model.composite.fabric.thickness
        poses: Floats = np.zeros((0, 6))
        left = poses
        if contact is not None:
            distance, poses = contact.distance, contact.poses.copy()
            left = -poses if end.poses is None else end.poses - poses
            reach = max(reach, contact.reach(left))
        if reach == 0:
            return state, 1.0
        probe = PROBE * distance / reach
        probe *= model.largest_step(state, probe * jump, USED, probe * left)
        residual = model.residual(state)
        if contact is not None:
            contact.poses[:] = poses + probe * left
        push = (model.residual(state + probe * jump) - residual) / probe
        if contact is not None:
            contact.poses[:] = poses
        step = longest * np.where(fixed, jump, newton.direction(state, residual + push))
        part = model.largest_step(state, step, USED, longest * left)
        return state + part * step, part * longest

    def _extension(self, jump: Floats) -> Floats:
        if not self._solvers:
            laplacian = self._model.skin.pattern.flat_laplacian()
            for fixed in self._model.supports.fixed.T:
                self._solvers.append(harmonic_extension(laplacian, fixed))
        return np.stack([f(jump[:, k]) for k, f in enumerate(self._solvers)], axis=1)
