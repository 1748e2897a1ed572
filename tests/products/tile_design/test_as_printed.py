"""Prints of tiles on the finer mesh: density, profile, curves, buckling."""

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

from toros_fem.base.errors import NoEquilibriumError
from toros_fem.materials.sheet import Composite
from toros_fem.products.tile_design.as_printed import (
    PrintSimulation,
    directions,
    measure_print,
    merged,
)
from toros_fem.products.tiles.plots import full_circle
from toros_fem.products.tiles.printability import island_areas
from toros_fem.products.tiles.stiffness_profile import ProfileSolver


def test_print_on_the_finer_mesh() -> None:
    """It covers the printed region, and its profile is that of this density."""
    case, result = small_result()
    simulation = PrintSimulation(case, SMALL)
    density = simulation.density(result.printed)
    assert set(np.unique(density)) == {0.0, 1.0}
    area = result.printed.regions[0].area
    assert case.fine.tile.pattern.areas @ density == pytest.approx(area, rel=0.015)  # 0.0138 seen
    assert result.failure == ""
    own = ProfileSolver(simulation.solver.tile, case.angles, 0.1).solve(density)
    assert result.profile.stress == pytest.approx(own.stress, rel=1e-9)
    areas = island_areas(case.tile, result.printed.cells)
    assert result.printability.island_areas == pytest.approx(areas)


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


def test_print_without_an_equilibrium(monkeypatch: pytest.MonkeyPatch) -> None:
    """On the finer mesh; on the design's it has one."""
    case, result = small_result()
    assert measure_print(replace(result, profile=None)) is None
    simulation = PrintSimulation(case, SMALL)

    def fails(*_: object, **__: object) -> None:
        raise NoEquilibriumError("no equilibrium")

    monkeypatch.setattr(simulation.solver, "solve", fails)
    failed = simulation.simulate(result.problem, result.result)
    assert failed.profile is None
    assert failed.failure == "no equilibrium"
    assert failed.printed.evaluation is not None


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
