"""Surfaces laid flat: exactly where they are developable, conformally elsewhere."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from helpers import surfaces
from mpi4py import MPI
from scipy.optimize import brentq

from toros_fem import errors
from toros_fem.making.print.contours import panel_outline
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes import Surface, sew, unwrap
from toros_fem.meshes.surface import volume
from toros_fem.meshes.topology import corner_angles, lengths


def lengths_kept(surface: Surface, flat: np.ndarray, corners: np.ndarray) -> float:
    """Largest relative difference between flat edges and those in space."""

    def ends(triangles: np.ndarray) -> np.ndarray:
        return np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2)

    wanted = lengths(surface.points, ends(surface.triangles))
    return float(np.abs(lengths(flat, ends(corners)) / wanted - 1).max())


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
    assert surfaces.misfit(made.pattern.flat_points, exact.pattern.flat_points) < 1e-8
    assert made.distortion.worst_stretch < 1e-8, "the scale is right as well"


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


def test_box_is_cut_at_its_creases(comm: MPI.Comm) -> None:
    made = unwrap(comm, surfaces.welded_box(3))
    assert made.methods == ("exact",) * 6
    assert made.distortion.worst_stretch < 1e-12
    assert np.bincount(made.pattern.panel, made.pattern.areas) == pytest.approx(
        np.repeat([6e-4, 3e-4, 2e-4], 2)[np.argsort(np.argsort(
            -np.bincount(made.pattern.panel, made.pattern.areas), kind="stable"))]
    )  # fmt: skip
    # Without creases it is one panel, cut through its eight corners.
    whole = unwrap(comm, surfaces.welded_box(3), crease_angle=np.pi)
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
