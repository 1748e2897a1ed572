"""Scenes and designs of the matrix: what is inflated or pulled, and where it is stiff.

All scenes are coarse. Lengths are in m; the fabric's E h is 50 N/m everywhere, so that scenes of
different thickness differ in bending only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from scipy.spatial import ConvexHull

from toros_fem.materials.sheet import Composite, Material
from toros_fem.mechanics.skin import supports
from toros_fem.mechanics.skin.supports import Supports, clamp
from toros_fem.meshes import Pattern, Skin, cylinder, sew
from toros_fem.meshes.pattern import Panel
from toros_fem.meshes.sheets import one_panel, polygon_mesh

Floats = npt.NDArray[np.float64]
Spacing = npt.NDArray[np.floating]
Ints = npt.NDArray[np.int64]

STIFFNESS = 50.0  # N/m, E h of the fabric
THICKNESS = 0.5e-3
LENGTH, DIAMETER, EDGE = 0.15, 0.02, 6e-3
SQUARE = 0.05
PRESSURES = (100.0, 1e3, 5e3, 20e3, 50e3)  # Pa


@dataclass(frozen=True, eq=False)
class Scene:
    """A skin, its supports, and coordinates on it for the designs.

    Attributes:
        name: What the report calls it.
        skin: The sewn skin.
        supports: Fixed components and directions.
        thickness: Of fabric and reinforcement, in m.
        loads: Pressures to apply, in Pa.
        strain: By how much the fixed borders are moved apart; 0 in inflated scenes.
        along: Place of each triangle along the skin, from 0 to 1.
        around: Place around it, from 0 to 1 where it closes; 0 is the side of the stiff strip.
    """

    name: str
    skin: Skin
    supports: Supports
    thickness: float
    loads: tuple[float, ...]
    strain: float
    along: Floats
    around: Floats

    def composite(self, contrast: float) -> Composite:
        """Fabric and a reinforcement that is stiffer by `contrast`, of equal thickness."""
        young = STIFFNESS / self.thickness
        return Composite(
            fabric=Material(young, 0.3, self.thickness),
            reinforcement=Material(contrast * young, 0.3, self.thickness),
        )

    def small_pressure(self) -> float:
        """A pressure in Pa that strains the fabric by a few per cent."""
        return 0.1 * STIFFNESS / self.skin.pattern.size


def grid(u: Spacing, v: Spacing) -> tuple[Floats, Ints]:
    """Flat points (m, 2) at all pairs of u and v, u running fastest, and right triangles."""
    node = np.arange(len(u) * len(v)).reshape(len(v), len(u))
    a, b, c, d = node[:-1, :-1], node[:-1, 1:], node[1:, :-1], node[1:, 1:]
    triangles = np.stack([np.stack([a, b, c], 2), np.stack([b, d, c], 2)], 2).reshape(-1, 3)
    flat = np.stack(np.meshgrid(u, v), axis=2).reshape(-1, 2)
    return flat, triangles


def fan_tube(angles: Spacing, heights: Spacing) -> Pattern:
    """A tube on a structured grid of given spacing, each cap a fan around its centre.

    Args:
        angles: Of the generators about z, in rad, increasing; the tube closes if the last is 2π
            after the first, else it is open along both its first and its last generator.
        heights: Of the rings, in m, increasing from 0.
    """
    radius = DIAMETER / 2
    ring = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    chord = np.linalg.norm(np.diff(ring, axis=0), axis=1)
    flat, triangles = grid(np.concatenate([[0], np.cumsum(chord)]), heights)
    wall = np.column_stack([np.tile(ring, (len(heights), 1)), flat[:, 1]])
    panels = [Panel("wall", flat, triangles, wall)]
    closed = np.isclose(angles[-1] - angles[0], 2 * np.pi)
    rim = ring[:-1] if closed else ring
    disc = np.concatenate([rim, np.zeros((1, 2))])
    first = np.arange(len(chord))
    fan = np.stack([first, (first + 1) % len(rim), np.full(len(chord), len(rim))], axis=1)
    for name, height in (("base", 0.0), ("tip", heights[-1])):
        points = np.column_stack([disc, np.full(len(disc), height)])
        if name == "base":  # seen from outside, that is from below, the disc is mirrored
            panels.append(Panel(name, disc * [1, -1], fan[:, ::-1], points))
        else:
            panels.append(Panel(name, disc, fan, points))
    spacing = min(chord.min(), np.diff(heights).min())
    return Pattern.from_panels(panels, tolerance=1e-3 * float(spacing))


def graded(count: int, total: float, ratio: float) -> Floats:
    """Numbers from 0 to `total` whose gaps grow geometrically by `ratio` from first to last."""
    gaps = ratio ** np.linspace(0, 1, count)
    places = np.concatenate([[0], np.cumsum(gaps)])
    return np.asarray(total * places / places[-1])


def icosahedron(radius: float, count: int) -> Pattern:
    """Twenty flat equilateral panels of count² triangles; under pressure they round to a ball."""
    golden = (1 + np.sqrt(5)) / 2
    around = [[0, a, b * golden] for a in (-1, 1) for b in (-1, 1)]
    vertex = np.array([np.roll(v, k) for v in around for k in range(3)], dtype=float)
    vertex *= radius / np.linalg.norm(vertex[0])
    faces = [
        face if np.linalg.det(vertex[face]) > 0 else face[::-1]
        for face in ConvexHull(vertex).simplices
    ]
    return triangle_panels(vertex, np.array(faces), count)


def triangle_panels(vertex: Floats, faces: Ints, count: int) -> Pattern:
    """Sew triangles in space, each a flat panel of count² triangles.

    Args:
        vertex: Corners, (n, 3), in m.
        faces: Corners of each panel, (k, 3), counter-clockwise seen from outside.
        count: Number of edges along each side of a panel.
    """
    place = [(i, j) for j in range(count + 1) for i in range(count + 1 - j)]
    number = {ij: k for k, ij in enumerate(place)}
    up = [[(i, j), (i + 1, j), (i, j + 1)] for i, j in place if i + j < count]
    down = [[(i + 1, j), (i + 1, j + 1), (i, j + 1)] for i, j in place if i + j < count - 1]
    triangles = np.array([[number[ij] for ij in corners] for corners in up + down])
    fraction = np.array(place) / count
    panels = []
    shortest = np.inf
    for k, (a, b, c) in enumerate(vertex[faces]):
        sides = np.stack([b - a, c - a])
        first = sides[0] / np.linalg.norm(sides[0])
        along = float(sides[1] @ first)
        chart = [[np.linalg.norm(sides[0]), 0], [along, np.linalg.norm(sides[1] - along * first)]]
        panels.append(
            Panel(f"face {k}", fraction @ np.array(chart), triangles, a + fraction @ sides)
        )
        shortest = min(shortest, *np.linalg.norm([b - a, c - a, c - b], axis=1))
    return Pattern.from_panels(panels, tolerance=1e-3 * float(shortest) / count)


def two_layers(flat: Floats, triangles: Ints) -> Pattern:
    """A mirror-symmetric outline and its mirror image, sewn along it and still flat.

    Mirrored, the lower layer faces down, and its inner edges do not repeat those of the upper.
    """
    above = np.column_stack([flat, np.zeros(len(flat))])
    panels = [
        Panel("top", flat, triangles, above),
        Panel("bottom", flat, triangles, above * [-1, 1, 1]),
    ]
    return Pattern.from_panels(panels, tolerance=1e-6)


def cross_outline(reach: float, half: float, edge: float) -> tuple[Floats, list[int]]:
    """An X of four arms with round ends: corners, and edges on the side after each.

    Round ends, because a mesher cuts a right-angled corner off by one triangle; both layers doing
    so would share its inner edge.
    """
    corners, counts = [], []
    straight = max(1, round((reach - half) / edge))
    turns = np.linspace(-np.pi / 2, np.pi / 2, round(np.pi * half / edge) + 1)
    for k in range(4):
        angle = np.pi / 4 + k * np.pi / 2
        out = np.array([np.cos(angle), np.sin(angle)])
        left = np.array([-out[1], out[0]])
        corners.append(half * (out - left))
        corners += [reach * out + half * (np.cos(t) * out + np.sin(t) * left) for t in turns]
        counts += [straight] + [1] * (len(turns) - 1) + [straight]
    return np.array(corners), counts


def three_points(pattern: Pattern) -> Supports:
    """Hold the six rigid motions and no more: a point, a second one across x, a third along z."""
    points = pattern.points
    middle = points.mean(axis=0)
    # A start that is not ambiguous: no symmetric skin has two vertices equally far this way.
    first = int(np.argmin((points - middle) @ [1, 0.11, 0.013]))
    second = int(np.argmax((points - points[first]) @ [1, 0.11, 0.013]))
    line = (points[second] - points[first]) / np.linalg.norm(points[second] - points[first])
    aside = np.cross([0, 0, 1], line)
    third = int(np.argmax((points - points[first]) @ (aside + 0.011 * line)))
    fixed = np.zeros((len(points), 3), dtype=bool)
    fixed[first], fixed[second, 1:], fixed[third, 2] = True, True, True
    return Supports(fixed)


def _tube(mesh: str, length: float = LENGTH) -> tuple[Pattern, Supports]:
    pattern = cylinder(MPI.COMM_WORLD, length, DIAMETER, EDGE, mesh=mesh)
    return pattern, clamp(pattern, ["base"])


def _sliver_tube() -> tuple[Pattern, Supports]:
    across = np.pi * DIAMETER / 105
    pattern = fan_tube(np.linspace(0, 2 * np.pi, 106), np.linspace(0, 5 * 50 * across, 6))
    return pattern, clamp(pattern, ["base"])


def _graded_tube() -> tuple[Pattern, Supports]:
    half = graded(8, np.pi, 20)
    angles = np.concatenate([half, 2 * np.pi - half[-2::-1]])
    pattern = fan_tube(angles, graded(24, LENGTH, 20))
    return pattern, clamp(pattern, ["base"])


def _half_tube() -> tuple[Pattern, Supports]:
    pattern = fan_tube(np.linspace(0, np.pi, 7), np.linspace(0, LENGTH, 26))
    return pattern, clamp(pattern, ["base"]) | supports.symmetry_plane(pattern, 1)


def _sphere() -> tuple[Pattern, Supports]:
    pattern = icosahedron(0.03, 5)
    return pattern, three_points(pattern)


def _pillow() -> tuple[Pattern, Supports]:
    side = np.linspace(-SQUARE / 2, SQUARE / 2, 11)
    pattern = two_layers(*grid(side, side))
    return pattern, three_points(pattern)


def _cross() -> tuple[Pattern, Supports]:
    corners, counts = cross_outline(0.03, 0.01, 5e-3)
    flat, triangles = polygon_mesh(corners, 5e-3, counts=counts)
    pattern = two_layers(flat, triangles)
    # A small patch: what the middle of the lower layer rests on.
    lower = pattern.vertices_of("bottom")
    fixed = np.zeros((len(pattern.points), 3), dtype=bool)
    fixed[lower[np.linalg.norm(pattern.points[lower], axis=1) < 7e-3]] = True
    return pattern, Supports(fixed)


def _tile(strain: float) -> tuple[Pattern, Supports]:
    flat, triangles = grid(np.linspace(0, SQUARE, 15), np.linspace(0, SQUARE, 15))
    points = np.column_stack([flat * [1 + strain, 1], np.zeros(len(flat))])
    pattern = one_panel(flat, triangles, lambda _: points)
    ends = (flat[:, 0] < 1e-9) | (flat[:, 0] > SQUARE - 1e-9)
    return pattern, Supports(np.repeat(ends[:, None], 3, axis=1))


BUILDERS: dict[str, Callable[[], tuple[Pattern, Supports]]] = {
    "tube": lambda: _tube("structured"),
    "tube_gmsh": lambda: _tube("unstructured"),
    "slender": lambda: _tube("structured", 15 * DIAMETER),
    "sphere": _sphere,
    "pillow": _pillow,
    "cross": _cross,
    "tile_10": lambda: _tile(0.1),
    "tile_40": lambda: _tile(0.4),
    "half_tube": _half_tube,
    "thickness_1e-1": lambda: _tube("structured"),
    "thickness_1e-2": lambda: _tube("structured"),
    "thickness_1e-3": lambda: _tube("structured"),
    "thickness_1e-4": lambda: _tube("structured"),
    "slivers": _sliver_tube,
    "graded": _graded_tube,
}


def loads_of(name: str) -> tuple[float, ...]:
    """Pressures of a scene in Pa, without building it; a tile is pulled, not inflated."""
    return (0.0,) if name.startswith("tile_") else PRESSURES


def build(name: str) -> Scene:
    """A scene by its name in `BUILDERS`."""
    pattern, fixed = BUILDERS[name]()
    kind, _, value = name.partition("_")
    along, around = _coordinates(pattern)
    return Scene(
        name=name,
        skin=sew(MPI.COMM_WORLD, pattern),
        supports=fixed,
        thickness=float(value) * DIAMETER if kind == "thickness" else THICKNESS,
        loads=loads_of(name),
        strain=float(value) / 100 if kind == "tile" else 0.0,
        along=along,
        around=around,
    )


def _coordinates(pattern: Pattern) -> tuple[Floats, Floats]:
    centre = pattern.points[pattern.triangles].mean(axis=1)
    low, extent = pattern.points.min(axis=0), np.ptp(pattern.points, axis=0)
    if extent[2] > 0:  # a tube or a ball about z
        return (
            (centre[:, 2] - low[2]) / extent[2],
            np.arctan2(centre[:, 1], centre[:, 0]) / (2 * np.pi) % 1,
        )
    # Flat: forth on the upper layer and back on the lower, the strip in the upper one's middle …
    fraction = (centre - low)[:, :2] / extent[:2]
    if "bottom" not in pattern.panel_names:  # … or along the border of a single sheet.
        return fraction[:, 0], fraction[:, 1] / 2
    forth = (fraction[:, 1] - 0.5) / 2
    return fraction[:, 0], np.where(pattern.panel == 0, forth, 0.5 - forth) % 1


def _checkerboard(scene: Scene) -> Floats:
    pattern = scene.skin.pattern
    side = np.sqrt(pattern.areas.sum()) / 8
    patch = np.floor(pattern.centroids / side).astype(int).sum(axis=1)
    return np.asarray((patch + pattern.panel) % 2, dtype=float)


def _islands(scene: Scene) -> Floats:
    pattern = scene.skin.pattern
    middles = np.random.default_rng(3).choice(len(pattern.panel), 12, replace=False)
    radius = 0.09 * np.sqrt(pattern.areas.sum())  # covers about 30 %
    gap = np.linalg.norm(pattern.centroids[:, None] - pattern.centroids[middles], axis=2)
    same = pattern.panel[:, None] == pattern.panel[middles]
    return np.asarray(((gap < radius) & same).any(axis=1), dtype=float)


def _uniform(value: float) -> Callable[[Scene], Floats]:
    return lambda scene: np.full(len(scene.along), value)


# Densities of all pattern triangles.
DESIGNS: dict[str, Callable[[Scene], Floats]] = {
    "fabric": _uniform(0.0),
    "reinforced": _uniform(1.0),
    "grey": _uniform(0.5),
    "random": lambda scene: np.random.default_rng(1).random(len(scene.along)),
    "checkerboard": _checkerboard,
    "strip": lambda scene: np.asarray((scene.around + 0.1) % 1 < 0.2, dtype=float),
    "helix": lambda scene: np.asarray((scene.around + 2 * scene.along) % 1 < 0.3, dtype=float),
    "islands": _islands,
}


def neighbour(density: Floats) -> Floats:
    """A design near another: each triangle's density moved by up to 0.2."""
    moved = density + np.random.default_rng(2).uniform(-0.2, 0.2, len(density))
    return np.clip(moved, 0, 1)
