"""Where a design starts: the density that it began with, and one that was found before."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from toros_fem.base.array_types import Floats
from toros_fem.design.loop.fields import DensityFields
from toros_fem.design.loop.options import Iteration
from toros_fem.design.loop.problem import DesignProblem
from toros_fem.meshes.pattern import Pattern


@dataclass(frozen=True, eq=False)
class InitialDensity:
    """The density that a design began with on its first mesh, for pictures; on every rank.

    Attributes:
        pattern: The pattern; that of the whole skin where a part is designed.
        density: ρ of all triangles, (t,).
    """

    pattern: Pattern
    density: Floats


def initial_density(problem: DesignProblem, density: Floats) -> InitialDensity | None:
    """Return a density on the whole skin; None where the variables are none (collective)."""
    if not isinstance(problem.fields, DensityFields):
        return None
    cells = problem.skin.gather_cells(problem.fields.with_passive(density))
    if problem.whole is None:
        return InitialDensity(problem.skin.pattern, cells)
    return InitialDensity(problem.whole.pattern, problem.whole.at_cells(cells))


@dataclass(frozen=True, eq=False)
class WarmStart:
    """A design that was found on another mesh, carried over to the mesh of a problem.

    Attributes:
        density: ρ at owned triangles, in [0, 1].
        pressures: Pressure of each chamber in Pa; empty without any.
        state: State from which the first simulation starts; None starts from the assembled shape.
        history: Rows of the design so far; they come first in the history of the result.
        seconds: Wall time so far by phase.
        level: Number of the new mesh, from 0, for the rows of its history.
        initial: The density that the design began with; None where it began with none.
    """

    density: Floats
    pressures: tuple[float, ...] = ()
    state: Any = None
    history: tuple[Iteration, ...] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)
    level: int = 0
    initial: InitialDensity | None = None
