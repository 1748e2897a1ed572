"""Sewing patterns from surfaces: seams, charts laid flat and checked, panels, their distortion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely
from mpi4py import MPI
from scipy.sparse import coo_array, csc_array, csr_array, eye_array
from scipy.sparse.csgraph import breadth_first_order
from scipy.sparse.linalg import splu

from toros_fem.base.errors import SurfaceError
from toros_fem.base.mpi import on_root
from toros_fem.base.validation import (
    Bools,
    Floats,
    Ints,
    require_choice,
    require_kind,
    require_positive,
)
from toros_fem.meshes.panels import arranged
from toros_fem.meshes.pattern import MIN_HEIGHT_RATIO, Pattern, checked_array, require_indices
from toros_fem.meshes.seams import cones, crease_regions, cut_open, disc_cuts, euler, halves
from toros_fem.meshes.surface import Surface
from toros_fem.meshes.triangles import (
    Edges,
    angle_defects,
    between,
    connected_regions,
    corner_angles,
    edge_keys,
    edges_of,
    flat_areas,
    half_edges,
    lengths,
    shapes,
    surface_areas,
    surface_components,
)

AUTOMATIC = "auto"
METHODS = ("auto", "exact", "abf", "lscm")
# Default of the largest stretch or compression of panels with automatic seams.
MAX_STRETCH = 0.15
# The pattern computes seam lengths again: its tolerance allows for the rounding.
ROUNDING = 1e-9
# Edges whose lengths differ by less than this fraction are equal: an STL has seven digits.
DEVELOPABLE = 1e-4
# Patterns refuse flat triangles of half this thickness (height over longest edge).
SLIVER = 2 * MIN_HEIGHT_RATIO
# Fraction of a region's area, at rough spots, on which the bound on stretch may be exceeded.
SPOTS = 0.02
Seams = npt.ArrayLike | str | None
# Inverse iterations, and Newton steps of ABF++, at most.
ROUNDS, STEPS = 500, 60
# Shift of a conformal energy that is singular to the last bit, over its mean diagonal.
SHIFT = 1e-16


class ChartError(Exception):
    """A region cannot be laid flat as one panel; dividing it may help."""


Chart = tuple[Floats, Bools, str]
"""A region laid flat: flat corners of each triangle, (t, 3, 2), in m; where it was cut from corner
i to i + 1 of each triangle to become a disc, (t, 3); and the method."""
Panels = list[tuple[Ints, Chart]]
"""Triangles of the surface in each panel, and the panel laid flat."""


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


@on_root
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
    edges = edges_of(surface.triangles)
    given = _given(surface, edges, seams)
    if given is not None:
        bound = np.inf if max_stretch is None else max_stretch
        return _unwrapped(surface, edges, given, method, bound, tips=False)
    cuts = between(edges, crease_regions(surface.points, surface.triangles, crease_angle))
    bound = MAX_STRETCH if max_stretch is None else max_stretch
    return _unwrapped(surface, edges, cuts, method, bound, tips=True)


def _given(surface: Surface, edges: Edges, seams: Seams) -> Bools | None:
    """Return whether each edge is a given seam; None if seams are to be found."""
    if isinstance(seams, str):
        require_choice("seams", seams, (AUTOMATIC,))
        return None
    if seams is None:
        own = between(edges, surface.parts) | _named(surface, edges, surface.seams)
        return own if own[edges.inner].any() else None
    if np.size(seams) == 0:
        return np.zeros(len(edges.ends), dtype=bool)
    return _named(surface, edges, checked_array("seams", seams, int, 2, SurfaceError))


def _named(surface: Surface, edges: Edges, pairs: Ints) -> Bools:
    """Return whether each edge is one of some pairs of vertices, (e,)."""
    size = len(surface.points)
    require_indices(SurfaceError, seams=(pairs, size))
    keys, known = edge_keys(pairs, size), edge_keys(edges.ends, size)
    wrong = np.flatnonzero(~np.isin(keys, known))
    if len(wrong):
        a, b = pairs[wrong[0]].tolist()
        raise SurfaceError(
            f"seams[{wrong[0]}] = {[a, b]} is no edge: no triangle has both vertices, at "
            f"{surface.points[a]} and {surface.points[b]} m. Give seams edge by edge."
        )
    return np.isin(known, keys)


def _unwrapped(
    surface: Surface, edges: Edges, cuts: Bools, method: str, max_stretch: float, *, tips: bool
) -> Unwrapped:
    panels = _flat_panels(surface, edges, cuts, method, max_stretch, tips=tips)
    label, seams = _labels(surface, panels), cuts.copy()
    for cells, (_, slits, _) in panels:
        seams[edges.of_triangle[cells][slits]] = True
    seams |= between(edges, label)
    flat_triangles, sewn = cut_open(surface.triangles, edges, seams)
    flat = np.zeros((len(sewn), 2))
    placed = arranged([corners.reshape(-1, 2) for _, (corners, _, _) in panels])
    for (cells, _), corners in zip(panels, placed, strict=True):
        flat[flat_triangles[cells].ravel()] = corners
    loose = Pattern(
        flat_points=flat,
        flat_triangles=flat_triangles,
        panel=label,
        sewn=sewn,
        points=surface.points,
        panel_names=_names(surface, [cells for cells, _ in panels]),
        seam_tolerance=1.0,
    )
    gap = float(loose.seam_gaps.max(initial=0.0))
    pattern = replace(loose, seam_tolerance=max(1e-6, (1 + ROUNDING) * gap))
    return Unwrapped(
        pattern=pattern,
        distortion=Distortion(pattern),
        seams=edges.ends[seams & (edges.count == 2)],
        methods=tuple(method for _, (_, _, method) in panels),
    )


def _labels(surface: Surface, panels: Panels) -> Ints:
    """Return the number of the panel that each triangle is in, (t,)."""
    label: Ints = np.zeros(len(surface.triangles), dtype=np.int64)
    for number, (cells, _) in enumerate(panels):
        label[cells] = number
    return label


def _names(surface: Surface, charts: Sequence[Ints]) -> tuple[str, ...]:
    """Name each chart after the part that it is in, or by a number if it is in several parts."""
    parts = [np.unique(surface.parts[cells]) for cells in charts]
    several = len(surface.part_names) == 1
    known = [-1 if several or len(part) > 1 else int(part[0]) for part in parts]
    alone = [k for k, part in enumerate(known) if part >= 0 and known.count(part) == 1]
    names = {k: surface.part_names[known[k]] for k in alone}
    for chart, part in enumerate(known):
        if chart not in names:
            stem = "panel" if part < 0 else surface.part_names[part]
            number = 1 + (chart if part < 0 else known[:chart].count(part))
            while (name := f"{stem}-{number}") in names.values():
                number += 1
            names[chart] = name
    return tuple(names[chart] for chart in range(len(charts)))


# -------------------------------------------------------------------------- regions and charts


def _flat_panels(
    surface: Surface, edges: Edges, cuts: Bools, method: str, max_stretch: float, *, tips: bool
) -> Panels:
    """Lay the regions between cuts flat; divide those that cannot be laid flat as one panel.

    Divided regions are merged again where that is possible. Arguments are those of `lay_flat`.
    """
    region = connected_regions(edges, edges.inner[~cuts[edges.inner]])
    waiting = [np.flatnonzero(region == k) for k in range(region.max() + 1)][::-1]
    panels: Panels = []
    divided = False

    def flat(cells: Ints) -> Chart:
        sides = cuts[edges.of_triangle[cells]]
        return lay_flat(surface.points, surface.triangles[cells], sides, method, max_stretch, tips)

    while waiting:
        cells = waiting.pop()
        try:
            panels.append((cells, flat(cells)))
        except ChartError as error:
            if len(cells) < 2:
                raise SurfaceError(f"triangle {cells[0]} cannot be laid flat: {error}") from error
            waiting += _divided(surface, edges, cuts, cells)
            divided = True
    refused: set[bytes] = set()
    while divided:
        for one, two in _neighbours(surface, edges, cuts, panels):
            cells = np.sort(np.concatenate([panels[one][0], panels[two][0]]))
            if cells.tobytes() in refused:
                continue
            try:
                chart = flat(cells)
            except ChartError:
                refused.add(cells.tobytes())
                continue
            panels = [panel for k, panel in enumerate(panels) if k not in (one, two)]
            panels.append((cells, chart))
            break
        else:
            break
    return sorted(panels, key=lambda panel: (int(surface.parts[panel[0][0]]), int(panel[0][0])))


def _divided(surface: Surface, edges: Edges, cuts: Bools, cells: Ints) -> list[Ints]:
    """Divide a region in two; return the triangles of each connected part."""
    triangles = surface.triangles[cells]
    local = edges_of(triangles)
    whole = (local.count == 2) & ~between(local, halves(surface.points, triangles))
    whole[local.of_triangle[cuts[edges.of_triangle[cells]]]] = False
    label = connected_regions(local, np.flatnonzero(whole))
    return [cells[label == k] for k in range(label.max(), -1, -1)]


def _neighbours(
    surface: Surface, edges: Edges, cuts: Bools, panels: Panels
) -> list[tuple[int, int]]:
    """Return pairs of panels that meet at an edge outside `cuts`, the most compact pair first."""
    label = _labels(surface, panels)
    area = np.bincount(label, surface_areas(surface.points, surface.triangles))
    meeting = between(edges, label) & ~cuts
    pair, group = np.unique(
        np.sort(label[edges.sides[meeting]], axis=1), axis=0, return_inverse=True
    )
    shared = np.bincount(group.ravel(), lengths(surface.points, edges.ends[meeting]))
    order = np.argsort(area[pair].sum(axis=1) / np.maximum(shared, 1e-300) ** 2, kind="stable")
    return [(int(one), int(two)) for one, two in pair[order]]


def lay_flat(
    points: Floats, triangles: Ints, cuts: Bools, method: str, max_stretch: float, tips: bool
) -> Chart:
    """Open a connected region to a disc and lay it flat, with the area that it has in space.

    Points (n, 3) in m are those of the whole surface. Cuts say whether it is already cut from
    corner i to i + 1 of each triangle, (t, 3); more may go through tips of high curvature.

    Raises:
        ChartError: Flat triangles are turned over or slivers, or the flat region overlaps itself
            or is stretched too far.
        SurfaceError: The method is "exact", but the region is not developable.
    """
    edges = edges_of(triangles)
    seams = np.zeros(len(edges.ends), dtype=bool)
    seams[edges.of_triangle[cuts]] = True
    opened, sewn = cut_open(triangles, edges, seams)
    if tips and len(edges.border) == 0 and not len(cones(points, triangles, edges)):
        raise ChartError("it is closed and round.")
    further = disc_cuts(points[sewn], opened, tips=tips)
    slits = np.isin(edges_of(opened).of_triangle, further)
    seams[edges.of_triangle[slits]] = True
    opened, sewn = cut_open(triangles, edges, seams)
    if surface_components(opened).max() > 0 or euler(opened) != 1:
        raise ChartError("its cuts do not open it to a disc.")
    flat, used = _mapped(points[sewn], opened, method)
    corners = flat[opened]
    fault = _overlap(flat, opened)
    if not fault and np.isfinite(max_stretch):
        strain = strains(triangle_stretches(corners, points[triangles]))
        area = surface_areas(points, triangles)
        if area[strain > max_stretch].sum() > SPOTS * area.sum():
            fault = f"its stretch of {strain.max():.2g} exceeds {max_stretch:g}."
    if fault:
        raise ChartError(fault)
    return corners, slits, used


def _mapped(points: Floats, triangles: Ints, method: str) -> tuple[Floats, str]:
    """Return the flat points of a disc, (n, 2) in m, and the method that gave them."""
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
    used = "lscm"
    if method != "lscm":
        try:
            angles, used = abf_angles(triangles, angles), "abf"
        except SurfaceError as error:
            if method == "abf":
                raise ChartError(str(error)) from error
    flat = conformal(triangles, angles)
    target = surface_areas(points, triangles).sum()
    return flat * np.sqrt(target / np.abs(flat_areas(flat[triangles]).sum())), used


def _overlap(flat: Floats, triangles: Ints) -> str:
    """Return how a flat disc overlaps itself, in a sentence; empty if it does not.

    A map of a disc that turns no triangle over is one-to-one if it is one-to-one on the border.
    """
    area = flat_areas(flat[triangles])
    if np.any(area <= 0):
        return f"{np.sum(area <= 0)} of its {len(area)} triangles are turned over."
    thin = shapes(np.pad(flat, ((0, 0), (0, 1))), triangles) <= SLIVER
    if np.any(thin):
        return (
            f"{thin.sum()} of its {len(area)} triangles are slivers, thinner than {SLIVER:g} of "
            "their longest edge."
        )
    edges = edges_of(triangles)
    next_vertex = dict(half_edges(triangles)[edges.twins[edges.border, 0]].tolist())
    start = here = next(iter(next_vertex))
    loop = [start]
    while (here := next_vertex[here]) != start:
        loop.append(here)
    simple = shapely.is_simple(shapely.linearrings(flat[loop]))
    return "" if simple else "its border overlaps itself."


# ------------------------------------------------------------------------------------- flattening


def unrolled(points: Floats, triangles: Ints) -> Floats:
    """Unroll a developable disc triangle by triangle, breadth first, to points (n, 2) in m.

    Triangles are turned as rigid pieces: scaled onto the edge before, rounding would grow
    exponentially on fine meshes. The first triangle that reaches a vertex places it.
    """
    edges, size = edges_of(triangles), len(triangles)
    one, two = edges.sides[edges.inner].T
    dual = csr_array((np.ones(len(one)), (one, two)), shape=(size, size))
    order, before = breadth_first_order(dual, 0, directed=False)
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    u, v = b - a, c - a
    base = np.linalg.norm(u, axis=1)
    # Corners of each triangle as complex numbers, the first at 0 and the second on the real axis.
    third = np.einsum("ij,ij->i", u, v) + 1j * np.linalg.norm(np.cross(u, v), axis=1)
    local: Any = np.stack([np.zeros(size), base, third / base], axis=1).tolist()
    corners: Any = triangles.tolist()
    numbers: Any = edges.of_triangle.tolist()
    turn = [1 + 0j] * size
    place = dict(zip(corners[order[0]], local[order[0]], strict=True))
    for t in order[1:].tolist():
        parent = int(before[t])
        i = next(k for k in range(3) if numbers[t][k] in numbers[parent])
        other = numbers[parent].index(numbers[t][i])
        j, k = (i + 1) % 3, (i + 2) % 3
        along = local[parent][other] - local[parent][(other + 1) % 3]
        way = turn[parent] * along / (local[t][j] - local[t][i])
        turn[t] = way / abs(way)
        if corners[t][k] not in place:
            middle = (place[corners[t][i]] + place[corners[t][j]]) / 2
            offset = local[t][k] - (local[t][i] + local[t][j]) / 2
            place[corners[t][k]] = middle + turn[t] * offset
    found = np.array([place[vertex] for vertex in range(len(points))])
    return np.column_stack([found.real, found.imag])


def closure_error(points: Floats, flat: Floats, triangles: Ints) -> float:
    """Return the largest relative difference of edge lengths between the plane and space."""
    ends = edges_of(triangles).ends
    return float(np.abs(lengths(flat, ends) / lengths(points, ends) - 1).max())


def conformal(triangles: Ints, angles: Floats) -> Floats:
    """Lay a disc flat with least conformal energy for given angles; return points (n, 2).

    Their scale is arbitrary. The energy is that of least squares conformal maps (Lévy et al. 2002,
    doi:10.1145/566654.566590). With two pinned vertices the result would depend on these.
    Therefore the spread of the border is fixed instead: the result is the smallest eigenvector of
    Mullen et al. (2008, spectral conformal parameterization, doi:10.1111/j.1467-8659.2008.01289.x,
    eq. 5), found by inverse iteration. In complex numbers its eigenvalue is simple. Angles at the
    corners, (t, 3), are those of the surface, or of `abf_angles`.
    """
    size = int(triangles.max()) + 1
    weight = 1 / (4 * np.tan(angles.ravel()))
    a, b = np.roll(triangles, -1, axis=1).ravel(), np.roll(triangles, -2, axis=1).ravel()
    edges = edges_of(triangles)
    p, q = half_edges(triangles)[edges.twins[edges.border, 0]].T
    area = np.full(len(p), -0.25j)
    rows = np.concatenate([a, b, a, b, p, q])
    cols = np.concatenate([a, b, b, a, q, p])
    values = np.concatenate([weight, weight, -weight, -weight, -area, area])
    energy = csc_array(coo_array((values, (rows, cols)), shape=(size, size)))
    kept = np.delete(np.arange(size), p[0])
    inner = csc_array(energy[kept][:, kept])
    try:
        factor = splu(inner, permc_spec="MMD_AT_PLUS_A")
    except RuntimeError:  # the energy of a developable disc has a kernel
        shift = SHIFT * np.abs(energy.diagonal()).mean()
        factor = splu(csc_array(inner + shift * eye_array(size - 1)), permc_spec="MMD_AT_PLUS_A")
    rim = np.unique(p)
    z = np.random.default_rng(0).standard_normal((size, 2)) @ [1, 1j]
    for _ in range(ROUNDS):
        load = np.zeros(size, dtype=complex)
        load[rim] = z[rim] - z[rim].mean()
        new = np.zeros(size, dtype=complex)
        new[kept] = factor.solve(load[kept])
        new -= new[rim].mean()
        new /= np.linalg.norm(new[rim])
        new *= np.exp(-1j * np.angle(np.vdot(z[rim], new[rim])))
        change, z = np.abs(new - z).max(), new
        if change < 1e-13:
            break
    return np.column_stack([z.real, z.imag])


def abf_angles(triangles: Ints, angles: Floats) -> Floats:
    """Return the angles of a flat disc that differ least from a surface's, (t, 3), in rad.

    Angle-based flattening by Sheffer et al. 2005 (ABF++, doi:10.1145/1061347.1061354) minimises
    the relative change of angles (eq. 1) under these constraints: the angles of a triangle sum to π
    (eq. 2), those around an inner vertex to 2π (eq. 3), and the edges around it close (eq. 4, here
    as a sum of logarithms, which makes the Hessian of the Lagrangian diagonal). Angles and triangle
    constraints are eliminated from Newton's system (section 3): two unknowns remain for each inner
    vertex.

    Raises:
        SurfaceError: Newton's method does not converge.
    """
    size, count, vertex = triangles.size, len(triangles), triangles.ravel()
    edges = edges_of(triangles)
    inner = np.ones(int(triangles.max()) + 1, dtype=bool)
    inner[edges.ends[edges.border]] = False
    if not inner.any():
        return angles
    around = np.bincount(vertex, angles.ravel())
    target = angles.ravel() * np.where(inner, 2 * np.pi / around, 1.0)[vertex]
    weight = 2 / target**2
    corner = np.flatnonzero(inner[vertex])
    wheels = int(inner.sum())  # a wheel: the triangles around an inner vertex
    row = (np.cumsum(inner) - 1)[vertex[corner]]
    first = corner - corner % 3
    ahead, behind = first + (corner + 1) % 3, first + (corner + 2) % 3
    rows = np.concatenate([row, wheels + row, wheels + row])
    columns = np.concatenate([corner, ahead, behind])
    of_triangle = csr_array((np.ones(size), (np.arange(size), np.arange(size) // 3)))

    def sums(values: Floats) -> Floats:
        return np.asarray(values.reshape(-1, 3).sum(axis=1))

    alpha, by_triangle, by_wheel = angles.ravel().copy(), np.zeros(count), np.zeros(2 * wheels)
    for _ in range(STEPS):
        cot, log = 1 / np.tan(alpha), np.log(np.sin(alpha))
        values = np.concatenate([np.ones(len(corner)), cot[ahead], -cot[behind]])
        jacobian = coo_array((values, (rows, columns)), shape=(2 * wheels, size)).tocsr()
        opening = sums(alpha) - np.pi
        closing = np.concatenate(
            [
                np.bincount(row, alpha[corner], wheels) - 2 * np.pi,
                np.bincount(row, log[ahead] - log[behind], wheels),
            ]
        )
        force = -weight * (alpha - target) - np.repeat(by_triangle, 3) - jacobian.T @ by_wheel
        done = max(np.abs(opening).max(), np.abs(closing).max(), np.abs(force / weight).max())
        if done < 1e-12:
            return alpha.reshape(-1, 3)
        pull = by_wheel[wheels + row]
        bend = np.bincount(behind, pull, size) - np.bincount(ahead, pull, size)
        diagonal = np.maximum(weight + bend / np.sin(alpha) ** 2, 0.25 * weight)
        # Eliminate the angles, then the multipliers of triangles: both blocks are diagonal.
        soft = 1 / diagonal
        pivot, load = sums(soft), sums(soft * force) + opening
        scaled = jacobian.multiply(soft).tocsr()
        coupling = scaled @ of_triangle
        reduced = scaled @ jacobian.T - coupling.multiply(1 / pivot) @ coupling.T
        right = scaled @ force + closing - coupling @ (load / pivot)
        wheel_step = splu(csc_array(reduced)).solve(right)
        triangle_step = (load - coupling.T @ wheel_step) / pivot
        step = soft * (force - np.repeat(triangle_step, 3) - jacobian.T @ wheel_step)
        # No angle moves by more than nine tenths of its distance to 0 or π.
        room = np.where(step < 0, alpha, np.pi - alpha) / np.maximum(np.abs(step), 1e-300)
        fraction = min(1.0, 0.9 * float(room.min()))
        alpha += fraction * step
        by_triangle += fraction * triangle_step
        by_wheel += fraction * wheel_step
    raise SurfaceError(
        f"angle-based flattening did not converge on a chart of {count} triangles (residual "
        f"{done:.1g}). Cut the chart, or use method 'lscm'."
    )


# ---------------------------------------------------------------------------------- distortion


@dataclass(frozen=True, eq=False)
class Distortion:
    """Deformation from the unstressed flat panels of a pattern to its assembled shape."""

    pattern: Pattern

    @cached_property
    def stretches(self) -> Floats:
        """Principal stretches of each triangle, the larger first, shape (t, 2)."""
        return triangle_stretches(self.pattern.corners, self.pattern.points[self.pattern.triangles])

    @cached_property
    def area_ratio(self) -> Floats:
        """Assembled over flat area of each triangle, shape (t,)."""
        return np.asarray(self.stretches.prod(axis=1))

    @cached_property
    def angle_error(self) -> Floats:
        """Largest change of each triangle's angles, shape (t,), in rad."""
        of = self.pattern
        assembled = corner_angles(of.points, of.triangles)
        flat = corner_angles(of.flat_points, of.flat_triangles)
        return np.asarray(np.abs(assembled - flat).max(axis=1))

    @property
    def strain(self) -> Floats:
        """Stretch or compression of each triangle, (t,): largest of λ − 1 and 1/λ − 1."""
        return strains(self.stretches)

    @property
    def worst_stretch(self) -> float:
        """Largest stretch or compression, 0 for an isometric map."""
        return float(self.strain.max())

    @property
    def mean_stretch(self) -> float:
        """Mean stretch or compression of the assembled area."""
        return float(np.average(self.strain, weights=self.area_ratio * self.pattern.areas))

    @property
    def worst_seam(self) -> float:
        """Largest relative difference of length at a seam, 0 if there is none."""
        return float(self.pattern.seam_gaps.max(initial=0.0))

    def table(self) -> str:
        """Return the worst and mean values of each panel and of all, as lines of text."""
        lines = [
            "panel             triangles  area/cm²   stretch        area ratio     angle error",
            "                                       worst   mean    min    max     worst   mean",
        ]
        pattern = self.pattern
        groups = [(name, pattern.panel == k) for k, name in enumerate(pattern.panel_names)]
        for name, cells in [*groups, ("all", np.ones(len(pattern.panel), dtype=bool))]:
            ratio = self.area_ratio[cells]
            weight, strain = ratio * pattern.areas[cells], self.strain[cells]
            angle = np.degrees(self.angle_error[cells])
            lines.append(
                f"{name[:16]:16s}  {cells.sum():9d}  {1e4 * weight.sum():8.2f}"
                f"  {strain.max():6.2%} {np.average(strain, weights=weight):6.2%}"
                f"  {ratio.min():5.3f}  {ratio.max():5.3f}"
                f"  {angle.max():6.2f}°  {np.average(angle, weights=weight):5.2f}°"
            )
        return "\n".join([*lines, f"longest difference at a seam: {self.worst_seam:.2%}"])


def triangle_stretches(flat: Floats, corners: Floats) -> Floats:
    """Return the singular values of F = ∂x/∂x̄, the larger first, (t, 2).

    Flat corners are (t, 3, 2), those in space (t, 3, 3).
    """
    before, after = (np.swapaxes(x[:, 1:] - x[:, :1], 1, 2) for x in (flat, corners))
    return np.linalg.svd(after @ np.linalg.inv(before), compute_uv=False)


def strains(stretches: Floats) -> Floats:
    """Return the largest of λ − 1 and 1/λ − 1, (t,), of stretches with the larger first, (t, 2)."""
    return np.maximum(stretches[:, 0], 1 / stretches[:, 1]) - 1
