"""Order of the tangent's rows; its entries are checked in test_terms."""

import numpy as np
from helpers.models import dense_tangent
from helpers.standing import model_on_base

from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.terms.tangent import EXACT, STRAINS, UpperTangent
from toros_fem.meshes import Skin


def test_rows_are_sorted_and_start_with_the_diagonal(short_tube: Skin) -> None:
    model = model_on_base(short_tube)
    model.set_density(np.full(len(short_tube.owned_cells), 0.3))
    assert model.entry_space.dofmap.bs == 21 * 22 // 2, "the entries that a triangle is given"
    tangent = UpperTangent(model)
    values = np.zeros(len(tangent.columns))
    tangent.assemble(model.assembled, values)
    first = model.space.dofmap.index_map.local_range[0]
    rows = np.repeat(np.arange(model.size_local), np.diff(tangent.indptr))
    assert np.array_equal(tangent.columns[tangent.diagonal], first + np.arange(model.size_local))
    inside = rows[1:] == rows[:-1]
    assert np.all(np.diff(tangent.columns)[inside] > 0)
    fixed = ~model.free
    assert np.all(values[tangent.diagonal][fixed] == 1)
    assert np.all(np.diff(tangent.indptr)[fixed] == 1), "nothing else in a fixed row"


def test_with_a_large_shift_only_stretching_softens(short_tube: Skin) -> None:
    """What bending adds is positive semidefinite then; the exact tangent of kinks is not."""
    whole, bare = model_on_base(short_tube), model_on_base(short_tube, Composite(bending=None))
    kinks = 2e-4 * np.random.default_rng(4).standard_normal(whole.size_local) * whole.free
    for model in (whole, bare):
        model.set_density(np.full(len(short_tube.owned_cells), 0.3))
    state = whole.assembled + kinks
    size, lowest = bare.size_local, {}
    for part in (EXACT, STRAINS):
        added = dense_tangent(whole, state, part)
        added[:size, :size] -= dense_tangent(bare, state[:size], part)
        eigenvalues = np.linalg.eigvalsh(added[np.ix_(whole.free, whole.free)])
        lowest[part] = eigenvalues[0] / eigenvalues[-1]
    assert lowest[EXACT] < -1e-3
    assert lowest[STRAINS] > -1e-11
