"""Mesh files: surfaces in STL, OBJ, PLY, MSH, XDMF …, and target shapes made in other programs."""

from __future__ import annotations

import contextlib
import ctypes
import io
import itertools
import threading
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import meshio
import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree

from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.errors import SurfaceError, TargetError, TorosError, UnitError
from toros_fem.base.files import MOST_BYTES
from toros_fem.base.mpi import on_root
from toros_fem.base.validation import (
    checked_path,
    real_numbers,
    require_count,
    require_kind,
    require_positive,
)
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.surfaces.repair import DROPPED, KINDS, MERGED, REVERSED, remove_thin, weld
from toros_fem.meshes.surfaces.surface import Surface, oriented, volume
from toros_fem.meshes.triangles import (
    edge_keys,
    edges_of,
    require_two_at_edges,
    surface_areas,
    surface_components,
)

FORMATS, DEFORMED_FORMATS = "STL, OBJ, PLY, MSH or XDMF", "OBJ, PLY or VTU"
# Some of meshio's readers look for the next line of a file that has ended, and never return. These
# times in s are far beyond those of good files.
SECONDS, SECONDS_PER_MEGABYTE = 5.0, 60.0
# Characters of the longest message of meshio that is passed on.
LONGEST = 160
# Largest sides in m of a bounding box beyond which a unit is in doubt.
SMALLEST, LARGEST = 1e-4, 10.0
# Units that files come in, their length in m, and the sizes in them that surfaces have.
UNITS = (("Metres", "1", 5e-3, 5.0), ("Millimetres", "1e-3", 5.0, 1e4))
# Names of the cell data that hold the part of each triangle; the first one found counts.
PARTS = ("gmsh:physical", "gmsh:geometrical", "obj:group_ids", "medit:ref", "cell_tags", "part")
# Corners that are apart by this fraction of the skin's size are different vertices.
APART = 1e-5


def load(path: Path, failure: type[TorosError], formats: str) -> Any:
    """Read a mesh file by meshio; where this fails, an error suggests formats, "OBJ or PLY".

    Where meshio cannot read a file, it prints, and may call `sys.exit`: both become an error.
    """
    if not path.is_file():
        raise failure(f"there is no file {path}.")
    if path.stat().st_size > MOST_BYTES["mesh"]:
        raise failure(f"{path} is longer than {MOST_BYTES['mesh']} bytes. Save a coarser mesh.")
    printed = io.StringIO()
    try:
        with (
            interrupted_after(SECONDS + SECONDS_PER_MEGABYTE * path.stat().st_size / 1e6),
            contextlib.redirect_stdout(printed),
            contextlib.redirect_stderr(printed),
            np.errstate(over="ignore"),
        ):
            return meshio.read(path)
    except ImportError as error:
        raise failure(
            f"{path} cannot be read as a mesh, since meshio lacks a package for its format "
            f"({error}). Save it as {formats}, or install that package."
        ) from error
    except TimeoutError:
        raise failure(
            f"{path} cannot be read as a mesh in a reasonable time: it ends too early, or its "
            f"counts are wrong. Save it again, as {formats}."
        ) from None
    except (Exception, SystemExit) as error:
        why = " ".join((printed.getvalue().strip() or f"{type(error).__name__}: {error}").split())
        why = why if len(why) <= LONGEST else f"{why[:LONGEST]} …"
        raise failure(f"{path} cannot be read as a mesh ({why}). Save it as {formats}.") from error


@contextlib.contextmanager
def interrupted_after(seconds: float) -> Iterator[None]:
    """Raise TimeoutError in a block that takes longer, unless it is in a call of compiled code."""
    lock, running, thread = threading.Lock(), [True], ctypes.c_ulong(threading.get_ident())

    def interrupt() -> None:
        with lock:
            if running:
                error = ctypes.py_object(TimeoutError)
                ctypes.pythonapi.PyThreadState_SetAsyncExc(thread, error)

    watch = threading.Timer(seconds, interrupt)
    watch.daemon = True
    watch.start()
    try:
        yield
    finally:
        with lock:
            running.clear()
        watch.cancel()


def obj_lines(path: Path) -> Ints:
    """Read the ends of the line elements of an OBJ file, (k, 2), which meshio ignores."""
    ends: list[tuple[int, int]] = []
    vertices = 0
    with path.open(encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, 1):
            word = line.split()
            vertices += word[:1] == ["v"]
            if word[:1] != ["l"]:
                continue
            try:
                chain = [int(item.split("/")[0]) for item in word[1:]]
            except ValueError as error:
                raise SurfaceError(
                    f"line {number} of {path}, {line.strip()!r}, does not give vertices as "
                    "numbers. Export it again, or delete the line."
                ) from error
            # Negative numbers count back from the last vertex so far.
            ends += itertools.pairwise(k - 1 if k >= 0 else vertices + k for k in chain)
    return np.array(ends, dtype=np.int64).reshape(-1, 2)


def cells(mesh: Any, kind: str, corners: int) -> Ints:
    """Return all cells of a kind, such as "line", (k, corners)."""
    blocks = [block.data for block in mesh.cells if block.type == kind]
    return np.concatenate([*blocks, np.zeros((0, corners), dtype=np.int64)]).astype(np.int64)


# ------------------------------------------------------------------------------------ surfaces


@on_root
def read_surface(
    comm: MPI.Comm, path: Path | str, scale: float = 1.0, component: int | None = None
) -> Surface:
    """Read a surface from a mesh file, repaired and oriented, the same on all ranks (collective).

    Coincident vertices are merged (an STL repeats each one), copies of triangles dropped,
    quadrilaterals split at their shorter diagonal, needles collapsed and caps flipped. Triangles
    are reversed to agree with their neighbours and, if the surface is closed, to face outwards.
    `Surface.repairs` tells the repairs. Vertices are numbered in the order in which the triangles
    use them, so that the format does not matter. Line elements become seams, cell groups become
    parts. Points of two coordinates lie in z = 0.

    Args:
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
    points, triangles, tags, seams, names = _raw(path)
    with np.errstate(over="ignore", invalid="ignore"):
        size = float(np.ptp(points, axis=0).max())
    if not SMALLEST <= size * scale <= LARGEST:
        raise UnitError(
            f"{path} is {size * scale:.3g} m across with scale = {scale:g}; surfaces are "
            f"{SMALLEST:g} m to {LARGEST:g} m. {unit_hint(size)}"
        )
    points = points * scale

    replaced_by, kept = weld(points, triangles)
    merged, dropped = len(points) - len(np.unique(replaced_by)), len(triangles) - len(kept)
    seams, triangles, tags = replaced_by[seams], replaced_by[triangles[kept]], tags[kept]
    if len(triangles) == 0:
        raise SurfaceError(f"all triangles of {path} have no area. Is `scale` = {scale:g} right?")
    seams = seams[seams[:, 0] != seams[:, 1]]
    wrong = ~_are_edges(seams, triangles)
    if wrong.any():
        a, b = points[seams[np.argmax(wrong)]]
        raise SurfaceError(
            f"{wrong.sum()} lines of {path} are no edges of its triangles, the first from {a} to "
            f"{b} m. Draw seams along the mesh, edge by edge, and delete all other lines."
        )

    chosen = _component(path, points, triangles, component)
    triangles, tags = triangles[chosen], tags[chosen]
    require_two_at_edges(points, edges_of(triangles))
    read, triangles = triangles, _outwards(points, triangles)
    known, parts = np.unique(tags, return_inverse=True)
    repairs = Counter({MERGED: merged, DROPPED: dropped})
    repairs[REVERSED] = int(np.any(read != triangles, axis=1).sum())
    points, triangles, parts, replaced_by, thin = remove_thin(points, triangles, parts, seams)
    points, triangles, seams = _renumbered(points, triangles, replaced_by[seams])
    done = repairs + thin
    return Surface(
        points=points,
        triangles=triangles,
        parts=parts,
        part_names=tuple(names.get(int(tag), f"part-{tag}") for tag in known),
        seams=seams,
        repairs=", ".join(f"{done[kind]} {kind}" for kind in KINDS if done[kind]) or "none",
    )


def unit_hint(size: float) -> str:
    """Return the advice on the unit of a file whose surface has this size in it."""
    for unit, scale, least, most in UNITS:
        if least <= size < most:
            return f"{unit}? Give scale = {scale}."
    return "Is `scale`, the length of the file's unit in m, right?"


def _raw(path: Path) -> tuple[Floats, Ints, Ints, Ints, dict[int, str]]:
    """Return points (n, 3), triangles, their tags, lines, and names of tags, as a file has them.

    Lines may have their own vertices, at the places of the triangles' vertices.
    """
    mesh = load(path, SurfaceError, FORMATS)
    points = real_numbers(f"points of {path}", mesh.points, "(n, 3)", SurfaceError)
    if not len(points) or not mesh.cells:
        raise SurfaceError(f"{path} holds no triangles. Save the surface, not points or volumes.")
    if points.ndim == 2 and points.shape[1] == 2:
        points = np.pad(points, ((0, 0), (0, 1)))
    if points.ndim != 2 or points.shape[1] != 3:
        raise SurfaceError(f"{path} holds points of shape {points.shape}; a surface needs (n, 3).")
    lines = cells(mesh, "line", 2)
    if path.suffix.lower() == ".obj":
        lines = np.concatenate([lines, obj_lines(path)])
    for kind, corners in (
        ("triangle", cells(mesh, "triangle", 3)), ("quad", cells(mesh, "quad", 4)), ("line", lines)
    ):  # fmt: skip
        wrong = corners[(corners < 0) | (corners >= len(points))]
        if len(wrong):
            raise SurfaceError(
                f"{path} has a {kind} at vertex {wrong[0]}, but its vertices are 0 … "
                f"{len(points) - 1}. Export it again; an OBJ's faces need positive numbers."
            )
    triangles, tags = _triangles(path, mesh, points)
    names = {int(tag): name for name, (tag, dim) in mesh.field_data.items() if dim == 2}
    used, number = np.unique(np.append(triangles, lines), return_inverse=True)
    if not np.all(np.isfinite(points[used])):
        raise SurfaceError(f"{path} holds coordinates that are not finite. Export it again.")
    corners, ends = np.split(number.ravel(), [triangles.size])
    return points[used], corners.reshape(-1, 3), tags, ends.reshape(-1, 2), names


def _triangles(path: Path, mesh: Any, points: Floats) -> tuple[Ints, Ints]:
    """Return the triangles (t, 3) of a mesh, with quadrilaterals split, and the tag of each."""
    data = next((mesh.cell_data[name] for name in PARTS if _tagged(mesh, name)), None)
    found: list[np.ndarray] = [np.zeros((0, 3))]
    tags: list[np.ndarray] = [np.zeros(0)]
    other = []
    for number, block in enumerate(mesh.cells):
        tag = np.zeros(len(block.data)) if data is None else np.asarray(data[number]).ravel()
        if block.type == "triangle":
            found.append(block.data)
            tags.append(tag)
        elif block.type == "quad":
            a, b, c, d = np.moveaxis(points[block.data], 1, 0)
            ac = np.linalg.norm(a - c, axis=1) <= np.linalg.norm(b - d, axis=1)
            one, two = block.data[:, [0, 1, 2, 0, 2, 3]], block.data[:, [0, 1, 3, 1, 2, 3]]
            found.append(np.where(ac[:, None], one, two).reshape(-1, 3))
            tags.append(np.repeat(tag, 2))
        elif block.type not in ("vertex", "line", "tetra", "hexahedron", "wedge", "pyramid"):
            other.append(f"{len(block.data)} of type {block.type}")
    if other:
        raise SurfaceError(
            f"{path} holds faces that are neither triangles nor quadrilaterals: "
            f"{', '.join(other)}. Triangulate it, with straight edges, before saving."
        )
    triangles = np.concatenate(found).astype(np.int64)
    if not len(triangles):
        raise SurfaceError(f"{path} holds no triangles. Save the surface, not points or volumes.")
    return triangles, np.concatenate(tags).astype(np.int64)


def _tagged(mesh: Any, name: str) -> bool:
    """Return whether a mesh has cell data of this name that are not all 0."""
    return any(np.any(np.asarray(values) != 0) for values in mesh.cell_data.get(name, ()))


def _are_edges(ends: Ints, triangles: Ints) -> np.ndarray:
    """Return whether pairs of vertices, (k, 2), are edges of triangles, (k,)."""
    size = int(max(triangles.max(), ends.max(initial=0))) + 1
    return np.isin(edge_keys(ends, size), edge_keys(edges_of(triangles).ends, size))


def _component(path: Path, points: Floats, triangles: Ints, component: int | None) -> Ints:
    """Return the triangles of one connected component."""
    label = surface_components(triangles)
    area = np.bincount(label, surface_areas(points, triangles))
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
        area, turned = surface_areas(points, triangles), np.any(agreed != triangles, axis=1)
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
    return points[used[np.argsort(first)]], triangles, seams[_are_edges(seams, triangles)]


# ------------------------------------------------------------------------------------- targets


@on_root
def from_mesh(comm: MPI.Comm, path: Path, pattern: Pattern) -> Floats:
    """Read target positions from a deformed copy of the assembled skin, (n, 3) in m (collective).

    `meshio.write_points_cells(path, pattern.points, [("triangle", pattern.triangles)])` writes the
    skin to be deformed. Vertices are matched by their order, which the program must keep; triangles
    may be in any order. OBJ, PLY and VTU files keep it; STL files do not.

    Raises:
        TargetError: The file cannot be read, has a position that is not finite, or its mesh is
            not the pattern's.
    """
    path = checked_path("path", path, TargetError)
    require_kind("pattern", pattern, Pattern, "a Pattern")
    points, theirs = _mesh_in_space(path, DEFORMED_FORMATS)
    if len(points) != len(pattern.points):
        raise TargetError(
            f"{path} has {len(points)} vertices; the skin has {len(pattern.points)}. Deform the "
            "skin itself, and keep the order of its vertices."
        )
    if len(theirs) != len(pattern.panel):
        raise TargetError(
            f"{path} has {len(theirs)} triangles; the skin has {len(pattern.panel)}. Deform the "
            "skin itself, and do not remesh it."
        )
    both = np.concatenate([pattern.triangles, theirs])
    # The same triangle may begin at another corner.
    first = np.argmin(both, axis=1)[:, None]
    both = np.take_along_axis(both, (first + np.arange(3)) % 3, axis=1)
    number = np.unique(both, axis=0, return_inverse=True)[1].ravel()
    ours, theirs = np.split(number, 2)
    missing = np.flatnonzero(~np.isin(ours, theirs))
    if len(missing):
        cell = int(missing[0])
        raise TargetError(
            f"triangle {cell} of the skin, between the vertices {pattern.triangles[cell]}, is not "
            f"in {path}: the vertices are in another order, or the surface is inside out. Export "
            "it so that the order is kept."
        )
    return points


def _mesh_in_space(path: Path, formats: str) -> tuple[Floats, Ints]:
    """Read points (n, 3), in the unit of a file, and triangles (t, 3) of a deformed mesh."""
    mesh = load(path, TargetError, formats)
    points = real_numbers(f"points of {path}", mesh.points, "(n, 3)", TargetError)
    triangles = cells(mesh, "triangle", 3)
    if not len(triangles) or points.ndim != 2 or points.shape[1] != 3:
        raise TargetError(f"{path} holds no triangles in space. Save the deformed surface.")
    if triangles.min() < 0 or triangles.max() >= len(points):
        raise TargetError(f"{path} has a triangle at a vertex that is not there. Export it again.")
    wrong = triangles[~np.isfinite(points[triangles]).all(axis=2)]
    if len(wrong):
        vertex = wrong.min()
        raise TargetError(
            f"vertex {vertex} of {path} lies at {points[vertex]}, which is not finite."
        )
    return points, triangles


@on_root
def from_copy(
    comm: MPI.Comm, original: Path, deformed: Path, pattern: Pattern | Surface, scale: float
) -> Floats:
    """Read target positions from a deformed copy of the mesh file that a pattern comes from.

    Triangles are matched by their order, which a program that deforms keeps in all formats. The
    pattern may be the surface that `read_surface` read; the scale is the length of the unit of both
    files in m. It is collective.

    Raises:
        TargetError: A file cannot be read, they have other triangles, corners that meet in one
            file are apart in the other, or a vertex of the pattern is none of the file.
    """
    meshes = [_mesh_in_space(path, f"STL, {DEFORMED_FORMATS}") for path in (original, deformed)]
    before, after = (scale * points[triangles].reshape(-1, 3) for points, triangles in meshes)
    if len(before) != len(after):
        raise TargetError(
            f"{deformed} has {len(after) // 3} triangles, {original} has {len(before) // 3}. "
            "Deform the same mesh, and do not remesh it."
        )
    near = APART * pattern.size
    gap, first = cKDTree(before).query(pattern.points)
    if gap.max() > near:
        raise TargetError(
            f"vertex {int(np.argmax(gap))} of the skin is none of {original}, which is repaired "
            "when it is read. Save the repaired surface, and deform that one."
        )
    target = after[first]
    # Several triangles share a vertex: they must agree on where it goes.
    gap, vertex = cKDTree(pattern.points).query(before)
    apart = np.where(gap <= near, np.linalg.norm(after - target[vertex], axis=1), 0.0)
    if apart.max() > near:
        corner = int(np.argmax(apart))
        raise TargetError(
            f"triangle {corner // 3} of {deformed} does not meet its neighbours at the corner that "
            f"was at {before[corner]} m: the triangles are in another order than in {original}, or "
            "the surface is torn. Export it so that the order is kept."
        )
    return np.asarray(target)
