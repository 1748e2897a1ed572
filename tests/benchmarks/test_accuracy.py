"""Known answers on coarse meshes: errors as measured, with the expected order."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.scenes import table

from benchmarks.accuracy.bending import BENDING
from benchmarks.accuracy.known import Known, Refinement, refinements
from benchmarks.accuracy.membrane import MEMBRANE
from benchmarks.accuracy.patterns import PATTERNS, helical_twist, mckibben
from benchmarks.accuracy.references import RADIUS, THICKNESS, Law, dimple, free_disc, pressed_disc

HOMOGENEOUS = (
    "uniaxial-stress", "uniaxial-width", "equibiaxial", "strip-along", "strip-across",
    "tube-polygon-balance", "stripes-along", "stripes-across",
)  # fmt: skip
# Error on the second coarsest mesh, as measured and rounded up by some per cent: of the structured
# mesh, then of the unstructured one.
ROUND = {
    "tube-radius-1kPa": (1.9e-3, 1.9e-3),
    "tube-radius-5kPa": (8e-4, 1.2e-3),
    "tube-limit-pressure": (9e-3,),
    "disc-100Pa": (1.5e-3, 5e-4),
    "disc-1000Pa": (1.2e-3, 3e-4),
    "disc-5000Pa": (2.7e-3, 1.1e-3),
    "hencky": (1.6e-3, 5.5e-4),
    "helix-twist": (1.9e-2,),
}
# Bounds of cases whose error does not come from the mesh alone, on both meshes.
NEARLY = {"mckibben-pinned": 3e-4, "helix-twist-polygon": 1e-3}


def named(*names: str) -> list[Known]:
    cases = {case.name: case for case in (*MEMBRANE, *PATTERNS)}
    return [cases[name] for name in names]


def quick(case: Known) -> list[list[Refinement]]:
    """The two coarsest meshes of each kind."""
    rows = list(refinements(case, quick=True))
    return [rows[k : k + 2] for k in range(0, len(rows), 2)]


def name_of(case: Known) -> str:
    return case.name


@pytest.mark.parametrize("case", named(*HOMOGENEOUS), ids=name_of)
def test_homogeneous_states_are_exact(case: Known) -> None:
    for row in refinements(case, quick=True):
        assert row.relative_error <= 1e-8


@pytest.mark.parametrize("case", named(*ROUND), ids=name_of)
def test_round_shapes_converge(case: Known) -> None:
    """With the square of the edge length, on any mesh."""
    for (_, fine), bound in zip(quick(case), ROUND[case.name], strict=True):
        assert fine.relative_error <= bound
        assert fine.observed_order is not None
        assert fine.observed_order >= 2 - 0.3


@pytest.mark.parametrize("case", named(*NEARLY), ids=name_of)
def test_stiff_lines_leave_a_tube_what_geometry_does(case: Known) -> None:
    for row in refinements(case, quick=True):
        assert row.relative_error <= NEARLY[case.name]


def test_polygonal_tube_but_for_its_twist() -> None:
    polygon, twist = named("tube-polygon", "tube-twist")
    ((coarse, fine),) = quick(polygon)
    assert coarse.relative_error <= 8.5e-4
    assert fine.relative_error <= 6e-5, "by the square of the twist"
    structured, unstructured = quick(twist)
    assert structured[1].observed_order == pytest.approx(2, abs=0.1)
    assert structured[1].value == pytest.approx(0.00442, rel=0.02)
    assert abs(unstructured[1].value) < 0.02 * structured[1].value


@pytest.mark.parametrize("case", named("mylar-volume", "mylar-height", "pillow-volume"),
                         ids=name_of)  # fmt: skip
def test_what_hardly_stretches_nears_its_limit_from_below(case: Known) -> None:
    for coarse, fine in quick(case):
        assert 0.4 * case.reference < coarse.value < fine.value < case.reference


PLATES = [case for case in BENDING if case.name.startswith("plate")]


@pytest.mark.slow
@pytest.mark.parametrize("case", PLATES, ids=name_of)
def test_mid_edge_plates_converge_on_every_mesh(case: Known) -> None:
    """With the square of the edge length; the average does not where its triangles do not pair."""
    for coarse, fine in quick(replace(case, formulations=("midedge",))):
        assert fine.observed_order is not None
        assert fine.observed_order >= 2 - 0.15
        assert fine.relative_error < 0.1
        assert fine.value > case.reference, "from above"
        # Richardson's extrapolation for order two.
        extrapolated = (4 * fine.value - coarse.value) / 3
        assert extrapolated == pytest.approx(case.reference, rel=0.015)
    ((_, stuck),) = quick(replace(case, formulations=("average",), meshes=("union-jack",)))
    assert stuck.relative_error > 0.15


@pytest.mark.slow
@pytest.mark.parametrize(
    ("formulation", "meshes", "bound"),
    [
        ("midedge", ("right", "equilateral", "union-jack", "crossed", "unstructured"), 4e-4),
        ("average", ("right",), 4e-5),
        ("quadratic", ("crossed", "unstructured"), 1.6e-3),
    ],
)
def test_energy_of_a_rolled_sheet(formulation: str, meshes: tuple[str, ...], bound: float) -> None:
    (case,) = (case for case in BENDING if case.name == "rolled-energy")
    for _, fine in quick(replace(case, formulations=(formulation,), meshes=meshes)):
        assert fine.relative_error < bound
        assert fine.observed_order is not None
        assert fine.observed_order > 1.6


@pytest.mark.parametrize(
    ("name", "mesh", "bound"),
    [
        ("cantilever", "right", 2e-3),
        ("cantilever", "crossed", 1e-3),
        ("rolled-up", "unstructured", 3e-3),
        ("pulled-cylinder", "unstructured", 2e-2),
    ],
)
def test_large_rotations(name: str, mesh: str, bound: float) -> None:
    """Strips and a shell turned far, against exact and published values."""
    (case,) = (case for case in BENDING if case.name == name)
    sizes = (2,) if name == "rolled-up" else case.sizes[1:2]
    for size in sizes:
        found = case.run("midedge", mesh, size)
        assert found.value == pytest.approx(case.reference, rel=bound)


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


def test_a_free_disc_is_that_of_the_other_table() -> None:
    """It was made by another method."""
    for row in table("gent_circular_membrane"):
        pressure = float(row["P_Pa"])
        if row["mat"] == "A" and row["c1"] == "1.8" and pressure in (100.0, 1000.0):
            found = free_disc(Law(c1=1.8, c2=2.0), pressure)
            assert found.height / RADIUS == pytest.approx(float(row["w0_over_a"]), abs=1e-6)
            assert found.volume == pytest.approx(float(row["volume_m3"]), rel=1e-6)


@pytest.mark.slow
def test_tables_of_contact_are_what_their_references_give() -> None:
    law = Law(c1=1.8, c2=2.0)
    for row in table("membrane_on_plate"):
        if (row["c1"], row["p_Pa"], row["height_m"]) == ("1.8", "500", "0.008"):
            plate = pressed_disc(law, 500.0, 8e-3, free_disc(law, 500.0))
            assert plate.contact_radius == pytest.approx(float(row["contact_radius_m"]), rel=1e-8)
            assert plate.pole == pytest.approx(float(row["pole_stretch"]), rel=1e-8)
            assert plate.volume == pytest.approx(float(row["volume_m3"]), rel=1e-8)
            force = 500.0 * np.pi * (RADIUS**2 - plate.contact_radius**2)
            assert plate.rim_force == pytest.approx(force, rel=1e-8)
    (row,) = (row for row in table("membrane_under_ball") if row["weight_N"] == "0.1")
    ball = dimple(law, 0.1)
    assert (float(row["a_m"]), float(row["h_m"])) == (RADIUS, THICKNESS)
    assert ball.depth == pytest.approx(float(row["depth_m"]), rel=1e-8)
    assert ball.contact == pytest.approx(float(row["contact_radius_m"]), rel=1e-8)
