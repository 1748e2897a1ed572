"""Ends of lines: each is led to another line or to a border, or cut back to its last crossing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from toros_fem.base.array_types import Floats, Ints
from toros_fem.design.lines.centre_lines import CentreLine
from toros_fem.design.lines.transport import LineMesh
from toros_fem.meshes.mirror import plane_border
from toros_fem.meshes.triangles import chart_turns, following

OPEN, LINE, BORDER, PRINTED, PLANE = "open", "line", "border", "printed", "plane"

# Ways to lead an end on: the angle to the family's direction in degrees, and how much longer than
# the straight one such a way counts.
WAYS = ((0, 1.0), (35, 2.0), (-35, 2.0), (90, 3.0), (-90, 3.0), (130, 4.0), (-130, 4.0))
# Longest way, in spacings; the last attempt for a line that would be lost otherwise.
LONGEST, LAST = 4.0, 40.0
# An end that turns off its family's direction by more than this angle is a hook.
HOOK = np.radians(25)
# A line goes back to itself only after this many spacings.
AWAY = 3.0
# Most triangles on a way: where directions lead back and forth over an edge it has no end.
MOST_TRIANGLES = 300
# Rounds over all ends: one that ends on a line that is cut back is open again.
ROUNDS = 8
# Relative distance in triangles within which points are the same.
CLOSE = 1e-7


@dataclass(frozen=True, eq=False)
class Family:
    """The lines of one family, and what leads them on.

    Attributes:
        lines: Centre lines.
        angles: Direction at each corner of the mesh, (t, 3), in rad, modulo π.
        spacing: Distance from line to line at each vertex, (n,), in m.
        radius: Half the width at each vertex, (n,), in m.
        width: Width asked, in m.
        bounds: Least half width, and the largest one at each vertex, (n,), in m.
    """

    lines: list[CentreLine]
    angles: Floats
    spacing: Floats
    radius: Floats
    width: float
    bounds: tuple[float, Floats]


@dataclass(eq=False)
class _Line:
    """A line while its ends are worked on."""

    family: int
    cell: Ints
    points: Floats
    closed: bool
    ends: list[str] = field(default_factory=lambda: [OPEN, OPEN])

    def lengths(self) -> Floats:
        return np.asarray(np.linalg.norm(self.points[:, 1] - self.points[:, 0], axis=1))


@dataclass(frozen=True)
class _Way:
    """Segments that lead an end on, and at what they end."""

    cells: list[int]
    points: list[tuple[Floats, Floats]]
    length: float
    end: str


class Net:
    """Lines of all families on a mesh, found by triangle."""

    def __init__(self, mesh: LineMesh, families: Sequence[Family], planes: Sequence[int]) -> None:
        self.mesh, self.families = mesh, families
        self.lines: dict[int, _Line] = {}
        self.at: dict[int, set[int]] = {}
        self.border = _borders(mesh, planes)
        self.turn = chart_turns(mesh.corners, mesh.edges)
        for number, family in enumerate(families):
            for line in family.lines:
                self._add(_Line(number, line.cell, line.points, line.closed))

    def _add(self, line: _Line) -> None:
        key = max(self.lines, default=-1) + 1
        self.lines[key] = line
        self._index(key)

    def _index(self, key: int) -> None:
        for cell in map(int, np.unique(self.lines[key].cell)):
            self.at.setdefault(cell, set()).add(key)

    def _drop(self, key: int) -> None:
        for cell in map(int, np.unique(self.lines[key].cell)):
            self.at[cell].discard(key)
        del self.lines[key]

    def spacing(self, line: _Line, side: int) -> float:
        """Return the distance between lines at an end, in m."""
        cell = line.cell[0 if side == 0 else -1]
        return float(self.families[line.family].spacing[self.mesh.vertex[cell]].mean())

    def classify(self) -> None:
        """Find which ends lie at borders."""
        for line in self.lines.values():
            if line.closed:
                continue
            for side in range(2):
                k = 0 if side == 0 else -1
                edge = self._edge_at(int(line.cell[k]), line.points[k, side])
                if edge is not None and edge in self.border:
                    line.ends[side] = self.border[edge]

    def _edge_at(self, cell: int, point: Floats) -> int | None:
        """Return the edge that a point of a triangle lies on."""
        at = self.mesh.barycentric(np.array([cell]), point[None])[0]
        corner = int(np.argmin(np.abs(at)))
        if abs(at[corner]) > CLOSE:
            return None
        return int(self.mesh.edges.of_triangle[cell, (corner + 1) % 3])

    def straighten(self) -> None:
        """Cut hooks off: the last segments of open ends that do not follow their direction."""
        for key in list(self.lines):
            line = self.lines[key]
            for side in range(2):
                if line.closed or line.ends[side] != OPEN:
                    continue
                way = line.points[:, 1] - line.points[:, 0]
                angle = np.arctan2(way[:, 1], way[:, 0])
                wanted = self.families[line.family].angles[line.cell]
                double = np.exp(2j * wanted).mean(axis=1)
                off = np.abs(np.angle(np.exp(2j * angle) * np.conj(double))) / 2
                length = line.lengths()
                if side == 1:
                    off, length = off[::-1], length[::-1]
                near = np.cumsum(length) <= 1.5 * self.spacing(line, side)
                bad = np.flatnonzero(near & (off > HOOK))
                if len(bad):
                    self._cut(key, side, int(bad[-1]) + 1, None)
                    if key not in self.lines:
                        break

    def _cut(self, key: int, side: int, count: int, start: Floats | None) -> None:
        """Take `count` segments off an end; the next one begins at a new start."""
        line = self.lines[key]
        for cell in map(int, np.unique(line.cell)):
            self.at[cell].discard(key)
        if count >= len(line.cell):
            del self.lines[key]
            return
        if side == 0:
            line.cell, line.points = line.cell[count:], line.points[count:].copy()
        else:
            stop = len(line.cell) - count
            line.cell, line.points = line.cell[:stop], line.points[:stop].copy()
        if start is not None:
            line.points[0 if side == 0 else -1, side] = start
        self._index(key)

    def drop_short(self) -> None:
        """Drop lines with an open end that are shorter than a spacing or three widths."""
        for key in list(self.lines):
            line = self.lines[key]
            if line.closed or OPEN not in line.ends:
                continue
            least = max(self.spacing(line, 0), 3 * self.families[line.family].width)
            if line.lengths().sum() < least:
                self._drop(key)

    def close(self) -> None:
        """Lead all ends to lines or borders; drop lines that cannot be."""
        for number in range(ROUNDS):
            self._reopen()
            waiting = [
                (key, side)
                for key, line in self.lines.items()
                for side in range(2)
                if not line.closed and line.ends[side] == OPEN
            ]
            if not waiting:
                return
            for key, side in waiting:
                if key in self.lines and self.lines[key].ends[side] == OPEN:
                    self._close(key, side, last=number >= ROUNDS // 2)
        for key in [k for k, line in self.lines.items() if OPEN in line.ends and not line.closed]:
            self._drop(key)

    def _reopen(self) -> None:
        """Find ends on lines that are there no more."""
        for key, line in self.lines.items():
            for side in range(2):
                if line.ends[side] == LINE and not self._on_line(key, side):
                    line.ends[side] = OPEN

    def _on_line(self, key: int, side: int) -> bool:
        line = self.lines[key]
        k = 0 if side == 0 else -1
        cell, point = int(line.cell[k]), line.points[k, side]
        size = np.sqrt(self.mesh.areas[cell])
        for a, b in self._segments(cell, key, side, AWAY * self.spacing(line, side)):
            way = b - a
            at = np.clip((point - a) @ way / max(way @ way, 1e-300), 0, 1)
            if np.linalg.norm(a + at * way - point) < 10 * CLOSE * size:
                return True
        return False

    def _segments(self, cell: int, key: int, side: int, away: float) -> list[tuple[Floats, Floats]]:
        """Return the segments in a triangle without those of a line near one of its ends."""
        found = []
        for other in sorted(self.at.get(cell, ())):
            line = self.lines[other]
            here = np.flatnonzero(line.cell == cell)
            if other == key:
                length = line.lengths()
                path = np.cumsum(length if side == 0 else length[::-1])
                path = path if side == 0 else path[::-1]
                here = here[path[here] > away]
            found += [(line.points[k, 0], line.points[k, 1]) for k in here]
        return found

    def _close(self, key: int, side: int, last: bool) -> None:
        """Choose the shortest way to close an end."""
        line = self.lines[key]
        limit = (LAST if last else LONGEST) * self.spacing(line, side)
        best: _Way | None = None
        least = np.inf
        for degrees, factor in WAYS:
            way = self._walk(key, side, np.radians(degrees), min(limit, least / factor))
            if way is not None and factor * way.length < least:
                best, least = way, factor * way.length
        cut = self._last_crossing(key, side)
        if cut is not None and (cut[2] < least or best is None):
            self._cut(key, side, cut[0], cut[1])
            if key in self.lines:
                self.lines[key].ends[side] = LINE
                if line.lengths().sum() < self.families[line.family].width:
                    self._drop(key)
        elif best is not None:
            self._extend(key, side, best)
        elif last:
            self._drop(key)

    def _extend(self, key: int, side: int, way: _Way) -> None:
        line = self.lines[key]
        cells, points = np.array(way.cells, dtype=np.int64), np.array(way.points)
        if side == 0:
            line.cell = np.concatenate([cells[::-1], line.cell])
            line.points = np.concatenate([points[::-1, ::-1], line.points])
        else:
            line.cell = np.concatenate([line.cell, cells])
            line.points = np.concatenate([line.points, points])
        line.ends[side] = way.end
        self._index(key)

    def _last_crossing(self, key: int, side: int) -> tuple[int, Floats, float] | None:
        """Return where an end is last crossed: segments beyond, the point, the length beyond."""
        line = self.lines[key]
        order = range(len(line.cell)) if side == 0 else range(len(line.cell) - 1, -1, -1)
        beyond = 0.0
        away = AWAY * self.spacing(line, side)
        for count, k in enumerate(order):
            end, start = line.points[k, side], line.points[k, 1 - side]
            least: float | None = None
            for a, b in self._segments(int(line.cell[k]), key, side, away + beyond):
                at = _meeting(end, start, a, b)
                if at is not None and (least is None or at < least):
                    least = at
            length = float(np.linalg.norm(start - end))
            if least is not None:
                return count, end + least * (start - end), beyond + least * length
            beyond += length
        return None

    def _walk(self, key: int, side: int, offset: float, limit: float) -> _Way | None:
        """Follow a family's direction, turned by an angle, to the next line or border."""
        mesh, line = self.mesh, self.lines[key]
        k = 0 if side == 0 else -1
        cell, point = int(line.cell[k]), line.points[k, side].copy()
        before = point - line.points[k, 1 - side]
        heading = np.arctan2(before[1], before[0])
        angles = self.families[line.family].angles
        away = AWAY * self.spacing(line, side)
        cells: list[int] = []
        points: list[tuple[Floats, Floats]] = []
        total = 0.0
        edge_at = self._edge_at(cell, point)
        if edge_at is not None:
            step = self._over(cell, edge_at, point, heading, offset)
            if step is not None:
                cell, point, heading = step
        while total < limit and len(cells) < MOST_TRIANGLES:
            at = np.clip(mesh.barycentric(np.array([cell]), point[None])[0], 0, 1)
            double = at @ np.exp(2j * angles[cell])
            angle = float(np.angle(double)) / 2
            if np.cos(angle - heading) < 0:
                angle += np.pi
            heading = angle
            way = np.array([np.cos(angle + offset), np.sin(angle + offset)])
            corner, end = _exit(mesh.corners[cell], point, way)
            hit = None
            for a, b in self._segments(cell, key, side, away):
                meet = _meeting(point, end, a, b)
                if meet is not None and (hit is None or meet < hit):
                    hit = meet
            if hit is not None:
                end = point + hit * (end - point)
            length = float(np.linalg.norm(end - point))
            total += length
            cells.append(cell)
            points.append((point, end))
            if total > limit:
                return None
            if hit is not None:
                return _Way(cells, points, total, LINE)
            edge = int(mesh.edges.of_triangle[cell, corner])
            if edge in self.border:
                return _Way(cells, points, total, self.border[edge])
            step = self._across(cell, edge, end, heading)
            cell, point, heading = step
        return None

    def _over(
        self, cell: int, edge: int, point: Floats, heading: float, offset: float
    ) -> tuple[int, Floats, float] | None:
        """Return the start on the other side of an edge, if the way leads there."""
        way = np.array([np.cos(heading + offset), np.sin(heading + offset)])
        inward = self.mesh.corners[cell].mean(axis=0) - point
        half = np.flatnonzero(self.mesh.edges.of_triangle[cell] == edge)[0]
        along = self.mesh.corners[cell, (half + 1) % 3] - self.mesh.corners[cell, half]
        normal = np.array([-along[1], along[0]])  # inwards
        if way @ normal > 0 or inward @ normal < 0 or edge in self.border:
            return None
        return self._across(cell, edge, point, heading)

    def _across(
        self, cell: int, edge: int, point: Floats, heading: float
    ) -> tuple[int, Floats, float]:
        """Return triangle, point and heading on the other side of an inner edge."""
        mesh = self.mesh
        one, two = mesh.edges.twins[edge]
        own, other, turn = (
            (one, two, self.turn[edge]) if one // 3 == cell else (two, one, -self.turn[edge])
        )
        flat = mesh.corners.reshape(-1, 2)
        begin, end = flat[own], flat[following(own)]
        at = float(np.clip((point - begin) @ (end - begin) / ((end - begin) @ (end - begin)), 0, 1))
        a, b = flat[following(other)], flat[other]
        return int(other // 3), a + at * (b - a), heading + float(turn)

    def result(self) -> list[list[CentreLine]]:
        """Return the lines of each family."""
        found: list[list[CentreLine]] = [[] for _ in self.families]
        for line in self.lines.values():
            ends = None if line.closed else (line.ends[0], line.ends[1])
            found[line.family].append(CentreLine(line.cell, line.points, line.closed, ends))
        return found


def close_ends(mesh: LineMesh, families: Sequence[Family], planes: Sequence[int]) -> list[Family]:
    """Return the families with all ends of their lines on lines or borders.

    An open end goes along its direction, or aside, to the next line of any family, or is cut back
    to its last crossing, whichever is shorter.

    Args:
        mesh: The mesh of the lines.
        families: The families.
        planes: Symmetry planes at which the pattern is cut.
    """
    net = Net(mesh, families, planes)
    net.classify()
    net.straighten()
    net.drop_short()
    net.close()
    return [
        replace(family, lines=lines) for family, lines in zip(families, net.result(), strict=True)
    ]


def _borders(mesh: LineMesh, planes: Sequence[int]) -> dict[int, str]:
    """Return what lies at each border edge of the mesh."""
    pattern = mesh.pattern
    whole = pattern.edges
    half = mesh.edges.twins[mesh.edges.border, 0]
    there = 3 * mesh.cells[half // 3] + half % 3
    kind = np.where(whole.count[whole.of_triangle.ravel()[there]] == 2, PRINTED, BORDER)
    for axis in planes:
        kind[np.isin(there, plane_border(pattern, axis))] = PLANE
    return {int(k): str(name) for k, name in zip(mesh.edges.border, kind, strict=True)}


def _meeting(a: Floats, b: Floats, c: Floats, d: Floats) -> float | None:
    """Return the fraction of the way from a to b where it meets the segment from c to d."""
    u, v, w = b - a, d - c, c - a
    area = u[0] * v[1] - u[1] * v[0]
    if abs(area) < 1e-14 * (np.abs(u).max() * np.abs(v).max() + 1e-300):
        return None
    first = (w[0] * v[1] - w[1] * v[0]) / area
    second = (w[0] * u[1] - w[1] * u[0]) / area
    if -CLOSE <= first <= 1 + CLOSE and -CLOSE <= second <= 1 + CLOSE:
        return float(np.clip(first, 0, 1))
    return None


def _exit(corners: Floats, point: Floats, way: Floats) -> tuple[int, Floats]:
    """Return the side, by its first corner, where a ray leaves a triangle, and the place."""
    best, side = np.inf, 0
    for k in range(3):
        a, b = corners[k], corners[(k + 1) % 3]
        normal = np.array([b[1] - a[1], a[0] - b[0]])  # outwards
        speed = way @ normal
        if speed > 0:
            at = ((a - point) @ normal) / speed
            if at < best:
                best, side = at, k
    return side, point + max(best, 0.0) * way
