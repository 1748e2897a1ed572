"""What is marked on panels: seam lines, labels with their places, and marks along seams."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.validation import Floats, Ints, require_kind
from toros_fem.meshes.panels import Affine
from toros_fem.meshes.pattern import Pattern

# Number of places that are tried along the longer side of a region.
INSIDE = 48
# Length and width in m.
Size = tuple[float, float]
# Width of a letter, and of the rectangle that stays free above and below, over its height.
LETTER, LINE = 0.85, 1.3
# Heights of texts in the allowance, over its width, and in m elsewhere.
HEIGHTS = (0.55, 0.45, 0.35)
ELSEWHERE = (4e-3, 3e-3, 2e-3, 1.5e-3)
# Largest distance in m of the numbers along one seam.
DISTANCE = 80e-3
# Steepest direction of writing downwards, in rad: a small tilt shall not turn a text.
TILT = np.radians(89.0)
# Number of places that are tried along a seam.
PLACES = 200
# Depth of a notch, over the allowance.
DEPTH = 0.5
# The double notch at the start of a seam, over the distance of notches: place and width.
START, PAIR = 0.35, 0.1
# Largest distance in m of its two notches.
APART = 3e-3
# Lengths in m of the grain arrow, the first that fits; its width over its length, and the least.
ARROWS = (30e-3, 20e-3, 15e-3, 10e-3, 7e-3, 5e-3)
BARB = 0.12
# Gap in m between marks and other things.
CLEAR = 0.5e-3
# The ruler: length and distance of ticks; heights of ticks, of its text and of the whole, in m.
RULER, STEP = 0.1, 0.01
TICK, TEXT, HEIGHT = 2e-3, 2.5e-3, 7e-3
# Distance in m of the places that are tried.
TRIED = 4e-3


@dataclass(frozen=True, eq=False)
class SewnSeam:
    """A seam: two lines of flat points, vertex by vertex sewn together.

    The first line runs counter-clockwise along its panel, the second clockwise along its own.

    Attributes:
        number: Number of the seam, from 1.
        panels: Numbers of both panels; equal where a panel is sewn to itself.
        lines: Flat points of both lines, (2, n, 2), in m.
    """

    number: int
    panels: tuple[int, int]
    lines: Floats

    @property
    def arc(self) -> Floats:
        """Arc length at each vertex in m, (n,): the mean of both sides, so the same for both."""
        steps = np.linalg.norm(np.diff(self.lines, axis=1), axis=2).mean(axis=0)
        return np.concatenate([[0.0], np.cumsum(steps)])

    @property
    def length(self) -> float:
        """Length in m."""
        return float(self.arc[-1])

    def at(self, side: int, arc: Floats) -> Floats:
        """Return the points of one side at arc lengths (k,) in m, (k, 2)."""
        x, y = (np.interp(arc, self.arc, self.lines[side, :, axis]) for axis in (0, 1))
        return np.column_stack([x, y])

    def outward(self, side: int, arc: Floats, reach: float) -> Floats:
        """Return unit vectors across one side, out of its panel, at arc lengths (k,) in m, (k, 2).

        The direction of the line is taken over a reach in m: steps of the mesh do not turn it.
        """
        begin, end = np.maximum(arc - reach / 2, 0), np.minimum(arc + reach / 2, self.length)
        along = self.at(side, end) - self.at(side, begin)
        # A panel lies on the left of the first line, and on the right of the second.
        normal = np.column_stack([along[:, 1], -along[:, 0]]) * (1.0 if side == 0 else -1.0)
        return np.asarray(normal / np.linalg.norm(normal, axis=1)[:, None])


def sewn_seams(pattern: Pattern) -> list[SewnSeam]:
    """Return the seams of a pattern of flat panels, numbered from 1 by their panels.

    A seam ends where other seams or a free border meet it, or at the tip of a dart. One that closes
    on itself starts at its lowest point on the first panel.

    Raises:
        ParameterError: The pattern is something else.
        PatternError: The skin is moulded.
    """
    require_kind("pattern", pattern, Pattern, "a Pattern, by meshes.cylinder for instance")
    pattern.require_flat_panels("a seam line")
    point_panel, found = pattern.panel_of_point, []
    for chain in _chains(pattern):
        one, two = chain.T
        panels = int(point_panel[one[0]]), int(point_panel[two[0]])
        centre = pattern.flat_points[chain].mean(axis=0)
        if (panels[0], *centre[0]) > (panels[1], *centre[1]):
            one, two, panels = two[::-1], one[::-1], panels[::-1]
        if one[0] == one[-1] and two[0] == two[-1]:
            x, y = pattern.flat_points[one[:-1]].T
            turn = int(np.lexsort([x, y.round(9)])[0])
            one, two = (np.append(np.roll(ring[:-1], -turn), ring[turn]) for ring in (one, two))
        lines = pattern.flat_points[np.stack([one, two])]
        found.append((panels, tuple(lines.mean(axis=(0, 1)).round(9)), lines))
    found.sort(key=lambda seam: seam[:2])
    return [SewnSeam(number, panels, lines) for number, (panels, _, lines) in enumerate(found, 1)]


def edges_of(seams: Sequence[SewnSeam], panel: int) -> list[tuple[SewnSeam, int]]:
    """Return the seams of a panel, with the side of each that it is."""
    return [(seam, side) for seam in seams for side in (0, 1) if seam.panels[side] == panel]


def _chains(pattern: Pattern) -> list[Ints]:
    """Return runs of seam edges as pairs of flat points, (n, 2), the first counter-clockwise."""
    edges = np.swapaxes(pattern.seams, 1, 2)  # by edge, end and side
    vertex = pattern.sewn[edges[..., 0]]
    passed = np.bincount(vertex.ravel(), minlength=len(pattern.points)) == 2
    passed[pattern.free_edges] = False
    joints: dict[frozenset[int], list[tuple[int, int]]] = defaultdict(list)
    for edge, end in zip(*np.nonzero(passed[vertex]), strict=True):
        joints[frozenset(edges[edge, end].tolist())].append((int(edge), int(end)))
    left = set(range(len(edges)))

    def run(edge: int, end: int) -> list[Ints]:
        """Return the pairs from the end of an edge on, as far as its seam goes."""
        pairs = [edges[edge, end]]
        while True:
            joint = joints[frozenset(pairs[-1].tolist())]
            onward = [(other, near) for other, near in joint if other in left]
            if not onward:
                return pairs
            edge, near = onward[0]
            left.discard(edge)
            far = edges[edge, 1 - near]
            pairs.append(far if edges[edge, near, 0] == pairs[-1][0] else far[::-1])

    chains = []
    for start in range(len(edges)):
        if start in left:
            left.discard(start)
            forward = run(start, 1)
            chains.append(np.array(run(start, 0)[::-1] + forward))
    return chains


def rectangles(centres: Floats, size: Size, angle: float | Floats) -> np.ndarray:
    """Return rectangles around points (k, 2), turned by an angle in rad, as polygons."""
    angle = np.broadcast_to(angle, len(centres))
    along = np.column_stack([np.cos(angle), np.sin(angle)]) * size[0] / 2
    aside = np.column_stack([-np.sin(angle), np.cos(angle)]) * size[1] / 2
    corners = [centres + s * along + t * aside for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return np.asarray(shapely.polygons(np.stack(corners, axis=1)))


def first_fit(
    region: BaseGeometry, centres: Floats, angles: float | Floats, sizes: Iterable[Size]
) -> tuple[int, Size] | None:
    """Return the first place where the first size that fits anywhere lies in a region.

    Places (k, 2) and sizes are given the best first, with the angle in rad of the length, one for
    all or one for each place. Returned are the number of the place and the size; None without room.
    """
    shapely.prepare(region)
    for size in sizes:
        fits = shapely.contains(region, rectangles(centres, size, angles))
        if fits.any():
            return int(np.argmax(fits)), size
    return None


def places_in(region: BaseGeometry) -> Floats:
    """Return places in a region, (k, 2), the nearest to its middle first."""
    if region.is_empty:
        return np.empty((0, 2))
    left, low, right, high = region.bounds
    step = max(right - left, high - low) / INSIDE
    x, y = np.meshgrid(
        np.arange(left + step / 2, right, step), np.arange(low + step / 2, high, step)
    )
    places = np.column_stack([x.ravel(), y.ravel()])
    shapely.prepare(region)
    places = places[shapely.contains_xy(region, places)]
    far = np.linalg.norm(places - np.array([left + right, low + high]) / 2, axis=1)
    return places[np.argsort(far, kind="stable")]


@dataclass(frozen=True, eq=False)
class Label:
    """A text on a panel: its centre, (2,), in m, direction in rad, and height of capitals in m."""

    text: str
    place: Floats
    angle: float
    height: float

    @property
    def frame(self) -> BaseGeometry:
        """Rectangle around the text."""
        return rectangles(self.place[None], text_size(self.text, self.height), self.angle)[0]

    def moved(self, place: Affine) -> Label:
        """Return the text after a rotation; one that would stand upside down turns over."""
        angle = float(upright(self.angle + place.angle))
        return replace(self, place=place.points(self.place), angle=angle)


def text_size(text: str, height: float) -> Size:
    """Return width and height in m of the room that a text needs."""
    return LETTER * height * len(text), LINE * height


def edge_labels(seam: SewnSeam, side: int, free: BaseGeometry, allowance: float) -> list[Label]:
    """Return the number of a seam once for every 80 mm beside its edge, where there is room.

    It stands at least once, at the middle of a short seam even where that is not free.
    """
    text, length = str(seam.number), seam.length
    places, angles, arc = _beside(seam, side, allowance)
    heights = [share * allowance for share in HEIGHTS]
    count = max(1, round(length / DISTANCE))
    found = []
    for k in range(count):
        away = np.abs(arc - (k + 0.5) * length / count).round(9)  # so that rounding picks none
        near = np.argsort(away, kind="stable")
        near = near[away[near] <= length / count / 2]
        label = _first(text, places[near], angles[near], free, heights)
        if label is not None:
            found.append(label)
            free = free.difference(label.frame)
    middle = PLACES // 2
    return found or [Label(text, places[middle], float(angles[middle]), heights[-1])]


def panel_label(
    texts: Sequence[str],
    edges: Sequence[tuple[SewnSeam, int]],
    band: BaseGeometry,
    fabric: BaseGeometry,
    panel: BaseGeometry,
    allowance: float | None,
) -> Label:
    """Return a text beside an edge of a panel, or inside of it where no edge is long enough.

    `texts` are its wordings, the best first. `band`, the allowance, and `fabric`, which is not
    printed, are where nothing else is. Without room the shortest wording stands on the panel.
    """
    inside = places_in(fabric)
    for text in texts:
        if allowance is not None and edges:
            tried = [_beside(*edge, allowance) for edge in edges]
            places, angles = (np.concatenate([t[i] for t in tried]) for i in (0, 1))
            label = _first(text, places, angles, band, [share * allowance for share in HEIGHTS])
            if label is not None:
                return label
        label = _first(text, inside, np.zeros(len(inside)), fabric, ELSEWHERE)
        if label is not None:
            return label
    middle = shapely.get_coordinates(panel.representative_point())[0]
    return Label(texts[-1], middle, 0.0, ELSEWHERE[-1])


def upright(angle: Floats | float) -> Floats:
    """Return the direction in rad in which a text along a line is read from below or the right."""
    return np.asarray(np.mod(angle + TILT, np.pi) - TILT)


def _beside(seam: SewnSeam, side: int, allowance: float) -> tuple[Floats, Floats, Floats]:
    """Return places in the middle of an allowance, directions of writing, and arc lengths."""
    arc = (np.arange(PLACES) + 0.5) * seam.length / PLACES
    outward = seam.outward(side, arc, 1e-6 * seam.length)
    angles = upright(np.arctan2(outward[:, 1], outward[:, 0]) + np.pi / 2)
    return seam.at(side, arc) + outward * allowance / 2, angles, arc


def _first(
    text: str, places: Floats, angles: Floats, free: BaseGeometry, heights: Sequence[float]
) -> Label | None:
    """Return the text at the first place that is free, as high as possible."""
    found = first_fit(free, places, angles, (text_size(text, height) for height in heights))
    if found is None:
        return None
    k, (_, high) = found
    return Label(text, places[k], float(angles[k]), high / LINE)


def notch_arcs(length: float, distance: float) -> Floats:
    """Return the places of notches along a seam as arc lengths in m, (k,).

    Single ones divide the seam evenly, at the distance in m at most. A double one stands near its
    start only, so that neither the direction of an edge nor its partner can be mistaken.
    """
    count = max(1, int(np.ceil(length / distance - 1e-9)))
    step = length / count
    start, half = START * step, min(PAIR * step, APART) / 2
    return np.array([start - half, start + half, *(step * np.arange(1, count))])


def notches(
    seam: SewnSeam, side: int, cut: BaseGeometry, allowance: float, distance: float
) -> Floats:
    """Return the notches at one side of a seam, segments (k, 2, 2) in m, from the cut inwards.

    They end half an allowance before the seam line. Both sides have theirs at the same arc lengths.
    """
    arc = notch_arcs(seam.length, distance)
    normal = seam.outward(side, arc, min(allowance, 0.2 * seam.length))
    foot = seam.at(side, arc)
    rays = shapely.linestrings(np.stack([foot, foot + 2 * allowance * normal], axis=1))
    points, border = shapely.points(foot), cut.boundary
    hit = shapely.shortest_line(points, shapely.intersection(rays, border))
    # A ray that misses the border, which has no length, or meets it at once is not followed.
    far = shapely.length(hit) >= DEPTH * allowance / 2
    hit = np.where(far, hit, shapely.shortest_line(points, border))
    inner, outer = np.moveaxis(shapely.get_coordinates(hit).reshape(-1, 2, 2), 1, 0)
    depth = np.minimum(1.0, DEPTH * allowance / np.maximum(shapely.length(hit), 1e-12))
    return np.stack([outer, outer + depth[:, None] * (inner - outer)], axis=1)


def crosses(outline: BaseGeometry, cut: BaseGeometry, size: float) -> Floats:
    """Return the centres of three registration crosses, (3, 2), of a size in m.

    They stand in corners of the cut outline's bounding box: far apart, so that they measure angles
    well, and off the skin. In a rectangle with an allowance they lie in the corners of the
    allowance, hidden by the sewing; beside a round panel on waste. Where the skin itself, inside
    its seam line, fills a corner they move outwards. The fourth corner has none, so that no half
    turn fits.
    """
    left, low, right, high = cut.bounds
    half = size / 2
    inset = half + CLEAR
    centres = []
    for x, y, outward in ((left, low, (-1, -1)), (right, low, (1, -1)), (left, high, (-1, 1))):
        out = np.array(outward, dtype=np.float64)
        centre = np.array([x, y]) - inset * out
        for _ in range(20):
            # Within the cut it must not meet the skin, outside of it it must not be cut.
            place = shapely.box(*(centre - half), *(centre + half))
            apart = place.intersection(outline).area < 1e-6 * size**2
            if apart and (cut.contains(place) or not cut.intersects(place)):
                break
            centre = centre + 0.25 * half * out
        centres.append(centre)
    return np.array(centres)


def cross_shapes(centres: Floats, size: float) -> list[Floats]:
    """Return the two bars of each cross as segments, (2, 2) in m each."""
    x, y = np.array([size / 2, 0.0]), np.array([0.0, size / 2])
    return [np.stack([c - d, c + d]) for c in centres for d in (x, y)]


def grain_arrow(places: Sequence[BaseGeometry], angle: float) -> list[Floats]:
    """Return the arrow along the grain, at an angle in rad, as lines (n, 2) in m: shaft and head.

    It lies in the first region that has room; without any it lies across the last one.
    """
    sizes = [(length, max(2 * BARB * length, 2e-3)) for length in ARROWS]
    centre, length = shapely.get_coordinates(places[-1].representative_point())[0], ARROWS[-1]
    for place in places:
        tried = places_in(place)
        found = first_fit(place, tried, angle, sizes)
        if found is not None:
            centre, (length, _) = tried[found[0]], found[1]
            break
    along = np.array([np.cos(angle), np.sin(angle)])
    aside = np.array([-along[1], along[0]])
    tail, tip = centre - along * length / 2, centre + along * length / 2
    head = [tip - length * (2 * BARB * along + side * BARB * aside) for side in (1, -1)]
    return [np.stack([tail, tip]), np.stack([head[0], tip, head[1]])]


def ruler(taken: BaseGeometry, sheet: tuple[float, float]) -> tuple[list[Floats], Label]:
    """Return the lines of a ruler of 100 mm, to check the scale of a sheet by, and its text.

    The first line, (n, 2) in m each, is 100 mm long, the others are ticks every 10 mm. They are at
    the lowest place that is not taken, upright where no level one is free, and below the sheet
    without any place.
    """
    free = shapely.box(2 * CLEAR, 2 * CLEAR, sheet[0] - 2 * CLEAR, sheet[1] - 2 * CLEAR)
    free = free.difference(taken.buffer(2 * CLEAR)).buffer(1e-6)
    size = RULER + 4 * CLEAR, HEIGHT
    for angle in (0.0, np.pi / 2):
        wide, high = size if angle == 0 else size[::-1]
        x = np.arange(2 * CLEAR + wide / 2, sheet[0], TRIED)
        for y in np.arange(2 * CLEAR + high / 2, sheet[1], TRIED):
            centres = np.column_stack([x, np.full(len(x), y)])
            found = first_fit(free, centres, angle, [size])
            if found is not None:
                return _ruler_at(Affine.turn(angle, centres[found[0]]))
    below = [2 * CLEAR + size[0] / 2, -2 * CLEAR - HEIGHT / 2]
    return _ruler_at(Affine.shift(below))


def _ruler_at(place: Affine) -> tuple[list[Floats], Label]:
    base = -HEIGHT / 2 + CLEAR
    ticks = np.arange(0, RULER + STEP / 2, STEP) - RULER / 2
    lines = [np.array([[-RULER / 2, base], [RULER / 2, base]])]
    lines += [np.array([[x, base], [x, base + TICK]]) for x in ticks]
    middle = place.points([0.0, base + TICK + CLEAR + TEXT / 2])
    label = Label(f"{1e3 * RULER:.0f} mm", middle, place.angle, TEXT)
    return [place.points(line) for line in lines], label
