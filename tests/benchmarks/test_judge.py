"""The judge of the matrix tells a residual that rounding leaves from one that something moves."""

import numpy as np

from benchmarks.stability.command import cell_of
from benchmarks.stability.matrix import Run, play, stage_of

# A graded mesh of 10⁴ times the fabric's stiffness under 100 Pa: the last bit of the positions
# changes the residual by less than evaluating it does.
LABEL = "graded random x10000 100 Pa continuation"


def test_rounding_is_no_fault_and_a_motion_is_one() -> None:
    cell = cell_of(LABEL)
    stage = stage_of(cell.scene)
    run = Run(stage, cell)
    result, _ = play(run, stage.scene)
    judge, model = stage.judge(cell.contrast), run.solver.model
    given = model, stage.density(run.request), run.request.load
    found = judge.check(*given, result.state)
    assert found.faults == []
    assert found.residual > 1e-8
    shake = np.random.default_rng(1).standard_normal(len(result.state)) * model.free
    off = 1e-15 * stage.scene.skin.pattern.size
    (fault,) = judge.check(*given, result.state + off * shake).faults
    assert fault.startswith("the residual is")
