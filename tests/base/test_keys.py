"""Keys of settings, and values with units."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import pytest

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import (
    Count,
    Flag,
    In,
    OneOf,
    Table,
    Text,
    key,
    read_quantity,
    write_quantity,
)


class Sample(Table):
    """Numbers of a sample; SI units."""

    width: Annotated[float, In("m", above=0, at_most=2)] = key(0.5, "width of the sample")
    turn: Annotated[float, In("deg", at_least=-90, below=90)] = key(0.0, "turn of the sample")
    count: Count = key(3, "number of samples")
    kind: Annotated[str, OneOf(("round", "square"))] = key("round", "shape of the sample")
    note: Text = key("", "free text")
    rigid: Flag = key(False, "whether the sample is rigid")
    load: Annotated[float, In("N", above=0)] | None = key(None, "load; none leaves it out")
    edge: Annotated[str, OneOf(("sharp", "blunt"))] | None = key("sharp", "shape of the edge")


def test_messages_name_value_unit_and_bounds() -> None:
    for changes, message in [
        ({"width": 0.0}, "width = 0.0 m must be a finite number, above 0 and at most 2."),
        (
            {"width": "wide"},
            "width = 'wide' does not start with a number; known are m, cm, mm, um, µm, in.",
        ),
        ({"count": 2.0}, "count = 2.0 must be a whole number, at least 1."),
        ({"rigid": 1}, "rigid = 1 must be true or false."),
        ({"load": "much"}, "load = 'much' does not start with a number; known are N, mN, cN, kN."),
    ]:
        for make in (Sample, Sample().updated):
            with pytest.raises(ParameterError) as caught:
                make(**changes)  # type: ignore[arg-type]
            assert str(caught.value) == message


def test_unknown_names_are_answered_by_the_nearest() -> None:
    with pytest.raises(ParameterError, match="unknown parameter 'widht'; did you mean 'width'?"):
        Sample().updated(widht=1.0)
    with pytest.raises(ParameterError, match="unknown parameter 'widht'; did you mean 'width'?"):
        Sample(widht=1.0)  # type: ignore[call-arg]
    with pytest.raises(ParameterError, match="unknown parameter 'zzz'; known are width, turn, "):
        Sample(zzz=1.0)  # type: ignore[call-arg]


def test_help() -> None:
    wanted = {
        "width": "width of the sample; in m; above 0 and at most 2",
        "kind": "shape of the sample; one of round, square",
        "note": "free text",
        "rigid": "whether the sample is rigid; true or false",
        "load": "load; none leaves it out; in N; above 0",
        "edge": "shape of the edge; one of sharp, blunt, or none",
    }
    assert {name: Sample.described()[name].help for name in wanted} == wanted


def test_all_wrong_values_are_told() -> None:
    with pytest.raises(ParameterError) as caught:
        Sample(width="5 kg", count=0, heihgt=1)  # type: ignore[arg-type, call-arg]
    assert str(caught.value).split("\n") == [
        "width = '5 kg' is a mass, but a length is needed; known are m, cm, mm, um, µm, in.",
        "count = 0 must be a whole number, at least 1.",
        "unknown parameter 'heihgt'; known are width, turn, count, kind, note, rigid, load, edge.",
    ]
    assert caught.value.key == "width"


def test_texts_have_units() -> None:
    assert Sample(width="30 cm", load="20 mN") == Sample(width=0.3, load=0.02)  # type: ignore[arg-type]


def test_a_class_with_another_type_is_refused() -> None:
    class Wrong(Table):
        sizes: dict[str, float] = key(None, "sizes")

    class Bare(Table):
        size: float = 1.0

    for kind in (Wrong, Bare):
        with pytest.raises(TypeError, match=r"size.* must be a number, Flag, str or Path"):
            kind.described()


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("5 kPa", "Pa", 5e3),
        ("0.6 mm", "m", 0.6e-3),
        ("2.15mm", "m", 2.15e-3),
        ("1.4e0 mm", "m", 1.4e-3),
        ("1 in", "m", 0.0254),
        ("5 \N{MICRO SIGN}m", "m", 5e-6),
        ("5 \N{GREEK SMALL LETTER MU}m", "m", 5e-6),
        ("20 mm²", "m²", 20e-6),
        ("20 mm2", "m²", 20e-6),
        ("180 deg", "deg", 180.0),
        ("-90°", "deg", -90.0),
        ("8 %", "%", 8.0),
        ("8 %", None, 0.08),
        ("30 g", "kg", 0.03),
        ("0.1 MPa", "Pa", 1e5),
        ("200 mbar", "Pa", 2e4),
        ("2 N/mm", "N/m", 2e3),
        ("3 cN", "N", 0.03),
    ],
)
def test_quantities_are_the_same_numbers_as_in_python(
    text: str, unit: str | None, value: float
) -> None:
    assert read_quantity(text, unit) == value  # not approximately: runs are repeated bit for bit


def test_radians() -> None:
    assert read_quantity(f"{np.pi!r} rad", "deg") == pytest.approx(180, rel=1e-15)


def test_quantities_are_written_as_people_say_them() -> None:
    assert write_quantity(5e3, "Pa") == "5 kPa"
    assert write_quantity(26e6, "Pa") == "26 MPa"
    assert write_quantity(0.15, "m") == "150 mm"
