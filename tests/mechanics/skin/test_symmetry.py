"""A part of a skin at its symmetry planes does what the whole does."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.models import pressurize
from helpers.scenes import TABLE_A, table
from mpi4py import MPI

from toros_fem.base.mpi import dot
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.skin.supports import Supports, symmetry_plane
from toros_fem.mechanics.terms.model import make_model
from toros_fem.meshes import Pattern, cylinder, sew

LENGTH, RADIUS = 0.03, 0.01


def moved(pattern: Pattern, by: tuple[float, ...]) -> Pattern:
    return replace(pattern, points=pattern.points + by)


def between(pattern: Pattern, at: tuple[float, ...], heights: tuple[float, float]) -> Supports:
    """Two planes across the tube, at heights over `at`; y fixed where the tube meets y = 0."""
    x, y, _ = (pattern.points - at).T
    fixed = np.zeros((len(x), 3), dtype=bool)
    ends = [np.isclose(np.abs(x), RADIUS) & np.isclose(y, 0)]
    fixed[np.concatenate([np.flatnonzero(rim) for rim in ends]), 1] = True
    fixed[np.argmin(np.abs(pattern.points - at - [-RADIUS, 0, heights[1]]).sum(axis=1)), 0] = True
    supports = Supports(fixed)
    for height in heights:
        supports |= symmetry_plane(pattern, 2, at[2] + height)
    return supports


@pytest.mark.parametrize("stretch", ["1.2", "1.4"])
def test_section_of_an_endless_tube(alone: MPI.Comm, stretch: str) -> None:
    """In plane strain: the hoop force N of eq. (1) bears N = P λ c/(2 tan(π/n)) on the n-gon.

    The work of the forces at a further widening is 0 there.
    """
    rows = table("gent_equibiaxial_planestrain")
    row = next(r for r in rows if r["mat"] == "A" and r["stretch"] == stretch)
    at = (0.02, 0.0, 0.03)
    pattern = moved(cylinder(alone, LENGTH, 2 * RADIUS, 6e-3, mesh="left", caps=None), at)
    sides = round(np.pi * 2 * RADIUS / 6e-3)
    chord = 2 * RADIUS * np.sin(np.pi / sides)
    force = float(row["P11_strip_l2=1_Pa"]) * TABLE_A.thickness
    pressure = 2 * force * np.tan(np.pi / sides) / (float(stretch) * chord)
    sheet = Composite(fabric=TABLE_A, c1=1.8, c2=2.0, bending=None)
    skin = sew(alone, pattern)
    model = make_model(skin, sheet, between(pattern, at, (0, LENGTH)))
    model.set_density(np.zeros(len(skin.owned_cells)))
    pressurize(model, pressure)
    wider = (model.positions(model.assembled) - at + [RADIUS, 0, 0]) * [1, 1, 0]
    state = model.assembled
    model.positions(state)[:] += (float(stretch) - 1) * wider
    area = sides / 2 * np.sin(2 * np.pi / sides) * (float(stretch) * RADIUS) ** 2
    assert model.volumes(state).sum() == pytest.approx(area * LENGTH, rel=1e-12)
    work = dot(alone, model.positions(model.residual(state)).ravel(), wider.ravel())
    assert abs(work) < 1e-7 * pressure * area * LENGTH
