"""Force by which a skin holds a body that is pulled out of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.validation import Floats, real_numbers, require_kind, shown, unit_vector
from toros_fem.mechanics.contact.contact import SkinContact
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium, EquilibriumError
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load, Pressure, load_of
from toros_fem.meshes.triangles import harmonic_extension

# Smallest step of a pull over the size of the skin.
SMALLEST = 1e-5


@dataclass(frozen=True, eq=False)
class PullPoint:
    """One equilibrium of a pull.

    Attributes:
        depth: Distance in m by which the body has been pulled.
        force: Force in N by which the skin holds it back.
        positions: Positions of all assembled vertices in m, (n, 3).
        normals: Normal force in N of the body on each of them, (n, 3).
        result: The equilibrium.
    """

    depth: float
    force: float
    positions: Floats
    normals: Floats
    result: Equilibrium


def pull_out(
    solver: EquilibriumSolver,
    density: Floats,
    load: Load | Pressure,
    depths: Sequence[float] | Floats,
    direction: Sequence[float],
    closed: Equilibrium,
    *,
    body: int = 0,
) -> Iterator[PullPoint]:
    """Return an iterator over the equilibria of a pull, found one by one (collective).

    A body that is free to move along the direction alone, under a dead force, follows these
    equilibria from the first to the one that holds the force: nothing moves it back. So one pull
    tells what becomes of all forces. Friction acts from its begin on.

    Args:
        solver: Equilibrium solver with contact; the body is not free.
        load: What acts, but for the poses of bodies; a number is a pressure in Pa.
        depths: Distances in m by which the body is pulled, ascending from 0.
        direction: Direction of the pull, (3,); its length does not matter.
        closed: Equilibrium of the skin around the body, without friction.
        body: Number of the body.

    Raises:
        ParameterError: The solver has no such body, or an argument does not fit.
        EquilibriumError: While iterating: the pull could not be followed further.
    """
    require_kind("solver", solver, EquilibriumSolver, "an EquilibriumSolver")
    along = unit_vector("direction", direction, "that of the pull")
    steps = real_numbers("depths", depths, "distances in m, ascending from 0")
    if steps.ndim != 1 or not len(steps) or steps[0] != 0 or not (np.diff(steps) > 0).all():
        raise ParameterError(f"depths = {shown(depths)} must be distances in m, ascending from 0.")
    contact = solver.model.contact
    if not isinstance(contact, SkinContact) or not 0 <= body < len(contact.contact.bodies):
        raise ParameterError(f"the solver's contact has no body number {body}.")
    pull = _Pull(solver, contact, density, load_of(load), along, body)
    return pull.follow(steps, closed)


@dataclass(frozen=True, eq=False)
class _Pull:
    """A pull of one body along a unit vector, by steps that shrink where they fail."""

    solver: EquilibriumSolver
    contact: SkinContact
    density: Floats
    load: Load
    along: Floats
    body: int

    @cached_property
    def _laplacian(self) -> csr_array:
        return self.solver.skin.pattern.flat_laplacian()

    def follow(self, depths: Floats, closed: Equilibrium) -> Iterator[PullPoint]:
        skin, friction = self.solver.skin, self.contact.friction
        rest = None
        if friction is not None:
            positions = skin.gather_vertices(closed.positions)
            rest = friction.at_rest(positions, self._poses(0.0))
        begin = self.solver.solve(self.density, self._at(0.0), closed.state, sliding=rest)
        last = self._point(begin, 0.0)
        yield last
        for goal in depths[1:]:
            step = goal - last.depth
            while last.depth < goal:
                try:
                    last = self._next(last, min(float(goal), last.depth + step))
                except EquilibriumError:  # raised by all ranks or by none
                    step /= 2
                    if step < SMALLEST * skin.pattern.size:
                        raise
            yield last

    def _next(self, last: PullPoint, depth: float) -> PullPoint:
        solver, model = self.solver, self.solver.model
        load, after = self._at(depth), last.result
        carried = after.state.copy()
        model.positions(carried)[:] = self._carried(last, depth)[solver.skin.owned_vertices]
        model.set_load(load)
        # Collective: all ranks find the same.
        start = next(filter(model.admits, (carried, after.state)), None)
        if start is None:
            raise EquilibriumError("the body cannot move so far in one step", after)
        found = solver.solve(self.density, load, start, after=after, trial=True)
        return self._point(solver.finish(found), depth)

    def _at(self, depth: float) -> Load:
        return replace(self.load, poses=self._poses(depth))

    def _poses(self, depth: float) -> Floats:
        poses: Floats = np.zeros((len(self.contact.contact.bodies), 6))
        poses[self.body, :3] = depth * self.along
        return poses

    def _carried(self, last: PullPoint, depth: float) -> Floats:
        """Return positions at which the vertices in contact have moved with the body, (n, 3).

        The others follow by the harmonic extension over the flat panels.
        """
        touching = np.any(last.normals != 0, axis=1)
        motion, moved = (depth - last.depth) * self.along, last.positions.copy()
        for k, fixed in enumerate(self.solver.model.supports.fixed.T):
            jump = np.where(touching & ~fixed, motion[k], 0.0)
            moved[:, k] += harmonic_extension(self._laplacian, touching | fixed)(jump)
        return moved

    def _point(self, found: Equilibrium, depth: float) -> PullPoint:
        solver, contact, body = self.solver, self.contact, self.body
        gradient = contact.forces(found.state)
        positions = solver.skin.gather_vertices(found.positions)
        bodies = contact.contact.bodies
        count = len(positions)
        begin = count + sum(len(other.points) for other in bodies[:body])
        push = -gradient[begin : begin + len(bodies[body].points)].sum(axis=0)
        friction, side = contact.friction, len(contact.contact.grounds) + body
        if friction is not None:  # the body's reaction
            poses = self._poses(depth)
            force = on_first_rank(solver.skin.comm, lambda: friction.force(positions, poses))
            push = push + force[side].sum(axis=0)
        normals = contact.normals(found.state)[side]
        return PullPoint(depth, float(-push @ self.along), positions, normals, found)


def largest_force(points: Sequence[PullPoint], limit: float) -> float:
    """Return the largest force in N of a pull up to a depth in m, interpolated between points."""
    depths, forces = _curve(points)
    return float(max(forces[depths <= limit].max(), np.interp(limit, depths, forces)))


def slip_under(points: Sequence[PullPoint], force: float) -> float | None:
    """Return the first depth in m of a pull that holds a force in N, interpolated between points.

    None if none does.
    """
    depths, forces = _curve(points)
    first = int(np.argmax(forces >= force))
    if forces[first] < force:
        return None
    if first == 0:
        return 0.0
    ends = slice(first - 1, first + 1)
    return float(np.interp(force, forces[ends], depths[ends]))


def _curve(points: Sequence[PullPoint]) -> tuple[Floats, Floats]:
    return np.array([p.depth for p in points]), np.array([p.force for p in points])
