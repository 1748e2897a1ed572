"""Derivatives of a pulled sheet's stress and width by the moduli: Taylor tests, exact laws."""

import numpy as np
import pytest
from helpers.tensile_tests import JERSEY
from mpi4py import MPI

from toros_fem.materials.sheet import Composite, Material
from toros_fem.mechanics.equilibrium.options import NewtonOptions
from toros_fem.meshes import rectangle, sew
from toros_fem.products.fitting.printed_sheet import PrintedSheet

COMPOSITE = Composite(JERSEY, Material(3e6, 0.25, 0.5e-3), c1=1.9, c2=2.2, bending=None)
STRAINS = np.array([0.05, 0.3])
EXACT = NewtonOptions(tolerance=1e-12)


def strip(comm: MPI.Comm, axis: int = 0) -> PrintedSheet:
    """A strip of 4 cm × 2 cm with random triangles printed."""
    pattern = rectangle(comm, 0.04, 0.02, 0.005, "crossed")
    skin = sew(comm, pattern)
    printed = np.random.default_rng(1).random(len(pattern.panel)) < 0.4
    density = printed.astype(float)[skin.owned_cells]
    return PrintedSheet(skin, COMPOSITE, density, axis, 0.01, EXACT)


@pytest.mark.parametrize("axis", [0, 1])
def test_taylor(alone: MPI.Comm, axis: int) -> None:
    """The error of the first order falls with the square of the step, or faster by chance."""
    sheet, base = strip(alone, axis), np.array([1.3, 0.8])
    values, slopes = sheet.curve(base, STRAINS)
    rng = np.random.default_rng(axis)
    direction = rng.uniform(0.5, 1.0, 2) * np.array([1, -1])
    errors = []
    for step in (0.1, 0.05, 0.025):
        there, _ = sheet.curve(base * np.exp(step * direction), STRAINS)
        errors.append((there - values - step * slopes @ direction) / values)
    rates = np.log2(np.abs(np.array(errors)[:-1] / np.array(errors)[1:]))
    assert rates.min() > 1.85


def test_both_moduli_scale_the_force_alone(alone: MPI.Comm) -> None:
    """The force is homogeneous in both moduli, and the shape depends on their ratio only."""
    values, slopes = strip(alone).curve(np.array([0.7, 2.0]), STRAINS)
    assert slopes.sum(axis=2)[0] == pytest.approx(values[0], rel=1e-9)
    assert slopes.sum(axis=2)[1] == pytest.approx(0.0, abs=1e-9)
    assert (slopes[0] > 0.02 * values[0][:, None]).all()
