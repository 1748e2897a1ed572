"""Cross-sections of a slender skin: their vertices, targets for them, and their rod."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import sum_over_ranks
from toros_fem.base.validation import (
    Floats,
    Ints,
    real_numbers,
    require_count,
    require_kind,
    whole_numbers,
)
from toros_fem.measures.shape import (
    Nodes,
    axial,
    checked_target,
    polar_rotation,
    require_determined,
)
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.transfer import OtherMesh

# Sum of the position weights of a component from which on a shape is judged by it: legs that turn
# weigh their centre line by some hundredths, to tell up from down.
COUNTS = 0.5


def label_cross_sections(
    pattern: Pattern, vertices: Ints, along: npt.ArrayLike, count: int, *, border: bool = True
) -> Ints:
    """Return the cross-section of each assembled vertex, (n,).

    The cross-sections are slabs of equal length along a direction of the assembled skin, (3,).
    Other vertices than those given are in none, −1. With `border` the outermost vertices, those of
    a tube's end, form one cross-section more, the last.
    """
    require_count(1, count=count)
    labels = np.full(len(pattern.points), -1)
    height = pattern.points[vertices] @ np.asarray(along, dtype=np.float64)
    fraction = (height - height.min()) / np.ptp(height)
    labels[vertices] = np.minimum((fraction * count).astype(int), count - 1)
    if border:
        labels[vertices[fraction > 1 - 1e-9]] = count
    return labels


def section_vertices(labels: Ints, least: int = 3) -> list[Ints]:
    """Return the vertices of each cross-section; those of fewer than `least` are left out."""
    found = [np.flatnonzero(labels == k) for k in range(int(labels.max(initial=-1)) + 1)]
    return [group for group in found if len(group) >= least]


@dataclass(frozen=True, eq=False)
class CrossSections:
    """Groups of vertices with weights of their position and orientation.

    Attributes:
        labels: Cross-section of each assembled vertex, (n,), from 0; −1 for none.
        position_weights: Weight of each cross-section's mean position by component, (k, 3), pure
            numbers.
        orientation_weights: Weight of each cross-section's orientation relative to the one
            before, (k,), pure numbers; the first one is compared with its assembled orientation.
    """

    labels: Ints
    position_weights: Floats
    orientation_weights: Floats

    def __call__(self, nodes: Nodes, target: Floats) -> CrossSectionObjective:
        """Return the objective, as a part of a case asks for it (collective)."""
        return CrossSectionObjective(nodes, target, self)

    def refined(self, finer: OtherMesh) -> CrossSections:
        """Return the same on a refined pattern; between two cross-sections the lower one counts."""
        return replace(self, labels=self.labels[finer.ends].min(axis=1))

    def __post_init__(self) -> None:
        labels = whole_numbers("labels", self.labels, "one for each vertex, −1 for none")
        object.__setattr__(self, "labels", labels)
        for name in ("position_weights", "orientation_weights"):
            weights = real_numbers(name, getattr(self, name), "one for each cross-section")
            object.__setattr__(self, name, weights)
        count = int(self.labels.max(initial=-1)) + 1
        sizes = np.bincount(self.labels[self.labels >= 0], minlength=count)
        if labels.ndim != 1 or count == 0 or sizes.min() < 3:
            least = int(sizes.min()) if count else 0
            raise ParameterError(
                f"labels make {count} cross-sections, the smallest of them with so many vertices: "
                f"{least}; each needs at least 3, and labels one number for each vertex, (n,). Use "
                "fewer cross_sections, or a finer mesh."
            )
        position, orientation = self.position_weights, self.orientation_weights
        fits = position.shape == (count, 3) and orientation.shape == (count,)
        both = np.append(position, orientation)
        if not (fits and np.isfinite(both).all() and both.min() >= 0 and both.max() > 0):
            raise ParameterError(
                f"position_weights have shape {position.shape} and orientation_weights "
                f"{orientation.shape}; with {count} cross-sections they must be ({count}, 3) and "
                f"({count},), finite, not negative, and not all zero."
            )


class CrossSectionObjective:
    """T = ½ Σₖ (cₖ · gₖ²/L² + tₖ ½‖Qₖ − Qₖ*‖²), independent of the sections' size and shape.

    gₖ is the distance of the section's mean position from that of the target, by component, and L
    the diagonal of the assembled skin's bounding box. Qₖ = Rₖ₋₁ᵀ Rₖ, where Rₖ is the rotation that
    best maps the assembled section onto the deformed one, and R₋₁ = 1; Qₖ* is that of the target.
    For a small angle δ between the two the term is tₖ δ². Bending and twist are compared from
    section to section, so that a target of several turns is not mistaken for a shorter one. Each
    vertex counts by its flat area. A section may swell freely. One with an orientation weight must
    not lie on a line, as assembled, in the target, or in a simulated shape (ParameterError).

    Attributes:
        compared: Whether positions along x, y and z count much: by `COUNTS` at least.
    """

    def __init__(self, skin: Nodes, target: Floats, sections: CrossSections) -> None:
        require_kind("sections", sections, CrossSections, "CrossSections")
        target = checked_target(skin, target)
        pattern, labels = skin.pattern, sections.labels
        if labels.shape != (len(pattern.points),):
            raise ParameterError(
                f"labels have shape {labels.shape}; they must be ({len(pattern.points)},)."
            )
        self._orientation_weight = np.asarray(sections.orientation_weights, dtype=np.float64)
        self._comm, self._count = skin.comm, len(self._orientation_weight)
        inside = labels >= 0
        weight = np.where(inside, pattern.vertex_areas, 0.0)
        weight[inside] /= np.bincount(labels[inside], weight[inside])[labels[inside]]
        self._label, self._weight = np.where(inside, labels, 0), weight
        self._arm = pattern.points - self._means(pattern.points)[self._label]
        self._target_mean = self._means(target)
        # A section's orientation is compared with that of the section before, and of the one after.
        following = np.append(self._orientation_weight[1:], 0)
        self._oriented = (self._orientation_weight > 0) | (following > 0)
        self._target_turn = _relative_rotations(self._rotations(self._moments(target))[0])
        owned = skin.owned_vertices
        self._label, self._weight, self._arm = self._label[owned], weight[owned], self._arm[owned]
        self._position_weight = sections.position_weights / pattern.size**2
        self.compared = sections.position_weights.sum(axis=0) >= COUNTS

    def forward(self, positions: Floats) -> float:
        """Return T at positions of the owned nodes, (n, 3) (collective)."""
        gap, rotation, _ = self._gaps(positions)
        off = (_relative_rotations(rotation) - self._target_turn) ** 2
        turned = 0.25 * float(self._orientation_weight @ off.sum(axis=(1, 2)))
        return 0.5 * float((self._position_weight * gap**2).sum()) + turned

    def backward(self, positions: Floats) -> Floats:
        """Return ∂T/∂x at the owned nodes, (n, 3), in 1/m (collective)."""
        gap, rotation, matrix = self._gaps(positions)
        turn, target = _relative_rotations(rotation), self._target_turn
        # From δRₖ = Rₖ [ωₖ]× follows δQₖ = Qₖ [ωₖ]× − [ωₖ₋₁]× Qₖ; below is ∂T/∂ω.
        weight = 0.5 * self._orientation_weight[:, None]
        by_turn = -weight * axial(np.swapaxes(turn, 1, 2) @ target)
        by_turn[:-1] += (weight * axial(target @ np.swapaxes(turn, 1, 2)))[1:]
        by_moment = np.linalg.solve(matrix, by_turn[:, :, None])[:, :, 0]
        by_position = (self._position_weight * gap)[self._label]
        turned = np.cross(by_moment[self._label], self._arm)
        turned = np.einsum("nij,nj->ni", rotation[self._label], turned)
        return np.asarray(self._weight[:, None] * (by_position + turned))

    def _gaps(self, positions: Floats) -> tuple[Floats, Floats, Floats]:
        sums = np.concatenate([self._means(positions), self._moments(positions).reshape(-1, 9)], 1)
        sums = sum_over_ranks(self._comm, sums)
        rotation, matrix = self._rotations(sums[:, 3:].reshape(-1, 3, 3))
        return sums[:, :3] - self._target_mean, rotation, matrix

    def _rotations(self, moments: Floats) -> tuple[Floats, Floats]:
        """Return R and B of `polar_rotation`, B = 1 for sections without orientation weight."""
        rotation, matrix = polar_rotation(moments)
        matrix = np.where(self._oriented[:, None, None], matrix, np.eye(3))
        names = [f"section {k}" for k in range(self._count)]
        remedy = "Use fewer cross-sections, or give them an orientation weight of 0."
        require_determined(matrix, names, remedy)
        return rotation, matrix

    def _moments(self, positions: Floats) -> Floats:
        outer = positions[:, :, None] * self._arm[:, None, :]
        return self._means(outer.reshape(-1, 9)).reshape(-1, 3, 3)

    def _means(self, values: Floats) -> Floats:
        """Return the weighted mean of rows over each section, this rank's part of the sum."""
        columns = [
            np.bincount(self._label, self._weight * column, minlength=self._count)
            for column in values.T
        ]
        return np.stack(columns, axis=1)


def _relative_rotations(rotations: Floats) -> Floats:
    return np.concatenate([rotations[:1], np.swapaxes(rotations[:-1], 1, 2) @ rotations[1:]])


@dataclass(frozen=True, eq=False)
class Rod:
    """Cross-sections of a shape, from the root to the tip.

    Attributes:
        rest: Centres of the assembled cross-sections, (k, 3), in m.
        centres: Centres in the shape, (k, 3), in m.
        frames: Rotations that best map the assembled cross-sections onto those of the shape,
            (k, 3, 3).
    """

    rest: Floats
    centres: Floats
    frames: Floats

    @property
    def strains(self) -> Floats:
        """Curvature in 1/m and stretch from each cross-section to the next, (k, 6).

        Both are in the frame half way, as Kirchhoff and Cosserat rods have them. The first row is
        that between the root, which has not moved, and the first cross-section.
        """
        before, rest, centres = self._with_root()
        length = np.linalg.norm(np.diff(rest, axis=0), axis=1)[:, None]
        turn = Rotation.from_matrix(np.swapaxes(before, 1, 2) @ self.frames).as_rotvec()
        middle = before @ Rotation.from_rotvec(turn / 2).as_matrix()
        stretch = np.einsum("kji,kj->ki", middle, np.diff(centres, axis=0))
        return np.hstack([turn, stretch]) / length

    def strained(self, strains: Floats) -> Rod:
        """Return the rod with the same root and other strains, as of `strains`."""
        _, rest, centres = self._with_root()
        length = np.linalg.norm(np.diff(rest, axis=0), axis=1)
        frame, place, made = np.eye(3), centres[0], []
        for size, strain in zip(length, strains, strict=True):
            half = Rotation.from_rotvec(size * strain[:3] / 2).as_matrix()
            place = place + size * (frame @ half @ strain[3:])
            frame = frame @ half @ half
            made.append((place, frame))
        places, frames = (np.array(part) for part in zip(*made, strict=True))
        return replace(self, centres=places, frames=frames)

    def carried(self, labels: Ints, positions: Floats, other: Rod) -> Floats:
        """Return positions, (n, 3), whose cross-sections move rigidly to those of another rod.

        `labels` are the vertices' cross-sections, (n,); those in none, −1, stay.
        """
        k = np.maximum(labels, 0)
        turn = other.frames @ np.swapaxes(self.frames, 1, 2)
        moved = np.einsum("nij,nj->ni", turn[k], positions - self.centres[k]) + other.centres[k]
        return np.where(labels[:, None] >= 0, moved, positions)

    def _with_root(self) -> tuple[Floats, Floats, Floats]:
        """Return the frame before each interval, and assembled and moved ends of all of them.

        The root is half a distance before the first cross-section, which is a slab.
        """
        rest = self.rest if len(self.rest) > 1 else np.vstack([self.rest, 2 * self.rest])
        root = rest[:1] - (rest[1:2] - rest[:1]) / 2
        before = np.concatenate([np.eye(3)[None], self.frames[:-1]])
        return before, np.vstack([root, self.rest]), np.vstack([root, self.centres])


def rod_of(pattern: Pattern, labels: Ints, positions: Floats) -> Rod:
    """Return the rod of a shape, by the cross-section of each vertex, −1 for none, and areas."""
    inside = labels >= 0
    label, weight = labels[inside], pattern.vertex_areas[inside]
    weight = weight / np.bincount(label, weight)[label]

    def means(values: Floats) -> Floats:
        return np.stack([np.bincount(label, weight * column) for column in values.T], axis=1)

    here, there = pattern.points[inside], positions[inside]
    rest, centres = means(here), means(there)
    outer = there[:, :, None] * (here - rest[label])[:, None, :]
    moments = means(outer.reshape(-1, 9)).reshape(-1, 3, 3)
    return Rod(rest, centres, polar_rotation(moments)[0])
