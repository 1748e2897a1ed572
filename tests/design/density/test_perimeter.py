"""Perimeter: exact lengths, the paper's sum, gradients."""

from collections.abc import Callable

import numpy as np
import pytest
from helpers.scenes import square, table
from mpi4py import MPI

from toros_fem.design.density.perimeter import Perimeter, edge_factor
from toros_fem.design.loop.fields import random_density
from toros_fem.meshes import Skin, sew


def test_edge_factor_against_the_table() -> None:
    for row in table("perimeter_soft_erode"):
        kappa = float(row["kappa = sum_i A_i P_i/(L r_w)"])
        assert edge_factor(float(row["w"])) == pytest.approx(kappa, abs=2e-6)
        assert edge_factor(-float(row["w"])) == -edge_factor(float(row["w"]))


@pytest.mark.parametrize("sharpness", [0.5, 20.0, -20.0])
def test_perimeter_of_stripes_on_a_torus(sharpness: float) -> None:
    """Straight slanting stripes on a periodic tile: the length of their borders, for any w."""
    size, n = 0.02, 60
    skin = sew(MPI.COMM_SELF, square(n=n, size=size))
    u, v = skin.pattern.centroids[skin.owned_cells].T
    stripes = ((u + 2 * v) % size < 0.45 * size).astype(float)
    term = Perimeter(skin, 4.2 * size / n, sharpness, beyond=size * np.eye(2))
    assert term.forward(stripes) == pytest.approx(2 * np.sqrt(5) * size, rel=0.03)


def test_the_papers_sum_by_its_definition(short_tube: Skin) -> None:
    """Eqs. (15, 16) as printed, over the triangles of a panel without weights."""
    pattern, window, w = short_tube.pattern, 7e-3, 0.5
    values = np.random.default_rng(3).random(len(pattern.panel))
    found = Perimeter(short_tube, window, w, area_weighted=False).forward(
        values[short_tube.owned_cells]
    )
    distance = np.linalg.norm(pattern.centroids[:, None] - pattern.centroids[None], axis=2)
    near = (distance <= window) & (pattern.panel[:, None] == pattern.panel[None])
    mean = (near * np.exp(w * (1 - values))).sum(axis=1) / near.sum(axis=1)
    assert found == pytest.approx((values - (1 - np.log(mean) / w)).sum(), rel=1e-10)


def test_perimeter_of_uniform_print_is_zero(short_tube: Skin) -> None:
    make: Callable[[float], float] = lambda value: Perimeter(short_tube, 7e-3).forward(  # noqa: E731
        np.full(len(short_tube.owned_cells), value)
    )
    assert abs(make(1.0)) < 1e-12
    assert abs(make(0.0)) < 1e-12


def test_erosion_of_fabric_counts_islands_more_than_of_print() -> None:
    """A disc smaller than the window; its hole in the print is the other way round."""
    skin = sew(MPI.COMM_SELF, square(n=60, size=0.02))
    radius, window = 1.6e-3, 2.4e-3
    middle = skin.pattern.centroids[skin.owned_cells] - 0.01
    disc = (np.hypot(*middle.T) < radius).astype(float)
    of_print, of_fabric = (Perimeter(skin, window, w) for w in (40.0, -40.0))
    # All of the disc is removed, and a ring as wide as the window is added.
    border = 2 * np.pi * radius
    assert of_print.forward(disc) == pytest.approx(np.pi * radius**2 / window, rel=0.05)
    assert of_fabric.forward(disc) == pytest.approx(border + np.pi * window, rel=0.05)
    assert of_print.forward(disc) < border < of_fabric.forward(disc)
    assert of_print.forward(1 - disc) == pytest.approx(of_fabric.forward(disc), rel=1e-10)
    assert of_fabric.forward(1 - disc) == pytest.approx(of_print.forward(disc), rel=1e-10)


@pytest.mark.parametrize("sharpness", [0.5, 20.0, -20.0])
def test_no_pattern_shortens_the_border(
    sharpness: float, short_tube: Skin, alone: MPI.Comm
) -> None:
    """On any mesh and at the borders of panels the length is positive, and its slope 0 at none.

    With the paper's ρ̄ in place of its mean, print on some triangles has a negative length.
    """
    areas = short_tube.pattern.areas[short_tube.owned_cells]
    term = Perimeter(short_tube, 7e-3, sharpness)
    for uniform in (0.0, 0.4, 1.0):
        slope = term.backward(np.full(len(areas), uniform))
        assert np.abs(slope).max() < 1e-10 * areas.max() / abs(edge_factor(sharpness) * 7e-3)
    steepest = Perimeter(short_tube, 7e-3, sharpness, area_weighted=False).backward(
        np.zeros(len(areas))
    )
    rewarded = (steepest < 0).astype(float)
    assert alone.allreduce(float(rewarded @ steepest)) < 0
    assert term.forward(rewarded) > 0.1
    for seed in range(3):
        assert term.forward(random_density(short_tube, seed, spread=0.4)) > 0
