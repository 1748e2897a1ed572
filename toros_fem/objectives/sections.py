"""Targets for the cross-sections of a slender skin: where they are and how they are turned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from toros_fem._mpi import sum_over_ranks
from toros_fem._types import Floats, Ints
from toros_fem.errors import ParameterError
from toros_fem.meshes.skin import Skin
from toros_fem.objectives.rotation import axial, polar_rotation, require_determined
from toros_fem.objectives.shape import checked_target


@dataclass(frozen=True, eq=False)
class CrossSections:
    """Groups of vertices, and how much place and orientation of each count.

    Attributes:
        label: Section of each assembled vertex, (n,), from 0; −1 for none.
        centre: Weight of each section's mean position by component, (k, 3), pure numbers.
        turn: Weight of each section's orientation relative to the section before, (k,), pure
            numbers; of the first, relative to how it is assembled.

    Raises:
        ParameterError: The arrays do not fit, are negative, or all zero.
    """

    label: Ints
    centre: Floats
    turn: Floats

    def __post_init__(self) -> None:
        count = int(self.label.max(initial=-1)) + 1
        sizes = np.bincount(self.label[self.label >= 0], minlength=count)
        if count == 0 or sizes.min() < 3:
            raise ParameterError(
                f"label makes sections of {sizes.tolist()} vertices; each needs 3 at least. Take "
                "fewer sections, or a finer mesh."
            )
        if self.centre.shape != (count, 3) or self.turn.shape != (count,):
            raise ParameterError(
                f"centre has shape {self.centre.shape} and turn {self.turn.shape}; with {count} "
                f"sections they must be ({count}, 3) and ({count},)."
            )
        both = np.column_stack([self.centre, self.turn])
        if not (np.isfinite(both).all() and both.min() >= 0 and both.max() > 0):
            raise ParameterError("centre and turn must be finite, not negative, not all zero.")


class CrossSectionObjective:
    """T = ½ Σₖ (cₖ · gₖ²/L² + tₖ ½‖Qₖ − Qₖ*‖²), whatever the sections' size and shape.

    gₖ is what the section's mean is off the target's by, component by component, L the diagonal
    of the assembled skin's bounding box. Qₖ = Rₖ₋₁ᵀ Rₖ, Rₖ the rotation that best maps the
    assembled section onto the deformed one, R₋₁ = 1; Qₖ* is that of the target. If the two are an
    angle δ apart, a small one, their term is tₖ δ². What counts is how the body is bent and
    twisted from section to section, so that a target of several turns is not mistaken for its
    shorter way round. Each vertex counts by its flat area. Swelling of a section is free.

    Args:
        skin: The sewn skin.
        target: Target positions of all assembled vertices, (n, 3), in m.
        sections: Groups and weights.

    Raises:
        TargetError: The target does not fit or is not finite; or a section whose orientation
            counts lies on a line, as assembled, in the target, or later in a simulated shape.
        ParameterError: The sections are made for another pattern.
    """

    def __init__(self, skin: Skin, target: Floats, sections: CrossSections) -> None:
        target = checked_target(skin, target)
        pattern, s = skin.pattern, sections
        if s.label.shape != (len(pattern.points),):
            raise ParameterError(
                f"label has shape {s.label.shape}; it must be ({len(pattern.points)},)."
            )
        self._comm, self._count = skin.comm, len(s.turn)
        inside = s.label >= 0
        weight = np.where(inside, pattern.vertex_areas, 0.0)
        weight[inside] /= np.bincount(s.label[inside], weight[inside])[s.label[inside]]
        self._label, self._weight = np.where(inside, s.label, 0), weight
        arm = pattern.points - self._means(pattern.points)[self._label]
        self._arm = arm
        self._goal = self._means(target)
        self._turn = s.turn
        # Its orientation is compared with that of the section before, and of the one after.
        self._turns_count = (s.turn > 0) | (np.append(s.turn[1:], 0) > 0)
        self._goal_turn = _turns(self._rotations(self._moments(target))[0])
        owned = skin.owned_vertices
        self._label, self._weight, self._arm = self._label[owned], weight[owned], arm[owned]
        self._centre = s.centre / pattern.size**2

    def forward(self, positions: Floats) -> float:
        """T at positions of the owned nodes, (n, 3) (collective)."""
        gap, rotation, _ = self._gaps(positions)
        off = (_turns(rotation) - self._goal_turn) ** 2
        turned = 0.25 * float(self._turn @ off.sum(axis=(1, 2)))
        return 0.5 * float((self._centre * gap**2).sum()) + turned

    def backward(self, positions: Floats) -> Floats:
        """∂T/∂x at the owned nodes, (n, 3), in 1/m (collective)."""
        gap, rotation, matrix = self._gaps(positions)
        turn, goal = _turns(rotation), self._goal_turn
        # With δRₖ = Rₖ [ωₖ]× is δQₖ = Qₖ [ωₖ]× − [ωₖ₋₁]× Qₖ; what follows is ∂T/∂ω.
        weight = 0.5 * self._turn[:, None]
        by_turn = -weight * axial(np.swapaxes(turn, 1, 2) @ goal)
        by_turn[:-1] += (weight * axial(goal @ np.swapaxes(turn, 1, 2)))[1:]
        reach = np.linalg.solve(matrix, by_turn[:, :, None])[:, :, 0]
        by_centre = (self._centre * gap)[self._label]
        turned = np.cross(reach[self._label], self._arm)
        turned = np.einsum("nij,nj->ni", rotation[self._label], turned)
        return np.asarray(self._weight[:, None] * (by_centre + turned))

    def _gaps(self, positions: Floats) -> tuple[Floats, Floats, Floats]:
        sums = np.concatenate([self._means(positions), self._moments(positions).reshape(-1, 9)], 1)
        sums = sum_over_ranks(self._comm, sums)
        rotation, matrix = self._rotations(sums[:, 3:].reshape(-1, 3, 3))
        return sums[:, :3] - self._goal, rotation, matrix

    def _rotations(self, moments: Floats) -> tuple[Floats, Floats]:
        """R and B of `polar_rotation`; of sections whose orientation does not count B = 1."""
        rotation, matrix = polar_rotation(moments)
        matrix = np.where(self._turns_count[:, None, None], matrix, np.eye(3))
        names = [f"section {k}" for k in range(self._count)]
        require_determined(matrix, names, "Take fewer sections, or a turn weight of 0 for them.")
        return rotation, matrix

    def _means(self, positions: Floats) -> Floats:
        return self._summed(positions)

    def _moments(self, positions: Floats) -> Floats:
        outer = positions[:, :, None] * self._arm[:, None, :]
        return self._summed(outer.reshape(-1, 9)).reshape(-1, 3, 3)

    def _summed(self, values: Floats) -> Floats:
        """Weighted sum of rows over each section, on this rank."""
        columns = [
            np.bincount(self._label, self._weight * column, minlength=self._count)
            for column in values.T
        ]
        return np.stack(columns, axis=1)


def _turns(rotations: Floats) -> Floats:
    """Rotation of each section relative to the one before."""
    return np.concatenate([rotations[:1], np.swapaxes(rotations[:-1], 1, 2) @ rotations[1:]])
