"""Surfaces of files that are no oriented manifold; orientation, volume."""

from pathlib import Path

import numpy as np
import pytest
from helpers import surfaces
from helpers.mesh_files import write
from mpi4py import MPI

from toros_fem import errors
from toros_fem.meshes import read_surface
from toros_fem.meshes.surfaces.surface import oriented, volume


def test_surfaces_that_cannot_be_sewn(alone: MPI.Comm, tmp_path: Path) -> None:
    points = np.vstack([np.eye(3), [[0, 0, 0], [1, 1, 1]]])
    path = write(alone, tmp_path / "fin.ply", points,
                 [("triangle", np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]]))])  # fmt: skip
    with pytest.raises(errors.ManifoldError, match=r"more than two triangles.*\[0, 1, 2\]"):
        read_surface(alone, path)
    turn = np.arange(5) * np.pi / 4
    ring = np.column_stack([np.cos(turn), np.sin(turn), np.cos(turn / 2)])
    # Five triangles in a ring, each sharing an edge with the next: a Möbius strip.
    five = np.stack([np.arange(5), (np.arange(5) + 1) % 5, (np.arange(5) + 2) % 5], axis=1)
    path = write(alone, tmp_path / "moebius.ply", ring, [("triangle", five)])
    with pytest.raises(errors.OrientationError, match="one side only"):
        read_surface(alone, path)


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
