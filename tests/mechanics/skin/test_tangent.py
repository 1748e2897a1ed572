"""The order of the tangent's rows; contracts/test_terms.py checks its entries."""

import numpy as np
import pytest
from helpers.models import pressurize

from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.skin.model import SkinModel
from toros_fem.mechanics.skin.supports import clamp
from toros_fem.mechanics.skin.tangent import UpperTangent
from toros_fem.meshes import Skin


@pytest.fixture(scope="module")
def disturbed(tube: Skin) -> tuple[SkinModel, np.ndarray]:
    """A random design under pressure, far from any equilibrium and from stability."""
    model = SkinModel(tube, Composite(), clamp(tube.pattern, ["base"]))
    rng = np.random.default_rng(3)
    model.set_density(rng.random(len(tube.pattern.panel))[tube.owned_cells])
    pressurize(model, 5e3)
    noise = np.zeros(model.size_local)
    drawn = rng.standard_normal(tube.pattern.points.shape)
    model.positions(noise)[:] = 2e-4 * drawn[tube.owned_vertices]
    return model, model.assembled + noise * model.free


def test_rows_are_sorted_and_start_with_the_diagonal(
    disturbed: tuple[SkinModel, np.ndarray],
) -> None:
    model, state = disturbed
    tangent = UpperTangent(model)
    values = np.zeros(len(tangent.columns))
    tangent.assemble(state, values)
    first = model.space.dofmap.index_map.local_range[0]
    rows = np.repeat(np.arange(model.size_local), np.diff(tangent.indptr))
    assert np.array_equal(tangent.columns[tangent.diagonal], first + np.arange(model.size_local))
    inside = rows[1:] == rows[:-1]
    assert np.all(np.diff(tangent.columns)[inside] > 0)
    fixed = ~model.free
    assert np.all(values[tangent.diagonal][fixed] == 1)
    assert np.all(np.diff(tangent.indptr)[fixed] == 1), "nothing else in a fixed row"
