"""The relaxed model: its designs, their checks and sensitivity, and what it measures by."""

import numpy as np
import pytest
from helpers.models import (
    SIZE,
    affine,
    bent_tube,
    drawn,
    line_design,
    relaxed_model,
    spread_by_rounding,
)
from helpers.scenes import square
from mpi4py import MPI

from toros_fem.base.mpi import norm, total
from toros_fem.materials.sheet import Bladder, Composite, Material
from toros_fem.mechanics.skin.designs import (
    CROSSING,
    crossing_of_widths,
)
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Supports, clamp
from toros_fem.mechanics.terms.loads import Weight
from toros_fem.mechanics.terms.model import SkinModel, make_model
from toros_fem.meshes import Skin, sew

WEIGHT = Weight(0.2, 2.0)


@pytest.fixture
def model(short_tube: Skin) -> SkinModel:
    """A tube with all terms: bending, rubber, weight and pressure."""
    composite = Composite(bladder=Bladder(0.3e6, 0.5e-3))
    made = relaxed_model(
        short_tube, composite, clamp(short_tube.pattern, ["base"]), 2, weight=WEIGHT
    )
    made.set_density(line_design(short_tube, 2, 1))
    made.set_load(Load(np.array([1e3]), weight_fraction=1.0))
    return made


def test_only_the_direction_of_an_angle_counts(model: SkinModel) -> None:
    state, base = bent_tube(model), line_design(model.skin, 2, 1)
    residual = model.residual(state)
    longer = base.copy()
    longer[:, 3:] *= 3.0
    model.set_density(longer)
    assert model.residual(state) == pytest.approx(residual, rel=1e-12, abs=1e-15)
    along, straight = base.copy(), base.copy()
    along[:, 3:], straight[:, 3:5], straight[:, 5:] = 0.0, 1.0, 0.0
    found = []
    for design in (along, straight):
        model.set_density(design)
        found.append(model.residual(state))
    assert np.array_equal(found[0], found[1]), "the zero vector is the first axis"
    model.set_density(along)
    assert not model.density_sensitivity(state, drawn(model, 3))[:, 3:].any()


def test_without_lines_it_is_the_plain_model(model: SkinModel) -> None:
    plain = make_model(model.skin, model.composite, model.supports, weight=WEIGHT)
    plain.set_load(model.load)
    state, base = bent_tube(plain), line_design(model.skin, 2, 1)
    bare = np.where(np.arange(7) > 0, 0.0, base)
    plain.set_density(base[:, 0])
    model.set_density(bare)
    force = plain.residual(state)
    assert norm(model.skin.comm, model.residual(state) - force) < 1e-13 * norm(
        model.skin.comm, force
    )
    assert model.energy(state) == pytest.approx(plain.energy(state), rel=1e-12)
    assert model.mean_modulus() == pytest.approx(plain.mean_modulus(), rel=1e-14)


def test_lines_are_heavy(short_tube: Skin) -> None:
    """As printed fabric is, by the area that they cover."""
    supports, weight = clamp(short_tube.pattern, ["base"]), Weight(0.2, 2.0)
    model = relaxed_model(short_tube, Composite(bending=None), supports, 2, weight=weight)
    model.set_density(np.tile([0.1, 0.2, 0.3, 1, 0, 0, 1], (len(short_tube.owned_cells), 1)))
    model.set_load(Load(np.array([0.0]), weight_fraction=1.0))
    force = model.positions(model.applied_load(model.assembled) + 0.0)
    model.set_state(model.assembled)
    free = model.positions(model.free.astype(float))[:, 2] > 0
    whole = short_tube.pattern.vertex_areas[short_tube.owned_vertices][free].sum()
    pull = total(short_tube.comm, force[:, 2].sum())
    assert pull == pytest.approx(
        -9.81 * (0.2 + 0.6 * 1.8) * total(short_tube.comm, whole), rel=1e-10
    )


def test_mean_modulus_is_that_of_fabric_and_lines(short_tube: Skin) -> None:
    strip = Material(26e6, 0.2, 0.4e-3)
    composite = Composite(reinforcement=strip, bending=None)
    model = relaxed_model(short_tube, composite, clamp(short_tube.pattern, ["base"]), 2)
    model.set_density(np.tile([0.0, 0.2, 0.3, 1, 0, 0, 1], (len(short_tube.owned_cells), 1)))
    fabric, ratio = composite.fabric, 26e6 * 0.4e-3 / 50
    crossings = 0.2**2 * 0.3 + 0.3**2 * 0.2
    sine = np.sin(np.pi / 4) ** 4  # between t = 0 and t = 45 degrees
    factor = 1 / 0.5 + CROSSING * ratio * crossings * sine
    expected = factor * fabric.thickness * (2 * fabric.mu + fabric.lam) + 0.5 * 26e6 * 0.4e-3
    assert model.mean_modulus() == pytest.approx(expected, rel=1e-12)


def test_wide_lines_across_thin_ones_stiffen_less(short_tube: Skin) -> None:
    assert crossing_of_widths(1.0) == pytest.approx(CROSSING, rel=1e-15)
    assert crossing_of_widths(4.0) == pytest.approx(0.21509 * CROSSING, rel=1e-4)
    assert crossing_of_widths(0.25) == pytest.approx(crossing_of_widths(4.0), rel=1e-14)
    supports, design = clamp(short_tube.pattern, ["base"]), line_design(short_tube, 2, 4)
    energies = []
    for crossing in (0.0, 0.2, 0.4):
        model = relaxed_model(short_tube, Composite(bending=None), supports, 2, crossing=crossing)
        model.set_density(design)
        energies.append(model.energy(bent_tube(model)))
    none, some, twice = energies
    assert twice - none == pytest.approx(2 * (some - none), rel=1e-9)
    assert some > 1.001 * none


def test_rounding_of_the_energy_is_bounded(alone: MPI.Comm) -> None:
    """On states that differ by rounding: what Newton's line search relies on."""
    pattern = square(size=SIZE)
    fixed = np.zeros(pattern.points.shape, dtype=bool)
    fixed[[0, 1, 10]] = True
    model = relaxed_model(sew(alone, pattern), Composite(bending=None), Supports(fixed), 2)
    model.set_density(line_design(model.skin, 2, 3))
    state = affine(model, np.array([[1.3, 0], [0, 0.8], [0, 0]]))
    assert 0 < spread_by_rounding(model, state) < model.energy_rounding()
