"""The trim of a print: its pressure goes where the worst figure is least."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers.designs import DESIGN_ALONE, problem_of
from mpi4py import MPI

import toros_fem as tf
from toros_fem.base.errors import ParameterError
from toros_fem.design.loop.miss import worst_figure
from toros_fem.measures.figures import Tolerances
from toros_fem.products.actuators.pressure import worst_of_print
from toros_fem.products.tubes import BendScene

SCENE = BendScene.of(
    angle=50.0, length=0.08, edge_length=4.5e-3, filter_radius=7e-3, pressure=10e3, **DESIGN_ALONE
)


@pytest.fixture(scope="module")
def made(alone: MPI.Comm) -> Any:
    """A strip along the inner side, at a pressure that bends it too little."""
    problem = problem_of(alone, SCENE)
    pattern = problem.skin.pattern
    along = pattern.points[pattern.triangles].mean(axis=1)[:, 0]
    strip = np.where(along > 0.7 * along.max(), 1.0, 0.0)[problem.skin.owned_cells]
    result = tf.optimize(problem, [tf.Stage(1)], start=strip)
    return tf.as_printed(problem, result)


def at(made: Any, factor: float) -> Any:
    evaluation = made.evaluation
    pressure = factor * evaluation.equilibrium.pressure
    moved = evaluation.problem.simulate_binary(evaluation.projected, evaluation, pressure=pressure)
    return replace(made, evaluation=moved)


def pressure_of(made: Any) -> float:
    return float(made.evaluation.equilibrium.pressure)


def test_worst_figure_is_least(made: Any) -> None:
    """Among prints at pressures around it, none is better by more than a sample of the trim."""
    begin = at(made, 0.9)
    found: Any = tf.trimmed(begin)
    worst = worst_of_print(found)
    assert worst < 0.9 * worst_of_print(begin)
    ratio = pressure_of(found) / pressure_of(begin)
    assert 0.85 - 1e-9 <= ratio <= 1.15 + 1e-9
    others = [worst_of_print(at(begin, factor)) for factor in (0.85, 0.95, 1.05, 1.15)]
    assert worst <= min(others) * 1.02
    assert (
        worst_figure(found.evaluation.problem, found.evaluation.problem.target, Tolerances()) < 1e-6
    )


def test_bounds_hold(made: Any) -> None:
    """Above all the largest pressure, which the pump gives."""
    begin = at(made, 0.9)
    problem = begin.evaluation.problem
    low, most = 0.5 * pressure_of(begin), 1.01 * pressure_of(begin)
    physics = replace(problem.physics, pressure_bounds=(low, most), pressure=low)
    bounded = replace(begin.evaluation, problem=problem.changed(physics=physics))
    assert pressure_of(tf.trimmed(replace(begin, evaluation=bounded))) <= most * (1 + 1e-12)
    given = replace(problem.physics, pressure_bounds=None, pressure=pressure_of(begin))
    held = replace(begin.evaluation, problem=problem.changed(physics=given))
    assert pressure_of(tf.trimmed(replace(begin, evaluation=held))) <= pressure_of(begin)


def test_nothing_to_trim(made: Any) -> None:
    assert tf.trimmed(made, share=0.0) is made
    none = replace(made, evaluation=None, failure="made to fail")
    assert tf.trimmed(none) is none
    assert worst_of_print(none) == np.inf
    with pytest.raises(ParameterError, match="share = 1.0 must"):
        tf.trimmed(made, share=1.0)


def test_the_share_is_of_the_pressure_of_the_design(made: Any) -> None:
    low, given = at(made, 0.9), pressure_of(made)
    assert pressure_of(tf.trimmed(low, 0.05, designed=[given])) > 0.94999 * given
    assert pressure_of(tf.trimmed(low, 0.05)) < 0.94501 * given
