"""A surface meshed anew with triangles of one size, where those of its file do not serve."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from scipy.sparse import csr_array

from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.errors import SurfaceError, TorosError
from toros_fem.base.mpi import on_root
from toros_fem.base.validation import require_kind, require_positive
from toros_fem.meshes.gmsh_model import gmsh_model, meshed
from toros_fem.meshes.surfaces.cut import euler
from toros_fem.meshes.surfaces.nearest import Nearest, nearest
from toros_fem.meshes.surfaces.surface import Surface, oriented
from toros_fem.meshes.triangles import (
    angle_defects,
    between,
    corner_angles,
    dihedral_angles,
    edges_of,
    normals,
    require_affordable,
)

# Largest distance between the two surfaces over the edge length: triangles across a ridge that is
# just no crease are 0.2 to 0.3 away from it.
FAR = 0.35
# Angle in rad that is missing around a vertex, from which on the surface has a tip there.
TIP = 0.25
# Distance from a kept curve, over the edge length, within which a tip is of the curve.
ALONG = 0.25
# Largest angle in rad between triangles side by side, unless the surface has a larger one: beyond
# it some face inwards.
FOLDED = np.radians(120)
# How much sharper than the surface's own such a fold may be, in rad.
SHARPER = np.radians(10)
# Part of the size within which a place is on a line.
EXACT = 1e-6
# Lengths of edges are those asked for, whatever the given vertices or a curvature would ask for.
OPTIONS = {
    "Mesh.MeshSizeExtendFromBoundary": 0, "Mesh.MeshSizeFromPoints": 0,
    "Mesh.MeshSizeFromCurvature": 0,
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Remeshed:
    """A surface that was meshed anew.

    Attributes:
        surface: The surface; its `repairs` tell what was done.
        weights: Matrix, (m, n), that interpolates values at the given vertices to the new ones.
        distance: Largest distance in m found between the two surfaces, at the given vertices, and
            at the middles of new edges and triangles.
    """

    surface: Surface
    weights: csr_array
    distance: float


@on_root
def remeshed(
    comm: MPI.Comm,
    surface: Surface,
    edge_length: float,
    *,
    crease_angle: float = np.radians(45),
) -> Remeshed:
    """Mesh a surface anew, with edges of a length in m, by gmsh (collective).

    Vertices lie on the given triangles. Borders, seams, borders between parts and creases become
    edges of the new mesh.

    Args:
        surface: The surface, the same on all ranks.
        edge_length: Edge length in m.
        crease_angle: Angle between normals above which an edge is a crease, in rad.

    Raises:
        ParameterError: An argument is out of its bounds, or the mesh has too many triangles.
        SurfaceError: gmsh fails, or the mesh is another surface: further away than a third of an
            edge, or folded back onto itself, for instance.
    """
    require_kind("surface", surface, Surface, "a Surface, by read_surface")
    require_positive(edge_length=edge_length)
    require_positive(**{"crease_angle, in rad,": crease_angle}, at_most=np.pi)
    require_affordable(surface.area, edge_length)
    places, triangles, on_curves = _by_gmsh(surface, edge_length, crease_angle)
    at = nearest(places, surface.points, surface.triangles)
    _keep_tips(surface, at, places, on_curves, edge_length)
    weights = at.weights(surface.triangles, len(surface.points))
    points = weights @ surface.points  # exactly in a plane that borders lie in
    middle = nearest(points[triangles].mean(axis=1), surface.points, surface.triangles)
    triangles, parts = _oriented(surface, points, triangles, middle), surface.parts[middle.triangle]
    ends = edges_of(triangles).ends
    distance = _largest_distance(surface, points, triangles, ends, middle)
    if distance > FAR * edge_length:
        raise _refusal(
            surface, edge_length, f"it would be up to {distance:.3g} m away from the surface; "
            f"the bound is {FAR:g} of an edge",
        )  # fmt: skip
    told = (
        f"{len(surface.triangles)} triangles meshed anew by {len(triangles)}, "
        f"{1e3 * distance:.2g} mm apart at most"
    )
    try:
        made = Surface(
            points, triangles, parts, surface.part_names,
            _seams(surface, points, on_curves, FAR * edge_length),
            told if surface.repairs == "none" else f"{surface.repairs}, {told}",
        )  # fmt: skip
    except TorosError as error:
        why = f"it would be no surface: {str(error).removesuffix('.')}"
        raise _refusal(surface, edge_length, why) from error
    other = made.closed != surface.closed or euler(triangles) != euler(surface.triangles)
    before = dihedral_angles(surface.points, surface.triangles, edges_of(surface.triangles)).max()
    after = dihedral_angles(points, triangles, edges_of(triangles)).max()
    bound = max(FOLDED, before + SHARPER)
    if other or after > bound:
        folded = f"{np.degrees(after):.0f} degrees; the bound is {np.degrees(bound):.0f}"
        why = "have other holes or handles" if other else f"be folded by {folded}"
        raise _refusal(surface, edge_length, f"it would {why}")
    return Remeshed(made, weights, distance)


def _refusal(surface: Surface, edge_length: float, why: str) -> SurfaceError:
    return SurfaceError(
        f"the surface of {len(surface.triangles)} triangles cannot be meshed anew with edges of "
        f"{edge_length:.3g} m: {why}. Take shorter edges or a smaller crease_angle, "
        "or remesh the file in another program."
    )


def _by_gmsh(
    surface: Surface, edge_length: float, crease_angle: float
) -> tuple[Floats, Ints, Ints]:
    """Return new points, (m, 3), triangles, and the edges on curves that were kept, (k, 2)."""
    edges = edges_of(surface.triangles)
    named = np.concatenate([surface.seams, edges.ends[between(edges, surface.parts)]])
    with gmsh_model(edge_length, OPTIONS) as gmsh:
        mesh = gmsh.model.mesh
        gmsh.model.addDiscreteEntity(2, 1)
        mesh.addNodes(2, 1, np.arange(1, 1 + len(surface.points)), surface.points.ravel())
        mesh.addElementsByType(1, 2, [], (1 + surface.triangles).ravel())
        if len(named):
            gmsh.model.addDiscreteEntity(1, 1)
            mesh.addElementsByType(1, 1, [], (1 + named).ravel())
        try:
            mesh.classifySurfaces(crease_angle, True, True, crease_angle)
            mesh.createGeometry()
            return meshed(gmsh)
        except Exception as error:  # gmsh raises no other type
            raise _refusal(surface, edge_length, f"gmsh fails ({error})") from error


def _keep_tips(
    surface: Surface, at: Nearest, places: Floats, on_curves: Ints, edge_length: float
) -> None:
    """Move the nearest new vertex into each tip of the surface, unless a curve goes along there."""
    points, edges = surface.points, edges_of(surface.triangles)
    angles = corner_angles(points, surface.triangles)
    defects = np.abs(angle_defects(surface.triangles, edges, angles))
    tips = np.argsort(-defects, kind="stable")[: np.count_nonzero(defects > TIP)]
    free = np.ones(len(places), dtype=bool)
    free[on_curves] = False
    first = surface.triangles.ravel().tolist().index
    for tip in tips[_from_lines(points[tips], places[on_curves]) > ALONG * edge_length]:
        away = np.where(free, np.linalg.norm(places - points[tip], axis=1), np.inf)
        mover = int(away.argmin())
        if away[mover] < edge_length:
            at.triangle[mover], corner = divmod(first(tip), 3)
            at.shares[mover], free[mover] = np.eye(3)[corner], False


def _oriented(surface: Surface, points: Floats, triangles: Ints, middle: Nearest) -> Ints:
    """Return triangles oriented as the given ones are."""
    try:
        agreed = oriented(triangles)
    except TorosError:
        return triangles  # refused as a surface
    given = normals(surface.points, surface.triangles)[middle.triangle]
    alike = np.einsum("ti,ti->t", normals(points, agreed), given)
    return agreed if alike.sum() > 0 else agreed[:, ::-1]


def _largest_distance(
    surface: Surface, points: Floats, triangles: Ints, ends: Ints, middle: Nearest
) -> float:
    used = surface.points[np.unique(surface.triangles)]
    there = nearest(used, points, triangles)
    sides = nearest(points[ends].mean(axis=1), surface.points, surface.triangles)
    return max(float(one.distance.max()) for one in (there, sides, middle))


def _seams(surface: Surface, points: Floats, on_curves: Ints, near: float) -> Ints:
    """Return the edges, of those on curves, that follow the surface's own seams, (k, 2)."""
    seams, both = surface.points[surface.seams], points[on_curves]
    ends = np.maximum(_from_lines(both[:, 0], seams), _from_lines(both[:, 1], seams))
    middle = _from_lines(both.mean(axis=1), seams)
    return on_curves[(ends < EXACT * surface.size) & (middle < near)]


def _from_lines(places: Floats, lines: Floats) -> Floats:
    """Return the distance of places (p, 3) from the nearest of straight lines (k, 2, 3), (p,)."""
    if not len(lines):
        return np.full(len(places), np.inf)
    begin, along = lines[:, 0], lines[:, 1] - lines[:, 0]
    way = np.einsum("pki,ki->pk", places[:, None] - begin, along) / (along**2).sum(axis=1)
    feet = begin + np.clip(way, 0, 1)[..., None] * along
    return np.asarray(np.linalg.norm(places[:, None] - feet, axis=2).min(axis=1))
