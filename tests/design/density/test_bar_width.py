"""Bars under both filters against tables."""

import pytest
from helpers.scenes import table

from toros_fem.design.density.length_scale import filtered_bar, threshold_for_width


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
