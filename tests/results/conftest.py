"""A short design of the tube, and its print."""

import dataclasses

import numpy as np
import pytest
from helpers.designs import full

from toros_fem.design.loop.loop import DesignResult, optimize
from toros_fem.design.loop.options import Stage
from toros_fem.making.as_printed import PrintedDesign, as_printed
from toros_fem.measures.metrics import Metric, bend_angle
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.meshes import Skin, bend

ANGLE = Metric("angle", "deg", 60.0, lambda of, x: float(np.degrees(bend_angle(of, x))))


@pytest.fixture(scope="session")
def result(tube: Skin, tube_solver: EquilibriumSolver) -> DesignResult:
    problem = full(tube, tube_solver, beta=20.0)
    target = bend(np.radians(60), 0.06, neutral=0.01)(tube.pattern.points)
    problem = dataclasses.replace(problem, metrics=(ANGLE,), target=target)
    return optimize(problem, [Stage(2), Stage(1, constrained=True)], seed=3)


@pytest.fixture(scope="session")
def printed(result: DesignResult) -> PrintedDesign:
    return as_printed(result.problem, result, island_area=4e-3)
