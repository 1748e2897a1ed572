"""What a skin touches: ground and rigid bodies, held, moved or free, and the motion of these.

A pose is a translation t in m and a rotation vector θ in rad. It takes a point p of a body with
centre c to c + t + R(θ) (p − c), with Rodrigues' formula for an angle φ = |θ|:

    R(θ) y = cos φ y + A θ × y + B (θ · y) θ,    A = sin φ / φ,    B = (1 − cos φ) / φ²

All three coefficients are smooth functions of φ², so that no angle is special at zero. At φ = 2π
the rotation is that of θ = 0 about every axis: there the Jacobian loses two of its six ranks, and
near there a pose is a poor unknown. A pose with φ > π should be replaced by the equal one with
angle φ − 2π (`shortest`) where it is kept as the start of a next solve.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.sparse import coo_array, csr_array, hstack

from toros_fem.base.errors import ParameterError, PatternError, SurfaceError
from toros_fem.base.packages import required
from toros_fem.base.validation import (
    Floats,
    Ints,
    checked_floats,
    checked_names,
    require_flag,
    unit_vector,
    whole_numbers,
)
from toros_fem.measures.shape import axial
from toros_fem.meshes.surface import Surface, holes, volume
from toros_fem.meshes.triangles import corner_angles, normals, skew, surface_areas

# Faces around a vertex whose normals spread by less than this, in rad, count as one plane.
FLAT = 0.05
# Squared angle in rad² below which the coefficients are summed as series, and terms of these.
SERIES, TERMS = 1.0, 10


@dataclass(frozen=True)
class Ground:
    """A half-space that nothing enters.

    Attributes:
        point: A point of its surface, in m.
        normal: Direction out of it; its length does not matter.
    """

    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        point = checked_floats("point", self.point, "a finite vector of three, in m", (3,))
        normal = unit_vector("normal", self.normal, "that out of the ground")
        object.__setattr__(self, "point", tuple(float(v) for v in point))
        object.__setattr__(self, "normal", tuple(float(v) for v in normal))


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


class FreeBodies:
    """The surfaces of all n bodies, and the motion of the k free ones.

    The surfaces are moved inwards by half the sheet's thickness, since distances are those of
    its middle surface. A free body has six unknowns, all in m: its translation, and its rotation
    vector times its radius. They count from where it was made. Poses are those of all bodies,
    (n, 6) in m and rad; vertices are those of all, (v, 3) in m.

    Attributes:
        names: Names of all bodies.
        count: Number k of free bodies.
        free: Their numbers among all bodies, (k,).
        triangles: Triangles of all bodies, (m, 3), by their vertices from 0 on.
        areas: Their areas in m², (m,), as made.
        counts: Number of vertices of each body.
        moving: Vertices of the free bodies.
        scale: Pose in m and rad by each unknown, (k, 6).
    """

    def __init__(self, bodies: Sequence[RigidBody], thickness: float) -> None:
        self.names = [body.name for body in bodies]
        self.free: Ints = np.flatnonzero([body.free for body in bodies])
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


def placed(points: Floats, centre: Floats, pose: Floats) -> Floats:
    """Return where a pose, (6,), takes points of a body, (n, 3) in m where it is made."""
    return np.asarray((points - centre) @ rotation(pose[3:]).T + (centre + pose[:3]))


def rotation(vector: Floats) -> Floats:
    """Return the rotation matrix, (3, 3), of a rotation vector in rad, (3,)."""
    cosine, a, b = _coefficients(float(vector @ vector))[0]
    return np.asarray(cosine * np.eye(3) + a * skew(vector) + b * np.outer(vector, vector))


def pose_jacobian(points: Floats, centre: Floats, pose: Floats) -> Floats:
    """Return the derivative of `placed` by the pose, (3 n, 6), in m/m and m/rad.

    Rows are x, y, z of each point in turn.
    """
    arms, turn = points - centre, pose[3:]
    (_, a, b), (dcosine, da, db), _ = _coefficients(float(turn @ turn))
    along, across = arms @ turn, np.cross(turn, arms)
    by_square = dcosine * arms + da * across + db * along[:, None] * turn
    jacobian: Floats = np.zeros((len(points), 3, 6))
    jacobian[:, :, :3] = np.eye(3)
    jacobian[:, :, 3:] = 2 * by_square[:, :, None] * turn
    jacobian[:, :, 3:] -= a * skew(arms)
    jacobian[:, :, 3:] += b * (along[:, None, None] * np.eye(3) + turn[:, None] * arms[:, None, :])
    return jacobian.reshape(-1, 6)


def pose_curvature(points: Floats, centre: Floats, pose: Floats, force: Floats) -> Floats:
    """Return the second derivative by the pose of Σ force · `placed`, (6, 6), forces held."""
    turn = pose[3:]
    (_, _, b), (dcosine, da, db), (ddcosine, dda, ddb) = _coefficients(float(turn @ turn))
    # All that the points enter by: the sum is cos φ tr G + A θ · moment + B θ · G θ.
    products = force.T @ (points - centre)
    trace, both = float(np.trace(products)), products + products.T
    moment = axial(products)
    spin, square, stretched = float(turn @ moment), float(turn @ products @ turn), both @ turn
    first = dcosine * trace + da * spin + db * square
    second = ddcosine * trace + dda * spin + ddb * square
    mixed = np.outer(turn, da * moment + db * stretched)
    curvature: Floats = np.zeros((6, 6))
    curvature[3:, 3:] = (
        2 * first * np.eye(3) + 4 * second * np.outer(turn, turn) + 2 * (mixed + mixed.T) + b * both
    )
    return curvature


def shortest(vectors: Floats) -> Floats:
    """Return rotation vectors in rad, (…, 3), of at most π that give the same rotations."""
    angle = np.linalg.norm(vectors, axis=-1, keepdims=True)
    turns = np.round(angle / (2 * np.pi))
    return np.asarray(vectors * (1 - 2 * np.pi * turns / np.maximum(angle, np.pi)))


def _coefficients(square: float) -> Floats:
    """Return cos φ, A and B, and their first and second derivatives by φ², (3, 3)."""
    if square < SERIES:
        return _series(square)
    angle = np.sqrt(square)
    cosine, a = np.cos(angle), np.sin(angle) / angle
    b = (1 - cosine) / square
    dcosine, da, db = -a / 2, (cosine - a) / (2 * square), (a / 2 - b) / square
    second = -da / 2, (dcosine - 3 * da) / (2 * square), (da / 2 - 2 * db) / square
    return np.array([[cosine, a, b], [dcosine, da, db], second])


def _series(square: float) -> Floats:
    """Return the same as `_coefficients` by the power series of the three functions."""
    orders = np.arange(TERMS)
    factorials = np.cumprod(np.append(1.0, np.arange(1, 2 * TERMS + 1)))
    series = (-1.0) ** orders / [factorials[2 * orders + k] for k in range(3)]
    out: Floats = np.empty((3, 3))
    for row in out:
        row[:] = np.polynomial.polynomial.polyval(square, series.T)
        series = series[:, 1:] * np.arange(1, series.shape[1])
    return out


def ipctk() -> Any:
    """Return the module `ipctk`, which then works on one thread: its sums keep their order.

    Raises:
        MissingPackageError: It is not installed.
    """
    module = required("ipctk", "contact")
    module.set_num_threads(1)
    module.set_logger_level(module.LoggerLevel.error)
    return module


def collision_mesh(points: Floats, triangles: Ints, may_touch: Any = None) -> Any:
    """Return the `ipctk.CollisionMesh` of surfaces; a filter, of its own kind, leaves pairs out."""
    library = ipctk()
    faces = np.asfortranarray(triangles, dtype=np.int32)
    mesh = library.CollisionMesh(np.asfortranarray(points), library.edges(faces), faces)
    if may_touch is not None:
        mesh.can_collide = may_touch
    return mesh


def patches_apart(numbers: Ints) -> Any:
    """Return a filter that lets vertices touch whose numbers differ."""
    return ipctk().make_vertex_patches_filter(np.asarray(numbers, dtype=np.int32))
