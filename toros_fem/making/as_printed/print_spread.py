"""Prints with wider and narrower lines than drawn, and how far their shapes are apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import NoEquilibriumError
from toros_fem.base.mpi import on_first_rank
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.making.as_printed.as_printed import PrintedDesign
from toros_fem.making.print.printability import printed_fractions
from toros_fem.making.print.regions import part_regions
from toros_fem.meshes.following import border_motion, snapped, with_flat_points
from toros_fem.meshes.pattern import Pattern


@dataclass(frozen=True, eq=False)
class PrintSpread:
    """Shapes of a print whose borders are off inwards and outwards.

    Attributes:
        half: Half the way from the shape with wider lines to that with narrower ones, at all
            nodes, (n, 3), in m.
        metrics: Values of all metrics by key: with narrower, then with wider lines.
    """

    half: Floats
    metrics: tuple[Mapping[str, float], Mapping[str, float]]

    def error(self, scales: Mapping[str, float]) -> float:
        """Return the largest half difference of a metric that counts over its scale, by key."""
        low, high = self.metrics
        return max((abs(low[k] - high[k]) / (2 * s) for k, s in scales.items()), default=0.0)


def print_spread(printed: PrintedDesign, offset: float) -> PrintSpread | None:
    """Simulate a print with its borders moved in and out by an offset in m (collective).

    The print is simulated on a mesh that follows its borders, whose vertices then move with them.
    None where one of these prints has no equilibrium.
    """
    made = printed.evaluation
    if made is None:
        return None
    problem = made.problem
    assert isinstance(problem, ShapeDesign)
    comm, part = problem.comm, problem.skin.pattern
    regions = on_first_rank(comm, lambda: part_regions(part, printed.regions))
    pattern = snapped(comm, part, regions)
    part_of = on_first_rank(comm, lambda: printed_fractions(pattern, regions))
    motion = on_first_rank(comm, lambda: border_motion(pattern, regions, part_of > 0.5, offset))

    def moved(way: float) -> Pattern:
        flat = pattern.flat_points + way * motion
        return on_first_rank(comm, lambda: with_flat_points(pattern, flat))

    def solved(
        on: Pattern, near: Floats, pressures: Sequence[float]
    ) -> tuple[Floats, dict[str, float]]:
        skin = problem.on(on)
        found = skin.simulate_binary(
            part_of[skin.skin.owned_cells],
            start=skin.physics.state_at(near),
            pressure=pressures,
        )
        there = found.equilibrium.positions
        return skin.skin.gather_vertices(there), skin.metrics_at(there)

    pressures = made.equilibrium.pressures
    shapes, metrics = [], []
    near = problem.skin.gather_vertices(made.equilibrium.positions)
    try:
        for way in (-offset, offset):
            shape, values = solved(moved(way), near, pressures)
            near = shape
            shapes.append(shape)
            metrics.append(values)
    except NoEquilibriumError:  # raised by all ranks or by none
        return None
    half = np.asarray((shapes[0] - shapes[1]) / 2)
    return PrintSpread(half, (metrics[0], metrics[1]))
