"""Print bodies are closed, outward, and of the right volume, as an independent reader finds."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from helpers.panels import pattern_of, striped
from shapely.geometry import Point, Polygon, box
from shapely.geometry.base import BaseGeometry

from toros_fem.making.panels.panel_drawing import panel_drawings
from toros_fem.making.sheets.write import print_bodies, print_body, stl_of

trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")
HEIGHT, BASE = 0.4e-3, 0.3e-3
SPOTS = np.random.default_rng(3)


def random_spots(count: int) -> BaseGeometry:
    places, radii = SPOTS.uniform(0, 0.1, (count, 2)), SPOTS.uniform(1e-3, 4e-3, count)
    spots = [Point(*place).buffer(radius, 8) for place, radius in zip(places, radii, strict=True)]
    return shapely.union_all(spots)


FRAME = box(0, 0, 0.1, 0.05).difference(box(0.02, 0.02, 0.04, 0.03))
REGIONS = {
    "a square": box(0, 0, 0.01, 0.01),
    "holes": FRAME.difference(Point(0.07, 0.025).buffer(0.01)),
    "holes that touch at a point": FRAME.difference(box(0.04, 0.03, 0.05, 0.04)),
    "a hole that touches the border": FRAME.difference(
        Polygon([(0.06, 0.0), (0.065, 0.01), (0.055, 0.01)])
    ),
    "parts that touch at a point": shapely.union_all([FRAME, box(0.1, 0.05, 0.12, 0.06)]),
    "a corner on an edge": shapely.union_all(
        [FRAME, Polygon([(0.1, 0.025), (0.12, 0.02), (0.12, 0.04)])]
    ),
    "an island in a hole": shapely.union_all([FRAME, box(0.025, 0.022, 0.035, 0.028)]),
    "200 spots": random_spots(200),
}


def checked(mesh: Any) -> None:
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0  # outward
    # Each edge belongs to two faces: no two bodies share one.
    assert (np.unique(mesh.edges_sorted, axis=0, return_counts=True)[1] == 2).all()


@pytest.mark.parametrize("name", REGIONS)
def test_bodies_are_watertight_and_of_the_right_volume(name: str, tmp_path: Path) -> None:
    region = REGIONS[name]
    body = print_body(region, HEIGHT, BASE)
    (tmp_path / "body.stl").write_bytes(stl_of([("body", *body)]))
    mesh = trimesh.load_mesh(tmp_path / "body.stl")  # single precision, corners found by place
    checked(mesh)
    assert mesh.volume == pytest.approx(1e9 * region.area * HEIGHT, rel=1e-3)
    low, high = mesh.bounds
    assert (low[2], high[2]) == pytest.approx((1e3 * BASE, 1e3 * (BASE + HEIGHT)), abs=1e-6)
    assert (low[0], low[1], high[0], high[1]) == pytest.approx(
        np.array(region.bounds) * 1e3, abs=2e-3
    )
    number = len(shapely.get_parts(region))
    assert mesh.body_count == number


def test_panels_without_print_have_no_body() -> None:
    pattern = pattern_of("finger")
    regions = striped(pattern)
    drawings = panel_drawings(pattern, [regions[0], Polygon()])
    names = [name for name, *_ in print_bodies(drawings)]
    assert names == ["top", "top registration"]
