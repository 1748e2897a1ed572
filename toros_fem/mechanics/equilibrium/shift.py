"""Shift τ of K + τM: the smallest of a ladder by which the tangent is positive definite."""

from __future__ import annotations

import weakref

from petsc4py import PETSc

from toros_fem.mechanics.equilibrium.linear_solver import TangentFactor

FIRST_SHIFT, LARGEST_SHIFT, SMALLEST_SHIFT = 0.03, 1e6, 2e-3
# Factor by which the shift falls after a success, grows where a factorisation fails, and grows
# where no step lowers the energy.
DECAY, GROWTH, REFUSED = 32.0, 4.0, 16.0


class ShiftLadder:
    """The shift of a factorisation, from which the next one begins.

    Attributes:
        shift: τ of the last factorisation.
        first: The shift with which a solve near the last one begins: neighbouring designs need
            like shifts in their first steps.
        definite: Whether no shift was needed since `reset`.
        renew: Whether the preconditioner factorises; else it keeps the factors that it has.
    """

    def __init__(self, factor: TangentFactor) -> None:
        self.factor = factor
        self.first, self.renew = 0.0, True
        self.reset(near=False)

    def reset(self, *, near: bool) -> None:
        """Begin a solve, near the last one or not: that one may have failed far away."""
        self.shift = self.first if near else 0.0
        # A smaller shift is worth a factorisation only if the last try of one succeeded.
        self._refused = self.shift > 0
        self._begins = self.definite = True

    @property
    def exhausted(self) -> bool:
        """Whether the shift cannot grow any more."""
        return self.shift >= LARGEST_SHIFT / 8

    def factorise(self) -> bool:
        """Factorise with the smallest shift that leaves no negative pivot; return whether one does.

        The tangent must be assembled (collective).
        """
        shift = self.shift if self._refused else self.shift / DECAY
        shift = shift if shift >= SMALLEST_SHIFT else 0.0
        refused, found = False, self.factor.factorise(shift)
        while not found and shift < LARGEST_SHIFT:
            shift = max(FIRST_SHIFT, GROWTH * shift) if shift else max(FIRST_SHIFT, self.shift)
            refused, found = True, self.factor.factorise(shift)
        if self._begins:
            lower = shift / GROWTH if shift >= GROWTH * SMALLEST_SHIFT else 0.0
            self._begins, self.first = False, shift if refused else lower
        self._refused = refused and not self._refused
        self.definite &= shift == 0
        self.shift = shift
        return found

    def enlarge(self) -> None:
        """Let the next factorisation begin with a larger shift: no step lowered the energy."""
        self.shift, self._refused = max(FIRST_SHIFT, REFUSED * self.shift), True


class ShiftedCholesky:
    """Preconditioner of PETSc's type "python": factors of K + τM.

    PETSc holds it out of sight of Python's garbage collector: without the weak reference no solver
    would ever be freed.
    """

    def __init__(self, ladder: ShiftLadder) -> None:
        self._held = weakref.ref(ladder)

    def _ladder(self) -> ShiftLadder:
        found = self._held()
        assert found is not None
        return found

    def setUp(self, pc: PETSc.PC) -> None:
        """Factorise, unless older factors are to serve."""
        ladder = self._ladder()
        if ladder.renew:
            ladder.renew = False  # PETSc asks again, as a shift changes the matrix
            reasons = PETSc.PC.FailedReason
            found = ladder.factorise()
            pc.setFailedReason(reasons.NOERROR if found else reasons.FACTOR_NUMERIC_ZEROPIVOT)

    def apply(self, _: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Solve."""
        y.array_w[:] = self._ladder().factor.solve(x.array_r)

    def view(self, _: PETSc.PC, viewer: PETSc.Viewer) -> None:
        """Say what factorises."""
        ladder = self._ladder()
        viewer.printfASCII(f"    {ladder.factor.describe()}, last shift {ladder.shift:g}\n")
