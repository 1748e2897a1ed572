"""Surfaces: checks, parts at symmetry planes, repair."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import surfaces
from helpers.mesh_files import write
from helpers.scenes import ROOT
from mpi4py import MPI

from toros_fem.base.errors import SurfaceError
from toros_fem.meshes import mirrored, read_surface, unwrap
from toros_fem.meshes.surface import (
    Surface,
    asymmetry,
    cut_at_planes,
    oriented,
    remove_thin,
    require_symmetric,
    straightened,
    volume,
    weld,
)
from toros_fem.meshes.triangles import edges_of, shapes


def test_oriented_surfaces() -> None:
    """Any triangles are reversed; the first one of each region decides."""
    rng = np.random.default_rng(1)
    for made in (surfaces.sphere(3), surfaces.torus(), surfaces.prism()):
        reverse = rng.random(len(made.triangles)) < 0.4
        mixed = np.where(reverse[:, None], made.triangles[:, ::-1], made.triangles)
        found = oriented(mixed)
        expected = made.triangles[:, ::-1] if reverse[0] else made.triangles
        first = np.argmin(found, axis=1) - np.argmin(expected, axis=1)
        rolled = [np.roll(row, shift) for row, shift in zip(expected, first, strict=True)]
        assert np.array_equal(found, rolled)
    two = np.array([[0, 1, 2], [5, 4, 3]])
    assert np.array_equal(oriented(two), two), "each region by itself"


def test_volume_and_area() -> None:
    box = surfaces.welded_box(2)
    assert volume(box.points + [1, 2, 3], box.triangles) == pytest.approx(6e-6, rel=1e-9)
    assert volume(box.points, box.triangles[:, ::-1]) == pytest.approx(-6e-6, rel=1e-9)
    assert box.area == pytest.approx(2 * (6 + 3 + 2) * 1e-4, rel=1e-9)
    assert box.closed
    assert not surfaces.prism().closed


@pytest.fixture(scope="module")
def finger(alone: MPI.Comm) -> Surface:
    """Edges of 2.5 mm, of which planes cross many."""
    return read_surface(alone, ROOT / "demos" / "surfaces" / "finger.stl", 1e-3)


@pytest.mark.parametrize("axes", [(0,), (1,), (0, 1)])
def test_part_and_its_images_are_the_whole(
    alone: MPI.Comm, finger: Surface, axes: tuple[int, ...]
) -> None:
    part, weights = cut_at_planes(finger, axes)
    for axis in axes:  # the part may be given again
        require_symmetric(finger, axis)
        require_symmetric(part, axis)
    assert shapes(part.points, part.triangles).min() > 0.15
    pattern = straightened(unwrap(alone, part).pattern, axes)
    whole = mirrored(pattern, axes).pattern
    assert len(whole.free_edges) == 0
    assert whole.panel_names == ("panel-1", "panel-2", "panel-3"), "panels go on across the cuts"
    seams = whole.points[whole.sewn[whole.seams[:, 0]]].mean(axis=1)
    wall = (seams[:, 2] > 1e-6) & (seams[:, 2] < 0.09 - 1e-6)
    assert np.ptp(seams[wall, :2], axis=0).max() < 1e-3, "the wall has one seam"
    assert volume(whole.points, whole.triangles) == pytest.approx(
        volume(finger.points, finger.triangles), rel=2e-3
    )
    assert max(asymmetry(Surface(whole.points, whole.triangles), axis) for axis in axes) < 1e-12
    # Interpolated positions differ from those of the part where a vertex slid into the plane.
    apart = np.linalg.norm((weights @ finger.points) - part.points, axis=1)
    assert apart.max() < 0.7e-3
    assert (apart > 1e-12).sum() < 0.1 * len(apart)
    in_plane = part.points[:, axes[0]] == 0
    assert np.abs((weights @ finger.points)[in_plane, axes[0]]).max() < 1e-10  # of an STL


def test_curved_panels_are_sewn_to_their_images(alone: MPI.Comm) -> None:
    """Half a sphere is no flat panel with a straight border."""
    part, _ = cut_at_planes(surfaces.sphere(), (2,))
    pattern = straightened(unwrap(alone, part).pattern, (2,))
    whole = mirrored(pattern, (2,)).pattern
    whole.require_closed()
    images = tuple(f"{name}, mirrored in z = 0" for name in pattern.panel_names)
    assert whole.panel_names == (*pattern.panel_names, *images)
    assert np.ptp(whole.areas.reshape(2, -1), axis=0).max() < 1e-15


def test_seams_and_parts_are_cut_too() -> None:
    """A box of two parts, with a seam along its top that the plane crosses."""
    corners = np.stack(np.meshgrid([-1.0, 1.0], [0, 1.0], [0, 1.0], indexing="ij"), -1)
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = np.array([(f[0], *f[k : k + 2]) for f in faces for k in (1, 2)])
    parts = np.repeat([0, 1, 1, 1, 1, 1], 2)
    box = Surface(corners.reshape(-1, 3), triangles, parts, ("left", "rest"), np.array([[1, 5]]))
    part, _ = cut_at_planes(box, (0,))
    assert part.part_names == ("rest",)
    np.testing.assert_allclose(np.sort(part.points[part.seams[0]][:, 0]), [0, 1])
    assert part.area == pytest.approx(5.0)
    assert cut_at_planes(part, (0,))[0].area == part.area


def test_what_is_not_symmetric_is_told_by_how_much(finger: Surface) -> None:
    moved = replace(finger, points=finger.points + [0, 1e-3, 0])
    with pytest.raises(
        SurfaceError, match=r"not symmetric about y = 0: a mirrored vertex is 0.00208 m"
    ):
        require_symmetric(moved, 1)


def test_needles_and_caps_are_repaired(alone: MPI.Comm, tmp_path: Path) -> None:
    ball = surfaces.sphere(2)
    points, triangles = ball.points.copy(), ball.triangles
    edges = edges_of(triangles)
    # A needle: a vertex almost at its neighbour. A cap: one split into three, off its centre.
    a, b = edges.ends[100]
    points[a] += (1 - 1e-5) * (points[b] - points[a])
    p, q, r = triangles[200]
    points = np.vstack([points, (points[p] + points[q]) / 2 + 1e-6 * (points[r] - points[p])])
    new = len(points) - 1
    triangles = np.vstack(
        [np.delete(triangles, 200, axis=0), [[p, q, new], [q, r, new], [r, p, new]]]
    )
    assert shapes(points, triangles).min() < 1e-4
    path = write(alone, tmp_path / "bad.obj", points, [("triangle", triangles)])
    found = read_surface(alone, path)
    assert found.repairs == "1 edges collapsed, 1 edges flipped"
    assert shapes(found.points, found.triangles).min() > 1e-3
    assert found.closed
    assert found.area == pytest.approx(ball.area, rel=0.02)


def test_caps_at_a_border_are_dropped_unless_that_tears(alone: MPI.Comm, tmp_path: Path) -> None:
    """The apex inside, the apex on the border too, an ear, and a cap that is all there is."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0.5, 5e-4, 0], [0, 1, 0], [1, 1, 0]])
    triangles = np.array([[0, 1, 2], [0, 2, 3], [2, 1, 4], [2, 4, 3]])
    for kept, dropped in (([0, 1, 2, 3], 1), ([0, 1, 2], 0), ([0, 1], 1), ([0], 0)):
        path = write(alone, tmp_path / "sheet.ply", points, [("triangle", triangles[kept])])
        found = read_surface(alone, path)
        assert found.repairs == ("1 triangles dropped" if dropped else "none")
        assert len(found.triangles) == len(kept) - dropped


@pytest.mark.parametrize("noise", [0, 1e-13, 1e-9, 3e-8])
@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_vertices_are_merged_by_distance(noise: float, unit: float) -> None:
    """Three copies or more of each vertex, apart by a fraction of the size, in any unit."""
    ball = surfaces.sphere(3)
    rng = np.random.default_rng(0)
    size = np.linalg.norm(np.ptp(ball.points, axis=0))
    points = ball.points[ball.triangles].reshape(-1, 3)
    points = points + noise * size / np.sqrt(3) * rng.uniform(-0.5, 0.5, points.shape)
    corners = np.arange(len(points)).reshape(-1, 3)
    replaced_by, kept = weld(unit * points, corners)
    assert len(np.unique(replaced_by)) == len(ball.points)
    assert np.array_equal(kept, np.arange(len(corners)))
    assert len(edges_of(replaced_by[corners]).border) == 0


def test_copies_and_degenerate_triangles_are_left_out() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 1e-9], [5, 5, 5.0]])
    triangles = np.array([[0, 1, 2], [2, 1, 0], [1, 3, 2], [3, 2, 0], [0, 1, 4]])
    replaced_by, kept = weld(points, triangles)
    assert replaced_by.tolist() == [0, 1, 2, 1, 4]
    assert kept.tolist() == [0, 4]


def test_kept_edges_and_borders_of_parts_are_not_repaired() -> None:
    """A cap whose long edge is kept, or divides two parts, stays as it is."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0.5, 1e-5, 0], [0.5, -1, 0], [0.5, 1, 0]])
    triangles = np.array([[0, 1, 2], [1, 0, 3], [2, 1, 4], [0, 2, 4]])
    free = remove_thin(points, triangles, np.zeros(4, dtype=int), np.zeros((0, 2), dtype=int))
    assert free[-1] == {"edges flipped": 1}
    assert shapes(free[0], free[1]).min() > 0.3
    for parts, kept in ((np.array([0, 1, 0, 0]), np.zeros((0, 2), dtype=int)),
                        (np.zeros(4, dtype=int), np.array([[1, 0]]))):  # fmt: skip
        found = remove_thin(points, triangles, parts, kept)
        assert not found[-1]
        assert np.array_equal(found[1], triangles)
