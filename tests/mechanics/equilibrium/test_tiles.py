"""Equilibria of periodic tiles: derivatives, balance, buckling, starts."""

from typing import Any

import numpy as np
import pytest
import shapely
from helpers.tiles import (
    SIDE,
    area_of,
    cell_map,
    mapped_cells,
    mean_gradient,
    mean_stiffness,
    mean_stress,
    owned,
    pulled,
    random_cells,
    smooth_cells,
    solver_of,
    stress_law,
    stripes,
    tile_of,
)
from mpi4py import MPI

from toros_fem.base.errors import NoEquilibriumError
from toros_fem.materials.sheet import Bending, Composite
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.terms.periodic import ALL_PRESCRIBED, UNIAXIAL, Periodic
from toros_fem.meshes import sew
from toros_fem.products.tiles.problem import lifted
from toros_fem.products.tiles.stiffness_profile import ALONG, tile_solver

# Sides of an oblong tile.
WIDE = (1.5, 1.0)
# A mean deformation with shear and rotation, and the four components in the plane.
SKEWED = np.array([[1.08, 0.06], [-0.03, 0.95], [0, 0]])
PARTS = np.eye(4).reshape(4, 2, 2)
PLANE = np.concatenate([PARTS, np.zeros((4, 1, 2))], axis=1)


def central(values: list[np.ndarray], step: float) -> np.ndarray:
    """Slope from values at −2, −1, 1 and 2 steps."""
    return np.asarray((values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * step))


STEPS = (-2, -1, 1, 2)


def derived_stiffness(
    solver: EquilibriumSolver, density: np.ndarray, gradient: np.ndarray, tolerance: float
) -> np.ndarray:
    """Return the mean stiffness; it and the mean stress must be derivatives of the energy."""
    base, step = pulled(solver, density, 0.4, gradient), 2e-4
    stiffness, at_base = mean_stiffness(solver, base, PLANE), mean_stress(solver, base)
    scale = np.abs(at_base).max()
    for part, row in zip(PLANE, stiffness, strict=True):
        near = [pulled(solver, density, 0.4, gradient + s * step * part) for s in STEPS]
        stress = central([np.array(state.energy) for state in near], step) / area_of(solver)
        assert stress == pytest.approx((at_base * part).sum(), abs=tolerance * scale)
        tangent = central([mean_stress(solver, state) for state in near], step)
        assert tangent[:2].ravel() == pytest.approx(row, abs=tolerance * np.abs(stiffness).max())
    return stiffness


@pytest.mark.parametrize("gradient", [np.eye(3)[:, :2] + 0.05 * ALONG, SKEWED])
def test_stress_and_tangent_are_derivatives_of_the_energy(gradient: np.ndarray) -> None:
    found = tile_of(3, "unstructured", WIDE)
    solver = solver_of(found, prescribed=ALL_PRESCRIBED)
    density = owned(solver, random_cells(found))
    stiffness = derived_stiffness(solver, density, gradient, 1e-9)
    assert stiffness == pytest.approx(stiffness.T, rel=1e-11)


def waves(comm: MPI.Comm, edge: float, **around: Any) -> tuple[EquilibriumSolver, np.ndarray]:
    """Return a solver of a square tile with a wavy line, quadratic there, and its density."""
    x = np.linspace(-1, 2, 91)
    line = shapely.LineString(SIDE * np.column_stack([x, 0.5 + 0.1 * np.sin(2 * np.pi * x)]))
    region = line.buffer(0.1 * SIDE) & shapely.box(0, 0, SIDE, SIDE)
    found, inside = tile_of(6).following(comm, region, edge)
    skin = sew(comm, found.pattern)
    composite = Composite(bending=Bending())
    solver = tile_solver(skin, composite, Periodic(found, **around), quadratic=inside)
    return solver, owned(solver, inside.astype(float))


def test_derivatives_with_quadratic_triangles(comm: MPI.Comm) -> None:
    """By F̄; a turned sheet has the same energy."""
    solver, density = waves(comm, 5e-3, prescribed=ALL_PRESCRIBED)
    stiffness = derived_stiffness(solver, density, SKEWED, 1e-7)
    assert stiffness == pytest.approx(stiffness.T, rel=1e-9, abs=1e-9 * stiffness.max())
    base = pulled(solver, density, 0.4, SKEWED)
    c, s = np.cos(0.3), np.sin(0.3)
    turned = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ SKEWED
    assert pulled(solver, density, 0.4, turned).energy == pytest.approx(base.energy, rel=1e-9)


def test_buckling_with_quadratic_triangles(comm: MPI.Comm) -> None:
    """The flat state is that of the other solver, with its bubbles."""
    one, density = waves(comm, 4e-3)
    other, _ = waves(comm, 4e-3, flat=False)
    for strain, buckles in ((-0.04, True), (0.04, False)):
        flat = pulled(one, density, 0.0, (1 + strain) * ALONG)
        state = lifted(other, flat)
        assert other.stable(density, flat.load, state) != buckles
        energy = other.model.energy(state)
        assert energy == pytest.approx(flat.energy, rel=1e-9)


def test_forces_and_moments_balance() -> None:
    found = tile_of(3, "unstructured", WIDE)
    density = random_cells(found)
    for prescribed in (ALL_PRESCRIBED, UNIAXIAL):
        solver = solver_of(found, prescribed=prescribed)
        state = pulled(solver, owned(solver, density), 0.4, SKEWED)
        stress, whole = mean_stress(solver, state), mean_gradient(solver, state)
        kirchhoff = stress @ whole.T
        assert kirchhoff == pytest.approx(kirchhoff.T, abs=1e-10 * np.abs(kirchhoff).max())
        assert whole[np.array(prescribed)] == pytest.approx(SKEWED[np.array(prescribed)], abs=1e-15)
    # The means of the stress and of the gradient of all triangles are P̄ and F̄.
    c, s = np.cos(0.4), np.sin(0.4)
    axes = np.array([[c, -s], [s, c]])
    pattern, composite = found.pattern, Composite()
    corner = solver.skin.gather_vertices(state.positions)[pattern.triangles][:, :, :2]
    corner = corner + found.wraps @ found.lattice @ axes @ whole[:2].T
    flat = pattern.corners @ axes
    total, mean = np.zeros((2, 2)), np.zeros((2, 2))
    for k, area in enumerate(pattern.areas):
        deformed, chart = np.diff(corner[k], axis=0).T, np.diff(flat[k], axis=0).T
        gradient = deformed @ np.linalg.inv(chart)
        mixed = (stress_law(gradient, m, composite.c1, composite.c2)
                 for m in (composite.fabric, composite.reinforcement))  # fmt: skip
        total += area * (np.array([1 - density[k], density[k]]) @ [m.ravel() for m in mixed]
                         ).reshape(2, 2)  # fmt: skip
        mean += area * gradient
    assert mean / pattern.areas.sum() == pytest.approx(whole[:2], abs=1e-12)
    scale = np.abs(stress).max()
    assert total / pattern.areas.sum() == pytest.approx(stress[:2], abs=1e-11 * scale)


def test_compressed_tile_buckles() -> None:
    found = tile_of(6, "right")
    one, other = solver_of(found), solver_of(found, flat=False)
    density = owned(one, stripes(found, 6, 2))
    for angle, strain, buckles in ((np.pi / 2, -0.04, True), (0.0, -0.04, True),
                                   (np.pi / 2, 0.04, False)):  # fmt: skip
        flat = pulled(one, density, angle, (1 + strain) * ALONG)
        assert one.stable(density, flat.load, flat.state)
        state = lifted(other, flat)
        assert other.stable(density, flat.load, state) != buckles
        assert other.model.energy(state) == pytest.approx(flat.energy, rel=1e-12)
        curved = pulled(other, density, angle, (1 + strain) * ALONG)
        assert other.stable(density, flat.load, curved.state)
        height = np.ptp(other.skin.gather_vertices(curved.positions)[:, 2])
        if buckles:
            assert height > 0.1 * SIDE
            assert curved.energy < 0.1 * flat.energy
        else:
            assert height < 1e-12 * SIDE
            assert curved.energy == pytest.approx(flat.energy, rel=1e-11)


def moved_state(
    solver: EquilibriumSolver,
    state: Equilibrium,
    there: EquilibriumSolver,
    image: np.ndarray,
    vertex: np.ndarray,
) -> np.ndarray:
    """Return a state of another tile, each vertex of which is an image of one of this tile.

    Edge rotations are not set.
    """
    new, gradient = there.model.assembled, mean_gradient(solver, state)
    old = solver.skin.gather_vertices(state.positions)[vertex]
    here, other = (one.skin.gather_vertices(one.model.images.flat) for one in (solver, there))
    old += (other[image] - here[vertex]) @ gradient.T
    every = np.empty_like(old)
    every[image] = old
    every += np.append(other[0], 0.0) - every[0]
    there.model.positions(new)[:] = every[there.skin.owned_vertices]
    there.model.images.set_mean_gradient(new, gradient)
    return new


@pytest.mark.parametrize("curvature", ["midedge", "average"])
def test_shifted_buckled_tile(curvature: str) -> None:
    """The border of the tile may lie anywhere on the periodic sheet."""
    found = tile_of(4)
    solver = solver_of(found, Composite(bending=Bending(curvature)), flat=False)
    density, shift = smooth_cells(found), np.array([0.25, 0.5])
    base = pulled(solver, owned(solver, density), 0.4, 0.96 * ALONG)
    points = found.pattern.points[:, :2] / SIDE
    gap = (points[:, None] + shift - points) % 1.0
    image = np.argmin(np.minimum(gap, 1 - gap).sum(axis=2), axis=1)
    start = moved_state(solver, base, solver, image, np.arange(len(points)))
    moved = mapped_cells(density, cell_map(found, np.eye(2), (0.25, 0.5)))
    state = pulled(solver, owned(solver, moved), 0.4, 0.96 * ALONG, start=start)
    assert state.energy == pytest.approx(base.energy, rel=1e-11)
    assert mean_gradient(solver, state) == pytest.approx(mean_gradient(solver, base), abs=1e-11)
    stress = mean_stress(solver, state)[0, 0]
    assert stress == pytest.approx(mean_stress(solver, base)[0, 0], rel=1e-10)


def test_stretched_beyond_the_bounds() -> None:
    found = tile_of(3)
    solver = solver_of(found)
    density = owned(solver, random_cells(found))
    with pytest.raises(NoEquilibriumError, match=r"bounds \(c1 = 1.9, c2 = 2.6\) was found at the "
                       r"mean deformation .* along 22.92 degrees, .* Lower the load"):  # fmt: skip
        pulled(solver, density, 0.4, 1.92 * ALONG)
    near = pulled(solver, density, 0.4, 1.05 * ALONG)
    far = pulled(solver, density, 0.4, 1.3 * ALONG, start=near)
    again = pulled(solver, density, 0.4, 1.3 * ALONG)
    assert mean_stress(solver, far)[0, 0] == pytest.approx(mean_stress(solver, again)[0, 0])
    with pytest.raises(NoEquilibriumError):
        pulled(solver, density, 0.4, 0.05 * ALONG, once=True)


def test_a_start_that_leads_nowhere() -> None:
    """It is tried once where that is asked for; else the flat sheet is stretched."""
    found = tile_of(3)
    solver = solver_of(found)
    density = owned(solver, random_cells(found))
    pressed = pulled(solver, density, 0.4, 0.3 * ALONG).state
    with pytest.raises(NoEquilibriumError, match="at once: "):
        pulled(solver, density, 0.4, 1.8 * ALONG, pressed, once=True)
    state = pulled(solver, density, 0.4, 1.8 * ALONG, pressed)
    fresh = pulled(solver, density, 0.4, 1.8 * ALONG)
    assert state.state == pytest.approx(fresh.state, abs=1e-9 * SIDE)


def test_flat_tiles_may_bend_in_any_way() -> None:
    for bending in (None, Bending(seams="hinged"), Bending(rest="assembled")):
        solver_of(tile_of(3), Composite(bending=bending))
    assert Periodic(tile_of(3, shape=(1.5, 2.0))).length == pytest.approx(3**0.5 * SIDE)


def test_derivatives_after_another_solve() -> None:
    """The tangent of an earlier equilibrium is made again."""
    solver = solver_of(tile_of(3))
    density = owned(solver, random_cells(tile_of(3)))
    first = pulled(solver, density, 0.0, 1.1 * ALONG)
    force, motion = solver.stretch(first, ALONG)
    pulled(solver, 0 * density, 0.3, 1.2 * ALONG)
    again = solver.stretch(first, ALONG)
    assert again[0] == pytest.approx(force, rel=1e-12, abs=1e-12 * np.abs(force).max())
    assert again[1] == pytest.approx(motion, rel=1e-9, abs=1e-9 * np.abs(motion).max())


def test_a_saved_tile_is_restored() -> None:
    solver = solver_of(tile_of(3))
    density, load = owned(solver, random_cells(tile_of(3))), Load(gradient=1.1 * ALONG, angle=0.4)
    at = solver.solve(density, load)
    unknowns, numbers = solver.save(at)
    pulled(solver, density, 0.0, 1.2 * ALONG)
    found = solver.restore(density, unknowns, numbers, load)
    assert np.array_equal(found.state, at.state)
    assert mean_stress(solver, found) == pytest.approx(mean_stress(solver, at), rel=1e-13)
