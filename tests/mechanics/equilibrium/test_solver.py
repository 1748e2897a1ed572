"""Equilibrium against exact states, and its errors."""

import gc
import pickle
import weakref

import numpy as np
import pytest
from helpers.models import dense_tangent, pressurize
from helpers.scenes import TABLE_A, square, table
from helpers.standing import model_on_base, solver_on_base
from mpi4py import MPI

from toros_fem import errors
from toros_fem.base.mpi import norm
from toros_fem.materials.sheet import SEAMS, Bending, Composite, Material
from toros_fem.mechanics.contact.bodies import Ground
from toros_fem.mechanics.contact.contact import Contact
from toros_fem.mechanics.equilibrium.equilibrium import EquilibriumError
from toros_fem.mechanics.equilibrium.newton import NewtonOptions
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.supports import Supports, clamp_where, pin, symmetry_plane
from toros_fem.meshes import Pattern, Skin, cylinder, finger, sew, two_panels, walker
from toros_fem.meshes.pattern import Panel
from toros_fem.products.actuators.legs import rest_on_body

RADIUS = 0.01


def fabric(skin: Skin) -> np.ndarray:
    return np.zeros(len(skin.owned_cells))


@pytest.mark.parametrize("row", table("gent_cylinder_ngon"), ids=lambda r: f"{r['mat']}-"
                         f"{r['n_circumference']}-{r['P_Pa']}")  # fmt: skip
def test_exact_polygonal_tube(alone: MPI.Comm, row: dict[str, str]) -> None:
    """The exact state of the inflated n-gon tube is in balance, around as well as along."""
    sides, pressure = int(row["n_circumference"]), float(row["P_Pa"])
    edge = 2 * np.pi * RADIUS / sides
    pattern = cylinder(alone, 6 * edge, 2 * RADIUS, edge, mesh="structured")
    factor = 1.0 if row["mat"] == "A" else 100.0
    cloth = Material(TABLE_A.young * factor, TABLE_A.poisson, TABLE_A.thickness)
    skin = sew(alone, pattern)
    composite = Composite(fabric=cloth, c1=1.8, c2=2.0, bending=None)
    model = model_on_base(skin, composite)
    model.set_density(fabric(skin))
    pressurize(model, pressure)
    swell, lengthen = float(row["lambda_theta"]), float(row["lambda_z"])
    state = (model.assembled.reshape(-1, 3) * [swell, swell, lengthen]).ravel()
    force = skin.gather_vertices(model.residual(state).reshape(-1, 3))
    load = skin.gather_vertices(model.volume_gradient(state).reshape(-1, 3)) * pressure
    caps = np.union1d(pattern.vertices_of("base"), pattern.vertices_of("tip"))
    inner = np.setdiff1d(np.arange(len(pattern.points)), caps)
    assert np.linalg.norm(force[inner]) <= 1e-8 * np.linalg.norm(load[inner])
    # Along the tube: the thrust on the tip is what the wall pulls with.
    area = 0.5 * sides * np.sin(2 * np.pi / sides) * (RADIUS * swell) ** 2
    assert abs(force[caps, 2].sum()) <= 1e-8 * pressure * area


def test_result_tells_what_happened(short_solver: EquilibriumSolver) -> None:
    skin, comm = short_solver.skin, short_solver.skin.comm
    rng = np.random.default_rng(0)
    density = rng.random(len(skin.pattern.panel))[skin.owned_cells]
    result = short_solver.solve(density, 5e3)
    assert result.converged
    assert result.reason == "A stable equilibrium was found at 5000 Pa."
    assert result.residual <= 1e-9
    assert 0 < result.steps <= result.factorisations
    assert result.history[-1].residual == result.residual
    energies = [row.energy for row in result.history]
    assert np.all(np.diff(energies) <= 1e-12 * abs(energies[-1])), "each step lowers the energy"
    assert 0 < result.stretch_use < 1
    model = short_solver.model
    assert norm(comm, model.residual(result.state)) < 1e-8 * 5e3 * norm(
        comm, model.volume_gradient(result.state)
    )
    again = short_solver.solve(density, 5e3, start=result)
    assert again.steps == 0
    # A small step: the tangent at its end, factorised once, shows that nothing snapped.
    assert short_solver.solve(density, 5.01e3, start=result).factorisations == 1
    # The same state by another way: up in small steps, and back down from a higher pressure.
    higher = short_solver.solve(density, 8e3, start=result)
    back = short_solver.solve(density, 5e3, start=higher)
    assert norm(comm, back.state - result.state) < 1e-7 * norm(comm, result.state)


@pytest.mark.parametrize("seams", SEAMS)
def test_flat_pillow_inflates(alone: MPI.Comm, seams: str) -> None:
    """A start of no volume, with no stiffness across its plane but bending."""
    size = 0.05
    one = square(n=6, size=size)
    # The lower panel is laid mirrored, so that it faces down and its diagonals cross the upper.
    below = one.points * [-1, 1, 1] + [size, 0, 0]
    pattern = Pattern.from_panels(
        [
            Panel("top", one.flat_points, one.flat_triangles, one.points),
            Panel("bottom", one.flat_points, one.flat_triangles, below),
        ],
        tolerance=1e-6,
    )
    assert len(pattern.free_edges) == 0
    fixed = np.zeros((len(pattern.points), 3), dtype=bool)
    at = [int(np.argmin(np.linalg.norm(pattern.points[:, :2] - corner, axis=1)))
          for corner in ([0, 0], [size, 0], [size, size])]  # fmt: skip
    fixed[at[0]], fixed[at[1], 1:], fixed[at[2], 2] = True, True, True
    skin = sew(alone, pattern)
    bending = Bending(seams=seams)
    solver = EquilibriumSolver(skin, Composite(bending=bending), Supports(fixed))
    result = solver.solve(fabric(skin), 500.0)
    assert result.converged
    assert result.volume > 0.1 * size**3
    assert np.linalg.eigvalsh(dense_tangent(solver.model, result.state))[0] > 0


def test_a_trial_is_completed(short_tube: Skin, alone: MPI.Comm) -> None:
    """A trial costs no factorisation at its end; completed, it is the equilibrium."""
    solver = solver_on_base(short_tube)
    density = fabric(short_tube) + 0.3
    base = solver.solve(density, 2e3)
    changed = density + np.where(short_tube.owned_cells % 2, 0.02, -0.02)
    trial = solver.solve(changed, 2.02e3, start=base, trial=True)
    assert trial.converged
    assert trial.residual <= 1e-6
    with pytest.raises(errors.ParameterError, match="finish a trial first"):
        solver.solve_tangent(trial.state, trial)
    found = solver.finish(trial)
    assert found.residual <= 1e-10
    assert found.factorisations >= 1
    assert solver.finish(found) is found
    tangent = solver.solve_tangent(found.state, found)
    assert "stable" in found.reason
    assert "stable" not in trial.reason
    direct = solver_on_base(short_tube)
    exact = direct.solve(changed, 2.02e3).state
    assert norm(alone, found.state - exact) < 1e-8 * norm(alone, exact)
    # Rejected trials, completed or not, do not take away the design that the next one starts from.
    for pressure in (2.01e3, 2.02e3):
        near = solver.solve(changed, pressure, start=base, trial=True)
        assert near.history[0].kind == "modified", "the tangent predictor"
    again = solver.solve(density, 2e3, start=base, trial=True)
    assert again.converged
    assert again.history[0].residual < 1e-9, "the start is that design's own equilibrium"
    for _ in range(2):
        solver.solve(density + 0.01, 2e3)
    assert solver.finish(trial).state == pytest.approx(found.state, abs=1e-10)
    assert solver.solve_tangent(found.state, found) == pytest.approx(tangent, rel=1e-6)


def test_a_trial_that_fails_is_not_continued(short_tube: Skin) -> None:
    far = Composite(fabric=TABLE_A, c1=1e5, c2=1e5, bending=None)
    solver = solver_on_base(short_tube, far)
    with pytest.raises(EquilibriumError, match="took 40 steps without converging") as caught:
        solver.solve(fabric(short_tube), 2.5e3, trial=True)
    assert caught.value.result.load_factor == 0
    assert len(caught.value.result.history) <= 60


@pytest.mark.slow
def test_nothing_remains_of_a_failed_solve(short_tube: Skin, alone: MPI.Comm) -> None:
    density, few = fabric(short_tube), NewtonOptions(max_steps=30, min_increment=0.5)
    solver = solver_on_base(short_tube, options=few)
    first = solver.solve(density, 10.0)
    tangent = solver.solve_tangent(first.state, first)
    failed = solver.solve(density, 1e13, raise_on_failure=False)
    assert not failed.converged
    assert failed.pressure > 1e6
    after = solver.solve(density, 10.3, start=first)
    assert after.steps > 0
    assert solver.solve_tangent(first.state, first) == pytest.approx(tangent, rel=1e-9)
    model = solver.model
    pressurize(model, 10.3)
    load = 10.3 * norm(alone, model.volume_gradient(after.state))
    assert norm(alone, model.residual(after.state)) < 1e-8 * load
    # The residual told is that of the state returned.
    pressurize(model, failed.pressure)
    load = failed.pressure * norm(alone, model.volume_gradient(failed.state))
    assert norm(alone, model.residual(failed.state)) / load == pytest.approx(failed.residual)
    assert failed.residual < 1e-5  # so near to the stretch bounds rounding allows no better


@pytest.mark.slow
def test_beyond_the_limit_point(alone: MPI.Comm) -> None:
    """Without a barrier in reach the tube has a limit pressure; above it nothing holds."""
    limit = float(table("stvk_limit_pressures")[0]["capped_cyl_lambda_theta_at_Pmax"])
    assert limit == pytest.approx(2.28856)
    skin = sew(alone, cylinder(alone, 0.04, 2 * RADIUS, 5e-3, mesh="structured"))
    composite = Composite(fabric=TABLE_A, c1=1e5, c2=1e5, bending=None)
    few = NewtonOptions(max_steps=40)
    solver = solver_on_base(skin, composite, options=few)
    below = solver.solve(fabric(skin), 1.2e3)
    assert below.converged
    with pytest.raises(EquilibriumError, match="was found at 2500 Pa, at once") as caught:
        solver.solve(fabric(skin), 2.5e3)
    last = caught.value.result
    assert not last.converged
    assert np.isfinite(last.state).all()
    assert "Lower the load" in last.reason
    # The state balances that fraction of the load, and no more.
    model = solver.model
    for pressure, balanced in ((2500 * last.load_factor, True), (2500.0, False)):
        pressurize(model, pressure)
        load = pressure * norm(alone, model.volume_gradient(last.state))
        assert (norm(alone, model.residual(last.state)) < 1e-8 * load) == balanced
    # The long tube's limit; this one is short and held at its base, which carries it further.
    assert 1811 < last.pressure < 2500
    # Ranks exchange errors as pickles: the result must survive.
    again = pickle.loads(pickle.dumps(caught.value))
    assert isinstance(again, EquilibriumError)
    assert str(again) == str(caught.value)
    assert np.array_equal(again.result.state, last.state)
    assert (again.steps, again.factorisations) == (last.steps, last.factorisations)
    silent = solver.solve(fabric(skin), 2.5e3, raise_on_failure=False)
    assert not silent.converged
    assert silent.pressure == last.pressure


def test_a_dropped_solver_is_freed(alone: MPI.Comm, short_tube: Skin) -> None:
    """By its last reference alone: with some versions the collector does not see PETSc's parts."""
    solver = solver_on_base(short_tube)
    solver.solve(np.full(len(short_tube.owned_cells), 0.5), 5e3)
    model, factor = weakref.ref(solver.model), weakref.ref(solver._factor)
    gc.disable()
    try:
        del solver
        assert model() is None
        assert factor() is None
    finally:
        gc.enable()


def half_finger(comm: MPI.Comm) -> tuple[Skin, Supports]:
    pattern = finger(comm, 4e-3, planes=(1,))
    mount = clamp_where(pattern, lambda x: x[:, 0] < 0.0151)
    return sew(comm, pattern), mount | symmetry_plane(pattern, 1)


@pytest.mark.parametrize("scene", ["pillow", "finger", "walker"])
def test_flat_skins_with_contact_start_apart(alone: MPI.Comm, scene: str) -> None:
    """Inflated, layers do not touch: where nothing holds them the state is that without contact."""
    pytest.importorskip("ipctk")
    if scene == "finger":
        skin, supports = half_finger(alone)
    elif scene == "walker":
        pattern = walker(alone, 4e-3, planes=(0, 1))
        skin, supports = sew(alone, pattern), rest_on_body(pattern, 0.02, (0, 1))
    else:
        side = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * 0.015
        pattern = two_panels(alone, side, 4e-3)
        skin, supports = sew(alone, pattern), pin(pattern, "bottom")
    composite = Composite(TABLE_A, bending=Bending(seams="hinged"))
    energies = []
    for contact in (Contact(), None):
        solver = EquilibriumSolver(skin, composite, supports, contact=contact)
        found = solver.solve(fabric(skin), 2e3)
        energies.append(found.energy)
        assert found.converged
        if contact is not None:
            assert found.smallest_distance > 0
            begin = solver.model.assembled
            assert solver.model.refusal(begin) is None
            assert solver.model.admits(found.state)
    if scene != "finger":  # its mount holds layers as far apart as the fabric is thick
        assert energies[0] == pytest.approx(energies[1], rel=1e-9)


def test_starts_that_contact_forbids_are_refused(alone: MPI.Comm) -> None:
    pytest.importorskip("ipctk")
    skin, supports = half_finger(alone)
    solver = EquilibriumSolver(skin, Composite(TABLE_A), supports, contact=Contact())
    flat = skin.pattern.points[skin.owned_vertices]
    with pytest.raises(
        errors.ParameterError,
        match=r"act on the start: faces overlap by 0\.\d+ mm at vert.* of 'top' and 'bottom'",
    ):
        solver.solve(fabric(skin), 1e3, start=flat)
    assert not solver.model.admits(solver.model.state_of(flat))
    inside_out = solver.model.assembled
    solver.model.positions(inside_out)[:, 2] *= -1
    found = solver.solve(fabric(skin), 1e3, start=inside_out)
    assert found.converged
    ground = Contact(ground=Ground((0, 0, 0)))
    with pytest.raises(
        errors.ParameterError, match=r"assembled shape.* overlap.* the ground, near"
    ):
        EquilibriumSolver(skin, Composite(TABLE_A), supports, contact=ground).solve(
            fabric(skin), 1e3
        )


def outside(solver: EquilibriumSolver, use: float) -> np.ndarray:
    """Return owned positions of a stretched tube, with a vertex off so that one triangle is out."""
    pattern, model = solver.skin.pattern, solver.model
    whole = pattern.points * [1.0, 1.0, 1.3]
    middle = int(np.argmin(np.abs(pattern.points - [RADIUS, 0.0, 0.03]).sum(axis=1)))

    def at(off: float) -> np.ndarray:
        moved = whole.copy()
        moved[middle, 2] += off
        return moved[solver.skin.owned_vertices]

    def used(off: float) -> float:
        return model.bounds.worst_of_start(model.corners(model.state_of(at(off))))

    low, high = 0.0, 0.02
    for _ in range(60):
        half = (low + high) / 2
        low, high = (half, high) if used(half) < use else (low, half)
    assert used(high) == pytest.approx(use, abs=1e-6)
    return at(high)


@pytest.mark.parametrize("use", [1.01, 1.3])
def test_a_start_outside_the_stretch_bounds_is_brought_inside(
    short_solver: EquilibriumSolver, use: float
) -> None:
    solver = short_solver
    plain = fabric(solver.skin)
    expected = solver.solve(plain, 1e3)
    start = outside(solver, use)
    for given in (start, solver.model.state_of(start)):  # positions, and all unknowns
        found = solver.solve(plain, 1e3, start=given)
        assert found.converged
        assert found.stretch_use < 1
        np.testing.assert_allclose(found.positions, expected.positions, atol=1e-9)
    assert solver.solve(plain, 1e3, start=start, trial=True).converged
