"""Parts of symmetric surfaces, cut at coordinate planes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array, eye_array

from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.errors import SurfaceError
from toros_fem.meshes.mirror import flip, longest_chain, plane_border
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.surfaces.nearest import nearest
from toros_fem.meshes.surfaces.surface import Surface
from toros_fem.meshes.triangles import edges_of, half_edges, lengths

# Largest distance between a symmetric surface and its mirror image over the mean edge length: two
# meshes of one round surface are apart by the sagitta of their edges.
SYMMETRIC = 0.1
# Part of an edge from its end within which a plane crosses it at this end.
NEAR = 0.25
# A vertex this close to a plane, over the surface's size, lies in it.
FLAT = 1e-6
# Largest distance of a cut border from a line, over its length, that is straightened.
STRAIGHT = 0.02


def cut_at_planes(
    surface: Surface, axes: Sequence[int], near: float = NEAR
) -> tuple[Surface, csr_array]:
    """Cut a symmetric surface at coordinate planes x, y or z = 0, given by their axes.

    Triangles that a plane crosses are divided, so that the mesh need not be symmetric. A vertex
    near a crossing, a part `near` of an edge, moves into the plane. `require_symmetric` checks the
    surface before. A part that lies on one side of a plane already is taken as it is. The matrix,
    (m, n), interpolates values at the whole's vertices to those of the part.
    """
    part, weights = surface, csr_array(eye_array(len(surface.points)))
    for axis in axes:
        part, own = _cut(part, axis, FLAT * surface.size, near)
        weights = own @ weights
    return part, weights


def straightened(pattern: Pattern, axes: Sequence[int]) -> Pattern:
    """Return a part's flat panels with straight borders where `mirrored` continues them.

    There a panel is reflected in the line of its longest cut. On a smooth surface the cut is a
    geodesic, and bends by no more than the panel is distorted. A border that is more crooked stays:
    the panel and its image are then sewn together there.
    """
    flat = pattern.flat_points.copy()
    for axis in axes:
        border = np.sort(plane_border(pattern, axis))
        edges, panel = half_edges(pattern.flat_triangles)[border], pattern.panel[border // 3]
        for number in np.unique(panel):
            chain = longest_chain(flat, edges[panel == number])
            vertices, count = np.unique(chain, return_counts=True)
            if np.count_nonzero(count == 1) != 2:
                continue  # a loop
            begin, end = flat[vertices[count == 1]]
            length = np.linalg.norm(end - begin)
            arm = flat[vertices] - begin
            on_line = np.outer(arm @ (end - begin), end - begin) / length**2
            if np.linalg.norm(arm - on_line, axis=1).max() <= STRAIGHT * length:
                flat[vertices] = begin + on_line
    return replace(pattern, flat_points=flat)


def asymmetry(surface: Surface, axis: int) -> float:
    """Return the largest distance in m of a mirrored vertex from the surface."""
    image = surface.points * flip(axis)
    return float(nearest(image, surface.points, surface.triangles).distance.max())


def require_symmetric(surface: Surface, axis: int, what: str = "the surface") -> None:
    """Check that a surface is its own mirror image in the plane x, y or z = 0, or half of one."""
    if surface.points[:, axis].min() >= -FLAT * surface.size and not surface.closed:
        return
    edge = float(lengths(surface.points, edges_of(surface.triangles).ends).mean())
    off = asymmetry(surface, axis)
    if off > SYMMETRIC * edge:
        name = "xyz"[axis]
        raise SurfaceError(
            f"{what} is not symmetric about {name} = 0: a mirrored vertex is {off:.3g} m away "
            f"from it; the bound is {SYMMETRIC:g} of the mean edge length, {SYMMETRIC * edge:.3g} "
            f"m. Move the mesh so that {name} = 0 is its middle, or leave this plane out."
        )


def _cut(surface: Surface, axis: int, flat: float, near: float) -> tuple[Surface, csr_array]:
    """Cut at one plane."""
    points, triangles, count = surface.points, surface.triangles, len(surface.points)
    away = np.where(np.abs(points[:, axis]) <= flat, 0.0, points[:, axis])
    # A vertex near a crossing moves into the plane, and has the values of the nearest crossing.
    ends, part = _crossings(triangles, away)
    to, fraction = np.arange(count), np.zeros(count)
    order = np.argsort(-np.minimum(part, 1 - part), kind="stable")
    for (a, b), at in zip(ends[order], part[order], strict=True):
        if min(at, 1 - at) < near:
            mover, other = (a, b) if at < near else (b, a)
            to[mover], fraction[mover], away[mover] = other, min(at, 1 - at), 0.0
    # Other crossings become vertices.
    ends, part = _crossings(triangles, away)
    number = {(int(a), int(b)): count + k for k, (a, b) in enumerate(ends)}
    one, two = np.append(np.arange(count), ends[:, 0]), np.append(to, ends[:, 1])
    share = np.append(fraction, part)
    weights = csr_array(
        (np.append(1 - share, share), (np.tile(np.arange(len(one)), 2), np.append(one, two))),
        shape=(len(one), count),
    )
    placed = np.concatenate([points, (weights @ points)[count:]])
    placed[np.append(away == 0, np.ones(len(ends), dtype=bool)), axis] = 0.0
    sides = away[triangles]
    kept = np.flatnonzero((sides >= 0).all(axis=1) & (sides > 0).any(axis=1))
    cells, corners = list(kept), list(triangles[kept])
    for cell in np.flatnonzero((sides.min(axis=1) < 0) & (sides.max(axis=1) > 0)):
        pieces = _pieces(triangles[cell], away, number, placed)
        cells += [cell] * len(pieces)
        corners += pieces
    used, made = np.unique(np.array(corners), return_inverse=True)
    seams = [
        pair
        if away[pair].min() >= 0
        else (pair[np.argmax(away[pair])], number[tuple(sorted(pair))])
        for pair in surface.seams
        if away[pair].max() > 0
    ]
    names, parts = np.unique(surface.parts[cells], return_inverse=True)
    half = Surface(
        placed[used],
        made.reshape(-1, 3),
        parts,
        tuple(surface.part_names[k] for k in names),
        np.searchsorted(used, np.array(seams, dtype=np.int64).reshape(-1, 2)),
        surface.repairs,
    )
    return half, weights[used]


def _crossings(triangles: Ints, away: Floats) -> tuple[Ints, Floats]:
    """Return the edges that a plane crosses, (k, 2), and where, as parts of their lengths, (k,)."""
    ends = edges_of(triangles).ends
    ends = ends[away[ends].prod(axis=1) < 0]
    return ends, away[ends[:, 0]] / (away[ends[:, 0]] - away[ends[:, 1]])


def _pieces(
    triangle: Ints, away: Floats, number: Mapping[tuple[int, int], int], points: Floats
) -> list[Ints]:
    """Return the one or two triangles on the far side of a plane that a triangle is cut at."""
    found: list[int] = []
    for a, b in zip(triangle, np.roll(triangle, -1), strict=True):
        found += [a] if away[a] >= 0 else []
        found += [number[min(a, b), max(a, b)]] if away[a] * away[b] < 0 else []
    if len(found) == 3:
        return [np.array(found)]
    a, b, c, d = found
    if np.linalg.norm(points[a] - points[c]) < np.linalg.norm(points[b] - points[d]):
        return [np.array([a, b, c]), np.array([a, c, d])]
    return [np.array([a, b, d]), np.array([b, c, d])]
