"""The four flows of CONTRIBUTING.md are those that a run takes, file by file."""

import re
import sys
from collections.abc import Callable
from inspect import CO_OPTIMIZED
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest
from helpers.scenes import ROOT
from mpi4py import MPI

import toros_fem as tf
from toros_fem.base import fenicsx
from toros_fem.design.loop.fields import random_density

EDGE = 6e-3
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
FLOW = re.compile(r"<!-- flow: (.*?) -->\n(.*?)(?=<!-- (?:flow|end))", re.DOTALL)
FLOWS = {name: text for name, text in FLOW.findall(TEXT)}


def path_of(name: str) -> str:
    """Return a file as it lies in a checkout."""
    return name if name.split("/")[0] in ("forms", "meshes") else f"toros_fem/{name}"


def files_met(run: Callable[[], Any]) -> list[str]:
    """Return the files of the package whose functions a run calls, in the order of first calls."""
    met: dict[str, None] = {}

    def note(frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code  # bodies of classes and modules, at an import, are no calls
        named = not code.co_name.startswith("<")
        if event == "call" and named and code.co_flags & CO_OPTIMIZED:
            met.setdefault(code.co_filename)

    sys.setprofile(note)
    try:
        run()
    finally:
        sys.setprofile(None)
    root = f"{ROOT}/"
    return [name.removeprefix(root) for name in met if name.startswith(root)]


def case(edge: float) -> tf.Case:
    tube = tf.meshes.cylinder(MPI.COMM_SELF, 0.06, 0.02, edge)
    target, base = tf.meshes.bend(0.5, 0.06, neutral=0.01), tf.clamp(tube, ["base"])
    bounds = (2e3, 8e3)
    return tf.Case(tube, target, base, 4e3, pressure_bounds=bounds, printed_panels=["base", "tip"])


def problem() -> tf.ShapeDesign:
    return tf.ShapeDesign(MPI.COMM_SELF, case(EDGE), tf.Regularisation(9e-3))


def a_design(folder: Path) -> Callable[[], Any]:
    few: dict[str, Any] = {
        "iterations": 2,
        "constrained_iterations": 1,
        "corrections": 1,
        "polish_iterations": 1,
    }
    curve: dict[str, Any] = {"curve_steps": 1, "curve_pressure": 2e3}
    return lambda: tf.design_skin(MPI.COMM_SELF, case, EDGE, folder, **few, **curve)


def an_equilibrium(_: Path) -> Callable[[], Any]:
    given = case(EDGE)
    skin = tf.sew(MPI.COMM_SELF, given.pattern)
    bare = np.zeros(len(skin.owned_cells))

    def solve() -> None:
        tf.EquilibriumSolver(skin, tf.Composite(), given.supports).solve(bare, 4e3)

    return solve


def a_gradient(_: Path) -> Callable[[], Any]:
    shape = problem()
    at = shape.simulate(random_density(shape.skin, 1))
    return lambda: shape.differentiate(at)


def a_print(_: Path) -> Callable[[], Any]:
    shape = problem()
    result = tf.optimize(shape, [tf.Stage(1)], seed=1)
    return lambda: tf.as_printed(shape, result, tf.PrintLimits())


RUNS = {
    "a design": a_design,
    "an equilibrium": an_equilibrium,
    "a gradient": a_gradient,
    "a print": a_print,
}


def test_each_flow_has_ten_lines() -> None:
    assert list(FLOWS) == list(RUNS)
    for text in FLOWS.values():
        assert len(re.findall(r"^\d+\. `", text, re.MULTILINE)) == 10


@pytest.mark.slow
@pytest.mark.usefixtures("without_pictures")
@pytest.mark.parametrize("name", list(RUNS))
def test_files_are_met_in_this_order(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fenicsx, "_KERNELS", {})  # as in a new process
    told = [path_of(one) for one in re.findall(r"`([\w/]+\.py)`", FLOWS[name])]
    met = files_met(RUNS[name](tmp_path))
    assert [one for one in told if one not in met] == []
    assert sorted(told, key=met.index) == told
