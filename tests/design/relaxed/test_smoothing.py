"""Smoothing of fields over triangles: means, bounds, seams."""

import numpy as np
import pytest
from helpers.line_fields import two_sheets
from mpi4py import MPI

from toros_fem.design.relaxed.problem import FixedDirections, FreeDirections, smoothing
from toros_fem.meshes import sew


def test_turns_of_charts() -> None:
    pattern = two_sheets(0.7)
    seam = pattern.panel[pattern.edges.sides[pattern.edges.inner]]
    across = seam[:, 0] != seam[:, 1]
    assert across.sum() == 6
    assert not pattern.chart_turns[~across].any()
    sign = np.where(seam[across, 0] == 0, 1, -1)
    assert pattern.chart_turns[across] == pytest.approx(0.7 * sign)


class Unturned(FixedDirections):
    """Fields that know nothing of charts."""

    def transport(self, turn: float) -> np.ndarray:
        return np.eye(self.directions)


def test_constants_means_and_bounds(alone: MPI.Comm) -> None:
    skin = sew(alone, two_sheets(0.7))
    smooth, own = smoothing(skin, 0.02, Unturned(3)), skin.owned_cells
    assert smooth.forward(np.full(3 * len(own), 0.3)) == pytest.approx(0.3, abs=1e-13)
    noise = np.random.default_rng(1).uniform(0, 1, (len(skin.pattern.panel), 3))
    found = skin.gather_cells(smooth.forward(noise[own].ravel()).reshape(-1, 3))
    areas = skin.pattern.areas
    assert areas @ found == pytest.approx(areas @ noise)
    assert noise.min() < found.min()
    assert found.max() < noise.max()
    assert found.std() < 0.3 * noise.std()


def test_lines_go_straight_on_across_a_turned_seam(alone: MPI.Comm) -> None:
    turn = 0.7
    skin = sew(alone, two_sheets(turn))
    families = FreeDirections()
    angles = np.array([0.2, 1.5]) + turn * skin.pattern.panel[:, None]
    x = families.variables(np.full_like(angles, 0.1), angles)[skin.owned_cells]
    found = smoothing(skin, 0.02, families).forward(x.ravel()).reshape(-1, 6)
    assert found == pytest.approx(x, abs=1e-12)
    # Without the turn of the chart the directions would mix.
    mixed = smoothing(skin, 0.02, Unturned(6)).forward(x.ravel()).reshape(-1, 6)
    assert np.abs(skin.gather_cells(mixed - x)).max() > 0.1


def test_shares_stay_within_their_bounds_across_a_turned_seam(alone: MPI.Comm) -> None:
    """A turn between two of the fixed directions shares a family out: no share gets below 0."""
    skin, families = sew(alone, two_sheets(0.4)), FixedDirections(6)
    smooth = smoothing(skin, 0.02, families)
    own, areas = skin.owned_cells, skin.pattern.areas
    for direction in range(6):
        x = np.zeros((len(areas), 6))
        x[:, direction] = 1.0
        found = skin.gather_cells(smooth.forward(x[own].ravel()).reshape(-1, 6))
        assert found.min() > -1e-13
        assert found.max() < 1 + 1e-13
        assert areas @ found.sum(axis=1) == pytest.approx(areas.sum())
    even = np.full(6 * len(own), 0.3)
    assert smooth.forward(even) == pytest.approx(0.3, abs=1e-13)


def test_triangles_without_fields(alone: MPI.Comm) -> None:
    skin = sew(alone, two_sheets(0.0))
    designed = skin.pattern.panel == 0
    smooth = smoothing(skin, 0.02, FixedDirections(2), designed)
    x = np.repeat(designed[skin.owned_cells].astype(float), 2)
    assert smooth.forward(x) == pytest.approx(x, abs=1e-13)
