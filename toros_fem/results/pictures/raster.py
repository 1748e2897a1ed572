"""Shaded pictures of skins in space, by a depth buffer.

Each pixel looks up the print in the flat panel, so that borders are as smooth as the print's own,
and surfaces that cross each other are right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from PIL import Image as Bitmap
from PIL import ImageDraw
from shapely import get_coordinates, get_parts
from shapely.geometry.base import BaseGeometry

from toros_fem.base.validation import Bools, Floats, Ints
from toros_fem.meshes.pattern import Pattern, Regions
from toros_fem.meshes.triangles import cross, normals
from toros_fem.meshes.triangles import normals as surface_normals
from toros_fem.results.pictures.style import FABRIC, PRINT, SILHOUETTE

# Turns about z that are tried for the side view, and for the oblique one beside it, in degrees.
# The latter is from the same side, so that both views are seen to be of one body.
SIDE_TURNS, OBLIQUE_TURNS = range(0, 180, 15), (-60, -45, -30, 30, 45, 60)
# Elevation of the oblique view in degrees.
ABOVE = 20.0
# The side view is turned only where the points spread this many times further by it.
WIDER = 1.1
# Weight of bare fabric beside print, where a view is judged by what it shows.
BARE = 0.3
# Directions to the light, from upper left, and to a weaker one, with what each adds to the shade.
LIGHT = np.array([-0.40, 0.54, 0.74])
FILL = np.array([0.74, -0.25, 0.62])
SHADE, LIT, FILLED = 0.55, 0.45, 0.10
# Brightness of the inside of an open skin.
INSIDE = 0.75
# Edges whose triangles differ by more than this, in degrees, stay sharp.
CREASE = 50.0
# Pixels are computed with this many in each direction.
SAMPLES = 2
# Depth over the size of the surface by which two neighbours differ at a silhouette.
STEP = 0.02
# Width of a silhouette in pixels of the picture.
LINE = 1.0
# Empty border of a window over its size.
MARGIN = 0.04
# Texels along the longest side of the panels.
TEXELS = 4096
# Fragments that are computed at once: so few that their arrays stay in the processor's cache.
CHUNK = 100_000


@dataclass(frozen=True)
class View:
    """Orthographic view; at (0, 0) the viewer looks along +y, with x to the right and z upwards.

    Attributes:
        elevation: Angle in degrees by which the viewer is above the x-y plane.
        turn: Angle in degrees by which the viewer is turned about z.
    """

    elevation: float = 0.0
    turn: float = 0.0

    @property
    def directions(self) -> Floats:
        """Unit vectors to the right, upwards and towards the viewer, as rows."""
        e, t = np.radians([self.elevation, self.turn])
        right = np.array([np.cos(t), np.sin(t), 0])
        toward = np.array([np.sin(t) * np.cos(e), -np.cos(t) * np.cos(e), np.sin(e)])
        return np.stack([right, np.cross(toward, right), toward])

    def project(self, points: Floats) -> Floats:
        """Return the coordinates (…, 2) of points (…, 3) on the picture."""
        return np.asarray(points @ self.directions[:2].T)

    def depth(self, points: Floats) -> Floats:
        """Return how far points (…, 3) lie towards the viewer, (…,)."""
        return np.asarray(points @ self.directions[2])


def side_view(points: Floats) -> View:
    """Return the horizontal view that spreads the points (n, 3), in m, of a shape most.

    It looks across the plane of a bent tube. A shape whose points spread about as much from
    everywhere, as those of equal legs do, is seen along y.
    """
    views = [View(0.0, float(turn)) for turn in SIDE_TURNS]
    widths = [float(np.std(view.project(points)[:, 0])) for view in views]
    best = int(np.argmax(widths))
    return views[best] if widths[best] > WIDER * widths[0] else views[0]


def oblique_view(triangles: Ints, points: Floats, print_share: Floats, side: View) -> View:
    """Return the view from above that shows most of the shape and of its print.

    It is turned against the side view, so that both together tell the shape. That a part of the
    skin may hide another is not considered. The share is the printed part of each triangle, (t,).
    """
    areas, weights = normals(points, triangles) / 2, BARE + print_share

    def score(view: View) -> float:
        seen = np.maximum(areas @ view.directions[2], 0) @ weights
        return float(seen * np.sqrt(np.prod(np.ptp(view.project(points), axis=0))))

    return max((View(ABOVE, side.turn + turn) for turn in OBLIQUE_TURNS), key=score)


@dataclass(frozen=True, eq=False)
class Ink:
    """The print of a pattern as a bitmap of each panel.

    Attributes:
        corners: Flat corners of the triangles, (t, 3, 2), in m.
        panel: Panel of each triangle, (t,).
        bitmaps: For each panel its lower left corner in m, texels per m, and the bitmap.
    """

    corners: Floats
    panel: Ints
    bitmaps: Sequence[tuple[Floats, float, Bools]]

    def at(self, triangles: Ints, weights: Floats) -> Bools:
        """Return whether points of triangles, by barycentric coordinates (k, 3), are printed."""
        flat = np.einsum("ki,kic->kc", weights, self.corners[triangles])
        panel, found = self.panel[triangles], np.zeros(len(triangles), dtype=bool)
        for number, (low, scale, bitmap) in enumerate(self.bitmaps):
            here = np.flatnonzero(panel == number)
            column, row = ((flat[here] - low) * scale).astype(np.intp).T
            rows, columns = bitmap.shape
            found[here] = bitmap[row.clip(0, rows - 1), column.clip(0, columns - 1)]
        return found


def ink_of(pattern: Pattern, regions: Regions) -> Ink:
    """Return the print of a pattern, to draw with."""
    bitmaps = []
    for number, region in enumerate(regions):
        flat = pattern.corners[pattern.panel == number].reshape(-1, 2)
        low, size = flat.min(axis=0), np.ptp(flat, axis=0)
        scale = TEXELS / float(size.max())
        width, height = np.ceil(size * scale).astype(int) + 1
        bitmaps.append((low, scale, _filled(region, low, scale, (int(width), int(height)))))
    return Ink(pattern.corners, pattern.panel, bitmaps)


def _filled(region: BaseGeometry, low: Floats, scale: float, size: tuple[int, int]) -> Bools:
    bitmap = Bitmap.new("1", size)
    draw = ImageDraw.Draw(bitmap)
    for polygon in get_parts(region):
        if polygon.is_empty:
            continue
        for ring, inside in ((polygon.exterior, 1), *((hole, 0) for hole in polygon.interiors)):
            corners = (get_coordinates(ring) - low) * scale - 0.5
            draw.polygon([tuple(corner) for corner in corners], fill=inside)
    return np.asarray(bitmap)


@dataclass(frozen=True, eq=False)
class DrawnSurface:
    """Triangles in space, (t, 3), counter-clockwise from outside, with a colour.

    Attributes:
        points: Positions of all vertices, (n, 3), in m.
        colour: Red, green and blue from 0 to 1: of all, (3,), of each triangle, (t, 3), or of each
            corner, (t, 3, 3).
        contrast: Part of the light's effect that is shown: less where colours are data.
        ink_shade: Factor on the colours of the print; None gives it its own colour.
        closed: Whether its inside is never seen, so that it need not be drawn.
    """

    triangles: Ints
    points: Floats
    colour: Floats = field(default_factory=lambda: FABRIC)
    ink: Ink | None = None
    contrast: float = 1.0
    ink_shade: float | None = None
    closed: bool = False


@dataclass(frozen=True)
class Window:
    """Part of the plane of a picture, of its corners (2,) in m, and its size in pixels."""

    low: Floats
    high: Floats
    pixels: tuple[int, int]

    @property
    def scale(self) -> float:
        """Pixels per m."""
        return self.pixels[0] / float(self.high[0] - self.low[0])


@dataclass(frozen=True, eq=False)
class Image:
    """A picture of surfaces, cut to what they cover.

    Attributes:
        colours: Red, green, blue and opacity from 0 to 255, (h, w, 4), the highest row first.
        depth: Depth in m towards the viewer, (h·s, w·s) for s samples; −∞ where nothing is.
    """

    colours: npt.NDArray[np.uint8]
    depth: npt.NDArray[np.float32]
    window: Window


def window_of(points: Floats, aspect: float, width: int) -> Window:
    """Return the window of an aspect, width over height, with points (n, 2) in m in its middle.

    The width is in pixels.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    size = np.maximum(high - low, 1e-6) / (1 - 2 * MARGIN)
    across = max(float(size[0]), float(size[1]) * aspect)
    half = np.array([across, across / aspect]) / 2
    middle = (low + high) / 2
    return Window(middle - half, middle + half, (width, round(width / aspect)))


def render(
    surfaces: Sequence[DrawnSurface], view: View, window: Window, *, cut: bool = True
) -> Image:
    """Return a picture of surfaces, those behind hidden by those before, in a window.

    It is cut to what the surfaces cover, if it may be.
    """
    if cut:
        window = _covered(window, view.project(np.concatenate([s.points for s in surfaces])))
    width, height = SAMPLES * window.pixels[0], SAMPLES * window.pixels[1]
    depth = np.full(width * height, -np.inf, dtype=np.float32)
    colours = np.zeros((width * height, 3), dtype=np.float32)
    for surface in surfaces:
        corners, normals = surface.points[surface.triangles], corner_normals(surface)
        pixels = (view.project(corners) - window.low) * (SAMPLES * window.scale)
        pixels[..., 1] = height - pixels[..., 1]
        away = view.depth(corners)
        for part in _parts(pixels, (width, height), surface.closed):
            place, triangle, weights = _fragments(pixels, part, (width, height))
            here = np.einsum("ki,ki->k", weights, away[triangle]).astype(np.float32)
            nearer = np.flatnonzero(here > depth[place])
            nearer = nearer[np.argsort(here[nearer])]  # of equal places the last one is kept
            depth[place[nearer]] = here[nearer]
            seen = nearer[here[nearer] == depth[place[nearer]]]
            place, triangle, weights = place[seen], triangle[seen], weights[seen]
            normal = np.einsum("ki,kic->kc", weights, normals[triangle])
            shade = 1 + surface.contrast * (_shade(normal, view) - 1)
            colours[place] = _inked(surface, triangle, weights) * shade[:, None]
    buffer, picture = depth.reshape(height, width), colours.reshape(height, width, 3)
    size = max((float(np.ptp(s.points, axis=0).max()) for s in surfaces), default=1.0)
    lines = silhouettes(buffer, STEP * size)
    picture[lines] = SILHOUETTE
    return Image(_reduced(picture, np.isfinite(buffer) | lines), buffer, window)


def _covered(window: Window, points: Floats) -> Window:
    """Return the part of a window, in whole pixels, around points on the picture, (n, 2)."""
    low = np.floor((points.min(axis=0) - window.low) * window.scale).astype(int) - 2
    high = np.ceil((points.max(axis=0) - window.low) * window.scale).astype(int) + 2
    low = np.clip(low, 0, np.array(window.pixels) - 1)
    high = np.clip(high, low + 1, window.pixels)
    across, up = (high - low).tolist()
    corners = window.low + low / window.scale, window.low + high / window.scale
    return Window(*corners, (across, up))


def _parts(pixels: Floats, size: tuple[int, int], closed: bool) -> list[Ints]:
    """Return numbers of the triangles that may be seen, in parts of bounded work."""
    low, high = pixels.min(axis=1), pixels.max(axis=1)
    inside = np.all((high >= 0) & (low < size), axis=1)
    if closed:  # rows go downwards, so that an outside has a negative area
        inside &= cross(pixels[:, 1] - pixels[:, 0], pixels[:, 2] - pixels[:, 0]) < 0
    seen = np.flatnonzero(inside)
    work = np.prod(high[seen] - low[seen] + 2, axis=1).cumsum() // CHUNK
    return np.split(seen, np.flatnonzero(np.diff(work)) + 1) if len(seen) else []


def _fragments(pixels: Floats, triangles: Ints, size: tuple[int, int]) -> tuple[Ints, Ints, Floats]:
    """Return the samples inside triangles: their place, triangle and barycentric coordinates."""
    p = pixels[triangles]
    last = np.array(size) - 1
    low = np.floor(p.min(axis=1)).astype(np.intp).clip(0, last)
    span = np.ceil(p.max(axis=1)).astype(np.intp).clip(0, last) - low + 1
    count = span.prod(axis=1)
    owner = np.repeat(np.arange(len(p)), count)
    number = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    across, down = low[owner, 0] + number % span[owner, 0], low[owner, 1] + number // span[owner, 0]
    a, b, c = np.moveaxis(p, 1, 0)
    area = cross(b - a, c - a)
    area = np.where(area == 0, np.inf, area)
    at = np.stack([across + 0.5, down + 0.5], axis=1)
    second = cross(at - a[owner], (c - a)[owner]) / area[owner]
    third = cross((b - a)[owner], at - a[owner]) / area[owner]
    weights = np.stack([1 - second - third, second, third], axis=1)
    inside = np.all(weights >= -1e-9, axis=1)
    place = down * size[0] + across
    return place[inside], triangles[owner[inside]], weights[inside]


def corner_normals(surface: DrawnSurface) -> Floats:
    """Return the unit normal at each corner of each triangle, (t, 3, 3): smooth but at creases."""
    face = surface_normals(surface.points, surface.triangles)
    vertex = np.zeros_like(surface.points)
    for k in range(3):
        np.add.at(vertex, surface.triangles[:, k], face)
    smooth = _unit(vertex)[surface.triangles]
    face = _unit(face)[:, None]
    sharp = np.einsum("tic,tic->ti", smooth, np.broadcast_to(face, smooth.shape)) < np.cos(
        np.radians(CREASE)
    )
    return np.where(sharp[..., None], face, smooth)


def _unit(vectors: npt.NDArray) -> Floats:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(length, np.finfo(float).tiny))


def _shade(normals: Floats, view: View) -> Floats:
    """Return the brightness of points with these normals, (k, 3); an inside is darker."""
    normals = _unit(normals)
    behind = normals @ view.directions[2] < 0
    normals = np.where(behind[:, None], -normals, normals)
    lit, filled = (np.clip(normals @ (d @ view.directions), 0, 1) for d in (LIGHT, FILL))
    return np.asarray((SHADE + LIT * lit + FILLED * filled) * np.where(behind, INSIDE, 1.0))


def _inked(surface: DrawnSurface, triangles: Ints, weights: Floats) -> Floats:
    """Return the colours of points of a surface, (k, 3), without light."""
    colour = surface.colour
    if colour.ndim == 3:
        colours = np.einsum("ki,kic->kc", weights, colour[triangles])
    else:
        colours = np.array(
            colour[triangles] if colour.ndim == 2 else np.tile(colour, (len(triangles), 1))
        )
    if surface.ink is not None:
        printed, shade = surface.ink.at(triangles, weights), surface.ink_shade
        colours[printed] = PRINT if shade is None else shade * colours[printed]
    return colours


def silhouettes(depth: npt.NDArray[np.float32], step: float) -> Bools:
    """Return where a depth buffer jumps by more than a step, in m, as lines of `LINE` pixels."""
    jumps = np.zeros(depth.shape, dtype=bool)
    near = np.where(np.isfinite(depth), depth, depth[np.isfinite(depth)].min(initial=0.0) - 1.0)
    for found, depths in ((jumps, near), (jumps.T, near.T)):
        far = np.abs(np.diff(depths, axis=0)) > step
        found[:-1] |= far
        found[1:] |= far
    return jumps


def _reduced(colours: npt.NDArray[np.float32], covered: Bools) -> npt.NDArray[np.uint8]:
    """Return pixels, (h, w, 4), of the mean of their samples."""
    height, width = np.array(covered.shape) // SAMPLES
    samples = np.dstack([colours * covered[..., None], covered])
    rows = samples.reshape(height, SAMPLES, -1).sum(axis=1)  # first: they are whole in memory
    found = rows.reshape(height, width, SAMPLES, 4).sum(axis=2)
    found[..., :3] /= np.maximum(found[..., 3:], 1)
    found[..., 3] /= SAMPLES**2
    return np.asarray((255 * np.clip(found, 0, 1)).round(), dtype=np.uint8)
