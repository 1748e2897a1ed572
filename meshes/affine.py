"""Affine maps of the plane: turns, shifts, mirror images, and the best map between points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike
from shapely.affinity import affine_transform
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats

# Entries of a rotation this close to a whole number are that number: quarter turns are exact, and
# a rectangle that just fits still does after one.
EXACT = 1e-12


@dataclass(frozen=True, eq=False)
class Affine:
    """The map x → matrix · x + offset of points in the plane, in m."""

    matrix: Floats
    offset: Floats

    @classmethod
    def shift(cls, offset: ArrayLike) -> Self:
        """Return the translation by an offset, (2,), in m."""
        return cls(np.eye(2), np.asarray(offset, dtype=np.float64))

    @classmethod
    def turn(cls, angle: float, offset: ArrayLike = (0.0, 0.0)) -> Self:
        """Return the rotation about the origin by an angle in rad, then a translation in m."""
        entries = np.array([np.cos(angle), np.sin(angle)])
        whole = np.round(entries)
        c, s = np.where(np.abs(entries - whole) < EXACT, whole, entries)
        return cls(np.array([[c, -s], [s, c]]), np.asarray(offset, dtype=np.float64))

    @classmethod
    def mirror(cls) -> Self:
        """Return the reflection (x, y) → (−x, y)."""
        return cls(np.diag([-1.0, 1.0]), np.zeros(2))

    @classmethod
    def fit(cls, source: Floats, target: Floats) -> Self:
        """Return the map that takes points (k, 2) to others, with the least sum of squares."""
        middle = source.mean(axis=0)
        columns = np.column_stack([source - middle, np.ones(len(source))])
        found = np.linalg.lstsq(columns, target, rcond=None)[0]
        matrix = found[:2].T
        return cls(matrix, found[2] - matrix @ middle)

    @property
    def angle(self) -> float:
        """Direction of the image of the x axis in rad."""
        return float(np.arctan2(self.matrix[1, 0], self.matrix[0, 0]))

    @property
    def inverse(self) -> Self:
        """The map back; a LinAlgError where the map takes the plane to a line."""
        back = np.asarray(np.linalg.inv(self.matrix), dtype=np.float64)
        return type(self)(back, -back @ self.offset)

    def __matmul__(self, first: Affine) -> Self:
        """Return the map that applies `first`, then this one."""
        return type(self)(self.matrix @ first.matrix, self.vectors(first.offset) + self.offset)

    def points(self, points: ArrayLike) -> Floats:
        """Return the images of points, (…, 2), in m."""
        return self.vectors(points) + self.offset

    def vectors(self, vectors: ArrayLike) -> Floats:
        """Return the images of differences of points, (…, 2)."""
        return np.asarray(np.asarray(vectors, dtype=np.float64) @ self.matrix.T)

    def region(self, region: BaseGeometry) -> BaseGeometry:
        """Return the image of a geometry."""
        return affine_transform(region, [*self.matrix.ravel(), *self.offset])
