"""Each energy term: force, tangent, load, sensitivity and rotation, by the energy alone.

A kind of unknown is moved alone: forces at positions would hide those at turns and bodies. Where a
term adds to a bare skin, what the bare skin has is taken off first.
"""

from __future__ import annotations

import gc
import weakref
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
import pytest
from dolfinx import fem
from helpers.models import dense_tangent
from kit.slopes import slope
from kit.terms import TERMS, Term, design_of, model_of, periodic
from scipy.spatial.transform import Rotation

from toros_fem.base.fenicsx import _KERNELS, compiled
from toros_fem.forms.energy import SkinForms
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.stretch_bounds import MixedBounds
from toros_fem.mechanics.terms.model import SkinModel
from toros_fem.mechanics.terms.tangent import MATERIAL, UpperTangent

STEP = 2e-8  # m: the fourth order's error is at rounding


def kinds(model: SkinModel) -> list[np.ndarray]:
    """Return which unknowns are positions, turns of edges, the lattice, and free bodies."""
    places = np.zeros(model.size_local, dtype=bool)
    model.positions(places)[:] = True
    lattice, bodies = ~places & False, np.zeros(model.size_local)
    if model.images is not None:
        lattice[model.images.dofs] = True
    if model.contact is not None:
        model.contact.set_motions(bodies, np.ones((model.free_bodies, 6)))
    return [places, ~places & ~lattice & (bodies == 0), lattice, bodies > 0]


def ways(model: SkinModel) -> Iterator[np.ndarray]:
    """Yield a small random motion of each kind of unknown."""
    numbers = np.random.default_rng(2).uniform(-1, 1, model.size_local)
    for kind in kinds(model):
        if (kind & model.free).any():
            yield STEP * numbers * model.free * kind


def compare(
    energy: Callable[[np.ndarray], float],
    force: Callable[[np.ndarray], np.ndarray],
    tangent: np.ndarray,
    state: np.ndarray,
    model: SkinModel,
) -> int:
    """Check force and tangent along each kind of unknown; return how many do any work."""
    pull, moved = force(state), 0
    rounding = 5e-17 + 4e-15 * abs(model.energy(state))  # of a difference of the whole energies
    for way in ways(model):
        work, wide = np.abs(pull) @ np.abs(way), np.abs(tangent) @ np.abs(way)
        by_energy = slope(lambda h, way=way: energy(state + h * way))  # type: ignore[misc]
        by_force = slope(lambda h, way=way: force(state + h * way))  # type: ignore[misc]
        assert pull @ way == pytest.approx(by_energy, abs=1e-7 * work + rounding)
        found = (tangent @ way) * model.free
        assert np.abs(found - by_force * model.free).max() < 1e-6 * wide.max() + 1e-14
        moved += bool(work > 1e-12)
    return moved


@pytest.mark.parametrize("term", TERMS.values(), ids=TERMS)
def test_force_and_tangent(term: Term) -> None:
    (state, model), size = model_of(term), 0
    if term.adds is not None:
        _, bare = model_of(Term(skin=term.skin))
        size = bare.size_local

    def alone(of: Callable[[SkinModel, np.ndarray], Any], x: np.ndarray) -> Any:
        found = np.array(of(model, x))
        if size:
            found[(slice(size),) * found.ndim] -= of(bare, x[:size])
        return found

    moved = compare(
        lambda x: float(alone(SkinModel.energy, x)),
        lambda x: np.asarray(alone(SkinModel.residual, x)),
        np.asarray(alone(dense_tangent, state)),
        state,
        model,
    )
    assert moved == term.kinds
    if term.by_hand is not None:
        places = model.skin.gather_vertices(model.positions(state))
        found = float(alone(SkinModel.energy, state))
        assert found == pytest.approx(term.by_hand(places), rel=1e-8)


def shared_and_own(model: SkinModel, design: np.ndarray) -> Iterator[tuple[Any, Any]]:
    """Yield what each shared form of a model gives, and what it gives when compiled for itself."""
    names: dict[str, Callable[[SkinForms], Any]] = {
        "energy": lambda forms: forms.energy,
        "residual": lambda forms: forms.residual,
        "tangent": lambda forms: forms.tangent,
    }
    for k in range(len(model.design.functions)):
        names[f"by {k}"] = lambda forms, k=k: forms.sensitivities[k]  # type: ignore[misc]
    for k in model.forms.loads:
        names[f"load {k}"] = lambda forms, k=k: forms.loads[k][1]  # type: ignore[misc]
        if model.terms[k] is model.pressure:
            names["volume"] = lambda forms, k=k: forms.loads[k][0]  # type: ignore[misc]
    bounds = model.bounds
    if isinstance(bounds, MixedBounds):
        names["narrowed"] = lambda forms: bounds.narrowed(forms.residual)
        bounds.loosen(np.zeros_like(model.corners(model.assembled)))
    model.set_density(design)
    for name, of in names.items():
        assert (model._shared._kind, name) in _KERNELS
        forms = model.compiled(name, of), compiled(of(model.forms))
        if forms[0].rank == 0:
            yield tuple(fem.assemble_scalar(form) for form in forms)
        else:
            yield tuple(fem.assemble_vector(form).array for form in forms)


@pytest.mark.parametrize("term", [*TERMS.values(), None], ids=[*TERMS, "tile"])
def test_forms_of_a_kind_are_shared(term: Term | None) -> None:
    """A second model fills the code of the first, with other values; the first is forgotten."""
    make = periodic if term is None else partial(model_of, term)
    first = make()[1]
    first.density_sensitivity(first.assembled, first.assembled)
    UpperTangent(first)
    known, old = len(_KERNELS), weakref.ref(first.q)
    state, model = make()
    model.density_sensitivity(state, 0.3 * state)
    UpperTangent(model)
    assert len(_KERNELS) == known
    assert "forms" not in vars(model), "nothing is stated in UFL again"
    del first
    gc.collect()
    assert old() is None
    found = 0
    design = model.design.owned if term is None else design_of(term, 0.1)
    for shared, own in shared_and_own(model, design):
        assert np.array_equal(shared, own)
        found += bool(np.any(own))
    assert found >= 4


@pytest.mark.parametrize("bending", [True, False])
def test_force_and_tangent_of_a_tile(bending: bool) -> None:
    composite = TERMS["sheet" if bending else "membrane"].composite
    state, model = periodic(composite)
    tangent = dense_tangent(model, state)
    assert compare(model.energy, model.residual, tangent, state, model) == 2 + bending


@pytest.mark.parametrize("term", TERMS.values(), ids=TERMS)
def test_load(term: Term) -> None:
    """What a load adds to the forces is what `applied_load` says, and none is no force."""
    state, model = model_of(term)
    load, pull = model.applied_load(state), model.residual(state)
    model.set_load(Load(0 * term.load.pressures))
    change = model.residual(state) - pull
    assert change == pytest.approx(load, abs=1e-9 * np.abs(pull).max())
    assert not model.applied_load(state).any()


@pytest.mark.parametrize("term", TERMS.values(), ids=TERMS)
def test_sensitivity(term: Term) -> None:
    """Of the work of a random adjoint, by each column of the design."""
    state, model = model_of(term)
    adjoint = np.random.default_rng(6).uniform(-1, 1, model.size_local) * model.free
    base = design_of(term)
    found = model.density_sensitivity(state, adjoint)
    assert found.shape == base.shape

    def work(shift: float) -> float:
        model.set_density(design_of(term, shift))
        return float(model.residual(state) @ adjoint)

    way = slope(lambda h: design_of(term, h), 1e-2)
    change = slope(work, 1e-2)
    assert (found * way).sum() == pytest.approx(change, rel=1e-6)
    assert abs(change) > 1e-6 * np.abs(found * way).sum()


@pytest.mark.parametrize("name", [name for name, term in TERMS.items() if term.free])
def test_rotation(name: str) -> None:
    """Energy does not see where the skin is and how it is turned; forces turn with it."""
    state, model = model_of(TERMS[name])
    turn = Rotation.from_euler("xyz", [0.4, -1.1, 2.0]).as_matrix()
    there = state.copy()
    model.positions(there)[:] = model.positions(state) @ turn.T + [0.03, -0.02, 0.05]
    assert model.energy(there) == pytest.approx(model.energy(state), rel=1e-9)
    pull = model.positions(model.residual(state) + model.reaction(state))
    turned = model.positions(model.residual(there) + model.reaction(there))
    assert turned == pytest.approx(pull @ turn.T, abs=1e-8 * np.abs(pull).max())


@pytest.mark.parametrize("term", TERMS.values(), ids=TERMS)
def test_material_part(term: Term) -> None:
    """It is positive semidefinite, so that a multiple of it makes any tangent positive."""
    state, model = model_of(term)
    noise = np.random.default_rng(3).standard_normal(model.size_local)
    state += 2e-4 * noise * model.free * kinds(model)[0] * (term.width == 1)
    material = dense_tangent(model, state, MATERIAL)
    scale = 1 / np.sqrt(np.abs(np.diag(material)))
    lowest = np.linalg.eigvalsh(scale[:, None] * material * scale)
    assert lowest[0] > -1e-11 * lowest[-1]
    if model.contact is not None:  # what makes its tangent so is told entry by entry
        more, less = (model.contact.entries(state, definite=part) for part in (True, False))
        added = (material - dense_tangent(model, state))[tuple(model.contact.pairs)]
        rows = model.contact.pairs
        _, bare = model_of(Term(width=term.width))
        inner = np.all(rows < bare.size_local, axis=0)
        small = state[: bare.size_local]
        of_sheet = dense_tangent(bare, small, MATERIAL) - dense_tangent(bare, small)
        added[inner] -= of_sheet[tuple(rows[:, inner])]
        assert more - less == pytest.approx(added, abs=1e-10 * np.abs(material).max())
