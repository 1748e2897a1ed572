"""Numbers of the relaxed design."""

import dataclasses

import numpy as np
import pytest
from helpers.designs import make_problem

from toros_fem.base.errors import ParameterError
from toros_fem.design.relaxed.find import LEAST_DECREASE, MOVE, RelaxedOptions, find_lines
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.meshes import Skin


def test_stages() -> None:
    options = RelaxedOptions(iterations=(7, 9))
    for number in range(2):
        rules = options.stage(number)
        assert [stage.iterations for stage in rules.stages] == [options.iterations[number]]
        assert rules.mma.move == MOVE
        assert rules.min_relative_decrease == LEAST_DECREASE


def test_two_stages_and_their_continuation(
    short_tube: Skin, short_solver: EquilibriumSolver
) -> None:
    design = make_problem(short_tube, short_solver)
    options = RelaxedOptions(directions=4, iterations=(4, 3), more_iterations=2)
    found = find_lines(design, options, seed=1)
    assert found.field.families == 2
    assert found.start.families == 4
    assert [sum(row.stage == stage for row in found.history) for stage in (0, 1)] == [5, 4]
    first = [row.objective for row in found.history if row.stage == 0]
    assert first[-1] < 0.9 * first[0]
    wall = found.field.pattern.panel == found.field.pattern.panel_index("wall")
    assert not found.field.shares[~wall].any()
    assert np.all(found.field.shares[wall].sum(axis=1) > 0)
    assert not found.start.shares[~wall].any()
    assert np.all(found.start.shares[wall] > 0)
    other_seed = find_lines(design, dataclasses.replace(options, iterations=(1, 1)), seed=2)
    assert not np.allclose(other_seed.start.shares, found.start.shares)
    further = find_lines(design, options, after=found)
    assert further.history[: len(found.history)] == found.history
    assert further.history[-1].iteration == found.history[-1].iteration + 2
    assert further.history[-1].objective <= found.history[-1].objective
    assert further.start is found.start
    other = dataclasses.replace(found, density=found.density[1:])
    with pytest.raises(ParameterError, match="result on"):
        find_lines(design, options, after=other)
