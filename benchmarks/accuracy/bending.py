"""Bending against exact and published results: plates, strips, shells."""

from __future__ import annotations

from functools import partial

import numpy as np
import numpy.typing as npt

from benchmarks.accuracy.known import Known, Measured, timed
from benchmarks.accuracy.scenes import COMM, entry
from benchmarks.accuracy.sheets import Sheet, elastic, jittered, line_force, value_at, warped
from toros_fem.materials.sheet import CURVATURES, Bending, Composite
from toros_fem.measures.metrics import bend_angle
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.supports import Supports, build_in, clamp, symmetry_plane
from toros_fem.meshes import Pattern, cylinder, rectangle, sew
from toros_fem.meshes.sheets import one_panel
from toros_fem.meshes.transfer import refine

Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

SHEETS = ("right", "equilateral", "union-jack", "crossed", "unstructured")
STRIPS = ("right", "crossed", "unstructured")
# Of the finest meshes 70.940 and 71.071 (40 320 and 161 280 triangles), order 2.
SPINE_ANGLE = 71.11  # degrees
SZE = "Sze, Liu & Lo 2004, Popular benchmark problems for geometric nonlinear analysis of shells"


def hold(pattern: Pattern, vertices: Mask, components: tuple[int, ...]) -> Supports:
    """Fix components of some vertices."""
    fixed = np.zeros((len(pattern.points), 3), dtype=bool)
    fixed[np.ix_(np.flatnonzero(vertices), components)] = True
    return Supports(fixed)


def plate(borders: str, formulation: str, mesh: str, size: int) -> Measured:
    """Centre deflection of a unit square plate under a uniform load, in p a⁴/D."""
    young, poisson, thickness = 1e9, 0.3, 0.05
    pattern = jittered(size) if mesh == "jittered" else rectangle(COMM, 1.0, 1.0, 1 / size, mesh)
    border = np.zeros(len(pattern.points), dtype=bool)
    border[pattern.free_edges.ravel()] = True
    supports = hold(pattern, border, (0, 1, 2))
    if borders == "clamped":
        supports = build_in(pattern, border)
    sheet = Sheet(pattern, elastic(young, poisson, thickness, formulation), supports)
    D = young * thickness**3 / 12 / (1 - poisson**2)
    # Deflected by so little of its thickness that stretching plays no part.
    pressure = 3e-3 * thickness * D / 0.0041
    force = pattern.vertex_areas[:, None] * np.array([0, 0, pressure])
    _, seconds = timed(lambda: sheet.bend(force))
    found = value_at(pattern, sheet.positions()[:, 2], np.array([0.5, 0.5]))
    return Measured(found * D / pressure, len(pattern.panel), seconds)


def rolled_energy(formulation: str, mesh: str, size: int) -> Measured:
    """Energy of a square rolled up to a quarter of a cylinder, over ½ D κ² A."""
    young, thickness, bend = 1e6, 1e-2, np.pi / 2
    flat = jittered(size) if mesh == "jittered" else rectangle(COMM, 1.0, 1.0, 1 / size, mesh)
    # Rolled along a direction that no edge has.
    turn = np.radians(30)
    along = flat.flat_points @ [np.cos(turn), np.sin(turn)]
    across = flat.flat_points @ [-np.sin(turn), np.cos(turn)]
    points = np.column_stack(
        [np.sin(bend * along) / bend, across, (1 - np.cos(bend * along)) / bend]
    )
    pattern = one_panel(flat.flat_points, flat.flat_triangles, lambda _: points)
    # A border that is free would relax: there the sheet is held tangent to the cylinder.
    border = pattern.free_edges
    middle = bend * along[border].mean(axis=1)
    normal = np.column_stack([-np.sin(middle), 0 * middle, np.cos(middle)])
    planes = np.cross(points[border[:, 1]] - points[border[:, 0]], normal)
    fixed = Supports(np.ones((len(points), 3), dtype=bool), border, planes)
    sheet = Sheet(pattern, elastic(young, 0.0, thickness, formulation), fixed)
    result, seconds = timed(lambda: sheet.bend(None))
    # What the chords stretch is taken off.
    plain = Sheet(pattern, elastic(young, 0.0, 1e-6 * thickness, formulation), fixed).bend(None)
    energy = result.energy - 1e6 * plain.energy
    return Measured(energy / (young * thickness**3 / 24 * bend**2), len(flat.panel), seconds)


def strip(length: float, mesh: str, size: int) -> Pattern:
    """Return a strip of width 1 along x, with a number of edges across."""
    return rectangle(COMM, length, 1.0, 1 / size, mesh)


def rolled_up(formulation: str, mesh: str, size: int) -> Measured:
    """Deflection of the tip when an end moment has turned it by 180°."""
    pattern = strip(12.0, mesh, size)
    x = pattern.points[:, 0]
    root, tip = x < 1e-9, x > 12 - 1e-9
    border = pattern.free_edges
    border = border[tip[border].all(axis=1)]
    seconds, state = 0.0, None
    for angle in np.pi / 8 * np.arange(1, 9):
        # The end is turned by an angle; the moment is what that takes.
        normals = np.tile([np.cos(angle), 0, np.sin(angle)], (len(border), 1))
        turned = Supports(np.zeros((len(x), 3), dtype=bool), border, normals)
        fixed = build_in(pattern, root) | turned
        sheet = Sheet(pattern, elastic(1.2e6, 0.0, 0.1, formulation), fixed)
        if state is None:
            state = sheet.solver.model.assembled
        result, time = timed(partial(sheet.bend, None, state))
        state, seconds = result.state, seconds + time
    return Measured(sheet.positions()[tip, 2].mean(), len(pattern.panel), seconds)


def sheared(formulation: str, mesh: str, size: int) -> Measured:
    """Deflection of a cantilever's tip under a shear force at its end."""
    pattern = strip(10.0, mesh, size)
    x = pattern.points[:, 0]
    root, tip = x < 1e-9, x > 10 - 1e-9
    composite = elastic(1.2e6, 0.0, 0.1, formulation)
    sheet = Sheet(pattern, composite, build_in(pattern, root))
    force = line_force(pattern, tip, np.array([0, 0, 4.0]))
    _, seconds = timed(lambda: [sheet.bend(fraction * force) for fraction in (0.1, 0.25, 0.5, 1.0)])
    return Measured(sheet.positions()[tip, 2].mean(), len(pattern.panel), seconds)


def slit_annulus(formulation: str, mesh: str, size: int) -> Measured:
    """Deflection of the outer corner of an annular plate that is slit and lifted at the slit."""

    def warp(flat: Floats) -> Floats:
        angle, radius = -2 * np.pi * flat[:, 0] / 12, 6 + 4 * flat[:, 1] / 2
        return radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])

    grid = rectangle(COMM, 12.0, 2.0, 1 / size, mesh)
    pattern = warped(grid, warp)
    root, slit = grid.flat_points[:, 0] < 1e-9, grid.flat_points[:, 0] > 12 - 1e-9
    composite = elastic(21e6, 0.0, 0.03, formulation)
    sheet = Sheet(pattern, composite, build_in(pattern, root))
    force = line_force(pattern, slit, np.array([0, 0, 0.8]))
    fractions = (0.025, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0)
    _, seconds = timed(lambda: [sheet.bend(fraction * force) for fraction in fractions])
    outer = int(np.flatnonzero(slit)[np.argmax(grid.flat_points[slit, 1])])
    return Measured(sheet.positions()[outer, 2], len(pattern.panel), seconds)


def pulled_cylinder(formulation: str, mesh: str, size: int) -> Measured:
    """Deflection under the force that pulls an open cylinder out: an eighth of it."""
    radius, half = 4.953, 10.35 / 2
    quarter = radius * np.pi / 2

    def place(flat: Floats) -> Floats:
        angle = flat[:, 0] / radius
        return np.column_stack([radius * np.sin(angle), flat[:, 1], radius * np.cos(angle)])

    pattern = rectangle(COMM, quarter, half, quarter / (6 * size), mesh, place)
    u, v = pattern.flat_points.T
    supports = symmetry_plane(pattern, 0) | symmetry_plane(pattern, 1) | symmetry_plane(pattern, 2)
    composite = elastic(10.5e6, 0.3125, 0.094, formulation, rest="assembled")
    sheet = Sheet(pattern, composite, supports)
    top = int(np.argmin(u + v))
    force = np.zeros((len(u), 3))
    force[top, 2] = 40000 / 4
    fractions = (0.025, 0.05, 0.1, 0.2, 0.3, 0.4)
    _, seconds = timed(lambda: [sheet.bend(fraction * force) for fraction in fractions])
    moved = sheet.positions()[top, 2] - radius
    return Measured(moved, len(pattern.panel), seconds)


def spine(pattern: Pattern) -> Floats:
    """A stiff strip along the inner side of a tube, fading towards its borders; stiff caps."""
    x, y, _ = pattern.points[pattern.triangles].mean(axis=1).T
    strip = 0.6 * np.exp(-((np.arctan2(y, x) / 0.5) ** 4))
    return np.asarray(np.where(pattern.panel == pattern.panel_index("wall"), strip, 1.0))


def spine_tube(formulation: str, mesh: str, level: int) -> Measured:
    """Angle of a tube with a stiff strip, each mesh started from the result on the one before."""
    pattern = cylinder(COMM, 0.09, 0.02, 5e-3, mesh=mesh)
    composite = Composite(bending=Bending(formulation))
    seconds, finer, positions = 0.0, None, None
    for _ in range(level + 1):
        if finer is not None:
            pattern = finer.pattern
        skin = sew(COMM, pattern)
        solver = EquilibriumSolver(skin, composite, clamp(pattern, ["base"]))
        start = None
        if finer is not None and positions is not None:
            start = finer.at_vertices(positions)[skin.owned_vertices]
        density = spine(pattern)[skin.owned_cells]
        result, time = timed(partial(solver.solve, density, 3e3, start=start))
        positions = skin.gather_vertices(result.positions)
        seconds, finer = seconds + time, refine(pattern)
    assert positions is not None
    return Measured(np.degrees(bend_angle(pattern, positions)), len(pattern.panel), seconds)


PLATES = (*SHEETS, "jittered")

BENDING: tuple[Known, ...] = (
    *(
        Known(
            name=f"plate-{borders}",
            group="bending",
            about=f"A thin square plate, {borders} along its borders, under a uniform load so "
            "small that it does not stretch; deflection of its centre.",
            quantity="w D/(p a⁴)",
            reference=reference,
            source="series solution (Timoshenko & Woinowsky-Krieger), ν = 0.3",
            formulations=CURVATURES,
            meshes=PLATES,
            sizes=(8, 16, 32, 64),
            run=partial(plate, borders),
            within=1e-2,
            note="Mid-edge: order 2 on every mesh, from above. The others: order 2 where "
            "triangles form parallelograms in pairs; elsewhere the remaining error does not "
            "depend on the edge length.",
        )
        for borders, reference in (("clamped", 0.00126531908), ("supported", 0.00406235266))
    ),
    Known(
        name="rolled-energy",
        group="bending",
        about="The bending energy of a square laid on a quarter of a cylinder, at an angle of 30°.",
        quantity="E/(½ D κ² A)",
        reference=1.0,
        source="exact, ν = 0",
        formulations=CURVATURES,
        meshes=PLATES,
        sizes=(8, 16, 32, 64),
        run=rolled_energy,
        within=1e-2,
        note="All vertices and the border's direction are fixed: only the operator is tested. "
        "Order 2, because chords replace arcs.",
    ),
    Known(
        name="rolled-up",
        group="bending",
        about="A strip of length 12 bent by an end moment until its end has turned by 180°.",
        quantity="w of the tip",
        reference=entry("sze32_cantilever_moment", "w_tip_exact", M_over_Mmax="0.50"),
        source="exact: an arc of a circle; M/Mmax = 0.5 of Sze et al. 2004, section 3.2",
        formulations=CURVATURES,
        meshes=STRIPS,
        sizes=(2, 4, 6, 8),
        run=rolled_up,
        within=1e-2,
        note="Order 2.",
    ),
    Known(
        name="cantilever",
        group="bending",
        about="A cantilever of length 10 under a shear force at its end, turned by 64°.",
        quantity="w of the tip",
        reference=entry("sze31_cantilever_shear", "w_elastica", P_over_Pmax="1.00"),
        source=f"exact elastica; {SZE}, section 3.1",
        formulations=CURVATURES,
        meshes=STRIPS,
        sizes=(1, 2, 4, 8),
        run=sheared,
        within=1e-2,
        note="Order 2 down to 1e-4, where the difference from the elastica appears, which has no "
        "width and does not stretch.",
    ),
    Known(
        name="slit-annulus",
        group="bending",
        about="An annular plate, slit, clamped at one side of the slit and lifted at the other.",
        quantity="w of the outer corner",
        reference=entry("sze33_slit_annular", "w_B_outer", P_over_Pmax="1.00"),
        source=f"{SZE}, section 3.3, by Abaqus S4R",
        formulations=CURVATURES,
        meshes=("right", "crossed", "unstructured"),
        sizes=(2, 4, 6, 8),
        run=slit_annulus,
        note="The reference itself is accurate to some tenths of a per cent. The plate twists "
        "while it bends: membrane locking leaves an order near 1.",
    ),
    Known(
        name="pulled-cylinder",
        group="bending",
        about="An open cylinder, moulded round, pulled out at two opposite points; an eighth.",
        quantity="w under the force",
        reference=entry("sze35_pullout_cylinder", "w_A", P_over_Pmax="0.40"),
        source=f"{SZE}, section 3.5, P/Pmax = 0.4, by Abaqus S4R",
        formulations=CURVATURES,
        meshes=("right", "unstructured"),
        sizes=(1, 2, 4, 6),
        run=pulled_cylinder,
        note="The reference itself is accurate to some tenths of a per cent, which the finest "
        "meshes reach.",
    ),
    Known(
        name="tube-spine",
        group="bending",
        about="A 9 cm tube of the demos' materials at 3 kPa, bent by a stiff strip along its "
        "inner side; refined by dividing each triangle into four.",
        quantity="angle in degrees",
        reference=SPINE_ANGLE,
        source="this code with mid-edge bending on 161 280 triangles, extrapolated",
        formulations=CURVATURES,
        meshes=("structured", "unstructured"),
        sizes=(0, 1, 2, 3),
        run=spine_tube,
        note="No independent reference: the case shows how a skin's angle depends on the mesh.",
    ),
)
