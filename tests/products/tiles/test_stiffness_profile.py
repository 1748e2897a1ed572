"""Profiles of tiles: exact sheets, effective tensors, parallel runs; objectives by hand."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from helpers.scenes import table
from helpers.tiles import (
    ANGLES,
    SIDE,
    A,
    Laminate,
    R,
    mean_stiffness,
    modulus,
    owned,
    profile_of,
    profile_solver,
    profile_table,
    random_cells,
    solver_of,
    stripes,
    table_composite,
    tile_of,
)
from mpi4py import MPI

from toros_fem.base.errors import NoEquilibriumError, ParameterError
from toros_fem.design.loop.fields import random_density
from toros_fem.materials.sheet import Composite, Material
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.terms.periodic import ALL_PRESCRIBED, Periodic
from toros_fem.meshes import Tile, sew
from toros_fem.products.tiles.stiffness_profile import (
    Contrast,
    Profile,
    ProfileSolver,
    ProfileTarget,
    profiles,
    tile_solver,
)

# Sides of an oblong tile.
WIDE = (1.5, 1.0)


def tensor(solver: EquilibriumSolver, density: np.ndarray) -> np.ndarray:
    """Membrane stiffness in N/m of strains (xx, yy, 2xy), (3, 3)."""
    state = solver.solve(owned(solver, density), Load(gradient=np.eye(3)[:, :2]))
    changes = np.zeros((3, 3, 2))
    changes[0, 0, 0] = changes[1, 1, 1] = 1.0
    changes[2, 0, 1] = changes[2, 1, 0] = 0.5
    return mean_stiffness(solver, state, changes)


@pytest.mark.parametrize("quadratic", [False, True])
@pytest.mark.parametrize("edge", [1e-3, 4e-3])
def test_stripes_along_their_borders(comm: MPI.Comm, edge: float, quadratic: bool) -> None:
    """A laminate is exact on every mesh along its borders, wherever they are."""
    stripe = shapely.box(0, 0.0062, SIDE, 0.0094)
    found, inside = tile_of(4).following(comm, stripe, edge)
    cells = inside if quadratic else None
    solver = tile_solver(sew(comm, found.pattern), Composite(), Periodic(found), quadratic=cells)
    profile = profile_of(solver, inside.astype(float), 0.1, ANGLES[::3])
    exact = Laminate(Composite(), 0.0032 / SIDE, np.pi / 2)
    expected = np.array([exact.pulled(angle, 0.1) for angle in ANGLES[::3]]).T
    assert profile.stress == pytest.approx(expected[0], rel=1e-6)
    assert profile.contraction == pytest.approx(expected[1], abs=1e-6)
    assert profile.shear == pytest.approx(expected[2], abs=1e-6)


def test_crossing_lines_on_coarse_meshes(comm: MPI.Comm) -> None:
    """Thin lines do not lock where they are quadratic; along x and y they are alike."""
    ways = shapely.linestrings([[(-SIDE, -SIDE), (2 * SIDE, 2 * SIDE)],
                                [(-SIDE, 2 * SIDE), (2 * SIDE, -SIDE)]])  # fmt: skip
    lines = shapely.union_all(shapely.buffer(ways, SIDE / 20)) & shapely.box(0, 0, SIDE, SIDE)
    angles, found = np.radians([0.0, 90.0, 45.0]), {}
    for edge in (0.07, 0.14):
        made, inside = tile_of(4).following(comm, lines, edge * SIDE)
        solver = tile_solver(sew(comm, made.pattern), Composite(), Periodic(made), quadratic=inside)
        found[edge] = profile_of(solver, inside.astype(float), 0.1, angles).stress
        assert found[edge][0] == pytest.approx(found[edge][1], rel=0.01)
    assert found[0.14] == pytest.approx(found[0.07], rel=0.03)


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
def test_tensor_of_stripes(phases: tuple[str, ...]) -> None:
    """Phase 1 in stripes along x: the table and the closed form agree with the tensor."""
    e1, nu1, e2, nu2 = map(float, phases)
    third = abs(nu1 - 1 / 3) < 1e-6  # the table gives six digits
    hard = Material(1e3 * e1, 1 / 3 if third else nu1, 1e-3)
    composite = Composite(Material(1e3 * e2, nu2, 1e-3), hard, bending=None)
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


def oblique() -> tuple[Tile, np.ndarray]:
    """Return a tile with a quarter printed, in stripes along the falling diagonals of its mesh."""
    found = tile_of(4, "right")
    return found, stripes(found, 4, 1, diagonal=True)


# Stripes that hardly stretch between soft ones.
NARROW = Composite(
    replace(A, c1=1.9, c2=2.4), replace(A, young=10 * A.young, c1=1.05, c2=1.06), bending=None
)


MIXED = replace(NARROW, reinforcement=replace(NARROW.reinforcement, c1=1.3, c2=1.5))


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
    assert [k for k, state in enumerate(batched.states) if state is not None] == list(
        range(comm.rank, 5, comm.size)
    )
    assert all(state is not None for state in parted.states)
    every = comm.allgather((batched.stress, batched.tangent, batched.contraction, batched.steps))
    for stress, tangent, contraction, steps in every:
        assert (stress == batched.stress).all()
        assert (tangent == batched.tangent).all()
        assert (contraction == batched.contraction).all()
        assert steps == batched.steps
    with pytest.raises(NoEquilibriumError):
        ProfileSolver(solver, ANGLES[:5], 0.95, batch=comm).solve(owned(solver, density), once=True)
    # Only one rank fails.
    solve = solver.solve

    def failing(*args: Any, **options: Any) -> Equilibrium:
        if args[1].angle == ANGLES[0]:
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
    again, fresh = solver.solve(near, base), solver.solve(near)
    assert profile_table(again) == pytest.approx(profile_table(fresh), abs=1e-10)
    assert again.steps < fresh.steps
    assert again.pressures == ()
    assert again.stiffness == pytest.approx(again.stress / 0.1, rel=1e-15)


def test_a_density_above_1() -> None:
    """All ranks raise the error."""
    solver = profile_solver(True, np.zeros(1))
    density = random_density(solver.tile.skin, 0)
    with pytest.raises(ParameterError, match="must lie in"):
        solver.solve(density + 1)


def test_profiles_at_several_strains() -> None:
    tile = tile_of(3)
    solver, density = solver_of(tile), random_cells(tile)
    found = profiles(solver, owned(solver, density), ANGLES[:3], [0.04, 0.1])
    for one, strain in zip(found, (0.04, 0.1), strict=True):
        single = profile_of(solver, density, strain, ANGLES[:3])
        assert one.strain == strain
        assert profile_table(one) == pytest.approx(profile_table(single), abs=1e-10)


def plain_profile(stress: list[float], contraction: list[float], strain: float) -> Profile:
    """Return a profile without states."""
    one, none = np.array(stress), (None,) * len(stress)
    return Profile(0 * one, strain, one, one, np.array(contraction), 0 * one, none, none, 0, 0)


def test_objectives_by_hand() -> None:
    profile = plain_profile([11.0, 30.0, 24.0], [0.3, 0.1, -0.2], 0.1)
    assert profile.stiffness == pytest.approx([110.0, 300.0, 240.0], rel=1e-15)
    stiffness, contraction = np.array([100.0, np.nan, 300.0]), np.array([np.nan, 0.4, 0.1])
    for target, terms, worst in (
        (ProfileTarget(stiffness), [0.1, 0.2], 0.2),
        (ProfileTarget(contraction=contraction), [0.75, 3.0], 3.0),
        (ProfileTarget(contraction=np.array([0.0, np.nan, np.nan])), [0.3], 0.3),
        (ProfileTarget(stiffness, contraction), [0.1, 0.2, 0.75, 3.0], 3.0),
        (ProfileTarget(profile.stiffness, profile.contraction), 6 * [0.0], 0.0),
    ):
        squares = np.square(terms) / 3
        assert target.residuals(profile)[0] ** 2 == pytest.approx(squares, rel=1e-12, abs=1e-28)
        assert target.forward(profile) == pytest.approx(squares.sum(), rel=1e-12, abs=1e-28)
        assert target.largest_deviation(profile) == pytest.approx(worst, rel=1e-14, abs=1e-14)
    contrast = Contrast(np.array([True, False, False]), np.array([False, True, True]))
    assert contrast.forward(profile) == pytest.approx(11 / 27, rel=1e-14)
    assert not len(contrast.residuals(profile)[0])
