"""What the default membrane leaves as it is, to the bit."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.models import affine, drawn, sheet_model
from helpers.pillow import COMPOSITE
from mpi4py import MPI

from toros_fem.materials.sheet import Bending, Composite, Membrane
from toros_fem.meshes import Skin


def density_of(skin: Skin) -> np.ndarray:
    values = np.random.default_rng(3).uniform(0.1, 0.9, len(skin.pattern.panel))
    return np.asarray(values[skin.owned_cells])


@pytest.mark.parametrize("bending", [None, Bending()])
def test_default_is_eq_1_to_the_bit(alone: MPI.Comm, bending: Bending | None) -> None:
    """No membrane given, the default one, and one with another unused residual stiffness."""
    plain = replace(COMPOSITE, membrane=Membrane(), bending=bending)
    composites = (
        Composite(fabric=plain.fabric, reinforcement=plain.reinforcement, c1=1.8, c2=2.0,
                  bending=bending),
        plain,
        replace(plain, membrane=Membrane(residual_stiffness=1e-2)),
    )  # fmt: skip
    seen = []
    for composite in composites:
        model = sheet_model(alone, composite)
        model.set_density(density_of(model.skin))
        state = affine(model, np.array([[1.1, 0.05], [0, 0.9], [0.02, 0.0]]))
        state += 1e-4 * drawn(model, 2)
        seen.append((model.energy(state), model.residual(state)))
    for energy, residual in seen[1:]:
        assert energy == seen[0][0]
        assert np.array_equal(residual, seen[0][1])
