"""Families of lines on a part of a symmetric skin: which of them is the mirror image of which."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations, product
from typing import Any

import numpy as np
import numpy.typing as npt

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.design.lines.centre_lines import CentreLine, Family
from toros_fem.design.lines.field import LineField
from toros_fem.design.lines.line_mesh import (
    Complexes,
    LineMesh,
    in_plane,
    make_line_mesh,
)
from toros_fem.design.lines.stripes import Waves
from toros_fem.meshes.mirror import mirrored, plane_border
from toros_fem.meshes.triangles import half_edges

# Pairs of families must fit better than each family fits its own image by this fraction.
BETTER = 1e-3
# Whether an image is a mirror image, by its number.
ODD = np.array([image.bit_count() % 2 == 1 for image in range(8)])


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
    """

    part: LineMesh
    whole: LineMesh
    partner: Ints

    def by_image(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return values at corners of the whole, (2^a t, 3, …), as (2^a, t, 3, …).

        Corners follow each other as those of the part do: in mirror images they are reversed.
        """
        found = values.reshape(len(self.partner), -1, *values.shape[1:]).copy()
        odd = ODD[: len(found)]
        found[odd] = found[odd, :, ::-1]
        return found

    @cached_property
    def vertex(self) -> Ints:
        """Vertex of the whole at each corner of each image, (2^a, t, 3)."""
        return self.by_image(self.whole.vertex)

    @cached_property
    def frames(self) -> tuple[Complexes, Complexes]:
        """First corner of each triangle of each image, and its first side over the part's.

        Both are (2^a, t). A vector of the part, conjugated in mirror images, is multiplied by the
        side over the part's, which has length 1, to be moved to the image.
        """
        here = self.by_image(self.whole.flat)
        side = here[..., 1] - here[..., 0]
        turn = side / _mirrored(side[0], ODD[: len(here), None])
        return here[..., 0], turn / np.abs(turn)

    def first(self, family: int) -> tuple[int, int]:
        """Return a family of the part and the image where it goes on as the given one.

        Of all families and images that would do, the first: lines need be found only once.
        """
        families, images = np.nonzero(family == self.partner.T)
        return int(families[0]), int(images[0])

    def of_whole(self, values: Floats, family: int) -> Floats:
        """Return values of a family's triangles on the whole, from those of the part, (t, K)."""
        return values.T[self.partner[:, family]].ravel()

    def angles_of_whole(self, angles: Floats, family: int) -> Floats:
        """Return a family's directions on the whole, from those of the part, (t, K), in rad."""
        way = np.exp(1j * self.of_whole(angles, family)).reshape(len(self.partner), -1)
        return np.angle(_mirrored(way, ODD[: len(way), None]) * self.frames[1]).ravel()

    def _angles(self, angles: Floats) -> Floats:
        """Return directions at the whole's corners, (2^a t, 3), in the part's charts, by image."""
        way = self.by_image(np.exp(1j * angles))
        back = way * np.conj(self.frames[1])[..., None]
        return np.angle(_mirrored(back, ODD[: len(way), None, None]))

    def symmetric(self, waves: Waves, family: int) -> Callable[[Complexes], Complexes]:
        """Return what averages exp(i phase) at vertices, (n,), over the images of a family."""
        images, angle = [], self._angles(waves.corner_angles())
        for image in np.flatnonzero(self.partner[:, family] == family)[1:]:
            moved = np.arange(len(angle)) ^ image
            vertex, flips = np.empty(self.whole.size, np.int64), np.empty(self.whole.size, bool)
            vertex[self.vertex] = self.vertex[moved]
            # The normal of a line turns against its direction in a mirror.
            flips[self.vertex] = (np.cos(angle[moved] - angle) < 0) != ODD[image]
            images.append((vertex, flips))

        def mean(z: Complexes) -> Complexes:
            return sum((_mirrored(z[vertex], flips) for vertex, flips in images), z) / (
                1 + len(images)
            )

        return mean

    def side(self, waves: Waves, family: int) -> Floats:
        """Return the sign of a small phase, (n,), that moves a line off a plane, to image 0."""
        inward = self.whole.flat.mean(axis=1, keepdims=True) - self.whole.flat
        sign = self.by_image(-np.sign((np.exp(-1j * waves.corner_angles()) * inward).imag))
        side, number = np.ones(self.whole.size), np.arange(len(sign))
        for bit in (b for b in (1, 2, 4) if b < len(sign) and self.partner[b, family] == family):
            own = (self.vertex == self.vertex[number ^ bit]) & (number & bit == 0)[:, None, None]
            side[self.vertex[own]] = np.where(sign[own] == 0, 1.0, sign[own])
        return side

    def to_part(self, family: Family, image: int) -> Family:
        """Return a family of the part from lines of the whole in an image."""

        def moved(values: Floats) -> Floats:
            found = np.empty(self.part.size)
            found[self.part.vertex] = values[self.vertex[image]]
            return found

        least, largest = family.bounds
        return Family(
            self._lines(family.lines, image),
            self._angles(family.angles)[image],
            moved(family.spacing),
            moved(family.radius),
            family.width,
            (least, moved(largest)),
        )

    def _lines(self, lines: list[CentreLine], image: int) -> list[CentreLine]:
        """Return the pieces of lines in an image, moved to the part."""
        found, count = [], len(self.part.cells)
        for line in lines:
            inside = line.cell // count == image
            cells = line.cell % count
            origin, turn = (frame[image, cells, None] for frame in self.frames)
            away = _mirrored((line.places - origin) * np.conj(turn), ODD[image])
            places = self.frames[0][0, cells, None] + away
            if inside.all():
                found.append(CentreLine(cells, places, line.ends))
                continue
            if line.closed:
                begin = -int(np.argmin(inside))
                inside, cells, places = (np.roll(x, begin, axis=0) for x in (inside, cells, places))
            change = np.flatnonzero(np.diff(inside.astype(int), prepend=0, append=0))
            found += [CentreLine(cells[a:b], places[a:b]) for a, b in change.reshape(-1, 2)]
        return found


def _mirrored(vectors: Complexes, odd: npt.ArrayLike) -> Complexes:
    """Return vectors conjugated where they are in mirror images."""
    return np.where(odd, np.conj(vectors), vectors)


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
    active: Bools = np.isin(np.arange(len(field.pattern.panel)), free)
    part = whole = make_line_mesh(field.pattern, active)
    if planes:
        image = mirrored(field.pattern, planes)
        whole = make_line_mesh(image.pattern, active[image.cell])
    return Symmetry(part, whole, _partners(field, active, planes, widths))


def _partners(
    field: LineField, active: Bools, planes: Sequence[int], widths: Sequence[float]
) -> Ints:
    """Return the family that each one goes on as in each image, (2^a, K)."""
    own = range(field.families)
    costs = [_misfit(field, active, axis, widths) for axis in planes]

    def cost(choice: Sequence[Sequence[int]]) -> float:
        return float(sum(each[own, pairs].sum() for each, pairs in zip(costs, choice, strict=True)))

    # All ways to pair families with each other or with themselves, at each plane.
    pairings = [one for one in permutations(own) if all(one[one[k]] == k for k in own)]
    best: Sequence[Sequence[int]] = [tuple(own)] * len(planes)
    for choice in product(pairings, repeat=len(planes)):
        commute = all(one[two[k]] == two[one[k]] for one in choice for two in choice for k in own)
        if commute and cost(choice) < (1 - BETTER) * cost(best):
            best = choice
    partner = np.tile(own, (2 ** len(planes), 1))
    for image, bit in product(range(len(partner)), range(len(planes))):
        if image >> bit & 1:
            partner[image] = np.array(best[bit])[partner[image]]
    return partner


def _misfit(field: LineField, active: Bools, axis: int, widths: Sequence[float]) -> Floats:
    """Return how badly each family fits the mirror image of each other one at a plane, (K, K)."""
    pattern = field.pattern
    half = plane_border(pattern, axis)
    half = half[active[half // 3]]
    ends = in_plane(pattern.flat_points[half_edges(pattern.flat_triangles)[half]])
    along = ends[:, 1] - ends[:, 0]
    share, angle = field.shares[half // 3], field.angles[half // 3]
    image = 2 * np.angle(along)[:, None] - angle
    off = np.sin(angle[:, :, None] - image[:, None, :]) ** 2
    kink = off * share[:, :, None] * share[:, None, :]
    other = (share[:, :, None] - share[:, None, :]) ** 2 / 4
    cost = np.einsum("k,kij->ij", np.abs(along), kink + other)
    width = np.asarray(widths)
    return np.where(width[:, None] == width, cost, np.inf)
