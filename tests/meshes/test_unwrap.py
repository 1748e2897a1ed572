"""Surfaces laid flat: exactly where they are developable, conformally elsewhere."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from helpers import surfaces
from mpi4py import MPI
from scipy.optimize import brentq

from toros_fem import errors
from toros_fem.equilibrium.solver import EquilibriumSolver
from toros_fem.fabrication.contours import panel_outline
from toros_fem.materials import Composite
from toros_fem.mechanics.supports import Supports
from toros_fem.meshes import Surface, sew, unwrap
from toros_fem.meshes.chart import ChartError, lay_flat
from toros_fem.meshes.cut import cut_open, disc_cuts, euler
from toros_fem.meshes.flatten import abf_angles, conformal
from toros_fem.meshes.surface import volume
from toros_fem.meshes.topology import corner_angles, edges_of, lengths


def lengths_kept(surface: Surface, flat: np.ndarray, corners: np.ndarray) -> float:
    """Largest relative difference between flat edges and those in space."""

    def ends(triangles: np.ndarray) -> np.ndarray:
        return np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2)

    wanted = lengths(surface.points, ends(surface.triangles))
    return float(np.abs(lengths(flat, ends(corners)) / wanted - 1).max())


def misfit(flat: np.ndarray, wanted: np.ndarray) -> float:
    """Largest distance after the best similarity, over the size."""
    z, w = flat @ [1, 1j], wanted @ [1, 1j]
    z, w = z - z.mean(), w - w.mean()
    return float(np.abs(np.vdot(z, w) / np.vdot(z, z) * z - w).max() / np.abs(w).max())


@pytest.mark.parametrize("method", ["auto", "exact"])
@pytest.mark.parametrize("make", [surfaces.prism, surfaces.cone])
def test_developable_surfaces_are_unrolled(
    comm: MPI.Comm, make: Callable[[], Surface], method: str
) -> None:
    surface = make()
    made = unwrap(comm, surface, method=method)
    pattern = made.pattern
    assert made.methods == ("exact",)
    assert lengths_kept(surface, pattern.flat_points, pattern.flat_triangles) < 1e-12
    assert made.distortion.worst_stretch < 1e-12
    assert pattern.seam_tolerance == 1e-6
    assert np.array_equal(pattern.triangles, surface.triangles)
    assert len(pattern.seams) == 5


def test_sector_of_a_cone(comm: MPI.Comm) -> None:
    """A pyramid over a regular 12-gon unrolls to twelve triangles around its tip."""
    pattern = unwrap(comm, surfaces.cone(12, 5, 0.01, 0.02)).pattern
    tip = int(np.argmax(pattern.points[:, 2]))
    flat = np.flatnonzero(pattern.sewn == tip)
    assert len(flat) == 1
    at_tip = pattern.flat_triangles == flat[0]
    angle = corner_angles(pattern.flat_points, pattern.flat_triangles)[at_tip].sum()
    slant = np.hypot(0.01, 0.02)
    assert angle == pytest.approx(24 * np.arcsin(0.01 * np.sin(np.pi / 12) / slant), rel=1e-12)


@pytest.mark.parametrize("make", [surfaces.prism, surfaces.cone])
@pytest.mark.parametrize("method", ["abf", "lscm"])
def test_conformal_maps_unroll_too(
    comm: MPI.Comm, make: Callable[[], Surface], method: str
) -> None:
    surface = make()
    exact, made = unwrap(comm, surface), unwrap(comm, surface, method=method)
    assert made.methods == (method,)
    assert misfit(made.pattern.flat_points, exact.pattern.flat_points) < 1e-8
    assert made.distortion.worst_stretch < 1e-8, "the scale is right as well"


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
    assert misfit(flat, image) < 2.5e-3
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


def euler_of(made: Surface) -> int:
    return euler(made.triangles)


@pytest.mark.parametrize(("make", "chi"), [(surfaces.sphere, 2), (surfaces.torus, 0)])
def test_closed_surfaces_are_cut_to_discs(make: Callable[[], Surface], chi: int) -> None:
    surface = make()
    assert euler_of(surface) == chi
    edges = edges_of(surface.triangles)
    seams = np.zeros(len(edges.ends), dtype=bool)
    seams[disc_cuts(surface.points, surface.triangles, tips=False)] = True
    cut = cut_open(surface.triangles, edges, seams)
    assert cut.chart.max() == 0
    assert euler(cut.triangles) == 1
    border = edges_of(cut.triangles)
    ends = border.ends[border.border]
    assert np.bincount(ends.ravel()).max() == 2, "one loop"
    if chi == 0:  # around the tube and around its inside: the shortest pair of loops
        shortest = 24 * 2 * 0.013 * np.sin(np.pi / 24) + 12 * 2 * 0.007 * np.sin(np.pi / 12)
        assert lengths(surface.points, edges.ends[seams]).sum() < 1.3 * shortest


@pytest.mark.parametrize("method", ["auto", "lscm"])
@pytest.mark.parametrize("make", [surfaces.sphere, surfaces.torus])
def test_closed_surfaces_become_panels(
    comm: MPI.Comm, make: Callable[[], Surface], method: str
) -> None:
    surface = make()
    made = unwrap(comm, surface, method=method)
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
    outlines = [panel_outline(pattern, k) for k in range(len(made.methods))]
    assert all(o.geom_type == "Polygon" and not len(o.interiors) for o in outlines)
    assert not any(a.intersects(b) for i, a in enumerate(outlines) for b in outlines[:i])
    again = unwrap(comm, surface, method=method)
    assert np.array_equal(again.pattern.flat_points, pattern.flat_points)


def test_a_tighter_bound_gives_more_panels(comm: MPI.Comm) -> None:
    counts = [
        len(unwrap(comm, surfaces.sphere(), max_stretch=bound).methods)
        for bound in (0.3, 0.15, 0.08)
    ]
    assert counts == sorted(counts)
    assert counts[0] < counts[2]


def welded_box() -> Surface:
    points, triangles = surfaces.box(3)
    place, number = np.unique(points.round(12), axis=0, return_inverse=True)
    return Surface(place, number.ravel()[triangles])


def test_box_is_cut_at_its_creases(comm: MPI.Comm) -> None:
    made = unwrap(comm, welded_box())
    assert made.methods == ("exact",) * 6
    assert made.distortion.worst_stretch < 1e-12
    assert np.bincount(made.pattern.panel, made.pattern.areas) == pytest.approx(
        np.repeat([6e-4, 3e-4, 2e-4], 2)[np.argsort(np.argsort(
            -np.bincount(made.pattern.panel, made.pattern.areas), kind="stable"))]
    )  # fmt: skip
    # Without creases it is one panel, cut through its eight corners.
    whole = unwrap(comm, welded_box(), crease_angle=np.pi)
    assert set(whole.methods) == {"exact"}
    assert len(whole.methods) <= 2


def test_seams_of_the_user(comm: MPI.Comm) -> None:
    tube = surfaces.prism(12, 5)
    around = np.arange(24, 36)
    ring = np.stack([around, np.roll(around, -1)], axis=1)
    made = unwrap(comm, tube, seams=ring)
    assert len(made.methods) == 2
    assert made.pattern.panel_names == ("panel-1", "panel-2")
    assert np.bincount(made.pattern.panel).tolist() == [48, 72]
    assert len(made.seams) == 12 + 5
    closed = unwrap(comm, surfaces.sphere(), seams=[])
    assert len(closed.methods) == 1, "no seam is added but what opens it to a disc"
    named = replace(tube, parts=(np.arange(120) >= 48).astype(int), part_names=("hand", "cuff"))
    assert unwrap(comm, named).pattern.panel_names == ("hand", "cuff")
    assert len(unwrap(comm, named, seams="auto").methods) == 1


def test_wrong_requests(comm: MPI.Comm) -> None:
    tube = surfaces.prism(12, 5)
    for seams, match in (
        ([[0, 72]], r"seams\[0\] = \[0, 72\] names no vertices; they lie in 0 … 71"),
        ([[0, 1], [0, 30]], r"seams\[1\] = \[0, 30\] is no edge"),
        ([0, 1], r"pairs of vertices"),
        ([[0.5, 1]], r"pairs of vertices"),
    ):
        with pytest.raises(errors.SurfaceError, match=match):
            unwrap(comm, tube, seams=seams)
    with pytest.raises(errors.ParameterError, match="seams = 'none'"):
        unwrap(comm, tube, seams="none")
    with pytest.raises(errors.ParameterError, match="method = 'best'"):
        unwrap(comm, tube, method="best")
    with pytest.raises(errors.ParameterError, match="max_stretch"):
        unwrap(comm, tube, max_stretch=0)
    cap, _ = surfaces.cap(4, 1.0)
    with pytest.raises(errors.SurfaceError, match="not developable.*miss 2π by 0.0"):
        unwrap(comm, cap, method="exact")


def test_a_strip_that_would_overlap_is_parted(comm: MPI.Comm) -> None:
    """A helicoidal ramp of two turns is developable here, but lies over itself when flat."""
    turn = np.linspace(0, 4 * np.pi, 49)
    ring = np.column_stack([np.cos(turn), np.sin(turn), 0.02 * turn])
    points = np.concatenate([ring, ring * [2, 2, 1]]) * 0.01
    k = np.arange(48)
    triangles = np.concatenate(
        [np.stack([k, k + 49, k + 1], 1), np.stack([k + 1, k + 49, k + 50], 1)]
    )
    made = unwrap(comm, Surface(points, triangles), seams=[])
    assert made.methods in (("exact",) * 2, ("exact",) * 3)
    assert made.distortion.worst_stretch < 1e-12


def test_slivers_are_named() -> None:
    """A flat triangle of no use, though none is turned over."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0.5, 1e-6, 0], [0.5, -1, 0]])
    triangles = np.array([[0, 1, 2], [1, 0, 3]])
    for method in ("exact", "lscm"):
        with pytest.raises(ChartError, match="1 of its 2 triangles are slivers"):
            lay_flat(points, triangles, np.zeros((2, 3), dtype=bool), method, np.inf, tips=False)


def test_sphere_of_panels_inflates(comm: MPI.Comm) -> None:
    """Sewn from stress-free flat panels it finds an equilibrium near the sphere.

    Of a sphere of eq. (1), h ψ'(λ) = P R λ² with both stretches λ. What the panels fit worse than a
    sphere's skin costs some of the growth.
    """
    surface = surfaces.sphere(2)
    made = unwrap(comm, surface)
    skin = sew(comm, made.pattern)
    composite = Composite(bending=None)
    fixed = np.zeros((len(surface.points), 3), dtype=bool)
    fixed[0], fixed[3, [0, 2]], fixed[8, 2] = True, True, True  # just no rigid motion
    solver = EquilibriumSolver(skin, composite, Supports(fixed))
    pressure, fabric = 1e3, composite.fabric
    result = solver.solve(np.zeros(len(skin.owned_cells)), pressure)
    assert result.converged
    a, b = (composite.c1 - 1) ** 2, (composite.c2 - 1) ** 2

    def out_of_balance(e: float) -> float:
        slope = 4 * fabric.mu * e / (1 - e**2 / a) + 4 * fabric.lam * e / (1 - 4 * e**2 / b)
        return fabric.thickness * slope - pressure * 0.01 * (1 + e) ** 2

    growth = brentq(out_of_balance, 0, 0.3)
    swollen = (result.volume / volume(surface.points, surface.triangles)) ** (1 / 3)
    assert growth > 0.07
    assert swollen == pytest.approx(1 + growth, rel=0.01)
