"""A skin through a sequence of pressures, and where a path stops."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.scenes import TABLE_A
from helpers.standing import solver_on_base
from mpi4py import MPI

from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium, EquilibriumError
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.trace import trace
from toros_fem.meshes import Skin, cylinder, sew


def test_a_path_is_followed(short_tube: Skin, short_solver: EquilibriumSolver) -> None:
    density = np.full(len(short_tube.owned_cells), 0.3)
    points = list(trace(short_solver, density, [500.0, 1e3, 2e3]))
    alone = short_solver.solve(density, 2e3)
    assert points[-1].result.volume == pytest.approx(alone.volume, rel=1e-8)
    assert [point.result.pressure for point in points] == [500.0, 1e3, 2e3]
    begun = list(trace(short_solver, density, [2e3], start=alone.positions))
    assert begun[0].result.steps <= 1


def test_a_path_stops_at_a_point(short_tube: Skin, short_solver: EquilibriumSolver) -> None:
    density = np.zeros(len(short_tube.owned_cells))
    path = trace(
        short_solver, density, [1e2, 2e2, 3e2, 4e2], stop=lambda point: point.result.pressure > 150
    )
    assert [point.pressure for point in path] == [1e2, 2e2]


def test_increments_shrink_where_no_stable_state_is_near(
    short_tube: Skin, monkeypatch: pytest.MonkeyPatch
) -> None:
    solver = solver_on_base(short_tube)
    finish = solver.finish
    tried: list[float] = []

    def unstable_at_first(trial: Equilibrium) -> Equilibrium:
        tried.append(trial.pressure)
        if len(tried) == 1:
            raise EquilibriumError("no stable equilibrium", replace(trial, converged=False))
        return finish(trial)

    monkeypatch.setattr(solver, "finish", unstable_at_first)
    density = np.full(len(short_tube.owned_cells), 0.3)
    points = list(trace(solver, density, [1e3, 2e3]))
    assert tried[:2] == [2e3, 1250.0]
    assert points[-1].result.pressure == 2e3


@pytest.mark.slow
def test_a_path_names_the_point_where_it_ends(alone: MPI.Comm) -> None:
    """Without a barrier in reach a tube has a limit pressure: what comes before is yielded."""
    skin = sew(alone, cylinder(alone, 0.04, 0.02, 5e-3, mesh="structured"))
    composite = Composite(fabric=TABLE_A, c1=1e5, c2=1e5, bending=None)
    solver = solver_on_base(skin, composite)
    path = trace(solver, np.zeros(len(skin.owned_cells)), [1e3, 3e3])
    assert next(path).result.pressure == 1e3
    with pytest.raises(EquilibriumError, match="the path ends between 1000 Pa and 3000 Pa, after"):
        next(path)
