"""Designing tiles: objectives of profiles, gradients to the density, symmetric designs."""

import dataclasses
import time
from typing import Any

import numpy as np
import pytest
from helpers.scenes import taylor_rates
from helpers.tiles import ANGLES, SIDE, numbers, pulled, solver_of, tile_of
from mpi4py import MPI

from toros_fem import errors
from toros_fem._mpi import dot
from toros_fem.density.cone import ConeFilter
from toros_fem.density.field import random_density
from toros_fem.density.length_scale import LengthScale, LengthScaleConstraints
from toros_fem.density.perimeter import Perimeter
from toros_fem.density.projection import Projection
from toros_fem.density.symmetric import SymmetricFilter
from toros_fem.design.loop import DesignResult, optimize
from toros_fem.design.options import DesignOptions, Stage
from toros_fem.design.variables import Scaled, Variables
from toros_fem.mechanics.periodicity import ALL_PRESCRIBED
from toros_fem.meshes import Mirrored
from toros_fem.tiles.objectives import Contrast, ProfileObjective, ProfileTarget
from toros_fem.tiles.problem import TileProblem
from toros_fem.tiles.solver import TileSolver, TileState
from toros_fem.tiles.stiffness_profile import ACROSS, ALONG, ProfileSolver

EDGES = 6
RADIUS = 1.6 * SIDE / EDGES
DIRECTIONS = ANGLES[:7:2] + 0.05
SHEAR = np.array([[0.0, 1], [0, 0], [0, 0]])
SKEWED = np.array([[1.08, 0.06], [-0.03, 0.95], [0, 0]])
TARGET = ProfileTarget(
    stiffness=np.array([3e3, np.nan, 6e3, 4e3]),
    contraction=np.array([0.2, 0.1, np.nan, -0.3]),
    weights=np.array([1.0, 2.0, 3.0, 0.5]),
    weight=0.7,
)
CONTRAST = Contrast(np.array([True, False, False, True]), np.array([False, True, True, False]))
# A tile parted over the ranks, or one on each rank and its directions parted.
WAYS = pytest.mark.parametrize("batched", [False, True], ids=["tile", "directions"])


def pulling(batched: bool, angles: np.ndarray = DIRECTIONS, strain: float = 0.1) -> ProfileSolver:
    batch = MPI.COMM_WORLD if batched else None
    return ProfileSolver(solver_of(tile_of(EDGES), alone=batched), angles, strain, batch)


def direction(solver: TileSolver, seed: int = 9) -> np.ndarray:
    drawn = np.random.default_rng(seed).uniform(-1, 1, len(solver.skin.pattern.panel))
    return np.asarray(drawn[solver.skin.owned_cells])


def start_of(chain: TileProblem) -> np.ndarray:
    """A rough density that is not symmetric, but would be without its noise."""
    x, y = (2 * np.pi * chain.skin.pattern.centroids / SIDE).T
    noise = np.random.default_rng(2).uniform(-1, 1, len(x))
    every = 0.5 + 0.3 * np.cos(x) * np.cos(y) + 0.15 * noise
    return np.asarray(every[chain.skin.owned_cells])


@pytest.mark.parametrize("kind", ["flat", "given", "buckled"])
def test_taylor_of_one_direction(kind: str) -> None:
    """Stress and what is free of F̄, by the density, also of a tile that has buckled."""
    found = tile_of(4, "right")
    if kind == "given":
        solver, gradient = solver_of(found, fixed=ALL_PRESCRIBED), SKEWED
        change = np.array([[0.3, -1.0], [0.7, 0.4], [0, 0]])
    else:
        solver, change = solver_of(found, flat=kind == "flat"), ALONG
        gradient = (1.1 if kind == "flat" else 0.95) * ALONG
    skin = solver.skin
    density, step = random_density(skin, 2, spread=0.3), direction(solver)
    base = solver.solve(density, 0.4, gradient)
    assert (np.ptp(skin.gather_vertices(base.positions)[:, 2]) > 1e-3) == (kind == "buckled")

    def there(h: float) -> TileState:
        return solver.solve(density + h * step, 0.4, gradient, start=base)

    slope = dot(skin.comm, solver.stress_gradient(base, change), step)
    rates = taylor_rates(lambda h: float((there(h).stress * change).sum()), slope, 1e-2)
    assert rates == pytest.approx(2.0, abs=0.05)
    if kind == "given":
        return
    for part in (ACROSS, SHEAR):
        base = there(0.0)
        slope = dot(skin.comm, solver.strain_gradient(base, part), step)

        def moved(h: float, part: np.ndarray = part) -> float:
            return float((there(h).gradient * part).sum())

        assert taylor_rates(moved, slope, 1e-2) == pytest.approx(2.0, abs=0.05)


@WAYS
@pytest.mark.parametrize("objective", [TARGET, CONTRAST], ids=["target", "contrast"])
@pytest.mark.parametrize("strain", [0.1, -0.05])
def test_taylor_of_objectives(batched: bool, objective: ProfileObjective, strain: float) -> None:
    solver = pulling(batched, strain=strain)
    skin = solver.tile.skin
    density, step = random_density(skin, 2, spread=0.3), direction(solver.tile)
    base = solver.solve(density)
    gradient = solver.backward(base, *objective.backward(base))
    slope = dot(skin.comm, gradient, step)

    def value(h: float) -> float:
        return objective.forward(solver.solve(density + h * step, base.state, gradients=False))

    assert taylor_rates(value, slope, 1e-2) == pytest.approx(2.0, abs=0.05)


def problem(
    batched: bool,
    objective: ProfileObjective,
    symmetry: str = "tetragonal",
    angles: np.ndarray = DIRECTIONS,
    beta: float = 4.0,
) -> TileProblem:
    solver, found = pulling(batched, angles), tile_of(EDGES)
    skin = solver.tile.skin
    inner = ConeFilter(skin, RADIUS, found.lattice)
    return TileProblem(
        solver=solver,
        objective=objective,
        filter=SymmetricFilter(skin, inner, found.symmetry_maps(symmetry)),
        projection=Projection(beta),
    )


def full(batched: bool, objective: ProfileObjective, symmetry: str = "tetragonal") -> TileProblem:
    """All that the chain has: part of the print given, its border penalised, widths constrained."""
    plain = problem(batched, objective, symmetry)
    skin = plain.skin
    limits = LengthScale(solid_threshold=0.7, void_threshold=0.3, epsilon=1e-3)
    place = np.abs(skin.pattern.centroids[skin.owned_cells] / SIDE - 0.5)
    return dataclasses.replace(
        plain,
        passive=np.where(place.max(axis=1) < 0.12, 1.0, np.nan),
        perimeter=Perimeter(skin, RADIUS, 5.0, lattice=tile_of(EDGES).lattice),
        weight=1.0,
        length_scale=LengthScaleConstraints(skin, plain.filter, limits, plain.designed),
    )


@WAYS
@pytest.mark.parametrize(("objective", "symmetry"), [(TARGET, "tetragonal"), (CONTRAST, "chiral")])
def test_taylor_of_everything(batched: bool, objective: ProfileObjective, symmetry: str) -> None:
    """T with its perimeter term, both constraints, and each residual of a sum of squares."""
    chain = full(batched, objective, symmetry)
    skin = chain.skin
    density = start_of(chain)
    base = chain.evaluate(density)
    assert base.gradient is not None
    assert base.pressure_gradient is None
    assert base.length_scale is not None
    assert base.length_scale_gradients is not None
    assert base.residual_gradients is not None
    assert base.perimeter is not None
    assert len(base.residuals) == len(base.residual_gradients) == (6 if objective is TARGET else 0)
    assert base.objective - base.shape > 0.02 * base.shape, "the perimeter must matter"
    step = direction(chain.solver.tile) * chain.designed
    every = (base.gradient, *base.length_scale_gradients, *base.residual_gradients)
    slopes = [dot(skin.comm, g, step) for g in every]
    gaps = []
    for h in 1e-2 * 0.5 ** np.arange(6):
        there = chain.simulate(density + h * step, base.equilibrium.state)
        assert there.length_scale is not None
        values = np.array([there.objective - base.objective,
                           *(there.length_scale - base.length_scale),
                           *(there.residuals - base.residuals)])  # fmt: skip
        gaps.append(np.abs(values - h * np.array(slopes)))
        if len(gaps) == 1:
            assert (np.abs(values) > gaps[0]).all(), "the linear part must matter"
    rates = np.log2(np.array(gaps[:-1]) / gaps[1:])
    assert rates[-3:] == pytest.approx(2, abs=0.1)


def test_both_ways_give_the_same() -> None:
    """With the tile parted over the ranks, or its directions."""
    found = []
    for batched in (False, True):
        chain = full(batched, TARGET)
        skin = chain.skin
        e = chain.evaluate(start_of(chain))
        assert e.gradient is not None
        assert e.length_scale_gradients is not None
        assert e.residual_gradients is not None
        parts = (e.gradient, *e.length_scale_gradients, *e.residual_gradients)
        found.append((e, np.array([skin.gather_cells(g) for g in parts])))
    (one, first), (other, second) = found
    assert numbers(other.equilibrium) == pytest.approx(numbers(one.equilibrium), abs=1e-12)
    assert other.objective == pytest.approx(one.objective, rel=1e-12)
    assert other.length_scale == pytest.approx(one.length_scale, rel=1e-12)
    scale = np.abs(first).max(axis=1, keepdims=True)
    assert second / scale == pytest.approx(first / scale, abs=1e-11)
    assert other.residuals == pytest.approx(one.residuals, rel=1e-11)
    # Each rank's own MMA steps on these.
    rows = other.residual_gradients
    assert rows is not None
    for theirs, others in MPI.COMM_WORLD.allgather((other.gradient, rows)):
        assert (theirs == other.gradient).all()
        assert np.array_equal(others, rows)


def test_symmetric_design_has_a_symmetric_profile() -> None:
    chain = problem(False, CONTRAST)
    e = chain.simulate(start_of(chain))
    projected = chain.skin.gather_cells(e.projected)
    found = numbers(pulled(chain.solver.tile, projected, 0.1, ANGLES))
    assert np.roll(found, 6, axis=0) == pytest.approx(found, abs=1e-12)
    assert found[-np.arange(12)] * [1, 1, 1, -1] == pytest.approx(found, abs=1e-12)
    assert np.ptp(found[:, 0]) > 0.01


THREE = np.array([0.0, np.pi / 8, np.pi / 4])


def short_run(chain: TileProblem, **options: Any) -> DesignResult:
    return optimize(chain, DesignOptions((Stage(8),), **options), start=start_of(chain))


def test_short_design_run(comm: MPI.Comm) -> None:
    """Soft along the sides and stiff in between; the same on any number of ranks."""
    target = ProfileTarget(np.array([900.0, 1200.0, 2400.0]))
    chain = problem(True, target, angles=THREE, beta=8.0)
    result = short_run(chain)
    first, last = result.history[0], result.history[-1]
    # Without knowing its squares MMA comes to a 180th.
    assert last.objective < first.objective / 250
    soft, _, stiff = result.final.equilibrium.stiffness
    assert stiff > 1.3 * soft
    assert last.iteration == 8
    assert result.pressure == 0
    for image in tile_of(EDGES).symmetry_maps("tetragonal"):
        whole = chain.skin.gather_cells(result.final.projected)
        assert whole[image] == pytest.approx(whole, abs=1e-12)
    assert all((density == result.density).all() for density in comm.allgather(result.density))
    if comm.size == 1:
        return
    alone = dataclasses.replace(chain, solver=ProfileSolver(chain.solver.tile, THREE, 0.1))
    for other in (alone, problem(False, target, angles=THREE, beta=8.0)):
        rows = short_run(other).history
        assert [row.rejected for row in rows] == [row.rejected for row in result.history]
        for row, same in zip(result.history, rows, strict=True):
            assert row.objective == pytest.approx(same.objective, rel=1e-8)


def test_nothing_left_to_do() -> None:
    """T = 0, where nothing can be scaled, at the start and on the way."""
    chain = problem(True, ProfileTarget(np.full(3, 1e3)), angles=THREE)
    there = chain.evaluate(start_of(chain)).equilibrium
    reached = dataclasses.replace(chain, objective=ProfileTarget(there.stiffness))
    result = optimize(reached, DesignOptions((Stage(2),)), start=start_of(chain))
    assert result.final.objective < 1e-20
    assert result.density == pytest.approx(start_of(chain), abs=1e-6)
    near = dataclasses.replace(chain, objective=ProfileTarget(1.01 * there.stiffness))
    result = optimize(near, DesignOptions((Stage(12),)), start=start_of(chain))
    assert result.final.objective < 1e-12
    assert np.isfinite(result.density).all()


def test_what_mma_is_given() -> None:
    """T at 10 in each step, but for what is small enough; its squares apart; widths by halves."""
    chain = full(True, TARGET)
    start = chain.evaluate(start_of(chain))
    widths = start.length_scale
    assert widths is not None
    variables = Variables(chain, DesignOptions())

    def scaled(enough: float) -> Scaled:
        return Scaled(chain, variables, constrained=True, target_objective=enough, start=start)

    one = scaled(0.0)
    assert one.refer(start) == 1
    values, slopes = one.values(start), one.gradients(start)
    assert values.objective == pytest.approx(10, rel=1e-14)
    share = 1 - start.shape / start.objective
    assert values.rest == pytest.approx(10 * share, rel=1e-10), "the perimeter's term"
    assert values.residuals @ values.residuals == pytest.approx(10 * (1 - share), rel=1e-12)
    limits = chain.length_scale
    assert limits is not None
    expected = [max(0.8 * e, 0.5 * g) for e, g in zip(limits.epsilon, widths, strict=True)]
    assert values.constraints == pytest.approx(widths / expected - 1, rel=1e-12)
    whole = slopes.rest.copy()
    for r, slope in zip(values.residuals, slopes.residuals, strict=True):
        whole.axpy(2 * r, slope)
    assert whole.array == pytest.approx(slopes.objective.array, rel=1e-12, abs=1e-15)
    less = dataclasses.replace(start, objective=start.objective / 100)
    assert one.refer(less) == pytest.approx(100, rel=1e-12)
    assert one.values(less).objective == pytest.approx(10, rel=1e-12)
    capped = scaled(start.objective / 4)
    assert capped.refer(less) == pytest.approx(4, rel=1e-12)
    missing = values.missing
    assert np.isinf([missing.rest, *missing.constraints, *missing.residuals]).all()


def test_clock_stops_all_ranks(comm: MPI.Comm) -> None:
    """Whose clocks are apart; otherwise some would wait for the others."""
    chain = problem(True, CONTRAST)
    chain.evaluate(start_of(chain))
    comm.Barrier()
    if comm.rank < comm.size - 1:
        time.sleep(1.0)
    result = short_run(chain, seconds=0.7)
    counts = comm.allgather(len(result.history))
    assert counts == [counts[0]] * comm.size
    if comm.size > 1:
        assert counts[0] == 1


def test_bad_start_on_one_rank(comm: MPI.Comm) -> None:
    """All raise what one finds."""
    solver = pulling(True, THREE[:1])
    density = random_density(solver.tile.skin, 0)
    state = solver.tile.solve(density, 0.3, 1.1 * ALONG)
    with pytest.raises(errors.ParameterError, match="start is that of direction 0.3 rad, not of 0"):
        solver.solve(density, (state,))
    with pytest.raises(errors.DensityError, match="must lie in"):
        solver.solve(density + 1)


def test_bad_problems() -> None:
    chain = problem(False, CONTRAST)
    part: Any = object.__new__(Mirrored)
    with pytest.raises(errors.ParameterError, match="a tile is whole"):
        dataclasses.replace(chain, whole=part)
    with pytest.raises(errors.ParameterError, match="weight = -1"):
        dataclasses.replace(chain, weight=-1.0)
    with pytest.raises(errors.ParameterError, match="with held = UNIAXIAL"):
        ProfileSolver(solver_of(tile_of(EDGES), fixed=ALL_PRESCRIBED), ANGLES, 0.1)
    first = chain.simulate(random_density(chain.skin, 0))
    assert first.gradient is None
