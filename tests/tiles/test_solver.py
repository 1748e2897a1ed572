"""Tiles that repeat: exact states, what symmetry and copies ask for, derivatives, buckling."""

import dataclasses
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from helpers.scenes import table
from helpers.tiles import (
    ANGLES,
    SIDE,
    A,
    Laminate,
    R,
    blob,
    carried,
    drawn,
    law,
    modulus,
    numbers,
    pulled,
    seen_at,
    solver_of,
    stripes,
    table_composite,
    tile_of,
    turned_density,
)
from mpi4py import MPI

from toros_fem.errors import DensityError, NoEquilibriumError, ParameterError
from toros_fem.materials import Bending, Composite, Material
from toros_fem.mechanics.periodicity import ALL_PRESCRIBED, UNIAXIAL, Periodic
from toros_fem.meshes import Tile
from toros_fem.tiles.solver import TileSolver, TileState
from toros_fem.tiles.stiffness_profile import ALONG, ProfileSolver, effective_tensor

SHEAR = np.array([[0.0, 1], [0, 0], [0, 0]])
TURN = np.array([[0.0, -1], [1, 0]])
# Sides of a tile that is no square.
WIDE = (1.5, 1.0)
# A mean deformation with shear and a turn of its own, and the four parts of its plane.
SKEWED = np.array([[1.08, 0.06], [-0.03, 0.95], [0, 0]])
PARTS = np.eye(4).reshape(4, 2, 2)
PLANE = np.concatenate([PARTS, np.zeros((4, 1, 2))], axis=1)


def owned(solver: TileSolver, density: np.ndarray) -> np.ndarray:
    return density[solver.skin.owned_cells]


def tensor(solver: TileSolver, density: np.ndarray) -> np.ndarray:
    return effective_tensor(solver, owned(solver, density))


@pytest.mark.parametrize("mesh", ["crossed", "right", "unstructured"])
def test_uniform_sheet(mesh: str) -> None:
    """Alike in all directions, and as eq. (1) has it, also where it is pressed together."""
    found = tile_of(3, mesh, WIDE)
    composite = table_composite()
    solver = solver_of(found, composite)
    for printed, one in enumerate((A, R)):
        density = np.full(len(found.wraps), float(printed))
        exact = Laminate(Composite(one, one, composite.c1, composite.c2), 0.5, 0.0)
        for strain, every in ((0.02, 6), (0.1, 6), (0.3, 1 + 4 * printed), (-0.05, 1)):
            profile = pulled(solver, density, strain, ANGLES[::every])
            stress, contraction, shear = exact.pulled(0.0, strain)
            assert profile.stress == pytest.approx(stress, rel=1e-10)
            assert profile.stiffness == pytest.approx(stress / strain, rel=1e-10)
            assert profile.contraction == pytest.approx(contraction, rel=1e-9)
            assert profile.shear == pytest.approx(shear, abs=1e-13)
            assert np.ptp(numbers(profile), axis=0) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("material", ["A", "R"])
def test_uniform_sheet_as_tabulated(material: str) -> None:
    solver = solver_of(tile_of(3), table_composite())
    density = np.full(len(solver.skin.pattern.panel), float(material == "R"))
    for row in table("gent_uniaxial"):
        stretch = float(row["stretch"])
        if row["mat"] != material or stretch == 1 or stretch > 1.5:
            continue
        profile = pulled(solver, density, stretch - 1, ANGLES[1:2])
        assert profile.stress == pytest.approx(float(row["nominal_stress_Pa"]), rel=1e-7)
        across = 1 - profile.contraction * (stretch - 1)
        assert across == pytest.approx(float(row["lateral_stretch"]), abs=1e-8)


PHASES = ("E1", "nu1", "E2", "nu2")


@pytest.mark.parametrize(
    "phases",
    sorted({tuple(row[name] for name in PHASES) for row in table("laminate_plane_stress")}),
)
def test_effective_tensor_of_stripes(phases: tuple[str, ...]) -> None:
    """Phase 1 in stripes along x: as tabulated, and as the closed form has it."""
    e1, nu1, e2, nu2 = map(float, phases)
    third = abs(nu1 - 1 / 3) < 1e-6  # the table has six digits of it
    hard = Material(e1, 1 / 3 if third else nu1, 1.0)
    composite = Composite(Material(e2, nu2, 1.0), hard, bending=None)
    found = tile_of(10, shape=(0.3, 2.0))
    solver = solver_of(found, composite, ALL_PRESCRIBED)
    rows = [r for r in table("laminate_plane_stress") if tuple(r[n] for n in PHASES) == phases]
    assert len(rows) == 4
    for row in rows:
        share = float(row["f1"])
        result = tensor(solver, stripes(found, 20, round(20 * share)))
        names = ("Qxx(along stripes)", "Qyy", "Qxy", "G")
        along, across, cross, shear = (float(row[name]) for name in names)
        expected = np.array([[along, cross, 0], [cross, across, 0], [0, 0, shear]])
        assert result == pytest.approx(expected, rel=1e-8, abs=1e-8)
        for degrees in range(0, 91, 15):
            value = float(row[f"E_{degrees}"])
            assert modulus(result, np.radians(degrees)) == pytest.approx(value, rel=1e-8)
        exact = Laminate(composite, share, np.pi / 2).stiffness()
        assert result == pytest.approx(exact, rel=1e-12, abs=1e-13 * along)


@pytest.mark.parametrize("share", [0.1, 0.5])
def test_stripes_at_finite_strain(share: float) -> None:
    """Pulled along and across, as tabulated for stripes of the same stretch bounds."""
    count = 10 if share == 0.1 else 4
    found = tile_of(10, shape=(0.3, 0.1 * count))
    solver = solver_of(found, table_composite())
    density = stripes(found, count, round(share * count))
    for row in table("laminate_gent_eq1"):
        if float(row["f(mat R)"]) != share or row["phase2"] != "A":
            continue
        strain = float(row["mean_stretch"]) - 1
        profile = pulled(solver, density, strain, np.array([0, np.pi / 2]))
        expected = [float(row["P_along_stripes_Pa"]), float(row["P_across_Pa"])]
        assert profile.stress == pytest.approx(expected, rel=5e-8)
        across = 1 - profile.contraction[1] * strain
        assert across == pytest.approx(float(row["lateral_stretch_common_across"]), abs=1e-8)
        assert profile.shear == pytest.approx(0, abs=1e-12)
        state = profile.state[1]
        assert state is not None
        heights = solver.skin.gather_vertices(state.positions)[:, 0]
        rows = solver.skin.pattern.points[:, 1] / SIDE
        steps = [
            (heights[np.isclose(rows, 0.1 * (k + 1))] - heights[np.isclose(rows, 0.1 * k)]).mean()
            for k in (0, count - 2)
        ]
        stretches = [float(row[f"stretch_{name}_across"]) for name in ("R", "phase2")]
        assert steps == pytest.approx(np.multiply(0.1 * SIDE, stretches), rel=1e-8)


def oblique() -> tuple[Tile, np.ndarray]:
    """A tile one quarter of which is stripes along the falling diagonals of its mesh."""
    found = tile_of(4, "right")
    return found, stripes(found, 4, 1, diagonal=True)


@pytest.mark.parametrize("composite", [table_composite(), Composite()], ids=["A", "default"])
def test_stripes_in_every_direction(composite: Composite) -> None:
    """Pulled at an angle to their stripes, laminates lean over; nothing is symmetric there."""
    found, density = oblique()
    solver, exact = solver_of(found, composite), Laminate(composite, 0.25, np.pi / 4)
    angles, h = ANGLES[::2] + 0.1, 1e-4
    for strain in (0.02, 0.15, -0.03):
        profile = pulled(solver, density, strain, angles)
        expected = np.array([exact.pulled(angle, strain) for angle in angles])
        assert profile.stress == pytest.approx(expected[:, 0], rel=3e-10)
        assert profile.contraction == pytest.approx(expected[:, 1], abs=3e-10)
        assert profile.shear == pytest.approx(expected[:, 2], abs=1e-10)
        assert np.abs(profile.shear / strain).max() > 0.5
        ends = [exact.pulled(angles[1], strain + s * h)[0] for s in (1, -1)]
        assert profile.tangent[1] == pytest.approx((ends[0] - ends[1]) / (2 * h), rel=1e-6)


def test_profile_at_small_strain_is_that_of_the_tensor() -> None:
    found, density = oblique()
    result = tensor(solver_of(found, fixed=ALL_PRESCRIBED), density)
    exact = Laminate(Composite(), 0.25, np.pi / 4).stiffness()
    assert result == pytest.approx(exact, rel=1e-13)
    profile = pulled(solver_of(found), density, 1e-6)
    expected = [modulus(result, angle) for angle in ANGLES]
    assert profile.tangent == pytest.approx(expected, rel=1e-5)
    assert profile.stiffness == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(
    ("mesh", "copies"),
    [("crossed", (2, 2)), ("right", (1, 3)), ("unstructured", (2, 2)), ("unstructured", (1, 3))],
)
def test_copies_do_what_one_tile_does(mesh: str, copies: tuple[int, int]) -> None:
    small = tile_of(3, mesh, WIDE)
    many = small.repeated(*copies)
    density, angles = drawn(small), ANGLES[1::5]
    one, other = solver_of(small), solver_of(many.tile)
    single = pulled(one, density, 0.1, angles)
    several = pulled(other, density[many.cell], 0.1, angles)
    assert numbers(several) == pytest.approx(numbers(single), abs=3e-10)
    for a, b in zip(single.state, several.state, strict=True):
        assert a is not None
        assert b is not None
        assert b.energy == pytest.approx(a.energy, rel=1e-12)
        assert b.stretch_use == pytest.approx(a.stretch_use, rel=1e-9)
    if mesh != "unstructured":
        return
    one, other = (solver_of(each, fixed=ALL_PRESCRIBED) for each in (small, many.tile))
    a, b = (
        solver.solve(owned(solver, values), 0.4, SKEWED)
        for solver, values in ((one, density), (other, density[many.cell]))
    )
    assert b.energy == pytest.approx(a.energy, rel=1e-12)
    assert b.stress == pytest.approx(a.stress, rel=1e-11)


def test_shifted_turned_and_mirrored_designs() -> None:
    found = tile_of(4)
    solver = solver_of(found)
    density = drawn(found, 1)
    plain = numbers(pulled(solver, density, 0.1))
    assert np.ptp(plain[:, 0]) > 0.01, "the design must tell directions apart"
    for shift in ((0.5, 0.5), (0.25, 0.0)):
        moved = turned_density(density, carried(found, np.eye(2), shift))
        assert not np.array_equal(moved, density)
        assert numbers(pulled(solver, moved, 0.1)) == pytest.approx(plain, abs=2e-10)
    moved = turned_density(density, carried(found, TURN))
    # The last half of a turn is the first one again.
    assert numbers(pulled(solver, moved, 0.1)) == pytest.approx(np.roll(plain, 6, 0), abs=2e-10)
    moved = turned_density(density, carried(found, np.diag([-1.0, 1.0])))
    mirrored = plain[-np.arange(12)] * [1, 1, 1, -1]
    assert numbers(pulled(solver, moved, 0.1)) == pytest.approx(mirrored, abs=2e-10)


def test_symmetric_designs_have_symmetric_tensors() -> None:
    found = tile_of(4, "unstructured", symmetry="tetragonal")
    solver = solver_of(found, fixed=ALL_PRESCRIBED)
    every = drawn(found)[found.symmetry_maps("tetragonal")].mean(axis=0)
    result = tensor(solver, every)
    assert seen_at(result, np.pi / 2) == pytest.approx(result, abs=1e-13 * result.max())
    assert np.abs(result[2, :2]).max() < 1e-13 * result.max()
    chiral = tensor(solver, drawn(found)[found.symmetry_maps("chiral")].mean(axis=0))
    assert seen_at(chiral, np.pi / 2) == pytest.approx(chiral, abs=1e-13 * chiral.max())
    assert np.abs(chiral[2, :2]).max() > 1e-4 * chiral.max()


def test_mean_deformation_may_be_turned() -> None:
    """Turned in space the stress turns along; seen in other axes it is the same."""
    found = tile_of(3, "unstructured", WIDE)
    solver = solver_of(found, fixed=ALL_PRESCRIBED)
    density = owned(solver, drawn(found))
    plain = solver.solve(density, 0.0, SKEWED)
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    turned = solver.solve(density, 0.0, turn @ SKEWED)
    assert turned.energy == pytest.approx(plain.energy, rel=1e-12)
    scale = np.abs(plain.stress).max()
    assert turned.stress == pytest.approx(turn @ plain.stress, abs=1e-11 * scale)
    seen = solver.solve(density, 0.7, turn.T @ SKEWED @ turn[:2, :2])
    assert seen.energy == pytest.approx(plain.energy, rel=1e-12)
    expected = turn.T @ plain.stress @ turn[:2, :2]
    assert seen.stress == pytest.approx(expected, abs=1e-11 * scale)


def central(values: list[np.ndarray], step: float) -> np.ndarray:
    """Slope from values at −2, −1, 1 and 2 steps."""
    return np.asarray((values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * step))


STEPS = (-2, -1, 1, 2)


@pytest.mark.parametrize("gradient", [np.eye(3)[:, :2] + 0.05 * ALONG, SKEWED])
def test_stress_and_tangent_are_derivatives_of_the_energy(gradient: np.ndarray) -> None:
    found = tile_of(3, "unstructured", WIDE)
    solver = solver_of(found, fixed=ALL_PRESCRIBED)
    density, step = owned(solver, drawn(found)), 2e-4
    base = solver.solve(density, 0.4, gradient)
    stiffness = solver.stiffness(base, PLANE)
    assert stiffness == pytest.approx(stiffness.T, rel=1e-11)
    scale = np.abs(base.stress).max()
    for part, row in zip(PLANE, stiffness, strict=True):
        near = [solver.solve(density, 0.4, gradient + s * step * part) for s in STEPS]
        stress = central([np.array(state.energy) for state in near], step)
        assert stress == pytest.approx((base.stress * part).sum(), abs=1e-9 * scale)
        tangent = central([state.stress for state in near], step)
        assert tangent[:2].ravel() == pytest.approx(row, abs=1e-9 * np.abs(stiffness).max())


@pytest.mark.parametrize("flat", [True, False])
@pytest.mark.parametrize("strain", [0.1, -0.04])
def test_stress_along_a_direction_is_that_of_the_energy(flat: bool, strain: float) -> None:
    """What is free costs nothing; also of a tile that has buckled."""
    found = tile_of(4, "right")
    solver = solver_of(found, flat=flat)
    density, step = owned(solver, blob(found)), 1e-4
    base = solver.solve(density, 0.4, (1 + strain) * ALONG)
    tangent = solver.stiffness(base, ALONG[None])[0, 0]
    response = solver.response(base, ALONG)
    near = [solver.solve(density, 0.4, (1 + strain + s * step) * ALONG, start=base) for s in STEPS]
    stress = central([np.array(state.energy) for state in near], step)
    assert stress == pytest.approx(base.stress[0, 0], rel=1e-9)
    found_tangent = central([state.stress[0, 0] for state in near], step)
    assert found_tangent == pytest.approx(tangent, rel=1e-7)
    moved = central([state.state for state in near], step)
    assert moved == pytest.approx(response, abs=1e-8 * np.abs(response).max())
    assert (base.stress[:2, 1] == 0).all()


def test_forces_and_moments_balance() -> None:
    found = tile_of(3, "unstructured", WIDE)
    density = drawn(found)
    for fixed in (ALL_PRESCRIBED, UNIAXIAL):
        solver = solver_of(found, fixed=fixed)
        state = solver.solve(owned(solver, density), 0.4, SKEWED)
        kirchhoff = state.stress @ state.gradient.T
        assert kirchhoff == pytest.approx(kirchhoff.T, abs=1e-10 * np.abs(kirchhoff).max())
        assert state.gradient[np.array(fixed)] == pytest.approx(SKEWED[np.array(fixed)], abs=1e-15)
    # The mean of the triangles' own stress is the mean stress, that of their gradients F̄.
    c, s = np.cos(0.4), np.sin(0.4)
    axes = np.array([[c, -s], [s, c]])
    pattern, composite = found.pattern, Composite()
    corner = solver.skin.gather_vertices(state.positions)[pattern.triangles][:, :, :2]
    corner = corner + found.wraps @ found.lattice @ axes @ state.gradient[:2].T
    flat = pattern.corners @ axes
    total, mean = np.zeros((2, 2)), np.zeros((2, 2))
    for k, area in enumerate(pattern.areas):
        deformed, chart = np.diff(corner[k], axis=0).T, np.diff(flat[k], axis=0).T
        gradient = deformed @ np.linalg.inv(chart)
        mixed = (law(gradient, m, composite.c1, composite.c2)
                 for m in (composite.fabric, composite.reinforcement))  # fmt: skip
        total += area * (np.array([1 - density[k], density[k]]) @ [m.ravel() for m in mixed]
                         ).reshape(2, 2)  # fmt: skip
        mean += area * gradient
    assert mean / pattern.areas.sum() == pytest.approx(state.gradient[:2], abs=1e-12)
    scale = np.abs(state.stress).max()
    assert total / pattern.areas.sum() == pytest.approx(state.stress[:2], abs=1e-11 * scale)


@pytest.mark.parametrize("seed", range(3))
def test_bounds_of_voigt_and_reuss(seed: int) -> None:
    found = tile_of(3, "unstructured", WIDE)
    soft, hard = Material(0.1e6, 0.1, 0.5e-3), Material(26e6, 0.4, 0.5e-3)
    solver = solver_of(found, Composite(soft, hard, bending=None), ALL_PRESCRIBED)
    density = drawn(found, seed) ** (1 + seed)
    result = tensor(solver, density)
    assert result == pytest.approx(result.T, rel=1e-11, abs=1e-12 * result.max())
    assert np.linalg.eigvalsh(result).min() > 0
    one, other = (Laminate(Composite(soft, hard), share, 0.0).stiffness() for share in (0.0, 1.0))
    weights = found.pattern.areas / found.pattern.areas.sum()
    phases = one + density[:, None, None] * (other - one)
    voigt = np.einsum("k,kij", weights, phases)
    reuss = np.linalg.inv(np.einsum("k,kij", weights, np.linalg.inv(phases)))
    least = 1e-3 * np.linalg.eigvalsh(voigt - reuss).min()
    assert np.linalg.eigvalsh(voigt - result).min() > least > 0
    assert np.linalg.eigvalsh(result - reuss).min() > least


def test_all_of_the_mean_deformation_but_turns_may_be_free() -> None:
    """Held by one shear alone a tile goes back to where it is not stretched."""
    found = tile_of(3)
    fixed = ((False, False), (True, False), (True, True))
    solver = solver_of(found, fixed=fixed)
    density = owned(solver, drawn(found))
    start = solver_of(found, fixed=UNIAXIAL).solve(density, 0.3, 1.05 * ALONG)
    state = solver.solve(density, 0.3, np.zeros((3, 2)), start=start)
    assert state.gradient == pytest.approx(np.eye(3)[:, :2], abs=1e-13)
    assert np.abs(state.stress).max() < 1e-9 * np.abs(start.stress).max()
    assert (state.stress[~np.array(fixed)] == 0).all()


def lifted(solver: TileSolver, flat: TileState) -> np.ndarray:
    """A flat state among those of a tile that bends."""
    state = solver.model.assembled
    solver.model.positions(state)[:] = flat.positions
    solver.model.set_mean_gradient(state, flat.gradient)
    return state


def test_pulled_out_of_plane_stays_in_it() -> None:
    found = tile_of(4)
    density, angles = blob(found), ANGLES[::4]
    one, other = solver_of(found), solver_of(found, flat=False)
    flat, free = (pulled(solver, density, 0.02, angles) for solver in (one, other))
    assert numbers(free) == pytest.approx(numbers(flat), abs=1e-12)
    for a, b in zip(free.state, flat.state, strict=True):
        assert a is not None
        assert b is not None
        assert a.positions[:, 2] == pytest.approx(0, abs=1e-15)
        assert a.energy == pytest.approx(b.energy, rel=1e-12)
        assert other.stable(lifted(other, b), owned(other, density), b.angle)


def test_pressed_tile_buckles() -> None:
    found = tile_of(6, "right")
    one, other = solver_of(found), solver_of(found, flat=False)
    density = owned(one, stripes(found, 6, 2))
    for angle, strain, buckles in ((np.pi / 2, -0.04, True), (0.0, -0.04, True),
                                   (np.pi / 2, 0.04, False)):  # fmt: skip
        flat = one.solve(density, angle, (1 + strain) * ALONG)
        assert one.stable(flat.state, density, angle)
        state = lifted(other, flat)
        assert other.stable(state, density, angle) != buckles
        assert other.buckles(flat, density) == buckles
        with pytest.raises(ParameterError, match="flat=False"):
            one.buckles(flat, density)
        assert other.model.energy(state) / other.area == pytest.approx(flat.energy, rel=1e-12)
        curved = other.solve(density, angle, (1 + strain) * ALONG)
        assert other.stable(curved.state, density, angle)
        height = np.ptp(other.skin.gather_vertices(curved.positions)[:, 2])
        if buckles:
            assert height > 0.1 * SIDE
            assert curved.energy < 0.1 * flat.energy
        else:
            assert height < 1e-12 * SIDE
            assert curved.energy == pytest.approx(flat.energy, rel=1e-11)


def places(solver: TileSolver, angle: float) -> np.ndarray:
    """Flat places of all vertices in axes n, t."""
    return solver.skin.gather_vertices(solver.flat_places(angle))


def moved_state(
    solver: TileSolver, state: TileState, there: TileSolver, image: np.ndarray, vertex: np.ndarray
) -> np.ndarray:
    """A state, without rotations, of another tile: a vertex each of its vertices is an image of."""
    angle, new = state.angle, there.model.assembled
    old = solver.skin.gather_vertices(state.positions)[vertex]
    old += (places(there, angle)[image] - places(solver, angle)[vertex]) @ state.gradient.T
    every = np.empty_like(old)
    every[image] = old
    every += np.append(places(there, angle)[0], 0.0) - every[0]
    there.model.positions(new)[:] = every[there.skin.owned_vertices]
    there.model.set_mean_gradient(new, state.gradient)
    return new


@pytest.mark.parametrize("mesh", ["right", "unstructured"])
def test_copies_of_a_buckled_tile(mesh: str) -> None:
    """They see across their borders what the tile sees across its own."""
    small = tile_of(3, mesh, WIDE)
    many, bending = small.repeated(2, 2), Composite(bending=Bending("quadratic"))
    one, other = (solver_of(each, bending, flat=False) for each in (small, many.tile))
    density = blob(small)
    buckled = one.solve(owned(one, density), 0.4, 0.96 * ALONG)
    assert np.ptp(one.skin.gather_vertices(buckled.positions)[:, 2]) > 0.05 * SIDE
    count = len(many.tile.pattern.points)
    vertex = np.arange(count) % len(small.pattern.points)
    state = moved_state(one, buckled, other, np.arange(count), vertex)
    other.stable(state, owned(other, density[many.cell]), 0.4)  # turns the axes
    assert other.model.energy(state) / other.area == pytest.approx(buckled.energy, rel=1e-11)
    residual = other.skin.gather_vertices(other.model.positions(other.model.residual(state)))
    inside = one.skin.gather_vertices(one.model.positions(one.model.residual(buckled.state)))
    scale = abs(buckled.stress[0, 0]) * SIDE
    assert np.abs(inside).max() < 1e-9 * scale
    assert np.abs(residual).max() < 1e-9 * scale
    stress = other.model.mean_force(state) / other.area
    assert stress == pytest.approx(buckled.stress, abs=1e-10 * np.abs(buckled.stress).max())


@pytest.mark.parametrize("curvature", ["midedge", "quadratic", "average"])
def test_buckled_tile_may_be_cut_elsewhere(curvature: str) -> None:
    found = tile_of(4)
    solver = solver_of(found, Composite(bending=Bending(curvature)), flat=False)
    density, shift = blob(found), np.array([0.25, 0.5])
    base = solver.solve(owned(solver, density), 0.4, 0.96 * ALONG)
    points = found.pattern.points[:, :2] / SIDE
    gap = (points[:, None] + shift - points) % 1.0
    image = np.argmin(np.minimum(gap, 1 - gap).sum(axis=2), axis=1)
    start = dataclasses.replace(base, state=moved_state(solver, base, solver, image,
                                                        np.arange(len(points))))  # fmt: skip
    moved = turned_density(density, carried(found, np.eye(2), (0.25, 0.5)))
    state = solver.solve(owned(solver, moved), 0.4, 0.96 * ALONG, start=start)
    assert state.energy == pytest.approx(base.energy, rel=1e-11)
    assert state.stress[0, 0] == pytest.approx(base.stress[0, 0], rel=1e-10)
    assert state.gradient == pytest.approx(base.gradient, abs=1e-11)


def test_refinement() -> None:
    """Of a smooth round inclusion and of smooth oblique stripes, about with h²."""
    composite = table_composite()
    for mesh in ("crossed", "right"):
        values: list[list[np.ndarray]] = [[], []]
        for edges in (4, 8, 16):
            found = tile_of(edges, mesh)
            x, y = (2 * np.pi * found.pattern.centroids / SIDE).T
            wave = np.cos(x) + np.cos(y) if mesh == "crossed" else np.cos(x + y)
            density = 1 / (1 + np.exp(-3 * wave))
            values[0].append(tensor(solver_of(found, composite, ALL_PRESCRIBED), density))
            if mesh == "crossed":
                solver = solver_of(found, composite)
                values[1].append(numbers(pulled(solver, density, 0.1, ANGLES[1:3])))
        for each in values[: 1 + (mesh == "crossed")]:
            gaps = [np.linalg.norm(b - a) for a, b in pairwise(each)]
            assert gaps[0] > 2.5 * gaps[1]


def test_stretched_beyond_the_bounds() -> None:
    found = tile_of(3)
    solver = solver_of(found)
    density = owned(solver, drawn(found))
    with pytest.raises(NoEquilibriumError, match=r"no equilibrium .* along 22.92 degrees .*"
                       r"c1 = 1.9, c2 = 2.6. Stretch it less"):  # fmt: skip
        solver.solve(density, 0.4, 1.92 * ALONG)
    near = solver.solve(density, 0.4, 1.05 * ALONG)
    assert near.stretch_use < 1
    far = solver.solve(density, 0.4, 1.3 * ALONG, start=near)
    assert far.stress[0, 0] == pytest.approx(solver.solve(density, 0.4, 1.3 * ALONG).stress[0, 0])
    with pytest.raises(NoEquilibriumError):
        solver.solve(density, 0.4, 0.05 * ALONG, allow_continuation=False)


def test_directions_spread_over_ranks(comm: MPI.Comm, monkeypatch: pytest.MonkeyPatch) -> None:
    """A rank that finds no equilibrium tells the others, and all profiles are the same."""
    found = tile_of(3)
    solver, spread = solver_of(found, alone=True), solver_of(found)
    density = drawn(found)
    batched = ProfileSolver(solver, ANGLES[:5], 0.1, batch=comm).solve(owned(solver, density))
    parted = pulled(spread, density, 0.1, ANGLES[:5])
    assert numbers(parted) == pytest.approx(numbers(batched), abs=1e-12)
    assert [k for k, state in enumerate(batched.state) if state is not None] == list(
        range(comm.rank, 5, comm.size)
    )
    assert all(state is not None for state in parted.state)
    every = comm.allgather((batched.stress, batched.tangent, batched.contraction, batched.steps))
    for stress, tangent, contraction, steps in every:
        assert (stress == batched.stress).all()
        assert (tangent == batched.tangent).all()
        assert (contraction == batched.contraction).all()
        assert steps == batched.steps
    with pytest.raises(NoEquilibriumError):
        ProfileSolver(solver, ANGLES[:5], 0.95, batch=comm).solve(
            owned(solver, density), allow_continuation=False
        )
    # Also where only one of them fails.
    solve = solver.solve

    def failing(*args: Any, **options: Any) -> TileState:
        if args[1] == ANGLES[0]:
            raise NoEquilibriumError("none along 0 degrees")
        return solve(*args, **options)

    monkeypatch.setattr(solver, "solve", failing)
    with pytest.raises(NoEquilibriumError, match="none along 0 degrees"):
        ProfileSolver(solver, ANGLES[:5], 0.1, batch=comm).solve(owned(solver, density))


def test_start_of_a_profile() -> None:
    found = tile_of(4)
    pulling = ProfileSolver(solver_of(found), ANGLES[::3], 0.1)
    skin = pulling.tile.skin
    density = drawn(found)[skin.owned_cells]
    base = pulling.solve(density)
    near = np.clip(density + 1e-3, 0, 1)
    again, fresh = pulling.solve(near, base.state), pulling.solve(near)
    assert numbers(again) == pytest.approx(numbers(fresh), abs=1e-10)
    assert again.steps < fresh.steps
    assert (again.pressure, again.pressures) == (0.0, ())
    assert again.stiffness == pytest.approx(again.stress / 0.1, rel=1e-15)


def test_bad_tiles() -> None:
    found = tile_of(3)
    for wrong in (UNIAXIAL[:2], tuple(row[:1] for row in UNIAXIAL), ((1, 0), (1, 0), (1, 1)),
                  ((True, False), (True,), (True, True))):  # fmt: skip
        with pytest.raises(ParameterError, match="it must be 3 × 2 of True or False"):
            Periodic(found, wrong)  # type: ignore[arg-type]
    for loose in (((True, False), (False, True), (True, True)),
                  ((True, False), (True, False), (True, False))):  # fmt: skip
        with pytest.raises(ParameterError, match="may turn the tile: prescribe its z components"):
            Periodic(found, loose)
    for bending in (None, Bending(seams="hinged"), Bending(rest="assembled")):
        with pytest.raises(ParameterError, match="rest = 'flat' and seams = 'continuous'"):
            solver_of(found, Composite(bending=bending), flat=False)
        solver_of(found, Composite(bending=bending))
    assert Periodic(tile_of(3, shape=(1.5, 2.0))).length == pytest.approx(3**0.5 * SIDE)


def test_bad_deformations_and_states() -> None:
    solver = solver_of(tile_of(3))
    density = np.zeros(len(solver.skin.owned_cells))
    for gradient in (np.eye(2), np.eye(3), 1.1, np.nan * ALONG):
        with pytest.raises(ParameterError, match=r"must be \(3, 2\) and finite where held"):
            solver.solve(density, 0.0, gradient)  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match="angle = inf"):
        solver.solve(density, np.inf, ALONG)
    with pytest.raises(DensityError, match=r"must lie in \[0, 1\]"):
        solver.solve(density - 0.1, 0.0, ALONG)
    first = solver.solve(density, 0.0, np.where(np.array(UNIAXIAL), 1.1 * ALONG, np.nan))
    with pytest.raises(ParameterError, match=r"direction 0 rad, not of 0.3: start from a state"):
        solver.solve(density, 0.3, 1.1 * ALONG, start=first)
    solver.stress_gradient(first, ALONG)
    second = solver.solve(density, 0.0, 1.2 * ALONG, start=first)
    for act in (solver.response, solver.stress_gradient, solver.strain_gradient,
                lambda at, part: solver.stiffness(at, part[None])):  # fmt: skip
        with pytest.raises(ParameterError, match="the solver has been used since"):
            act(first, ALONG)
        act(second, ALONG)
    assert solver.stable(second.state, density, 0.0)
    with pytest.raises(ParameterError, match="the solver has been used since"):
        solver.response(second, ALONG)
    with pytest.raises(ParameterError, match=r"Periodic\(GIVEN\)"):
        effective_tensor(solver, density)


def test_bad_profiles(comm: MPI.Comm) -> None:
    solver = solver_of(tile_of(3))
    for strain in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ParameterError, match=f"strain = {strain} must be finite, over -1"):
            ProfileSolver(solver, ANGLES, strain)
    for angles in ([], [[0.0]], [np.nan]):
        with pytest.raises(ParameterError, match="at least one finite direction"):
            ProfileSolver(solver, angles, 0.1)  # type: ignore[arg-type]
    if comm.size > 1:
        with pytest.raises(ParameterError, match=r"over 2 ranks and its directions over 2: spread"):
            ProfileSolver(solver, ANGLES, 0.1, batch=comm)
