"""Entries found by pairs of blocks, against the plain way over all pairs of unknowns."""

import numpy as np
import pytest
from kit.terms import FOUR

from toros_fem.materials.sheet import Bending, Composite
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.mechanics.terms.model import SkinModel, make_model
from toros_fem.mechanics.terms.tangent import BlockPairs, TriangleMatrices
from toros_fem.meshes import Skin


def plain(model: SkinModel, triangles: TriangleMatrices) -> tuple[np.ndarray, np.ndarray]:
    """Key and weight of every number of the triangles; −1 where a component is fixed or absent."""
    index_map = model.space.dofmap.index_map
    local = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
    number = index_map.local_to_global(local)
    row, dofs, present = triangles.rows, triangles.dofs, triangles.present
    one, two = np.triu_indices(dofs.shape[1])
    i, j = dofs[:, one], dofs[:, two]
    low, high = np.minimum(number[i], number[j]), np.maximum(number[i], number[j])
    there = present[:, one] & present[:, two] & ~model.fixed[i] & ~model.fixed[j]
    keys, weights = np.empty_like(low), np.empty(low.shape)
    keys[row] = np.where(there, low * index_map.size_global + high, -1)
    weights[row] = np.where((low == high) & (one != two) & there, 2.0, 1.0)
    return keys.ravel(), weights.ravel()


@pytest.mark.parametrize("scene", ["tube", "tetrahedron"])
@pytest.mark.parametrize(
    "bending", [None, Bending(), Bending(curvature="average"), Bending(seams="hinged")]
)
def test_same_entries_as_over_all_pairs_of_unknowns(
    scene: str, bending: Bending | None, short_tube: Skin
) -> None:
    skin = short_tube if scene == "tube" else FOUR
    fixed = np.random.default_rng(3).random(skin.pattern.points.shape) < 0.5  # many in part
    fixed[0] = True
    model = make_model(skin, Composite(bending=bending), Supports(fixed))
    triangles = TriangleMatrices(model)
    pairs = BlockPairs(model, triangles)
    keys, weights = plain(model, triangles)
    assert triangles.count == len(keys)
    assert np.array_equal(pairs.keys, np.unique(keys[keys >= 0]))
    found = pairs.places(np.arange(len(pairs.keys) + 1))
    assert np.array_equal(np.append(pairs.keys, -1)[found], keys)
    twice = pairs.twice[keys[pairs.twice] >= 0]
    assert np.array_equal(np.sort(twice), np.flatnonzero(weights == 2))
    if scene == "tetrahedron" and bending == Bending() and len(skin.owned_cells):
        assert len(twice) > 0
