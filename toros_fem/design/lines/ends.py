"""Ends of lines: each is led to another line or to a border, or cut back to its last crossing."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.design.lines.centre_lines import (
    BORDER,
    LINE,
    OPEN,
    PLANE,
    PRINTED,
    CentreLine,
    Family,
)
from toros_fem.design.lines.line_mesh import Complexes, LineMesh, coordinates, in_plane
from toros_fem.meshes.mirror import plane_border
from toros_fem.meshes.triangles import barycentric

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
    return net.result()


class Net:
    """Lines of all families on a mesh, found by triangle.

    What is done at an end is done to the line that runs towards it: `towards` turns a line round
    where the end is its start, and `put` turns it back. Places are complex numbers.
    """

    def __init__(self, mesh: LineMesh, families: Sequence[Family], planes: Sequence[int]) -> None:
        self.mesh, self.families = mesh, families
        self.corners = in_plane(mesh.corners)
        self.double = [np.exp(2j * family.angles) for family in families]
        self.border = _borders(mesh, planes)
        every = [(k, line) for k, family in enumerate(families) for line in family.lines]
        self.family = [k for k, _ in every]
        self.lines = {key: line for key, (_, line) in enumerate(every)}
        self.at: defaultdict[int, set[int]] = defaultdict(set)
        for key, line in self.lines.items():
            for cell in line.cell.tolist():
                self.at[cell].add(key)

    def towards(self, key: int, side: int) -> CentreLine:
        """Return a line as it runs towards its start, side 0, or its end, side 1."""
        return self.lines[key] if side == 1 else self.lines[key].reversed

    def put(self, key: int, side: int, line: CentreLine) -> None:
        """Change a line; it is given as it runs towards a side."""
        for cell in self.lines[key].cell.tolist():
            self.at[cell].discard(key)
        self.lines[key] = line if side == 1 else line.reversed
        for cell in line.cell.tolist():
            self.at[cell].add(key)

    def drop(self, key: int) -> None:
        """Take a line away."""
        for cell in self.lines.pop(key).cell.tolist():
            self.at[cell].discard(key)

    def open_ends(self) -> list[tuple[int, int]]:
        """Return line and side of each open end."""
        return [
            (key, side)
            for key, line in self.lines.items()
            for side, kind in enumerate(line.ends)
            if kind == OPEN
        ]

    def result(self) -> list[Family]:
        """Return the families with their lines."""
        return [
            replace(f, lines=[line for key, line in self.lines.items() if self.family[key] == k])
            for k, f in enumerate(self.families)
        ]

    def spacing(self, key: int, side: int) -> float:
        """Return the distance between lines at an end, in m."""
        cell = self.lines[key].cell[-side]
        return float(self.families[self.family[key]].spacing[self.mesh.vertex[cell]].mean())

    def classify(self) -> None:
        """Find which ends lie at borders."""
        for key, side in self.open_ends():
            line = self.towards(key, side)
            edge = self._edge_at(int(line.cell[-1]), in_plane(line.points[-1, 1]))
            if edge in self.border:
                self.put(key, side, replace(line, ends=(line.ends[0], self.border[edge])))

    def straighten(self) -> None:
        """Cut hooks off: the last segments of open ends that do not follow their direction."""
        for key, side in self.open_ends():
            if key not in self.lines:
                continue
            line = self.towards(key, side)
            way = in_plane(line.points[:, 1] - line.points[:, 0])
            double = self.double[self.family[key]][line.cell].mean(axis=1)
            off = np.abs(np.angle(way**2 * np.conj(double))) / 2
            hook = (_to_end(line) <= 1.5 * self.spacing(key, side)) & (off > HOOK)
            if hook[0]:
                self.drop(key)
            elif hook.any():
                kept = int(np.argmax(hook))
                self.put(key, side, CentreLine(line.cell[:kept], line.points[:kept], line.ends))

    def drop_short(self) -> None:
        """Drop lines with an open end that are shorter than a spacing or three widths."""
        for key in {key for key, _ in self.open_ends()}:
            least = max(self.spacing(key, 0), 3 * self.families[self.family[key]].width)
            if self.lines[key].length < least:
                self.drop(key)

    def close(self) -> None:
        """Lead all ends to lines or borders; drop lines that cannot be."""
        for number in range(ROUNDS):
            self._reopen()
            for key, side in self.open_ends():
                if key in self.lines:
                    self._close(key, side, last=number >= ROUNDS // 2)
        for key in {key for key, _ in self.open_ends()}:
            self.drop(key)

    def _reopen(self) -> None:
        """Find ends on lines that are there no more."""
        for key, side in [(k, s) for k, line in self.lines.items() for s in range(len(line.ends))]:
            line = self.towards(key, side)
            cell, end = int(line.cell[-1]), in_plane(line.points[-1, 1])
            if line.ends[1] == LINE and not np.any(
                distances(end, self._segments(cell, key, side)) < touching(self.mesh, cell)
            ):
                self.put(key, side, replace(line, ends=(line.ends[0], OPEN)))

    def _segments(self, cell: int, key: int, side: int, beyond: float = 0.0) -> Complexes:
        """Return the segments in a triangle, (k, 2), without those of a line near one of its ends.

        Args:
            cell: The triangle.
            key: The line.
            side: Its end.
            beyond: How far from its end it would be cut back.
        """
        found = [np.empty((0, 2, 2))]
        for other in sorted(self.at[cell]):
            line = self.lines[other] if other != key else self.towards(key, side)
            here = line.cell == cell
            if other == key:
                here &= _to_end(line) > AWAY * self.spacing(key, side) + beyond
            found.append(line.points[here])
        return in_plane(np.concatenate(found))

    def _close(self, key: int, side: int, last: bool) -> None:
        """Choose the shortest way to close an end."""
        line, spacing = self.towards(key, side), self.spacing(key, side)
        limit = (LAST if last else LONGEST) * spacing
        best, least = None, np.inf
        for degrees, factor in WAYS:
            way = self._walk(key, side, np.radians(degrees), min(limit, least / factor))
            if way is not None and factor * way.length < least:
                best, least = way, factor * way.length
        cut, beyond = self._cut_back(key, side)
        if cut is not None and beyond < least:
            self.put(key, side, cut)
            if cut.length < self.families[self.family[key]].width:
                self.drop(key)
        elif best is not None:
            cell = np.concatenate([line.cell, best.cell])
            points = np.concatenate([line.points, best.points])
            self.put(key, side, CentreLine(cell, points, (line.ends[0], best.ends[1])))
        elif last:
            self.drop(key)

    def _cut_back(self, key: int, side: int) -> tuple[CentreLine | None, float]:
        """Return a line cut back to where its end is last crossed, and the length beyond in m."""
        line, beyond = self.towards(key, side), 0.0
        for k in range(len(line.cell) - 1, -1, -1):
            start, end = in_plane(line.points[k])
            hit = _first_meeting(end, start, self._segments(int(line.cell[k]), key, side, beyond))
            if hit is not None:
                points = line.points[: k + 1].copy()
                points[k, 1] = coordinates(end + hit * (start - end))
                cut = CentreLine(line.cell[: k + 1], points, (line.ends[0], LINE))
                return cut, beyond + hit * abs(start - end)
            beyond += abs(start - end)
        return None, beyond

    def _walk(self, key: int, side: int, offset: float, limit: float) -> CentreLine | None:
        """Follow a family's direction, turned by an angle, to the next line or border."""
        line, double = self.towards(key, side), self.double[self.family[key]]
        cell, (start, point) = int(line.cell[-1]), in_plane(line.points[-1])
        heading, turn = point - start or 1.0, np.exp(1j * offset)
        edge = self._edge_at(cell, point)
        if edge is not None and edge not in self.border:
            along = self._side(cell, edge)[1]
            if (np.conj(along) * heading * turn).imag <= 0:  # it leads out
                cell, point, heading = self._across(cell, edge, point, heading)
        cells: list[int] = []
        points: list[Floats] = []
        while len(cells) < MOST_TRIANGLES:
            at = barycentric(self.mesh.corners[cell], coordinates(point)[None])[0]
            way = np.exp(0.5j * np.angle(np.clip(at, 0, 1) @ double[cell]))
            heading = way if (np.conj(way) * heading).real >= 0 else -way
            edge, end = self._exit(cell, point, heading * turn)
            hit = _first_meeting(point, end, self._segments(cell, key, side))
            if hit is not None:
                end = point + hit * (end - point)
            cells.append(cell)
            points.append(coordinates(np.array([point, end])))
            limit -= abs(end - point)
            if limit < 0:
                return None
            kind = LINE if hit is not None else self.border.get(edge)
            if kind is not None:
                return CentreLine(np.array(cells), np.array(points), (OPEN, kind))
            cell, point, heading = self._across(cell, edge, end, heading)
        return None

    def _edge_at(self, cell: int, point: complex) -> int | None:
        """Return the edge that a point of a triangle lies on."""
        at = np.abs(barycentric(self.mesh.corners[cell], coordinates(point)[None])[0])
        corner = int(np.argmin(at))
        if at[corner] > CLOSE:
            return None
        return int(self.mesh.edges.of_triangle[cell, (corner + 1) % 3])

    def _side(self, cell: int, edge: int) -> tuple[complex, complex]:
        """Return the start of an edge of a triangle, and the way along it."""
        corner = int(np.flatnonzero(self.mesh.edges.of_triangle[cell] == edge)[0])
        start = self.corners[cell, corner]
        return start, self.corners[cell, (corner + 1) % 3] - start

    def _exit(self, cell: int, point: complex, way: complex) -> tuple[int, complex]:
        """Return the edge where a ray leaves a triangle, and the place."""
        start = self.corners[cell]
        outwards = -1j * (np.roll(start, -1) - start)
        speed = (np.conj(way) * outwards).real
        room = (np.conj(start - point) * outwards).real
        at = np.divide(room, speed, out=np.full(3, np.inf), where=speed > 0)
        side = int(np.argmin(at))
        return int(self.mesh.edges.of_triangle[cell, side]), point + max(at[side], 0.0) * way

    def _across(
        self, cell: int, edge: int, point: complex, heading: complex
    ) -> tuple[int, complex, complex]:
        """Return triangle, point and heading on the other side of an inner edge."""
        one, two = self.mesh.edges.sides[edge]
        other, turn = (two, 1) if one == cell else (one, -1)
        start, along = self._side(cell, edge)
        at = float(np.clip(((point - start) / along).real, 0, 1))
        there, back = self._side(other, edge)
        turned = heading * np.exp(1j * turn * self.mesh.edge_turns[edge])
        return int(other), there + (1 - at) * back, turned


def _borders(mesh: LineMesh, planes: Sequence[int]) -> dict[int | None, str]:
    """Return what lies at each border edge of the mesh."""
    pattern = mesh.pattern
    whole = pattern.edges
    half = mesh.edges.twins[mesh.edges.border, 0]
    there = 3 * mesh.cells[half // 3] + half % 3
    kind = np.where(whole.count[whole.of_triangle.ravel()[there]] == 2, PRINTED, BORDER)
    for axis in planes:
        kind[np.isin(there, plane_border(pattern, axis))] = PLANE
    return dict(zip(mesh.edges.border.tolist(), kind.tolist(), strict=True))


def _to_end(line: CentreLine) -> Floats:
    """Return the length from the start of each segment to the end of the line in m, (m,)."""
    return np.cumsum(line.lengths[::-1])[::-1]


def touching(mesh: LineMesh, cell: int) -> float:
    """Return the distance in m within which an end in a triangle lies on a line."""
    return float(10 * CLOSE * np.sqrt(mesh.areas[cell]))


def distances(point: complex, segments: Complexes) -> Floats:
    """Return the distance of a point from segments (k, 2), (k,), in m."""
    way, there = segments[:, 1] - segments[:, 0], point - segments[:, 0]
    at = (np.conj(way) * there).real / np.maximum(np.abs(way) ** 2, 1e-300)
    return np.abs(there - np.clip(at, 0, 1) * way)


def _first_meeting(a: complex, b: complex, segments: Complexes) -> float | None:
    """Return the least fraction of the way from a to b where it meets one of the segments."""
    way, along, there = b - a, segments[:, 1] - segments[:, 0], segments[:, 0] - a
    area = (np.conj(way) * along).imag
    crossing = np.abs(area) > 1e-14 * np.abs(way) * np.abs(along)
    area, along, there = area[crossing], along[crossing], there[crossing]
    first, second = (np.conj(there) * along).imag / area, (np.conj(there) * way).imag / area
    low, high = np.minimum(first, second), np.maximum(first, second)
    hits = first[(low >= -CLOSE) & (high <= 1 + CLOSE)]
    return float(np.clip(hits.min(), 0, 1)) if len(hits) else None
