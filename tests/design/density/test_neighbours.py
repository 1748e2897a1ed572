"""Neighbours inside a panel, and distributed matrices of weights on them."""

from types import SimpleNamespace

import numpy as np
import pytest
from helpers.scenes import square

from toros_fem.design.density.filters import (
    Neighbourhood,
    product,
)
from toros_fem.meshes import Skin, mirrored

RADIUS = 8e-3


def test_pairs_against_all_distances(short_tube: Skin, monkeypatch: pytest.MonkeyPatch) -> None:
    """The pairs of one panel within the radius, for any number of rows searched at once."""
    pattern = short_tube.pattern
    offset = pattern.centroids[None] - pattern.centroids[:, None]
    distance = np.linalg.norm(offset, axis=2)
    near = (distance <= RADIUS) & (pattern.panel[:, None] == pattern.panel[None])
    for at_once in (2_000_000, 1000):
        monkeypatch.setattr("toros_fem.design.density.filters.PAIRS", at_once)
        search = Neighbourhood(pattern, RADIUS)
        found = np.zeros_like(near)
        for pairs in search.pairs(pattern.centroids, pattern.panel):
            row = pairs.begin + pairs.row
            assert not found[row, pairs.cell].any()
            found[row, pairs.cell] = True
            assert pairs.offset == pytest.approx(offset[row, pairs.cell])
            assert pairs.distance == pytest.approx(distance[row, pairs.cell])
            assert pairs.sums(pairs.distance) == pytest.approx(
                (near * distance)[pairs.begin : pairs.begin + pairs.rows].sum(axis=1)
            )
        assert np.array_equal(found, near)
        assert np.array_equal(search.counts(pattern.centroids, pattern.panel), near.sum(axis=1))
    assert np.array_equal(
        search.nearest(pattern.centroids, pattern.panel), np.arange(len(pattern.panel))
    )


def test_a_part_has_the_neighbours_of_the_whole() -> None:
    """Neighbours across a plane of symmetry count as the triangles that they mirror."""
    pattern = square(n=6, size=0.02)
    whole = mirrored(pattern, (0,))
    alone = Neighbourhood(pattern, RADIUS)
    part, full = Neighbourhood(pattern, RADIUS, beyond=whole), Neighbourhood(whole.pattern, RADIUS)
    count = len(pattern.panel)
    points, panel = pattern.centroids, pattern.panel
    assert np.array_equal(part.counts(points, panel), full.counts(points, panel))
    assert (part.counts(points, panel) > alone.counts(points, panel)).any()
    cells = np.concatenate([pairs.cell for pairs in part.pairs(points, panel)])
    mirrors = np.concatenate([pairs.cell for pairs in full.pairs(points, panel)])
    assert np.array_equal(cells, whole.cell[mirrors])
    assert cells.max() < count <= mirrors.max()


def test_products_make_no_vectors() -> None:
    """Dropped ones stay in memory on several ranks: 58 MiB a rank after 400 steps of a filter."""
    made = []

    def vectors() -> tuple[SimpleNamespace, SimpleNamespace]:
        made.append(1)
        return SimpleNamespace(array=np.zeros(2)), SimpleNamespace(array=np.zeros(3))

    def mult(x: SimpleNamespace, y: SimpleNamespace) -> None:
        y.array[:] = x.array.sum()

    matrix = SimpleNamespace(createVecs=vectors, mult=mult, multTranspose=mult)
    made_of = product(matrix)  # type: ignore[arg-type]
    first = made_of.forward(np.ones(2))
    assert made_of.backward(np.ones(3)).tolist() == [3.0, 3.0]
    assert made_of.forward(np.zeros(2)).tolist() == [0.0] * 3
    assert first.tolist() == [2.0] * 3, "a result is not changed by the next product"
    assert len(made) == 1
