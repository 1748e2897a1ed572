"""Prints with wider and narrower lines than drawn, and how far their shapes are apart."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import NoEquilibriumError
from toros_fem.base.mpi import on_first_rank
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.making.as_printed.as_printed import PrintedDesign
from toros_fem.meshes.moving import border_motion, with_flat_points


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

    The print is simulated on a mesh along its borders, whose vertices then move with them.
    None where one of these prints has no equilibrium.
    """
    made = printed.evaluation
    if made is None:
        return None
    problem = made.problem
    assert isinstance(problem, ShapeDesign)
    comm, part = problem.comm, problem.skin.pattern
    part_of = problem.skin.gather_cells(made.projected)
    motion = on_first_rank(comm, lambda: border_motion(part, part_of > 0.5, offset))
    shapes, metrics = [problem.skin.gather_vertices(made.equilibrium.positions)], []
    try:
        for way in (-offset, offset):
            flat = part.flat_points + way * motion
            there = problem.on(on_first_rank(comm, partial(with_flat_points, part, flat)))
            found = there.simulate_binary(
                part_of[there.skin.owned_cells],
                start=there.physics.state_at(shapes[-1]),
                pressure=made.equilibrium.pressures,
            )
            shapes.append(there.skin.gather_vertices(found.equilibrium.positions))
            metrics.append(there.metrics_at(found.equilibrium.positions))
    except NoEquilibriumError:  # raised by all ranks or by none
        return None
    half = np.asarray((shapes[1] - shapes[2]) / 2)
    return PrintSpread(half, (metrics[0], metrics[1]))
