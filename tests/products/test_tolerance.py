"""Tolerances of one print."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from helpers.pages import assert_apart
from helpers.prints import MM, metres
from helpers.scenes import square
from helpers.worn import Printed, printed_tube
from matplotlib.figure import Figure
from mpi4py import MPI

import toros_fem as tf
from toros_fem.base.errors import ParameterError
from toros_fem.meshes import Pattern
from toros_fem.products.common.options import ToleranceConfig
from toros_fem.products.tolerance import ToleranceResult, broken_lines, offset_print
from toros_fem.products.tolerance_of_run import by_size, plot_tolerances, write_tolerances

KEYS = ("objective", "angle_deg", "length_ratio")
QUANTITIES = (
    "print width",
    "fabric modulus",
    "fabric thickness",
    "print modulus",
    "print thickness",
    "pressure",
)
RESOLUTION = 0.03 * MM


@pytest.fixture(scope="session")
def printed(alone: MPI.Comm) -> Printed:
    return printed_tube(alone)


@pytest.fixture(scope="session")
def found(printed: Printed) -> ToleranceResult:
    small = ToleranceConfig(modulus=0.01, thickness=0.01, pressure_change=0.005)
    return tf.tolerances(*printed, small)


def test_all_variants_are_there(found: ToleranceResult) -> None:
    changes = [(v.quantity, v.label) for v in found.variants]
    assert changes[:4] == [
        ("print width", f"{change} mm") for change in ("−0.2", "−0.1", "+0.1", "+0.2")
    ]
    assert tuple(dict.fromkeys(q for q, _ in changes)) == QUANTITIES
    assert len(changes) == 14
    assert all(v.values for v in found.variants)


def test_shapes_follow_the_ratio_of_moduli_and_pressure(found: ToleranceResult) -> None:
    """Both moduli and the pressure by one factor change no shape: their derivatives cancel."""
    for key in KEYS:
        slopes = []
        for quantity in ("fabric modulus", "print modulus", "pressure"):
            less, more = (v for v in found.variants if v.quantity == quantity)
            slopes.append((more.values[key] - less.values[key]) / (more.change - less.change))
        assert sum(slopes) == pytest.approx(0.0, abs=1e-3 * max(map(abs, slopes))), key


def test_the_mesh_of_the_design(printed: Printed, found: ToleranceResult) -> None:
    problem, made = printed
    assert found.own_mesh == problem.metrics_of(made.evaluation.equilibrium)


def test_signs_are_those_of_mechanics(found: ToleranceResult) -> None:
    """Softer fabric bends more, as does a larger pressure; print area follows the polygons."""
    for quantity, sign in (("fabric modulus", -1), ("fabric thickness", -1), ("pressure", 1)):
        (more,) = (v for v in found.variants if v.quantity == quantity and v.change > 0)
        change = found.change(more, "angle_deg")
        assert sign * change > 0
    for variant in found.variants[:4]:
        polygons, mesh = variant.areas
        assert mesh == pytest.approx(polygons, rel=0.02)
        assert np.sign(mesh) == np.sign(variant.change)


def test_the_worst_is_named(found: ToleranceResult) -> None:
    worst = found.worst("angle_deg")
    sizes = [abs(found.change(v, "angle_deg") or 0) for v in found.variants]
    assert abs(found.change(worst, "angle_deg") or 0) == max(sizes)
    sentence = found.worst_sentences[0]
    assert worst.quantity.split()[0] in sentence.lower()
    assert "the angle" in sentence
    assert f"{found.nominal['angle_deg']:.4g}° becomes" in sentence


def test_files(alone: MPI.Comm, found: ToleranceResult, tmp_path: Path) -> None:
    write_tolerances(alone, tmp_path, found)
    content = json.loads((tmp_path / "tolerance.json").read_text(encoding="utf-8"))
    assert content["variants"][0]["change"] == "−0.2 mm"
    assert content["variants"][0]["change_m"] == pytest.approx(-2e-4)
    assert content["worst"]["angle_deg"]["sentence"] == found.worst_sentences[0]
    assert (tmp_path / "tolerance.csv").read_text(encoding="utf-8").count("\n") == 15
    assert (tmp_path / "tolerance.png").stat().st_size > 10_000


def test_a_variant_without_equilibrium_is_drawn_as_the_largest(found: ToleranceResult) -> None:
    """Not as one that changes nothing; the largest is on top, the last of them."""
    weak = replace(found.variants[0], values={})
    pairs = by_size(replace(found, variants=(weak, *found.variants[1:])))
    assert weak in pairs[-1]
    assert sum(map(len, pairs)) == len(found.variants)
    sizes = [[abs(found.change(v, "angle_deg") or 0) for v in pair] for pair in pairs[:-1]]
    assert list(map(max, sizes)) == sorted(map(max, sizes))


def test_wrong_types_are_refused(printed: Printed) -> None:
    problem, _ = printed
    with pytest.raises(ParameterError, match="by as_printed"):
        tf.tolerances(problem, "print")  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match="a ToleranceConfig"):
        tf.tolerances(*printed, 0.2)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def pattern() -> Pattern:
    return square()  # 20 mm wide


def test_a_border_on_the_cut_stays(pattern: Pattern) -> None:
    """A line of 2 mm across the panel gets wider by twice the way of its borders."""
    line = metres(shapely.box(9, 0, 11, 20))
    for offset in (-0.1, 0.1):
        (made,) = offset_print(pattern, [line], offset * MM, RESOLUTION)
        wanted = metres(shapely.box(9 - offset, 0, 11 + offset, 20))
        assert made.symmetric_difference(wanted).area < 1e-4 * MM**2


def test_a_panel_that_is_printed_all_over_stays(pattern: Pattern) -> None:
    (made,) = offset_print(pattern, [metres(shapely.box(0, 0, 20, 20))], -0.1 * MM, RESOLUTION)
    assert made.area == pytest.approx(pattern.areas.sum(), rel=1e-9)


def test_what_breaks_is_told(pattern: Pattern) -> None:
    """A thin line vanishes, one with a neck parts; two close ones merge, a small hole closes."""
    thin = shapely.box(1, 1, 19, 1.15)
    neck = shapely.union_all(
        [shapely.box(1, 4, 9, 6), shapely.box(9, 4.9, 11, 5.05), shapely.box(11, 4, 19, 6)]
    )
    close = [shapely.box(1, 9, 19, 11), shapely.box(1, 11.15, 19, 13)]
    ring = shapely.Point(10, 17).buffer(2).difference(shapely.Point(10, 17).buffer(0.08))
    drawn = [metres(shapely.union_all([thin, neck, *close, ring]))]

    def told(offset: float) -> list[str]:
        made = offset_print(pattern, drawn, offset * MM, RESOLUTION)
        return broken_lines(pattern, drawn, made, RESOLUTION)

    assert told(-0.1) == ["1 line vanishes.", "1 line parts."]
    assert told(0.1) == ["1 gap closes.", "1 line touches another."]
    assert told(0.01) == told(-0.01) == []


def test_a_ring_that_opens_is_a_line_that_parts(pattern: Pattern) -> None:
    outer, inner = shapely.box(4, 4, 16, 16), shapely.box(6, 6, 14, 15.85)
    drawn = [metres(outer.difference(inner))]
    made = offset_print(pattern, drawn, -0.1 * MM, RESOLUTION)
    assert broken_lines(pattern, drawn, made, RESOLUTION) == ["1 line parts."]
    assert np.isclose(made[0].area, drawn[0].area, rtol=0.2)


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_words_of_the_picture_are_apart(
    found: ToleranceResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, count: int
) -> None:
    """Also numbers of charts beside each other, at each height of the values."""
    (angle, *_), pages = found.metrics, list[Figure]()
    monkeypatch.setattr(Figure, "savefig", lambda self, place, **how: pages.append(self))
    for size in (1.0, 0.004, 400.0):
        metrics = tuple(replace(angle, name=f"angle_{k}", target=None) for k in range(count))

        def of(values: Mapping[str, float], size: float = size) -> dict[str, float]:
            return {f"angle_{k}_deg": (k + 1) * size * values["angle_deg"] for k in range(count)}

        variants = tuple(replace(v, values=of(v.values)) for v in found.variants)
        nominal = of(found.nominal)
        plot_tolerances(
            tmp_path / "tolerance.png",
            replace(found, metrics=metrics, nominal=nominal, variants=variants),
        )
    for page in pages:
        assert_apart(page)
