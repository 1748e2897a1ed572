"""The end of a step: correction, proof of stability, and the way off a saddle."""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from toros_fem.base.array_types import Floats
from toros_fem.base.mpi import dot, norm
from toros_fem.mechanics.assembly.model import SkinModel
from toros_fem.mechanics.equilibrium.direction import Direction
from toros_fem.mechanics.equilibrium.iteration import (
    NO_NUMBER,
    RESOLVED,
    STAGNATED,
    STUCK,
    UNRESOLVED,
    Iteration,
    Point,
)
from toros_fem.mechanics.equilibrium.linear_solver import TangentFactor

# A step that leaves more of the residual than this fraction is corrected, so that the stiff parts
# relax.
RELAXED = 0.1
CORRECTIONS = 2
# With friction, a step that leaves more of the residual than the fraction OVERSHOT may be halved.
OVERSHOT = 0.7
# Where rounding limits a residual, Newton's step leaves more than this fraction of it.
FALLS = 0.7
# Number of saddles that a solve leaves before it gives up, and the least part of a mode.
ESCAPES, SMALLEST_ESCAPE = 10, 1e-10

Reason = PETSc.SNES.ConvergedReason

# Part of the diagonal that makes a saddle's tangent positive definite: the first and the largest.
FIRST_DIAGONAL, LARGEST_DIAGONAL = 1e-8, 1e6
ITERATIONS = 20
# Length of the mode over the skin's size.
LENGTH = 0.01


class Landing:
    """The convergence test of the SNES, and what it does to the state before."""

    def __init__(self, at: Iteration, direction: Direction, snes: PETSc.SNES) -> None:
        self.at, self._direction, self._snes = at, direction, snes
        self._own = direction.newton
        self._absolute = snes.getTolerances()[1]

    def end_step(self, snes: PETSc.SNES, count: int, norms: tuple[float, float, float]) -> int:
        """Correct the state that the line search found, and test it.

        petsc4py 3.22 has no post-check of the line search, where PETSc would change a state.
        """
        at, x = self.at, snes.getSolution()
        found = point = at.points.at(x.array_r)
        if not np.isfinite(point.size):
            return NO_NUMBER
        outcome = None
        if count > 0 and self._own:
            outcome, point = self._advance(point)
        elif count > 0:
            at.record("newton", 1.0)
        at.base = point
        if outcome is None:
            outcome = self._judge(count)
        if at.base is not found:
            x.array[:] = at.base.state
            snes.getFunction()[0].array[:] = at.base.residual
            snes.setFunctionNorm(at.base.size)
        return outcome

    def _advance(self, found: Point) -> tuple[int | None, Point]:
        """Return why the solve ends, or None, and the point from which it goes on."""
        at, base = self.at, self.at.base
        moved = not at.points.same(found.state, base.state)
        fraction = at.cap * self._part(found) if moved else 0.0
        whole = fraction == 1.0 and at.exact
        stuck = self._stuck(found.size if fraction == 1.0 else np.inf)
        if stuck and not self._nearer(found):
            at.proven = True  # K is factorised there, unshifted
            at.record("end", 0.0)
            return int(Reason.CONVERGED_SNORM_RELATIVE), base
        at.record(at.kind, fraction)
        if stuck:
            return self._taken(found), found
        if not moved:
            return self._refused(), base
        new = found
        if at.kind == "cg" and at.residual <= UNRESOLVED and new.size > STUCK * base.size:
            at.factor.usable = False  # only the exact direction tells rounding
        if at.kind in ("newton", "cg"):
            new = self._correct(base, new, fraction)
        if at.kind != "coupled":
            new = self._lagged(new, base if fraction == 1.0 else None)
        # Newton's residual falls quadratically; that of a modified step by twice this factor.
        if whole or at.kind == "modified":
            at.rate = (2 if whole else 1) * new.size / base.size
        return None, new

    def _part(self, found: Point) -> float:
        at = self.at
        if at.points.same(found.state, at.base.state - at.step):
            return 1.0  # the difference of two states may have no digits left
        along = dot(at.comm, at.base.state - found.state, at.step)
        return along / dot(at.comm, at.step, at.step)

    def _refused(self) -> int | None:
        """Return why the solve ends where a step was refused; None if it goes on."""
        at = self.at
        if at.kind != "newton":  # rounding, or a barrier that needs the exact direction
            at.factor.usable = False
            if at.kind == "coupled":
                at.lag(at.base.state)
            return None
        if at.residual <= STAGNATED and at.stable(at.base.state):
            at.proven = True
            return int(Reason.CONVERGED_SNORM_RELATIVE)
        if at.ladder.exhausted:
            return int(Reason.DIVERGED_LINE_SEARCH)
        at.ladder.enlarge()
        return None

    def _judge(self, count: int) -> int:
        """Return PETSc's reason at the point from which a step would begin."""
        at = self.at
        if at.residual <= max(at.tolerance, UNRESOLVED):
            at.measure()
        size = at.base.size
        if size <= max(at.tolerance * at.reference, self._floor(), self._absolute):
            at.proven = at.finish and at.stable(at.base.state)
            if at.proven or not at.finish or not self._own:
                at.record("end", 0.0)
                return int(Reason.CONVERGED_FNORM_RELATIVE)
            if at.escapes == ESCAPES:
                return int(Reason.DIVERGED_INNER)
            at.base = self._escape(at.base)
        if count >= self._snes.getTolerances()[3]:
            return int(Reason.DIVERGED_MAX_IT)
        return int(Reason.ITERATING)

    def _floor(self) -> float:
        """Return the residual's norm by rounding of the positions alone, once K is known.

        Close to the stretch bounds it would exceed any load, so that it is limited.
        """
        at = self.at
        return min(at.force_rounding(), STAGNATED * at.reference)

    def _stuck(self, size: float) -> bool:
        """Return whether rounding limits the residual: Newton's whole step is negligible.

        Where stretching is far stiffer than bending, its rounding alone may exceed the load. `size`
        is the norm after the whole step; infinite if it was shortened.
        """
        at = self.at
        if not at.exact or at.residual > UNRESOLVED or size <= STUCK * at.base.size:
            return False
        small = at.longest <= RESOLVED * at.model.skin.pattern.size
        return small and at.base.size <= at.force_rounding()

    def _nearer(self, found: Point) -> bool:
        """Return whether Newton's last step is worth a factorisation, though rounding is near.

        Where a mode is soft, a state whose residual is hardly above its rounding may be far from
        the equilibrium; and a residual that still falls is above it. With friction the residual
        after the step is not known yet.
        """
        at = self.at
        far = at.longest > at.tolerance * at.model.skin.pattern.size
        falls = found.size < (1.0 if far else FALLS) * at.base.size
        return falls and not at.model.slides

    def _taken(self, found: Point) -> int | None:
        """Return why the solve ends after Newton's last step; None if it leads to a saddle."""
        at = self.at
        at.base, at.proven = found, at.stable(found.state)
        if not at.proven:
            return None
        at.record("end", 0.0)
        return int(Reason.CONVERGED_SNORM_RELATIVE)

    def _correct(self, old: Point, new: Point, fraction: float) -> Point:
        """Solve for the residual beyond its linear prediction: the second-order correction."""
        at = self.at
        for _ in range(CORRECTIONS):
            if new.size <= RELAXED * old.size:
                break
            change = -self._direction.back(new.residual - (1 - fraction) * old.residual)
            # Contact may lie between two states whose energies tell nothing of it.
            if at.model.contact is not None and at.cap_of(new.state, change) < 1:
                break
            state = new.state + change
            if not at.points.near(state).energy < new.energy:
                break
            new = at.points.at(state)
        return new

    def _escape(self, saddle: Point) -> Point:
        """Return a lower point along the softest mode of a saddle."""
        at = self.at
        at.escapes += 1
        at.ladder.shift = 0.0
        mode = softest_mode(at.model, at.factor, saddle.residual, at.escapes)
        at.factor.usable = False
        fraction = at.cap_of(saddle.state, mode)
        while fraction > SMALLEST_ESCAPE:
            state = saddle.state + fraction * mode
            if at.points.near(state).energy - saddle.energy < -at.rounding:
                at.record("escape", fraction)
                return at.points.at(state)
            fraction /= 2
        return saddle

    def _lagged(self, point: Point, before: Point | None) -> Point:
        """Return the point with friction by the normal forces of its own state.

        Where these overshoot, the point half way from the one before may be nearer to equilibrium:
        without it strong friction goes to and fro between two states.
        """
        at = self.at
        if not at.model.slides:
            return point
        at.lag(point.state)
        found = at.points.at(point.state)
        if before is None or found.size <= OVERSHOT * before.size:
            return found
        middle = (before.state + point.state) / 2
        at.lag(middle)
        half = at.points.at(middle)
        if half.size < OVERSHOT * found.size and np.isfinite(half.energy):
            return half
        at.lag(point.state)
        return at.points.at(point.state)


def softest_mode(model: SkinModel, factor: TangentFactor, residual: Floats, seed: int) -> Floats:
    """Return the mode of smallest curvature by inverse iteration, against a residual (collective).

    The curvature is measured by the diagonal: the material part would hide the buckling mode. The
    tangent must be assembled.
    """
    comm, diagonal = model.skin.comm, FIRST_DIAGONAL
    while not factor.factorise(diagonal=diagonal) and diagonal < LARGEST_DIAGONAL:
        diagonal *= 4
    # A start that is the same on any number of ranks: drawn by assembled vertex.
    generator = np.random.default_rng(seed)
    drawn = generator.standard_normal(model.skin.pattern.points.shape)
    mode = model.state_of(drawn[model.skin.owned_vertices])
    if model.contact is not None:
        model.contact.set_motions(mode, generator.standard_normal((model.free_bodies, 6)))
    for _ in range(ITERATIONS):
        mode = factor.solve(factor.scale * mode)
        mode /= norm(comm, mode)
    mode *= -1.0 if dot(comm, mode, residual) > 0 else 1.0
    return LENGTH * model.skin.pattern.size * mode
