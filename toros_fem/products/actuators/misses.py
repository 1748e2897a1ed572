"""What a shape misses of its targets, in units of what may be missed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.design.loop.case import Case
from toros_fem.measures.cross_sections import COUNTS, CrossSections, Rod, rod_of
from toros_fem.measures.figures import DEFAULT, TOLERANCE
from toros_fem.products.actuators.space_mapping import Aim, aims_of

# Angle in rad that the direction of a body's tip may be off.
DIRECTION = np.radians(DEFAULT.direction)


@dataclass(frozen=True, eq=False)
class Misses:
    """Differences between a shape and its target that a run is judged by.

    They are those of the metrics from their targets, and where cross-sections count, of their
    centres and of the direction of the tip. All are 1 where they are as large as they may be.

    Attributes:
        case: The skin, on the mesh of the shape.
        aims: Targets of its metrics, by key.
        labels: Cross-section of each vertex of the whole skin, (n,), −1 for none; None where none
            count.
        compared: Whether their positions along x, y and z count.
    """

    case: Case
    aims: Mapping[str, Aim]
    labels: Ints | None
    compared: Bools

    def rod(self, positions: Floats) -> Rod:
        """Return the cross-sections of a shape, from positions of all vertices, (n, 3), in m."""
        assert self.labels is not None
        whole = self.case.whole
        if whole is None:
            return rod_of(self.case.pattern, self.labels, positions)
        return rod_of(whole.pattern, self.labels, whole.at_vertices(positions))

    def __call__(self, positions: Floats) -> Floats:
        """Return all differences, (j,), from positions of all vertices, (n, 3), in m."""
        found = [self._of_metrics(positions)]
        if self.labels is not None:
            off, turned = self._of_shape(positions)
            found += [off.ravel() / np.sqrt(len(off)), turned]
        return np.concatenate(found)

    def of_metrics(self, positions: Floats) -> float:
        """Return the largest miss of a metric, over its scale."""
        return TOLERANCE * float(np.abs(self._of_metrics(positions)).max(initial=0.0))

    def of_shape(self, positions: Floats) -> float:
        """Return the root mean square miss of the centres over the length, or that of the tip.

        The direction of the tip counts as `TOLERANCE` where it is off by `DIRECTION`. Without
        cross-sections there is none, 0.
        """
        if self.labels is None:
            return 0.0
        off, turned = self._of_shape(positions)
        rms = float(np.sqrt((off**2).sum(axis=1).mean()))
        return TOLERANCE * max(rms, float(np.linalg.norm(turned)))

    def _of_metrics(self, positions: Floats) -> Floats:
        pattern, metrics = self.case.pattern, {m.key: m for m in self.case.judged}
        off = [
            (metrics[key].value(pattern, positions) - aim.target) / aim.scale
            for key, aim in self.aims.items()
        ]
        return np.array(off) / TOLERANCE

    def _of_shape(self, positions: Floats) -> tuple[Floats, Floats]:
        """Return the misses of the centres, (k, 3), and of the tip's direction, (3,)."""
        goal, rod = self.rod(self.case.goal), self.rod(positions)
        length = float(np.ptp(self.case.pattern.points, axis=0).max())
        off = (rod.centres - goal.centres) * self.compared / (TOLERANCE * length)
        way = rod.rest[-1] - rod.rest[0]
        turned = (rod.frames[-1] - goal.frames[-1]) @ (way / np.linalg.norm(way)) / DIRECTION
        return np.asarray(off), np.asarray(turned)


def misses_of(case: Case) -> Misses:
    """Return what shapes of a case are judged by.

    Cross-sections count where they are a part of the objective, and their places in it.
    """
    part = next((part for part in case.parts if isinstance(part, CrossSections)), None)
    weights = np.zeros(3) if part is None else part.position_weights.sum(axis=0)
    compared = weights >= COUNTS
    labels = part.labels if part is not None and compared.any() else None
    return Misses(case, aims_of(case.judged), labels, compared)
