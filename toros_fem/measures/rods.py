"""A slender skin as a rod: places and frames of its cross-sections, and strains between them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from toros_fem.base.array_types import Floats, Ints
from toros_fem.measures.rotation import polar_rotation
from toros_fem.meshes.pattern import Pattern


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
