"""Regions and conditions."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.meshes import cylinder
from toros_fem.meshes.pattern import Pattern
from toros_fem.products.own_metrics import Expression, Region

X, Y, Z = POINTS = np.random.default_rng(3).uniform(-0.02, 0.02, (3, 500))


def test_regions_of_a_skin(alone: MPI.Comm) -> None:
    tube = cylinder(alone, 0.06, 0.02, 5e-3)
    low = Region(where="z < 10 mm").vertices(tube)
    np.testing.assert_array_equal(low, tube.points[:, 2] < 0.01)
    caps = Region(panels="base, tip").cells(tube)
    np.testing.assert_array_equal(caps, tube.panel != tube.panel_index("wall"))
    both = Region(panels="base,tip", where="z > 30 mm").cells(tube)
    np.testing.assert_array_equal(both, tube.panel == tube.panel_index("tip"))
    # Triangles go by their centroids: those of the wall that only touch the plane are outside.
    np.testing.assert_array_equal(
        Region(where="z < 0.01 mm").cells(tube), tube.panel == tube.panel_index("base")
    )
    divided = Pattern(
        tube.flat_points, tube.flat_triangles, tube.panel, tube.sewn, tube.points,
        ("wall", "cap-1", "cap-2"),
    )  # fmt: skip
    np.testing.assert_array_equal(Region(panels="cap").cells(divided), caps)


@pytest.mark.parametrize(
    ("text", "inside"),
    [
        ("z < 5 mm", Z < 5e-3),
        ("z < 0.005", Z < 5e-3),
        ("z<=-.5cm", Z <= -5e-3),
        ("0 < z < 5 mm", (Z > 0) & (Z < 5e-3)),
        ("z < 5 mm and x > 0", (Z < 5e-3) & (X > 0)),
        ("z < 5 mm or x > 0 and y > 0", (Z < 5e-3) | ((X > 0) & (Y > 0))),
        ("(z < 5 mm or x > 0) and y > 0", ((Z < 5e-3) | (X > 0)) & (Y > 0)),
        ("not z < 5 mm", Z >= 5e-3),
        ("not (x > 0 or not y > 0)", ~((X > 0) | (Y <= 0))),
        ("not not x > 0", X > 0),
        ("hypot(x, y) > 1 cm", np.hypot(X, Y) > 1e-2),
        ("sqrt(x*x + y*y) > 1 cm", np.hypot(X, Y) > 1e-2),
        ("x*x + y*y > 1 cm²", X**2 + Y**2 > 1e-4),
        ("abs(x - 3 mm) < 2 * (1 mm + 2 mm) / 3", np.abs(X - 3e-3) < 2e-3),
        ("-x > 2 mm - 1 mm", -X > 1e-3),
        ("x / y > 1", X / Y > 1),
        ("1 mm < 2 mm", np.full(500, True)),
    ],
)
def test_conditions(text: str, inside: np.ndarray) -> None:
    np.testing.assert_array_equal(Expression(text)(POINTS.T), inside)


def test_longest_conditions_can_be_evaluated() -> None:
    assert not Expression("+".join(["x"] * 140) + "<-1e9")(POINTS.T).any()
    assert Expression("-" * 290 + "1 < 2")(POINTS.T).all()
