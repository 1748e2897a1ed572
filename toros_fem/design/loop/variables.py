"""Design variables as one distributed vector."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.mpi import largest
from toros_fem.design.loop.options import DesignOptions
from toros_fem.design.loop.problem import DesignProblem, Evaluation
from toros_fem.meshes.skin import Skin


class Variables:
    """Densities or shares, and on the first rank the designed pressures, as one vector.

    A pressure enters as the fraction of the way between the logarithms of its bounds, so that a
    step changes it by a factor.
    """

    def __init__(self, problem: DesignProblem, options: DesignOptions) -> None:
        skin, physics = problem.skin, problem.physics
        least, most = problem.fields.bounds
        self._comm, self._count, self._skin = skin.comm, len(least), skin
        self._pressures = np.array(physics.pressures, dtype=np.float64)
        ranges = physics.pressure_ranges
        self._which = [k for k, bounds in enumerate(ranges) if bounds is not None]
        self._low, self._high = (
            np.array([bounds for bounds in ranges if bounds is not None]).reshape(-1, 2).T
        )
        self._carried = len(self._which) if skin.comm.rank == 0 else 0
        low, high = self.vector(least), self.vector(most)
        high[self._count :] = 1.0
        self.bounds = (low, high)
        self.move = self.vector(np.full(self._count, options.mma.move))
        if self._carried:
            ways = np.log1p(options.pressure_move) / np.log(self._high / self._low)
            self.move[self._count :] = np.minimum(ways, 1.0)

    def vector(self, cells: Floats, pressures: Sequence[float] | None = None) -> Floats:
        """Return a vector of own variables and of all pressures in Pa (0 if None)."""
        out: Floats = np.append(cells, np.zeros(self._carried))
        if self._carried and pressures is not None:
            designed = np.array(pressures)[self._which]
            fractions = np.log(designed / self._low) / np.log(self._high / self._low)
            out[self._count :] = fractions
        return out

    def design(self, x: Floats) -> tuple[Floats, tuple[float, ...]]:
        """Return the density and the pressures of a vector (collective)."""
        density, pressures = x[: self._count].copy(), self._pressures.copy()
        if self._which:
            fractions = self._comm.bcast(x[self._count :] if self._carried else None, root=0)
            moved = self._low * (self._high / self._low) ** fractions
            pressures[self._which] = np.clip(moved, self._low, self._high)
        return density, tuple(float(p) for p in pressures)

    def gather(self, local: Floats) -> Floats:
        """Return the entries of all ranks, in an order that no partition changes (collective)."""
        cells = by_cell(self._skin, local[: self._count])
        pressures = self._comm.bcast(local[self._count :], root=0)
        return np.concatenate([cells.ravel(), pressures])

    def scatter(self, entries: Floats) -> Floats:
        """Return the entries of this rank from those of all, as of `gather`."""
        end = len(entries) - len(self._which)
        cells = entries[:end].reshape(len(self._skin.pattern.panel), -1)
        own = cells[self._skin.owned_cells].ravel()
        return np.concatenate([own, entries[end:][: self._carried]])

    def gradient(
        self, evaluation: Evaluation, scale: float, by_density: Floats, by_pressure: Floats | None
    ) -> Floats:
        """Return `scale` times a gradient by the variables, from those by ρ and by pressures."""
        out = self.vector(scale * by_density)
        if self._carried:
            assert by_pressure is not None
            factor = np.array(evaluation.equilibrium.pressures)[self._which]
            factor *= np.log(self._high / self._low)
            out[self._count :] = scale * by_pressure[self._which] * factor
        return out


def by_cell(skin: Skin, owned: Floats) -> Floats:
    """Return one row for each triangle on every rank, from owned rows or their entries in line.

    It is collective.
    """
    count = len(skin.owned_cells)
    width = int(largest(skin.comm, owned.size / max(count, 1)))
    return skin.gather_cells(owned.reshape(count, width))
