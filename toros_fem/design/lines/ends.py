"""Ends of lines: each is led to another line or to a border, or cut back to its last crossing."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from toros_fem.design.lines.centre_lines import (
    BORDER,
    LINE,
    OPEN,
    PLANE,
    PRINTED,
    CentreLine,
    LinesOfFamily,
)
from toros_fem.design.lines.field import Complexes, LineMesh
from toros_fem.meshes.pattern import plane_border

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

# Key of a line, and which of its ends: 0 is its start.
End = tuple[int, int]


def close_ends(
    mesh: LineMesh, families: Sequence[LinesOfFamily], planes: Sequence[int]
) -> list[LinesOfFamily]:
    """Return the families with all ends of their lines on lines or borders.

    An open end goes along its direction, or aside, to the next line of any family, or is cut back
    to its last crossing, whichever is shorter. The pattern is cut at symmetry planes.
    """
    net = Net(mesh, families, planes)
    net.straighten()
    net.drop_short()
    net.close()
    return net.result()


class Net:
    """Lines of all families on a mesh, found by triangle.

    What is done at an end is done to the line that runs towards it: `towards` turns a line round
    where the end is its start, and `put` turns it back.
    """

    def __init__(
        self, mesh: LineMesh, families: Sequence[LinesOfFamily], planes: Sequence[int]
    ) -> None:
        self.mesh, self.families = mesh, families
        self.double = [np.exp(2j * family.angles) for family in families]
        self.border = _borders(mesh, planes)
        self.lines: dict[int, CentreLine] = {}
        self.at: defaultdict[int, set[int]] = defaultdict(set)
        every = [(k, line) for k, family in enumerate(families) for line in family.lines]
        self.family = [k for k, _ in every]
        for key, (_, line) in enumerate(every):
            self.put((key, 1), line)
        for end in self.open_ends():
            line = self.towards(end)
            edge = self._edge_at(int(line.cell[-1]), line.places[-1, 1])
            if edge in self.border:
                self.put(end, replace(line, ends=(line.ends[0], self.border[edge])))

    def towards(self, end: End) -> CentreLine:
        """Return a line as it runs towards an end."""
        key, side = end
        return self.lines[key] if side == 1 else self.lines[key].reversed

    def put(self, end: End, line: CentreLine | None) -> None:
        """Change a line, given as it runs towards an end, or take it away."""
        key, side = end
        if key in self.lines:
            for cell in map(int, self.lines[key].cell):
                self.at[cell].discard(key)
        if line is None:
            del self.lines[key]
        else:
            self.lines[key] = line if side == 1 else line.reversed
            for cell in map(int, line.cell):
                self.at[cell].add(key)

    def open_ends(self, kind: str = OPEN) -> list[End]:
        """Return the ends that are open, or of another kind."""
        ends = [(key, side) for key, line in self.lines.items() for side in range(len(line.ends))]
        return [(key, side) for key, side in ends if self.lines[key].ends[side] == kind]

    def result(self) -> list[LinesOfFamily]:
        """Return the families with their lines."""
        return [
            replace(f, lines=[line for key, line in self.lines.items() if self.family[key] == k])
            for k, f in enumerate(self.families)
        ]

    def spacing(self, end: End) -> float:
        """Return the distance between lines at an end, in m."""
        key, side = end
        corner = self.mesh.vertex[self.lines[key].cell[-side]]
        return float(self.families[self.family[key]].spacing[corner].mean())

    def straighten(self) -> None:
        """Cut hooks off: the last segments of open ends that do not follow their direction."""
        for end in self.open_ends():
            if end[0] not in self.lines:
                continue
            line = self.towards(end)
            double = self.double[self.family[end[0]]][line.cell].mean(axis=1)
            off = np.abs(np.angle(line.ways**2 * np.conj(double))) / 2
            hook = (line.to_end <= 1.5 * self.spacing(end)) & (off > HOOK)
            if hook.any():
                k = int(np.argmax(hook))
                rest = CentreLine(line.cell[:k], line.places[:k], line.ends)
                self.put(end, rest if k > 0 else None)

    def drop_short(self) -> None:
        """Drop lines with an open end that are shorter than a spacing or three widths."""
        for key in {key for key, _ in self.open_ends()}:
            least = max(self.spacing((key, 0)), 3 * self.families[self.family[key]].width)
            if self.lines[key].length < least:
                self.put((key, 0), None)

    def close(self) -> None:
        """Lead all ends to lines or borders; drop lines that cannot be."""
        for number in range(ROUNDS):
            for end in self.open_ends(LINE):  # on lines that are there no more
                line = self.towards(end)
                if not touches(self.mesh, line, self._segments(int(line.cell[-1]), end)):
                    self.put(end, replace(line, ends=(line.ends[0], OPEN)))
            for end in self.open_ends():
                if end[0] in self.lines:
                    self._close(end, last=number >= ROUNDS // 2)
        for key in {key for key, _ in self.open_ends()}:
            self.put((key, 0), None)

    def _segments(self, cell: int, end: End, beyond: float = 0.0) -> Complexes:
        """Return the segments in a triangle, (k, 2), without those of a line near one of its ends.

        The line may be cut back by a length beyond this end, in m.
        """
        found = [np.empty((0, 2), dtype=np.complex128)]
        for key in sorted(self.at[cell]):
            line = self.towards((key, end[1]))
            here = line.cell == cell
            if key == end[0]:
                here &= line.to_end > AWAY * self.spacing(end) + beyond
            found.append(line.places[here])
        return np.concatenate(found)

    def _close(self, end: End, last: bool) -> None:
        """Choose the shortest way to close an end."""
        line, limit = self.towards(end), (LAST if last else LONGEST) * self.spacing(end)
        best, least = None, np.inf
        for degrees, factor in WAYS:
            way = self._walk(end, np.radians(degrees), min(limit, least / factor))
            if way is not None and factor * way.length < least:
                best, least = way, factor * way.length
        cut, beyond = self._cut_back(end)
        if cut is not None and beyond < least:
            enough = cut.length >= self.families[self.family[end[0]]].width
            self.put(end, cut if enough else None)
        elif best is not None:
            cell = np.concatenate([line.cell, best.cell])
            places = np.concatenate([line.places, best.places])
            self.put(end, CentreLine(cell, places, (line.ends[0], best.ends[1])))
        elif last:
            self.put(end, None)

    def _cut_back(self, end: End) -> tuple[CentreLine | None, float]:
        """Return a line cut back to where its end is last crossed, and the length beyond in m."""
        line, beyond = self.towards(end), 0.0
        for k in range(len(line.cell) - 1, -1, -1):
            way = -line.ways[k]
            segments = self._segments(int(line.cell[k]), end, beyond)
            hit = _first_meeting(line.places[k, 1], way, segments)
            if hit is not None:
                places = line.places[: k + 1].copy()
                places[k, 1] += hit * way
                cut = CentreLine(line.cell[: k + 1], places, (line.ends[0], LINE))
                return cut, beyond + hit * abs(way)
            beyond += abs(way)
        return None, beyond

    def _walk(self, end: End, offset: float, limit: float) -> CentreLine | None:
        """Follow a family's direction, turned by an angle, to the next line or border."""
        line, double = self.towards(end), self.double[self.family[end[0]]]
        cell, place = int(line.cell[-1]), line.places[-1, 1]
        heading, turn = line.ways[-1] or 1.0, np.exp(1j * offset)
        edge = self._edge_at(cell, place)
        if edge is not None and edge not in self.border:
            along = self._side(cell, edge)[1]
            if (np.conj(along) * heading * turn).imag <= 0:  # it leads out
                cell, place, heading = self._across(cell, edge, place, heading)
        cells: list[int] = []
        places: list[tuple[complex, complex]] = []
        while len(cells) < MOST_TRIANGLES:
            at = np.clip(self.mesh.barycentric(cell, place), 0, 1)
            direction = np.exp(0.5j * np.angle(at @ double[cell]))
            heading = direction if (np.conj(direction) * heading).real >= 0 else -direction
            edge, way = self._exit(cell, place, heading * turn)
            hit = _first_meeting(place, way, self._segments(cell, end))
            if hit is not None:
                way = hit * way
            limit -= abs(way)
            if limit < 0:
                return None
            cells.append(cell)
            places.append((place, place + way))
            kind = LINE if hit is not None else self.border.get(edge)
            if kind is not None:
                return CentreLine(np.array(cells), np.array(places), (OPEN, kind))
            cell, place, heading = self._across(cell, edge, place + way, heading)
        return None

    def _edge_at(self, cell: int, place: complex) -> int | None:
        """Return the edge of a triangle that a place lies on."""
        at = np.abs(self.mesh.barycentric(cell, place))
        side = (int(np.argmin(at)) + 1) % 3
        return int(self.mesh.edges.of_triangle[cell, side]) if at.min() <= CLOSE else None

    def _side(self, cell: int, edge: int) -> tuple[complex, complex]:
        """Return the start of an edge of a triangle, and the way along it."""
        corner = int(np.flatnonzero(self.mesh.edges.of_triangle[cell] == edge)[0])
        return self.mesh.flat[cell, corner], self.mesh.sides[cell, corner]

    def _exit(self, cell: int, place: complex, heading: complex) -> tuple[int, complex]:
        """Return the edge where a ray leaves a triangle, and the way to it."""
        outwards = 1j * np.conj(self.mesh.sides[cell])
        speed = (outwards * heading).real
        room = (outwards * (self.mesh.flat[cell] - place)).real
        at = np.divide(room, speed, out=np.full(3, np.inf), where=speed > 0)
        side = int(np.argmin(at))
        return int(self.mesh.edges.of_triangle[cell, side]), max(at[side], 0.0) * heading

    def _across(
        self, cell: int, edge: int, place: complex, heading: complex
    ) -> tuple[int, complex, complex]:
        """Return triangle, place and heading on the other side of an inner edge."""
        one, two = self.mesh.edges.sides[edge].tolist()
        other, turn = (two, 1) if one == cell else (one, -1)
        (start, along), (there, back) = self._side(cell, edge), self._side(other, edge)
        at = float(np.clip(((place - start) / along).real, 0, 1))
        turned = heading * np.exp(1j * turn * self.mesh.edge_turns[edge])
        return other, there + (1 - at) * back, turned


def _borders(mesh: LineMesh, planes: Sequence[int]) -> dict[int | None, str]:
    """Return what lies at each border edge of the mesh."""
    whole = mesh.pattern.edges
    kind = np.where(whole.count[whole.of_triangle.ravel()[mesh.border]] == 2, PRINTED, BORDER)
    for axis in planes:
        kind[np.isin(mesh.border, plane_border(mesh.pattern, axis))] = PLANE
    return {int(k): str(name) for k, name in zip(mesh.edges.border, kind, strict=True)}


def touches(mesh: LineMesh, line: CentreLine, segments: Complexes) -> bool:
    """Return whether the end of a line lies on one of the segments (k, 2) in its last triangle."""
    way, there = segments[:, 1] - segments[:, 0], line.places[-1, 1] - segments[:, 0]
    at = (np.conj(way) * there).real / np.maximum(np.abs(way) ** 2, 1e-300)
    near = 10 * CLOSE * np.sqrt(mesh.areas[line.cell[-1]])
    return bool(np.any(np.abs(there - np.clip(at, 0, 1) * way) < near))


def _first_meeting(place: complex, way: complex, segments: Complexes) -> float | None:
    """Return the least fraction of a way from a place where it meets one of the segments."""
    along, there = segments[:, 1] - segments[:, 0], segments[:, 0] - place
    area = (np.conj(way) * along).imag
    crossing = np.abs(area) > 1e-14 * np.abs(way) * np.abs(along)
    area, along, there = area[crossing], along[crossing], there[crossing]
    first, second = (np.conj(there) * along).imag / area, (np.conj(there) * way).imag / area
    low, high = np.minimum(first, second), np.maximum(first, second)
    hits = first[(low >= -CLOSE) & (high <= 1 + CLOSE)]
    return float(np.clip(hits.min(), 0, 1)) if len(hits) else None
