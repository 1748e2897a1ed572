"""Equilibria of periodic tiles: derivatives, balance, buckling, bad input."""

import dataclasses

import numpy as np
import pytest
from helpers.tiles import (
    ANGLES,
    SIDE,
    cell_map,
    mapped_cells,
    profile_of,
    profile_table,
    random_cells,
    random_step,
    smooth_cells,
    solver_of,
    stress_law,
    stripes,
    tile_of,
)
from kit.slopes import slope

from toros_fem.base.errors import DensityError, NoEquilibriumError, ParameterError
from toros_fem.base.mpi import dot
from toros_fem.design.density.field import random_density
from toros_fem.materials.sheet import Bending, Composite
from toros_fem.mechanics.skin.periodicity import ALL_PRESCRIBED, UNIAXIAL, Periodic
from toros_fem.products.tiles.solver import TileSolver, TileState
from toros_fem.products.tiles.stiffness_profile import ACROSS, ALONG, effective_tensor

SHEAR = np.array([[0.0, 1], [0, 0], [0, 0]])
# Sides of an oblong tile.
WIDE = (1.5, 1.0)
# A mean deformation with shear and rotation, and the four components in the plane.
SKEWED = np.array([[1.08, 0.06], [-0.03, 0.95], [0, 0]])
PARTS = np.eye(4).reshape(4, 2, 2)
PLANE = np.concatenate([PARTS, np.zeros((4, 1, 2))], axis=1)


def owned(solver: TileSolver, density: np.ndarray) -> np.ndarray:
    return density[solver.skin.owned_cells]


def test_rotated_mean_deformation() -> None:
    """The stress rotates with the deformation, and does not depend on the axes."""
    found = tile_of(3, "unstructured", WIDE)
    solver = solver_of(found, prescribed=ALL_PRESCRIBED)
    density = owned(solver, random_cells(found))
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


@pytest.mark.parametrize("flat", [True, False])
@pytest.mark.parametrize("strain", [0.1, -0.04])
def test_stress_along_a_direction_is_that_of_the_energy(flat: bool, strain: float) -> None:
    """Free components carry no stress, in a flat and in a buckled tile."""
    found = tile_of(4, "right")
    solver = solver_of(found, flat=flat)
    density, step = owned(solver, smooth_cells(found)), 1e-4
    base = solver.solve(density, 0.4, (1 + strain) * ALONG)
    tangent = solver.stiffness(base, ALONG[None])[0, 0]
    derivative = solver.state_derivative(base, ALONG)
    near = [solver.solve(density, 0.4, (1 + strain + s * step) * ALONG, start=base) for s in STEPS]
    stress = central([np.array(state.energy) for state in near], step)
    assert stress == pytest.approx(base.stress[0, 0], rel=1e-9)
    found_tangent = central([state.stress[0, 0] for state in near], step)
    assert found_tangent == pytest.approx(tangent, rel=1e-7)
    moved = central([state.state for state in near], step)
    assert moved == pytest.approx(derivative, abs=1e-8 * np.abs(derivative).max())
    assert (base.stress[:2, 1] == 0).all()


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


def test_free_mean_deformation() -> None:
    """With only one shear component prescribed, a tile returns to its unstretched state."""
    found = tile_of(3)
    prescribed = ((False, False), (True, False), (True, True))
    solver = solver_of(found, prescribed=prescribed)
    density = owned(solver, random_cells(found))
    start = solver_of(found, prescribed=UNIAXIAL).solve(density, 0.3, 1.05 * ALONG)
    state = solver.solve(density, 0.3, np.zeros((3, 2)), start=start)
    assert state.gradient == pytest.approx(np.eye(3)[:, :2], abs=1e-13)
    assert np.abs(state.stress).max() < 1e-9 * np.abs(start.stress).max()
    assert (state.stress[~np.array(prescribed)] == 0).all()


def lifted(solver: TileSolver, flat: TileState) -> np.ndarray:
    """Return a flat state as a state of a tile that may leave its plane."""
    state = solver.model.assembled
    solver.model.positions(state)[:] = flat.positions
    solver.model.set_mean_gradient(state, flat.gradient)
    return state


def test_pulled_tile_stays_in_its_plane() -> None:
    found = tile_of(4)
    density, angles = smooth_cells(found), ANGLES[::4]
    one, other = solver_of(found), solver_of(found, flat=False)
    flat, free = (profile_of(solver, density, 0.02, angles) for solver in (one, other))
    assert profile_table(free) == pytest.approx(profile_table(flat), abs=1e-12)
    for a, b in zip(free.state, flat.state, strict=True):
        assert a is not None
        assert b is not None
        assert a.positions[:, 2] == pytest.approx(0, abs=1e-15)
        assert a.energy == pytest.approx(b.energy, rel=1e-12)
        assert other.stable(lifted(other, b), owned(other, density), b.angle)


def test_compressed_tile_buckles() -> None:
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
    there.model.set_mean_gradient(new, state.gradient)
    return new


@pytest.mark.parametrize("mesh", ["right", "unstructured"])
def test_copies_of_a_buckled_tile(mesh: str) -> None:
    """A buckled tile repeated 2 × 2 is in equilibrium too."""
    small = tile_of(3, mesh, WIDE)
    many, bending = small.repeated(2, 2), Composite(bending=Bending("quadratic"))
    one, other = (solver_of(each, bending, flat=False) for each in (small, many.tile))
    density = smooth_cells(small)
    buckled = one.solve(owned(one, density), 0.4, 0.96 * ALONG)
    assert np.ptp(one.skin.gather_vertices(buckled.positions)[:, 2]) > 0.05 * SIDE
    count = len(many.tile.pattern.points)
    vertex = np.arange(count) % len(small.pattern.points)
    state = moved_state(one, buckled, other, np.arange(count), vertex)
    other.stable(state, owned(other, density[many.cell]), 0.4)  # rotates the axes
    assert other.model.energy(state) / other.area == pytest.approx(buckled.energy, rel=1e-11)
    residual = other.skin.gather_vertices(other.model.positions(other.model.residual(state)))
    inside = one.skin.gather_vertices(one.model.positions(one.model.residual(buckled.state)))
    scale = abs(buckled.stress[0, 0]) * SIDE
    assert np.abs(inside).max() < 1e-9 * scale
    assert np.abs(residual).max() < 1e-9 * scale
    stress = other.model.mean_force(state) / other.area
    assert stress == pytest.approx(buckled.stress, abs=1e-10 * np.abs(buckled.stress).max())


@pytest.mark.parametrize("curvature", ["midedge", "quadratic", "average"])
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
    assert near.stretch_use < 1
    far = solver.solve(density, 0.4, 1.3 * ALONG, start=near)
    assert far.stress[0, 0] == pytest.approx(solver.solve(density, 0.4, 1.3 * ALONG).stress[0, 0])
    with pytest.raises(NoEquilibriumError):
        solver.solve(density, 0.4, 0.05 * ALONG, allow_continuation=False)


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
        with pytest.raises(ParameterError, match=r"must be \(3, 2\), with finite prescribed"):
            solver.solve(density, 0.0, gradient)  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match="angle = inf"):
        solver.solve(density, np.inf, ALONG)
    with pytest.raises(DensityError, match=r"must lie in \[0, 1\]"):
        solver.solve(density - 0.1, 0.0, ALONG)
    first = solver.solve(density, 0.0, np.where(np.array(UNIAXIAL), 1.1 * ALONG, np.nan))
    with pytest.raises(
        ParameterError, match=r"angle = 0 rad, the solve 0.3 rad. Start from a state"
    ):
        solver.solve(density, 0.3, 1.1 * ALONG, start=first)
    solver.stress_gradient(first, ALONG)
    second = solver.solve(density, 0.0, 1.2 * ALONG, start=first)
    for act in (solver.state_derivative, solver.stress_gradient, solver.strain_gradient,
                lambda at, part: solver.stiffness(at, part[None])):  # fmt: skip
        with pytest.raises(ParameterError, match="the solver has been used since"):
            act(first, ALONG)
        act(second, ALONG)
    assert solver.stable(second.state, density, 0.0)
    with pytest.raises(ParameterError, match="the solver has been used since"):
        solver.state_derivative(second, ALONG)
    with pytest.raises(ParameterError, match=r"Periodic\(tile, ALL_PRESCRIBED\)"):
        effective_tensor(solver, density)


@pytest.mark.parametrize("kind", ["flat", "given", "buckled"])
def test_gradients_of_one_direction(kind: str) -> None:
    """Gradients of stress and of free components of F̄ are exact, also of a buckled tile."""
    found = tile_of(4, "right")
    if kind == "given":
        solver, gradient = solver_of(found, prescribed=ALL_PRESCRIBED), SKEWED
        change = np.array([[0.3, -1.0], [0.7, 0.4], [0, 0]])
    else:
        solver, change = solver_of(found, flat=kind == "flat"), ALONG
        gradient = (1.1 if kind == "flat" else 0.95) * ALONG
    skin = solver.skin
    density, step = random_density(skin, 2, spread=0.3), random_step(solver)
    base = solver.solve(density, 0.4, gradient)
    assert (np.ptp(skin.gather_vertices(base.positions)[:, 2]) > 1e-3) == (kind == "buckled")

    def there(h: float) -> TileState:
        return solver.solve(density + h * step, 0.4, gradient, start=base)

    along = dot(skin.comm, solver.stress_gradient(base, change), step)
    rise = slope(lambda h: float((there(1e-3 * h).stress * change).sum())) / 1e-3
    assert along == pytest.approx(rise, rel=1e-6)
    if kind == "given":
        return
    for part in (ACROSS, SHEAR):
        base = there(0.0)
        along = dot(skin.comm, solver.strain_gradient(base, part), step)
        rise = slope(lambda h, part=part: float((there(1e-3 * h).gradient * part).sum())) / 1e-3
        assert along == pytest.approx(rise, rel=1e-6)
