"""Prints of tiles on meshes along their borders: density, profile, curves, buckling."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.tiles import (
    ANGLES,
    SMALL,
    Laminate,
    profile_of,
    profile_table,
    random_cells,
    small_result,
    solver_of,
    tile_of,
)

from toros_fem.base.errors import NoEquilibriumError, PatternError
from toros_fem.materials.sheet import Composite
from toros_fem.meshes.tiles import Tile
from toros_fem.products.tiles.plots import full_circle
from toros_fem.products.tiles.problem import (
    directions,
    island_areas,
    measure_print,
    merged,
    simulated_print,
)
from toros_fem.products.tiles.stiffness_profile import ProfileSolver


def test_print_along_its_borders() -> None:
    """The printed triangles are the region, and the profile is that of their density."""
    case, result = small_result()
    density, cells = result.density, result.cells
    assert set(np.unique(density)) == {0.0, 1.0}
    area = result.tile.pattern.areas[cells].sum()
    assert area == pytest.approx(result.region.area, rel=1e-6)
    assert result.failure == ""
    own = ProfileSolver(result.solver.tile, case.angles, 0.1).solve(density)
    assert result.profile.stress == pytest.approx(own.stress, rel=1e-9)
    areas = island_areas(result.tile, result.cells)
    assert result.printability.island_areas == pytest.approx(areas)


def test_along_x_and_y_alike() -> None:
    """The print is tetragonal; its mesh is not."""
    _, result = small_result()
    angles = np.radians([0.0, 90.0])
    found = ProfileSolver(result.solver.tile, angles, 0.1).solve(result.density, gradients=False)
    assert found.stress[0] == pytest.approx(found.stress[1], rel=5e-3)
    assert found.contraction[0] == pytest.approx(found.contraction[1], abs=5e-3)


@pytest.mark.parametrize(
    ("symmetry", "last", "count"),
    [("none", 172.5, 24), ("orthotropic", 90, 13), ("chiral", 82.5, 12), ("tetragonal", 45, 7)],
)
def test_directions_that_a_symmetry_does_not_repeat(symmetry: str, last: float, count: int) -> None:
    """They and their images are the full circle in equal steps."""
    angles = directions(symmetry)
    assert [np.degrees(angles[-1]), len(angles)] == pytest.approx([last, count])
    turn, _ = full_circle(angles, angles, symmetry)
    assert np.degrees(turn) == pytest.approx(np.arange(0, 361, 7.5))


def test_measured_print() -> None:
    _, result = small_result()
    measured = measure_print(result)
    assert np.degrees(measured.profile.angles) == pytest.approx(np.arange(0, 46, 7.5))
    assert measured.profile.stress[::2] == pytest.approx(result.profile.stress, rel=1e-12)
    fabric = Composite().fabric
    exact, _, _ = Laminate(Composite(fabric, fabric), 0.5, 0.0).pulled(0.0, 0.1)
    assert measured.fabric_stiffness == pytest.approx(exact / 0.1, rel=1e-9)
    assert [curve.strain for curve in measured.curves] == pytest.approx([0.025, 0.05, 0.075, 0.1])
    assert measured.curves[-1] is result.profile
    assert measured.buckling.shape == (4,)


def test_intervals_hold_what_a_finer_mesh_tells() -> None:
    case, result = small_result()
    finer = replace(case, edge_length=case.edge_length / 2)
    fine = simulated_print(finer, SMALL, result.problem, result.result).profile
    measured = measure_print(result)
    for name, told in (("stiffness", 0.02), ("contraction", 0.015)):
        width, value = measured.intervals[name], getattr(result.profile, name)
        assert width.shape == value.shape
        assert (np.abs(getattr(fine, name) - value) <= width).all()
        assert (width <= told * np.abs(value).max()).all(), "so wide that they tell nothing"


def test_without_other_meshes_intervals_are_unknown(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    _, result = small_result()

    def fails(*_: object, **__: object) -> None:
        raise PatternError("borders meet")

    monkeypatch.setattr(Tile, "following", fails)
    measured = measure_print(result)
    assert measured.intervals == {}
    assert "a coarser mesh is left out of the intervals: borders meet" in caplog.text


def test_print_without_an_equilibrium(monkeypatch: pytest.MonkeyPatch) -> None:
    case, result = small_result()
    assert measure_print(replace(result, profile=None)) is None

    def fails(*_: object, **__: object) -> None:
        raise NoEquilibriumError("no equilibrium")

    monkeypatch.setattr(ProfileSolver, "solve", fails)
    failed = simulated_print(case, SMALL, result.problem, result.result)
    assert failed.profile is None
    assert failed.failure == "no equilibrium"


def test_union_of_profiles() -> None:
    """Two sets of directions give what both give together."""
    tile = tile_of(3)
    solver, density = solver_of(tile), random_cells(tile)
    one, other, whole = (
        profile_of(solver, density, 0.1, ANGLES[at]) for at in ([4, 3], [0, 1, 2], range(5))
    )
    found = merged(one, other)
    assert found.angles == pytest.approx(ANGLES[:5], abs=1e-15)
    assert profile_table(found) == pytest.approx(profile_table(whole), abs=1e-10)
    assert found.steps == one.steps + other.steps
