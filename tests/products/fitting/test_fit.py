"""Constants of synthetic tests are found again, with intervals that hold them."""

import numpy as np
import pytest
from helpers.tensile_tests import C1, C2, JERSEY, TRUE, synthetic

from toros_fem import fit_material
from toros_fem.products.fitting.samples import TensileTest
from toros_fem.products.options import FitOptions

FEW = FitOptions(draws=40)


def test_exact_data_give_the_exact_constants() -> None:
    result = fit_material([synthetic()], FEW)
    for name, value in TRUE.items():
        assert result.estimates[name].value == pytest.approx(value, rel=1e-5)
    assert (result.r2_stress, result.r2_lateral) == pytest.approx((1.0, 1.0), abs=1e-10)
    assert result.trusted_to == result.measured_to == pytest.approx(1.8)


def test_intervals_are_as_narrow_as_the_noise() -> None:
    """A tenth of the noise gives intervals a tenth as wide: holding the truth is not enough."""
    wide, narrow = (
        fit_material([synthetic(1, noise=noise)], FEW).estimates for noise in (0.02, 0.002)
    )
    for name in ("young", "poisson", "c1"):
        widths = [one[name].high - one[name].low for one in (wide, narrow)]
        assert 7 < widths[0] / widths[1] < 14
    assert (wide["young"].high - wide["young"].low) / wide["young"].value < 0.1


def test_specimens_that_differ_widen_the_interval() -> None:
    """Of three specimens, 10 % apart, whole tests are drawn."""
    tests = []
    for k, factor in enumerate((0.9, 1.0, 1.1)):
        one = synthetic(k, specimen=str(k))
        tests.append(TensileTest(one.stretch, factor * one.stress, one.thickness, one.lateral))
    alike = [synthetic(k, specimen=str(k)) for k in range(3)]
    options = FitOptions(draws=60)
    apart, same = (fit_material(t, options).estimates["young"] for t in (tests, alike))
    assert apart.high - apart.low > 3 * (same.high - same.low)
    assert TRUE["young"] in apart


def test_outliers_count_little() -> None:
    one = synthetic(5)
    stress = one.stress.copy()
    stress[::8] *= 3
    bad = [TensileTest(one.stretch, stress, one.thickness, one.lateral)]
    robust = fit_material(bad, FEW).estimates["young"].value
    squares = fit_material(bad, FitOptions(draws=40, loss="squares"))
    assert abs(robust / JERSEY.young - 1) < 0.06
    assert abs(squares.estimates["young"].value / JERSEY.young - 1) > 0.2


def test_what_data_cannot_tell_is_told() -> None:
    """Without lateral stretch c₂ is not identified, nor is c₁ from small stretches."""
    result = fit_material([synthetic(2, lateral=False)], FEW)
    assert not result.estimates["c2"].identified
    assert result.estimates["c1"].identified
    assert any("No lateral stretch" in text for text in result.remarks)
    small = fit_material([synthetic(2, top=1.15)], FEW)
    assert not small.estimates["c1"].identified
    assert C1 in small.estimates["c1"]
    assert C2 in small.estimates["c2"]
    assert any(text.startswith("c1 is not identified") for text in small.remarks)
    assert small.c1 > 1.15


def test_both_directions_of_a_knit() -> None:
    tests = [
        synthetic(k, noise=0.01, knit_ratio=2.5, direction=direction, specimen=f"{direction}{k}")
        for direction in ("course", "wale")
        for k in range(2)
    ]
    result = fit_material(tests, FEW)
    assert result.stiff == "course"
    assert 2.5 in result.estimates["knit_ratio"]
    assert result.estimates["knit_ratio"].value == pytest.approx(2.5, rel=0.05)
    assert result.material.young == pytest.approx(JERSEY.young, rel=0.05)
    assert result.knit is not None
    single = fit_material(tests[:2], FEW)
    assert single.knit is None
    assert "knit_ratio" not in single.estimates


def test_a_stretch_that_the_model_misses_is_told() -> None:
    """Data that follow eq. (1) up to 1.5, where something gives way."""
    one = synthetic(0, noise=0.005)
    stress = np.where(one.stretch > 1.5, 0.85 * one.stress[one.stretch <= 1.5].max(), one.stress)
    tests = [TensileTest(one.stretch, stress, one.thickness)]
    result = fit_material(tests, FEW)
    assert result.trusted_to < 1.7
    assert any("mean residual exceeds 10 %" in text for text in result.remarks)
    cut = fit_material(tests, FitOptions(draws=40, up_to=1.5))
    assert cut.trusted_to == cut.measured_to <= 1.5
