"""Parts of surfaces at symmetry planes, of meshes that are not symmetric themselves."""

from dataclasses import replace

import numpy as np
import pytest
from helpers import surfaces
from helpers.scenes import ROOT
from mpi4py import MPI

from toros_fem.base.errors import SurfaceError
from toros_fem.meshes import mirrored, read_surface, unwrap
from toros_fem.meshes.surfaces.planes import (
    asymmetry,
    cut_at_planes,
    require_symmetric,
    straightened,
)
from toros_fem.meshes.surfaces.surface import Surface, volume
from toros_fem.meshes.triangles import shapes


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
