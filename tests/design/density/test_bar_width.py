"""Bars under both filters against tables."""

import numpy as np
import pytest
from helpers.scenes import table
from mpi4py import MPI

from toros_fem.base.mpi import dot
from toros_fem.design.density.bar_width import filtered_bar, offset_thresholds, threshold_for_width
from toros_fem.design.density.cone import cone_filter
from toros_fem.design.density.projection import Projection
from toros_fem.meshes import rectangle, sew


@pytest.mark.parametrize("name", ["cone", "helmholtz"])
def test_bars_against_the_tables(name: str) -> None:
    column = {"cone": "peak_cone2D", "helmholtz": "peak_helmholtz"}[name]
    for row in table("filter_strip_peak"):
        peak = filtered_bar(name, float(row["b_over_R"]), 0.0)
        assert peak == pytest.approx(float(row[column]), abs=2e-6)
    if name == "cone":
        for row in table("filter_min_bar")[1:]:
            width = float(row["projected width at eta=.5 for that bar cone2D/R"])
            assert threshold_for_width(name, width) == pytest.approx(float(row["eta"]), abs=1e-5)


@pytest.mark.parametrize("name", ["cone", "helmholtz"])
def test_thresholds_of_moved_borders_against_the_table(name: str) -> None:
    """Half planes."""
    column = {"cone": "cone2D", "helmholtz": "helmholtz_r=R/(2sqrt3)"}[name]
    values = {float(row["d_over_R"]): float(row[column]) for row in table("filter_halfplane")}
    eroded, dilated = offset_thresholds(name, 0.125)
    assert eroded == pytest.approx(values[0.125], abs=2e-6)
    assert dilated == pytest.approx(values[-0.125], abs=2e-6)
    # From another nominal threshold both borders move as far.
    for level in offset_thresholds(name, 0.03):
        ends = offset_thresholds(name, 0.03, level)
        assert min(abs(end - 0.5) for end in ends) < 1e-9


def test_areas_change_by_the_way_of_the_border(alone: MPI.Comm) -> None:
    """A printed disc: its border runs across the triangles in all directions."""
    size, disc, radius = 0.06, 0.02, 4.8e-3
    skin = sew(alone, rectangle(alone, size, size, 1.2e-3, mesh="unstructured"))
    pattern = skin.pattern
    away = np.linalg.norm(pattern.centroids[skin.owned_cells] - size / 2, axis=1)
    filtered = cone_filter(skin, radius).forward(np.where(away < disc, 1.0, 0.0))
    own = pattern.areas[skin.owned_cells]
    for offset in (0.05, 0.15):
        levels = (*offset_thresholds("cone", offset), 0.5)
        steps = [Projection(20.0, eta) for eta in levels]
        eroded, dilated, nominal = (dot(alone, own, step.forward(filtered)) for step in steps)
        change = 2 * np.pi * disc * offset * radius
        assert nominal - eroded == pytest.approx(change, rel=0.04)  # 0.013 seen
        assert dilated - nominal == pytest.approx(change, rel=0.04)  # 0.035 seen
