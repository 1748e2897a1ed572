"""Constants of inflated skins are found again, and what readings do not tell is told."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from benchmarks.fits import helices
from toros_fem.base.errors import FileError, ParameterError
from toros_fem.products.fitting.inflation import (
    CONSTANTS,
    DIFFERENCE,
    InflationFit,
    MeasuredSkin,
    Readings,
    fit_inflation,
    read_inflation,
    write_inflation,
)
from toros_fem.products.inflate import METRICS, InflateScene
from toros_fem.products.tiles.tile import TileScene
from toros_fem.products.tubes import TwistScene

TRUE = {
    "fabric_young": 0.12e6, "along_over_around": 1.25, "c1": 1.8, "c2": 2.4, "poisson": 0.3,
}  # fmt: skip
SCENE = InflateScene.of(length=0.06, edge_length=4e-3)
PRESSURES = np.linspace(2e3, 20e3, 10, dtype=np.float64)


@cache
def tube() -> MeasuredSkin:
    return MeasuredSkin(MPI.COMM_SELF, SCENE)


@cache
def exact() -> dict[str, np.ndarray]:
    return tube().measured(PRESSURES, TRUE)


def noisy(seed: int, noise: float = 0.01, top: float = 20e3) -> Readings:
    """Readings of both sizes, with noise as a part of the largest."""
    rng, few = np.random.default_rng(seed), top >= PRESSURES
    values = {
        key: value[few] + noise * value[few].max() * rng.standard_normal(few.sum())
        for key, value in exact().items()
    }
    return Readings(PRESSURES[few], values)


def test_exact_readings_give_the_exact_constants() -> None:
    found = fit_inflation(tube(), Readings(PRESSURES, exact()))
    assert list(found.held) == ["poisson"], "it hides behind the moduli"
    for name, estimate in found.estimates.items():
        assert estimate.value == pytest.approx(TRUE[name], rel=1e-4)


def test_derivatives_are_those_of_the_simulation() -> None:
    """Of all constants, against differences of two simulations."""
    skin, few = tube(), PRESSURES[::4]
    keys = ["length_percent", "radius_percent"]
    path = skin.path(few, TRUE)

    def changed(name: str, by: float) -> dict[str, float]:
        begin = CONSTANTS[name].begin
        return {**TRUE, name: begin + (TRUE[name] - begin) * np.exp(by)}

    slopes, ways = skin.slopes(path, [changed(name, DIFFERENCE) for name in TRUE], keys)
    assert ways.shape[:2] == (len(few), len(TRUE))
    for name, slope in zip(TRUE, slopes, strict=True):
        high, low = (skin.measured(few, changed(name, by)) for by in (1e-3, -1e-3))
        for key, row in zip(keys, slope, strict=True):
            assert row == pytest.approx((high[key] - low[key]) / 2e-3, rel=2e-3, abs=2e-3)


def test_what_readings_do_not_tell_is_held_and_told() -> None:
    """Poisson's ratio hides behind the moduli; intervals know that it may be another."""
    found = fit_inflation(tube(), noisy(1))
    value, why = found.held["poisson"]
    assert value == pytest.approx(0.3)
    assert "its interval would reach" in why or "it is correlated with" in why
    assert any(text.startswith("poisson is not told, and held at 0.3") for text in found.remarks)
    assert list(found.estimates) == ["fabric_young", "along_over_around", "c1", "c2"]
    assert found.correlations.shape == (4, 4)
    assert np.diag(found.correlations) == pytest.approx(np.ones(4))
    for name, estimate in found.estimates.items():
        assert TRUE[name] in estimate
    assert all(value > 0.97 for value in found.quality().values())


def test_intervals_allow_for_what_is_held() -> None:
    """Of exact readings they are what 20 % more or less of Poisson's ratio makes of them."""
    readings = Readings(PRESSURES, exact())
    found = fit_inflation(tube(), readings).estimates
    other = MeasuredSkin(MPI.COMM_SELF, SCENE.updated(poisson=1.2 * TRUE["poisson"]))
    moved = fit_inflation(other, readings).estimates
    for name in ("fabric_young", "along_over_around"):
        half = found[name].value - found[name].low
        assert found[name].value - moved[name].value == pytest.approx(half, rel=0.2)


def test_less_noise_narrows_intervals_up_to_what_is_held() -> None:
    wide, narrow = (fit_inflation(tube(), noisy(2, noise)) for noise in (0.01, 0.005))
    for name in ("c1", "c2"):
        widths = [one.estimates[name].high - one.estimates[name].low for one in (wide, narrow)]
        assert 1.3 < widths[0] / widths[1] < 3.0
    assert "poisson" in narrow.held


def test_readings_that_tell_nothing_are_refused() -> None:
    rng = np.random.default_rng(0)
    values = {"radius_percent": 100 + 100 * rng.standard_normal(len(PRESSURES))}
    with pytest.raises(FileError, match="the readings tell no constant: of fabric_young"):
        fit_inflation(tube(), Readings(PRESSURES, values))


def test_moduli_along_and_around_are_those_of_a_knit() -> None:
    for ratio in (0.5, 1.0, 1.5):
        keys = tube().keys({"fabric_young": 0.1e6, "along_over_around": ratio})
        sheet = SCENE.updated(**keys).material.composite
        courses, wales = sheet.moduli
        along, around = (courses, wales) if keys.get("grain_angle") == 90.0 else (wales, courses)
        assert along / around == pytest.approx(ratio)
        assert sheet.fabric.young == pytest.approx(0.1e6 * min(ratio, 1.0))


@pytest.mark.slow
def test_print_of_a_twisted_tube(tmp_path: Path) -> None:
    """Its modulus, and that of the fabric, from exact readings of the twist and the length."""
    scene = TwistScene().coarse().updated(
        length=0.03, edge_length=3.4e-3, print_edge_length=3.4e-3, pressure=8e3, cross_sections=4
    )  # fmt: skip
    skin = MeasuredSkin(MPI.COMM_SELF, scene, helices(scene, tmp_path / "helices.geojson"))
    true = {"reinforcement_young": 80e6, "fabric_young": 0.11e6}
    pressures = np.linspace(2e3, 8e3, 5, dtype=np.float64)
    values = skin.measured(pressures, true)
    readings = Readings(pressures, {key: values[key] for key in ("twist_deg", "length_ratio")})
    found = fit_inflation(skin, readings)
    for name, value in true.items():
        assert found.estimates[name].value == pytest.approx(value, rel=1e-3)


TABLE = """\
# a tube of 60 mm, 20 mm wide
pressure [kPa];diameter [mm];length [%];time
0;20,0;100;0
4;30,0;150;1
2;26,0;;2
6;32,0;155;3
8;33,0;158;4
10;34,0;160;5
12;34,5;161;5
"""


def test_a_table_is_read_with_its_units(tmp_path: Path) -> None:
    path = tmp_path / "tube.csv"
    path.write_text(TABLE, encoding="utf-8")
    found = read_inflation(path, SCENE, METRICS)
    assert found.pressures == pytest.approx([2e3, 4e3, 6e3, 8e3, 10e3, 12e3])
    assert found.values["radius_percent"][:2] == pytest.approx([130.0, 150.0])
    assert np.isnan(found.values["length_percent"][0])
    assert found.values["length_percent"][1] == pytest.approx(150.0)
    path.write_text("pressure_pa,length_percent\n" + "1e3,110\n" * 5, encoding="utf-8")
    assert read_inflation(path, SCENE, METRICS).values["length_percent"] == pytest.approx([110] * 5)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "a column 'pressure \\[kPa\\]' is needed"),
        ("pressure [kPa],diameter [kPa]\n1,2\n", "line 1: diameter is in 'kPa'; write 'diameter"),
        ("pressure,diameter [mm]\n1,2\n", "line 1: pressure is in 'no unit'"),
        ("pressure [kPa],time\n1,2\n", "known are .*diameter, length"),
        ("pressure [kPa],diameter [mm],radius_percent\n1,2,3\n", "is needed, and once"),
        ("pressure [kPa],diameter [mm]\n1,20\n2,x\n", "line 3: radius_percent = 'x' is no finite"),
        ("pressure [kPa],diameter [mm]\n,20\n", "line 2: pressure = '' is no finite"),
        ("pressure [kPa],diameter [mm]\n1,20\n", "have \\[1\\] readings .* at least 5"),
    ],
)
def test_faults_name_their_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "tube.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(FileError, match=message):
        read_inflation(path, SCENE, METRICS)


def test_refusals() -> None:
    with pytest.raises(ParameterError, match="'tile' is no skin that is inflated"):
        MeasuredSkin(MPI.COMM_SELF, TileScene())
    with pytest.raises(ParameterError, match="'angle_deg' is no metric of this skin"):
        fit_inflation(tube(), Readings(PRESSURES, {"angle_deg": PRESSURES}))
    with pytest.raises(ParameterError, match="none below the one before"):
        Readings(PRESSURES[::-1], exact())


def test_files(tmp_path: Path) -> None:
    found: InflationFit = fit_inflation(tube(), noisy(3))
    write_inflation(MPI.COMM_SELF, tmp_path, found)
    lines = (tmp_path / "fit.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0].split(",")[:3] == ["pressure_pa", "radius_percent", "radius_percent_fitted"]
    assert len(lines) == 1 + len(PRESSURES)
    text = (tmp_path / "fit.txt").read_text(encoding="utf-8")
    assert "in scenes: fabric_young = " in text
    assert (tmp_path / "fit.png").stat().st_size > 5000
