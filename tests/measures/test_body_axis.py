"""The axis of a body of any shape: targets along it, and metrics that measure them."""

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.measures.body_axis import body_axis
from toros_fem.meshes import bend, compose, contract, cylinder, twist
from toros_fem.meshes.pattern import Pattern

LENGTH = 0.12
# Where a tube along z lies after its axes are permuted, and shifted.
PLACES = [("z", "x"), ("x", "y"), ("-y", "z")]
SHIFT = np.array([0.3, -0.2, 0.5])


@pytest.fixture(scope="module")
def tube(alone: MPI.Comm) -> Pattern:
    return cylinder(alone, LENGTH, 0.02, 4e-3)


def placed(tube: Pattern, along: str, toward: str) -> tuple[Pattern, np.ndarray]:
    """The tube with its axis along another direction, and the rows of its frame."""
    unit = {w: (-1.0 if "-" in w else 1.0) * np.eye(3)["xyz".index(w[-1])] for w in (along, toward)}
    frame = np.stack([unit[toward], np.cross(unit[along], unit[toward]), unit[along]])
    moved = Pattern(
        tube.flat_points, tube.flat_triangles, tube.panel, tube.sewn, tube.points @ frame + SHIFT,
        tube.panel_names,
    )  # fmt: skip
    return moved, frame


@pytest.mark.parametrize(("along", "toward"), PLACES)
def test_targets_are_those_of_the_tube(tube: Pattern, along: str, toward: str) -> None:
    """At another place, targets are those of the tube along z, and metrics measure them."""
    moved, frame = placed(tube, along, toward)
    axis = body_axis(moved, along, toward, 0.0, None)
    assert axis.length == pytest.approx(LENGTH)
    assert axis.flat_tip
    bent, turned = bend(1.2, LENGTH, neutral=0.01), twist(2.5, LENGTH)
    all_three = compose(turned, contract(0.92), bend(1.2, 0.92 * LENGTH, neutral=0.01))
    for asked, expected, metric in (
        ((1.2, None, None), bent, axis.metric("angle", np.degrees(1.2))),
        ((None, 2.5, None), turned, axis.metric("twist", np.degrees(2.5))),
        ((None, None, 0.08), contract(0.92), axis.metric("shortening", 8.0)),
        ((1.2, 2.5, 0.08), all_three, None),
    ):
        x = axis.deformer(*asked, 0.01)(moved.points)
        np.testing.assert_allclose((x - SHIFT) @ frame.T, expected(tube.points), atol=1e-5)
        if metric is not None:
            assert metric.measure(moved, x) == pytest.approx(metric.target, abs=0.01)
    x = axis.deformer(-7.0, None, None, 0.01)(moved.points)  # by more than a turn
    assert axis.metric("angle", None).measure(moved, x) == pytest.approx(np.degrees(-7), abs=0.01)
    x = axis.deformer(1.2, None, None, 0.01)(moved.points)
    assert axis.metric("twist", None).measure(moved, x) == pytest.approx(0, abs=0.01)


def test_part_of_the_body_is_deformed(tube: Pattern) -> None:
    """Before `begin` it stays, beyond `end` it goes on straight."""
    axis = body_axis(tube, "z", "x", 0.03, 0.09)
    x = axis.deformer(np.radians(60), np.radians(40), 0.1, 0.0)(tube.points)
    low, high = tube.points[:, 2] < 0.03, tube.points[:, 2] > 0.09
    np.testing.assert_allclose(x[low], tube.points[low], atol=1e-15)
    # A rigid motion: distances stay.
    before, after = tube.points[high], x[high]
    np.testing.assert_allclose(
        np.linalg.norm(after - after[0], axis=1), np.linalg.norm(before - before[0], axis=1)
    )
    assert axis.metric("angle", 60.0).measure(tube, x) == pytest.approx(60, abs=1e-6)
    assert axis.metric("twist", 40.0).measure(tube, x) == pytest.approx(40, abs=0.01)


def test_round_tip(alone: MPI.Comm) -> None:
    """Without a flat end, the target ends where the tip begins, and is measured there."""
    tube = cylinder(alone, LENGTH, 0.02, 4e-3)
    points = tube.points.copy()
    cap = points[:, 2] > LENGTH - 1e-9
    points[cap, 2] += 0.01 * np.sqrt(1 - np.minimum(1, np.hypot(*points[cap, :2].T) / 0.0101) ** 2)
    rounded = Pattern(
        tube.flat_points, tube.flat_triangles, tube.panel, tube.sewn, points, tube.panel_names
    )
    axis = body_axis(rounded, "z", "x", 0.0, None)
    assert not axis.flat_tip
    assert axis.end == pytest.approx(axis.length * 11 / 12)
    x = axis.deformer(1.0, None, None, 0.0)(points)
    assert axis.metric("angle", None).measure(rounded, x) == pytest.approx(np.degrees(1), abs=1e-6)
