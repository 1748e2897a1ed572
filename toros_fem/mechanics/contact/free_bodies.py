"""Bodies of a contact as it sees them: their vertices, moved by given poses or by unknowns."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.sparse import coo_array, csr_array, hstack

from toros_fem.base.array_types import Floats, Ints
from toros_fem.mechanics.contact.motion import placed, pose_curvature, pose_jacobian, shortest
from toros_fem.mechanics.contact.settings import Contact
from toros_fem.meshes.triangles import surface_areas


class FreeBodies:
    """The surfaces of all n bodies, and the motion of the k free ones.

    The surfaces are moved inwards by half the sheet's thickness, since distances are those of
    its middle surface. A free body has six unknowns, all in m: its translation, and its rotation
    vector times its radius. They count from where it was made. Poses are those of all bodies,
    (n, 6) in m and rad; vertices are those of all, (v, 3) in m.

    Attributes:
        count: Number k of free bodies.
        free: Their numbers among all bodies, (k,).
        triangles: Triangles of all bodies, (m, 3), by their vertices from 0 on.
        areas: Their areas in m², (m,), as made.
        counts: Number of vertices of each body.
        moving: Vertices of the free bodies.
        scale: Pose in m and rad by each unknown, (k, 6).
    """

    def __init__(self, contact: Contact, thickness: float) -> None:
        bodies = contact.bodies
        self.free: Ints = np.array(contact.free_bodies, dtype=np.int64)
        self.count = len(self.free)
        self._centres = [body.centre for body in bodies]
        self._points = [body.inset(thickness / 2) for body in bodies]
        self._placed: tuple[Floats, Floats] = np.full((len(bodies), 6), np.nan), np.zeros((0, 3))
        self.counts = [len(points) for points in self._points]
        ahead = np.cumsum([0, *self.counts])
        self._ranges = [slice(begin, end) for begin, end in pairwise(ahead)]
        owner = np.repeat(np.arange(len(bodies)), self.counts)
        self.moving: Ints = np.flatnonzero(np.isin(owner, self.free))
        shifted = [body.triangles + begin for body, begin in zip(bodies, ahead, strict=False)]
        self.triangles: Ints = np.concatenate([np.zeros((0, 3), dtype=np.int64), *shifted])
        areas = [surface_areas(body.points, body.triangles) for body in bodies]
        self.areas: Floats = np.concatenate([np.zeros(0), *areas])
        radii = [bodies[k].radius for k in self.free]
        self.scale = np.array([[1.0] * 3 + [1 / radius] * 3 for radius in radii]).reshape(-1, 6)

    def poses(self, unknowns: Floats, held: Floats) -> Floats:
        """Return the poses of all bodies from the unknowns in m, (k, 6), and those held."""
        poses = held.copy()
        poses[self.free] = unknowns * self.scale
        return poses

    def shortest(self, unknowns: Floats) -> Floats:
        """Return unknowns in m, (k, 6), of the same places, with rotations of at most π."""
        out, scale = unknowns.copy(), self.scale[:, 3:]
        turned = np.linalg.norm(out[:, 3:] * scale, axis=1) > np.pi
        out[turned, 3:] = shortest(out[turned, 3:] * scale[turned]) / scale[turned]
        return out

    def vertices(self, poses: Floats) -> Floats:
        """Return the vertices of all bodies."""
        if not np.array_equal(poses, self._placed[0]):  # held bodies stay where they are
            places = map(placed, self._points, self._centres, poses)
            self._placed = poses.copy(), np.concatenate([np.zeros((0, 3)), *places])
        return self._placed[1]

    def jacobian(self, poses: Floats) -> csr_array:
        """Return the derivative of `vertices` by the unknowns, (3 v, 6 k)."""
        blocks = []
        for number, scale in zip(self.free, self.scale, strict=True):
            points, centre = self._points[number], self._centres[number]
            dense = pose_jacobian(points, centre, poses[number]) * scale
            blocks.append((3 * self._ranges[number].start, dense))
        return in_columns(3 * sum(self.counts), blocks)

    def reduced(self, poses: Floats, forces: Floats) -> Floats:
        """Return what forces on all vertices, (v, 3), are on the unknowns, (k, 6), in N."""
        return np.asarray(self.jacobian(poses).T @ forces.ravel()).reshape(-1, 6)

    def largest_angle(self, motions: Floats) -> float:
        """Return the largest rotation in rad of a change of the unknowns, (k, 6)."""
        angles = np.linalg.norm((motions * self.scale)[:, 3:], axis=1)
        return float(angles.max(initial=0.0))

    def curvature(self, poses: Floats, forces: Floats) -> Floats:
        """Return the second derivative of Σ forces · `vertices` by the unknowns, (k, 6, 6) in N/m.

        The forces are those on all vertices in N, (v, 3), held constant.
        """
        blocks = np.zeros((self.count, 6, 6))
        for block, number, scale in zip(blocks, self.free, self.scale, strict=True):
            points, own = self._points[number], forces[self._ranges[number]]
            block[:] = pose_curvature(points, self._centres[number], poses[number], own)
            block *= scale * scale[:, None]
        return blocks


def in_columns(size: int, blocks: Sequence[tuple[int, Floats]]) -> csr_array:
    """Return a matrix of so many rows: dense blocks side by side, each from some row on."""
    columns = []
    for begin, dense in blocks:
        part = coo_array(dense)
        places = part.row + begin, part.col
        columns.append(csr_array((part.data, places), shape=(size, dense.shape[1])))
    return csr_array(hstack(columns) if columns else (size, 0))
