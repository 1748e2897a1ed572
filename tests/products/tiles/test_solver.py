"""Equilibria of periodic tiles: derivatives, balance, buckling, bad input."""

import dataclasses
from typing import Any

import numpy as np
import pytest
import shapely
from helpers.tiles import (
    SIDE,
    cell_map,
    mapped_cells,
    owned,
    random_cells,
    smooth_cells,
    solver_of,
    stress_law,
    stripes,
    tile_of,
)
from mpi4py import MPI

from toros_fem.base.errors import NoEquilibriumError, ParameterError
from toros_fem.materials.sheet import Bending, Composite
from toros_fem.mechanics.skin.periodicity import ALL_PRESCRIBED, UNIAXIAL, Periodic
from toros_fem.meshes import sew
from toros_fem.products.tiles.solver import TileSolver, TileState
from toros_fem.products.tiles.stiffness_profile import ALONG

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


@pytest.mark.parametrize("gradient", [np.eye(3)[:, :2] + 0.05 * ALONG, SKEWED])
def test_stress_and_tangent_are_derivatives_of_the_energy(gradient: np.ndarray) -> None:
    found = tile_of(3, "unstructured", WIDE)
    solver = solver_of(found, prescribed=ALL_PRESCRIBED)
    density, step = owned(solver, random_cells(found)), 2e-4
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


def waves(comm: MPI.Comm, edge: float, **around: Any) -> tuple[TileSolver, np.ndarray]:
    """Return a solver of a square tile with a wavy line, quadratic there, and its density."""
    x = np.linspace(-1, 2, 91)
    line = shapely.LineString(SIDE * np.column_stack([x, 0.5 + 0.1 * np.sin(2 * np.pi * x)]))
    region = line.buffer(0.1 * SIDE) & shapely.box(0, 0, SIDE, SIDE)
    found, inside = tile_of(6).following(comm, region, edge)
    skin = sew(comm, found.pattern)
    composite = Composite(bending=Bending())
    solver = TileSolver(skin, composite, Periodic(found, **around), quadratic=inside)
    return solver, owned(solver, inside.astype(float))


def test_derivatives_with_quadratic_triangles(comm: MPI.Comm) -> None:
    """By F̄; a turned sheet has the same energy."""
    solver, density = waves(comm, 5e-3, prescribed=ALL_PRESCRIBED)
    step = 2e-4
    base = solver.solve(density, 0.4, SKEWED)
    stiffness = solver.stiffness(base, PLANE)
    assert stiffness == pytest.approx(stiffness.T, rel=1e-9, abs=1e-9 * stiffness.max())
    scale = np.abs(base.stress).max()
    for part, row in zip(PLANE, stiffness, strict=True):
        near = [solver.solve(density, 0.4, SKEWED + s * step * part) for s in STEPS]
        stress = central([np.array(state.energy) for state in near], step)
        assert stress == pytest.approx((base.stress * part).sum(), abs=1e-7 * scale)
        tangent = central([state.stress for state in near], step)
        assert tangent[:2].ravel() == pytest.approx(row, abs=1e-7 * np.abs(stiffness).max())
    c, s = np.cos(0.3), np.sin(0.3)
    turned = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ SKEWED
    assert solver.solve(density, 0.4, turned).energy == pytest.approx(base.energy, rel=1e-9)


def test_buckling_with_quadratic_triangles(comm: MPI.Comm) -> None:
    """The flat state is that of the other solver, with its bubbles."""
    one, density = waves(comm, 4e-3)
    other, _ = waves(comm, 4e-3, flat=False)
    for strain, buckles in ((-0.04, True), (0.04, False)):
        flat = one.solve(density, 0.0, (1 + strain) * ALONG)
        assert other.buckles(flat, density) == buckles
        energy = other.model.energy(other.lifted(flat)) / other.area
        assert energy == pytest.approx(flat.energy, rel=1e-9)


def test_forces_and_moments_balance() -> None:
    found = tile_of(3, "unstructured", WIDE)
    density = random_cells(found)
    for prescribed in (ALL_PRESCRIBED, UNIAXIAL):
        solver = solver_of(found, prescribed=prescribed)
        state = solver.solve(owned(solver, density), 0.4, SKEWED)
        kirchhoff = state.stress @ state.gradient.T
        assert kirchhoff == pytest.approx(kirchhoff.T, abs=1e-10 * np.abs(kirchhoff).max())
        assert state.gradient[np.array(prescribed)] == pytest.approx(
            SKEWED[np.array(prescribed)], abs=1e-15
        )
    # The means of the stress and of the gradient of all triangles are P̄ and F̄.
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
        mixed = (stress_law(gradient, m, composite.c1, composite.c2)
                 for m in (composite.fabric, composite.reinforcement))  # fmt: skip
        total += area * (np.array([1 - density[k], density[k]]) @ [m.ravel() for m in mixed]
                         ).reshape(2, 2)  # fmt: skip
        mean += area * gradient
    assert mean / pattern.areas.sum() == pytest.approx(state.gradient[:2], abs=1e-12)
    scale = np.abs(state.stress).max()
    assert total / pattern.areas.sum() == pytest.approx(state.stress[:2], abs=1e-11 * scale)


def test_compressed_tile_buckles() -> None:
    found = tile_of(6, "right")
    one, other = solver_of(found), solver_of(found, flat=False)
    density = owned(one, stripes(found, 6, 2))
    for angle, strain, buckles in ((np.pi / 2, -0.04, True), (0.0, -0.04, True),
                                   (np.pi / 2, 0.04, False)):  # fmt: skip
        flat = one.solve(density, angle, (1 + strain) * ALONG)
        assert one.stable(flat.state, density, angle)
        state = other.lifted(flat)
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


def flat_vertices(solver: TileSolver, angle: float) -> np.ndarray:
    """Return the flat positions of all vertices in axes n, t."""
    return solver.skin.gather_vertices(solver.flat_positions(angle))


def moved_state(
    solver: TileSolver, state: TileState, there: TileSolver, image: np.ndarray, vertex: np.ndarray
) -> np.ndarray:
    """Return a state of another tile, each vertex of which is an image of one of this tile.

    Edge rotations are not set.
    """
    angle, new = state.angle, there.model.assembled
    old = solver.skin.gather_vertices(state.positions)[vertex]
    old += (
        flat_vertices(there, angle)[image] - flat_vertices(solver, angle)[vertex]
    ) @ state.gradient.T
    every = np.empty_like(old)
    every[image] = old
    every += np.append(flat_vertices(there, angle)[0], 0.0) - every[0]
    there.model.positions(new)[:] = every[there.skin.owned_vertices]
    there.model.images.set_mean_gradient(new, state.gradient)
    return new


@pytest.mark.parametrize("curvature", ["midedge", "average"])
def test_shifted_buckled_tile(curvature: str) -> None:
    """The border of the tile may lie anywhere on the periodic sheet."""
    found = tile_of(4)
    solver = solver_of(found, Composite(bending=Bending(curvature)), flat=False)
    density, shift = smooth_cells(found), np.array([0.25, 0.5])
    base = solver.solve(owned(solver, density), 0.4, 0.96 * ALONG)
    points = found.pattern.points[:, :2] / SIDE
    gap = (points[:, None] + shift - points) % 1.0
    image = np.argmin(np.minimum(gap, 1 - gap).sum(axis=2), axis=1)
    start = dataclasses.replace(base, state=moved_state(solver, base, solver, image,
                                                        np.arange(len(points))))  # fmt: skip
    moved = mapped_cells(density, cell_map(found, np.eye(2), (0.25, 0.5)))
    state = solver.solve(owned(solver, moved), 0.4, 0.96 * ALONG, start=start)
    assert state.energy == pytest.approx(base.energy, rel=1e-11)
    assert state.stress[0, 0] == pytest.approx(base.stress[0, 0], rel=1e-10)
    assert state.gradient == pytest.approx(base.gradient, abs=1e-11)


def test_stretched_beyond_the_bounds() -> None:
    found = tile_of(3)
    solver = solver_of(found)
    density = owned(solver, random_cells(found))
    with pytest.raises(NoEquilibriumError, match=r"no equilibrium .* along 22.92 degrees .*"
                       r"c1 = 1.9, c2 = 2.6. Stretch it less"):  # fmt: skip
        solver.solve(density, 0.4, 1.92 * ALONG)
    near = solver.solve(density, 0.4, 1.05 * ALONG)
    far = solver.solve(density, 0.4, 1.3 * ALONG, start=near)
    assert far.stress[0, 0] == pytest.approx(solver.solve(density, 0.4, 1.3 * ALONG).stress[0, 0])
    with pytest.raises(NoEquilibriumError):
        solver.solve(density, 0.4, 0.05 * ALONG, allow_continuation=False)


def test_flat_tiles_may_bend_in_any_way() -> None:
    for bending in (None, Bending(seams="hinged"), Bending(rest="assembled")):
        solver_of(tile_of(3), Composite(bending=bending))
    assert Periodic(tile_of(3, shape=(1.5, 2.0))).length == pytest.approx(3**0.5 * SIDE)


def test_states_of_another_solve() -> None:
    solver = solver_of(tile_of(3))
    density = np.zeros(len(solver.skin.owned_cells))
    first = solver.solve(density, 0.0, np.where(np.array(UNIAXIAL), 1.1 * ALONG, np.nan))
    with pytest.raises(
        ParameterError, match=r"angle = 0 rad, the solve 0.3 rad. Start from a state"
    ):
        solver.solve(density, 0.3, 1.1 * ALONG, start=first)
    solver.stress_gradient(first, ALONG)
    second = solver.solve(density, 0.0, 1.2 * ALONG, start=first)
    for act in (solver.stress_gradient, solver.strain_gradient,
                lambda at, part: solver.stiffness(at, part[None])):  # fmt: skip
        with pytest.raises(ParameterError, match="the solver has been used since"):
            act(first, ALONG)
        act(second, ALONG)
    assert solver.stable(second.state, density, 0.0)
    with pytest.raises(ParameterError, match="the solver has been used since"):
        solver.stress_gradient(second, ALONG)
