"""Printable lines along the families of a relaxed design."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import Bools, Floats, Ints, checked_axes, require_kind
from toros_fem.design.lines.centre_lines import (
    CentreLine,
    LinesOfFamily,
    Stripes,
    Waves,
    find_stripes,
    fitting_spacing,
    trace,
)
from toros_fem.design.lines.ends import close_ends
from toros_fem.design.lines.field import (
    Complexes,
    LineField,
    LineMesh,
    LineOptions,
    Values,
    in_plane,
    make_line_mesh,
)
from toros_fem.design.lines.laid_lines import LaidLines, kept_width, with_regions
from toros_fem.meshes.pattern import Pattern, mirrored, plane_border
from toros_fem.meshes.transfer import refine
from toros_fem.meshes.triangles import equilateral_edge, half_edges

# Edges of the mesh that lines are laid on are at most this fraction of the least spacing, but it
# has at most so many triangles.
FINE = 0.4
MOST_TRIANGLES = 60_000
# Distance over which spacings are adapted to directions, as a multiple of `LineOptions.even`.
ALONG = 2.0
# If only so many ends of lines lie in the open, other spacings may do without: with how many more
# lines across the skin.
FEW = 4
OTHERS = (0.5, -0.5, 1.0, -1.0, 1.5, -1.5)
# Stiffness of the lines, as a multiple of their spacing.
STIFF = 0.3


def lay_lines(
    field: LineField,
    options: LineOptions | None = None,
    *,
    printed: Bools | None = None,
    planes: Sequence[int] = (),
    like: LaidLines | None = None,
) -> LaidLines:
    """Lay lines of printable width along the families of a field.

    All is done on one rank: under MPI, call it on the first one (`on_first_rank`).

    Args:
        field: Shares and directions.
        options: Widths and limits.
        printed: Triangles of the field's pattern that are printed all over, (t,). They carry no
            lines, and lines may end at them.
        planes: Symmetry planes at which the pattern is cut, as of `mirrored`.
        like: Lines that were laid on the same pattern before, for a field that was little
            different: their number stays, and widths take up changes of the shares.

    Raises:
        ParameterError: `printed` does not fit the pattern, or the options the field.
        PatternError: The skin is moulded.
    """
    require_kind("field", field, LineField, "a LineField")
    require_kind("options", options, (LineOptions, type(None)), "LineOptions, or None")
    require_kind("like", like, (LaidLines, type(None)), "LaidLines, or None")
    planes = checked_axes("planes", planes)
    field.pattern.require_flat_panels("laying lines")
    options = options or LineOptions()
    count = len(field.pattern.panel)
    covered = np.zeros(count, bool) if printed is None else np.asarray(printed)
    if covered.shape != (count,) or covered.dtype != np.bool_:
        raise ParameterError(
            f"printed has shape {covered.shape} and type {covered.dtype}; it must be {count} "
            "truth values, one for each triangle."
        )
    areas = field.pattern.areas * ~covered
    means = areas @ field.shares / max(areas.sum(), np.finfo(float).tiny)
    widths = [options.width_of(k, field.families, float(mean)) for k, mean in enumerate(means)]
    fine, cell = _fine(field, widths, options, like)
    field = LineField(fine, field.shares[cell], field.angles[cell])
    active = ~covered[cell]
    if active.any():
        symmetry = make_symmetry(field, active, planes, widths)
        mesh = symmetry.part
        families, stripes = _families(symmetry, field, planes, widths, options, like)
    else:
        mesh, stripes, none = make_line_mesh(fine, active), {}, np.empty(0)
        families = [LinesOfFamily(width, [], none, none, none, (0.0, none)) for width in widths]
    still = np.zeros(mesh.size, dtype=np.complex128)
    return with_regions(LaidLines(mesh, tuple(families), stripes, planes, options, still))


def _families(
    symmetry: Symmetry,
    field: LineField,
    planes: tuple[int, ...],
    widths: Sequence[float],
    options: LineOptions,
    like: LaidLines | None,
) -> tuple[list[LinesOfFamily], dict[int, Stripes]]:
    """Return the families of lines on the part, and the stripes of those found on the whole."""
    mesh, smoother = symmetry.part, cache(symmetry.whole.smoother)
    known = {} if like is None else like.stripes

    @cache
    def on_whole(family: int) -> tuple[LinesOfFamily, Stripes]:
        width, earlier = widths[family], known.get(family)
        return _on_whole(symmetry, field, family, width, options, smoother, earlier)

    first = [symmetry.first(k) for k in range(field.families)]
    open_ = [symmetry.to_part(on_whole(family)[0], image) for family, image in first]
    shares = mesh.areas @ field.shares[mesh.cells] / mesh.areas.sum()
    families = [
        replace(family, share=float(share))
        for family, share in zip(close_ends(mesh, open_, planes), shares, strict=True)
    ]
    return families, {family: on_whole(family)[1] for family, _ in first}


def _fine(
    field: LineField, widths: list[float], options: LineOptions, like: LaidLines | None
) -> tuple[Pattern, Ints]:
    """Return a mesh that is fine enough for the lines, and the field's triangle of each of its.

    It is as fine as that of earlier lines.
    """
    pattern = field.pattern
    cell: Ints = np.arange(len(pattern.panel))
    means = np.average(field.shares, axis=0, weights=pattern.areas)
    least = min(_spacing(share, width, options) for share, width in zip(means, widths, strict=True))
    while 4 * len(pattern.panel) <= MOST_TRIANGLES:
        edge = equilateral_edge(float(np.median(pattern.areas)))
        if edge <= FINE * least if like is None else len(pattern.panel) >= len(like.pattern.panel):
            break
        refined = refine(pattern)
        pattern, cell = refined.pattern, cell[refined.cell]
    return pattern, cell


def _spacing(share: Floats, width: float, options: LineOptions) -> Floats:
    """Return the distance in m between lines of a width that cover a share."""
    most = width / (width + kept_width(options.print_width))
    return np.asarray(width / np.clip(share, options.least_share, most))


def _on_whole(
    symmetry: Symmetry,
    field: LineField,
    family: int,
    width: float,
    options: LineOptions,
    smoother: Callable[..., Callable[[Values], Values]],
    like: Stripes | None,
) -> tuple[LinesOfFamily, Stripes]:
    """Return a family of lines on the whole, and its stripes; like earlier ones if there are any.

    The smoother is that of the whole; it keeps its factors.
    """
    mesh, part = symmetry.whole, symmetry.part.cells
    share = symmetry.of_whole(field.shares[part], family)
    angle = symmetry.angles_of_whole(field.angles[part], family)
    at_vertices = mesh.at_vertices(share)
    even, half, most = options.even, None, 1.0
    if even is not None:  # what changes from one line to the next cannot be followed
        mean_share = np.asarray(np.average(at_vertices, weights=mesh.vertex_areas))
        even = max(even, float(_spacing(mean_share, width, options)))
        # The other half of the spread is for widths that follow the share.
        half, most = even / 2, float(np.sqrt(options.spread))
    double = smoother(half, turned=True)(mesh.double_angles(angle, share))
    local, mean = smoother(half)(at_vertices), smoother(even)(at_vertices)
    number = np.asarray(2 * np.pi / _spacing(mean, width, options), dtype=np.float64)
    waves = Waves(mesh, np.angle(double) / 2, number)
    weight = np.maximum(mean, options.least_share)
    if even is not None:
        waves = fitting_spacing(waves, weight, ALONG * even, options.spread)
    if like is not None:
        waves = replace(waves, number=like.waves.number)
    present = np.min(local[mesh.edges.ends], axis=1) >= options.least_share
    symmetric, side = symmetry.symmetric(waves, family), symmetry.side(waves, family)

    def found(factor: float) -> Stripes:
        tried = replace(waves, number=factor * waves.number)
        return find_stripes(tried, weight, symmetric, side, like)

    stripes = found(1.0)
    if like is None:
        across = np.sqrt(mesh.areas.sum()) / np.average(waves.spacing, weights=weight)
        factors = 1 + np.array(OTHERS) / across
        factors = factors[(factors >= 1 / most) & (factors <= most)]
        stripes = _with_fewest_ends(stripes, map(found, factors), present)
    waves = stripes.waves
    stiffness = STIFF * float(np.average(waves.spacing, weights=mesh.vertex_areas))
    lines = trace(stripes, present, stiffness)
    # The true spacing: the phase grows faster or slower than wanted where lines close in a ring.
    products = stripes.change * stripes.wanted, stripes.wanted**2
    top, bottom = (smoother(even)(mesh.around(each)) for each in products)
    spacing = 2 * np.pi / (waves.number * np.clip(top / bottom, 0.5, 2.0))
    least = kept_width(options.print_width)
    low = max(least, width / options.spread)
    high = np.maximum(low, np.minimum(width * options.spread, spacing - least))
    radius, bounds = np.clip(local * spacing, low, high) / 2, (low / 2, high / 2)
    angles = waves.corner_angles()
    return LinesOfFamily(width, lines, angles, waves.spacing, radius, bounds), stripes


def _with_fewest_ends(best: Stripes, others: Iterator[Stripes], present: Bools) -> Stripes:
    """Return stripes, or others whose lines have fewer ends; these are made as they are needed."""
    fewest = best.line_ends(present)
    while 0 < fewest <= FEW and (other := next(others, None)) is not None:
        ends = other.line_ends(present)
        if ends < fewest:
            best, fewest = other, ends
    return best


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
    """

    part: LineMesh
    whole: LineMesh
    partner: Ints

    def by_image(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return values at corners of the whole, (2^a t, 3), as (2^a, t, 3), as in the part.

        In mirror images, corners follow each other the other way round.
        """
        found = values.reshape(len(self.partner), -1, 3)
        return np.where(self.odd, found[..., ::-1], found)

    @cached_property
    def odd(self) -> Bools:
        """Whether each image is a mirror image, (2^a, 1, 1)."""
        bits = (image.bit_count() for image in range(len(self.partner)))
        return np.array([count % 2 == 1 for count in bits])[:, None, None]

    @cached_property
    def vertex(self) -> Ints:
        """Vertex of the whole at each corner of each image, (2^a, t, 3)."""
        return self.by_image(self.whole.vertex)

    @cached_property
    def places(self) -> Complexes:
        """Each corner of each image, (2^a, t, 3)."""
        return self.by_image(self.whole.flat)

    @cached_property
    def turn(self) -> Floats:
        """Angle that is added to directions of the part in each image, (2^a, t, 1).

        In mirror images it is added to minus the direction.
        """
        side = self.places[..., 1:2] - self.places[..., :1]
        return np.asarray(np.angle(side / np.where(self.odd, np.conj(side[0]), side[0])))

    @property
    def sign(self) -> Floats:
        """Minus 1 for mirror images, (2^a, 1, 1)."""
        return np.where(self.odd, -1.0, 1.0)

    def first(self, family: int) -> tuple[int, int]:
        """Return a family of the part and the image where it goes on as the given one.

        Of all families and images that would do, the first: lines need be found only once.
        """
        families, images = np.nonzero(np.equal(self.partner.T, family))
        return int(families[0]), int(images[0])

    def of_whole(self, values: Floats, family: int) -> Floats:
        """Return values of a family's triangles on the whole, from those of the part, (t, K)."""
        return values.T[self.partner[:, family]].ravel()

    def angles_of_whole(self, angles: Floats, family: int) -> Floats:
        """Return a family's directions on the whole, from those of the part, (t, K), in rad."""
        own = angles.T[self.partner[:, family], :, None]
        return (self.sign * own + self.turn).ravel()

    def angles_of_part(self, angles: Floats) -> Floats:
        """Return directions at the whole's corners, (2^a t, 3), in the part's charts, by image."""
        return self.sign * (self.by_image(angles) - self.turn)

    def symmetric(self, waves: Waves, family: int) -> Callable[[Complexes], Complexes]:
        """Return what averages exp(i phase) at vertices, (n,), over the images of a family."""
        images, angle = [], self.angles_of_part(waves.corner_angles())
        for image in np.flatnonzero(self.partner[:, family] == family)[1:]:
            moved = np.arange(len(angle)) ^ image
            vertex, flips = np.empty(self.whole.size, np.int64), np.empty(self.whole.size, bool)
            vertex[self.vertex] = self.vertex[moved]
            # The normal of a line turns against its direction in a mirror.
            flips[self.vertex] = (np.cos(angle[moved] - angle) < 0) != self.odd[image]
            images.append((vertex, flips))

        def mean(z: Complexes) -> Complexes:
            moved = (np.where(flips, np.conj(z[k]), z[k]) for k, flips in images)
            return np.asarray(sum(moved, z) / (1 + len(images)))

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

    def to_part(self, family: LinesOfFamily, image: int) -> LinesOfFamily:
        """Return a family of the part from lines of the whole in an image."""

        def moved(values: Floats) -> Floats:
            found = np.empty(self.part.size)
            found[self.part.vertex] = values[self.vertex[image]]
            return found

        least, largest = family.bounds
        lines = [piece for line in family.lines for piece in self._pieces(line, image)]
        angles = self.angles_of_part(family.angles)[image]
        spacing, radius, largest = map(moved, (family.spacing, family.radius, largest))
        return LinesOfFamily(family.width, lines, angles, spacing, radius, (least, largest))

    def _pieces(self, line: CentreLine, image: int) -> list[CentreLine]:
        """Return the pieces of a line in an image, moved to the part."""
        inside, cells = np.divmod(line.cell, len(self.part.cells))
        inside = inside == image
        away = line.places - self.places[image, cells, :1]
        away = away * np.exp(-1j * self.turn[image, cells])
        places = self.places[0, cells, :1] + (np.conj(away) if self.odd[image] else away)
        if inside.all():
            return [CentreLine(cells, places, line.ends)]
        if line.closed:
            begin = -int(np.argmin(inside))
            inside, cells, places = (np.roll(x, begin, axis=0) for x in (inside, cells, places))
        change = np.flatnonzero(np.diff(inside.astype(int), prepend=0, append=0))
        return [CentreLine(cells[a:b], places[a:b]) for a, b in change.reshape(-1, 2)]


def make_symmetry(
    field: LineField, active: Bools, planes: Sequence[int], widths: Sequence[float]
) -> Symmetry:
    """Return how families of lines go on across symmetry planes.

    Families of the same width are paired so that their directions and shares fit at the planes,
    at which the part is cut as of `mirrored`. Triangles that may carry lines are `active`.
    """
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

    pairings = [[pairs[k] for k in own] for pairs in _pairings(list(own))]
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


def _pairings(left: list[int]) -> Iterator[dict[int, int]]:
    """Yield all ways to pair items with each other or with themselves."""
    if not left:
        yield {}
    for other in left:
        for found in _pairings([k for k in left[1:] if k != other]):
            yield {**found, left[0]: other, other: left[0]}


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
