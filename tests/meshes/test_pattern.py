"""Patterns, and wholes by mirror images."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest
from helpers.outlines import volume
from helpers.scenes import square
from mpi4py import MPI

from benchmarks.stability.scenes import fan_tube
from toros_fem.base.errors import PatternError
from toros_fem.meshes import finger, mirrored
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.sheets import one_panel


def test_areas_and_topology() -> None:
    sheet = square(n=4, size=0.02)
    assert sheet.areas.sum() == pytest.approx(4e-4, rel=1e-14)
    assert sheet.vertex_areas.sum() == pytest.approx(4e-4, rel=1e-14)
    assert len(sheet.free_edges) == 16
    assert len(sheet.seams) == 0


def check_mirrored(part: Pattern, axes: tuple[int, ...], panels: int) -> Pattern:
    whole = mirrored(part, axes)
    count = 2 ** len(axes)
    assert len(whole.pattern.panel_names) == panels
    assert whole.pattern.areas == pytest.approx(part.areas[whole.cell], rel=1e-12)
    assert len(whole.pattern.panel) == count * len(part.panel)
    assert whole.at_vertices(part.points) == pytest.approx(whole.pattern.points, abs=1e-18)
    assert volume(whole.pattern) == pytest.approx(count * volume(part), rel=1e-12)
    values = np.arange(len(part.panel), dtype=float)
    assert np.bincount(whole.at_cells(values).astype(int)) == pytest.approx(count)
    return whole.pattern


def test_a_whole_is_made_once_and_does_not_outlive_its_part(alone: MPI.Comm) -> None:
    part = finger(alone, 8e-3, planes=(1,))
    kept = weakref.ref(mirrored(part, (1,)))
    assert kept() is mirrored(part, [1])
    mirrored(part, ())
    gone = weakref.ref(part)
    del part
    gc.collect()
    assert gone() is None
    assert kept() is None


def test_mirrored_sheet_and_panels_off_the_plane() -> None:
    """A quarter of a box without a lid: one wall is cut nowhere."""
    side = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    part = Pattern(
        flat_points=np.concatenate([side, side]),
        flat_triangles=np.concatenate([triangles, triangles + 4]),
        panel=np.array([0, 0, 1, 1]),
        sewn=np.array([0, 1, 2, 3, 1, 4, 5, 2]),
        points=np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [1, 0, 1], [1, 1, 1.0]]),
        panel_names=("floor", "wall"),
    )
    whole = check_mirrored(part, (0,), 3)
    assert whole.panel_names == ("floor", "wall", "wall, mirrored in x = 0")
    assert len(whole.seams) == 2


def test_mirrored_half_tube_closes_at_a_second_cut() -> None:
    half = fan_tube(np.linspace(0, np.pi, 9), np.linspace(0, 0.05, 8))
    tube = check_mirrored(half, (1,), 3)
    tube.require_closed()
    # Sewn along one generator and around both caps, which go on across the cut.
    assert len(tube.seams) == 7 + 2 * 16


def test_part_that_reaches_across_its_plane_is_refused() -> None:
    """An L-shaped sheet from x = −1 to 1, whose inner side lies in the plane x = 0."""
    corners = np.array([[-1, 0], [0, 0], [1, 0], [1, 1], [0, 1], [0, 2], [-1, 2], [-1, 1]])
    triangles = np.array([[0, 1, 7], [1, 4, 7], [1, 2, 4], [2, 3, 4], [7, 4, 6], [4, 5, 6]])
    ell = one_panel(corners.astype(float), triangles)
    with pytest.raises(PatternError, match=r"across the plane x = 0 .* vertex 0 lies at x = -1 m"):
        mirrored(ell, (0,))
    half = one_panel(corners[[0, 1, 4, 5, 6, 7]].astype(float), np.array(
        [[0, 1, 5], [1, 2, 5], [5, 2, 4], [2, 3, 4]]))  # fmt: skip
    assert mirrored(half, (0,)).pattern.areas.sum() == pytest.approx(2 * half.areas.sum())
