"""A skin through a sequence of pressures, each equilibrium the start of the next."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from toros_fem.equilibrium import EquilibriumResult, EquilibriumSolver
from toros_fem.measure import Figure

Floats = npt.NDArray[np.float64]
Pressure = float | Sequence[float]


@dataclass(frozen=True, eq=False)
class PathPoint:
    """One equilibrium of a path.

    Attributes:
        pressure: What was asked for, in Pa; one for each chamber if there are several.
        positions: Positions of all assembled vertices in m, (n, 3).
        figures: What was measured, by key.
        result: The equilibrium.
    """

    pressure: Pressure
    positions: Floats
    figures: dict[str, float]
    result: EquilibriumResult


def follow(
    solver: EquilibriumSolver,
    density: Floats,
    pressures: Sequence[Pressure],
    figures: Sequence[Figure] = (),
    start: Floats | None = None,
) -> Iterator[PathPoint]:
    """Equilibria at pressures one after the other (collective).

    Args:
        solver: Equilibrium solver.
        density: Projected density of its owned triangles.
        pressures: In Pa, in the order in which they act; where the skin snaps the order matters.
        figures: What to measure of each.
        start: As for `EquilibriumSolver.solve`; None starts from the assembled skin.

    Raises:
        EquilibriumError: There is no equilibrium at one of them; those before have been given out.
    """
    skin = solver.skin
    for pressure in pressures:
        result = solver.solve(density, pressure, start=start)
        positions = skin.gather_vertices(result.positions)
        measured = {f.key: float(f.measure(skin.pattern, positions)) for f in figures}
        yield PathPoint(pressure, positions, measured, result)
        start = result.state
