"""Bending energy against hand values."""

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.materials.sheet import CURVATURES, Bending, Composite, Material
from toros_fem.mechanics.skin.supports import clamp
from toros_fem.mechanics.terms.model import make_model
from toros_fem.meshes import cylinder, sew


@pytest.mark.parametrize("curvature", CURVATURES)
def test_bending_of_a_rolled_sheet(alone: MPI.Comm, curvature: str) -> None:
    """The regular n-gon prism: one hinge of 2 pi / n per triangle, curvature 2 pi / (n chord)."""
    pattern = cylinder(alone, 0.06, 0.02, 4e-3, mesh="structured", caps=None)
    # Without Poisson's ratio the free ends of the prism want no other angle than they have.
    cloth = Material(0.1e6, 0.0, 0.5e-3)
    composite = Composite(
        fabric=cloth, reinforcement=Material(26e6, 0.0, 0.5e-3), bending=Bending(curvature)
    )
    model = make_model(sew(alone, pattern), composite, clamp(pattern, ["wall"]))
    model.set_density(np.zeros(len(model.skin.owned_cells)))
    sides = round(np.pi * 0.02 / 4e-3)
    bend = 2 * np.pi / (sides * 0.02 * np.sin(np.pi / sides))
    D = cloth.thickness**3 / 12 * (cloth.lam + 2 * cloth.mu)
    expected = 0.5 * D * bend**2 * pattern.areas.sum()
    assert model.energy(model.assembled) == pytest.approx(expected, rel=1e-9)
    # Full interpolation: the reinforcement bends by its own modulus.
    model.set_density(np.ones(len(model.skin.owned_cells)))
    assert model.energy(model.assembled) == pytest.approx(expected * 260, rel=1e-9)
