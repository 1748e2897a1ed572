"""Slack, set, preload, untared cells and breaks: found, told, and without them the constants."""

import numpy as np
import pytest
from helpers.scenes import DATA
from helpers.tensile_tests import C1, JERSEY, uniaxial_curve

from toros_fem import fit_material, read_tensile_tests
from toros_fem.base.errors import FileError
from toros_fem.materials.sheet import Material
from toros_fem.products.common.options import FitOptions
from toros_fem.products.fitting.fit import FitResult, library_entry
from toros_fem.products.fitting.reading import Given
from toros_fem.products.fitting.samples import TensileTest

NOISES = (0.0, 0.002, 0.01)


def law(strain: np.ndarray, sheet: Material = JERSEY) -> np.ndarray:
    """The stress of the jersey, 0 before it is stretched."""
    return uniaxial_curve(sheet, 1 + np.maximum(strain, 0.0))[0]


def fitted(
    strain: np.ndarray, stress: np.ndarray, noise: float = 0.0, seed: int = 1, **options: object
) -> FitResult:
    """The fit of a test, with noise as a part of the largest stress."""
    rng = np.random.default_rng(seed)
    stress = stress + noise * stress.max() * rng.standard_normal(len(stress))
    how = FitOptions(draws=40).updated(**options)
    return fit_material([TensileTest(1 + strain, stress, JERSEY.thickness)], how)


def holds(found: FitResult, within: float) -> None:
    """Check E h and its interval, and that c₁ is near."""
    young = found.estimates["young"]
    assert young.value == pytest.approx(JERSEY.young, rel=within)
    assert young.low * (1 - 1e-4) <= JERSEY.young <= young.high * (1 + 1e-4)
    assert found.c1 == pytest.approx(C1, rel=0.03)


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("nolat", {}), ("slack", {}), ("break", {}), ("bluehill2", {}), ("bluehill_plain", {}),
        ("wb", {}), ("strain_fraction_as_pct", {}), ("preload", {"offset": "preload"}),
    ],
)  # fmt: skip
def test_damaged_files(name: str, options: dict[str, str]) -> None:
    """All have E h = 50.3 N/m and c₁ = 1.90 of the whole one."""
    given = Given(thickness=0.5e-3, width=25e-3, gauge_length=0.1)
    tests = read_tensile_tests([DATA / "tensile" / f"{name}.csv"], given)
    found = fit_material(tests, FitOptions(draws=40).updated(**options))
    assert found.material.membrane_stiffness == pytest.approx(50.3, rel=0.01)
    assert found.c1 == pytest.approx(1.90, rel=0.01)
    doubted = name == "strain_fraction_as_pct"
    assert bool(found.doubted) == doubted
    assert library_entry(found, "a").trust == ("doubted" if doubted else "measured")
    assert bool(found.taken) == (name not in ("nolat", "wb", "strain_fraction_as_pct"))


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("slack", [0.03, 0.06, 0.15])
def test_slack_is_left_out(slack: float, noise: float) -> None:
    strain = np.linspace(0, 0.75 + slack, 200)
    found = fitted(strain, law(strain - slack), noise)
    holds(found, 0.01 + 8 * noise)
    assert "this is slack" in found.taken[0]
    kept = fitted(strain, law(strain - slack), noise, start="none")
    assert kept.material.young < 0.9 * JERSEY.young
    assert kept.doubted


def test_a_slack_strip_tells_the_zero_of_the_cell() -> None:
    strain = np.linspace(0, 0.81, 200)
    found = fitted(strain, law(strain - 0.06) + 4.0)
    holds(found, 0.01)
    assert "idle force, 4 N/m" in found.taken[0]


@pytest.mark.parametrize("points", [40, 200])
def test_the_set_of_a_later_cycle_lengthens_the_strip(points: int) -> None:
    up = np.linspace(0, 0.75 * 1.04 + 0.04, points)
    stress = law((1 + up) / 1.04 - 1)
    parts = [law(0.9 * up), 0.8 * stress[::-1], stress, 0.8 * stress[::-1], stress]
    cycles = np.concatenate([up, up[::-1], up, up[::-1], up])
    found = fitted(cycles, np.concatenate(parts))
    holds(found, 0.01)
    assert "set of the fabric" in found.taken[0]
    slack = fitted(cycles, np.concatenate(parts), start="slack")
    assert slack.material.young == pytest.approx(JERSEY.young / 1.04, rel=0.01)
    first = fitted(cycles, np.concatenate(parts), branch="first-loading")
    assert not first.taken


@pytest.mark.parametrize("noise", NOISES)
def test_a_force_at_rest_is_refused_until_it_is_told(noise: float) -> None:
    strain = np.linspace(0, 0.75, 200)
    with pytest.raises(FileError, match="--offset preload .* --offset untared"):
        fitted(strain, law(strain) + 4.0, noise)
    holds(fitted(strain, law(strain) + 4.0, noise, offset="untared"), 0.01 + 5 * noise)
    taut = np.linspace(0, 0.65, 200)
    loaded = law(1.08 * (1 + taut) - 1)
    with pytest.raises(FileError, match="--offset preload .* --offset untared"):
        fitted(taut, loaded, noise, seed=2)
    found = fitted(taut, loaded, noise, offset="preload")
    holds(found, 0.02 if noise == 0 else 0.3)
    assert "preloaded to a strain of" in found.taken[0]


def test_small_and_negative_offsets_are_doubted() -> None:
    strain = np.linspace(0, 0.75, 200)
    small = fitted(strain, law(strain) + 0.2)
    holds(small, 0.03)
    assert "small preload" in small.doubted[0]
    negative = fitted(strain, law(strain) - 4.0)
    holds(negative, 0.01)
    assert "not tared" in negative.doubted[0]
    assert library_entry(negative, "a").trust == "doubted"


@pytest.mark.parametrize("noise", NOISES)
def test_a_toe_is_doubted(noise: float) -> None:
    """The force rises by and by around a strain of 5 %."""
    strain = np.linspace(0, 0.8, 200)
    found = fitted(strain, law(0.02 * np.logaddexp(0, (strain - 0.05) / 0.02)), noise)
    assert found.doubted or "slack" in found.taken[-1]
    assert JERSEY.young in found.estimates["young"]


def test_a_record_that_begins_taut() -> None:
    strain = np.linspace(0.06, 0.81, 100)
    found = fitted(strain, law(strain - 0.06))
    holds(found, 0.01)
    assert "not recorded" in found.doubted[0]


@pytest.mark.parametrize("noise", NOISES)
def test_a_test_ends_at_its_break(noise: float) -> None:
    strain = np.linspace(0, 0.85, 200)
    found = fitted(strain, np.where(strain < 0.75, law(np.minimum(strain, 0.75)), 0.0), noise)
    holds(found, 0.01 + 5 * noise)
    assert "as at a break" in found.taken[0]
    assert found.measured_to < 1.76


def test_whole_tests_are_taken_as_they_are() -> None:
    """With noise some intervals are wider, but nothing is changed."""
    strain = np.linspace(0, 0.75, 100)
    for noise in NOISES:
        found = [fitted(strain, law(strain), noise, seed) for seed in range(5)]
        assert not any(one.taken or one.doubted for one in found)
        held = sum(JERSEY.young * (1 + 1e-4) >= one.estimates["young"].low for one in found)
        assert held >= 4


def test_bad_fits_and_unlike_specimens_are_doubted() -> None:
    strain: np.ndarray = np.linspace(0, 0.75, 100)
    wave = fitted(strain, law(strain) + 40 * np.sin(30 * strain), start="none")
    assert any("R² of the stress" in text for text in wave.doubted)
    tests = [
        TensileTest(1 + strain, np.asarray(k * law(strain)), JERSEY.thickness, specimen=str(k))
        for k in (1.0, 1.5)
    ]
    apart = fit_material(tests, FitOptions(draws=40))
    assert any("the specimens differ by 40%" in text for text in apart.doubted)
    entry = library_entry(apart, "a")
    assert entry.trust == "doubted"
    assert "specimens differ" in str(entry.note)
