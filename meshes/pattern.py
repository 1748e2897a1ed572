"""The sewing pattern: flat panels, their seams, the assembled shape; wholes by mirror images."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias
from weakref import WeakKeyDictionary

import numpy as np
import shapely
from scipy.sparse import csr_array, eye_array
from scipy.spatial import cKDTree
from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import PanelError, ParameterError, PatternError, TorosError
from toros_fem.base.validation import (
    Bools,
    Floats,
    Ints,
    checked_axes,
    checked_floats,
    checked_names,
    is_number,
    require_flag,
    require_kind,
    shown,
    whole_numbers,
)
from toros_fem.meshes.triangles import (
    Edges,
    chart_turns,
    edges_of,
    flat_areas,
    half_edges,
    laplacian,
    lengths,
    linked,
    require_manifold,
)

if TYPE_CHECKING:
    from toros_fem.meshes.transfer import OtherMesh

# A triangle thinner than this fraction of its longest edge has no usable shape functions.
MIN_HEIGHT_RATIO = 1e-6
# Number of names of panels in a message.
MOST_NAMES = 8
# Damping over the Laplacian's diagonal: without any fixed vertex a harmonic extension is zero.
DAMPING = 1e-9
Regions: TypeAlias = Sequence[BaseGeometry]
"""A region of each panel of a pattern, polygons in m; an empty one where there is nothing."""
# Largest distance of a vertex in a symmetry plane from it, as a fraction of the skin's size.
FLAT = 1e-6
# Cuts of a panel are equally long, or at the same place, to this fraction of the longest one.
ALIKE = 1e-4
# Largest distance of a target from its mirror image, as a fraction of the skin's size.
SYMMETRIC = 1e-9


class Panel(NamedTuple):
    """A flat piece of cloth, with the positions of its vertices in the assembled skin, in m."""

    name: str
    flat_points: Floats  # (m, 2)
    triangles: Ints  # (t, 3), counter-clockwise
    points: Floats  # (m, 3)


@dataclass(frozen=True, eq=False)
class Pattern:
    """Flat panels sewn into a skin, validated on construction.

    Each panel has one flat chart: its triangles share flat vertices. Sewing maps every flat
    vertex to an assembled vertex; two flat edges mapped to the same assembled edge are a seam.
    A tube is one rectangle with its left and right borders mapped to the same vertices.

    Args:
        flat_points: Flat positions, shape (m, 2), in m. Panels may overlap: `panel` separates
            them, not their places. `panels.panel_places` gives places beside each other.
        flat_triangles: Corners of each triangle among the flat points, shape (t, 3),
            counter-clockwise seen from outside the skin.
        panel: Panel of each triangle, shape (t,), numbered from 0.
        sewn: Assembled vertex of each flat point, shape (m,).
        points: Assembled positions, shape (n, 3), in m, where a simulation starts. The flat shape
            is free of stress; for bending, the assembled one may be chosen instead.
        panel_names: A name for each panel.
        seam_tolerance: Largest relative difference of length of two edges sewn together.
        moulded: Whether triangles have charts of their own, as of `meshes.moulded`, so that
            neither places nor directions on a panel mean anything beyond one triangle.

    Raises:
        PatternError: The arrays do not fit together or hold NaN.
        PatternError, PanelError: The surface is not a valid skin; the message names triangle, edge
            or panel.
    """

    flat_points: Floats
    flat_triangles: Ints
    panel: Ints
    sewn: Ints
    points: Floats
    panel_names: tuple[str, ...]
    seam_tolerance: float = 1e-6
    moulded: bool = False

    def __post_init__(self) -> None:
        keep_arrays(
            self, PatternError, flat_points=(float, 2), flat_triangles=(int, 3), panel=(int, 0),
            sewn=(int, 0), points=(float, 3),
        )  # fmt: skip
        names = checked_names("panel_names", self.panel_names, PatternError)
        object.__setattr__(self, "panel_names", names)
        require_flag(moulded=self.moulded)
        for fault in chain(self._faults_of_sizes(), self._faults_of_triangles()):
            raise fault
        remedy = "Mirror one of their panels, or reverse a seam."
        require_manifold(self.points, self.triangles, self.edges, remedy)
        self._check_seams()

    @classmethod
    def from_panels(cls, panels: Sequence[Panel], tolerance: float) -> Pattern:
        """Sew panels wherever their embedded border vertices coincide, within a tolerance in m."""
        offsets = np.cumsum([0] + [len(panel.flat_points) for panel in panels])[:-1]
        embedded = np.concatenate([panel.points for panel in panels])
        flat = np.concatenate([off + p.triangles for off, p in zip(offsets, panels, strict=True)])
        edges = edges_of(flat)
        border = np.unique(edges.ends[edges.border])
        pairs = border[cKDTree(embedded[border]).query_pairs(tolerance, output_type="ndarray")]
        sewn = linked(pairs[:, 0], pairs[:, 1], len(embedded))
        return cls(
            flat_points=np.concatenate([panel.flat_points for panel in panels]),
            flat_triangles=flat,
            panel=np.repeat(np.arange(len(panels)), [len(p.triangles) for p in panels]),
            sewn=sewn,
            points=embedded[np.unique(sewn, return_index=True)[1]],
            panel_names=tuple(panel.name for panel in panels),
        )

    def panel_index(self, name: str) -> int:
        """Return the number of the panel with this name."""
        if not isinstance(name, str) or name not in self.panel_names:
            known = ", ".join(map(repr, self.panel_names[:MOST_NAMES]))
            more = ", …" if len(self.panel_names) > MOST_NAMES else ""
            raise PanelError(f"no panel is named {shown(name)}; there are {known}{more}.")
        return self.panel_names.index(name)

    def cells_of(self, name: str) -> Ints:
        """Return the triangles of a panel, by its name."""
        return np.flatnonzero(self.panel == self.panel_index(name))

    def vertices_of(self, name: str) -> Ints:
        """Return the assembled vertices of a panel, by its name, including those on its seams."""
        return np.unique(self.triangles[self.cells_of(name)])

    def outline(self, panel: int) -> BaseGeometry:
        """Return the outline of a panel, by its number, a polygon in m."""
        return self.outlines[panel]

    def mean_over_flat_points(self, values: Floats) -> Floats:
        """Return values at assembled vertices, (n, …): means over those of their flat points."""
        sewn, count = self.sewn, len(self.points)
        shape = (count, len(sewn))
        matrix = csr_array((np.ones(len(sewn)), (sewn, np.arange(len(sewn)))), shape=shape)
        mean = (matrix @ values.reshape(len(values), -1)) / np.bincount(sewn)[:, None]
        return np.asarray(mean).reshape(count, *values.shape[1:])

    def flat_laplacian(self) -> csr_array:
        """Return the stiffness of linear elements on the flat panels, sewn together, (n, n)."""
        whole = laplacian(self.corners, self.triangles)
        identity = csr_array(eye_array(len(self.points)))
        return whole + DAMPING * whole.diagonal().mean() * identity

    def require_closed(self) -> None:
        """Check that the skin encloses a volume."""
        if len(self.free_edges):
            a, b = self.free_edges[0]
            raise PatternError(
                f"pressure needs a closed skin, but {len(self.free_edges)} edges are free, the "
                f"first between vertices {a} and {b} at {self.points[a]} and {self.points[b]} m. "
                "Sew them to a neighbour, add a cap, hold the whole border, let a symmetry_plane "
                "close it, or set the pressure to 0."
            )

    def require_flat_panels(self, purpose: str) -> None:
        """Check that panels are flat pieces of cloth; the purpose is for the message."""
        if self.moulded:
            raise PatternError(
                f"{purpose} needs flat panels, but this skin is moulded: each of its triangles has "
                "a chart of its own. Cut it from flat panels (meshes.unwrap), or leave this out."
            )

    @cached_property
    def triangles(self) -> Ints:
        """Assembled vertices of each triangle, shape (t, 3)."""
        return _fixed(self.sewn[self.flat_triangles])

    @cached_property
    def corners(self) -> Floats:
        """Flat corner positions of each triangle, shape (t, 3, 2), in m."""
        return _fixed(self.flat_points[self.flat_triangles])

    @cached_property
    def areas(self) -> Floats:
        """Flat area of each triangle, shape (t,), in m²."""
        return flat_areas(self.corners)

    @cached_property
    def centroids(self) -> Floats:
        """Flat centroid of each triangle in its panel's chart, shape (t, 2), in m."""
        return self.corners.mean(axis=1)

    @cached_property
    def vertex_areas(self) -> Floats:
        """A third of the flat area around each assembled vertex, shape (n,), in m²."""
        third = np.repeat(self.areas / 3, 3)
        return np.bincount(self.triangles.ravel(), third).astype(np.float64)

    @cached_property
    def panel_of_point(self) -> Ints:
        """Panel of each flat point, shape (m,); −1 where no triangle uses it."""
        found: Ints = np.full(len(self.flat_points), -1, dtype=np.int64)
        found[self.flat_triangles] = self.panel[:, None]
        return found

    @cached_property
    def size(self) -> float:
        """Diagonal of the assembled skin's bounding box in m, the skin's length scale."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))

    @cached_property
    def edges(self) -> Edges:
        """Edges of the assembled skin, between its vertices."""
        return edges_of(self.triangles)

    @cached_property
    def free_edges(self) -> Ints:
        """Assembled edges with only one triangle, shape (k, 2)."""
        return half_edges(self.triangles)[self.edges.twins[self.edges.border, 0]]

    @cached_property
    def flat_sides(self) -> Ints:
        """Flat ends of both sides of each inner edge, sewn ones at the same index."""
        sides = half_edges(self.flat_triangles)[self.edges.twins[self.edges.inner]]
        sides[:, 1] = sides[:, 1, ::-1]
        return sides

    @cached_property
    def seams(self) -> Ints:
        """Pairs of flat edges sewn together, flat points of shape (s, 2 sides, 2 ends).

        `seams[k, 0, e]` and `seams[k, 1, e]` are sewn to the same vertex.
        """
        return self.flat_sides[np.any(self.flat_sides[:, 0] != self.flat_sides[:, 1], axis=1)]

    @cached_property
    def seam_gaps(self) -> Floats:
        """Relative difference of length of the two edges of each seam, shape (s,)."""
        length = lengths(self.flat_points, self.seams)
        return np.asarray(np.abs(length[:, 0] - length[:, 1]) / length.max(axis=1))

    @cached_property
    def seam_edges(self) -> Bools:
        """Whether each triangle has a seam at edge i, opposite corner i, shape (t, 3)."""
        flat = self.flat_sides
        seam = np.zeros(len(self.edges.ends), dtype=bool)
        seam[self.edges.inner] = np.any(flat[:, 0] != flat[:, 1], axis=1)
        # The edge from corner i + 1 to i + 2 is the one opposite corner i.
        return np.roll(seam[self.edges.of_triangle], -1, axis=1)

    @cached_property
    def chart_turns(self) -> Floats:
        """Angle in rad, (−π, π], by which a direction turns across each edge with two triangles.

        A direction at angle t in the chart of the first of `edges.sides` is at t plus this in that
        of the second, for the edges `edges.inner`.
        """
        return chart_turns(self.corners, self.edges)[self.edges.inner]

    @cached_property
    def outlines(self) -> list[BaseGeometry]:
        """Outline of each panel, polygons in m."""
        return [
            shapely.coverage_union_all(shapely.polygons(self.corners[self.panel == panel]))
            for panel in range(len(self.panel_names))
        ]

    def require_regions(self, regions: Regions) -> None:
        """Check that there is a region for each panel."""
        if len(regions) != len(self.panel_names):
            raise PanelError(
                f"there are {len(regions)} regions for {len(self.panel_names)} panels; give one "
                "for each panel, an empty polygon where nothing is printed."
            )

    def _faults_of_sizes(self) -> Iterator[PatternError]:
        m, t, n = len(self.flat_points), len(self.flat_triangles), len(self.points)
        if t == 0:
            yield PatternError("the pattern has no triangle.")
        if len(self.panel) != t:
            yield PatternError(f"panel has {len(self.panel)} entries for {t} triangles.")
        if len(self.sewn) != m:
            yield PatternError(f"sewn has {len(self.sewn)} entries for {m} flat points.")
        require_indices(
            PatternError, flat_triangles=(self.flat_triangles, m), sewn=(self.sewn, n),
            panel=(self.panel, len(self.panel_names)),
        )  # fmt: skip
        for index, name in enumerate(self.panel_names):
            if not np.any(self.panel == index):
                yield PanelError(f"panel {index} ({name!r}) has no triangle.")
        if np.any(self.panel_of_point < 0):
            point = int(np.argmin(self.panel_of_point))
            yield PatternError(f"flat point {point} belongs to no triangle.")
        found = self.panel_of_point[self.flat_triangles]
        shared = np.argwhere(found != self.panel[:, None])
        if len(shared):
            cell, corner = shared[0]
            low, high = sorted((self.panel[cell], found[cell, corner]))
            yield PanelError(
                f"flat point {self.flat_triangles[cell, corner]} is used by panels {low} and "
                f"{high}. Give each panel its own flat points and sew them by `sewn`."
            )
        unused = np.setdiff1d(np.arange(n), self.sewn)
        if len(unused):
            yield PatternError(f"assembled vertex {unused[0]} belongs to no flat point.")
        if not (is_number(self.seam_tolerance) and 0 <= self.seam_tolerance < np.inf):
            yield PatternError(
                f"seam_tolerance = {shown(self.seam_tolerance)} must be a number, not negative."
            )

    def _faults_of_triangles(self) -> Iterator[PatternError]:
        def first(wrong: Bools) -> tuple[int, str]:
            k = int(np.argmax(wrong))
            return k, f"triangle {k} of panel {self.panel[k]} ({self.panel_names[self.panel[k]]!r})"

        twice = np.any(self.triangles == np.roll(self.triangles, 1, axis=1), axis=1)
        if np.any(twice):
            k, name = first(twice)
            yield PatternError(
                f"{name} uses an assembled vertex twice: {self.triangles[k].tolist()}. Refine it, "
                "or correct `sewn`."
            )
        sides = self.corners - np.roll(self.corners, 1, axis=1)
        longest = np.linalg.norm(sides, axis=2).max(axis=1)
        flat = np.abs(self.areas) * 2 <= MIN_HEIGHT_RATIO * longest**2
        if np.any(flat):
            k, name = first(flat)
            yield PatternError(
                f"{name} has a flat area of {self.areas[k]:.3g} m² on a longest edge of "
                f"{longest[k]:.3g} m; its height must exceed {MIN_HEIGHT_RATIO:g} of that edge. "
                "Remesh the panel."
            )
        if np.any(self.areas < 0):
            yield PatternError(
                f"{first(self.areas < 0)[1]} is clockwise on its panel; seen from outside the skin "
                "all triangles must be counter-clockwise. Swap two corners."
            )

    def _check_seams(self) -> None:
        if self.seam_gaps.max(initial=0.0) > self.seam_tolerance:
            worst = int(np.argmax(self.seam_gaps))
            a, b = self.sewn[self.seams[worst, 0]]
            length = lengths(self.flat_points, self.seams[worst])
            raise PatternError(
                f"the seam edge between vertices {a} and {b} is {length[0]:.6g} m long on one side "
                f"and {length[1]:.6g} m on the other, a relative difference of "
                f"{self.seam_gaps[worst]:.2g}; the bound is {self.seam_tolerance:g}. Correct the "
                "panels, or raise seam_tolerance if the cloth is to be gathered."
            )


def keep_arrays(owner: Any, failure: type[TorosError], **kinds: tuple[type, int]) -> None:
    """Check the arrays of a frozen dataclass, and keep copies that cannot be written.

    Of each it is told whether it is float or int, and the length of its second axis, 0 without.
    """
    for name, (kind, width) in kinds.items():
        array = checked_array(name, getattr(owner, name), kind, width, failure)
        object.__setattr__(owner, name, _fixed(np.array(array)))


def checked_array(
    name: str, values: Any, kind: type, width: int, failure: type[TorosError]
) -> np.ndarray:
    """Return an array of floats or ints, (n, width), or (n,) for 0, checked to be finite."""
    what = f"of shape (…, {width})" if width else "of shape (…,)"
    rest = (width,) if width else ()

    def fits(shape: tuple[int, ...]) -> bool:
        return len(shape) > 0 and shape[1:] == rest

    array = checked_floats(name, values, what, fits, failure=failure)
    return array if kind is float else whole_numbers(name, array, what, failure)


def require_indices(failure: type[TorosError], **arrays: tuple[Ints, int]) -> None:
    """Check that arrays of numbers lie below their bounds, and none is negative."""
    for name, (array, bound) in arrays.items():
        if array.size and (array.min() < 0 or array.max() >= bound):
            wrong = array.min() if array.min() < 0 else array.max()
            raise failure(f"{name} holds {wrong}; entries must lie in 0 … {bound - 1}.")


def _fixed(array: Any) -> Any:
    array.setflags(write=False)
    return array


# ------------------------------------------------------------------------ wholes by mirror images


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
