"""Yeoh's law fitted to tension of a rubber."""

import numpy as np
import pytest

from toros_fem import fit_material
from toros_fem.cli.commands.materials import material_details
from toros_fem.cli.scene_files import numbers_of
from toros_fem.materials.sheet import Bladder
from toros_fem.products.common.options import FitOptions
from toros_fem.products.fitting.fit import fit_table, library_entry
from toros_fem.products.fitting.samples import TensileTest
from toros_fem.products.fitting.uniaxial import rubber_stress
from toros_fem.products.inflate import InflateScene

YOUNG, SECOND, THIRD, THICKNESS = 0.2e6, 6e3, 0.4e3, 0.5e-3
TRUE = {"young": YOUNG, "second": SECOND, "third": THIRD}
RUBBER = FitOptions(kind="rubber", draws=40)


def pulled(
    seed: int | None = None, *, noise: float = 0.01, top: float = 3.0, young: float = YOUNG,
    second: float = SECOND, third: float = THIRD,
) -> TensileTest:  # fmt: skip
    """A strip of a rubber, with noise as a part of the largest stress."""
    stretch = np.linspace(1.02, top, 60, dtype=np.float64)
    invariant = stretch**2 + 2 / stretch - 3
    slope = young / 6 + 2 * second * invariant + 3 * third * invariant**2
    stress = THICKNESS * 2 * (stretch - stretch**-2) * slope
    if seed is not None:
        stress = stress + noise * stress.max() * np.random.default_rng(seed).standard_normal(60)
    return TensileTest(stretch, stress, THICKNESS)


def test_exact_data_give_the_exact_constants() -> None:
    found = fit_material([pulled()], RUBBER)
    for name, value in TRUE.items():
        assert found.estimates[name].value == pytest.approx(value, rel=1e-5)
    assert found.r2_stress == pytest.approx(1.0, abs=1e-10)
    assert found.lateral == pytest.approx((1 + found.samples.strain) ** -0.5)


def test_the_stress_is_the_derivative_of_the_energy() -> None:
    """That of ψ = E/6 J + C₂₀ J² + C₃₀ J³ along an incompressible strip, by differences."""
    strain, h = np.array([0.1, 0.7, 2.0]), 1e-6
    parts = rubber_stress(strain, 2.0)

    def invariant(stretch: np.ndarray) -> np.ndarray:
        return np.asarray(stretch**2 + 2 / stretch - 3)

    for k, part in enumerate(parts):
        size = invariant(np.array(3.0)) ** k
        high, low = (invariant(1 + strain + step) ** (k + 1) / (6 * size) for step in (h, -h))
        assert part == pytest.approx((high - low) / (2 * h), rel=1e-6)


def test_what_a_neo_hookean_rubber_does_not_tell() -> None:
    found = fit_material([pulled(1, second=0.0, third=0.0, top=1.5)], RUBBER)
    assert not found.estimates["second"].identified
    assert not found.estimates["third"].identified
    assert "has 0 in it" in fit_table(found)
    assert YOUNG in found.estimates["young"]


def test_entry_is_a_bladder() -> None:
    found = fit_material([pulled()], RUBBER)
    entry = library_entry(found, "mine")
    bladder = Bladder(YOUNG, THICKNESS, SECOND, THIRD)
    assert (entry.kind, entry.poisson, entry.c1) == ("rubber", 0.5, None)
    for name in ("young", "thickness", "second", "third"):
        assert getattr(entry.bladder, name) == pytest.approx(getattr(bladder, name), rel=1e-4)
    values, _ = numbers_of(InflateScene(), [{"bladder": entry}])
    assert values["bladder_second"] == entry.second
    assert values["bladder_third"] == entry.third
    assert "\nC₂₀         " in material_details(entry)


def test_a_preload_is_found_by_the_law_of_the_rubber() -> None:
    """A force at rest is that of a strain, which Yeoh's law tells; eq. (1) would miss the curve."""
    whole = pulled(3, noise=0.001)
    late = whole.taken(np.flatnonzero(whole.stretch > 1.2))
    test = TensileTest(np.asarray(late.stretch / 1.2), late.stress, THICKNESS)
    found = fit_material([test], RUBBER.updated(offset="preload"))
    assert "preloaded to a strain of" in " ".join(found.remarks)
    told = next(text for text in found.remarks if "preloaded" in text)
    assert float(told.split("strain of ")[1].split(" %")[0]) == pytest.approx(20.0, abs=2.5)


def test_a_curve_that_eq_1_would_misread() -> None:
    """At a stretch of 5 eq. (1) takes the soft middle of the curve for slack."""
    found = fit_material([pulled(1, noise=0.003, top=5.0)], RUBBER)
    assert not any("slack" in text or "toe" in text for text in found.remarks)
    for name, value in TRUE.items():
        assert value in found.estimates[name]


@pytest.mark.slow
def test_intervals_hold_the_true_values() -> None:
    """In 90 of 100 trials at least, for each constant, with noise of 1 %."""
    hits = dict.fromkeys(TRUE, 0)
    for seed in range(100):
        found = fit_material([pulled(seed)], RUBBER).estimates
        for name, value in TRUE.items():
            hits[name] += value in found[name]
    assert min(hits.values()) >= 90, hits
