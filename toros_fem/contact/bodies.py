"""Rigid bodies: closed surfaces that are held, moved, or free with a mass."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from toros_fem._types import Floats, Ints
from toros_fem._validate import require_positive


@dataclass(frozen=True, eq=False)
class RigidBody:
    """A rigid body with a closed triangulated surface.

    Attributes:
        name: Its name, in results and reports.
        points: Vertices of its surface in m, (n, 3), where it is made.
        triangles: Their triangles, (m, 3), oriented outwards.
        mass: In kg, of a body that moves freely; None for one that is held or moved with the load.
    """

    name: str
    points: Floats
    triangles: Ints
    mass: float | None = None

    def __post_init__(self) -> None:
        if self.mass is not None:
            require_positive(mass=self.mass)
        object.__setattr__(self, "points", np.array(self.points, dtype=np.float64))
        object.__setattr__(self, "triangles", np.array(self.triangles, dtype=np.int64))

    @property
    def centre(self) -> Floats:
        """Centroid of the volume in m, (3,): the centre of mass and of rotations."""
        corners = self.points[self.triangles]
        six = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
        return np.asarray(six @ corners.sum(axis=1) / (4 * six.sum()))
