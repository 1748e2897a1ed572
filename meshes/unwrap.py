"""Sewing patterns from surfaces: seams, charts, flat panels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from toros_fem.base.array_types import Bools, Ints
from toros_fem.base.errors import SurfaceError
from toros_fem.base.mpi import collective, on_first_rank
from toros_fem.base.validation import require_choice, require_kind, require_positive, whole_numbers
from toros_fem.meshes.arrange import arranged
from toros_fem.meshes.chart import METHODS
from toros_fem.meshes.cut import cut_open
from toros_fem.meshes.distortion import Distortion, distortion
from toros_fem.meshes.panels import flat_panels
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.regions import crease_regions
from toros_fem.meshes.surface import Surface
from toros_fem.meshes.triangles import Edges, between, edge_keys, edges_of

AUTOMATIC = "auto"

# Default of the largest stretch or compression of panels with automatic seams.
MAX_STRETCH = 0.15
# The pattern computes seam lengths again: its tolerance allows for the rounding.
ROUNDING = 1e-9

Seams = npt.ArrayLike | str | None


@dataclass(frozen=True, eq=False)
class Unwrapped:
    """A surface as a sewing pattern.

    Attributes:
        pattern: The flat panels and their seams. Its assembled shape is the surface, with the
            surface's vertices and triangles in the same order.
        distortion: Distortion between the panels and the surface.
        seams: Edges of the surface that are cut, pairs of vertices, shape (k, 2).
        methods: Method by which each panel was laid flat, "exact", "abf" or "lscm".
    """

    pattern: Pattern
    distortion: Distortion
    seams: Ints
    methods: tuple[str, ...]


@collective("comm")
def unwrap(
    comm: MPI.Comm,
    surface: Surface,
    seams: Seams = None,
    method: str = "auto",
    *,
    crease_angle: float = np.radians(45),
    max_stretch: float | None = None,
) -> Unwrapped:
    """Cut a surface along seams and lay it out as flat panels (collective).

    Each panel keeps the area that it has on the surface, and is counter-clockwise seen from
    outside. A region that is no disc is opened by further cuts. It is divided in two if its flat
    shape overlaps itself or is stretched too far.

    Args:
        comm: Communicator; the first rank works.
        surface: The surface, the same on all ranks.
        seams: Edges to cut, pairs of the surface's vertices (k, 2). "auto" cuts at creases and
            where the stretch is too large. None takes the surface's own seams and the borders
            between its parts, or "auto" if it has neither.
        method: "exact" unrolls developable regions. "abf" changes angles as little as possible
            (ABF++). "lscm" solves one linear problem for nearly the same. "auto" unrolls where
            possible, otherwise takes "abf", or "lscm" where "abf" does not converge.
        crease_angle: Angle between normals above which an automatic seam follows an edge, in rad.
        max_stretch: Largest stretch or compression, 0.1 for 10 %. A region that exceeds it on more
            than 2 % of its area is divided. None is 0.15 with automatic seams, and no bound with
            given ones.

    Raises:
        ParameterError: An option is outside its bounds.
        SurfaceError: A seam is no edge of the surface, or a region cannot be laid flat by the
            requested method.
    """
    require_kind("surface", surface, Surface, "a Surface, by read_surface")
    require_choice("method", method, METHODS)
    require_positive(**{"crease_angle, in rad,": crease_angle}, at_most=np.pi)
    if max_stretch is not None:
        require_positive(max_stretch=max_stretch)

    def build() -> Unwrapped:
        edges = edges_of(surface.triangles)
        cuts = _given(surface, edges, seams)
        bound, automatic = max_stretch, cuts is None
        if cuts is None:
            region = crease_regions(surface.points, surface.triangles, crease_angle)
            cuts = between(edges, region)
            bound = MAX_STRETCH if max_stretch is None else max_stretch
        limit = np.inf if bound is None else bound
        return _unwrap(surface, edges, cuts, automatic, method, limit)

    return on_first_rank(comm, build)


def _given(surface: Surface, edges: Edges, seams: Seams) -> Bools | None:
    """Return whether each edge is a given seam; None if seams are to be found."""
    if isinstance(seams, str):
        require_choice("seams", seams, (AUTOMATIC,))
        return None
    if seams is None:
        own = between(edges, surface.parts) | _named(surface, edges, surface.seams)
        return own if own[edges.inner].any() else None
    pairs = whole_numbers("seams", seams, "pairs of vertices (k, 2)", SurfaceError)
    if pairs.size == 0:
        return np.zeros(len(edges.ends), dtype=bool)
    if pairs.ndim != 2 or pairs.shape[1] != 2:
        raise SurfaceError(f"seams has shape {pairs.shape}; it must hold pairs of vertices (k, 2).")
    return _named(surface, edges, pairs)


def _named(surface: Surface, edges: Edges, pairs: Ints) -> Bools:
    size = len(surface.points)
    wrong = np.flatnonzero(np.any((pairs < 0) | (pairs >= size), axis=1))
    if len(wrong):
        raise SurfaceError(
            f"seams[{wrong[0]}] = {pairs[wrong[0]].tolist()} names no vertices; they lie in "
            f"0 … {size - 1}."
        )
    keys, known = edge_keys(pairs, size), edge_keys(edges.ends, size)
    wrong = np.flatnonzero(~np.isin(keys, known))
    if len(wrong):
        a, b = pairs[wrong[0]]
        raise SurfaceError(
            f"seams[{wrong[0]}] = {[int(a), int(b)]} is no edge: no triangle has both vertices, at "
            f"{surface.points[a]} and {surface.points[b]} m. Give seams edge by edge."
        )
    return np.isin(known, keys)


def _unwrap(
    surface: Surface, edges: Edges, cuts: Bools, automatic: bool, method: str, max_stretch: float
) -> Unwrapped:
    charts = flat_panels(surface, edges, cuts, method, max_stretch, tips=automatic)
    label = np.zeros(len(surface.triangles), dtype=np.int64)
    seams = cuts.copy()
    for number, (cells, chart) in enumerate(charts):
        label[cells] = number
        seams[edges.of_triangle[cells][chart.slits]] = True
    seams |= between(edges, label)
    cut = cut_open(surface.triangles, edges, seams)
    flat = np.zeros((len(cut.sewn), 2))
    placed = arranged([chart.corners.reshape(-1, 2) for _, chart in charts])
    for (cells, _), corners in zip(charts, placed, strict=True):
        flat[cut.triangles[cells].ravel()] = corners
    loose = Pattern(
        flat_points=flat,
        flat_triangles=cut.triangles,
        panel=label,
        sewn=cut.sewn,
        points=surface.points,
        panel_names=_names(surface, [cells for cells, _ in charts]),
        seam_tolerance=1.0,
    )
    found = distortion(loose)
    return Unwrapped(
        pattern=replace(loose, seam_tolerance=max(1e-6, (1 + ROUNDING) * found.worst_seam)),
        distortion=found,
        seams=edges.ends[seams & (edges.count == 2)],
        methods=tuple(chart.method for _, chart in charts),
    )


def _names(surface: Surface, charts: Sequence[Ints]) -> tuple[str, ...]:
    """Name each chart after the part that it is in, or by a number if it is in several parts."""
    parts = [np.unique(surface.parts[cells]) for cells in charts]
    known = [int(part[0]) if len(part) == 1 else -1 for part in parts]
    names = []
    for number, part in enumerate(known):
        if len(surface.part_names) == 1 or part < 0:
            names.append(f"panel-{number + 1}")
        elif known.count(part) == 1:
            names.append(surface.part_names[part])
        else:
            names.append(f"{surface.part_names[part]}-{known[: number + 1].count(part)}")
    return tuple(names)
