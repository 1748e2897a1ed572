"""The reference of a membrane against a plate: its table, and the work of the plate."""

import numpy as np
import pytest
from helpers.scenes import table
from membrane_on_plate import RADIUS, THICKNESS, Law, energy, free_disc, pressed_disc

LAW = Law(c1=1.8, c2=2.0)


def test_a_free_disc_is_that_of_the_other_table() -> None:
    """It was made by another method."""
    for row in table("gent_circular_membrane"):
        pressure = float(row["P_Pa"])
        if row["mat"] == "A" and row["c1"] == "1.8" and pressure in (100.0, 1000.0):
            found = free_disc(LAW, pressure)
            assert found.height / RADIUS == pytest.approx(float(row["w0_over_a"]), abs=1e-6)
            assert found.volume == pytest.approx(float(row["volume_m3"]), rel=1e-6)


@pytest.mark.slow
def test_the_plate_does_the_work_that_is_missing() -> None:
    """dΠ/dH = −p π r² with the potential Π = U − p V, found from the energy alone."""
    pressure, height, step = 500.0, 8e-3, 4e-5
    free = free_disc(LAW, pressure)

    def potential(at: float) -> float:
        found = pressed_disc(LAW, pressure, at, free)
        return energy(LAW, found) - pressure * found.volume

    found = pressed_disc(LAW, pressure, height, free)
    slope = (potential(height + step) - potential(height - step)) / (2 * step)
    force = pressure * np.pi * found.contact_radius**2
    assert slope == pytest.approx(-force, rel=1e-3)
    assert found.rim_force == pytest.approx(pressure * np.pi * RADIUS**2 - force, rel=1e-8)


@pytest.mark.slow
def test_the_table_is_what_the_reference_gives() -> None:
    rows = [row for row in table("membrane_on_plate") if row["p_Pa"] == "500"]
    assert {row["c1"] for row in rows} == {"1.8", "inf"}
    for row in rows:
        if row["height_m"] != "0.008":
            continue
        assert (float(row["a_m"]), float(row["h_m"])) == (RADIUS, THICKNESS)
        bounded = row["c1"] != "inf"
        law = Law(c1=float(row["c1"]), c2=float(row["c2"])) if bounded else Law()
        found = pressed_disc(law, 500.0, 8e-3, free_disc(law, 500.0))
        for name, value in (
            ("contact_radius_m", found.contact_radius),
            ("pole_stretch", found.pole),
            ("volume_m3", found.volume),
        ):
            assert value == pytest.approx(float(row[name]), rel=1e-8)
