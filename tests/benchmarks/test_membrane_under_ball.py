"""The reference of a membrane under a ball: its table, and the work of the ball."""

import pytest
from helpers.scenes import table
from membrane_on_plate import RADIUS, THICKNESS, Law
from membrane_under_ball import BALL, dimple

LAW = Law(c1=1.8, c2=2.0)


@pytest.mark.slow
def test_the_sheet_stores_the_work_of_the_ball() -> None:
    """DU = W dδ, and so for W ± w exactly to third order."""
    (row,) = (row for row in table("membrane_under_ball") if row["weight_N"] == "0.1")
    assert (float(row["a_m"]), float(row["h_m"])) == (RADIUS, THICKNESS)
    assert float(row["ball_radius_m"]) == BALL
    before, found, after = (dimple(LAW, weight) for weight in (0.099, 0.1, 0.101))
    assert found.depth == pytest.approx(float(row["depth_m"]), rel=1e-8)
    assert found.contact == pytest.approx(float(row["contact_radius_m"]), rel=1e-8)
    assert found.pole == pytest.approx(float(row["pole_stretch"]), rel=1e-8)
    work = 0.1 * (after.depth - before.depth)
    assert after.energy - before.energy == pytest.approx(work, rel=1e-4)
