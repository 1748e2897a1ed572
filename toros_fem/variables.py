"""Design variables as one distributed vector: densities, and the pressure if it is designed."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from toros_fem.design import DesignProblem, Evaluation
from toros_fem.stages import DesignOptions

Floats = npt.NDArray[np.float64]


class Variables:
    """Densities, and on the first rank the pressure if it is designed, as one vector.

    The pressure enters as the share of the way between the logarithms of its bounds, so that a
    step changes it by a factor.
    """

    def __init__(self, problem: DesignProblem, options: DesignOptions) -> None:
        skin = problem.solver.skin
        self._comm, self._count = skin.comm, len(skin.owned_cells)
        self._pressure, self._range = problem.pressure, problem.pressure_bounds
        self._carries = self._range is not None and skin.comm.rank == 0
        designed = problem.designed
        passive = np.ones(self._count) if problem.passive is None else problem.passive
        fixed = np.where(designed, 0.0, passive)
        low = self.vector(fixed, None if self._range is None else self._range[0])
        high = self.vector(
            np.where(designed, 1.0, fixed), None if self._range is None else self._range[1]
        )
        self.bounds = (low, high)
        self.move = self.vector(np.full(self._count, options.mma.move), None)
        if self._carries:
            self.move.array[-1] = options.pressure_move

    def vector(self, cells: Floats, pressure: float | None) -> PETSc.Vec:
        """A vector of values at owned triangles, and of a pressure in Pa (0 if None)."""
        size = self._count + self._carries
        out = PETSc.Vec().createMPI((size, PETSc.DECIDE), comm=self._comm)
        out.array[: self._count] = cells
        if self._carries and pressure is not None:
            assert self._range is not None
            low, high = self._range
            out.array[-1] = math.log(pressure / low) / math.log(high / low)
        return out

    def design(self, x: PETSc.Vec) -> tuple[Floats, float]:
        """Density and pressure that a vector stands for (collective)."""
        density = x.array[: self._count].copy()
        if self._range is None:
            return density, self._pressure
        low, high = self._range
        share = float(self._comm.bcast(x.array[-1] if self._carries else None, root=0))
        return density, min(max(low * (high / low) ** share, low), high)

    def gradient(self, evaluation: Evaluation, scale: float) -> PETSc.Vec:
        """Gradient of scale · T by the variables."""
        assert evaluation.gradient is not None
        out = self.vector(scale * evaluation.gradient, None)
        if self._carries:
            assert self._range is not None
            assert evaluation.pressure_gradient is not None
            factor = evaluation.equilibrium.pressure * math.log(self._range[1] / self._range[0])
            out.array[-1] = scale * evaluation.pressure_gradient * factor
        return out
