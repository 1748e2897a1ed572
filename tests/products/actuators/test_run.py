"""A design run: polishing, prints and refined meshes without equilibrium, the closing sentence."""

import csv
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.designs import DESIGN_ALONE, problem_of
from helpers.scenes import shared
from mpi4py import MPI

from toros_fem.base.errors import OutputError
from toros_fem.design.loop import fields
from toros_fem.design.loop.case import PRESSURE_WEIGHT, Case
from toros_fem.design.loop.fields import densities_of
from toros_fem.design.loop.loop import optimize
from toros_fem.design.loop.shape_design import ShapeDesign, ShapeProblem
from toros_fem.measures.figures import largest_part
from toros_fem.measures.metrics import Metric
from toros_fem.mechanics.equilibrium.equilibrium import EquilibriumError
from toros_fem.meshes import Skin, bend
from toros_fem.products import tubes
from toros_fem.products.actuators import designer
from toros_fem.products.actuators.designer import DensityDesigner
from toros_fem.products.actuators.pressure import NOT_FROM_REST, OTHER_SHAPE, CurveFigures
from toros_fem.products.actuators.scene import Level
from toros_fem.products.tubes import TubeScene, bend_metric
from toros_fem.results.reporter import DesignReporter
from toros_fem.results.runs.frames import FOLDER, Frame, read_frames

pytestmark = pytest.mark.usefixtures("without_pictures")


class Bent(TubeScene):
    """A tube to be bent by 45 degrees."""

    def case(self, comm: MPI.Comm, level: Level) -> Case:
        """The whole tube."""
        deform = bend(np.radians(45), 0.08, neutral=0.01)
        return self.tube_case(comm, level, deform, [bend_metric(45.0)])


SHORT = Bent.of(
    length=0.08,
    edge_length=4.5e-3,
    filter_radius=7e-3,
    iterations=1,
    constrained_iterations=0,
    polish_iterations=0,
    corrections=0,
    **DESIGN_ALONE,
)


def test_problem_holds_what_the_configuration_says(alone: MPI.Comm) -> None:
    plain = problem_of(alone, SHORT)
    assert plain.terms == ()
    assert plain.length_scale is None
    assert plain.physics.pressure_ranges == ((1e3, 10e3),)
    assert plain.pressure_weight == PRESSURE_WEIGHT
    assert plain.fields.filter.radius == 7e-3
    config = SHORT.updated(
        perimeter_weight=1e-4, perimeter_window=0.5, constrained_iterations=3,
        pressure=4e3, hold_pressure=True, beta=8.0, filter="helmholtz",
    )  # fmt: skip
    full = problem_of(alone, config)
    (term,) = full.terms
    assert term.price == 1e-4 / full.skin.pattern.size
    assert full.length_scale is not None
    assert full.physics.pressure_ranges == (None,)
    assert full.physics.pressures == (4e3,)
    assert full.fields.projection.beta == 8.0
    assert full.fields.filter.name == "helmholtz"


def with_spots(*spots: tuple[float, float, float]) -> Callable[[Skin, int], np.ndarray]:
    """Starts with a band along a tube, and spots beside it: part of the width, height, radius."""

    def start(skin: Skin, seed: int) -> np.ndarray:
        wall = skin.pattern.cells_of("wall")
        u, v = skin.pattern.centroids.T
        width = u[wall].max()
        printed = np.abs(u - width / 2) < 8e-3
        for part, height, radius in spots:
            printed |= np.hypot(u - part * width, v - height) < radius
        return printed.astype(float)[skin.owned_cells]

    return start


@pytest.mark.slow
def test_polishing_removes_islands(
    alone: MPI.Comm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From a start with a lone spot in a corner that the few steps cannot remove."""
    monkeypatch.setattr(fields, "random_density", with_spots((0.2, 0.04, 6e-3)))
    config = SHORT.updated(move_limit=0.01, island_area=0.0)
    left = config.run_design(alone, tmp_path / "left").summary()
    assert left["dropped"]["before"]["islands"] == left["dropped"]["islands_bridged"] == 1
    assert left["manufacture"]["islands"] == 0
    polished = config.updated(polish_iterations=2)
    gone = polished.run_design(alone, tmp_path / "gone").summary()
    assert gone["iterations"] == left["iterations"] + 2
    assert gone["dropped"]["before"]["islands"] == 0
    assert gone["manufacture"]["islands"] == 0


@pytest.mark.slow
def test_a_print_that_misses_is_polished_from_each_pattern(
    alone: MPI.Comm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A speck and a larger island: neither, one or both are removed. The best print is kept."""
    spots = with_spots((0.15, 0.02, 5e-3), (0.85, 0.04, 9e-3))
    monkeypatch.setattr(fields, "random_density", spots)
    config = SHORT.updated(move_limit=0.01, polish_iterations=2, tolerance=1e-6)
    polishes = list[float]()

    def counted(*args: Any, **named: Any) -> Any:
        found = optimize(*args, **named)
        polishes.append(found.final.objective)
        return found

    monkeypatch.setattr("toros_fem.products.actuators.designer.optimize", counted)
    worst_of, misses = DensityDesigner.worst, list[float]()

    def noted(self: DensityDesigner, printed: Any) -> float:
        misses.append(worst_of(self, printed))
        return misses[-1]

    monkeypatch.setattr(DensityDesigner, "worst", noted)
    made = config.run_design(alone, tmp_path)
    assert largest_part(made.figures) == pytest.approx(min(misses))
    assert min(misses) < 0.999 * max(misses)
    assert len(polishes) == 3
    assert len(set(polishes)) == 3
    assert largest_part(made.figures) > 1
    assert made.design.final.objective in polishes
    iterations = made.design.history[-1].iteration
    names = {path.name.split("-")[0] for path in (tmp_path / FOLDER).glob("*.npz")}
    assert names == {"iteration", "print", "skin"}
    frames = read_frames(tmp_path / FOLDER, "iteration")
    assert [frame.number for frame in frames] == list(range(iterations + 1))


def fails(*_: object, **__: object) -> None:
    """In place of a simulation."""
    raise EquilibriumError("made to fail", None)  # type: ignore[arg-type]


def test_print_without_equilibrium(
    alone: MPI.Comm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No figure of the design stands for the print's."""
    monkeypatch.setattr(ShapeProblem, "simulate_binary", fails)
    config = SHORT.updated(estimate_error=True)
    made = config.run_design(alone, tmp_path)
    summary = made.summary()
    assert summary["printed_failure"] == "made to fail"
    assert (
        made.value("angle_deg") is summary["printed_objective"] is made.value("volume_m3") is None
    )
    assert summary["design"]["angle_deg"] is not None
    assert made.errors is None
    assert made.figures[0].as_dict()["reached"] is False
    assert "angle no equilibrium of 45°" in made.sentence()
    times = {path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir() if path.is_file()}
    of_design = ("history.csv", "print.npz", "pattern.svg", "skin.vtu")
    assert times["summary.json"] > max(times[name] for name in of_design), "it is the last"


def test_a_print_has_its_own_mesh_and_intervals(alone: MPI.Comm, tmp_path: Path) -> None:
    """Figures are those of the print's mesh; coarser ones tell how far they may be off."""
    made = SHORT.updated(estimate_error=True).run_design(alone, tmp_path)
    figure, meshes = made.figures[0], made.summary()["errors"]["meshes"]
    assert figure.value == meshes[1.0]["angle_deg"]
    assert set(meshes[1.0]) >= {"angle_deg", "shape_distance_mm"}
    assert abs(figure.value - meshes[1.5]["angle_deg"]) < figure.interval
    assert "±" in made.sentence()
    problem = made.printed.evaluation.problem
    assert isinstance(problem, ShapeDesign)
    assert problem.case.quadratic is not None
    assert problem.case.quadratic.any()


@pytest.mark.parametrize(
    ("joins", "doubt"), [(True, None), (False, OTHER_SHAPE), (None, NOT_FROM_REST)]
)
def test_a_shape_that_inflating_does_not_reach_is_told(
    alone: MPI.Comm,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    joins: bool | None,
    doubt: str | None,
) -> None:
    curve = CurveFigures(points=3, joins_rest=joins)
    assert curve.doubt == doubt
    monkeypatch.setattr(designer, "write_curve", lambda *_: curve)
    made = SHORT.run_design(alone, tmp_path)
    for told in (made.binding, made.sentence(), caplog.text):
        assert ("inflat" in str(told)) is (doubt is not None)
        assert doubt is None or doubt in told


def test_a_run_without_pictures_shows_its_page(
    alone: MPI.Comm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And a reporter that was made earlier counts the set-up too, the last trial as well."""
    reporter, until_trial = DesignReporter(alone, tmp_path), []

    def trial(*_: object) -> None:
        until_trial.append(reporter.seconds["total"])

    monkeypatch.setattr(Bent, "trial", trial)
    made = SHORT.run_design(alone, tmp_path, reporter=reporter)
    assert made.figures[0].interval is None
    assert {figure.state for figure in made.figures} <= {None, "missed", "not certain"}
    assert "its error is unknown" in made.sentence()
    assert "±" not in made.sentence()
    assert "<td>angle</td>" in made._repr_html_()
    assert made.folder == tmp_path
    assert 'id="canvas"' in made.show().page
    with pytest.raises(OutputError, match="has no files yet"):
        replace(made).show()
    assert (tmp_path / "pattern.svg").exists()
    summary = made.summary()
    assert summary["seed"] == SHORT.design.seed
    assert summary["inputs"] == SHORT.as_dict()
    assert 0 < summary["seconds"]["setup"] < until_trial[0] <= summary["seconds"]["total"]
    last = made.design.history[-1]
    assert last.metrics["angle_deg"] == summary["design"]["angle_deg"]


@pytest.mark.slow
@pytest.mark.parametrize("levels", [1, 2])
def test_several_starts(comm: MPI.Comm, tmp_path: Path, levels: int) -> None:
    """The best one goes on, with one mesh alone on that; the history begins with its rows."""
    folder = shared(comm, tmp_path)
    config = SHORT.updated(
        edge_length=3.4e-3 * 2 / levels, filter_radius=5.2e-3 * 2 / levels, diameter=0.04,
        levels=levels, starts=2, seed=3, iterations=2, constrained_iterations=1,
        level_iterations=1,
    )  # fmt: skip
    made = config.run_design(comm, folder)
    summary, history = made.summary(), made.design.history
    assert set(summary["starts"]) == {"3", "4"}
    assert str(summary["seed"]) == min(summary["starts"], key=summary["starts"].__getitem__)
    assert [row.level for row in history] == [0] * 5 + [1] * 2
    assert history[4].objective == summary["starts"][str(summary["seed"])]
    assert made.problem.skin.comm.size == comm.size
    assert densities_of(made.problem.fields).filter.radius == config.design.filter_radius
    comm.barrier()
    with (folder / "history.csv").open(encoding="utf-8") as file:
        assert [float(row["objective"]) for row in csv.DictReader(file)] == [
            row.objective for row in history
        ]


@pytest.mark.slow
def test_of_several_seeds_the_best_is_kept(alone: MPI.Comm, tmp_path: Path) -> None:
    """None reaches the target, so that all are tried; each is the design of its seed alone."""
    config = tubes.BendScene.of(angle=170.0, iterations=4, corrections=0, **COARSE)
    single = [config.updated(seed=seed).run_design(alone, tmp_path / f"{seed}") for seed in (1, 2)]
    best = min(single, key=lambda one: largest_part(one.figures))
    made = config.updated(seeds=2).run_design(alone, tmp_path / "both")

    def frames_of(name: str) -> list[Frame]:
        return read_frames(tmp_path / name / FOLDER, "iteration")

    assert {path.name.split("-")[0] for path in (tmp_path / "both" / FOLDER).glob("*.npz")} == {
        path.name.split("-")[0] for path in (tmp_path / "1" / FOLDER).glob("*.npz")
    }, "no frames of the other attempt"
    assert made.search.seed == best.search.seed
    assert made.metrics == pytest.approx(best.metrics, rel=1e-9)
    rows = (tmp_path / "both" / "history.csv").read_text().splitlines()
    assert len(rows) == 1 + len(best.design.history)
    for a, b in zip(*(frames_of(name) for name in (f"{best.search.seed}", "both")), strict=True):
        assert a.number == b.number
        assert a.positions == pytest.approx(b.positions)


COARSE: dict[str, Any] = {
    "length": 0.06, "edge_length": 5e-3, "filter_radius": 8e-3, "levels": 1, "seed": 1,
    "constrained_iterations": 0, "polish_iterations": 0, **DESIGN_ALONE,
}  # fmt: skip


class Judged(tubes.BendScene):
    """A tube that is judged by its height too."""

    def case(self, comm: MPI.Comm, level: Level) -> Case:
        """The tube with one more metric."""
        bent = super().case(comm, level)
        height = Metric("height", "mm", 50.0, lambda _, x: float(1e3 * x[:, 2].max()), scale=1e6)
        return replace(bent, metrics=(*bent.judged, height))


@pytest.mark.slow
def test_a_corrected_design(alone: MPI.Comm, tmp_path: Path) -> None:
    """Its objective is the problem's own, and its print is not farther off than the first."""
    few = {"iterations": 4, "level_iterations": 2}
    config = Judged.of(angle=40.0, **few, **COARSE)
    first, made = (
        config.updated(corrections=rounds).run_design(alone, tmp_path / f"{rounds}")
        for rounds in (0, 2)
    )
    assert made.figures[0].target == 40.0
    assert largest_part(made.figures) <= largest_part(first.figures)
    assert made.search.rounds >= 1
    final = made.design.final
    objective = made.problem.objective.forward(final.equilibrium.positions)
    assert final.shape == pytest.approx(objective, rel=1e-12)


@pytest.mark.slow
def test_a_design_that_does_not_follow_is_not_asked_again(alone: MPI.Comm, tmp_path: Path) -> None:
    few = {"iterations": 2, "level_iterations": 1, "corrections": 4}
    config = tubes.BendScene.of(angle=90.0, level_move_limit=1e-4, **few, **COARSE)
    made = config.run_design(alone, tmp_path)
    rounds = made.search.rounds
    assert 1 <= rounds < 4
    assert made.binding[-1] == f"correction {rounds} hardly helped"
