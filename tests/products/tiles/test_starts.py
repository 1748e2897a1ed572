"""Starts of a tile's design: random waves, and families of lines."""

import numpy as np
import pytest
from helpers.tiles import EDGES, SIDE, tile_of
from scipy.spatial import cKDTree

from toros_fem.meshes import SYMMETRIES
from toros_fem.products.tiles.search import (
    LineFamily,
    random_families,
    random_lines,
    random_waves,
)


def test_random_waves() -> None:
    """Waves are periodic, within bounds, and differ by seed."""
    tile = tile_of(EDGES)
    one, other = random_waves(tile, 1), random_waves(tile, 2)
    for density in (one, other):
        assert density.min() >= 0.1
        assert density.max() <= 0.9
        assert np.ptp(density) > 0.4
    assert np.abs(one - other).max() > 0.1
    x, y = 2 * np.pi * tile.pattern.centroids.T / SIDE
    # Waves of at most three periods along each side span 49 functions.
    waves = [f(i * x) * g(j * y) for i in range(4) for j in range(4)
             for f in (np.cos, np.sin) for g in (np.cos, np.sin)]  # fmt: skip
    inside = (one > 0.1) & (one < 0.9)
    fit = np.transpose(waves)[inside]
    rest = one[inside] - fit @ np.linalg.lstsq(fit, one[inside], rcond=None)[0]
    assert np.abs(rest).max() < 1e-12


@pytest.mark.parametrize("normal", [(0, 1), (1, 0), (1, -1)])
def test_straight_lines(normal: tuple[int, int]) -> None:
    """The depth inside straight lines is exact, on an oblong tile too."""
    tile = tile_of(EDGES, shape=(1.0, 1.5))
    sides = np.diagonal(tile.lattice)
    depth = LineFamily(normal, 2e-3, offset=0.25).depth(tile)
    across = np.array(normal) / sides
    height = tile.pattern.centroids @ across + 0.25
    distance = np.abs(height - np.rint(height)) / np.linalg.norm(across)
    assert depth == pytest.approx(1e-3 - distance, abs=1e-15)


def test_wavy_lines() -> None:
    """A wavy line has its width across the wave, to a few per cent."""
    tile = tile_of(8 * EDGES)
    family = LineFamily((0, 1), 2e-3, offset=-0.5, amplitude=0.1, waves=2, shift=0.25)
    t = np.linspace(-0.2, 1.2, 20001)
    centres = SIDE * np.column_stack([t, 0.5 - 0.1 * np.sin(2 * np.pi * 2 * t)])
    away, _ = cKDTree(centres).query(tile.pattern.centroids)
    depth = family.depth(tile)
    near = away < 1.2e-3
    assert depth[near] == pytest.approx(1e-3 - away[near], abs=1.5e-4)
    assert (depth[~near] < 0).all()


@pytest.mark.parametrize("symmetry", sorted(SYMMETRIES))
def test_lines_fit_the_symmetry(symmetry: str) -> None:
    """Lines are symmetric, and do not cross their own images, but for a family turned across."""
    tile = tile_of(4 * EDGES, symmetry=symmetry)
    maps = tile.symmetry_maps(symmetry)
    rng, again = np.random.default_rng(3), np.random.default_rng(3)
    drawn = [random_lines(tile, rng, symmetry, SIDE / 14) for _ in range(12)]
    for density in drawn:
        assert (density[maps] == density).all()
        assert density.min() == 0.1
        assert density.max() > 0.8
    families = [family for _ in drawn for family in random_families(again, symmetry, SIDE / 14)]
    assert {family.amplitude > 0 for family in families} == {True, False}
    assert {np.abs(family.normal).sum() for family in families} == {1, 2}
    for one, other in zip(families[::2], families[1::2], strict=True):
        assert np.dot(one.normal, other.normal) == 0
    for family in families:
        inside = family.depth(tile) > 0
        for operation, image in zip(SYMMETRIES[symmetry], maps, strict=True):
            if abs(operation @ family.normal @ family.normal) > 0:
                moved = inside[image]
                assert (moved == inside).all() or not (moved & inside).any()
