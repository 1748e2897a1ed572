"""Effect of patterns of stiff lines on a shape: McKibben's lattice, a helix, stripes.

Lines that do not stretch leave a tube few ways to deform. What they leave is known in closed form
whatever the fabric and the pressure, so a tube is inflated and its kinematics compared. Stripes on
a sheet are exact at any strain.
"""

from __future__ import annotations

from functools import cache, partial
from typing import Any

import numpy as np
from scipy.optimize import root_scalar

from benchmarks.accuracy.known import Known, Measured
from benchmarks.accuracy.scenes import (
    COMM,
    Floats,
    Ints,
    Solved,
    entry,
    half_held,
    membrane,
    membrane_case,
    solve,
    table_a,
)
from benchmarks.accuracy.tubes import RADIUS
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.equilibrium.newton import NewtonOptions
from toros_fem.mechanics.skin.supports import Supports, clamp
from toros_fem.meshes import Pattern
from toros_fem.meshes.pattern import Panel
from toros_fem.meshes.sheets import circle, rectangle, ringed_disc

# What turns and folds a lot without stretching takes Newton's method many steps. Where the sheet is
# so much stiffer than its load, rounding leaves the residual no more digits.
PATIENT = NewtonOptions(tolerance=1e-8, max_steps=500)
LATTICE = np.radians(30.0)  # of lines from the tube's axis, assembled
HELIX = np.radians(45.0)
PERIOD = 4  # columns of the helical tube to a line one column wide
BAND, STRETCH, THICKNESS = 5e-3, "1.10", 0.3e-3  # m; of the stripes


def soft(contrast: float) -> Composite:
    """Material A with bounds so wide that they do not matter."""
    return membrane(400e3 / 3, 1 / 3, THICKNESS, 2.5, 3.5, contrast)


def mckibben(angle: float, radius_ratio: float) -> float:
    """L/L₀ of a tube of crossed lines that do not stretch, at an angle from its axis, from R/R₀."""
    return float(np.sqrt(1 - (radius_ratio * np.sin(angle)) ** 2) / np.cos(angle))


def helical_twist(angle: float, around: float, along: float) -> float:
    """Angle, over R₀, by which a tube turns whose one family of lines does not stretch."""
    shear = np.sqrt(1 - (along * np.cos(angle)) ** 2) - around * np.sin(angle)
    return float(shear / np.cos(angle) / around)


def prism(flat: Floats, sides: int) -> Floats:
    """Flat points of a wall rolled up to the prism over a regular polygon, without stretch."""
    ring = circle(sides, RADIUS)
    place = flat[:, 0] / np.linalg.norm(ring[1] - ring[0])
    side = np.clip(np.floor(place + 1e-9).astype(int), 0, sides - 1)
    fraction = (place - side)[:, None]
    corner = (1 - fraction) * ring[side] + fraction * ring[(side + 1) % sides]
    return np.column_stack([corner, flat[:, 1]])


def cap(sides: int, height: float, turn: float = 0.0) -> Panel:
    """The round panel on a tube's end, turned by an angle."""
    flat, triangles = ringed_disc(sides, RADIUS)
    c, s = np.cos(turn), np.sin(turn)
    points = np.column_stack([flat @ np.array([[c, s], [-s, c]]), np.full(len(flat), height)])
    if height == 0:  # seen from outside, that is from below, the disc is mirrored
        return Panel("base", flat * [1, -1], triangles[:, ::-1], points)
    return Panel("tip", flat, triangles, points)


def pinned_lattice(count: int) -> tuple[Pattern, Supports, Floats, Ints]:
    """Half a tube, lines as chains of slender stiff rhombi that meet at their tips alone.

    There they turn freely, as the strands of a braid do.

    Args:
        count: Lines of each family.

    Returns:
        Pattern, supports, densities, and the vertices where lines cross.
    """
    sides = 2 * count
    width = 2 * RADIUS * np.sin(np.pi / sides)
    height = width / np.tan(LATTICE)
    rows = round(6 * RADIUS / height)
    squares = rectangle(COMM, sides, rows, 1.0, "union-jack")
    flat, triangles = squares.flat_points * [width, height], squares.flat_triangles
    # Each triangle is cut in three at a point near its longest edge, along which a line runs.
    a, b, right = crossing_last(flat, triangles).T
    thin = len(flat) + np.arange(len(triangles))
    flat = np.concatenate([flat, 0.35 * (flat[a] + flat[b]) + 0.3 * flat[right]])
    parts = np.concatenate(
        [np.column_stack(corners) for corners in ((a, b, thin), (b, right, thin), (right, a, thin))]
    )
    wall = Panel("wall", flat, parts, prism(flat, sides))
    pattern = Pattern.from_panels([wall, cap(sides, rows * height)], tolerance=1e-3 * width)
    density = (pattern.panel == pattern.panel_index("tip")).astype(float)
    density[: len(triangles)] = 1.0
    crossings = np.unique(pattern.triangles[: len(triangles), :2])
    return pattern, half_held(pattern), density, crossings


def crossing_last(flat: Floats, triangles: Ints) -> Ints:
    """Corners of right triangles, turned so that the right angle comes last."""
    corner = flat[triangles]
    opposite = np.linalg.norm(np.roll(corner, -1, axis=1) - np.roll(corner, 1, axis=1), axis=2)
    first = opposite.argmax(axis=1)[:, None] + np.array([[1, 2, 3]])
    return np.take_along_axis(triangles, first % 3, axis=1)


def shortening(found: Solved, vertices: Ints) -> Measured:
    """Shortening about the middle of a half tube over McKibben's for the radius found there."""
    before = found.pattern.points[vertices]
    near = before[:, 2] < 2 * RADIUS
    height, after = before[near, 2], found.points[vertices][near]
    ratio = np.linalg.norm(after[:, :2], axis=1).mean() / RADIUS
    along = height @ after[:, 2] / (height @ height)
    return found.measured((1 - along) / (1 - mckibben(LATTICE, ratio)))


def braid(count: int) -> Measured:
    """The pinned lattice under pressure."""
    pattern, supports, density, crossings = pinned_lattice(count)
    found = solve(pattern, soft(1e5), supports, 1e3, density, PATIENT)
    return shortening(found, crossings)


def helical_tube(sides: int) -> tuple[Pattern, Floats, Ints]:
    """A capped tube whose edges run along one family of lines.

    Returns:
        Pattern, densities, and the lines' vertices.
    """
    width, height = helical_cell(sides)
    rows = round(8 * RADIUS / height)
    squares = rectangle(COMM, sides, rows, 1.0, "right")
    (u, v), triangles = squares.flat_points.T, squares.flat_triangles
    # Rows shift by one column each.
    flat = np.column_stack([(u + v) * width, v * height])
    angle = np.pi + 2 * np.pi * (u + v) / sides
    tube = np.column_stack([RADIUS * np.cos(angle), RADIUS * np.sin(angle), flat[:, 1]])
    wall = Panel("wall", flat, triangles, tube)
    ends = [cap(sides, 0.0), cap(sides, rows * height, 2 * np.pi * rows / sides)]
    pattern = Pattern.from_panels([wall, *ends], tolerance=1e-3 * width)
    line = np.arange(len(triangles)) // 2 % sides % PERIOD == 0
    density = (pattern.panel != pattern.panel_index("wall")).astype(float)
    density[: len(line)] = line
    return pattern, density, np.unique(pattern.triangles[: len(line)][line])


def helical_cell(sides: int) -> tuple[float, float]:
    """Width around and height along of a cell of the helical tube, in m."""
    width = 2 * RADIUS * np.sin(np.pi / sides)
    return width, width / np.tan(HELIX)


@cache
def turned_helix(sides: int) -> tuple[Solved, float, float, float]:
    """The helical tube under pressure: stretches about its middle, and twist over R."""
    pattern, density, vertices = helical_tube(sides)
    found = solve(pattern, soft(3e4), clamp(pattern, ["base"]), 500.0, density, PATIENT)
    height = pattern.points[vertices, 2]
    near = vertices[np.abs(height - height.max() / 2) < 2 * RADIUS]
    before, after = pattern.points[near], found.points[near]
    after = after - [*after[:, :2].mean(axis=0), 0.0]
    at = before[:, 2] - before[:, 2].mean()
    around = float(np.linalg.norm(after[:, :2], axis=1).mean() / RADIUS)
    along = float(at @ after[:, 2] / (at @ at))
    turned = (after[:, 0] + 1j * after[:, 1]) / (before[:, 0] + 1j * before[:, 1])
    order = np.argsort(at)  # neighbours along the tube turn alike, its ends may differ by 2π
    twist = np.polyfit(at[order] / RADIUS, np.unwrap(np.angle(turned[order])), 1)[0]
    return found, around, along, float(twist)


def helix(sides: int) -> Measured:
    """Twist over that of the closed form for the stretches found."""
    found, around, along, twist = turned_helix(sides)
    return found.measured(twist / helical_twist(HELIX, around, along))


def polygonal_helix(sides: int) -> Measured:
    """Twist over that by which the straight edges along the lines keep their length."""
    found, around, along, twist = turned_helix(sides)
    width, height = helical_cell(sides)
    chord = np.sqrt(width**2 + height**2 * (1 - along**2))
    between = 2 * np.arcsin(chord / (2 * around * RADIUS))
    return found.measured(twist / ((between - 2 * np.pi / sides) * RADIUS / height))


def stripes(mesh: str, count: int, across: bool) -> Measured:
    """Nominal stress in Pa of a sheet of two periods, pulled along its stripes or across them.

    Pulled across, stripes of either kind would narrow differently, but adhere: as in a wide
    sheet, its sides stay straight, and stand where nothing pulls at them.
    """
    stretch, length, width = float(STRETCH), 4 * BAND, 2 * BAND
    if not across:
        length, width = width, length

    def pull(side: float | None) -> Solved:
        def place(flat: Floats) -> Floats:
            return np.column_stack([flat * [stretch, side or 1.0], np.zeros(len(flat))])

        pattern = rectangle(COMM, length, width, BAND / count, mesh, place)
        u, v = pattern.flat_points.T
        fixed = np.ones((len(u), 3), dtype=bool)
        fixed[:, 0] = (u < 1e-9) | (u > length - 1e-9)
        fixed[:, 1] = (v < 1e-9) | ((v > width - 1e-9) & (side is not None))
        stiff = pattern.centroids[:, 0 if across else 1] // BAND % 2
        return solve(pattern, table_a(contrast=100.0), Supports(fixed), 0.0, stiff)

    def force(found: Solved, axis: int) -> float:
        end = found.pattern.flat_points[:, axis] > (length, width)[axis] - 1e-9
        return float(found.reactions[end, axis].sum())

    tried: list[Solved] = []

    def side_force(side: float) -> float:
        tried.append(pull(side))
        return force(tried[-1], 1)

    if across:
        root_scalar(side_force, x0=1.0, x1=0.995, xtol=1e-11)
    else:
        tried.append(pull(None))
    value = force(tried[-1], 0) / (width * THICKNESS)
    return Measured(value, len(tried[-1].pattern.panel), sum(found.seconds for found in tried))


case = partial(membrane_case, "patterns")
ALIGNED: dict[str, Any] = {
    "meshes": ("right", "crossed"),
    "sizes": (1, 2, 4, 8),
    "within": 1e-7,
    "note": "Homogeneous in each stripe: exact where edges follow the stripes.",
}
JAGGED: dict[str, Any] = {
    "meshes": ("unstructured",),
    "sizes": (2, 4, 8, 16),
    "within": None,
    "note": "Triangles belong to a stripe by their centroids, which makes its border jagged: "
    "about first order, and not regular. The size of a mesh is the number of edges "
    "across a stripe.",
}
TUBES = (
    case(
        "mckibben-pinned",
        "A tube of two crossed families of lines at 30° from its axis, chains of slender stiff "
        "triangles that meet at their tips, inflated by 1 kPa: its shortening, over that of "
        "McKibben's relation for the computed radius.",
        "(1 - L/L₀) over the closed form",
        1.0,
        "L/L₀ = √(1 - (R/R₀)² sin²θ₀)/cos θ₀ of lines that do not stretch",
        lambda _, size: braid(size),
        meshes=("lattice",),
        sizes=(4, 6, 8, 12, 16),
        note="Exact for any number of lines, since the lattice's chords keep the same relation. "
        "The remaining error is the stretch of the lines: they are 1e5 times stiffer than "
        "the fabric, and the error falls with this ratio. The size of a mesh is the number "
        "of lines of a family.",
    ),
    case(
        "helix-twist",
        "A tube with one family of lines at 45°, every fourth column of a mesh that follows "
        "them, inflated by 0.5 kPa: its twist, over the closed form for the computed radius and "
        "length.",
        "twist over the closed form",
        1.0,
        "γ = (√(1 - λ_z² cos²θ) - λ_θ sin θ)/cos θ of lines that do not stretch, twist γ/(λ_θ R₀)",
        lambda _, size: helix(size),
        meshes=("helical",),
        sizes=(12, 16, 32, 64),
        default=32,
        within=2e-3,
        note="The error is that of the polygon; the size of a mesh is its number of sides. The "
        "twist is a small difference between the directions of the lines before and after, "
        "so that this error has a large effect.",
    ),
    case(
        "helix-twist-polygon",
        "The same twist, over that by which the straight edges along the lines keep their length.",
        "twist over that of the polygon",
        1.0,
        "geometry of the polygonal tube",
        lambda _, size: polygonal_helix(size),
        meshes=("helical",),
        sizes=(12, 16, 32, 64),
        default=32,
        note="Exact except for the stretch of the lines and for the effect of the ends on the "
        "middle.",
    ),
)
STRIPES = tuple(
    case(
        f"stripes-{direction}{suffix}",
        f"A sheet of stripes, half R, half A, R a hundred times stiffer, pulled {direction} to a "
        f"mean stretch of {STRETCH}" + (", its sides straight and free." if across else "."),
        "nominal stress in Pa",
        entry("laminate_gent_eq1", column, mean_stretch=STRETCH, phase2="A", **{"f(mat R)": "0.5"}),
        "closed form of eq. (1) in a laminate of two phases",
        partial(stripes, across=across),
        **options,
    )
    for direction, across, column in (
        ("along", False, "P_along_stripes_Pa"),
        ("across", True, "P_across_Pa"),
    )
    for suffix, options in (("", ALIGNED), ("-jagged", JAGGED))
)
PATTERNS: tuple[Known, ...] = (*TUBES, *STRIPES)
