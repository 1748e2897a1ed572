"""Sewing patterns from surfaces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from helpers import surfaces
from helpers.scenes import square
from mpi4py import MPI

from toros_fem.base.errors import SurfaceError
from toros_fem.meshes import Pattern, Surface, cylinder, unwrap
from toros_fem.meshes.seams import cut_open
from toros_fem.meshes.triangles import corner_angles, edges_of, flat_areas, lengths
from toros_fem.meshes.unwrapped import (
    ChartError,
    Distortion,
    abf_angles,
    closure_error,
    conformal,
    lay_flat,
    triangle_stretches,
    unrolled,
)


def lengths_kept(surface: Surface, flat: np.ndarray, corners: np.ndarray) -> float:
    """Largest relative difference between flat edges and those in space."""

    def ends(triangles: np.ndarray) -> np.ndarray:
        return np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2)

    wanted = lengths(surface.points, ends(surface.triangles))
    return float(np.abs(lengths(flat, ends(corners)) / wanted - 1).max())


@pytest.mark.parametrize("method", ["auto", "exact"])
@pytest.mark.parametrize("make", [surfaces.prism, surfaces.cone])
def test_developable_surfaces_are_unrolled(
    alone: MPI.Comm, make: Callable[[], Surface], method: str
) -> None:
    surface = make()
    made = unwrap(alone, surface, method=method)
    pattern = made.pattern
    assert made.methods == ("exact",)
    assert lengths_kept(surface, pattern.flat_points, pattern.flat_triangles) < 1e-12
    assert made.distortion.worst_stretch < 1e-12
    assert pattern.seam_tolerance == 1e-6
    assert np.array_equal(pattern.triangles, surface.triangles)
    assert len(pattern.seams) == 5


@pytest.mark.parametrize("make", [surfaces.prism, surfaces.cone])
@pytest.mark.parametrize("method", ["abf", "lscm"])
def test_conformal_maps_unroll_too(
    alone: MPI.Comm, make: Callable[[], Surface], method: str
) -> None:
    surface = make()
    exact, made = unwrap(alone, surface), unwrap(alone, surface, method=method)
    assert made.methods == (method,)
    assert surfaces.misfit(made.pattern.flat_points, exact.pattern.flat_points) < 1e-8
    assert made.distortion.worst_stretch < 1e-8, "the scale is right as well"


@pytest.mark.parametrize(("make", "method"), [(surfaces.sphere, "auto"), (surfaces.torus, "lscm")])
def test_closed_surfaces_become_panels(
    alone: MPI.Comm, make: Callable[[], Surface], method: str
) -> None:
    surface = make()
    made = unwrap(alone, surface, method=method)
    pattern = made.pattern
    pattern.require_closed()
    assert 2 <= len(made.methods) <= 12
    assert np.mean(made.distortion.strain <= 0.15) > 0.97
    assert pattern.areas.sum() == pytest.approx(surface.area, rel=1e-12)
    for k in range(len(made.methods)):  # each panel has its own area too
        cells = pattern.panel == k
        ratio = np.average(made.distortion.area_ratio[cells], weights=pattern.areas[cells])
        assert ratio == pytest.approx(1, rel=1e-10)
    assert pattern.seam_tolerance == pytest.approx(made.distortion.worst_seam, rel=1e-6)
    assert f"seam: {made.distortion.worst_seam:.2%}" in made.distortion.table()
    outlines = [pattern.outline(k) for k in range(len(made.methods))]
    assert all(o.geom_type == "Polygon" and not len(o.interiors) for o in outlines)
    assert not any(a.intersects(b) for i, a in enumerate(outlines) for b in outlines[:i])
    again = unwrap(alone, surface, method=method)
    assert np.array_equal(again.pattern.flat_points, pattern.flat_points)


def test_box_is_cut_at_its_creases(alone: MPI.Comm) -> None:
    made = unwrap(alone, surfaces.welded_box(3))
    assert made.methods == ("exact",) * 6
    assert made.distortion.worst_stretch < 1e-12
    assert np.bincount(made.pattern.panel, made.pattern.areas) == pytest.approx(
        np.repeat([6e-4, 3e-4, 2e-4], 2)[np.argsort(np.argsort(
            -np.bincount(made.pattern.panel, made.pattern.areas), kind="stable"))]
    )  # fmt: skip
    # Without creases it is one panel, cut through its eight corners.
    whole = unwrap(alone, surfaces.welded_box(3), crease_angle=np.pi)
    assert set(whole.methods) == {"exact"}
    assert len(whole.methods) <= 2


def test_seams_of_the_user(alone: MPI.Comm) -> None:
    tube = surfaces.prism(12, 5)
    around = np.arange(24, 36)
    ring = np.stack([around, np.roll(around, -1)], axis=1)
    made = unwrap(alone, tube, seams=ring)
    assert len(made.methods) == 2
    assert made.pattern.panel_names == ("panel-1", "panel-2")
    assert np.bincount(made.pattern.panel).tolist() == [48, 72]
    assert len(made.seams) == 12 + 5
    closed = unwrap(alone, surfaces.sphere(), seams=[])
    assert len(closed.methods) == 1, "no seam is added but what opens it to a disc"
    named = replace(tube, parts=(np.arange(120) >= 48).astype(int), part_names=("hand", "cuff"))
    assert unwrap(alone, named).pattern.panel_names == ("hand", "cuff")
    assert len(unwrap(alone, named, seams="auto").methods) == 1


def test_a_strip_that_would_overlap_is_divided(alone: MPI.Comm) -> None:
    """A helicoidal ramp of two turns is developable here, but lies over itself when flat."""
    made = unwrap(alone, surfaces.ramp(), seams=[])
    assert made.methods in (("exact",) * 2, ("exact",) * 3)
    assert made.distortion.worst_stretch < 1e-12


def test_a_tighter_bound_gives_more_panels(alone: MPI.Comm) -> None:
    counts = [
        len(unwrap(alone, surfaces.sphere(), max_stretch=bound).methods)
        for bound in (0.3, 0.15, 0.08)
    ]
    assert counts == sorted(counts)
    assert counts[0] < counts[2]


def test_slivers_are_named() -> None:
    """A flat triangle of no use, though none is turned over."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0.5, 1e-6, 0], [0.5, -1, 0]])
    triangles = np.array([[0, 1, 2], [1, 0, 3]])
    for method in ("exact", "lscm"):
        with pytest.raises(ChartError, match="1 of its 2 triangles are slivers"):
            lay_flat(points, triangles, np.zeros((2, 3), dtype=bool), method, np.inf, tips=False)


def uncut(triangles: np.ndarray) -> np.ndarray:
    return np.zeros(triangles.shape, dtype=bool)


def test_regions_that_are_refused() -> None:
    cap, _ = surfaces.cap(6, 1.3)
    with pytest.raises(ChartError, match=r"stretch of 0\.\d+ exceeds 0.01"):
        lay_flat(cap.points, cap.triangles, uncut(cap.triangles), "abf", 0.01, tips=False)
    with pytest.raises(SurfaceError, match=r"216 triangles is not developable: .* 'auto'"):
        lay_flat(cap.points, cap.triangles, uncut(cap.triangles), "exact", np.inf, tips=False)
    ball = surfaces.sphere(2)
    with pytest.raises(ChartError, match="closed and round"):
        lay_flat(ball.points, ball.triangles, uncut(ball.triangles), "auto", np.inf, tips=True)
    ramp = surfaces.ramp()
    with pytest.raises(ChartError, match="border overlaps itself"):
        lay_flat(ramp.points, ramp.triangles, uncut(ramp.triangles), "exact", np.inf, tips=False)


@pytest.mark.parametrize("method", ["auto", "lscm"])
def test_a_tube_gets_one_slit_and_keeps_its_area(method: str) -> None:
    tube = surfaces.prism(12, 5)
    corners, slits, used = lay_flat(
        tube.points, tube.triangles, uncut(tube.triangles), method, np.inf, tips=False
    )
    assert used == ("exact" if method == "auto" else method)
    assert slits.sum() == 2 * 5, "both sides of a line of five edges"
    areas = flat_areas(corners)
    assert areas.min() > 0
    assert areas.sum() == pytest.approx(tube.area, rel=1e-9)
    _, more, _ = lay_flat(tube.points, tube.triangles, slits, method, np.inf, tips=False)
    assert not more.any(), "what is cut already is not cut again"


def test_names_of_panels_do_not_collide(alone: MPI.Comm) -> None:
    """A part of several panels beside one that is named like one of these, or like a number."""
    box = surfaces.welded_box(2)
    side = np.argmax(
        np.abs(np.cross(*np.diff(box.points[box.triangles], axis=1).swapaxes(0, 1))), 1
    )
    for names in (("arm", "arm-1", "arm-2"), ("arm-2", "arm", "arm-1"), ("a", "a-1", "a-1-1")):
        made = unwrap(alone, replace(box, parts=side, part_names=names))
        assert len(set(made.pattern.panel_names)) == 6
        assert all(any(n.startswith(part) for part in names) for n in made.pattern.panel_names)
    # Of the first part two rings are apart, and "arm-1" is taken.
    tube = surfaces.prism(12, 5)
    rows = np.repeat([0, 0, 1, 2, 0], len(tube.triangles) // 5)
    found = unwrap(alone, replace(tube, parts=rows, part_names=("arm", "arm-1", "arm-2")))
    assert found.pattern.panel_names == ("arm-3", "arm-4", "arm-1", "arm-2")


@pytest.mark.parametrize("method", ["abf", "lscm"])
def test_spherical_cap_against_the_stereographic_map(method: str) -> None:
    """Angles converge at first order, the scale between centre and rim at second order."""
    wrong, scale = [], []
    for rows in (4, 8, 16):
        surface, image = surfaces.cap(rows, np.radians(60))
        angles = corner_angles(surface.points, surface.triangles)
        wanted = abf_angles(surface.triangles, angles) if method == "abf" else angles
        flat = conformal(surface.triangles, wanted)
        found = corner_angles(flat, surface.triangles)
        wrong.append(np.abs(found - angles).mean())
        k = rows // 2
        half, rim = slice(1 + 3 * k * (k - 1), 1 + 3 * k * (k + 1)), slice(-6 * rows, None)
        size = [np.sqrt(np.mean(np.sum((flat[ring] - flat[0]) ** 2, axis=1)))
                for ring in (half, rim)]  # fmt: skip
        exact = np.linalg.norm(image[[half.start, -1]], axis=1)
        scale.append(abs(size[1] / size[0] / (exact[1] / exact[0]) - 1))
    assert surfaces.misfit(flat, image) < 2.5e-3
    assert np.log2(wrong[1] / wrong[2]) > 0.98
    assert np.log2(scale[1] / scale[2]) == pytest.approx(2, abs=0.05)
    assert scale[2] < 2e-4


def test_abf_meets_its_constraints() -> None:
    surface, _ = surfaces.cap(8, np.radians(80))
    triangles = surface.triangles
    found = abf_angles(triangles, corner_angles(surface.points, triangles))
    assert found.sum(axis=1) == pytest.approx(np.pi, abs=1e-12)
    inner = slice(0, len(surface.points) - 48)
    around = np.bincount(triangles.ravel(), found.ravel())[inner]
    assert around == pytest.approx(2 * np.pi, abs=1e-11)
    laid = corner_angles(conformal(triangles, found), triangles)
    assert laid == pytest.approx(found, abs=1e-9), "wheels close, so that it can be laid out"


def test_fine_tube_unrolls_to_rounding() -> None:
    """Rounding must not grow from triangle to triangle: here it grew by 12 orders."""
    surface = surfaces.prism(around=80, rows=60, radius=0.01, length=0.1)
    edges = edges_of(surface.triangles)
    seam = np.abs(surface.points[:, 1]) + np.maximum(0, -surface.points[:, 0]) < 1e-9
    triangles, sewn = cut_open(surface.triangles, edges, seam[edges.ends].all(axis=1))
    points = surface.points[sewn]
    flat = unrolled(points, triangles)
    assert closure_error(points, flat, triangles) < 1e-12
    assert np.ptp(flat, axis=0).max() == pytest.approx(0.1, rel=1e-12)


def test_stretches_of_an_affine_map() -> None:
    """λ = 1.2 and 0.9 in turned directions, then any rigid motion in space."""
    rng = np.random.default_rng(5)
    turn = np.linalg.qr(rng.normal(size=(2, 2)))[0]
    frame = np.linalg.qr(rng.normal(size=(3, 3)))[0][:2]
    flat = square(n=3).corners
    stretched = flat @ turn @ np.diag([1.2, 0.9]) @ frame + rng.normal(size=3)
    found = triangle_stretches(flat, stretched)
    assert found == pytest.approx(np.tile([1.2, 0.9], (len(flat), 1)), rel=1e-12)


def test_stretched_sheet() -> None:
    flat = square(n=4, size=0.02)
    sheet = square(np.pad(flat.flat_points * [1.25, 0.8], ((0, 0), (0, 1))), n=4, size=0.02)
    found = Distortion(sheet)
    assert found.strain == pytest.approx(0.25, rel=1e-12)
    assert found.worst_stretch == pytest.approx(0.25, rel=1e-12)
    assert found.mean_stretch == pytest.approx(0.25, rel=1e-12)
    assert found.area_ratio == pytest.approx(1, rel=1e-12)
    # The legs 1 : 1 of each right triangle become 1.25 : 0.8.
    assert found.angle_error == pytest.approx(np.arctan(1.25 / 0.8) - np.pi / 4, rel=1e-12)
    assert found.worst_seam == 0
    rows = found.table().splitlines()
    assert len(rows) == 2 + 2 + 1
    assert rows[2].split()[:3] == ["sheet", "32", "4.00"]
    assert "25.00%" in rows[3]


def test_seam_gap_of_gathered_cloth() -> None:
    """The tip's disc is cut 2 % too large, so that it is gathered at its seam."""
    tube = cylinder(MPI.COMM_SELF, 0.05, 0.02, 5e-3, mesh="structured")
    flat = tube.flat_points.copy()
    flat[np.unique(tube.flat_triangles[tube.cells_of("tip")])] *= 1.02
    gathered = Pattern(
        flat, tube.flat_triangles, tube.panel, tube.sewn, tube.points, tube.panel_names, 0.05
    )
    found = Distortion(gathered)
    assert found.worst_seam == pytest.approx(1 - 1 / 1.02, rel=1e-9)
    tip = gathered.panel == tube.panel_index("tip")
    assert found.strain[tip] == pytest.approx(0.02, rel=1e-9)
    assert found.strain[~tip].max() < 1e-12


@pytest.mark.slow
def test_conformal_maps_of_fine_surfaces(alone: MPI.Comm) -> None:
    """A fine cone, which is developable, keeps its lengths, and angles by ABF++ are laid out."""
    cone = surfaces.cone(120, 60)
    laid = unwrap(alone, cone, method="lscm")
    assert len(cone.triangles) > 14_000
    assert laid.distortion.worst_stretch < 1e-7
    cap, _ = surfaces.cap(40, np.radians(60))
    wanted = abf_angles(cap.triangles, corner_angles(cap.points, cap.triangles))
    found = corner_angles(conformal(cap.triangles, wanted), cap.triangles)
    assert found == pytest.approx(wanted, abs=1e-9)
