"""Rectangles and discs of every kind of mesh."""

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem import errors
from toros_fem.meshes import disc, rectangle
from toros_fem.meshes.sheet import KINDS


@pytest.mark.parametrize("kind", KINDS)
def test_rectangles_of_every_kind(comm: MPI.Comm, kind: str) -> None:
    pattern = rectangle(comm, 0.06, 0.04, 0.005, kind)
    assert pattern.areas.sum() == pytest.approx(0.06 * 0.04, rel=1e-12)
    ends = pattern.points[pattern.free_edges]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    assert lengths.sum() == pytest.approx(0.2, rel=1e-12)
    # Euler's formula: a disc, whatever the triangles.
    edges = (3 * len(pattern.panel) + len(ends)) // 2
    assert len(pattern.points) - edges + len(pattern.panel) == 1
    assert lengths.max() < 0.0066
    if kind == "equilateral":  # but for the halves at two borders, and what the width rounds
        assert np.median(pattern.areas) == pytest.approx(np.sqrt(3) / 4 * 0.005**2, rel=0.05)


@pytest.mark.parametrize("kind", ["structured", "unstructured"])
def test_discs(comm: MPI.Comm, kind: str) -> None:
    pattern = disc(comm, 0.02, 0.004, kind)
    sides = round(2 * np.pi * 0.02 / 0.004)
    assert len(pattern.free_edges) == sides
    polygon = 0.5 * sides * 0.02**2 * np.sin(2 * np.pi / sides)
    assert pattern.areas.sum() == pytest.approx(polygon, rel=1e-12)


def test_a_sheet_is_placed_in_space(comm: MPI.Comm) -> None:
    pattern = rectangle(
        comm, 0.02, 0.02, 0.01, place=lambda flat: np.column_stack([flat, flat[:, 0] ** 2])
    )
    assert pattern.points[:, 2] == pytest.approx(pattern.points[:, 0] ** 2)
    with pytest.raises(errors.ParameterError, match="mesh = 'round'"):
        rectangle(comm, 0.02, 0.02, 0.01, "round")
    with pytest.raises(errors.ParameterError, match="edge_length"):
        disc(comm, 0.01, 0.02)
