"""What a shape misses of its targets, and what to ask for so that its print takes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.base.rounding import rounded
from toros_fem.design.loop.case import Case
from toros_fem.measures.cross_sections import COUNTS, CrossSections, Rod, rod_of
from toros_fem.measures.figures import DEFAULT, TOLERANCE
from toros_fem.products.actuators.space_mapping import RESOLUTION, Aim, aims_of, next_asked

# Angle in rad that the direction of a body's tip may be off.
DIRECTION = np.radians(DEFAULT.direction)
# Least curvature, over that of an arc of 1 rad, and stretch that count as 1.
TURN, STRETCH = 1.0, 0.2
# Largest change of a strain in one round, over what counts as 1.
LARGEST_STEP = 1.0
# Weights of a strain and its neighbours: between lines the strains of a print vary.
SMOOTH = (0.25, 0.5, 0.25)


@dataclass(frozen=True, eq=False)
class StrainResponse:
    """Strains of cross-sections that were asked beyond the target's, and what the print has beyond.

    Attributes:
        asked, printed: Differences from the strains of the target, (k, 6), as of `Rod.strains`.
    """

    asked: Floats
    printed: Floats


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
        return rod_of(whole.pattern, self.labels, whole.at_vertices(positions))

    def __call__(self, positions: Floats) -> Floats:
        """Return all differences, (j,), from positions of all vertices, (n, 3), in m."""
        found = [self._of_metrics(positions)]
        if self.labels is not None:
            off, turned = self._of_shape(positions)
            found += [off.ravel() / np.sqrt(len(off)), turned]
        return np.concatenate(found)

    def of_metrics(self, positions: Floats) -> float:
        """Return the largest miss of a metric, over its target, or its scale if that is more."""
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

    def strains_beyond(self, positions: Floats) -> Floats:
        """Return the strains of a shape minus those of the target, smoothed along it, (k, 6)."""
        off = self.rod(positions).strains - self.rod(self.case.goal).strains
        ends = np.concatenate([off[:1], off, off[-1:]])
        return np.asarray(SMOOTH[0] * ends[:-2] + SMOOTH[1] * off + SMOOTH[2] * ends[2:])

    def strains_to_ask(self, answers: Sequence[StrainResponse]) -> Floats:
        """Return the strains to ask for next, beyond those of the target, (k, 6)."""
        goal = self.rod(self.case.goal)
        length = float(np.linalg.norm(goal.rest[-1] - goal.rest[0]))
        turn = max(TURN, length * float(np.abs(goal.strains[:, :3]).max())) / length
        size = np.repeat([turn, STRETCH], 3)
        asked, printed = (
            [(s / size).ravel() for s in of]
            for of in ([a.asked for a in answers], [a.printed for a in answers])
        )
        found = next_asked(asked, printed, np.zeros_like(asked[0]), LARGEST_STEP)
        return size * rounded(found, RESOLUTION).reshape(-1, 6)

    def asking(self, strains: Floats) -> Case:
        """Return the case with a target that has strains (k, 6) beyond those of its own."""
        assert self.labels is not None
        goal, whole = self.case.goal, self.case.whole
        rod = self.rod(goal)
        other = rod.strained(rod.strains + strains)
        moved = rod.carried(self.labels, whole.at_vertices(goal), other)
        return replace(self.case, target=moved[: len(goal)])  # those of the part come first

    def _of_metrics(self, positions: Floats) -> Floats:
        pattern, metrics = self.case.pattern, {m.key: m for m in self.case.judged}
        off = [
            (metrics[key].value(pattern, positions) - aim.target) / max(abs(aim.target), aim.scale)
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
