"""Charts: regions of a surface, opened to a disc, laid flat and checked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.base.errors import SurfaceError
from toros_fem.meshes.cut import cones, cut_open, disc_cuts, euler
from toros_fem.meshes.distortion import triangle_stretches
from toros_fem.meshes.flatten import abf_angles, closure_error, conformal, unrolled
from toros_fem.meshes.pattern import MIN_HEIGHT_RATIO
from toros_fem.meshes.triangles import (
    angle_defects,
    corner_angles,
    edges_of,
    flat_areas,
    half_edges,
    normals,
    shapes,
)

METHODS = ("auto", "exact", "abf", "lscm")
# Edges whose lengths differ by less than this fraction are equal: an STL has seven digits.
DEVELOPABLE = 1e-4
# Patterns refuse flat triangles of half this thickness (height over longest edge).
SLIVER = 2 * MIN_HEIGHT_RATIO
# Fraction of a region's area, at rough spots, on which the bound on stretch may be exceeded.
SPOTS = 0.02


class ChartError(Exception):
    """A region cannot be laid flat as one panel; dividing it may help."""


@dataclass(frozen=True, eq=False)
class Chart:
    """A region laid flat.

    Attributes:
        corners: Flat corners of each triangle, shape (t, 3, 2), in m.
        slits: Whether the region was cut from corner i to i + 1 of each triangle to become a
            disc, shape (t, 3).
        method: "exact", "abf" or "lscm".
    """

    corners: Floats
    slits: Bools
    method: str


def lay_flat(
    points: Floats, triangles: Ints, cuts: Bools, method: str, max_stretch: float, tips: bool
) -> Chart:
    """Open a connected region to a disc and lay it flat, with the area that it has in space.

    Args:
        points: Vertices of the whole surface (n, 3) in m.
        triangles: Triangles of the region (t, 3).
        cuts: Whether it is already cut from corner i to i + 1 of each triangle, (t, 3).
        method: One of `METHODS`.
        max_stretch: Bound on stretch and compression.
        tips: Whether cuts may go through tips of high curvature.

    Raises:
        ChartError: Flat triangles are turned over or slivers, or the flat region overlaps itself
            or is stretched too far.
        SurfaceError: The method is "exact", but the region is not developable.
    """
    edges = edges_of(triangles)
    seams = np.zeros(len(edges.ends), dtype=bool)
    seams[edges.of_triangle[cuts]] = True
    cut = cut_open(triangles, edges, seams)
    if tips and len(edges.border) == 0 and not len(cones(points, triangles, edges)):
        raise ChartError("it is closed and round.")
    further = disc_cuts(points[cut.sewn], cut.triangles, tips=tips)
    slits = np.isin(edges_of(cut.triangles).of_triangle, further)
    seams[edges.of_triangle[slits]] = True
    cut = cut_open(triangles, edges, seams)
    if cut.chart.max() > 0 or euler(cut.triangles) != 1:
        raise ChartError("its cuts do not open it to a disc.")
    embedded = points[cut.sewn]
    flat, used = _mapped(embedded, cut.triangles, method)
    corners = flat[cut.triangles]
    _check_injective(flat, cut.triangles)
    if np.isfinite(max_stretch):
        stretches = triangle_stretches(corners, embedded[cut.triangles])
        strain = np.maximum(stretches[:, 0], 1 / stretches[:, 1]) - 1
        area = np.linalg.norm(normals(points, triangles), axis=1)
        if area[strain > max_stretch].sum() > SPOTS * area.sum():
            raise ChartError(f"its stretch of {strain.max():.2g} exceeds {max_stretch:g}.")
    return Chart(corners, slits, used)


def _mapped(points: Floats, triangles: Ints, method: str) -> tuple[Floats, str]:
    angles = corner_angles(points, triangles)
    if method in ("auto", "exact"):
        flat = unrolled(points, triangles)
        error = closure_error(points, flat, triangles)
        if error <= DEVELOPABLE:
            return flat, "exact"
        if method == "exact":
            defect = np.abs(angle_defects(triangles, edges_of(triangles), angles))
            vertex = int(np.argmax(defect))
            raise SurfaceError(
                f"a region of {len(triangles)} triangles is not developable: unrolled, edge "
                f"lengths change by {error:.2g} (bound {DEVELOPABLE:g}); the angles around the "
                f"vertex at {points[vertex]} m miss 2π by {defect[vertex]:.2g} rad. Cut through "
                "such vertices, or use method 'auto'."
            )
    if method != "lscm":
        try:
            flat = _scaled(points, triangles, conformal(triangles, abf_angles(triangles, angles)))
            return flat, "abf"
        except SurfaceError as error:
            if method == "abf":
                raise ChartError(str(error)) from error
    return _scaled(points, triangles, conformal(triangles, angles)), "lscm"


def _scaled(points: Floats, triangles: Ints, flat: Floats) -> Floats:
    target = np.linalg.norm(normals(points, triangles), axis=1).sum() / 2
    return flat * np.sqrt(target / np.abs(flat_areas(flat[triangles]).sum()))


def _check_injective(flat: Floats, triangles: Ints) -> None:
    """Check that a flat disc does not overlap itself.

    A map of a disc that turns no triangle over is one-to-one if it is one-to-one on the border.
    """
    area = flat_areas(flat[triangles])
    if np.any(area <= 0):
        raise ChartError(f"{np.sum(area <= 0)} of its {len(area)} triangles are turned over.")
    thin = shapes(np.pad(flat, ((0, 0), (0, 1))), triangles) <= SLIVER
    if np.any(thin):
        raise ChartError(
            f"{thin.sum()} of its {len(area)} triangles are slivers, thinner than {SLIVER:g} of "
            "their longest edge."
        )
    edges = edges_of(triangles)
    next_vertex = dict(half_edges(triangles)[edges.twins[edges.border, 0]].tolist())
    start = here = next(iter(next_vertex))
    loop = [start]
    while (here := next_vertex[here]) != start:
        loop.append(here)
    if not shapely.is_simple(shapely.linearrings(flat[loop])):
        raise ChartError("its border overlaps itself.")
