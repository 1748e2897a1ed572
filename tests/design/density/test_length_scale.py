"""Constraints on widths: exact tables, gradients, and the lines that they detect."""

import numpy as np
import pytest
from helpers.scenes import square, table
from mpi4py import MPI

from toros_fem.base.validation import Floats
from toros_fem.design.density.filters import Filter, Linear, cone_filter, make_filter
from toros_fem.design.density.length_scale import (
    LengthScale,
    LengthScaleConstraints,
    filtered_bar,
    threshold_for_width,
    unfiltered_width,
    width_for_threshold,
)
from toros_fem.design.density.projection import Projection
from toros_fem.meshes import Skin, cylinder, sew
from toros_fem.meshes.triangles import equilateral_edge


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


def hat_bar(x: Floats, width: float) -> Filter:
    """A straight bar along y under the one-dimensional hat of R = 1: exact ρ̃ and ∇ρ̃."""

    def left_of(t: Floats) -> Floats:
        t = np.clip(t, -1, 1)
        return 0.5 + t - np.sign(t) * t**2 / 2

    def hat(t: Floats) -> Floats:
        return np.maximum(1 - np.abs(t), 0)

    def slope(density: Floats) -> Floats:
        across = hat(x + width / 2) - hat(x - width / 2)
        return np.array([across, np.zeros_like(across)])

    def value(density: Floats) -> Floats:
        return left_of(x + width / 2) - left_of(x - width / 2)

    def unused(given: Floats) -> Floats:
        raise NotImplementedError

    return Filter(value, unused, "cone", 1.0, Linear(slope, unused), unused)


@pytest.mark.parametrize(("width", "decay"), [(0.6, 4.0), (0.7, 30.0), (0.8, 1.0)])
def test_g_r_against_the_table_of_bars(width: float, decay: float) -> None:
    """The table's continuous value, a bar on a sheet 6 R wide, by a fine mesh's midpoint sum."""
    skin = sew(MPI.COMM_SELF, square(n=120, size=6.0))
    bar = hat_bar(skin.pattern.centroids[skin.owned_cells, 0] - 3.0, width)
    everywhere = np.ones(len(skin.owned_cells), dtype=bool)
    parameters = LengthScale(solid_threshold=0.7, void_threshold=0.3, decay=decay, epsilon=1e-5)
    limits = LengthScaleConstraints(skin, bar, parameters, everywhere)
    zeros = np.zeros(len(skin.owned_cells))
    filtered = bar.forward(zeros)
    projected = Projection(20.0).forward(filtered)
    found = limits.forward(zeros, filtered, projected)
    (row,) = [
        r
        for r in table("zhou_constraint_strip")
        if float(r["raw_bar_width/R"]) == width
        and float(r["c/R^2"]) == decay
        and float(r["h/R(cont=0)"]) == 0
    ]
    assert found[0] == pytest.approx(float(row["g_r centre-on-ridge"]), rel=2e-2)
    # A gap is the line of the opposite design.
    opposite = limits.forward(zeros, 1 - filtered, 1 - projected)
    assert opposite[1] == pytest.approx(found[0], rel=1e-12)


# The mesh blunts the Helmholtz kernel's cusp: lines must be somewhat wider than requested to pass.
@pytest.mark.parametrize(("name", "ratio", "wide"), [("cone", 1.5, 1.2), ("helmholtz", 4.0, 1.35)])
@pytest.mark.parametrize("degrees", [0.0, 17.0])
def test_thin_lines_and_gaps_are_caught_wide_ones_pass(
    name: str, ratio: float, wide: float, degrees: float
) -> None:
    """One straight line across a sheet, no finer resolved than docs/optimisation.md asks for."""
    radius = 2.4e-3
    edge = radius / ratio
    pattern = cylinder(MPI.COMM_SELF, 0.05, 0.016, edge, caps=None)
    skin = sew(MPI.COMM_SELF, pattern)
    flat = make_filter(name, skin, radius)
    limits = LengthScaleConstraints(
        skin, flat, LengthScale(), np.ones(len(skin.owned_cells), dtype=bool)
    )
    direction = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    centre = pattern.flat_points.mean(axis=0) + 0.3e-3
    across = np.abs((pattern.centroids - centre) @ direction)[skin.owned_cells]
    values = {}
    for fraction in (0.8, wide):  # of the requested width
        half = unfiltered_width(name, fraction) * radius / 2
        # The border triangles of a line are grey by the fraction that it covers.
        raw = np.clip(0.5 + (half - across) / edge, 0, 1)
        filtered = flat.forward(raw)
        projected = Projection(20.0).forward(filtered)
        values[fraction] = limits.forward(raw, filtered, projected)
        void = limits.forward(1 - raw, 1 - filtered, 1 - projected)
        assert void[1] == pytest.approx(values[fraction][0], rel=1e-9)
    assert values[0.8][0] > limits.epsilon[0] > 3 * values[wide][0]
    assert values[wide][1] < limits.epsilon[1]


def test_length_scale_parameters(short_tube: Skin) -> None:
    flat = cone_filter(short_tube, 8e-3)
    designed = np.ones(len(short_tube.owned_cells), dtype=bool)
    default = LengthScaleConstraints(short_tube, flat, LengthScale(), designed)
    assert default.solid_threshold == pytest.approx(0.7799, abs=1e-3)
    assert default.void_threshold == pytest.approx(1 - 0.7799, abs=1e-3)
    assert default.decay == pytest.approx(25 * 8e-3**2)
    half = LengthScaleConstraints(short_tube, flat, LengthScale(), designed, parts=2)
    np.testing.assert_allclose(half.epsilon, default.epsilon / 2)
    paper = LengthScaleConstraints(short_tube, flat, LengthScale.paper(short_tube), designed)
    assert (paper.solid_threshold, paper.void_threshold) == pytest.approx((0.7, 0.3))
    assert np.all(paper.epsilon == 1e-3)
    # Each ε belongs to its own width; another η of the projection shifts both thresholds.
    wide = LengthScaleConstraints(short_tube, flat, LengthScale(gap_width=4e-3), designed)
    assert wide.epsilon[0] == pytest.approx(default.epsilon[0])
    assert wide.epsilon[1] < 0.2 * default.epsilon[1]
    low = LengthScaleConstraints(short_tube, flat, LengthScale(), designed, Projection(20.0, 0.3))
    assert width_for_threshold("cone", low.solid_threshold, 0.3) == pytest.approx(1)
    assert width_for_threshold("cone", 1 - low.void_threshold, 0.7) == pytest.approx(1)
    assert paper.decay == pytest.approx(
        100 * equilateral_edge(short_tube.pattern.areas.mean()) ** 2
    )


def test_summary_says_whether_both_hold(short_tube: Skin) -> None:
    designed = np.ones(len(short_tube.owned_cells), dtype=bool)
    limits = LengthScaleConstraints(
        short_tube, cone_filter(short_tube, 8e-3), LengthScale.paper(short_tube), designed
    )
    found = limits.summary(np.array([1e-3, 2e-4]))
    assert found == {
        "g_r": 1e-3, "g_t": 2e-4, "epsilon_r": 1e-3, "epsilon_t": 1e-3, "eta_r": 0.7,
        "eta_t": pytest.approx(0.3), "c_m2": limits.decay, "satisfied": True,
    }  # fmt: skip
    assert not limits.summary(np.array([1e-4, 1.1e-3]))["satisfied"]
