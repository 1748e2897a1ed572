"""Coefficients of the forms."""

import numpy as np
import pytest
from helpers.scenes import square
from mpi4py import MPI

from toros_fem.materials.sheet import Bending, Material
from toros_fem.mechanics.skin.coefficients import edge_coefficients, sheet_stiffness
from toros_fem.mechanics.skin.hinges import find_hinges
from toros_fem.mechanics.skin.supports import Supports, clamp, symmetry_plane
from toros_fem.meshes import Skin, sew


def test_stiffness_of_a_sheet(tube: Skin) -> None:
    """Membrane h, bending h³/12 times the plane-stress Lamé parameters."""
    sheet = Material(2e6, 0.25, 2e-3)
    found = sheet_stiffness(tube.mesh, sheet)
    mu, lam = 2e6 / 2.5, 2e6 * 0.25 / (1 - 0.0625)
    assert float(found.mu.value) == pytest.approx(2e-3 * mu)
    assert float(found.lam.value) == pytest.approx(2e-3 * lam)
    assert float(found.mu_bend.value) == pytest.approx(8e-9 / 12 * mu)
    assert float(found.lam_bend.value) == pytest.approx(8e-9 / 12 * lam)


def test_edges_have_only_the_constants_that_they_need(tube: Skin, comm: MPI.Comm) -> None:
    fixed = clamp(tube.pattern, ["base"])
    plain = find_hinges(tube, Bending("average"), fixed, 0.3)
    edges = edge_coefficients(tube, plain, rotations=False)
    assert (edges.rests, edges.turns, edges.mirrors) == (None, None, None)
    moulded = find_hinges(tube, Bending(rest="assembled"), fixed, 0.3)
    edges = edge_coefficients(tube, moulded, rotations=True)
    assert edges.rests is not None
    assert edges.turns is not None
    assert edges.mirrors is None
    values = edges.tensors[0].x.array.reshape(-1, 3)
    row = edges.tensors[0].function_space.dofmap.list[:, 0]
    assert np.array_equal(values[row], moulded.tensors[:, 0])
    half = square()
    skin = sew(comm, half)
    supports = symmetry_plane(half, 0) | Supports(np.ones(half.points.shape, dtype=bool))
    mirrored = edge_coefficients(skin, find_hinges(skin, Bending(), supports, 0.3), rotations=True)
    assert mirrored.mirrors is not None
