"""Meshes beyond a number of triangles are refused before they are made."""

from collections.abc import Callable

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.base.errors import MeshSizeError
from toros_fem.meshes import cylinder, disc, finger, rectangle, tile, triangle_limit
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.refine import refine
from toros_fem.meshes.triangle_limit import expected_triangles

TINY = 1e-7
MAKERS: dict[str, Callable[[MPI.Comm, float], object]] = {
    "tube": lambda comm, h: cylinder(comm, 0.15, 0.02, h),
    "rows": lambda comm, h: cylinder(comm, 0.15, 0.02, h, mesh="structured"),
    "finger": lambda comm, h: finger(comm, h, length=0.09, width=0.025, root=0.015),
    "tile": lambda comm, h: tile(comm, 0.01, h),
    "unstructured tile": lambda comm, h: tile(comm, 0.01, h, "unstructured"),
    "rectangle": lambda comm, h: rectangle(comm, 0.1, 0.1, h),
    "disc": lambda comm, h: disc(comm, 0.1, h, "unstructured"),
}


@pytest.mark.parametrize("name", list(MAKERS))
def test_too_fine_meshes_are_refused(alone: MPI.Comm, name: str) -> None:
    with pytest.raises(MeshSizeError, match=r"triangles on .* more than 2000000. Give at least"):
        MAKERS[name](alone, TINY)


def test_the_edge_length_that_the_message_gives_is_accepted(alone: MPI.Comm) -> None:
    with triangle_limit(2000):
        with pytest.raises(MeshSizeError, match="Give at least") as caught:
            cylinder(alone, 0.15, 0.02, 1e-3)
        longest = float(str(caught.value).split("Give at least ")[1].split(" m")[0])
        assert len(cylinder(alone, 0.15, 0.02, 1.05 * longest).panel) < 2300


def test_the_limit_can_be_lifted_and_comes_back(alone: MPI.Comm) -> None:
    with triangle_limit(100):
        with triangle_limit(None):
            assert len(cylinder(alone, 0.06, 0.02, 5e-3).panel) > 300
        with pytest.raises(MeshSizeError):
            cylinder(alone, 0.06, 0.02, 5e-3)
    assert len(cylinder(alone, 0.06, 0.02, 5e-3).panel) > 300


@pytest.mark.parametrize("edge", [5e-3, 2.5e-3])
def test_expected_number(alone: MPI.Comm, edge: float) -> None:
    """The number is that of gmsh's meshes to a tenth."""
    pattern: Pattern = cylinder(alone, 0.15, 0.02, edge)
    count = len(pattern.panel)
    assert np.isclose(expected_triangles(pattern.areas.sum(), edge), count, rtol=0.1)


def test_refinements_and_copies_keep_the_limit(alone: MPI.Comm) -> None:
    with triangle_limit(1000):
        sheet = tile(alone, 0.01, 1e-3)
        with pytest.raises(MeshSizeError, match="triangles are more than 1000") as caught:
            sheet.repeated(10, 1)
        assert caught.value.area == pytest.approx(10 * 0.01**2)
        with pytest.raises(MeshSizeError, match="triangles are more than 1000") as caught:
            refine(refine(sheet.pattern).pattern)
        assert caught.value.area == pytest.approx(0.01**2)
