"""Files of meshes: surfaces in STL, OBJ, PLY, MSH, XDMF …, target shapes, patterns."""

from __future__ import annotations

import contextlib
import ctypes
import io
import logging
import threading
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree

from toros_fem.base.errors import FileError, ParameterError, SurfaceError, TorosError
from toros_fem.base.files import MOST_BYTES, Archive, read_archive, write_archive
from toros_fem.base.mpi import on_root
from toros_fem.base.validation import (
    LONGEST_NAME,
    Bools,
    Floats,
    Ints,
    checked_floats,
    checked_path,
    real_numbers,
    require_count,
    require_kind,
    require_positive,
    shown,
)
from toros_fem.meshes.formats import NONE, Content, content_of
from toros_fem.meshes.pattern import Pattern, require_indices
from toros_fem.meshes.surface import (
    DROPPED,
    KINDS,
    MERGED,
    REVERSED,
    Surface,
    oriented,
    remove_thin,
    volume,
    weld,
)
from toros_fem.meshes.triangles import (
    edge_keys,
    edges_of,
    require_two_at_edges,
    surface_areas,
    surface_components,
)

FORMATS, DEFORMED_FORMATS = "STL, OBJ, PLY, MSH or XDMF", "OBJ, PLY or VTU"
log = logging.getLogger(__name__)
# Some of meshio's readers look for the next line of a file that has ended, and never return. These
# times in s are far beyond those of good files.
SECONDS, SECONDS_PER_MEGABYTE = 5.0, 60.0
# Characters of the longest message of a library that is passed on.
LONGEST = 160
# Largest sides in m of a bounding box beyond which a unit is in doubt.
SMALLEST, LARGEST = 1e-4, 10.0
# Sizes in m that skins have.
USUAL = (5e-3, 2.0)
# Units that files come in, and their length in m as `scale`, the most frequent ones first.
UNITS = (("Millimetres", "1e-3"), ("Metres", "1"), ("Inches", "0.0254"), ("Centimetres", "0.01"))
# Corners that belong together may be apart by this fraction of the size, if the surface closes.
NEAR = 1e-5
# Fractions of the size within which corners that are not merged are looked for, to be told.
GAPS = (NEAR, 1e-4, 1e-3, 1e-2)
# Corners that are apart by this fraction of the skin's size are different vertices.
APART = 1e-5
PATTERN_FILE, PATTERN_KIND = "pattern.npz", "pattern"
PATTERN_ARRAYS = ("flat_points", "flat_triangles", "panel", "sewn", "points")
PATTERN_NUMBERS = ("panel_names", "seam_tolerance", "moulded")
PRINTED = "printed"


def load(path: Path, failure: type[TorosError], formats: str) -> Content:
    """Read a mesh file; where this fails, an error suggests formats, "OBJ or PLY".

    Where a library cannot read a file, it prints, and may call `sys.exit`: both become an error.
    """
    if not path.is_file():
        raise failure(f"there is no file {path}.")
    size, most = path.stat().st_size, MOST_BYTES["mesh"]
    if not 0 < size <= most:
        what = f"is longer than {most} bytes. Save a coarser mesh" if size else "is empty"
        raise failure(f"{path} {what}. Save it again, as {formats}.")
    printed = io.StringIO()
    try:
        with (
            interrupted_after(SECONDS + SECONDS_PER_MEGABYTE * size / 1e6),
            contextlib.redirect_stdout(printed),
            contextlib.redirect_stderr(printed),
            np.errstate(over="ignore", invalid="ignore"),
        ):
            return content_of(path)
    except (Exception, SystemExit) as error:
        why = _why(error, printed.getvalue().strip())
        raise failure(f"{path} cannot be read as a mesh{why}. Save it as {formats}.") from error


def _why(error: BaseException, printed: str) -> str:
    """Return why a file is no mesh, in words after "cannot be read as a mesh"."""
    if isinstance(error, ImportError):
        return f", since Python lacks a package for its format ({error}): install that package"
    if isinstance(error, TimeoutError):
        return " in a reasonable time: it ends too early, or its counts are wrong"
    ours = type(error) is ValueError
    kind = "" if ours else f"{type(error).__name__}: "
    why = " ".join((printed or f"{kind}{error}").split()).rstrip(".")
    why = why if len(why) <= LONGEST else f"{why[:LONGEST]} …"
    return f": {why}" if ours else f" ({why})"


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


# ------------------------------------------------------------------------------------ surfaces


@on_root
def read_surface(
    comm: MPI.Comm, path: Path | str, scale: float = 1.0, component: int | None = None
) -> Surface:
    """Read a surface from a mesh file, repaired and oriented, the same on all ranks (collective).

    Coincident vertices are merged (an STL repeats each one), and nearly coincident ones, within
    1e-5 of the size, where that closes the surface. Copies of triangles are dropped, quadrilaterals
    split at their shorter diagonal, needles collapsed and caps flipped. Triangles
    are reversed to agree with their neighbours and, if the surface is closed, to face outwards.
    `Surface.repairs` tells the repairs. Vertices are numbered in the order in which the triangles
    use them, so that the format does not matter. Line elements become seams, cell groups become
    parts; a triangle of several groups is in the smallest. Points of two coordinates lie in z = 0.
    The log tells what is odd about the file.

    Args:
        path: STL, OBJ, PLY, MSH, XDMF or another format of meshio.
        scale: Length of the file's unit in m, 1e-3 for mm.
        component: Connected component to read, 0 for the one of largest area. None: the file must
            have a single one.

    Raises:
        ParameterError: scale is not positive, or component not a whole number from 0.
        SurfaceError: The surface is smaller than 0.1 mm or larger than 10 m. The file cannot be
            read, has no triangles, several components, or lines that are not edges of its
            triangles.
        PatternError: As of `Surface`.
    """
    path = checked_path("path", path, SurfaceError)
    require_positive(scale=scale)
    if component is not None:
        require_count(0, component=component)
    points, triangles, tags, seams, content = _raw(path)
    with np.errstate(over="ignore", invalid="ignore"):
        size = float(np.ptp(points, axis=0).max())
    if not SMALLEST <= size * scale <= LARGEST:
        raise SurfaceError(
            f"{path} is {size * scale:.3g} m across with scale = {scale:g}; surfaces are "
            f"{SMALLEST:g} m to {LARGEST:g} m. {unit_hint(size)}"
        )
    points = points * scale

    notes = list(content.notes)
    replaced_by, kept = _welded(points, triangles, notes)
    merged = len(points) - len(np.unique(replaced_by))
    seams, triangles = replaced_by[seams], replaced_by[triangles]
    tags, copies = _smallest_groups(triangles, tags, kept, content, notes)
    dropped, triangles = len(triangles) - len(kept) - copies, triangles[kept]
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
    parts, names = _named_parts(content, tags, notes)
    repairs = Counter({MERGED: merged, DROPPED: dropped})
    repairs[REVERSED] = int(np.any(read != triangles, axis=1).sum())
    points, triangles, parts, replaced_by, thin = remove_thin(points, triangles, parts, seams)
    points, triangles, seams = _renumbered(points, triangles, replaced_by[seams])
    done = repairs + thin
    for note in notes:
        log.warning("%s: %s", path, note)
    return Surface(
        points=points,
        triangles=triangles,
        parts=parts,
        part_names=names,
        seams=seams,
        repairs=", ".join(f"{done[kind]} {kind}" for kind in KINDS if done[kind]) or "none",
    )


def unit_hint(size: float) -> str:
    """Return the advice on the unit of a file whose surface has this size in it."""
    fit = [(unit, scale) for unit, scale in UNITS if USUAL[0] <= size * float(scale) <= USUAL[1]]
    if not fit:
        return "Is `scale`, the length of the file's unit in m, right?"
    if len(fit) == 1:
        return f"{fit[0][0]}? Give scale = {fit[0][1]}."
    told = (f"{scale} for {unit.lower()} ({size * float(scale):.2g} m)" for unit, scale in fit)
    return f"In which unit is it? Give scale = {', '.join(told)}."


def _raw(path: Path) -> tuple[Floats, Ints, Ints, Ints, Content]:
    """Return points (n, 3), triangles, their tags, lines, and all else that a file has.

    Lines may have their own vertices, at the places of the triangles' vertices.
    """
    content = load(path, SurfaceError, FORMATS)
    points = checked_floats(
        f"points of {path}", content.points, "(n, 3)",
        lambda shape: len(shape) == 2 and shape[1] in (2, 3), finite=False, failure=SurfaceError,
    )  # fmt: skip
    points = np.pad(points, ((0, 0), (0, 3 - points.shape[1])))
    if content.other:
        raise SurfaceError(
            f"{path} holds faces that are neither triangles nor quadrilaterals: "
            f"{', '.join(content.other)}. Triangulate it, with straight edges, before saving."
        )
    faces, lines = content.faces, content.lines
    square = faces[:, 3] != NONE
    for kind, corners in (
        ("triangle", faces[~square, :3]), ("quad", faces[square]), ("line", lines)
    ):  # fmt: skip
        wrong = corners[(corners < 0) | (corners >= len(points))]
        if len(wrong):
            raise SurfaceError(
                f"{path} has a {kind} at vertex {wrong[0]}, but its vertices are 0 … "
                f"{len(points) - 1}. It is cut off, or damaged: export it again."
            )
    if not len(faces):
        raise SurfaceError(f"{path} holds no triangles. Save the surface, not points or volumes.")
    # A quadrilateral becomes two triangles, in its place.
    a, b, c, d = np.moveaxis(points[np.where(square[:, None], faces, 0)], 1, 0)
    ac = np.linalg.norm(a - c, axis=1) <= np.linalg.norm(b - d, axis=1)
    one, two = faces[:, [0, 1, 2, 0, 2, 3]], faces[:, [0, 1, 3, 1, 2, 3]]
    halves = np.where((ac | ~square)[:, None], one, two).reshape(-1, 3)
    kept = np.column_stack([np.ones(len(faces), dtype=bool), square]).ravel()
    triangles, tags = halves[kept], np.repeat(content.tags, 2)[kept]
    used, number = np.unique(np.append(triangles, lines), return_inverse=True)
    if not np.all(np.isfinite(points[used])):
        raise SurfaceError(f"{path} holds coordinates that are not finite. Export it again.")
    corners, ends = np.split(number.ravel(), [triangles.size])
    return points[used], corners.reshape(-1, 3), tags, ends.reshape(-1, 2), content


def _welded(points: Floats, triangles: Ints, notes: list[str]) -> tuple[Ints, Ints]:
    """Merge vertices as `weld` does, further apart where that closes the surface, and note it."""
    found = weld(points, triangles)
    if _borders(triangles, *found):
        closer = weld(points, triangles, NEAR)
        if len(closer[1]) and not _borders(triangles, *closer):
            moved = float(np.linalg.norm(points - points[closer[0]], axis=1).max())
            notes.append(f"Corners up to {moved:.2g} m apart were merged, which closes it.")
            return closer
    return found


def _borders(triangles: Ints, replaced_by: Ints, kept: Ints) -> int:
    """Return the number of edges of welded triangles that do not have two of them."""
    return int(np.sum(edges_of(replaced_by[triangles[kept]]).count != 2)) if len(kept) else 0


def gap_hint(points: Floats, triangles: Ints) -> str:
    """Return the advice on an open surface whose corners are only near each other; "" for none."""
    first = _borders(triangles, *weld(points, triangles))
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    for gap in GAPS:
        found = weld(points, triangles, gap)
        if len(found[1]) > 0.9 * len(triangles) and _borders(triangles, *found) <= first / 2:
            return (
                f"Corners of neighbours are up to about {gap * size:.1g} m apart: merge them by "
                "distance, in the program that made the file. "
            )
    return ""


def _smallest_groups(
    triangles: Ints, tags: Ints, kept: Ints, content: Content, notes: list[str]
) -> tuple[Ints, int]:
    """Return the tag of each kept triangle, that of the smallest group which it or a copy is in.

    Returned is further how many of the others stand there for a further group.
    """
    number = np.unique(np.sort(triangles, axis=1), axis=0, return_inverse=True)[1].ravel()
    pairs = np.unique(np.column_stack([number, tags]), axis=0)
    group, size = np.unique(pairs[:, 1], return_inverse=True, return_counts=True)[1:]
    pairs = pairs[np.lexsort((pairs[:, 1], size[group.ravel()], pairs[:, 0]))]
    chosen = np.append(True, pairs[1:, 0] != pairs[:-1, 0])
    of_number = np.zeros(number.max() + 1, dtype=np.int64)
    of_number[pairs[chosen, 0]] = pairs[chosen, 1]
    copies = ~chosen & np.isin(pairs[:, 0], number[kept])
    if copies.any():
        names = [_part_name(content, tag) for tag in pairs[copies, 1]]
        given = ", ".join(f"{names.count(one)} of {one!r}" for one in dict.fromkeys(names))
        notes.append(
            f"Its groups overlap. Triangles in several are in the smallest one alone: {given} are "
            "in others now."
        )
    return of_number[number[kept]], int(copies.sum())


def _part_name(content: Content, tag: int) -> str:
    """Return the name of a group as that of a part, which is printable and short."""
    name = "".join(filter(str.isprintable, content.names.get(int(tag), ""))).strip()
    return name[:LONGEST_NAME] or f"part-{tag}"


def _named_parts(content: Content, tags: Ints, notes: list[str]) -> tuple[Ints, tuple[str, ...]]:
    """Return the part of each triangle by the tag of its group, and the names of parts."""
    known, parts = np.unique(tags, return_inverse=True)
    names = [_part_name(content, tag) for tag in known]
    alone = list(dict.fromkeys(names))
    notes += [
        f"{names.count(one)} groups are called {one!r}; they are one part."
        for one in alone if names.count(one) > 1
    ]  # fmt: skip
    return np.array([alone.index(one) for one in names])[parts.ravel()], tuple(alone)


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
            f"{gap_hint(points, triangles)}Choose one by `component` (0 is the largest), or "
            "connect them before saving."
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
        ParameterError: The file cannot be read, has a position that is not finite, or its mesh is
            not the pattern's.
    """
    path = checked_path("path", path, ParameterError)
    require_kind("pattern", pattern, Pattern, "a Pattern")
    points, theirs = _mesh_in_space(path, DEFORMED_FORMATS)
    if len(points) != len(pattern.points) or len(theirs) != len(pattern.panel):
        raise ParameterError(
            f"{path} has {len(points)} vertices and {len(theirs)} triangles; the skin has "
            f"{len(pattern.points)} and {len(pattern.panel)}. Deform the skin itself, keep the "
            "order of its vertices, and do not remesh it."
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
        raise ParameterError(
            f"triangle {cell} of the skin, between the vertices {pattern.triangles[cell]}, is not "
            f"in {path}: the vertices are in another order, or the surface is inside out. Export "
            "it so that the order is kept."
        )
    return points


def _mesh_in_space(path: Path, formats: str) -> tuple[Floats, Ints]:
    """Read points (n, 3), in the unit of a file, and triangles (t, 3) of a deformed mesh."""
    content = load(path, ParameterError, formats)
    points = real_numbers(f"points of {path}", content.points, "(n, 3)", ParameterError)
    triangles = content.triangles
    if not len(triangles) or points.ndim != 2 or points.shape[1] != 3:
        raise ParameterError(f"{path} holds no triangles in space. Save the deformed surface.")
    require_indices(ParameterError, **{f"{path}, its triangles,": (triangles, len(points))})
    wrong = triangles[~np.isfinite(points[triangles]).all(axis=2)]
    if len(wrong):
        vertex = wrong.min()
        raise ParameterError(
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
        ParameterError: A file cannot be read, they have other triangles, corners that meet in one
            file are apart in the other, or a vertex of the pattern is none of the file.
    """
    meshes = [_mesh_in_space(path, f"STL, {DEFORMED_FORMATS}") for path in (original, deformed)]
    before, after = (scale * points[triangles].reshape(-1, 3) for points, triangles in meshes)
    if len(before) != len(after):
        raise ParameterError(
            f"{deformed} has {len(after) // 3} triangles, {original} has {len(before) // 3}. "
            "Deform the same mesh, and do not remesh it."
        )
    near = APART * pattern.size
    gap, first = cKDTree(before).query(pattern.points)
    if gap.max() > near:
        raise ParameterError(
            f"vertex {int(np.argmax(gap))} of the skin is none of {original}, which is repaired "
            "when it is read. Save the repaired surface, and deform that one."
        )
    target = after[first]
    # Several triangles share a vertex: they must agree on where it goes.
    gap, vertex = cKDTree(pattern.points).query(before)
    apart = np.where(gap <= near, np.linalg.norm(after - target[vertex], axis=1), 0.0)
    if apart.max() > near:
        corner = int(np.argmax(apart))
        raise ParameterError(
            f"triangle {corner // 3} of {deformed} does not meet its neighbours at the corner that "
            f"was at {before[corner]} m: the triangles are in another order than in {original}, or "
            "the surface is torn. Export it so that the order is kept."
        )
    return np.asarray(target)


# --------------------------------------------------------------------------------------- patterns


def write_pattern(path: Path | str, pattern: Pattern, printed: Bools | None = None) -> None:
    """Write a pattern as an archive, a file ending in .npz (one rank).

    Its entries are the fields of `Pattern` by name, lengths in m, and "printed" where it is given:
    whether each triangle is printed, (t,).

    Raises:
        FileError: The path does not end in .npz.
    """
    path = checked_path("path", path, FileError)
    if path.suffix != ".npz":
        raise FileError(f"path = {shown(str(path))} must end in .npz.")
    require_kind("pattern", pattern, Pattern, "a Pattern")
    write_archive(
        path, archive_of(PATTERN_KIND, pattern, {} if printed is None else {PRINTED: printed})
    )


@on_root
def read_pattern(comm: MPI.Comm, path: Path | str) -> Pattern:
    """Read the pattern that `write_pattern` wrote, the same on all ranks (collective).

    Raises:
        FileError: There is no such file, it is damaged, of another kind or format, or holds
            no valid pattern.
    """
    place = checked_path("path", path, FileError)
    remedy = f"Give a {PATTERN_FILE} of `toros unwrap`."
    return read_archive(place, PATTERN_KIND, pattern_of, FileError, remedy)


@on_root
def read_print(comm: MPI.Comm, path: Path | str) -> tuple[Pattern, Bools]:
    """Read a pattern of a design and which of its triangles are printed, (t,) (collective).

    Raises:
        FileError: As for `read_pattern`, or the file does not say what is printed.
    """
    place = checked_path("path", path, FileError)
    remedy = f"Give the {PATTERN_FILE} of a design."

    def make(archive: Archive) -> tuple[Pattern, Bools]:
        pattern, printed = pattern_of(archive), archive.arrays.get(PRINTED)
        if printed is None or printed.dtype != bool or printed.shape != pattern.panel.shape:
            raise FileError("it does not say which triangles are printed")
        return pattern, printed

    return read_archive(place, PATTERN_KIND, make, FileError, remedy)


def archive_of(
    kind: str, pattern: Pattern, arrays: Mapping[str, Any], numbers: Mapping[str, Any] | None = None
) -> Archive:
    """Return an archive of a pattern and of what belongs to it."""
    own = {name: getattr(pattern, name) for name in PATTERN_ARRAYS}
    more = {name: getattr(pattern, name) for name in PATTERN_NUMBERS}
    given = {name: np.asarray(array) for name, array in arrays.items()}
    return Archive(kind, {**own, **given}, {**more, **(numbers or {})})


def pattern_of(archive: Archive) -> Pattern:
    """Return the pattern in an archive; any error where there is none."""
    arrays = {name: archive.arrays[name] for name in PATTERN_ARRAYS}
    names, tolerance, moulded = (archive.numbers[name] for name in PATTERN_NUMBERS)
    return Pattern(**arrays, panel_names=tuple(names), seam_tolerance=tolerance, moulded=moulded)
