"""A print on one face of the fabric against the exact bimorph strip and ring."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.models import bent_tube, pressurize, relaxed_model
from helpers.standing import model_on_base
from mpi4py import MPI

from toros_fem.base.mpi import norm
from toros_fem.materials.sheet import CURVATURES, Bending, Composite, Material
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.newton import NewtonOptions
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Supports, build_in, clamp, symmetry_plane
from toros_fem.mechanics.terms.model import SkinModel
from toros_fem.meshes import Pattern, Skin, cylinder, sew
from toros_fem.meshes.sheets import rectangle

PRINT = Material(1e6, 0.3, 1e-3)


OFFSET = 1e-3


# Bounds so wide that eq. (1) is St. Venant-Kirchhoff's energy to 1e-6.
SIDED = Composite(Material(1e5, 0.3, 1e-3), PRINT, c1=1e3, c2=1e3, print_side="outside")


LENGTH, WIDTH, RADIUS = 0.04, 0.01, 0.02


def in_plane(pattern: Pattern) -> Supports:
    """Three components that hold a ring in its plane without straining it."""
    x, y, z = pattern.points.T
    fixed = np.zeros(pattern.points.shape, dtype=bool)
    fixed[np.argmax(x - abs(z)), 1] = fixed[np.argmin(x + abs(z)), 1] = True
    fixed[np.argmax(y - abs(z)), 0] = True
    return Supports(fixed)


def without_poisson(composite: Composite) -> Composite:
    fabric, strip = composite.fabric, composite.reinforcement
    return replace(
        composite,
        fabric=replace(fabric, poisson=0.0),
        reinforcement=replace(strip, poisson=0.0),
    )


def printed(
    comm: MPI.Comm,
    pattern: Pattern,
    composite: Composite,
    supports: Supports,
    pressure: float = 0.0,
    force: np.ndarray | None = None,
) -> tuple[Skin, Equilibrium]:
    """Equilibrium of a skin that is printed everywhere."""
    skin = sew(comm, pattern)
    solver = EquilibriumSolver(skin, composite, supports, NewtonOptions(tolerance=1e-12))
    return skin, solver.solve(np.ones(len(skin.owned_cells)), Load(pressure, force=force))


@pytest.mark.parametrize("side", ["outside", "inside"])
def test_pulled_strip_curls_towards_the_print(alone: MPI.Comm, side: str) -> None:
    """Along N the curvature is N e/D about the print's middle, across −ν of it: a patch test."""
    pattern = rectangle(alone, LENGTH, WIDTH, 4e-3, "unstructured")
    points, border = pattern.points, pattern.free_edges
    force = np.zeros(points.shape)
    pull = 1e-6  # N/m, so little that it does not straighten what it curls
    for end, sign in ((0.0, -1), (LENGTH, 1)):
        for edge in border[(np.abs(points[border, 0] - end) < 1e-9).all(axis=1)]:
            force[edge, 0] += sign * pull * np.linalg.norm(np.subtract(*points[edge])) / 2
    corner = [int(np.argmin(np.abs(points[:, :2] - at).sum(axis=1)))
              for at in ((0, 0), (LENGTH, 0), (0, WIDTH))]  # fmt: skip
    fixed = np.zeros(points.shape, dtype=bool)
    fixed[corner, 2], fixed[corner[0]], fixed[corner[1], 1] = True, True, True
    composite = replace(SIDED, print_side=side)
    skin, found = printed(alone, pattern, composite, Supports(fixed), force=force)
    x, y, z = skin.gather_vertices(found.positions).T
    table = np.column_stack([np.ones(len(x)), x, y, x * x / 2, x * y, y * y / 2])
    fit = np.linalg.lstsq(table, z, rcond=None)[0]
    expected = pull * OFFSET / (PRINT.young * PRINT.thickness**3 / 12)
    # The normal is +z, and z'' > 0 lifts the ends.
    sign = 1 if side == "outside" else -1
    curvature = sign * expected * np.array([1, 0, -PRINT.poisson])
    assert fit[3:] == pytest.approx(curvature, abs=1e-5 * expected)
    assert np.abs(table @ fit - z).max() < 1e-6 * np.ptp(z)


@pytest.mark.parametrize("side", ["outside", "inside"])
def test_rolled_strip_bends_about_the_print(alone: MPI.Comm, side: str) -> None:
    """D − B²/A = E h³/12; the fabric's middle is longer or shorter by e times the angle."""
    angle, errors = np.pi / 2, []
    composite = without_poisson(replace(SIDED, print_side=side))
    for edge in (5e-3, 2.5e-3):
        pattern = rectangle(alone, LENGTH, WIDTH, edge, "right")
        points, border = pattern.points, pattern.free_edges
        tip = points[:, 0] > LENGTH - 1e-9
        ends = border[tip[border].all(axis=1)]
        normals = np.tile([np.cos(angle), 0, np.sin(angle)], (len(ends), 1))
        free = np.zeros(points.shape, dtype=bool)
        held = build_in(pattern, points[:, 0] < 1e-9) | Supports(free, ends, normals)
        skin, found = printed(alone, pattern, composite, held)
        # Turned upwards, the face of the normal +z is the inner one of the bend.
        strain = OFFSET * angle / LENGTH * (1 if side == "outside" else -1)
        radius = LENGTH * (1 + strain) / angle
        D = PRINT.young * PRINT.thickness**3 / 12
        energy = D / 2 * (angle / LENGTH) ** 2 * LENGTH * WIDTH
        place = skin.gather_vertices(found.positions)[tip].mean(axis=0)
        errors.append([place[0] / radius - 1, place[2] / radius - 1, found.energy / energy - 1])
    coarse, fine = np.abs(errors)
    assert np.all(fine < 4e-3)
    assert np.all(fine < coarse / 2)


@pytest.mark.parametrize("curvature", CURVATURES)
def test_printed_ring(alone: MPI.Comm, curvature: str) -> None:
    """Of given curvature 1/R, the print's middle has the strain ε ± e/R; E h of it is P R (1 + ε).

    Without a pressure the ring gets narrower by e with the print outside, wider with it inside.
    """
    stiffness, z = PRINT.membrane_stiffness, 0.01
    patterns = [
        cylinder(alone, z, 2 * RADIUS, edge, mesh="structured", caps=None) for edge in (4e-3, 2e-3)
    ]
    for side, pressure in (("outside", 0.0), ("inside", 2e3)):
        composite = replace(SIDED, bending=Bending(curvature), print_side=side)
        errors = []
        for pattern in patterns:
            held = symmetry_plane(pattern, 2) | symmetry_plane(pattern, 2, z) | in_plane(pattern)
            skin, found = printed(
                alone, pattern, without_poisson(composite), held, pressure=pressure
            )
            place = skin.gather_vertices(found.positions)
            strain = np.hypot(place[:, 0], place[:, 1]).mean() / RADIUS - 1
            by_print = pressure * RADIUS * (1 + strain) / stiffness
            errors.append(strain + composite.eccentricity / RADIUS - by_print)
        coarse, fine = np.abs(errors) / (OFFSET / RADIUS)
        assert fine < 2e-3
        assert fine < coarse / 3


@pytest.fixture(scope="module")
def sides(short_tube: Skin) -> dict[str | None, SkinModel]:
    """The tube with the print outside, inside, and in the middle."""
    models = {}
    for side in ("outside", "inside", None):
        composite = Composite(print_side=side)
        models[side] = model_on_base(short_tube, composite)
        pressurize(models[side], 2e3)
    return models


def test_fabric_is_unchanged(sides: dict[str | None, SkinModel], alone: MPI.Comm) -> None:
    """And what a print adds is linear in the density, its coupling opposite on both sides."""
    state = bent_tube(sides[None])
    gaps = {}
    for density in (0.0, 0.25, 1.0):
        force = {}
        for side, model in sides.items():
            model.set_density(np.full(len(model.skin.owned_cells), density))
            force[side] = model.residual(state)
        gaps[density] = force["outside"] - force["inside"]
        both = force["outside"] + force["inside"] - 2 * force[None]
        if density == 0:
            assert norm(alone, both) == norm(alone, gaps[density]) == 0
    scale = norm(alone, gaps[1.0])
    assert scale > 0
    assert norm(alone, gaps[0.25] - gaps[1.0] / 4) < 1e-10 * scale


def test_lines_around_a_tube(alone: MPI.Comm) -> None:
    """Widened by a tenth: outside, s k e ε Λ per area more than in the middle, inside less."""
    pattern = cylinder(alone, 0.06, 0.02, 4e-3, mesh="structured", caps=None)
    skin, energies = sew(alone, pattern), {}
    for side in ("outside", "inside"):
        composite = replace(SIDED, print_side=side)
        model = relaxed_model(skin, composite, clamp(pattern, ["wall"]), 1)
        model.set_density(np.tile([0.0, 0.25, 1.0, 0.0], (len(skin.owned_cells), 1)))
        state = model.assembled
        model.positions(state)[:, :2] *= 1.1
        energies[side] = model.energy(state)
    sides = round(np.pi * 0.02 / 4e-3)
    bend = 2 * np.pi / (sides * 0.02 * np.sin(np.pi / sides))
    density = 0.25 * PRINT.membrane_stiffness * OFFSET * 0.1 * bend
    gap = energies["outside"] - energies["inside"]
    assert gap == pytest.approx(2 * density * pattern.areas.sum(), rel=1e-9)
