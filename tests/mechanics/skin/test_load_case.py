"""Load cases: scaling, interpolation and wording."""

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.mechanics.skin.load_case import LoadCase, make_load_case
from toros_fem.mechanics.skin.supports import Supports, clamp
from toros_fem.meshes import Pattern, Skin, cylinder

FORCE = np.array([[0.0, 3.0, 4.0], [0.0, 0.0, 0.0]])


def test_a_load_case_is_scaled_as_a_whole() -> None:
    way = np.array([[1e-3, 0.0, 0.0], [0.0, 0.0, 0.0]])
    part = LoadCase(np.array([100.0, 50.0]), FORCE, way, 1.0).scaled(0.4)
    assert part.pressures == pytest.approx([40, 20])
    assert part.force == pytest.approx(0.4 * FORCE)
    assert part.displacement == pytest.approx(0.4 * way)
    assert part.weight_fraction == pytest.approx(0.4)
    assert part.largest == pytest.approx(40)
    nothing = part.scaled(0.0)
    assert nothing.largest == nothing.weight_fraction == 0


def test_interpolation_between_load_cases() -> None:
    load, plain = LoadCase(np.array([100.0]), FORCE), LoadCase(np.array([20.0]))
    there = plain.towards(load, 0.25)
    assert there.pressures == pytest.approx([40])
    assert there.force == pytest.approx(0.25 * FORCE)
    assert there.displacement is None


def test_wording() -> None:
    load = LoadCase(np.array([100.0]), FORCE)
    assert str(load) == "100 Pa and forces of 5 N in total"
    assert str(LoadCase(np.zeros(1), FORCE)) == "forces of 5 N in total"
    assert str(LoadCase(np.zeros(1))) == "0 Pa"
    heavy = LoadCase(np.array([100.0]), weight_fraction=1.0)
    assert str(heavy) == "100 Pa and its own weight"
    assert str(heavy.scaled(0.25)) == "25 Pa and 25 % of its own weight"
    assert str(LoadCase(np.array([5e3, 2e3]))) == "5000 and 2000 Pa"


def test_whether_anything_acts() -> None:
    none = np.zeros(1)
    assert not LoadCase(none)
    assert LoadCase(np.ones(1))
    assert LoadCase(none, FORCE)
    assert LoadCase(none, displacement=FORCE)
    assert LoadCase(none, weight_fraction=0.5)


def made(pattern: Pattern, pressure: object = 0.0, **more: object) -> LoadCase:
    supports = clamp(pattern, ["base"])
    return make_load_case(pattern, supports, 2, pressure, **more)  # type: ignore[arg-type]


def test_one_pressure_counts_for_all_chambers(short_tube: Skin) -> None:
    assert made(short_tube.pattern, 2e3).pressures == pytest.approx([2e3, 2e3])
    assert made(short_tube.pattern, (2e3, 0.0)).pressures == pytest.approx([2e3, 0])


def test_a_load_case_keeps_its_own_arrays(short_tube: Skin) -> None:
    force = np.ones(short_tube.pattern.points.shape)
    load = made(short_tube.pattern, force=force)
    force[:] = 7.0
    assert load.force.max() == 1.0


def test_a_border_must_stay_in_its_symmetry_plane(alone: MPI.Comm) -> None:
    pattern = cylinder(alone, 0.04, 0.02, 5e-3, mesh="structured", planes=(1,))
    border = np.abs(pattern.points[:, 1]) < 1e-9
    supports = Supports(np.ones(pattern.points.shape, dtype=bool))  # closed by the plane y = 0
    along = np.where(border[:, None], [1e-3, 0, 0], 0.0)
    assert make_load_case(pattern, supports, 1, 0.0, displacement=along).displacement is not None
