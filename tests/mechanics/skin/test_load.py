"""Loads: scaling, interpolation, wording, and what a skin makes of them."""

import numpy as np
import pytest
from helpers.standing import model_on_base
from mpi4py import MPI

from toros_fem.base.errors import PatternError
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.chambers import chambers_of_panels
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.mechanics.terms.model import SkinModel, make_model
from toros_fem.meshes import cylinder, moulded, sew

FORCE = np.array([[0.0, 3.0, 4.0], [0.0, 0.0, 0.0]])


def test_a_load_is_scaled_as_a_whole() -> None:
    way = np.array([[1e-3, 0.0, 0.0], [0.0, 0.0, 0.0]])
    part = Load(np.array([100.0, 50.0]), FORCE, way, 1.0).scaled(0.4)
    assert part.pressures == pytest.approx([40, 20])
    assert part.force == pytest.approx(0.4 * FORCE)
    assert part.displacement == pytest.approx(0.4 * way)
    assert part.weight_fraction == pytest.approx(0.4)
    assert part.largest == pytest.approx(40)
    nothing = part.scaled(0.0)
    assert nothing.largest == nothing.weight_fraction == 0


def test_interpolation_between_loads() -> None:
    load, plain = Load(np.array([100.0]), FORCE), Load(np.array([20.0]))
    there = plain.towards(load, 0.25)
    assert there.pressures == pytest.approx([40])
    assert there.force == pytest.approx(0.25 * FORCE)
    assert there.displacement is None


def test_wording() -> None:
    load = Load(np.array([100.0]), FORCE)
    assert str(load) == "100 Pa and forces of 5 N in total"
    assert str(Load(np.zeros(1), FORCE)) == "forces of 5 N in total"
    assert str(Load(np.zeros(1))) == "0 Pa"
    heavy = Load(np.array([100.0]), weight_fraction=1.0)
    assert str(heavy) == "100 Pa and its own weight"
    assert str(heavy.scaled(0.25)) == "25 Pa and 25 % of its own weight"
    assert str(Load(np.array([5e3, 2e3]))) == "5000 and 2000 Pa"


def test_whether_anything_acts() -> None:
    none = np.zeros(1)
    assert not Load(none)
    assert Load(np.ones(1))
    assert Load(none, FORCE)
    assert Load(none, displacement=FORCE)
    assert Load(none, weight_fraction=0.5)


@pytest.fixture
def two(alone: MPI.Comm) -> SkinModel:
    """A tube of two chambers."""
    pattern = cylinder(alone, 0.04, 0.02, 8e-3, mesh="structured")
    chambers = chambers_of_panels(pattern, {"front": ["base", "wall"], "back": ["tip"]})
    return model_on_base(sew(alone, pattern), chambers=chambers)


def test_one_pressure_counts_for_all_chambers(two: SkinModel) -> None:
    assert Load(2e3).on(two).pressures == pytest.approx([2e3, 2e3])
    assert Load((2e3, 0.0)).on(two).pressures == pytest.approx([2e3, 0])


def test_a_load_has_only_what_the_skin_has(two: SkinModel) -> None:
    """Its own arrays, and no weight that the skin lacks."""
    force = np.ones(two.skin.pattern.points.shape)
    load = Load(force=force).on(two)
    force[:] = 7.0
    assert load.force.max() == 1.0
    assert load.weight_fraction == 0.0


def test_a_border_must_stay_in_its_symmetry_plane(alone: MPI.Comm) -> None:
    pattern = cylinder(alone, 0.04, 0.02, 5e-3, mesh="structured", planes=(1,))
    border = np.abs(pattern.points[:, 1]) < 1e-9
    supports = Supports(np.ones(pattern.points.shape, dtype=bool))  # closed by the plane y = 0
    model = EquilibriumSolver(sew(alone, pattern), Composite(), supports).model
    along = np.where(border[:, None], [1e-3, 0, 0], 0.0)
    assert Load(displacement=along).on(model).displacement is not None


@pytest.mark.parametrize("planes", [(), (1,)])
def test_a_skin_that_faces_inwards_takes_no_pressure(
    alone: MPI.Comm, planes: tuple[int, ...]
) -> None:
    """A whole tube and half of one; without a pressure it does not matter."""
    tube = cylinder(alone, 0.03, 0.02, 8e-3, planes=planes)
    for triangles in (tube.triangles, tube.triangles[:, ::-1]):
        skin = moulded(tube.points, triangles)
        supports = Supports(np.ones(skin.points.shape, dtype=bool))  # closed by the plane y = 0
        model = make_model(sew(alone, skin), Composite(), supports)
        assert Load(0.0).on(model).largest == 0
        if triangles is tube.triangles:
            assert Load(5.0).on(model).largest == 5
            continue
        with pytest.raises(PatternError, match=r"volume is -.* m³.*Reverse its triangles"):
            Load(5.0).on(model)
