"""Cone filter: definition, exact response, slope, torus."""

import numpy as np
import pytest
from helpers.scenes import square, table
from helpers.warned import warned
from mpi4py import MPI

from toros_fem.design.density.filters import cone_filter
from toros_fem.meshes import Skin, cylinder, mirrored, sew


def test_filter_against_its_definition(short_tube: Skin) -> None:
    pattern, radius = short_tube.pattern, 8e-3
    cone = cone_filter(short_tube, radius)
    density = np.random.default_rng(0).random(len(pattern.panel))
    found = short_tube.gather_cells(cone.forward(density[short_tube.owned_cells]))
    distance = np.linalg.norm(pattern.centroids[:, None] - pattern.centroids[None], axis=2)
    weight = np.maximum(radius - distance, 0) * pattern.areas
    weight *= pattern.panel[:, None] == pattern.panel[None]
    assert found == pytest.approx(weight @ density / weight.sum(axis=1), rel=1e-12)


def test_filter_of_a_half_plane(alone: MPI.Comm) -> None:
    """Against the exact response of the cone to a straight edge."""
    skin = sew(alone, cylinder(alone, 0.05, 0.02, 1.2e-3))
    pattern, radius = skin.pattern, 9e-3
    cone = cone_filter(skin, radius)
    edge = 0.025
    step = (pattern.centroids[skin.owned_cells, 1] > edge).astype(float)
    filtered = skin.gather_cells(cone.forward(step))
    wall = np.flatnonzero(pattern.panel == pattern.panel_index("wall"))
    u, v = pattern.centroids[wall].T
    inner = (u > radius) & (u < u.max() - radius)
    rows = table("filter_halfplane")
    exact = np.interp(
        (v[inner] - edge) / radius,
        [float(r["d_over_R"]) for r in rows],
        [float(r["cone2D"]) for r in rows],
    )
    assert np.abs(filtered[wall[inner]] - exact).max() < 0.015  # 0.0132 seen
    assert np.abs(filtered[wall[inner]] - exact).mean() < 0.0012  # 0.0010 seen


def test_at_points_is_the_filtered_field(short_tube: Skin) -> None:
    """Exact at the vertices; the value of the nearest triangle where none is within the radius."""
    pattern = short_tube.pattern
    density = np.random.default_rng(0).random(len(pattern.panel))
    cone = cone_filter(short_tube, 8e-3)
    found = cone.at_points(density[short_tube.owned_cells])
    for point in (0, 11, len(found) - 1):
        panel = pattern.panel[np.any(pattern.flat_triangles == point, axis=1)][0]
        distance = np.linalg.norm(pattern.flat_points[point] - pattern.centroids, axis=1)
        weight = np.maximum(8e-3 - distance, 0) * pattern.areas * (pattern.panel == panel)
        assert found[point] == pytest.approx(weight @ density / weight.sum(), rel=1e-12)
    with warned(short_tube.comm, match="hardly filters"):
        narrow = cone_filter(short_tube, 1e-4)
    assert narrow.forward(density[short_tube.owned_cells]) == pytest.approx(
        density[short_tube.owned_cells]
    )
    lone = narrow.at_points((pattern.panel == pattern.panel_index("tip")).astype(float)[
        short_tube.owned_cells])  # fmt: skip
    tip = np.unique(pattern.flat_triangles[pattern.cells_of("tip")])
    assert np.all(lone[tip] == 1), "the nearest triangle is one of the same panel"
    assert lone.sum() == len(tip)


def test_cone_on_a_torus(alone: MPI.Comm) -> None:
    """A tile is filtered like the middle one of nine tiles."""
    size, n, radius = 0.02, 6, 8e-3
    tile = sew(alone, square(n=n, size=size))
    density = np.random.default_rng(0).random(2 * n * n)
    cone = cone_filter(tile, radius, beyond=size * np.eye(2))
    found = tile.gather_cells(cone.forward(density[tile.owned_cells]))
    pattern = tile.pattern
    every = [pattern.centroids + [i * size, j * size] for i in (-1, 0, 1) for j in (-1, 0, 1)]
    distance = np.linalg.norm(pattern.centroids[:, None] - np.concatenate(every)[None], axis=2)
    weight = np.maximum(radius - distance, 0) * np.tile(pattern.areas, 9)
    expected = weight @ np.tile(density, 9) / weight.sum(axis=1)
    assert found == pytest.approx(expected, rel=1e-12)
    slanted = cone_filter(tile, 6e-3, beyond=size * np.array([[1.0, 0.0], [1.0, 1.0]]))
    straight = cone_filter(tile, 6e-3, beyond=size * np.eye(2))
    mine = density[tile.owned_cells]
    assert slanted.forward(mine) == pytest.approx(straight.forward(mine), rel=1e-12)


def test_a_filter_of_most_of_a_part_and_its_image(alone: MPI.Comm) -> None:
    """A triangle and its image are one column, although both are near."""
    half = cylinder(alone, 0.05, 0.02, 5e-3, planes=(1,))
    skin = sew(alone, half)
    wide = cone_filter(skin, 0.04, beyond=mirrored(half, (1,)))
    assert wide.forward(np.ones(len(skin.owned_cells))) == pytest.approx(1.0, rel=1e-12)
