"""Two materials with bounds of their own: energy of mixtures, and when bounds are let loose."""

from dataclasses import replace

import numpy as np
import pytest
import ufl
from dolfinx import fem
from helpers.models import affine, sheet_model
from mpi4py import MPI

from toros_fem.base.mpi import norm, total
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.skin.stretch_bounds import MixedBounds

# A print that hardly stretches.
TIGHT = replace(Composite(), reinforcement=replace(Composite().reinforcement, c1=1.2, c2=1.35))


FLAT = replace(TIGHT, bending=None)


def test_energy_is_that_of_the_mixed_bounds(alone: MPI.Comm) -> None:
    """Of a homogeneous sheet by hand, also where strains are tiny."""
    model = sheet_model(alone, FLAT)
    area = float(model.skin.pattern.areas.sum())
    fabric, printed = FLAT.fabric, FLAT.reinforcement
    for rho in (0.0, 0.3, 1.0):
        model.set_density(np.full(len(model.skin.owned_cells), rho))
        mu, lam = (
            (1 - rho) * fabric.thickness * getattr(fabric, name)
            + rho * printed.thickness * getattr(printed, name)
            for name in ("mu", "lam")
        )
        a, b = (0.9 - 0.7 * rho) ** 2, (1.6 - 1.25 * rho) ** 2
        for x, y in ((0.15, -0.05), (1e-7, 2e-7)):
            logs = [np.log1p(-x * x / a), np.log1p(-y * y / a), np.log1p(-((x + y) ** 2) / b)]
            expected = -mu * a * (logs[0] + logs[1]) - lam / 2 * b * logs[2]
            state = affine(model, np.array([[1 + x, 0], [0, 1 + y], [0, 0]]))
            assert model.energy(state) == pytest.approx(area * expected, rel=1e-7)


def test_print_stiffens_at_every_stretch(alone: MPI.Comm) -> None:
    """∂ψ/∂ρ̄ ≥ 0 up to where the mixture's barrier is, and nothing jumps at ρ̄ = 0."""
    model = sheet_model(alone, FLAT)
    before, areas = np.inf, float(model.skin.pattern.areas.sum())
    for stretch in (0.85, 1.1, 1.4, 1.8):
        state = affine(model, np.array([[stretch, 0], [0, 1], [0, 0]]))
        values = []
        for rho in (0.0, 1e-9, 0.01, 0.1, 0.3, 0.6, 0.9, 1.0):
            model.set_density(np.full(len(model.skin.owned_cells), rho))
            values.append(model.energy(state) / areas)
        finite = np.isfinite(values)
        assert np.all(np.diff(np.array(values)[finite]) > 0)
        assert np.all(np.diff(finite.astype(int)) <= 0), "once outside, outside"
        assert values[1] == pytest.approx(values[0], rel=1e-5)
        assert finite.sum() <= before if stretch > 1 else finite.all()
        before = finite.sum() if stretch > 1 else before


def test_each_triangle_has_bounds_of_its_own(alone: MPI.Comm) -> None:
    model = sheet_model(alone, FLAT)
    cells, count = model.skin.owned_cells, len(model.skin.pattern.panel)
    density: np.ndarray = np.linspace(0.0, 1.0, count)
    model.set_density(density[cells])
    bounds = model.bounds
    assert isinstance(bounds, MixedBounds)
    state = affine(model, np.array([[1.15, 0], [0, 1.0], [0, 0]]))
    use = model.skin.gather_cells(bounds.use(model.corners(state)))
    expected = np.maximum(0.15 / (0.9 - 0.7 * density), 0.15 / (1.6 - 1.25 * density))
    assert use == pytest.approx(expected, rel=1e-12)
    assert not bounds.loosen(model.corners(state))
    state = affine(model, np.array([[1.3, 0], [0, 1.0], [0, 0]]))
    assert model.energy(state) == np.inf
    assert bounds.worst_of_start(model.corners(state)) == pytest.approx(0.3 / 0.9)
    assert bounds.loosen(model.corners(state))
    assert np.isfinite(model.energy(state))
    assert bounds.worst(model.corners(state)) < 1
    near, rounds = affine(model, np.diag([1.195, 1.0, 0])[:, :2]), 0
    while bounds.loosened and rounds < 10:
        bounds.narrow(model.corners(near), None)
        rounds += 1
    assert 1 < rounds < 10
    assert np.isfinite(model.energy(near))
    assert model.energy(state) == np.inf, "all bounds are back"


def test_shared_bounds_compile_the_usual_forms(alone: MPI.Comm) -> None:
    """Bounds of the materials that are alike make the forms of one pair, and equal bits."""
    one = Composite(c1=1.5, c2=2.0, bending=None)
    own = replace(
        one,
        fabric=replace(one.fabric, c1=1.5, c2=2.0),
        reinforcement=replace(one.reinforcement, c1=1.5, c2=2.0),
        c1=1.9,
    )
    models = [sheet_model(alone, composite) for composite in (one, own)]
    results = []
    for model in models:
        assert not isinstance(model.bounds, MixedBounds)
        assert not any(
            isinstance(c, fem.Function) and c is not model.q and c is not model.design.density
            for c in ufl.algorithms.analysis.extract_coefficients(model.forms.energy)
        )
        model.set_density(np.full(len(model.skin.owned_cells), 0.3))
        results.append(model.residual(affine(model, np.diag([1.2, 0.9, 0])[:, :2])))
    assert np.array_equal(results[0], results[1])


def test_bounds_are_narrowed_along_a_predicted_motion(alone: MPI.Comm) -> None:
    """The push is the change of the force by the bounds; a motion that leads inside is taken."""
    model = sheet_model(alone, FLAT)
    model.set_density(np.full(len(model.skin.owned_cells), 0.9))
    state = affine(model, np.array([[1.5, 0], [0, 1.0], [0, 0]]))
    bounds = model.bounds
    assert isinstance(bounds, MixedBounds)
    assert bounds.loosen(model.corners(state))
    before = model.residual(state)
    push = bounds.push() * model.free
    gone = bounds.narrow(model.corners(state), model.corners(0 * state))
    assert 0 < gone < 1, "the way from the bound 2 to 1.27 stays outside but for its first part"
    changed = model.residual(state) - before
    cosine = total(alone, float(push @ changed)) / (norm(alone, push) * norm(alone, changed))
    assert cosine > 0.99
    assert bounds.loosened
    inside = affine(model, np.array([[1.1, 0], [0, 1.0], [0, 0]]))
    gone = bounds.narrow(model.corners(state), model.corners(inside - state))
    assert gone == 1
    assert not bounds.loosened
