"""Surfaces meshed anew, and seams."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from helpers import surfaces
from helpers.scenes import square
from mpi4py import MPI

from toros_fem.base.errors import SurfaceError
from toros_fem.meshes import Surface, panels, remeshed, seams
from toros_fem.meshes.seams import cones, crease_regions, cut_open, disc_cuts, euler
from toros_fem.meshes.surface import cut_at_planes, nearest, volume
from toros_fem.meshes.triangles import (
    edge_keys,
    edges_of,
    expected_triangles,
    lengths,
    normals,
    shapes,
    surface_components,
)

BOX = np.array([[x, y, z] for x in (0, 0.02) for y in (0, 0.03) for z in (0, 0.08)])
SIDES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
BOX_TRIANGLES = np.array([[s[0], s[k], s[k + 1]] for s in SIDES for k in (1, 2)])


def sampled(surface: Surface, parts: int) -> np.ndarray:
    """Places all over each triangle, on a grid of barycentric coordinates."""
    share = [(i, j, parts - i - j) for i in range(parts + 1) for j in range(parts + 1 - i)]
    corners = surface.points[surface.triangles]
    return np.einsum("pk,tki->tpi", np.array(share) / parts, corners).reshape(-1, 3)


@pytest.mark.parametrize(
    ("given", "edge"),
    [
        (surfaces.long_tube(), 3e-3),
        (surfaces.ellipsoid((0.012, 0.012, 0.04)), 3e-3),
        (Surface(BOX, BOX_TRIANGLES), 4e-3),
        (surfaces.prism(), 2e-3),
    ],
    ids=["long tube", "ellipsoid", "box", "open tube"],
)
def test_mesh_of_equal_edges_on_the_surface(alone: MPI.Comm, given: Surface, edge: float) -> None:
    made = remeshed(alone, given, edge)
    new = made.surface
    assert new.closed == given.closed
    assert len(new.triangles) == pytest.approx(expected_triangles(given.area, edge), rel=0.3)
    of_edges = lengths(new.points, edges_of(new.triangles).ends)
    assert of_edges.min() > 0.3 * edge
    assert np.median(of_edges) == pytest.approx(edge, rel=0.15)
    assert of_edges.max() < 2.2 * edge
    assert shapes(new.points, new.triangles).min() > 0.1
    assert nearest(new.points, given.points, given.triangles).distance.max() < 1e-12
    np.testing.assert_allclose(made.weights @ given.points, new.points, atol=1e-15)
    apart = max(
        nearest(sampled(one, parts), other.points, other.triangles).distance.max()
        for one, other, parts in ((given, new, 12), (new, given, 4))
    )
    assert 0.75 * apart - 1e-12 <= made.distance <= apart + 1e-12
    told = f"{len(given.triangles)} triangles meshed anew by {len(new.triangles)}, "
    assert new.repairs == f"{told}{1e3 * made.distance:.2g} mm apart at most"


def test_distance_of_a_round_border(alone: MPI.Comm) -> None:
    """A chord of the mean edge leaves a circle by its sagitta; the longest one by some more."""
    made = remeshed(alone, surfaces.long_tube(around=256), 3e-3)
    assert 3e-3**2 / 8 / 0.01 < made.distance < 2 * 3e-3**2 / 8 / 0.01


def test_creases_stay(alone: MPI.Comm) -> None:
    new = remeshed(alone, Surface(BOX, BOX_TRIANGLES), 4e-3).surface
    assert volume(new.points, new.triangles) == pytest.approx(0.02 * 0.03 * 0.08, rel=1e-9)
    assert new.area == pytest.approx(Surface(BOX, BOX_TRIANGLES).area, rel=1e-9)
    with pytest.raises(SurfaceError, match="up to .* m away from the surface; the bound is 0.35"):
        remeshed(alone, Surface(BOX, BOX_TRIANGLES), 4e-3, crease_angle=np.pi)


def test_tips_stay(alone: MPI.Comm) -> None:
    """No crease leads to the tip of a flat cone."""
    given = surfaces.cone(around=24, rows=4, radius=0.02, height=0.012)
    new = remeshed(alone, given, 3e-3).surface
    assert new.points[:, 2].max() == pytest.approx(0.012, abs=1e-12)


def test_parts_and_seams_stay(alone: MPI.Comm) -> None:
    """A flat square of two parts, with a seam across one of them."""
    sheet = square(n=8)
    x = sheet.points[sheet.triangles].mean(axis=1)[:, 0]
    middle = np.ptp(sheet.points[:, 0]) / 2
    u, v, _ = sheet.points.T
    on = np.flatnonzero(np.isclose(v, middle) & (u < 1.01 * middle))
    seam = np.column_stack([on[:-1], on[1:]])
    given = Surface(sheet.points, sheet.triangles, (x > middle).astype(int), ("a", "b"), seam)
    new = remeshed(alone, given, middle / 5).surface
    assert new.part_names == ("a", "b")
    corners = new.points[new.triangles]
    np.testing.assert_array_equal(new.parts, corners.mean(axis=1)[:, 0] > middle)
    inside = np.where(new.parts[:, None] == 1, 1, -1) * (corners[..., 0] - middle)
    assert inside.min() > -1e-9, "no triangle crosses the border"
    assert len(new.seams) in (5, 6)
    places = new.points[new.seams]
    np.testing.assert_allclose(places[..., 1], middle, atol=1e-9)
    assert lengths(new.points, new.seams).sum() == pytest.approx(middle, rel=1e-6)


def test_border_stays_in_a_plane(alone: MPI.Comm) -> None:
    """Exactly: images of a part are sewn to it there."""
    half, _ = cut_at_planes(surfaces.ellipsoid((0.012, 0.011, 0.04)), (1,), 1e-3)
    new = remeshed(alone, half, 3e-3).surface
    border = edges_of(new.triangles)
    assert (new.points[border.ends[border.border], 1] == 0).all()
    assert new.points[:, 1].min() == 0


def test_nearest_places() -> None:
    """Beside a corner, a side and the inside of a triangle, and of the nearer of two."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 9.0], [40, 0, 9], [0, 40, 9]])
    points = np.array([[-1, -1, 0], [0.5, -1, 0], [0.25, 0.25, 1], [0.25, 0.25, 8], [20, 1, 9.5]])
    found = nearest(points, vertices, np.array([[0, 1, 2], [3, 4, 5]]))
    assert found.distance == pytest.approx([np.sqrt(2), 1, 1, 1, 0.5])
    np.testing.assert_array_equal(found.triangle, [0, 0, 0, 1, 1])
    shares = np.array([[1, 0, 0], [0.5, 0.5, 0], [0.5, 0.25, 0.25]])
    np.testing.assert_allclose(found.shares[:3], shares)


def test_nearest_of_long_triangles() -> None:
    """Each triangle by itself gives no nearer place."""
    tube = surfaces.long_tube()
    points = np.random.default_rng(1).uniform([-0.02, -0.02, -0.01], [0.02, 0.02, 0.09], (300, 3))
    found = nearest(points, tube.points, tube.triangles)
    alone = [nearest(points, tube.points, one[None]).distance for one in tube.triangles]
    np.testing.assert_allclose(found.distance, np.min(alone, axis=0), rtol=1e-12)
    places = found.weights(tube.triangles, len(tube.points)) @ tube.points
    np.testing.assert_allclose(np.linalg.norm(places - points, axis=1), found.distance)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t[1:], "it would have other holes or handles"),
        (lambda t: np.vstack([t, t[:1]]), "it would be no surface: 3 edges have more than two"),
    ],
)
def test_another_surface_is_refused(
    alone: MPI.Comm,
    monkeypatch: pytest.MonkeyPatch,
    change: Callable[[np.ndarray], np.ndarray],
    message: str,
) -> None:
    """As if gmsh had left a triangle out, or made one twice."""

    def meshed(gmsh: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        points, triangles, ends = panels.meshed(gmsh)
        return points, change(triangles), ends

    monkeypatch.setattr(seams, "meshed", meshed)
    with pytest.raises(SurfaceError, match=message):
        remeshed(alone, Surface(BOX, BOX_TRIANGLES), 4e-3)


def test_triangles_that_would_face_inwards_are_refused(alone: MPI.Comm) -> None:
    """Of a ball of few triangles, at edges that are longer than its own."""
    ball = surfaces.sphere(1)
    edge = lengths(ball.points, edges_of(ball.triangles).ends).mean()
    assert remeshed(alone, ball, 0.8 * edge).surface.closed
    with pytest.raises(
        SurfaceError, match=r"it would be folded by 1\d\d degrees; the bound is 120"
    ):
        remeshed(alone, ball, 1.6 * edge)


def test_a_sharp_edge_stays(alone: MPI.Comm) -> None:
    """A wedge is folded by 150 degrees at its edge, and its mesh may be."""
    half = 0.02 * np.tan(np.radians(15))
    corners = np.array([[0, 0], [0.02, -half], [0.02, half]])
    turn = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
    points = np.array([[x, y, z] for z in (0, 0.03) for x, y in corners]) @ turn.T
    triangles = np.array(
        [[0, 2, 1], [3, 4, 5], [0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4], [2, 0, 3], [2, 3, 5]]
    )
    if np.linalg.det(turn) < 0:
        triangles = triangles[:, ::-1]
    assert remeshed(alone, Surface(points, triangles), 4e-3).surface.closed


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
