"""Rigid bodies: closed surfaces that are held, moved, or free."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.errors import ParameterError, PatternError, SurfaceError
from toros_fem.base.validation import (
    checked_floats,
    checked_names,
    require_flag,
    whole_numbers,
)
from toros_fem.mechanics.contact.library import collision_mesh, ipctk
from toros_fem.mechanics.contact.motion import placed
from toros_fem.meshes.surfaces.surface import Surface, holes, volume
from toros_fem.meshes.triangles import corner_angles, normals

# Faces around a vertex whose normals spread by less than this, in rad, count as one plane.
FLAT = 0.05


@dataclass(frozen=True, eq=False)
class RigidBody:
    """A rigid body with a closed triangulated surface; `rigid_sphere` and others make some.

    Attributes:
        name: Its name, in results and reports.
        points: Vertices of its surface in m, (n, 3), where it is made.
        triangles: Their triangles, (m, 3), oriented outwards; all are turned if they face inwards.
        free: Whether what touches it moves it; others are held, or moved with the load.

    Raises:
        SurfaceError: Its surface is open, not connected, or no surface; or as of `Surface`.
    """

    name: str
    points: Floats
    triangles: Ints
    free: bool = False

    def __post_init__(self) -> None:
        checked_names("name", [self.name])
        require_flag(free=self.free)
        try:
            surface = _closed(self.points, self.triangles)
        except (SurfaceError, PatternError) as error:
            raise type(error)(f"rigid body {self.name!r}: {error}") from None
        object.__setattr__(self, "points", surface.points)
        object.__setattr__(self, "triangles", surface.triangles)

    @cached_property
    def volume(self) -> float:
        """Volume in m³."""
        return volume(self.points, self.triangles)

    @cached_property
    def centre(self) -> Floats:
        """Centroid of the volume in m, (3,): the centre of rotations."""
        middle = self.points.mean(axis=0)  # close by, so that far bodies lose no digits
        corners = (self.points - middle)[self.triangles]
        six = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
        return np.asarray(middle + six @ corners.sum(axis=1) / (4 * six.sum()))

    @cached_property
    def radius(self) -> float:
        """Largest distance in m of a vertex from the centre."""
        return float(np.linalg.norm(self.points - self.centre, axis=1).max())

    def moved(self, pose: Floats) -> RigidBody:
        """Return the body made at another pose, (6,): translation in m, rotation vector in rad."""
        pose = checked_floats("pose", pose, "six finite numbers, in m and rad", (6,))
        points = placed(self.points, self.centre, pose)
        return RigidBody(self.name, points, self.triangles, self.free)

    def inset(self, depth: float) -> Floats:
        """Return its vertices moved inwards, (n, 3) in m, so that all faces move by a depth.

        The surface at this distance around the inset one is the body, with convex edges rounded by
        the depth. Each vertex moves to where the planes of its faces meet after their own motion;
        where there are more than three, by least squares, weighted by the angles of the faces. On
        a face or an edge it moves straight inwards.

        Raises:
            ParameterError: A triangle would turn over, or two walls would cross: the body is too
                thin or too sharp there.
        """
        points, triangles = self.points, self.triangles
        normal = normals(points, triangles)
        unit = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        weight = corner_angles(points, triangles)
        planes: Floats = np.zeros((len(points), 3, 3))
        pushes: Floats = np.zeros((len(points), 3))
        for corner, angle in zip(triangles.T, weight.T, strict=True):
            np.add.at(planes, corner, angle[:, None, None] * unit[:, :, None] * unit[:, None, :])
            np.add.at(pushes, corner, angle[:, None] * unit)
        values, axes = np.linalg.eigh(planes)
        kept = values > FLAT**2 * values[:, 2:]
        steps = np.einsum("nij,ni->nj", axes, pushes) * kept / np.where(kept, values, 1.0)
        inner = points - depth * np.einsum("nij,nj->ni", axes, steps)
        over = np.einsum("ij,ij->i", normals(inner, triangles), normal) <= 0
        fault = ""
        if over.any():
            place = points[triangles[np.argmax(over)]].mean(axis=0)
            fault = f"{over.sum()} triangles turn over, the first at {place} m"
        elif depth > 0 and self._crosses(inner) and not self._crosses(points):
            fault = "two of its walls cross"
        if fault:
            raise ParameterError(
                f"depth = {depth:g} m: moved inwards by it, rigid body {self.name!r} is no body "
                f"any more: {fault}. It is thinner or sharper there than the sheet can feel: give "
                "it no walls, edges or roundings finer than twice the depth, or a thinner sheet."
            )
        return np.asarray(inner)

    def _crosses(self, points: Floats) -> bool:
        mesh = collision_mesh(points, self.triangles)
        return bool(ipctk().has_intersections(mesh, np.asfortranarray(points)))


def _closed(points: Floats, triangles: Ints) -> Surface:
    points = checked_floats(
        "points", points, "(n, 3), in m", lambda s: len(s) == 2 and s[1] == 3, failure=SurfaceError
    )
    triangles = whole_numbers("triangles", triangles, "(m, 3)", SurfaceError)
    fits = triangles.ndim == 2 and triangles.shape[1] == 3 and len(triangles) > 0
    known = fits and triangles.min() >= 0 and triangles.max() < len(points)
    if known and volume(points, triangles) < 0:
        triangles = triangles[:, ::-1]
    surface = Surface(points, triangles)
    if not surface.closed:
        raise SurfaceError(
            f"its surface has a border: {holes(surface)}. Close it, so that it has an inside."
        )
    return surface
