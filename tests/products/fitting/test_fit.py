"""Constants of synthetic tests are found again, with intervals that hold them."""

import numpy as np
import pytest
from helpers.tensile_tests import C1, C2, JERSEY, TRUE, synthetic

from toros_fem import fit_material
from toros_fem.materials.sheet import Threads
from toros_fem.products.common.options import FitOptions
from toros_fem.products.fitting.fit import library_entry
from toros_fem.products.fitting.samples import TensileTest
from toros_fem.products.fitting.uniaxial import Coefficients, lame, lateral_strain, pulling_stress

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


def knitted_test(direction: str, seed: int, noise: float = 0.01) -> TensileTest:
    """A strip of a sheet of 40 N/m with threads that stiffen, in one direction."""
    course, wale = (90.0, 0.4**-2), (12.0, 0.6**-2)
    own, other = (course, wale) if direction == "course" else (wale, course)
    mu, lam = lame(40.0, 0.3)
    c = Coefficients(mu, lam, 0.0, 1.6**-2, own[0], other[0], own[1], other[1])
    most = 1.6 if direction == "course" else 1.9
    stretch = np.linspace(1.01, most, 40, dtype=np.float64)
    w = lateral_strain(stretch - 1, c)
    stress, rng = pulling_stress(stretch - 1, w, c), np.random.default_rng(seed)
    stress = stress + noise * stress.max() * rng.standard_normal(len(stretch))
    across = 1 + w + noise / 2 * rng.standard_normal(len(stretch))
    return TensileTest(stretch, stress, 5e-4, across, f"{direction}{seed}", direction)


KNIT = {
    "course_stiffness": 90.0, "course_strain": 0.4, "wale_stiffness": 12.0, "wale_strain": 0.6,
    "poisson": 0.3, "young": 40.0 / 5e-4, "c2": 2.6,
}  # fmt: skip


def test_both_directions_of_a_knit() -> None:
    """Its seven constants come back; of one direction alone there are none."""
    exact = [knitted_test(direction, 0, noise=0.0) for direction in ("course", "wale")]
    found = fit_material(exact, FEW)
    assert found.stiff == "course"
    for name, value in KNIT.items():  # c₁ of the sheet is far, not infinite
        assert found.estimates[name].value == pytest.approx(value, rel=0.02), name

    tests = [knitted_test(direction, k, 0.003) for direction in ("course", "wale") for k in (2, 3)]
    result = fit_material(tests, FEW)
    for name, value in KNIT.items():
        assert value in result.estimates[name], name
    assert result.r2_stress > 0.999
    assert result.knit is not None
    assert result.knit.course == Threads(
        result.estimates["course_stiffness"].value, result.estimates["course_strain"].value
    )
    assert any("Shear was not measured" in text for text in result.remarks)
    entry = library_entry(result, "mine")
    assert entry.wale_strain == result.estimates["wale_strain"].value
    assert entry.knit_ratio is None
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
