"""A triangulated surface in space, modelled or scanned, before it is cut and unwrapped."""

from __future__ import annotations

from dataclasses import astuple, dataclass, field

import numpy as np

from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.errors import (
    DegenerateTriangleError,
    ManifoldError,
    OrientationError,
    SurfaceError,
)
from toros_fem.base.validation import checked_names, real_numbers, whole_numbers
from toros_fem.meshes.triangles import (
    clashing,
    connected_regions,
    edges_of,
    half_edges,
    linked,
    normals,
    pinched,
    shapes,
    surface_components,
    users,
)

# Thinner triangles (height over longest edge) spoil every flattening.
MIN_SHAPE = 1e-5


@dataclass(frozen=True)
class Repairs:
    """Number of repairs of each kind that were made when a surface was read.

    Attributes:
        merged: Vertices merged with another one at the same place.
        dropped: Triangles dropped: copies, those with a corner twice, and flat ones at a border.
        collapsed: Edges collapsed in needles (triangles with one short edge).
        flipped: Edges flipped in caps (triangles with a corner on the opposite edge).
        turned: Triangles reversed to agree with their neighbours or to face outwards.
    """

    merged: int = 0
    dropped: int = 0
    collapsed: int = 0
    flipped: int = 0
    turned: int = 0

    def __add__(self, other: Repairs) -> Repairs:
        return Repairs(*(a + b for a, b in zip(astuple(self), astuple(other), strict=True)))

    def __str__(self) -> str:
        done = {
            "coincident vertices merged": self.merged,
            "triangles dropped": self.dropped,
            "edges collapsed": self.collapsed,
            "edges flipped": self.flipped,
            "triangles reversed": self.turned,
        }
        return ", ".join(f"{count} {what}" for what, count in done.items() if count) or "none"


@dataclass(frozen=True, eq=False)
class Surface:
    """One connected, oriented, manifold surface; validated on construction.

    Args:
        points: Vertices, shape (n, 3), in m.
        triangles: Corners of each triangle, shape (t, 3), counter-clockwise seen from outside.
        parts: Number of the part of each triangle, shape (t,), from 0; empty is one part.
            Borders between parts are seams.
        part_names: A name for each part.
        seams: Edges to cut along, pairs of vertices, shape (k, 2).
        repairs: Repairs that were made when it was read.

    Raises:
        SurfaceError: The arrays do not fit together, hold NaN, or the surface is not connected.
        DegenerateTriangleError: Triangles are thinner than `MIN_SHAPE`.
        ManifoldError: An edge has more than two triangles, or a vertex has several fans of them.
        OrientationError: Neighbours are oriented differently, or a closed surface faces inwards.
    """

    points: Floats
    triangles: Ints
    parts: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    part_names: tuple[str, ...] = ()
    seams: Ints = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    repairs: Repairs = Repairs()

    def __post_init__(self) -> None:
        if np.size(self.parts) == 0 and np.ndim(self.triangles) > 0:
            object.__setattr__(self, "parts", np.zeros(len(self.triangles)))
        for name, kind, width in (
            ("points", np.float64, 3),
            ("triangles", np.int64, 3),
            ("parts", np.int64, 0),
            ("seams", np.int64, 2),
        ):
            required = f"(…, {width})" if width else "(…,)"
            read = real_numbers if kind is np.float64 else whole_numbers
            array = np.array(read(name, getattr(self, name), f"of shape {required}", SurfaceError))
            if array.ndim != (2 if width else 1) or (width and array.shape[1] != width):
                raise SurfaceError(f"{name} has shape {array.shape}; it must be {required}.")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        names = self.part_names
        if isinstance(names, tuple) and not names:
            names = tuple(f"part-{k}" for k in range(1 + int(self.parts.max(initial=0))))
        object.__setattr__(self, "part_names", checked_names("part_names", names, SurfaceError))
        self._check_sizes()
        check_edges(self.points, self.triangles)
        self._check_orientation()
        check_fans(self.points, self.triangles)

    @property
    def area(self) -> float:
        """Area of the surface in m²."""
        return float(np.linalg.norm(normals(self.points, self.triangles), axis=1).sum() / 2)

    @property
    def closed(self) -> bool:
        """Whether the surface has no border."""
        return len(edges_of(self.triangles).border) == 0

    def _check_sizes(self) -> None:
        n = len(self.points)
        if len(self.triangles) == 0:
            raise SurfaceError("the surface has no triangle.")
        if len(self.parts) != len(self.triangles):
            raise SurfaceError(f"parts has {len(self.parts)} entries, not one for each triangle.")
        if not np.all(np.isfinite(self.points)):
            row = int(np.flatnonzero(~np.isfinite(self.points).all(axis=1))[0])
            raise SurfaceError(f"points[{row}] = {self.points[row]} is not finite.")
        for name, array, bound in (
            ("triangles", self.triangles, n),
            ("seams", self.seams, n),
            ("parts", self.parts, len(self.part_names)),
        ):
            if array.size and (array.min() < 0 or array.max() >= bound):
                wrong = array.min() if array.min() < 0 else array.max()
                raise SurfaceError(f"{name} holds {wrong}; entries must lie in 0 … {bound - 1}.")
        unused = np.setdiff1d(np.arange(n), self.triangles)
        if len(unused):
            raise SurfaceError(f"vertex {unused[0]} belongs to no triangle.")
        shape = shapes(self.points, self.triangles)
        thin = np.flatnonzero(shape < MIN_SHAPE)
        if len(thin):
            worst = int(np.argmin(shape))
            raise DegenerateTriangleError(
                f"{len(thin)} triangles are thinner than {MIN_SHAPE:g} of their longest edge, the "
                f"worst, {worst}, at {self.points[self.triangles[worst]].mean(axis=0)} m with "
                f"{shape[worst]:.2g}. Remesh the surface."
            )
        label = surface_components(self.triangles)
        if label.max() > 0:
            raise SurfaceError(
                f"the surface has {label.max() + 1} connected components, of "
                f"{np.bincount(label).tolist()} triangles. Give one of them, or connect them."
            )

    def _check_orientation(self) -> None:
        edges = edges_of(self.triangles)
        wrong = clashing(self.triangles, edges)
        if len(wrong):
            a, b = half_edges(self.triangles)[edges.twins[wrong[0], 0]]
            raise OrientationError(
                f"both triangles at edge {a}-{b} pass it in the same direction. Reverse one of "
                "them; a surface with one side only cannot be sewn."
            )
        if self.closed and volume(self.points, self.triangles) <= 0:
            raise OrientationError(
                "the closed surface faces inwards: its volume is not positive. Swap two corners "
                "of every triangle."
            )


def volume(points: Floats, triangles: Ints) -> float:
    """Return the volume in m³ inside a closed oriented surface; negative if it faces inwards."""
    a, b, c = np.moveaxis(points[triangles] - points.mean(axis=0), 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def oriented(triangles: Ints) -> Ints:
    """Reverse triangles (t, 3) to agree with the first one of their connected region.

    Args:
        triangles: Triangles with at most two at each edge.

    Raises:
        OrientationError: A region has one side only, as a Möbius strip has.
    """
    edges = edges_of(triangles)
    one, two = edges.sides[edges.inner].T
    clash = np.isin(edges.inner, clashing(triangles, edges))
    size = len(triangles)
    # Each triangle is two nodes: unchanged, and reversed (+ size). On a surface with two sides, a
    # node is linked to one of the two nodes of any other triangle.
    rows = np.concatenate([one, one + size])
    cols = np.concatenate([two + size * clash, two + size * ~clash])
    label = linked(rows, cols, 2 * size)
    if np.any(label[:size] == label[size:]):
        k = int(np.flatnonzero(label[:size] == label[size:])[0])
        raise OrientationError(
            f"the surface has one side only around triangle {k}, vertices "
            f"{triangles[k].tolist()}: it has no outside. Cut it, or remove the faces that "
            "connect its two sides."
        )
    region = connected_regions(edges, edges.inner)
    root = np.unique(region, return_index=True)[1][region]
    turned = label[:size] != label[root]
    return np.where(turned[:, None], triangles[:, ::-1], triangles)


def check_edges(points: Floats, triangles: Ints) -> None:
    """Check that no edge has more than two triangles.

    Raises:
        ManifoldError: Naming the edge, its place and its triangles.
    """
    edges = edges_of(triangles)
    many = np.flatnonzero(edges.count > 2)
    if len(many):
        a, b = edges.ends[many[0]]
        raise ManifoldError(
            f"{len(many)} edges have more than two triangles, the first between vertices {a} and "
            f"{b} at {points[[a, b]].mean(axis=0)} m with triangles "
            f"{users(edges, many[0]).tolist()}. A sewn skin has one inside and one outside: remove "
            "inner walls, or export the outer hull alone."
        )


def check_fans(points: Floats, triangles: Ints) -> None:
    """Check that the triangles around each vertex form one fan.

    Neighbours must have the same orientation.

    Raises:
        ManifoldError: Naming the vertex and its place.
    """
    found = pinched(triangles, edges_of(triangles))
    if len(found):
        vertex = found[0]
        raise ManifoldError(
            f"vertex {vertex} at {points[vertex]} m joins fans of triangles that share no edge "
            "there; the surface pinches to a point. Separate the fans."
        )
