"""Print bodies are closed, outward, and of the right volume, as an independent reader finds."""

import locale
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from helpers.panels import KINDS, pattern_of, striped
from shapely import affinity
from shapely.geometry import Point, Polygon, box
from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import ParameterError, PatternError
from toros_fem.making.panels import ManufactureOptions, panel_drawings
from toros_fem.making.sheets import PrintBody, print_bodies, print_body, write_3mf, write_stl

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
    write_stl(tmp_path / "body.stl", [PrintBody("body", *print_body(region, HEIGHT, BASE))])
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


@pytest.mark.parametrize("seed", range(24))
def test_bodies_of_random_polygons(seed: int) -> None:
    """Slivers, dense corners, and many parts that touch at points, turned by any angle."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(5, 60))
    if seed % 3 == 0:
        low = rng.integers(0, 12, (count, 2)) * 2e-3
        shapes = shapely.box(*low.T, *(low + 2e-3).T)
    elif seed % 3 == 1:
        shapes = shapely.polygons(rng.uniform(0, 0.03, (count, 3, 2)))
    else:
        shapes = shapely.buffer(shapely.points(rng.uniform(0, 0.03, (count, 2))), 2e-3, quad_segs=5)
    region = affinity.rotate(shapely.union_all(shapes), rng.uniform(0, 90), origin=(0, 0))
    if seed % 2:
        region = shapely.box(-0.05, -0.05, 0.05, 0.05).difference(region)
    vertices, triangles = print_body(region, HEIGHT)
    mesh = trimesh.Trimesh((1e3 * vertices).astype(np.float32), triangles, process=True)
    checked(mesh)
    assert mesh.volume == pytest.approx(1e9 * region.area * HEIGHT, rel=1e-3)


@pytest.mark.parametrize("kind", KINDS)
def test_one_body_for_each_panel(kind: str, tmp_path: Path) -> None:
    """3MF holds the unit, a named object for each panel at its place, and its crosses."""
    pytest.importorskip("lib3mf", reason="lib3mf is not installed")
    pattern = pattern_of(kind)
    options = ManufactureOptions(layer_height=HEIGHT, fabric_offset=BASE)
    drawings = [
        drawing.moved(0.3, np.array([0.2, 0.1 * k]))
        for k, drawing in enumerate(panel_drawings(pattern, striped(pattern), options))
    ]
    bodies = print_bodies(drawings, options)
    before = locale.setlocale(locale.LC_ALL)
    write_3mf(tmp_path / "print.3mf", bodies)
    assert locale.setlocale(locale.LC_ALL) == before
    scene = trimesh.load(tmp_path / "print.3mf")
    assert scene.units == "millimeter"
    assert set(scene.geometry) == {
        name for d in drawings for name in (d.name, f"{d.name} registration")
    }
    for drawing in drawings:
        matrix, name = scene.graph[drawing.name]
        mesh = scene.geometry[name]
        checked(mesh)
        assert mesh.volume == pytest.approx(1e9 * drawing.printed.area * HEIGHT, rel=1e-3)
        assert np.array_equal(matrix, np.eye(4))
        wanted = 1e3 * np.reshape(drawing.printed.bounds, (2, 2))
        assert mesh.bounds[:, :2] == pytest.approx(wanted, abs=2e-3)
        assert mesh.bounds[:, 2] == pytest.approx([0.3, 0.7], abs=1e-6)
        marks = scene.geometry[f"{drawing.name} registration"]
        checked(marks)
        # Three crosses of 4 mm with lines of 0.8 mm, where the cut file has them.
        assert marks.volume == pytest.approx(3 * (2 * 4 * 0.8 - 0.64) * 0.4, rel=1e-3)
        centres = 1e3 * drawing.crosses
        found = np.array([part.bounds.mean(axis=0)[:2] for part in marks.split()])
        assert found[np.lexsort(found.T)] == pytest.approx(centres[np.lexsort(centres.T)], abs=2e-3)


def test_panels_without_print_have_no_body() -> None:
    pattern = pattern_of("finger")
    regions = striped(pattern)
    drawings = panel_drawings(pattern, [regions[0], Polygon()])
    names = [body.name for body in print_bodies(drawings)]
    assert names == ["top", "top registration"]


def test_wrong_bodies() -> None:
    with pytest.raises(PatternError, match="nothing is printed"):
        print_body(Polygon(), HEIGHT)
    with pytest.raises(ParameterError, match="height = 0"):
        print_body(box(0, 0, 1, 1), 0)
    with pytest.raises(ParameterError, match=r"base = -0\.1"):
        print_body(box(0, 0, 1, 1), HEIGHT, -0.1)
