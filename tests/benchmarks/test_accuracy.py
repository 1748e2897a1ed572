"""Known answers on coarse meshes: errors as measured, with the expected order."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.scenes import table

from benchmarks.accuracy.command import BY_NAME
from benchmarks.accuracy.known import refinements
from benchmarks.accuracy.patterns import helical_twist, mckibben
from benchmarks.accuracy.references import RADIUS, THICKNESS, Law, dimple, free_disc, pressed_disc

# Case, formulation, kind of mesh; error on the second coarsest mesh, as measured and rounded up by
# some per cent; least order, None where the error does not come from the mesh alone.
MEMBRANE, ROUND, EXACT = "membrane", 2 - 0.3, 1e-8
COARSE = [
    ("uniaxial-stress", MEMBRANE, "unstructured", EXACT, None),
    ("uniaxial-width", MEMBRANE, "right", EXACT, None),
    ("equibiaxial", MEMBRANE, "unstructured", EXACT, None),
    ("strip-along", MEMBRANE, "right", EXACT, None),
    ("strip-across", MEMBRANE, "unstructured", EXACT, None),
    ("tube-polygon-balance", MEMBRANE, "structured", EXACT, None),
    ("stripes-along", MEMBRANE, "right", EXACT, None),
    ("stripes-across", MEMBRANE, "crossed", EXACT, None),
    ("tube-radius-1kPa", MEMBRANE, "structured", 1.9e-3, ROUND),
    ("tube-radius-5kPa", MEMBRANE, "unstructured", 1.2e-3, ROUND),
    ("tube-polygon", MEMBRANE, "structured", 6e-5, 3.5),
    ("tube-twist", MEMBRANE, "structured", 4.5e-3, 1.9),
    ("tube-limit-pressure", MEMBRANE, "structured", 9e-3, ROUND),
    ("disc-100Pa", MEMBRANE, "structured", 1.5e-3, ROUND),
    ("disc-5000Pa", MEMBRANE, "unstructured", 1.1e-3, ROUND),
    ("hencky", MEMBRANE, "unstructured", 5.5e-4, ROUND),
    ("helix-twist", MEMBRANE, "helical", 1.9e-2, ROUND),
    ("helix-twist-polygon", MEMBRANE, "helical", 1e-3, None),
    ("mckibben-pinned", MEMBRANE, "lattice", 3e-4, None),
    ("plate-clamped", "midedge", "union-jack", 0.1, 1.85),
    ("plate-clamped", "midedge", "unstructured", 0.1, 1.85),
    ("plate-supported", "midedge", "jittered", 0.1, 1.85),
    ("rolled-energy", "midedge", "unstructured", 4e-4, 1.6),
    ("rolled-energy", "average", "right", 4e-5, 1.6),
    ("cantilever", "midedge", "right", 2e-3, None),
    ("pulled-cylinder", "midedge", "unstructured", 2e-2, None),
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "formulation", "mesh", "bound", "order"), COARSE)
def test_coarse_meshes(
    name: str, formulation: str, mesh: str, bound: float, order: float | None
) -> None:
    known = replace(BY_NAME[name], formulations=(formulation,), meshes=(mesh,))
    _, fine = refinements(known, quick=True)
    assert fine.relative_error <= bound
    if order is not None:
        assert fine.observed_order >= order


def test_closed_forms_of_lines_that_do_not_stretch() -> None:
    for row in table("mckibben_kinematics"):
        angle = np.radians(float(row["theta0_deg"]))
        found = mckibben(angle, float(row["radius_ratio_R/R0"]))
        assert found == pytest.approx(float(row["axial_ratio_L/L0"]), abs=3e-6)
    for row in table("helical_twist"):
        angle = np.radians(float(row["theta_deg_from_axis"]))
        twist = helical_twist(angle, float(row["lambda_theta"]), float(row["lambda_z"]))
        expected = float(row["twist_deg_per_cm_for_R0=1cm"])
        assert np.degrees(twist) == pytest.approx(expected, abs=1e-4)


@pytest.mark.slow
def test_references_of_contact() -> None:
    """The free disc is that of another method; the tables are what the references give."""
    law = Law(c1=1.8, c2=2.0)
    for row in table("gent_circular_membrane"):
        pressure = float(row["P_Pa"])
        if row["mat"] == "A" and row["c1"] == "1.8" and pressure in (100.0, 1000.0):
            found = free_disc(law, pressure)
            assert found.height / RADIUS == pytest.approx(float(row["w0_over_a"]), abs=1e-6)
            assert found.volume == pytest.approx(float(row["volume_m3"]), rel=1e-6)
    for row in table("membrane_on_plate"):
        if (row["c1"], row["p_Pa"], row["height_m"]) == ("1.8", "500", "0.008"):
            plate = pressed_disc(law, 500.0, 8e-3, free_disc(law, 500.0))
            assert plate.contact_radius == pytest.approx(float(row["contact_radius_m"]), rel=1e-8)
            assert plate.volume == pytest.approx(float(row["volume_m3"]), rel=1e-8)
            force = 500.0 * np.pi * (RADIUS**2 - plate.contact_radius**2)
            assert plate.rim_force == pytest.approx(force, rel=1e-8)
    (row,) = (row for row in table("membrane_under_ball") if row["weight_N"] == "0.1")
    ball = dimple(law, 0.1)
    assert (float(row["a_m"]), float(row["h_m"])) == (RADIUS, THICKNESS)
    assert ball.depth == pytest.approx(float(row["depth_m"]), rel=1e-8)
    assert ball.contact == pytest.approx(float(row["contact_radius_m"]), rel=1e-8)
