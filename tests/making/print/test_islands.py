"""Pieces, islands and holes are found, across seams too."""

import numpy as np
import shapely
from helpers.scenes import square
from mpi4py import MPI
from shapely.geometry import Polygon, box
from shapely.geometry.base import BaseGeometry

from toros_fem.making.print.cleaning import Panels, clean
from toros_fem.making.print.printability import find_holes, find_pieces, printability
from toros_fem.meshes import Pattern, cylinder


def test_pieces_across_seams(alone: MPI.Comm) -> None:
    """A body that runs out at the tube's seam, its other half, and a spot that meets nothing."""
    pattern = cylinder(alone, 0.04, 0.02, 2e-3, caps=None)
    width = np.ptp(pattern.flat_points[:, 0])
    shapes = {
        "body": box(0.02, 0.02, width, 0.03),
        "other half": box(0, 0.029, 0.01, 0.035),
        "spot at the seam": box(width - 5e-3, 5e-3, width, 10e-3),
        "spot across": box(0, 11e-3, 5e-3, 16e-3),
        "spot": box(0.02, 5e-3, 0.025, 10e-3),
    }
    (outline,) = (pattern.outline(0),)
    region = shapely.MultiPolygon(list(shapes.values())) & outline
    pieces = find_pieces(pattern, [region])
    assert [piece.main for piece in pieces] == [True] + 4 * [False]
    met = {name: piece.attached for name, shape in shapes.items()
           for piece in pieces if piece.polygon.intersects(shape.buffer(-1e-3))}  # fmt: skip
    assert met == {"body": True, "other half": True, "spot at the seam": False,
                   "spot across": False, "spot": False}  # fmt: skip
    summary = printability(pattern, [region]).summary()
    assert (summary["pieces"], summary["islands"], summary["islands_attached_by_seam"]) == (5, 3, 1)
    # The other half meets the body along 1 mm.
    for contact, attached in ((0.9e-3, 2), (1.1e-3, 1)):
        assert sum(p.attached for p in find_pieces(pattern, [region], contact)) == attached


def test_images_of_the_main_body_are_main_bodies() -> None:
    """Four legs of a symmetric print, and a spot in the middle: no leg is an island."""
    pattern = square(n=8)
    low, high = pattern.flat_points.min(axis=0), pattern.flat_points.max(axis=0)
    size = (high - low) / 10
    corners = [low + size * [x, y] for x in (0, 7) for y in (0, 7)]
    legs = [box(*at, *(at + 3 * size * [1, 1 + 1e-6 * k])) for k, at in enumerate(corners)]
    spot = box(*(low + 4.5 * size), *(low + 5.5 * size))
    pieces = find_pieces(pattern, [shapely.MultiPolygon([*legs, spot])])
    assert [piece.main for piece in pieces] == [True] * 4 + [False]
    assert [piece.attached for piece in pieces] == [True] * 4 + [False]


def test_caps_hold_what_touches_them(alone: MPI.Comm) -> None:
    pattern = cylinder(alone, 0.04, 0.02, 2e-3)
    wall, tip = pattern.panel_index("wall"), pattern.panel_index("tip")
    shapes = [box(0.02, 0.01, 0.04, 0.02), box(0.02, 0.03, 0.03, 0.05)]
    regions: list[BaseGeometry] = [Polygon()] * 3
    regions[wall] = shapely.MultiPolygon(shapes) & pattern.outline(wall)
    assert [p.attached for p in find_pieces(pattern, regions)] == [True, False]
    regions[tip] = pattern.outline(tip)
    pieces = find_pieces(pattern, regions)
    assert all(piece.attached for piece in pieces)
    assert sum(piece.main for piece in pieces) == 2


def test_cut_outs_are_no_holes() -> None:
    whole = square(n=8)
    centre = np.all(np.abs(whole.centroids - 0.01) < 0.005, axis=1)
    used, corners = np.unique(whole.flat_triangles[~centre], return_inverse=True)
    pattern = Pattern(
        flat_points=whole.flat_points[used],
        flat_triangles=corners.reshape(-1, 3),
        panel=whole.panel[~centre],
        sewn=np.arange(len(used)),
        points=whole.points[used],
        panel_names=whole.panel_names,
    )
    region = pattern.outline(0)
    assert len(region.interiors) == 1
    assert not find_holes(pattern, [region])
    assert clean(Panels(pattern), [region], island_area=1.0).regions[0].equals(region)
