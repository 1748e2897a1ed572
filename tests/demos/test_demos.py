"""Each demo beside the scene of the same name: the same model, options and first step."""

import re
import runpy
import sys
from collections.abc import Callable
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.scenes import ROOT, shared
from mpi4py import MPI

import toros_fem as tf
from toros_fem.cli.scene_files import read_scene
from toros_fem.design.loop.loop import optimize
from toros_fem.design.relaxed.find import find_lines
from toros_fem.mechanics.paths.trace import trace
from toros_fem.products.actuators.design_skin import scene_of
from toros_fem.products.inflate import METRICS
from toros_fem.products.tiles.problem import tile_problem
from toros_fem.products.tiles.tile import tile_case
from toros_fem.products.tubes import plain_planes, plain_tube

# Numbers by name, what must be equal, and figures of the first steps.
Model = tuple[dict[str, Any], Any, list[float]]


class EndedError(Exception):
    """The end of a script, with its model."""


def model(solver: Any, settings: Any, figures: list[float], **numbers: Any) -> Model:
    pattern, supports = solver.skin.pattern, solver.model.supports
    numbers |= {"points": pattern.points, "flat": pattern.flat_points, "normals": supports.normals}
    numbers |= {"fixed": supports.fixed, "guided": supports.guided, "faces": pattern.triangles}
    return (numbers, (solver.model.composite, settings), figures)


def of_problem(problem: Any, settings: Any, history: Any) -> Model:
    physics, passive = problem.physics, problem.fields.passive
    given = {"target": problem.target, "density": passive, "pressure": physics.pressures}
    given["bounds"] = np.array(physics.pressure_ranges, dtype=float)
    rules = problem.regularisation
    window = rules.perimeter_window or rules.filter_radius
    rules = replace(rules, perimeter_window=window)
    figures = [row.objective for row in history]
    return model(problem.solver, (settings, rules), figures, **given)


def designed(
    comm: MPI.Comm, case_of: Callable[..., Any], edge: float, output: Path, **given: Any
) -> Model:
    """Return what `design_skin` is called with."""
    given.pop("overwrite")
    return of_scene(comm, scene_of(case_of, edge, given))


def of_scene(comm: MPI.Comm, scene: Any) -> Model:
    """Return first step, options, and a mesh of each kind that a scene designs on."""
    lines = scene.design.start == "relaxed"
    level = scene.relaxed_level if lines else scene.levels[0]
    fine = scene.print_level if lines else scene.finest_level
    problem = scene.problem(comm, scene.case(comm, level), level)
    results, design = scene.results, scene.design
    settings: tuple[Any, ...] = (scene.print, results.tolerances, results.check_refinement)
    settings += (results.estimate_error, design.corrections, design.seed)
    if lines:
        options = scene.relaxed_options
        history = find_lines(problem, replace(options, iterations=(1, 1)), seed=design.seed).history
        settings += options, scene.line_options
    else:
        options = scene.options[0]
        one = replace(options, stages=(replace(options.stages[0], iterations=1),))
        history = optimize(problem, one, seed=design.seed).history
        settings += scene.options, design.polish_iterations, fine.regularisation
    numbers, options, figures = of_problem(problem, settings, history)
    finest = scene.case(comm, fine).pattern.points
    return {"finest": finest, **numbers}, options, figures


def tile(case: Any, scene: Any, _: Any = None) -> Model:
    meshes = [one.tile.pattern.points for one in (case, case.coarse)]
    numbers = {f"mesh_{k}": points for k, points in enumerate(meshes)}
    numbers |= {"angles": case.angles, "stiffness": case.objective.stiffness}
    settings = case.symmetry, scene.material, scene.pull, scene.design, scene.print
    problem = tile_problem(case.coarse, scene)
    one = optimize(problem, tf.DesignOptions((tf.Stage(1),)), seed=scene.design.seed)
    return numbers, settings, [row.objective for row in one.history]


def path(solver: Any, density: Any, pressures: Any, metrics: Any) -> Model:
    points = islice(trace(solver, density, pressures, metrics), 2)
    figures = [value for point in points for value in point.metrics.values()]
    return model(solver, None, figures, density=density, pressures=pressures)


def scene_path(comm: MPI.Comm, scene: Any) -> Model:
    planes = plain_planes(scene.material.seams)
    pattern, supports, density = plain_tube(comm, scene.skin, planes)
    skin = tf.sew(comm, pattern)
    solver = tf.EquilibriumSolver(skin, scene.material.composite, supports)
    metrics = [metric.of_whole(planes) for metric in METRICS]
    return path(solver, density[skin.owned_cells], scene.pressures, metrics)


def scene_tile(comm: MPI.Comm, scene: Any) -> Model:
    return tile(tile_case(comm, scene), scene)


def ending(steps: Callable[..., Model]) -> Callable[..., None]:
    """Return a function that ends its caller by the model that it is given."""

    def end(*given: Any, **named: Any) -> None:
        raise EndedError(steps(*given, **named))

    return end


# The public function that a demo comes to first, what a step of it is, and the scene's.
DEMOS: dict[str, tuple[str, Callable[..., Model], Callable[..., Model]]] = {
    **dict.fromkeys(
        ("bend", "contract", "twist", "bend_twist", "own_design", "walker", "gripper"),
        ("design_skin", designed, of_scene),
    ),
    "inflate": ("trace", path, scene_path),
    "tile": ("products.tiles.tile.design_tile", tile, scene_tile),
}
ON_RANKS = ["bend", "contract"]


def compare(comm: MPI.Comm, name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    entry, steps, of_scene = DEMOS[name]

    monkeypatch.setattr(f"toros_fem.{entry}", ending(steps))
    monkeypatch.setattr(sys, "argv", [name, "--coarse", "--output", str(shared(comm, folder))])
    with pytest.raises(EndedError) as ended:
        runpy.run_path(str(ROOT / "demos" / f"{name}.py"), run_name="__main__")
    file = read_scene(ROOT / "demos" / "scenes" / f"{name}.toml", coarse=True)
    scene: Any = file.config
    if file.files:
        scene = scene.with_files(comm, file.files)
    (found, settings, figures), expected = ended.value.args[0], of_scene(comm, scene)
    assert found.keys() == expected[0].keys()
    for key, value in expected[0].items():
        np.testing.assert_allclose(found[key], value, 1e-9, 1e-12, err_msg=key)
    assert settings == expected[1]
    assert len(figures) >= 2
    assert figures == pytest.approx(expected[2], rel=1e-9)


@pytest.mark.parametrize("name", [name for name in DEMOS if name not in ON_RANKS])
def test_is_its_scene(
    alone: MPI.Comm, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compare(alone, name, tmp_path, monkeypatch)


@pytest.mark.parametrize("name", ON_RANKS)
def test_on_all_ranks(
    comm: MPI.Comm, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compare(comm, name, tmp_path, monkeypatch)


@pytest.mark.parametrize("name", [*DEMOS, "three_field", "tile_sheet"])
def test_is_a_short_script_with_four_options(name: str) -> None:
    text = (ROOT / "demos" / f"{name}.py").read_text(encoding="utf-8")
    seeds = [] if name == "tile_sheet" else ["seed"]  # nothing is random there
    assert re.findall(r'"--(.*?)"', text) == ["coarse", *seeds, "output", "overwrite"]
    if name != "three_field":
        assert text.startswith("# %% [markdown]\n# # ")
        assert len(text.splitlines()) <= (160 if name == "gripper" else 140)


@pytest.mark.parametrize("name", ["gripper", "walker"])
def test_prints_are_read_on_their_own_mesh(name: str) -> None:
    """That of the design has other triangles, and on several ranks another order."""
    *_, after = (ROOT / "demos" / f"{name}.py").read_text().partition("found.printed")
    assert after
    assert not re.search(r"\bdesign\.skin\b|\bprinted\.cells\b", after)


def test_the_middle_of_a_sheet_is_pulled_as_its_tile(
    comm: MPI.Comm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = shared(comm, tmp_path)
    monkeypatch.setattr(sys, "argv", ["tile_sheet", "--coarse", "--output", str(folder)])
    rows = runpy.run_path(str(ROOT / "demos" / "tile_sheet.py"), run_name="__main__")["rows"]
    last = {key: float(value) for key, value in rows[-1].items()}
    assert last["stress_n_per_m"] == pytest.approx(last["stress_predicted_n_per_m"], rel=0.05)
    assert last["stress_n_per_m"] == pytest.approx(42.20104966, rel=1e-6)
    assert last["contraction"] == pytest.approx(0.9662487244, rel=1e-6)
    assert last["contraction_predicted"] == pytest.approx(1.0740217672, rel=1e-6)
    assert 0.1 < last["middle_strain"] < 0.12, "clamps keep the ends wide"
