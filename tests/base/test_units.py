"""Values with units: exact conversion, and what is refused."""

import numpy as np
import pytest

from toros_fem.base.units import read_quantity, write_quantity


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
