"""A triangulated surface in space, modelled or scanned, before it is cut and unwrapped."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.errors import PatternError, SurfaceError
from toros_fem.base.validation import checked_names
from toros_fem.meshes.pattern import keep_arrays, require_indices
from toros_fem.meshes.triangles import (
    clashing,
    connected_regions,
    edges_of,
    linked,
    require_manifold,
    shapes,
    surface_areas,
    surface_components,
)

# Thinner triangles (height over longest edge) spoil every flattening.
MIN_SHAPE = 1e-5


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
        repairs: Repairs that were made when it was read, in words.

    Raises:
        SurfaceError: The arrays do not fit together, hold NaN, or the surface is not connected.
        PatternError: It has triangles thinner than `MIN_SHAPE`, an edge of more than two or a
            vertex of several fans of them, neighbours that are oriented differently, or is closed
            and faces inwards.
    """

    points: Floats
    triangles: Ints
    parts: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    part_names: tuple[str, ...] = ()
    seams: Ints = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    repairs: str = "none"

    def __post_init__(self) -> None:
        if np.size(self.parts) == 0 and np.ndim(self.triangles) > 0:
            object.__setattr__(self, "parts", np.zeros(len(self.triangles)))
        keep_arrays(
            self, SurfaceError, points=(float, 3), triangles=(int, 3), parts=(int, 0),
            seams=(int, 2),
        )  # fmt: skip
        names = self.part_names
        if isinstance(names, tuple) and not names:
            names = tuple(f"part-{k}" for k in range(1 + int(self.parts.max(initial=0))))
        object.__setattr__(self, "part_names", checked_names("part_names", names, SurfaceError))
        for fault in self._faults():
            raise fault
        remedy = "Reverse one of them; a surface with one side only cannot be sewn."
        require_manifold(self.points, self.triangles, edges_of(self.triangles), remedy)
        if self.closed and volume(self.points, self.triangles) <= 0:
            raise PatternError(
                "the closed surface faces inwards: its volume is not positive. Swap two corners "
                "of every triangle."
            )

    @property
    def area(self) -> float:
        """Area of the surface in m²."""
        return float(surface_areas(self.points, self.triangles).sum())

    @property
    def size(self) -> float:
        """Diagonal of the bounding box in m."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))

    @property
    def closed(self) -> bool:
        """Whether the surface has no border."""
        return len(edges_of(self.triangles).border) == 0

    def _faults(self) -> Iterator[SurfaceError | PatternError]:
        n = len(self.points)
        if len(self.triangles) == 0:
            yield SurfaceError("the surface has no triangle.")
        if len(self.parts) != len(self.triangles):
            yield SurfaceError(f"parts has {len(self.parts)} entries, not one for each triangle.")
        require_indices(
            SurfaceError, triangles=(self.triangles, n), seams=(self.seams, n),
            parts=(self.parts, len(self.part_names)),
        )  # fmt: skip
        unused = np.setdiff1d(np.arange(n), self.triangles)
        if len(unused):
            yield SurfaceError(f"vertex {unused[0]} belongs to no triangle.")
        shape = shapes(self.points, self.triangles)
        thin = np.flatnonzero(shape < MIN_SHAPE)
        if len(thin):
            worst = int(np.argmin(shape))
            yield PatternError(
                f"{len(thin)} triangles are thinner than {MIN_SHAPE:g} of their longest edge, the "
                f"worst, {worst}, at {self.points[self.triangles[worst]].mean(axis=0)} m with "
                f"{shape[worst]:.2g}. Remesh the surface."
            )
        label = surface_components(self.triangles)
        if label.max() > 0:
            yield SurfaceError(
                f"the surface has {label.max() + 1} connected components, of "
                f"{np.bincount(label).tolist()} triangles. Give one of them, or connect them."
            )


def holes(surface: Surface) -> str:
    """Return the number of edges around the holes of an open surface, and the largest, in words."""
    edges = edges_of(surface.triangles)
    ends = edges.ends[edges.border]
    used, local = np.unique(ends, return_inverse=True)
    one, two = local.reshape(-1, 2).T
    label = linked(one, two, len(used))
    rims = [surface.points[used[label == k]] for k in range(label.max(initial=-1) + 1)]
    wide = max(rims, key=lambda rim: float(np.ptp(rim, axis=0).max()))
    across, (x, y, z) = np.ptp(wide, axis=0).max(), wide.mean(axis=0)
    count = "a hole" if len(rims) == 1 else f"{len(rims)} holes, the largest"
    return (
        f"{len(ends)} edges have one triangle alone, around {count} of {across:.3g} m at "
        f"({x:.4g}, {y:.4g}, {z:.4g}) m"
    )


def volume(points: Floats, triangles: Ints) -> float:
    """Return the volume in m³ inside a closed oriented surface; negative if it faces inwards."""
    a, b, c = np.moveaxis(points[triangles] - points.mean(axis=0), 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def oriented(triangles: Ints) -> Ints:
    """Reverse triangles (t, 3) to agree with the first one of their connected region.

    At most two triangles may meet at each edge.
    """
    edges, size = edges_of(triangles), len(triangles)
    one, two = edges.sides[edges.inner].T
    clash = np.isin(edges.inner, clashing(triangles, edges))
    # Each triangle is two nodes: unchanged, and reversed (+ size). On a surface with two sides, a
    # node is linked to one of the two nodes of any other triangle.
    rows = np.concatenate([one, one + size])
    cols = np.concatenate([two + size * clash, two + size * ~clash])
    label = linked(rows, cols, 2 * size)
    if np.any(label[:size] == label[size:]):
        k = int(np.argmax(label[:size] == label[size:]))
        raise PatternError(
            f"the surface has one side only around triangle {k}, vertices "
            f"{triangles[k].tolist()}: it has no outside. Cut it, or remove the faces that "
            "connect its two sides."
        )
    region = connected_regions(edges, edges.inner)
    root = np.unique(region, return_index=True)[1][region]
    turned = label[:size] != label[root]
    return np.where(turned[:, None], triangles[:, ::-1], triangles)
