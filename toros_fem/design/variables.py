"""Design variables as one distributed vector: densities, and the pressures that are designed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from petsc4py import PETSc

from toros_fem._types import Floats
from toros_fem.design.options import DesignOptions
from toros_fem.design.problem import DesignChain, Evaluation


class Variables:
    """Densities, and on the first rank those pressures that are designed, as one vector.

    A pressure enters as the share of the way between the logarithms of its bounds, so that a
    step changes it by a factor.
    """

    def __init__(self, problem: DesignChain, options: DesignOptions) -> None:
        skin = problem.skin
        self._comm, self._count = skin.comm, len(skin.owned_cells)
        self._pressures = np.array(problem.pressures, dtype=np.float64)
        ranges = problem.pressure_ranges
        self._which = [k for k, bounds in enumerate(ranges) if bounds is not None]
        self._low, self._high = (
            np.array([bounds for bounds in ranges if bounds is not None]).reshape(-1, 2).T
        )
        self._carried = len(self._which) if skin.comm.rank == 0 else 0
        designed = problem.designed
        passive = np.ones(self._count) if problem.passive is None else problem.passive
        fixed = np.where(designed, 0.0, passive)
        low, high = self.vector(fixed), self.vector(np.where(designed, 1.0, fixed))
        high.array[self._count :] = 1.0
        self.bounds = (low, high)
        self.move = self.vector(np.full(self._count, options.mma.move))
        self.move.array[self._count :] = options.pressure_move

    def vector(self, cells: Floats, pressures: Sequence[float] | None = None) -> PETSc.Vec:
        """A vector of values at owned triangles, and of all pressures in Pa (0 if None)."""
        size = self._count + self._carried
        out = PETSc.Vec().createMPI((size, PETSc.DECIDE), comm=self._comm)
        out.array[: self._count] = cells
        if self._carried and pressures is not None:
            designed = np.array(pressures)[self._which]
            shares = np.log(designed / self._low) / np.log(self._high / self._low)
            out.array[self._count :] = shares
        return out

    def design(self, x: PETSc.Vec) -> tuple[Floats, tuple[float, ...]]:
        """Density and pressures that a vector stands for (collective)."""
        density, pressures = x.array[: self._count].copy(), self._pressures.copy()
        if self._which:
            shares = self._comm.bcast(x.array[self._count :] if self._carried else None, root=0)
            moved = self._low * (self._high / self._low) ** shares
            pressures[self._which] = np.clip(moved, self._low, self._high)
        return density, tuple(float(p) for p in pressures)

    def gradient(self, evaluation: Evaluation, scale: float) -> PETSc.Vec:
        """Gradient of scale · T by the variables."""
        assert evaluation.gradient is not None
        out = self.vector(scale * evaluation.gradient)
        if self._carried:
            assert evaluation.pressure_gradient is not None
            by_pressure = evaluation.pressure_gradient[self._which]
            factor = np.array(evaluation.equilibrium.pressures)[self._which]
            factor *= np.log(self._high / self._low)
            out.array[self._count :] = scale * by_pressure * factor
        return out
