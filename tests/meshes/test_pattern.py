"""Each defect of a pattern has its typed error, which names the place."""

import numpy as np
import pytest
from helpers.scenes import square
from mpi4py import MPI

from toros_fem import errors
from toros_fem.meshes import Pattern, cylinder


def rebuilt(pattern: Pattern, **changes: object) -> Pattern:
    names = ("flat_points", "flat_triangles", "panel", "sewn", "points", "panel_names")
    return Pattern(**{name: changes.get(name, getattr(pattern, name)) for name in names})  # type: ignore[arg-type]


def test_areas_and_topology() -> None:
    sheet = square(n=4, size=0.02)
    assert sheet.areas.sum() == pytest.approx(4e-4, rel=1e-14)
    assert sheet.vertex_areas.sum() == pytest.approx(4e-4, rel=1e-14)
    assert len(sheet.free_edges) == 16
    assert len(sheet.seams) == 0
    with pytest.raises(errors.OpenSkinError, match="16 edges are free"):
        sheet.require_closed()


def test_nan_is_named() -> None:
    flat = square().flat_points.copy()
    flat[7, 1] = np.nan
    with pytest.raises(errors.PatternError, match=r"flat_points\[7\]"):
        rebuilt(square(), flat_points=flat)


def test_degenerate_triangle_is_named() -> None:
    sheet = square()
    flat = sheet.flat_points.copy()
    flat[6] = (flat[5] + flat[7]) / 2 + [0, -(flat[7, 0] - flat[5, 0])]
    flat[0] = (flat[1] + flat[5]) / 2
    with pytest.raises(errors.DegenerateTriangleError, match=r"triangle 0 of panel 0 \('sheet'\)"):
        rebuilt(sheet, flat_points=flat)


def test_vertex_used_twice() -> None:
    sheet = square()
    sewn = sheet.sewn.copy()
    sewn[1] = 0
    with pytest.raises(errors.PatternError):
        rebuilt(sheet, sewn=sewn)
    points = np.delete(sheet.points, 1, axis=0)
    sewn = np.where(sheet.sewn > 1, sheet.sewn - 1, np.minimum(sheet.sewn, 0))
    with pytest.raises(errors.DegenerateTriangleError, match="triangle 0 .* twice"):
        rebuilt(sheet, sewn=sewn, points=points)


def test_clockwise_triangle() -> None:
    triangles = square().flat_triangles.copy()
    triangles[3] = triangles[3, ::-1]
    with pytest.raises(errors.OrientationError, match="triangle 3 .* clockwise"):
        rebuilt(square(), flat_triangles=triangles)


def test_seam_sewn_the_wrong_way() -> None:
    """Two separate triangles sewn along edges that run in the same direction."""
    flat = np.array([[0, 0], [1, 0], [0, 1], [3, 0], [4, 0], [3, 1]], dtype=float)
    sewn = np.array([0, 1, 2, 0, 1, 3])
    with pytest.raises(errors.OrientationError, match="triangles 0 and 1 .* edge 0-1"):
        Pattern(flat, np.array([[0, 1, 2], [3, 4, 5]]), np.array([0, 1]), sewn,
                np.eye(4, 3), ("a", "b"))  # fmt: skip


def test_three_triangles_at_an_edge() -> None:
    flat = np.array([[0, 0], [1, 0], [0, 1]] * 3, dtype=float) + np.repeat(
        [[0, 0], [3, 0], [6, 0]], 3, axis=0
    )
    sewn = np.array([0, 1, 2, 1, 0, 3, 0, 1, 4])
    with pytest.raises(errors.ManifoldError, match="edge between vertices 0 and 1 has 3"):
        Pattern(flat, np.arange(9).reshape(3, 3), np.arange(3), sewn, np.eye(5, 3),
                ("a", "b", "c"))  # fmt: skip


def test_pinched_vertex() -> None:
    flat = np.array([[0, 0], [1, 0], [0, 1], [3, 0], [4, 0], [3, 1]], dtype=float)
    sewn = np.array([0, 1, 2, 0, 3, 4])
    with pytest.raises(errors.ManifoldError, match="vertex 0 .* pinches"):
        Pattern(flat, np.arange(6).reshape(2, 3), np.array([0, 1]), sewn, np.eye(5, 3),
                ("a", "b"))  # fmt: skip


def test_seam_of_unequal_lengths() -> None:
    tube = cylinder(MPI.COMM_SELF, 0.05, 0.02, 5e-3, mesh="structured")
    flat = tube.flat_points.copy()
    cap = np.unique(tube.flat_triangles[tube.cells_of("tip")])
    flat[cap] *= 1.01
    with pytest.raises(errors.SeamError, match="relative difference of 0.0099"):
        rebuilt(tube, flat_points=flat)


def test_panel_shares_points() -> None:
    sheet = square()
    panel = np.zeros(len(sheet.panel), dtype=int)
    panel[5:] = 1
    with pytest.raises(errors.PanelError, match="is used by panels 0 and 1"):
        rebuilt(sheet, panel=panel, panel_names=("a", "b"))
    with pytest.raises(errors.PanelError, match="'b'.* no triangle"):
        rebuilt(sheet, panel_names=("a", "b"))
