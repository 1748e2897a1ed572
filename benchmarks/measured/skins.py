"""A skin under one load after the other, each solved from the equilibrium before."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from benchmarks.measured.compared import Bools, Floats
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.newton import NewtonOptions
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes import Pattern, sew


class Held:
    """A skin that is held, and its last equilibrium."""

    def __init__(
        self, pattern: Pattern, composite: Composite, supports: Supports,
        stiff: Bools | None = None, options: NewtonOptions | None = None,
    ) -> None:  # fmt: skip
        """Take the skin; `stiff` says which triangles are reinforced."""
        self.skin = sew(MPI.COMM_SELF, pattern)
        self.solver = EquilibriumSolver(self.skin, composite, supports, options)
        whole = np.zeros(len(pattern.triangles)) if stiff is None else stiff.astype(float)
        self.density = whole[self.skin.owned_cells]
        self.last: Equilibrium | None = None

    def under(self, load: Load) -> tuple[Floats, Floats]:
        """Return positions in m and forces of the supports in N, of all vertices, (n, 3)."""
        self.last = self.solver.solve(self.density, load, start=self.last)
        return self.skin.gather_vertices(self.last.positions), self.solver.reactions(self.last)


def border(pattern: Pattern) -> Supports:
    """Return the supports that hold the free edges."""
    held = np.isin(np.arange(len(pattern.points)), pattern.free_edges)
    return Supports(np.repeat(held[:, None], 3, axis=1))
