"""Neighbours inside a panel, and distributed matrices of weights on them."""

from types import SimpleNamespace

import numpy as np
import pytest
from helpers.scenes import square
from mpi4py import MPI

from toros_fem.base.mpi import dot
from toros_fem.design.density.linear import product
from toros_fem.design.density.neighbours import (
    Neighbourhood,
    Pairs,
    neighbour_matrices,
)
from toros_fem.meshes import Skin, mirrored, sew
from toros_fem.meshes.triangles import equilateral_edge

RADIUS = 8e-3


def test_pairs_against_all_distances(short_tube: Skin, monkeypatch: pytest.MonkeyPatch) -> None:
    """The pairs of one panel within the radius, for any number of rows searched at once."""
    pattern = short_tube.pattern
    offset = pattern.centroids[None] - pattern.centroids[:, None]
    distance = np.linalg.norm(offset, axis=2)
    near = (distance <= RADIUS) & (pattern.panel[:, None] == pattern.panel[None])
    for at_once in (2_000_000, 1000):
        monkeypatch.setattr("toros_fem.design.density.neighbours.PAIRS", at_once)
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


def test_matrices_do_not_depend_on_ranks(tube: Skin, comm: MPI.Comm) -> None:
    def weigh(pairs: Pairs) -> list[np.ndarray]:
        return [RADIUS - pairs.distance, pairs.offset[:, 0]]

    def products(skin: Skin, values: np.ndarray) -> list[np.ndarray]:
        search = Neighbourhood(skin.pattern, RADIUS)
        matrices = neighbour_matrices(skin, search, weigh, 2)
        mine = values[skin.owned_cells]
        both = [act(mine) for matrix in matrices for act in (matrix.forward, matrix.backward)]
        return [skin.gather_cells(one) for one in both]

    one, other = np.random.default_rng(0).random((2, len(tube.pattern.panel)))
    alone = products(sew(MPI.COMM_SELF, tube.pattern), one)
    for found, expected in zip(products(tube, one), alone, strict=True):
        assert found == pytest.approx(expected, rel=1e-12, abs=1e-14)
    assert alone[0] == pytest.approx(alone[1], rel=1e-12), "the distance is symmetric"
    assert alone[2] == pytest.approx(-alone[3], abs=1e-14), "the offset is antisymmetric"
    matrix = neighbour_matrices(tube, Neighbourhood(tube.pattern, RADIUS), weigh, 2)[1]
    a, b = one[tube.owned_cells], other[tube.owned_cells]
    there = dot(comm, matrix.forward(a), b)
    assert dot(comm, a, matrix.backward(b)) == pytest.approx(there, rel=1e-12)


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


def test_mean_edge(alone: MPI.Comm) -> None:
    """A right triangle of legs a has the area of an equilateral one of edge 1.075 a."""
    skin = sew(alone, square(n=10, size=0.02))
    edge = equilateral_edge(skin.pattern.areas.mean())
    assert edge == pytest.approx(2e-3 * np.sqrt(2 / np.sqrt(3)))
