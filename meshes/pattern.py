"""The sewing pattern: flat panels, their seams, and the assembled shape."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.base.errors import (
    DegenerateTriangleError,
    ManifoldError,
    OpenSkinError,
    OrientationError,
    PanelError,
    PatternError,
    SeamError,
)
from toros_fem.base.validation import (
    checked_names,
    is_number,
    real_numbers,
    require_flag,
    shown,
    whole_numbers,
)
from toros_fem.meshes.triangles import (
    Edges,
    chart_turns,
    clashing,
    edges_of,
    flat_areas,
    half_edges,
    linked,
    pinched,
    users,
)

# A triangle thinner than this fraction of its longest edge has no usable shape functions.
MIN_HEIGHT_RATIO = 1e-6
# Number of names of panels in a message.
MOST_NAMES = 8


@dataclass(frozen=True, eq=False)
class Panel:
    """A flat piece of cloth, with the positions of its vertices in the assembled skin.

    Attributes:
        name: Name in messages and pictures.
        flat_points: Flat positions, shape (m, 2), in m.
        triangles: Corners among the flat points, shape (t, 3), counter-clockwise.
        points: Embedded positions, shape (m, 3), in m.
    """

    name: str
    flat_points: Floats
    triangles: Ints
    points: Floats


@dataclass(frozen=True, eq=False)
class Pattern:
    """Flat panels sewn into a skin, validated on construction.

    Each panel has one flat chart: its triangles share flat vertices. Sewing maps every flat
    vertex to an assembled vertex; two flat edges mapped to the same assembled edge are a seam.
    A tube is one rectangle with its left and right borders mapped to the same vertices.

    Args:
        flat_points: Flat positions, shape (m, 2), in m. Panels may overlap: `panel` separates
            them, not their places. `arrange.panel_offsets` gives places beside each other.
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
        DegenerateTriangleError, OrientationError, ManifoldError, SeamError, PanelError:
            The surface is not a valid skin; the message names triangle, edge or panel.
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
        for name, kind, width in (
            ("flat_points", np.float64, 2),
            ("flat_triangles", np.int64, 3),
            ("panel", np.int64, 0),
            ("sewn", np.int64, 0),
            ("points", np.float64, 3),
        ):
            required = f"(…, {width})" if width else "(…,)"
            read = real_numbers if kind is np.float64 else whole_numbers
            array = np.array(read(name, getattr(self, name), f"of shape {required}", PatternError))
            if array.ndim != (2 if width else 1) or (width and array.shape[1] != width):
                raise PatternError(f"{name} has shape {array.shape}; it must be {required}.")
            if not np.all(np.isfinite(array)):
                row = int(np.flatnonzero(~np.isfinite(array.reshape(len(array), -1)).all(1))[0])
                raise PatternError(f"{name}[{row}] = {array[row]} is not finite.")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        names = checked_names("panel_names", self.panel_names, PatternError)
        object.__setattr__(self, "panel_names", names)
        require_flag(moulded=self.moulded)
        self._check_sizes()
        self._check_triangles()
        self._check_edges()
        self._check_vertices()
        self._check_seams()

    @classmethod
    def from_panels(
        cls, panels: Sequence[Panel], tolerance: float, seam_tolerance: float = 1e-6
    ) -> Pattern:
        """Sew panels wherever their embedded border vertices coincide.

        Args:
            panels: Flat panels with their embedded positions.
            tolerance: Distance in m below which two embedded border vertices coincide.
            seam_tolerance: As in the constructor.
        """
        offsets = np.cumsum([0] + [len(panel.flat_points) for panel in panels])
        embedded = np.concatenate([panel.points for panel in panels])
        flat = np.concatenate([off + p.triangles for off, p in zip(offsets, panels, strict=False)])
        edges = edges_of(flat)
        border = np.unique(edges.ends[edges.border])
        pairs = border[cKDTree(embedded[border]).query_pairs(tolerance, output_type="ndarray")]
        sewn = linked(pairs[:, 0], pairs[:, 1], len(embedded))
        _, first = np.unique(sewn, return_index=True)
        return cls(
            flat_points=np.concatenate([panel.flat_points for panel in panels]),
            flat_triangles=flat,
            panel=np.repeat(np.arange(len(panels)), [len(p.triangles) for p in panels]),
            sewn=sewn,
            points=embedded[first],
            panel_names=tuple(panel.name for panel in panels),
            seam_tolerance=seam_tolerance,
        )

    def panel_index(self, name: str) -> int:
        """Return the number of the panel with this name.

        Raises:
            PanelError: There is no such panel.
        """
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

    @property
    def triangles(self) -> Ints:
        """Assembled vertices of each triangle, shape (t, 3)."""
        return self.sewn[self.flat_triangles]

    @property
    def corners(self) -> Floats:
        """Flat corner positions of each triangle, shape (t, 3, 2), in m."""
        return self.flat_points[self.flat_triangles]

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
        count = len(self.points)
        return np.bincount(self.triangles.ravel(), third, minlength=count).astype(np.float64)

    @cached_property
    def size(self) -> float:
        """Diagonal of the assembled skin's bounding box in m, the skin's length scale."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))

    @cached_property
    def free_edges(self) -> Ints:
        """Assembled edges with only one triangle, shape (k, 2)."""
        return half_edges(self.triangles)[self.edges.twins[self.edges.border, 0]]

    @cached_property
    def seams(self) -> Ints:
        """Pairs of flat edges sewn together, flat points of shape (s, 2 sides, 2 ends).

        `seams[k, 0, e]` and `seams[k, 1, e]` are sewn to the same vertex.
        """
        flat = self.flat_sides
        return flat[np.any(flat[:, 0] != flat[:, 1], axis=1)]

    @cached_property
    def seam_edges(self) -> Bools:
        """Whether each triangle has a seam at edge i, opposite corner i, shape (t, 3)."""
        flat = self.flat_sides
        seam = np.zeros(len(self.edges.ends), dtype=bool)
        seam[self.edges.inner] = np.any(flat[:, 0] != flat[:, 1], axis=1)
        # The edge from corner i + 1 to i + 2 is the one opposite corner i.
        return np.roll(seam[self.edges.of_triangle], -1, axis=1)

    def require_closed(self) -> None:
        """Check that the skin encloses a volume.

        Raises:
            OpenSkinError: An edge has no neighbour.
        """
        if len(self.free_edges):
            a, b = self.free_edges[0]
            raise OpenSkinError(
                f"pressure needs a closed skin, but {len(self.free_edges)} edges are free, the "
                f"first between vertices {a} and {b} at {self.points[a]} and {self.points[b]} m. "
                "Sew them to a neighbour, add a cap, let a symmetry plane close a border that "
                "lies in it (symmetry_plane), or set the pressure to 0."
            )

    def require_flat_panels(self, purpose: str) -> None:
        """Check that panels are flat pieces of cloth.

        Args:
            purpose: What needs them, for the message.

        Raises:
            PatternError: The skin is moulded.
        """
        if self.moulded:
            raise PatternError(
                f"{purpose} needs flat panels, but this skin is moulded: each of its triangles has "
                "a chart of its own. Cut it from flat panels (meshes.unwrap), or leave this out."
            )

    @cached_property
    def edges(self) -> Edges:
        """Edges of the assembled skin, between its vertices."""
        return edges_of(self.triangles)

    @cached_property
    def chart_turns(self) -> Floats:
        """Angle in rad, (−π, π], by which a direction turns across each edge with two triangles.

        A direction at angle t in the chart of the first of `edges.sides` is at t plus this in that
        of the second, for the edges `edges.inner`.
        """
        return chart_turns(self.corners, self.edges)[self.edges.inner]

    @cached_property
    def flat_sides(self) -> Ints:
        """Flat ends of both sides of each inner edge, sewn ones at the same index."""
        sides = half_edges(self.flat_triangles)[self.edges.twins[self.edges.inner]]
        sides[:, 1] = sides[:, 1, ::-1]
        return sides

    def _check_sizes(self) -> None:
        m, t, n = len(self.flat_points), len(self.flat_triangles), len(self.points)
        if t == 0:
            raise PatternError("the pattern has no triangle.")
        if len(self.panel) != t:
            raise PatternError(f"panel has {len(self.panel)} entries for {t} triangles.")
        if len(self.sewn) != m:
            raise PatternError(f"sewn has {len(self.sewn)} entries for {m} flat points.")
        for name, array, bound in (
            ("flat_triangles", self.flat_triangles, m),
            ("sewn", self.sewn, n),
            ("panel", self.panel, len(self.panel_names)),
        ):
            if array.min() < 0 or array.max() >= bound:
                wrong = array.min() if array.min() < 0 else array.max()
                raise PatternError(f"{name} holds {wrong}; entries must lie in 0 … {bound - 1}.")
        for index, name in enumerate(self.panel_names):
            if not np.any(self.panel == index):
                raise PanelError(f"panel {index} ({name!r}) has no triangle.")
        low = np.full(m, len(self.panel_names))
        high = np.full(m, -1)
        corner = self.flat_triangles.ravel()
        np.minimum.at(low, corner, np.repeat(self.panel, 3))
        np.maximum.at(high, corner, np.repeat(self.panel, 3))
        if np.any(high < 0):
            raise PatternError(f"flat point {np.flatnonzero(high < 0)[0]} belongs to no triangle.")
        if np.any(low != high):
            point = np.flatnonzero(low != high)[0]
            raise PanelError(
                f"flat point {point} is used by panels {low[point]} and {high[point]}. Give each "
                "panel its own flat points and sew them by `sewn`."
            )
        unused = np.setdiff1d(np.arange(n), self.sewn)
        if len(unused):
            raise PatternError(f"assembled vertex {unused[0]} belongs to no flat point.")
        if not (is_number(self.seam_tolerance) and 0 <= self.seam_tolerance < np.inf):
            raise PatternError(
                f"seam_tolerance = {shown(self.seam_tolerance)} must be a number, not negative."
            )

    def _check_triangles(self) -> None:
        tri = self.triangles
        twice = (tri[:, 0] == tri[:, 1]) | (tri[:, 1] == tri[:, 2]) | (tri[:, 2] == tri[:, 0])
        if np.any(twice):
            k = int(np.flatnonzero(twice)[0])
            raise DegenerateTriangleError(
                f"triangle {k} of panel {self._panel_of(k)} uses an assembled vertex twice: "
                f"{tri[k].tolist()}. Refine it, or correct `sewn`."
            )
        corners = self.corners
        longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
        flat = np.abs(self.areas) * 2 <= MIN_HEIGHT_RATIO * longest**2
        if np.any(flat):
            k = int(np.flatnonzero(flat)[0])
            raise DegenerateTriangleError(
                f"triangle {k} of panel {self._panel_of(k)} has a flat area of "
                f"{self.areas[k]:.3g} m² on a longest edge of {longest[k]:.3g} m; its height must "
                f"exceed {MIN_HEIGHT_RATIO:g} of that edge. Remesh the panel."
            )
        if np.any(self.areas < 0):
            k = int(np.flatnonzero(self.areas < 0)[0])
            raise OrientationError(
                f"triangle {k} of panel {self._panel_of(k)} is clockwise on its panel; seen from "
                "outside the skin all triangles must be counter-clockwise. Swap two corners."
            )

    def _check_edges(self) -> None:
        edges = self.edges
        many = np.flatnonzero(edges.count > 2)
        if len(many):
            a, b = self._ends(many[0])
            raise ManifoldError(
                f"the edge between vertices {a} and {b} has {edges.count[many[0]]} triangles "
                f"({users(edges, many[0]).tolist()}); a skin allows two."
            )
        wrong = clashing(self.triangles, edges)
        if len(wrong):
            a, b = self._ends(wrong[0])
            one, two = edges.sides[wrong[0]]
            raise OrientationError(
                f"triangles {one} and {two} pass their common edge {a}-{b} in the same direction. "
                "Mirror one of their panels, or reverse a seam."
            )

    def _check_vertices(self) -> None:
        found = pinched(self.triangles, self.edges)
        if len(found):
            raise ManifoldError(
                f"vertex {found[0]} at {self.points[found[0]]} m joins fans of triangles that "
                "share no edge there; the skin pinches to a point. Separate the fans."
            )

    def _check_seams(self) -> None:
        if not len(self.seams):
            return
        ends = self.flat_points[self.seams]
        length = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)
        gap = np.abs(length[:, 0] - length[:, 1]) / length.max(axis=1)
        worst = int(np.argmax(gap))
        if gap[worst] > self.seam_tolerance:
            a, b = self.sewn[self.seams[worst, 0]]
            raise SeamError(
                f"the seam edge between vertices {a} and {b} is {length[worst, 0]:.6g} m long on "
                f"one side and {length[worst, 1]:.6g} m on the other, a relative difference of "
                f"{gap[worst]:.2g}; the bound is {self.seam_tolerance:g}. Correct the panels, or "
                "raise seam_tolerance if the cloth is to be gathered."
            )

    def _panel_of(self, triangle: int) -> str:
        return f"{self.panel[triangle]} ({self.panel_names[self.panel[triangle]]!r})"

    def _ends(self, edge: int) -> Ints:
        """Return the ends of an edge in the direction in which its first triangle passes it."""
        return half_edges(self.triangles)[self.edges.twins[edge, 0]]
