"""Families of lines on a part of a symmetric skin: which of them is the mirror image of which."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from toros_fem.base.array_types import Floats, Ints
from toros_fem.design.lines.centre_lines import CentreLine
from toros_fem.design.lines.field import LineField
from toros_fem.design.lines.stripes import Image, Waves
from toros_fem.design.lines.transport import LineMesh, make_line_mesh
from toros_fem.meshes.mirror import Mirrored, mirrored, plane_border
from toros_fem.meshes.triangles import half_edges

# Pairs of families must fit better than each family fits its own image by this fraction.
BETTER = 1e-3


@dataclass(frozen=True, eq=False)
class Symmetry:
    """A part of a skin, its whole, and how families go on from image to image.

    The whole consists of 2^a images of the part, numbered by bits: bit i is set where the image is
    mirrored in plane i. Image 0 is the part. A family k of the part goes on in image b as the
    mirror image of family `partner[b, k]`.

    Attributes:
        part: Line mesh of the part, with t triangles.
        whole: Line mesh of the whole, whose triangle b t + i is image b of triangle i.
        partner: Families by image, (2^a, K).
        turns: Orthogonal matrix from the part's chart to that of each triangle, (2^a t, 2, 2).
    """

    part: LineMesh
    whole: LineMesh
    partner: Ints
    turns: Floats

    @property
    def count(self) -> int:
        """Number of triangles of the part."""
        return len(self.part.cells)

    def first(self, family: int) -> tuple[int, int]:
        """Return a family of the part and the image where it goes on as the given one.

        Of all families and images that would do, the first: lines need be found only once.
        """
        images, families = np.nonzero(self.partner == family)
        order = np.lexsort((images, families))[0]
        return int(families[order]), int(images[order])

    def of_whole(self, values: Floats, family: int) -> Floats:
        """Return values of a family's triangles on the whole, from those of the part, (t, K)."""
        return np.concatenate([values[:, partner] for partner in self.partner[:, family]])

    def angles_of_whole(self, angles: Floats, family: int) -> Floats:
        """Return a family's directions on the whole, from those of the part, (t, K), in rad."""
        angle = self.of_whole(angles, family)
        way = np.einsum("tij,tj->ti", self.turns, np.stack([np.cos(angle), np.sin(angle)], axis=1))
        return np.arctan2(way[:, 1], way[:, 0])

    def images(self, waves: Waves, family: int) -> list[Image]:
        """Return the symmetries of the whole that map a family to itself."""
        found = []
        corner_angle = waves.corner_angles()
        for image in range(1, len(self.partner)):
            if self.partner[image, family] != family:
                continue
            odd = image.bit_count() % 2 == 1
            cell = self._moved(image)
            there = self.whole.vertex[cell][:, ::-1] if odd else self.whole.vertex[cell]
            vertex = np.empty(self.whole.size, dtype=np.int64)
            vertex[self.whole.vertex] = there
            angle = corner_angle[cell][:, ::-1] if odd else corner_angle[cell]
            turn = self.turns[cell] @ self.turns.transpose(0, 2, 1)
            way = np.stack([np.cos(corner_angle), np.sin(corner_angle)], axis=2)
            moved = np.einsum("tij,tcj->tci", turn, way)
            fit = moved[..., 0] * np.cos(angle) + moved[..., 1] * np.sin(angle)
            # The normal of a line turns against its direction in a mirror.
            flips = np.zeros(self.whole.size, dtype=bool)
            flips[self.whole.vertex] = (fit < 0) != odd
            found.append(Image(vertex, flips))
        return found

    def side(self, waves: Waves, family: int) -> Floats:
        """Return the sign of a small phase, (n,), that moves a line off a plane, to image 0."""
        side = np.ones(self.whole.size)
        vertex, angle = self.whole.vertex, waves.corner_angles()
        inward = self.whole.corners.mean(axis=1)[:, None] - self.whole.corners
        normal = np.stack([-np.sin(angle), np.cos(angle)], axis=2)
        sign = -np.sign(np.einsum("tcx,tcx->tc", inward, normal))
        image = np.arange(len(vertex)) // self.count
        for bit in (b for b in (1, 2, 4) if b < len(self.partner)):
            if self.partner[bit, family] == family:
                there = self.whole.vertex[self._moved(bit)][:, ::-1]
                own = (vertex == there) & (image & bit == 0)[:, None]
                side[vertex[own]] = np.where(sign[own] == 0, 1.0, sign[own])
        return side

    def _moved(self, image: int) -> Ints:
        """Return the triangle that is the image of each triangle of the whole."""
        cell = np.arange(len(self.whole.cells))
        return (cell // self.count ^ image) * self.count + cell % self.count

    def restricted(self, lines: list[CentreLine], image: int) -> list[CentreLine]:
        """Return the pieces of lines in an image, moved to the part."""
        found = []
        for line in lines:
            inside = line.cell // self.count == image
            cells, points = line.cell, line.points
            if line.closed and not inside.all():
                begin = int(np.argmin(inside))
                cells, points = np.roll(cells, -begin), np.roll(points, -begin, axis=0)
                inside = np.roll(inside, -begin)
            first = np.flatnonzero(np.diff(inside.astype(int), prepend=0) == 1)
            last = np.flatnonzero(np.diff(inside.astype(int), append=0) == -1)
            for a, b in zip(first, last + 1, strict=True):
                closed = line.closed and bool(inside.all())
                found.append(CentreLine(*self._to_part(cells[a:b], points[a:b]), closed))
        return found

    def _to_part(self, cells: Ints, points: Floats) -> tuple[Ints, Floats]:
        own = cells % self.count
        odd = np.array([int(b).bit_count() % 2 for b in cells // self.count])
        here = self.whole.corners[cells]
        here = np.where(odd[:, None, None] == 1, here[:, ::-1], here)
        there = self.part.corners[own]
        away = np.einsum("kji,kej->kei", self.turns[cells], points - here[:, :1])
        return own, there[:, :1] + away

    def vertices_to_part(self, values: Floats, image: int) -> Floats:
        """Return values at the part's vertices from those of the whole at an image of them."""
        found = np.empty(self.part.size)
        found[self.part.vertex] = values[self._corners(image)]
        return found

    def angles_to_part(self, waves: Waves, image: int) -> Floats:
        """Return directions at the corners of the part, (t, 3), from those at an image of it."""
        cells = np.arange(self.count) + image * self.count
        angle = waves.corner_angles()[cells]
        angle = angle[:, ::-1] if image.bit_count() % 2 else angle
        way = np.stack([np.cos(angle), np.sin(angle)], axis=2)
        back = np.einsum("tji,tcj->tci", self.turns[cells], way)
        return np.arctan2(back[..., 1], back[..., 0])

    def _corners(self, image: int) -> Ints:
        cells = np.arange(self.count) + image * self.count
        vertex = self.whole.vertex[cells]
        return vertex[:, ::-1] if image.bit_count() % 2 else vertex


def make_symmetry(
    field: LineField, free: Ints, planes: Sequence[int], widths: Sequence[float]
) -> Symmetry:
    """Return how families of lines go on across symmetry planes.

    Families are paired so that their directions and shares fit at the planes; they must have the
    same width.

    Args:
        field: Families on the part.
        free: Triangles of the part that may carry lines, in ascending order.
        planes: Symmetry planes at which it is cut, as of `mirrored`.
        widths: Width asked of each family, in m.
    """
    pattern = field.pattern
    active = np.zeros(len(pattern.panel), dtype=bool)
    active[free] = True
    part = make_line_mesh(pattern, active)
    image = mirrored(pattern, planes)
    whole = make_line_mesh(image.pattern, active[image.cell]) if len(planes) else part
    return Symmetry(
        part,
        whole,
        _partners(field, active, planes, widths),
        _turns(image, whole, pattern.flat_points),
    )


def _turns(image: Mirrored, whole: LineMesh, origin: Floats) -> Floats:
    """Return the orthogonal matrix from the part's chart to that of each triangle of the whole."""
    corner = image.pattern.flat_triangles[whole.cells]
    part = origin[image.flat[corner]]
    here = whole.corners
    a = np.stack([here[:, 1] - here[:, 0], here[:, 2] - here[:, 0]], axis=2)
    b = np.stack([part[:, 1] - part[:, 0], part[:, 2] - part[:, 0]], axis=2)
    turn = a @ np.linalg.inv(b)
    # Rounding: the nearest orthogonal matrix.
    u, _, v = np.linalg.svd(turn)
    return np.asarray(u @ v)


def _partners(
    field: LineField, active: Floats, planes: Sequence[int], widths: Sequence[float]
) -> Ints:
    """Return the family that each one goes on as in each image, (2^a, K)."""
    families = field.families
    costs = [_misfit(field, active, axis, widths) for axis in planes]
    best: tuple[tuple[int, ...], ...] = tuple(tuple(range(families)) for _ in planes)
    least = sum(_cost(cost, own) for cost, own in zip(costs, best, strict=True))
    for choice in product(_involutions(list(range(families))), repeat=len(planes)):
        commute = all(
            [one[k] for k in two] == [two[k] for k in one] for one in choice for two in choice
        )
        cost = sum(_cost(cost, own) for cost, own in zip(costs, choice, strict=True))
        if commute and cost < (1 - BETTER) * least:
            best, least = choice, cost
    partner = np.tile(np.arange(families), (2 ** len(planes), 1))
    for image in range(len(partner)):
        for bit, own in enumerate(best):
            if image >> bit & 1:
                partner[image] = np.array(own)[partner[image]]
    return partner


def _cost(cost: Floats, partner: Sequence[int]) -> float:
    return float(sum(cost[k, other] for k, other in enumerate(partner)))


def _involutions(items: list[int]) -> Iterator[tuple[int, ...]]:
    """Yield all ways to pair items with each other or with themselves."""
    if not items:
        yield ()
        return

    def pairs(left: list[int]) -> Iterator[dict[int, int]]:
        if not left:
            yield {}
            return
        one, rest = left[0], left[1:]
        for other in left:
            for found in pairs([k for k in rest if k != other]):
                yield {**found, one: other, other: one}

    for found in pairs(items):
        yield tuple(found[k] for k in items)


def _misfit(field: LineField, active: Floats, axis: int, widths: Sequence[float]) -> Floats:
    """Return how badly each family fits the mirror image of each other one at a plane, (K, K)."""
    pattern = field.pattern
    half = plane_border(pattern, axis)
    half = half[active[half // 3]]
    ends = pattern.flat_points[half_edges(pattern.flat_triangles)[half]]
    along = ends[:, 1] - ends[:, 0]
    length, mirror = np.hypot(*along.T), np.arctan2(along[:, 1], along[:, 0])
    share, angle = field.shares[half // 3], field.angles[half // 3]
    image = 2 * mirror[:, None] - angle
    off = np.sin(angle[:, :, None] - image[:, None, :]) ** 2
    kink = off * share[:, :, None] * share[:, None, :]
    other = (share[:, :, None] - share[:, None, :]) ** 2 / 4
    cost = np.einsum("k,kij->ij", length, kink + other)
    width = np.asarray(widths)
    return np.where(width[:, None] == width, cost, np.inf)
