"""Surfaces read from STL, OBJ, PLY, MSH, XDMF and the other formats of meshio."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.errors import SurfaceError, UnitError
from toros_fem.base.mpi import collective, on_first_rank
from toros_fem.base.validation import checked_path, real_numbers, require_count, require_positive
from toros_fem.meshes.mesh_file import load, obj_lines
from toros_fem.meshes.repair import remove_thin, weld
from toros_fem.meshes.surface import Repairs, Surface, check_edges, oriented, volume
from toros_fem.meshes.triangles import edge_keys, edges_of, normals, surface_components

FORMATS = "STL, OBJ, PLY, MSH or XDMF"
READ = ("triangle", "quad", "line")
# Largest sides in m of a bounding box beyond which a unit is in doubt.
SMALLEST, LARGEST = 1e-4, 10.0
# Units that files come in, their length in m, and the sizes in them that surfaces have.
UNITS = (("Metres", "1", 5e-3, 5.0), ("Millimetres", "1e-3", 5.0, 1e4))
# Names of the cell data that hold the part of each triangle; the first one found counts.
PARTS = ("gmsh:physical", "gmsh:geometrical", "obj:group_ids", "medit:ref", "cell_tags", "part")


@collective("comm")
def read_surface(
    comm: MPI.Comm, path: Path | str, scale: float = 1.0, component: int | None = None
) -> Surface:
    """Read a surface from a mesh file, repaired and oriented, the same on all ranks (collective).

    Coincident vertices are merged (an STL repeats each one), copies of triangles dropped,
    quadrilaterals split at their shorter diagonal, needles collapsed and caps flipped. Triangles
    are reversed to agree with their neighbours and, if the surface is closed, to face outwards.
    `Surface.repairs` counts the repairs. Vertices are numbered in the order in which the triangles
    use them, so that the format does not matter. Line elements become seams, cell groups become
    parts. Points of two coordinates lie in z = 0.

    Args:
        comm: Communicator; the first rank reads.
        path: STL, OBJ, PLY, MSH, XDMF or another format of meshio.
        scale: Length of the file's unit in m, 1e-3 for mm.
        component: Connected component to read, 0 for the one of largest area. None: the file must
            have a single one.

    Raises:
        ParameterError: scale is not positive, or component not a whole number from 0.
        UnitError: The surface is smaller than 0.1 mm or larger than 10 m.
        SurfaceError: The file cannot be read, has no triangles, several components, or lines that
            are not edges of its triangles.
        ManifoldError, OrientationError, DegenerateTriangleError: As of `Surface`.
    """
    path = checked_path("path", path, SurfaceError)
    require_positive(scale=scale)
    if component is not None:
        require_count(0, component=component)
    return on_first_rank(comm, lambda: _read(path, scale, component))


def _read(path: Path, scale: float, component: int | None) -> Surface:
    mesh = load(path, SurfaceError, FORMATS)
    points = real_numbers(f"points of {path}", mesh.points, "(n, 3)", SurfaceError)
    if not len(points) or not mesh.cells:
        raise SurfaceError(f"{path} holds no triangles. Save the surface, not points or volumes.")
    if points.ndim == 2 and points.shape[1] == 2:
        points = np.pad(points, ((0, 0), (0, 1)))
    if points.ndim != 2 or points.shape[1] != 3:
        raise SurfaceError(f"{path} holds points of shape {points.shape}; a surface needs (n, 3).")
    cells = [(block.type, block.data) for block in mesh.cells if block.type in READ]
    if path.suffix.lower() == ".obj":
        cells.append(("line", obj_lines(path)))
    for kind, corners in cells:
        wrong = corners[(corners < 0) | (corners >= len(points))]
        if len(wrong):
            raise SurfaceError(
                f"{path} has a {kind} at vertex {wrong[0]}, but its vertices are 0 … "
                f"{len(points) - 1}. Export it again; an OBJ's faces need positive numbers."
            )
    triangles, tags = _triangles(path, mesh, points)
    lines = [corners for kind, corners in cells if kind == "line"]
    seams = np.concatenate([*lines, np.zeros((0, 2), dtype=np.int64)]).astype(np.int64)
    # Lines may have their own vertices, at the places of the triangles' vertices.
    used = np.union1d(triangles, seams)
    if not np.all(np.isfinite(points[used])):
        raise SurfaceError(f"{path} holds coordinates that are not finite. Export it again.")
    points = _in_metres(path, points, used, scale)

    replaced_by, kept = weld(points[used], np.searchsorted(used, triangles))
    merged = len(used) - len(np.unique(replaced_by))
    place = np.arange(len(points))
    place[used] = used[replaced_by]
    seams, dropped = place[seams], len(triangles) - len(kept)
    triangles, tags = place[triangles[kept]], tags[kept]
    if len(triangles) == 0:
        raise SurfaceError(f"all triangles of {path} have no area. Is `scale` = {scale:g} right?")

    seams = seams[seams[:, 0] != seams[:, 1]]
    _check_seams(path, points, triangles, seams)
    chosen = _component(path, points, triangles, component)
    triangles, tags = triangles[chosen], tags[chosen]
    check_edges(points, triangles)
    read, triangles = triangles, _outwards(points, triangles)
    turned = int(np.any(read != triangles, axis=1).sum())
    parts, names = _parts(mesh, tags)
    points, triangles, parts, replaced_by, repairs = remove_thin(points, triangles, parts, seams)
    points, triangles, seams = _renumbered(points, triangles, replaced_by[seams])
    return Surface(
        points=points,
        triangles=triangles,
        parts=parts,
        part_names=names,
        seams=seams,
        repairs=repairs + Repairs(merged=merged, dropped=dropped, turned=turned),
    )


def _in_metres(path: Path, points: Floats, used: Ints, scale: float) -> Floats:
    """Return the points in m.

    Raises:
        UnitError: The surface would be too large or too small for a skin.
    """
    low, high = points[used].min(axis=0), points[used].max(axis=0)
    with np.errstate(over="ignore", invalid="ignore"):
        size = float(np.max((high - low) * scale))
    if not SMALLEST <= size <= LARGEST:
        raise UnitError(
            f"{path} is {size:.3g} m across with scale = {scale:g}; surfaces are {SMALLEST:g} m to "
            f"{LARGEST:g} m. {unit_hint(float(np.max(high - low)))}"
        )
    return points * scale


def unit_hint(size: float) -> str:
    """Return the advice on the unit of a file whose surface has this size in it."""
    for unit, scale, least, most in UNITS:
        if least <= size < most:
            return f"{unit}? Give scale = {scale}."
    return "Is `scale`, the length of the file's unit in m, right?"


def _triangles(path: Path, mesh: Any, points: Floats) -> tuple[Ints, Ints]:
    """Return the triangles (t, 3) of a mesh, with quadrilaterals split, and the tag of each."""
    name = next((n for n in PARTS if n in mesh.cell_data and _tags(mesh, n)), None)
    found, tags, other = [], [], []
    for number, block in enumerate(mesh.cells):
        tag = mesh.cell_data[name][number] if name else np.zeros(len(block.data))
        tag = np.asarray(tag).ravel().astype(np.int64)
        if block.type == "triangle":
            found.append(block.data)
            tags.append(tag)
        elif block.type == "quad":
            a, b, c, d = (points[block.data[:, k]] for k in range(4))
            ac = np.linalg.norm(a - c, axis=1) <= np.linalg.norm(b - d, axis=1)
            halves = np.where(ac[:, None], block.data[:, [0, 1, 2, 0, 2, 3]],
                              block.data[:, [0, 1, 3, 1, 2, 3]])  # fmt: skip
            found.append(halves.reshape(-1, 3))
            tags.append(np.repeat(tag, 2))
        elif block.type not in ("vertex", "line", "tetra", "hexahedron", "wedge", "pyramid"):
            other.append(f"{len(block.data)} of type {block.type}")
    if other:
        raise SurfaceError(
            f"{path} holds faces that are neither triangles nor quadrilaterals: "
            f"{', '.join(other)}. Triangulate it, with straight edges, before saving."
        )
    if not found or not sum(len(block) for block in found):
        raise SurfaceError(f"{path} holds no triangles. Save the surface, not points or volumes.")
    return np.concatenate(found).astype(np.int64), np.concatenate(tags)


def _tags(mesh: Any, name: str) -> bool:
    values = [np.asarray(v).ravel() for v in mesh.cell_data[name]]
    return len(values) > 0 and bool(np.any(np.concatenate(values) != 0))


def _parts(mesh: Any, tags: Ints) -> tuple[Ints, tuple[str, ...]]:
    """Return the part of each triangle, numbered from 0, and the names of the parts."""
    known, parts = np.unique(tags, return_inverse=True)
    named = {int(tag): name for name, (tag, dim) in mesh.field_data.items() if dim == 2}
    return parts.ravel(), tuple(named.get(int(tag), f"part-{tag}") for tag in known)


def _check_seams(path: Path, points: Floats, triangles: Ints, seams: Ints) -> None:
    size = len(points)
    wrong = ~np.isin(edge_keys(seams, size), edge_keys(edges_of(triangles).ends, size))
    if wrong.any():
        a, b = points[seams[np.argmax(wrong)]]
        raise SurfaceError(
            f"{wrong.sum()} lines of {path} are no edges of its triangles, the first from {a} to "
            f"{b} m. Draw seams along the mesh, edge by edge, and delete all other lines."
        )


def _component(path: Path, points: Floats, triangles: Ints, component: int | None) -> Ints:
    """Return the triangles of one connected component."""
    label = surface_components(triangles)
    area = np.bincount(label, np.linalg.norm(normals(points, triangles), axis=1) / 2)
    order = np.argsort(-area, kind="stable")
    if component is None and len(area) > 1:
        shown = ", ".join(f"{area[k]:.3g}" for k in order[:5])
        raise SurfaceError(
            f"{path} holds {len(area)} components, of {shown}{', …' if len(area) > 5 else ''} m². "
            "Choose one by `component` (0 is the largest), or connect them before saving."
        )
    if component is not None and component >= len(area):
        raise SurfaceError(f"component = {component}, but {path} holds {len(area)}, from 0 on.")
    return np.flatnonzero(label == order[component or 0])


def _outwards(points: Floats, triangles: Ints) -> Ints:
    """Orient triangles: closed surfaces outwards, open ones as most of their area is."""
    agreed = oriented(triangles)
    if len(edges_of(agreed).border) == 0:
        inwards = volume(points, agreed) < 0
    else:
        area = np.linalg.norm(normals(points, triangles), axis=1)
        turned = np.any(agreed != triangles, axis=1)
        inwards = area[turned].sum() > area[~turned].sum()
    return agreed[:, ::-1] if inwards else agreed


def _renumbered(points: Floats, triangles: Ints, seams: Ints) -> tuple[Floats, Ints, Ints]:
    """Number vertices in the order of their first use; keep the seams that are still edges.

    The other seams were on another component, or collapsed in a repair.
    """
    used, first, inverse = np.unique(triangles, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    number = np.full(len(points), -1, dtype=np.int64)
    number[used] = rank
    seams = number[seams]
    seams = np.unique(np.sort(seams[(seams >= 0).all(axis=1)], axis=1), axis=0)
    triangles = rank[inverse.ravel()].reshape(-1, 3)
    size = len(used)
    real = np.isin(edge_keys(seams, size), edge_keys(edges_of(triangles).ends, size))
    return points[used[np.argsort(first)]], triangles, seams[real]
