"""Profiles of tiles: exact sheets, copies and symmetries, effective tensors, parallel runs."""

from collections.abc import Callable
from dataclasses import replace
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
    modulus,
    profile_of,
    profile_solver,
    profile_table,
    random_cells,
    solver_of,
    stress_law,
    stripes,
    table_composite,
    tile_of,
)
from mpi4py import MPI
from scipy.optimize import brentq

from toros_fem.base.errors import DensityError, NoEquilibriumError, ParameterError
from toros_fem.design.density.field import random_density
from toros_fem.materials.sheet import Composite, Material
from toros_fem.mechanics.skin.periodicity import ALL_PRESCRIBED
from toros_fem.meshes import Tile
from toros_fem.products.tiles.solver import TileSolver, TileState
from toros_fem.products.tiles.stiffness_profile import (
    ALONG,
    ProfileSolver,
    effective_tensor,
    merge_profiles,
    profiles,
)

# Sides of an oblong tile.
WIDE = (1.5, 1.0)


# A mean deformation with shear and rotation.
SKEWED = np.array([[1.08, 0.06], [-0.03, 0.95], [0, 0]])


def owned(solver: TileSolver, density: np.ndarray) -> np.ndarray:
    return density[solver.skin.owned_cells]


def tensor(solver: TileSolver, density: np.ndarray) -> np.ndarray:
    return effective_tensor(solver, owned(solver, density))


@pytest.mark.parametrize("mesh", ["crossed", "right", "unstructured"])
def test_uniform_sheet(mesh: str) -> None:
    """The profile is that of eq. (1) in all directions, in tension and in compression."""
    found = tile_of(3, mesh, WIDE)
    composite = table_composite()
    solver = solver_of(found, composite)
    for printed, one in enumerate((A, R)):
        density = np.full(len(found.wraps), float(printed))
        exact = Laminate(Composite(one, one, composite.c1, composite.c2), 0.5, 0.0)
        for strain, every in ((0.02, 6), (0.1, 6), (0.3, 1 + 4 * printed), (-0.05, 1)):
            profile = profile_of(solver, density, strain, ANGLES[::every])
            stress, contraction, shear = exact.pulled(0.0, strain)
            assert profile.stress == pytest.approx(stress, rel=1e-10)
            assert profile.stiffness == pytest.approx(stress / strain, rel=1e-10)
            assert profile.contraction == pytest.approx(contraction, rel=1e-9)
            assert profile.shear == pytest.approx(shear, abs=1e-13)
            assert np.ptp(profile_table(profile), axis=0) == pytest.approx(0, abs=1e-12)


PHASES = ("E1", "nu1", "E2", "nu2")


@pytest.mark.parametrize(
    "phases",
    sorted({tuple(row[name] for name in PHASES) for row in table("laminate_plane_stress")}),
)
def test_effective_tensor_of_stripes(phases: tuple[str, ...]) -> None:
    """Phase 1 in stripes along x: the table and the closed form agree with the tensor."""
    e1, nu1, e2, nu2 = map(float, phases)
    third = abs(nu1 - 1 / 3) < 1e-6  # the table gives six digits
    hard = Material(e1, 1 / 3 if third else nu1, 1.0)
    composite = Composite(Material(e2, nu2, 1.0), hard, bending=None)
    found = tile_of(10, shape=(0.3, 2.0))
    solver = solver_of(found, composite, ALL_PRESCRIBED)
    rows = [r for r in table("laminate_plane_stress") if tuple(r[n] for n in PHASES) == phases]
    assert len(rows) == 4
    for row in rows:
        fraction = float(row["f1"])
        result = tensor(solver, stripes(found, 20, round(20 * fraction)))
        names = ("Qxx(along stripes)", "Qyy", "Qxy", "G")
        along, across, cross, shear = (float(row[name]) for name in names)
        expected = np.array([[along, cross, 0], [cross, across, 0], [0, 0, shear]])
        assert result == pytest.approx(expected, rel=1e-8, abs=1e-8)
        for degrees in range(0, 91, 15):
            value = float(row[f"E_{degrees}"])
            assert modulus(result, np.radians(degrees)) == pytest.approx(value, rel=1e-8)
        exact = Laminate(composite, fraction, np.pi / 2).stiffness()
        assert result == pytest.approx(exact, rel=1e-12, abs=1e-13 * along)


@pytest.mark.parametrize("fraction", [0.1, 0.5])
def test_stripes_at_finite_strain(fraction: float) -> None:
    """Pulls along and across agree with the table for the same stretch bounds."""
    count = 10 if fraction == 0.1 else 4
    found = tile_of(10, shape=(0.3, 0.1 * count))
    solver = solver_of(found, table_composite())
    density = stripes(found, count, round(fraction * count))
    for row in table("laminate_gent_eq1"):
        if float(row["f(mat R)"]) != fraction or row["phase2"] != "A":
            continue
        strain = float(row["mean_stretch"]) - 1
        profile = profile_of(solver, density, strain, np.array([0, np.pi / 2]))
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
    """Return a tile with a quarter printed, in stripes along the falling diagonals of its mesh."""
    found = tile_of(4, "right")
    return found, stripes(found, 4, 1, diagonal=True)


# Stripes that hardly stretch between soft ones.
NARROW = Composite(
    replace(A, c1=1.9, c2=2.4), replace(A, young=10 * A.young, c1=1.05, c2=1.06), bending=None
)


MIXED = replace(NARROW, reinforcement=replace(NARROW.reinforcement, c1=1.3, c2=1.5))


def pull_of_stripes(composite: Composite, fraction: float, stretch: float) -> tuple[float, float]:
    """Nominal stress of stripes pulled along and across them, by roots of scalar functions."""
    phases = (
        (composite.reinforcement, composite.reinforcement_bounds),
        (composite.fabric, composite.fabric_bounds),
    )

    def law(k: int, one: float, two: float) -> np.ndarray:
        return np.diag(stress_law(np.diag([one, two]), phases[k][0], *phases[k][1]))

    def root(f: Callable[[float], float], low: float, high: float) -> float:
        return float(brentq(f, low, high, xtol=1e-15, rtol=1e-15))

    weights = np.array([fraction, 1 - fraction])
    c1, c2 = zip(*(bounds for _, bounds in phases), strict=True)
    along = 0.0
    if stretch < min(c1):
        for k, weight in enumerate(weights):
            low, high = max(2 - c1[k], 3 - c2[k] - stretch), min(c1[k], 1 + c2[k] - stretch)
            free = root(lambda y, k=k: law(k, stretch, y)[1], low + 1e-9, high - 1e-9)  # type: ignore[misc]
            along += weight * law(k, stretch, free)[0]

    def series(lateral: float) -> tuple[np.ndarray, np.ndarray]:
        """Both stress states at a common lateral stretch."""
        soft = lambda hard: (stretch - fraction * hard) / (1 - fraction)  # noqa: E731
        low = max(2 - c1[0], 3 - c2[0] - lateral, (stretch - (1 - fraction) * c1[1]) / fraction)
        high = min(c1[0], 1 + c2[0] - lateral)
        hard = root(
            lambda x: law(0, x, lateral)[0] - law(1, soft(x), lateral)[0], low + 1e-9, high - 1e-9
        )
        return law(0, hard, lateral), law(1, soft(hard), lateral)

    def lateral_force(lateral: float) -> float:
        return float(weights @ [stress[1] for stress in series(lateral)])

    lateral = root(lateral_force, 1 - 0.9 * (c1[0] - 1), 1 + 0.5 * (c1[0] - 1))
    return along, float(series(lateral)[0][0])


@pytest.mark.parametrize("fraction", [0.25, 0.5])
def test_stripes_of_two_bounds(fraction: float) -> None:
    """Stripes with bounds of their own, also where the stiff ones are at theirs."""
    found = tile_of(4, shape=(0.75, 1.0))
    solver, density = solver_of(found, NARROW), stripes(found, 4, round(4 * fraction))
    most, use = 1 + (1 - fraction) * 0.9 + fraction * 0.05, []
    # The mean of the bounds limits what is pulled across.
    for stretch in (1.01, 1.045, 1.2, most - 0.05):
        along, across = pull_of_stripes(NARROW, fraction, stretch)
        found_across = profile_of(solver, density, stretch - 1, np.array([np.pi / 2]))
        assert found_across.stress == pytest.approx([across], rel=1e-9)
        assert found_across.state[0] is not None
        use.append(found_across.state[0].stretch_use)
        if along:
            found_along = profile_of(solver, density, stretch - 1, np.array([0.0]))
            assert found_along.stress == pytest.approx([along], rel=1e-9)
    assert max(use) > 0.9
    gradient = np.array([[1.06, 0], [0, 1], [0, 0]])
    with pytest.raises(NoEquilibriumError, match=r"c2 = 2.4 of the fabric, c1 = 1.05, c2 = 1.06"):
        solver.solve(owned(solver, density), 0.0, gradient, allow_continuation=False)


@pytest.mark.parametrize(
    "composite", [table_composite(), Composite(), MIXED], ids=["A", "default", "two bounds"]
)
def test_stripes_in_every_direction(composite: Composite) -> None:
    """Laminates shear when pulled at an angle to their stripes: no symmetry helps here."""
    found, density = oblique()
    solver, exact = solver_of(found, composite), Laminate(composite, 0.25, np.pi / 4)
    angles, h = ANGLES[::2] + 0.1, 1e-4
    for strain in (0.02, 0.15, -0.03):
        profile = profile_of(solver, density, strain, angles)
        expected = np.array([exact.pulled(angle, strain) for angle in angles])
        assert profile.stress == pytest.approx(expected[:, 0], rel=3e-10)
        assert profile.contraction == pytest.approx(expected[:, 1], abs=3e-10)
        assert profile.shear == pytest.approx(expected[:, 2], abs=1e-10)
        assert np.abs(profile.shear / strain).max() > 0.5
        ends = [exact.pulled(angles[1], strain + s * h)[0] for s in (1, -1)]
        assert profile.tangent[1] == pytest.approx((ends[0] - ends[1]) / (2 * h), rel=1e-6)


def test_directions_spread_over_ranks(comm: MPI.Comm, monkeypatch: pytest.MonkeyPatch) -> None:
    """All ranks get the same profile, and the same error if one of them finds no equilibrium."""
    found = tile_of(3)
    solver, spread = solver_of(found, alone=True), solver_of(found)
    density = random_cells(found)
    batched = ProfileSolver(solver, ANGLES[:5], 0.1, batch=comm).solve(owned(solver, density))
    parted = profile_of(spread, density, 0.1, ANGLES[:5])
    assert profile_table(parted) == pytest.approx(profile_table(batched), abs=1e-12)
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
    # Only one rank fails.
    solve = solver.solve

    def failing(*args: Any, **options: Any) -> TileState:
        if args[1] == ANGLES[0]:
            raise NoEquilibriumError("none along 0 degrees")
        return solve(*args, **options)

    monkeypatch.setattr(solver, "solve", failing)
    with pytest.raises(NoEquilibriumError, match="none along 0 degrees"):
        ProfileSolver(solver, ANGLES[:5], 0.1, batch=comm).solve(owned(solver, density))


def test_start_of_a_profile() -> None:
    """A near start needs fewer steps and leads to the same profile."""
    found = tile_of(4)
    solver = ProfileSolver(solver_of(found), ANGLES[::3], 0.1)
    skin = solver.tile.skin
    density = random_cells(found)[skin.owned_cells]
    base = solver.solve(density)
    near = np.clip(density + 1e-3, 0, 1)
    again, fresh = solver.solve(near, base.state), solver.solve(near)
    assert profile_table(again) == pytest.approx(profile_table(fresh), abs=1e-10)
    assert again.steps < fresh.steps
    assert (again.pressure, again.pressures) == (0.0, ())
    assert again.stiffness == pytest.approx(again.stress / 0.1, rel=1e-15)


def test_bad_profiles(comm: MPI.Comm) -> None:
    solver = solver_of(tile_of(3))
    for strain in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ParameterError, match=f"strain = {strain} must be finite, above -1"):
            ProfileSolver(solver, ANGLES, strain)
    for angles in ([], [[0.0]], [np.nan]):
        with pytest.raises(ParameterError, match="at least one finite direction"):
            ProfileSolver(solver, angles, 0.1)  # type: ignore[arg-type]
    if comm.size > 1:
        with pytest.raises(
            ParameterError, match=r"over 2 ranks and its directions over 2: spread only"
        ):
            ProfileSolver(solver, ANGLES, 0.1, batch=comm)


def test_bad_start_on_one_rank() -> None:
    """All ranks raise the error of one."""
    solver = profile_solver(True, np.zeros(1))
    density = random_density(solver.tile.skin, 0)
    state = solver.tile.solve(density, 0.3, 1.1 * ALONG)
    with pytest.raises(ParameterError, match="angle = 0.3 rad, the solve 0 rad"):
        solver.solve(density, (state,))
    with pytest.raises(DensityError, match="must lie in"):
        solver.solve(density + 1)


def test_profiles_and_their_union() -> None:
    """Profiles at several strains, and in two sets of directions, equal single ones."""
    tile = tile_of(3)
    solver = solver_of(tile)
    density = random_cells(tile)
    strains = [0.04, 0.1]
    first, second = profiles(solver, owned(solver, density), ANGLES[:3], strains)
    whole = profile_of(solver, density, 0.1, ANGLES[:5])
    assert (first.strain, second.strain) == (0.04, 0.1)
    assert profile_table(first) == pytest.approx(
        profile_table(profile_of(solver, density, 0.04, ANGLES[:3])), abs=1e-10
    )
    others = profile_of(solver, density, 0.1, ANGLES[[4, 3]])
    merged = merge_profiles(others, second)
    assert merged.angles == pytest.approx(ANGLES[:5], abs=1e-15)
    assert profile_table(merged) == pytest.approx(profile_table(whole), abs=1e-10)
    assert merged.steps == others.steps + second.steps
    for state, angle in zip(merged.state, ANGLES[:5], strict=True):
        assert state is not None
        assert state.angle == angle
    along = [replace(p, gradients=tuple(p.angles)) for p in (others, second)]  # type: ignore[arg-type]
    assert merge_profiles(*along).gradients == tuple(merged.angles)
