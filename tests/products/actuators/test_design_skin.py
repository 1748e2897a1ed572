"""A design by one call: the files, figures and verdict of its scene; refusals; going on."""

import os
import signal
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.designs import DESIGN_ALONE
from helpers.run_files import content
from helpers.scenes import shared
from mpi4py import MPI

import toros_fem as tf
from toros_fem.base.errors import CheckpointError, OutputError, ParameterError, RunStoppedError
from toros_fem.meshes import bend, cylinder, twist
from toros_fem.products.actuators.design_skin import scene_of
from toros_fem.products.actuators.scene import Level
from toros_fem.products.tubes import BendScene
from toros_fem.results.reporter import DesignReporter

CaseOf = Callable[[float], tf.Case]
LENGTH, DIAMETER, EDGE = 0.08, 0.02, 4.5e-3
FEW = {"iterations": 1, "constrained_iterations": 0, "polish_iterations": 0, "corrections": 0}
SHORT: dict[str, Any] = {**FEW, "filter_radius": 7e-3, **DESIGN_ALONE}
WITH_ERRORS = {**SHORT, "estimate_error": True}


def case_on(comm: MPI.Comm) -> CaseOf:
    """Return the case of a scene, as a function of the edge length."""
    scene = BendScene.of(angle=45.0, length=LENGTH, edge_length=EDGE)
    return lambda edge: scene.case(comm, Level(edge, scene.design.regularisation))


def tube(comm: MPI.Comm, edge: float, twist_deg: float = 60.0) -> tf.Case:
    """Return a tube that twists."""
    angle = tf.Metric("twist", "deg", twist_deg, lambda of, x: np.degrees(tf.twist_angle(of, x)))
    pattern = cylinder(comm, LENGTH, DIAMETER, edge)
    return tf.Case(
        pattern,
        twist(np.radians(twist_deg), LENGTH),
        tf.clamp(pattern, ["base"]),
        5e3,
        metrics=[angle],
    )


@pytest.mark.usefixtures("without_pictures")
def test_one_call_is_the_design_of_its_scene(comm: MPI.Comm, tmp_path: Path) -> None:
    folder = shared(comm, tmp_path)
    made = tf.design_skin(comm, case_on(comm), EDGE, folder / "call", **WITH_ERRORS)
    sizes = {"angle": 45.0, "length": LENGTH, "edge_length": EDGE, "perimeter_weight": None}
    scene = BendScene.of(**sizes, **WITH_ERRORS).run_design(comm, folder / "scene")
    assert made.summary()["figures"] == scene.summary()["figures"]
    assert made.value("angle_deg") > 1
    told = str(made)
    assert told.splitlines()[0] in ("Reached", "Missed", "Not certain")
    assert "angle" in told
    assert "±" in told
    assert "of 45" not in repr(made)
    files = {path.name for path in (folder / "call").iterdir()}
    assert files >= {"summary.json", "history.csv", "pattern.svg", "skin.vtu", "manufacture"}


def test_the_report_and_the_curve_are_there(alone: MPI.Comm, tmp_path: Path) -> None:
    given = {**SHORT, "curve_pressure": 2e3, "curve_steps": 1}
    made = tf.design_skin(alone, partial(plain_case, alone), EDGE, tmp_path, **given)
    assert made.curve is not None
    assert {"report.html", "curve.csv"} <= {path.name for path in tmp_path.iterdir()}
    assert made.printed.evaluation is not None
    assert made.printed.evaluation.equilibrium.pressures == (5e3,), "a given pressure is held"


def plain_case(comm: MPI.Comm, edge: float) -> tf.Case:
    """Return a case with the least that one needs: no sheets, no metrics, a target by a map."""
    pattern = cylinder(comm, LENGTH, DIAMETER, edge)
    target = bend(np.radians(45), LENGTH, neutral=0.01)
    return tf.Case(pattern, target, tf.clamp(pattern, ["base"]), 5e3, printed_panels=["tip"])


def test_lines_are_asked_for_other_targets(alone: MPI.Comm) -> None:
    given = {"start": "relaxed", "relaxed_edge_length": 6e-3}

    def case_of(edge: float, twist_deg: float = 60.0) -> tf.Case:
        return tube(alone, edge, twist_deg)

    scene = scene_of(case_of, EDGE, given)
    assert scene.edges == {"relaxed_edge_length": 6e-3, "edge_length": EDGE}
    assert scene.print_level.edge_length == EDGE
    assert set(scene.targets()) == {"twist_deg"}
    assert set(scene.asked({"twist_deg": 70.0}).targets()) == {"twist_deg"}
    case = scene.asked({"twist_deg": 70.0}).case(alone, scene.relaxed_level)
    assert case.judged[0].target == 70.0
    assert case.judged[0].value(case.pattern, case.goal) == pytest.approx(70.0, abs=1e-3)
    assert not scene_of(lambda edge: tube(alone, edge), EDGE, given).targets()


def test_lines_are_laid_beside_printed_panels(
    alone: MPI.Comm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whether a case names them, or prescribes the density of their triangles."""
    masks = []

    def told(*_: Any, printed: Any, **__: Any) -> None:
        masks.append(printed)
        raise InterruptedError

    def by_name(edge: float) -> tf.Case:
        return replace(tube(alone, edge), printed_panels=["base", "tip"])

    def by_density(edge: float) -> tf.Case:
        return replace(tube(alone, edge), passive=by_name(edge).prescribed)

    monkeypatch.setattr("toros_fem.products.actuators.discovery.lay_lines", told)
    few: dict[str, Any] = {"start": "relaxed", "relaxed_edge_length": 6e-3, "relaxed_iterations": 1}
    for number, case_of in enumerate((by_name, by_density)):
        with pytest.raises(InterruptedError):
            tf.design_skin(alone, case_of, EDGE, tmp_path / f"{number}", **few)
    pattern = tube(alone, 6e-3).pattern
    assert (masks[0] == (pattern.panel != pattern.panel_index("wall"))).all()
    assert (masks[1] == masks[0]).all()


def test_meshes_and_filter_follow_the_edge(alone: MPI.Comm) -> None:
    scene = scene_of(case_on(alone), 2e-3, {"levels": 3, "iterations": 4})
    assert [level.edge_length for level in scene.levels] == [8e-3, 4e-3, 2e-3]
    assert [level.regularisation.filter_radius for level in scene.levels] == [12e-3, 6e-3, 3e-3]
    assert [len(options.stages) for options in scene.options] == [2, 1, 1]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"itertions": 4}, "itertions.*iterations"),
        ({"start": "relaxed", "print_edge_length": 1e-3}, "print_edge_length is given"),
        ({"filter_radius": -1.0}, "filter_radius = -1"),
        ({"pressure": 4e3}, "unknown parameter 'pressure'"),
        ({"case_of": lambda edge: None}, "must be a Case"),
        ({"case_of": "bend"}, "function of an edge length"),
        ({"resume": 1}, "True or False"),
    ],
)
def test_refused_before_a_folder_is_touched(
    alone: MPI.Comm, tmp_path: Path, changes: dict[str, Any], words: str
) -> None:
    given = {"case_of": case_on(alone), **changes}
    with pytest.raises(ParameterError, match=words):
        tf.design_skin(alone, edge_length=EDGE, output=tmp_path / "new", **given)
    with pytest.raises(ParameterError, match="edge_length"):
        tf.design_skin(alone, case_on(alone), -1.0, tmp_path / "new")
    assert not (tmp_path / "new").exists()


@pytest.mark.slow
@pytest.mark.usefixtures("without_pictures")
def test_goes_on_where_it_was_stopped(
    alone: MPI.Comm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = {**SHORT, "iterations": 4}
    tf.design_skin(alone, case_on(alone), EDGE, tmp_path / "whole", **given)
    report, rows = DesignReporter.report, []

    def stopping(self: DesignReporter, row: Any) -> None:
        report(self, row)
        rows.append(row)
        if len(rows) == 3:
            os.kill(os.getpid(), signal.SIGTERM)

    monkeypatch.setattr(DesignReporter, "report", stopping)
    stopped = tmp_path / "stopped"
    with pytest.raises(RunStoppedError, match="resume=True in design_skin"):
        tf.design_skin(alone, case_on(alone), EDGE, stopped, **given)
    with pytest.raises(OutputError, match="not empty"):
        tf.design_skin(alone, case_on(alone), EDGE, stopped, **given)
    plain = partial(plain_case, alone)
    with pytest.raises(CheckpointError, match="other inputs"):
        tf.design_skin(alone, plain, EDGE, stopped, resume=True, **given)
    tf.design_skin(alone, case_on(alone), EDGE, stopped, resume=True, **given)
    assert content(stopped) == content(tmp_path / "whole")
    with pytest.raises(OutputError, match="finished"):
        tf.design_skin(alone, case_on(alone), EDGE, stopped, resume=True, **given)
    tf.design_skin(alone, case_on(alone), EDGE, stopped, overwrite=True, **given)
