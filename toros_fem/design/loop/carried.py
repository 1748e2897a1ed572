"""A design on its whole mesh, as the loop on another mesh takes it over."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.design.loop.fields import DensityFields
from toros_fem.design.loop.options import Iteration
from toros_fem.design.loop.problem import DesignProblem
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.transfer import make_transfer

InitialDensity = tuple[Pattern, Floats]


@dataclass(frozen=True, eq=False)
class CarriedDesign:
    """A design on every rank, without the problem that it came from.

    Attributes:
        pattern: The pattern.
        density: ρ of all triangles, (t,); or all variables of each, (t, k).
        pressures: Pressure of each chamber in Pa; empty without any.
        positions: Positions of all vertices, (n, 3), in m; None starts from the assembled shape.
        projected: ρ̄ of all triangles, (t,), which another mesh starts from, so that its filter sees
            the lines of the print with sharp borders; None takes ρ there too.
        level: Number of the mesh that takes it over, from 0, for the rows of its history.
        history: Rows of the design so far; they come first in the history of the result.
        seconds: Wall time so far by phase.
        initial: The whole pattern and the density that the design began with, (t,), for pictures;
            None where it began with none.
    """

    pattern: Pattern
    density: Floats
    pressures: tuple[float, ...] = ()
    positions: Floats | None = None
    projected: Floats | None = None
    level: int = 0
    history: tuple[Iteration, ...] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)
    initial: InitialDensity | None = None

    def on(self, problem: DesignProblem) -> tuple[Floats, Any]:
        """Return the variables of this rank and a state to start from (collective).

        The problem is the same, on this mesh or on another one of the same panels.

        Raises:
            PanelError: Its panels are others.
        """
        here, there = self.pattern, problem.skin.pattern
        density, positions = self.density, self.positions
        same = np.array_equal(here.flat_triangles, there.flat_triangles) and np.array_equal(
            here.flat_points, there.flat_points
        )
        if not same:
            transfer = make_transfer(here, there)
            density = transfer.at_cells(density if self.projected is None else self.projected)
            positions = None if positions is None else transfer.positions(positions)
        state = None if positions is None else problem.physics.state_at(positions)
        return density[problem.skin.owned_cells].ravel(), state


def initial_density(problem: DesignProblem, density: Floats) -> InitialDensity | None:
    """Return a density on the whole skin; None where the variables are none (collective)."""
    if not isinstance(problem.fields, DensityFields):
        return None
    cells = problem.skin.gather_cells(problem.fields.with_passive(density))
    return problem.whole.pattern, problem.whole.at_cells(cells)
