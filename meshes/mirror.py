"""Whole skins from a part that is cut at symmetry planes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.base.errors import ParameterError, PatternError
from toros_fem.base.validation import checked_axes, require_kind
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.triangles import half_edges, linked

if TYPE_CHECKING:
    from toros_fem.meshes.transfer import OtherMesh

# Largest distance of a vertex in a symmetry plane from it, as a fraction of the skin's size.
FLAT = 1e-6
# Cuts of a panel are equally long, or at the same place, to this fraction of the longest one.
ALIKE = 1e-4
# Largest distance of a target from its mirror image, as a fraction of the skin's size.
SYMMETRIC = 1e-9


@dataclass(frozen=True, eq=False)
class Mirrored:
    """A whole skin, and the vertex and triangle of the part behind each of its own.

    Attributes:
        pattern: The whole. A panel that is cut continues across the cut, without a seam.
        vertex: Vertex of the part whose mirror image each assembled vertex is, shape (n,).
        cell: Triangle of the part whose mirror image each triangle is, shape (t,). The part's own
            triangles come first, at their flat places.
        flat: Flat point of the part whose mirror image each flat point is, shape (m,).
        signs: Factors ±1 from the part's coordinates to those of the image, shape (n, 3).
    """

    pattern: Pattern
    vertex: Ints
    cell: Ints
    flat: Ints
    signs: Floats

    @property
    def parts(self) -> int:
        """Number of equal parts that the whole is made of."""
        return len(self.cell) // (int(self.cell.max()) + 1)

    def at_vertices(self, positions: Floats) -> Floats:
        """Return positions of the whole, (n, 3), from those of the part, (m, 3), in m."""
        return np.asarray(self.signs * positions[self.vertex])

    def at_cells(self, values: Floats) -> Floats:
        """Return values of the whole's triangles, such as densities, from those of the part's."""
        return np.asarray(values[self.cell])

    def refined(self, finer: OtherMesh, axes: Sequence[int]) -> OtherMesh:
        """Return the finer mesh of the whole that a finer mesh of the part leads to.

        The axes are those of `mirrored`, in their order.
        """

        def keys(vertex: Ints, signs: Floats) -> Ints:
            """Return a number for each vertex of the part, (…), and its image by signs (…, 3)."""
            return np.asarray(8 * vertex + (signs < 0) @ [1, 2, 4])

        made, count = mirrored(finer.pattern, axes), int(self.vertex.max()) + 1
        # An image is known by its vertex and its signs, + across a plane that the vertex lies in.
        outside = np.zeros((count, 3), dtype=bool)
        np.logical_or.at(outside, self.vertex, self.signs < 0)
        known, ends = keys(self.vertex, self.signs), finer.ends[made.vertex]
        order = np.argsort(known)
        wanted = keys(ends, np.where(outside[ends], made.signs[:, None], 1.0))
        triangles = len(self.cell) // self.parts
        return replace(
            finer,
            source=self.pattern,
            pattern=made.pattern,
            cell=(triangles * np.arange(self.parts)[:, None] + finer.cell).ravel(),
            ends=order[np.searchsorted(known[order], wanted)],
            weights=finer.weights[made.vertex],
        )


_WHOLES: WeakKeyDictionary[Pattern, dict[tuple[int, ...], Mirrored]] = WeakKeyDictionary()


def mirrored(pattern: Pattern, axes: Sequence[int]) -> Mirrored:
    """Complete a part of a skin by its mirror images in coordinate planes through the origin.

    Its free edges in a plane are a cut, where it meets its image. The axes are the planes' normals
    in the order of reflection, 0 for x = 0, … The whole is made once for each pattern and kept as
    long as the pattern is.

    Raises:
        ParameterError: No free edge lies in a plane.
        PatternError: The part reaches across a plane, so that it overlaps its image.
    """
    require_kind("pattern", pattern, Pattern, "a Pattern")
    wholes, key = _WHOLES.setdefault(pattern, {}), checked_axes("axes", axes)
    if key in wholes:
        return wholes[key]
    found = Mirrored(
        pattern,
        vertex=np.arange(len(pattern.points)),
        cell=np.arange(len(pattern.panel)),
        flat=np.arange(len(pattern.flat_points)),
        signs=np.ones_like(pattern.points),
    )
    for axis in key:
        found = _doubled(found, axis)
    if key:  # without axes the value would keep its own key alive
        wholes[key] = found
    return found


def plane_border(pattern: Pattern, axis: int, at: float = 0.0) -> Ints:
    """Return the free half-edges, (k,), in the plane where a coordinate is `at`, in m."""
    flat = np.abs(pattern.points[:, axis] - at) <= FLAT * pattern.size
    border = pattern.edges.border[flat[pattern.free_edges].all(axis=1)]
    if len(border) == 0:
        raise ParameterError(
            f"no free edge lies in the plane {'xyz'[axis]} = {at:g} m. Cut the skin there; by "
            "default the plane goes through the origin."
        )
    return pattern.edges.twins[border, 0]


def longest_chain(flat_points: Floats, edges: Ints) -> Ints:
    """Return those of the edges of a panel's cut, (k, 2), that make up its longest chain.

    Of equally long ones it is the one with the least first coordinate in the mean, or else the
    least second one: other meshes of the same panel have the same chain.
    """
    label = linked(edges[:, 0], edges[:, 1], int(edges.max()) + 1)[edges[:, 0]]
    way, middle = np.diff(flat_points[edges], axis=1)[:, 0], flat_points[edges].mean(axis=1)
    length = np.hypot(*way.T)
    chains = np.unique(label)
    total = np.array([length[label == one].sum() for one in chains])
    places = np.array([length[label == one] @ middle[label == one] for one in chains])
    places = np.round(places / total[:, None] / (ALIKE * total.max()))
    long = np.flatnonzero(total > (1 - ALIKE) * total.max())
    best = long[np.lexsort(places[long].T[::-1])[0]]
    return edges[label == chains[best]]


def flip(axis: int) -> Floats:
    """Return the factors of the coordinates, (3,), of a reflection across an axis."""
    return np.where(np.arange(3) == axis, -1.0, 1.0)


def require_symmetric_map(
    points: Floats, axes: Sequence[int], deform: Callable[[Floats], Floats]
) -> None:
    """Check at points (n, 3) that a map of positions takes mirror images to mirror images."""
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    for axis in axes:
        off = float(np.abs(deform(flip(axis) * points) - flip(axis) * deform(points)).max())
        if off > SYMMETRIC * size:
            raise ParameterError(
                f"the target is not symmetric about {'xyz'[axis]} = 0: a vertex and its image are "
                f"{off:.3g} m apart. Leave this plane out."
            )


def _doubled(part: Mirrored, axis: int) -> Mirrored:
    """Return a part with its image in one plane."""
    pattern, name = part.pattern, "xyz"[axis]
    cut = half_edges(pattern.flat_triangles)[np.sort(plane_border(pattern, axis))]
    away = pattern.points[:, axis]
    low, high = int(np.argmin(away)), int(np.argmax(away))
    if -away[low] > FLAT * pattern.size < away[high]:
        raise PatternError(
            f"the part reaches across the plane {name} = 0 of reflection: vertex {low} lies at "
            f"{name} = {away[low]:.6g} m, vertex {high} at {away[high]:.6g} m, so that the part "
            "and its image would overlap. Cut it there, and give one side only."
        )
    shared = np.zeros(len(pattern.points), dtype=bool)
    shared[pattern.sewn[cut]] = True
    flat, kept, panel, names = _flat_images(pattern, cut, name)
    image, flat_image = (
        np.where(same, np.arange(len(same)), len(same) + np.cumsum(~same) - 1)
        for same in (shared, kept)
    )
    whole = replace(
        pattern,
        flat_points=np.concatenate([pattern.flat_points, flat[~kept]]),
        flat_triangles=np.concatenate(
            [pattern.flat_triangles, flat_image[pattern.flat_triangles[:, ::-1]]]
        ),
        panel=np.concatenate([pattern.panel, panel]),
        sewn=np.concatenate([pattern.sewn, image[pattern.sewn[~kept]]]),
        points=np.concatenate([pattern.points, flip(axis) * pattern.points[~shared]]),
        panel_names=names,
    )
    return Mirrored(
        whole,
        vertex=np.concatenate([part.vertex, part.vertex[~shared]]),
        cell=np.concatenate([part.cell, part.cell]),
        flat=np.concatenate([part.flat, part.flat[~kept]]),
        signs=np.concatenate([part.signs, flip(axis) * part.signs[~shared]]),
    )


def _flat_images(
    pattern: Pattern, cut: Ints, plane: str
) -> tuple[Floats, Bools, Ints, tuple[str, ...]]:
    """Mirror each panel in the line of its longest cut, where it continues.

    Its other cuts, as on a tube's wall, become seams. A panel without a cut, or with a crooked one,
    gets a second panel as its image. Returned are the mirrored flat points, whether each is its own
    image, the panel of each mirrored triangle, and the names of all panels.
    """
    flat, names, panel = pattern.flat_points.copy(), list(pattern.panel_names), pattern.panel.copy()
    near, kept = FLAT * pattern.size, np.zeros(len(flat), dtype=bool)
    for number, name in enumerate(pattern.panel_names):
        points = np.flatnonzero(pattern.panel_of_point == number)
        here = cut[pattern.panel_of_point[cut[:, 0]] == number]
        if len(here):
            chain = longest_chain(pattern.flat_points, here)
            begin, end = pattern.flat_points[chain[0]]
            normal = np.array([begin[1] - end[1], end[0] - begin[0]]) / np.hypot(*(end - begin))
            away = (pattern.flat_points - begin) @ normal
        if len(here) == 0 or np.abs(away[chain]).max() > near:
            flat[points] *= [-1, 1]
            panel[pattern.panel == number] = len(names)
            names.append(f"{name}, mirrored in {plane} = 0")
            continue
        flat[points] -= 2 * away[points, None] * normal
        border = np.unique(here)
        kept[border[np.abs(away[border]) <= near]] = True
    return flat, kept, panel, tuple(names)
