"""Skins that are not made as drawn."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.worn import Printed
from mpi4py import MPI

import toros_fem as tf
from toros_fem.base.errors import ParameterError
from toros_fem.products.tolerance.of_run import by_size, write_tolerances
from toros_fem.products.tolerance.result import Tolerances

KEYS = ("objective", "angle_deg", "length_ratio")
QUANTITIES = (
    "print width",
    "fabric modulus",
    "fabric thickness",
    "print modulus",
    "print thickness",
    "pressure",
)


def test_all_variants_are_there(found: Tolerances) -> None:
    changes = [(v.quantity, v.label) for v in found.variants]
    assert changes[:4] == [
        ("print width", f"{change} mm") for change in ("−0.2", "−0.1", "+0.1", "+0.2")
    ]
    assert tuple(dict.fromkeys(q for q, _ in changes)) == QUANTITIES
    assert len(changes) == 14
    assert all(v.values for v in found.variants)


def test_shapes_follow_the_ratio_of_moduli_and_pressure(found: Tolerances) -> None:
    """Both moduli and the pressure by one factor change no shape: their derivatives cancel."""
    for key in KEYS:
        slopes = []
        for quantity in ("fabric modulus", "print modulus", "pressure"):
            less, more = (v for v in found.variants if v.quantity == quantity)
            slopes.append((more.values[key] - less.values[key]) / (more.change - less.change))
        assert sum(slopes) == pytest.approx(0.0, abs=1e-3 * max(map(abs, slopes))), key


def test_the_mesh_of_the_design(printed: Printed, found: Tolerances) -> None:
    problem, made = printed
    assert found.own_mesh == problem.metrics_of(made.evaluation.equilibrium)


def test_signs_are_those_of_mechanics(found: Tolerances) -> None:
    """Softer fabric bends more, as does a larger pressure; print area follows the polygons."""
    for quantity, sign in (("fabric modulus", -1), ("fabric thickness", -1), ("pressure", 1)):
        (more,) = (v for v in found.variants if v.quantity == quantity and v.change > 0)
        change = found.change(more, "angle_deg")
        assert sign * change > 0
    for variant in found.variants[:4]:
        polygons, mesh = variant.areas
        assert mesh == pytest.approx(polygons, rel=0.02)
        assert np.sign(mesh) == np.sign(variant.change)


def test_the_worst_is_named(found: Tolerances) -> None:
    worst = found.worst("angle_deg")
    sizes = [abs(found.change(v, "angle_deg") or 0) for v in found.variants]
    assert abs(found.change(worst, "angle_deg") or 0) == max(sizes)
    sentence = found.worst_sentences[0]
    assert worst.quantity.split()[0] in sentence.lower()
    assert "the angle" in sentence
    assert f"{found.nominal['angle_deg']:.4g}° becomes" in sentence


def test_files(alone: MPI.Comm, found: Tolerances, tmp_path: Path) -> None:
    write_tolerances(alone, tmp_path, found)
    content = json.loads((tmp_path / "tolerance.json").read_text(encoding="utf-8"))
    assert content["variants"][0]["change"] == "−0.2 mm"
    assert content["variants"][0]["change_m"] == pytest.approx(-2e-4)
    assert content["worst"]["angle_deg"]["sentence"] == found.worst_sentences[0]
    assert (tmp_path / "tolerance.csv").read_text(encoding="utf-8").count("\n") == 15
    assert (tmp_path / "tolerance.png").stat().st_size > 10_000


def test_a_variant_without_equilibrium_is_drawn_as_the_largest(found: Tolerances) -> None:
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
