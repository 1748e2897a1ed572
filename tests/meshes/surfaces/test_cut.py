"""Surfaces are cut open to discs, at creases, and by a short way across."""

from collections.abc import Callable

import numpy as np
import pytest
from helpers import surfaces

from toros_fem.meshes import Surface
from toros_fem.meshes.surfaces.cut import cones, crease_regions, cut_open, disc_cuts, euler
from toros_fem.meshes.triangles import edge_keys, edges_of, lengths, normals, surface_components


@pytest.mark.parametrize(("make", "chi"), [(surfaces.sphere, 2), (surfaces.torus, 0)])
def test_closed_surfaces_are_cut_to_discs(make: Callable[[], Surface], chi: int) -> None:
    surface = make()
    assert euler(surface.triangles) == chi
    edges = edges_of(surface.triangles)
    seams = np.zeros(len(edges.ends), dtype=bool)
    seams[disc_cuts(surface.points, surface.triangles, tips=False)] = True
    opened, _ = cut_open(surface.triangles, edges, seams)
    assert surface_components(opened).max() == 0
    assert euler(opened) == 1
    border = edges_of(opened)
    ends = border.ends[border.border]
    assert np.bincount(ends.ravel()).max() == 2, "one loop"
    if chi == 0:  # around the tube and around its inside: the shortest pair of loops
        shortest = 24 * 2 * 0.013 * np.sin(np.pi / 24) + 12 * 2 * 0.007 * np.sin(np.pi / 12)
        assert lengths(surface.points, edges.ends[seams]).sum() < 1.3 * shortest


def test_a_single_edge_separates_nothing() -> None:
    """An inner edge whose ends are inside stays whole; two in a row open a slit."""
    tube = surfaces.prism(12, 5)
    edges = edges_of(tube.triangles)
    keys = edge_keys(edges.ends, len(tube.points))
    for line, opened in (([24, 36], 0), ([24, 36, 48], 1), ([36, 48, 60], 2)):
        seams = np.isin(keys, edge_keys(np.stack([line[:-1], line[1:]], axis=1), len(tube.points)))
        triangles, sewn = cut_open(tube.triangles, edges, seams)
        assert len(sewn) - len(tube.points) == opened
        assert np.array_equal(sewn[triangles], tube.triangles)
        assert surface_components(triangles).max() == 0


def test_tips_are_vertices_with_most_of_the_curvature() -> None:
    box = surfaces.welded_box(3)
    found = cones(box.points, box.triangles, edges_of(box.triangles))
    assert sorted(map(tuple, np.abs(box.points[found]))) == [(0.015, 0.01, 0.005)] * 8
    ball = surfaces.sphere(2)
    assert len(cones(ball.points, ball.triangles, edges_of(ball.triangles))) == 0
    seams = disc_cuts(box.points, box.triangles, tips=True)
    ends = edges_of(box.triangles).ends[seams]
    assert np.isin(found, ends).all(), "cuts lead through all of them"


def test_a_small_region_joins_the_neighbour_with_the_longest_border() -> None:
    """A side of less than 1 % of the area of a flat box is no region of its own."""
    points, triangles = surfaces.box(2, (0.03, 0.03, 1e-4))
    places, number = np.unique(points.round(12), axis=0, return_inverse=True)
    region = crease_regions(places, number.ravel()[triangles], np.radians(45))
    assert np.unique(region).tolist() == [0, 1]
    area = np.bincount(region, np.linalg.norm(normals(points, triangles), axis=1) / 2)
    assert area.sum() == pytest.approx(2 * 9e-4 + 4 * 3e-6, rel=1e-12)
    assert area.min() > 0.49 * area.sum()
