"""Simulation of an actuator's plain skin, or of a given print, up to the scene's pressure."""

from __future__ import annotations

import logging
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from mpi4py import MPI
from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import OutputError, PanelError, ParameterError
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.validation import Floats
from toros_fem.design.loop.case import Case
from toros_fem.making.drawing import is_drawing, read_drawing
from toros_fem.making.printability import PRINT, case_of_print, read_print_polygons
from toros_fem.measures.figures import Figure, formatted
from toros_fem.mechanics.equilibrium.equilibrium import EquilibriumError
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.trace import trace
from toros_fem.mechanics.paths.trace_point import TracePoint
from toros_fem.meshes.files import PATTERN_FILE, read_print
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.skin import sew
from toros_fem.meshes.transfer import make_transfer
from toros_fem.products.actuators.estimates import (
    Job,
    MetricErrors,
    Printed,
    SimulatedPrint,
    metric_errors,
    values_of,
)
from toros_fem.results.reporter import print_step, with_progress
from toros_fem.results.result import write_summary
from toros_fem.results.runs.stored_run import summary_of
from toros_fem.results.writer import PathResult, draw_pictures, write_pressure_path

if TYPE_CHECKING:  # a scene is simulated here, and says so
    from toros_fem.products.actuators.scene import ActuatorScene, Level

log = logging.getLogger(__name__)

# Relative difference of pressures that are the same.
SAME = 1e-3

FILES = {
    "pattern": f"output folder of a design, its {PATTERN_FILE}, or a drawing; none: "
    "nothing is printed"
}


@dataclass(frozen=True, eq=False, repr=False)
class SimulationResult(PathResult):
    """An actuator that was inflated without being designed.

    Attributes:
        source: Where its print was read; None for a plain skin.
        failure: Why the pressures were not followed to their end; None if they were.
        errors: Errors of its metrics; None if they were not estimated.
    """

    source: str | None = None
    failure: str | None = None
    errors: MetricErrors | None = None

    @property
    def drawn(self) -> bool:
        """Whether its print is a drawing."""
        return self.source is not None and is_drawing(Path(self.source))

    @property
    def figures(self) -> tuple[Figure, ...]:
        """Metrics, pressure and volume at the last point; a plain or drawn skin has no target."""
        found = super().figures
        if self.source is not None and not self.drawn:
            return found
        return tuple(replace(figure, target=None, tolerance=None) for figure in found)

    def entries(self) -> dict[str, Any]:
        """Return errors, inputs and cost."""
        found = {"failure": self.failure, "pattern": self.source, **super().entries()}
        return found if self.errors is None else {**found, "errors": self.errors.as_dict()}

    def description(self) -> str:
        """Return metrics and pressure in a sentence."""
        printed = "as drawn" if self.drawn else "as printed"
        what = "plain skin" if self.source is None else printed
        ended = "" if self.failure is None else f"; it ends there: {self.failure}"
        return f"{super().description()}, {what}{ended}"


def simulate_actuator(
    comm: MPI.Comm,
    scene: ActuatorScene,
    output: Path | str,
    pattern: Path | str | None = None,
    *,
    verbose: bool = False,
) -> SimulationResult:
    """Inflate an actuator without designing it, and write curve, fields and pictures (collective).

    `ActuatorScene.run_simulation` tells what it takes.
    """
    begin = time.perf_counter()
    made, level, density, regions = case_to_simulate(comm, scene, pattern)
    if pattern is not None and not scene.pressure.hold_pressure:
        _tell_pressure(comm, scene.pressure.pressure, Path(pattern))
    skin = sew(comm, made.pattern)
    log = print_step(comm) if verbose else None
    assert made.composite is not None
    solver = EquilibriumSolver(
        skin,
        made.composite,
        made.supports,
        log=log,
        chambers=made.chambers,
        contact=made.contact,
        quadratic=made.quadratic,
    )
    own = density[skin.owned_cells]
    pressures = np.linspace(0.0, scene.pressure.pressure, scene.results.curve_steps + 1)[1:]
    points: list[TracePoint] = []
    failure = None
    path = trace(solver, own, [*map(float, pressures)], made.judged)
    try:
        points.extend(with_progress(comm, path, len(pressures), "pressure"))
    except EquilibriumError as caught:  # raised by all ranks or by none
        failure = str(caught)
        if not points:
            raise
    found = SimulationResult(
        made.pattern,
        points,
        density,
        made.judged,
        made.whole,
        scene.material.composite,
        scene,
        {"total": time.perf_counter() - begin},
        scene.results.tolerance,
        source=None if pattern is None else str(pattern),
        failure=failure,
    )
    write_pressure_path(comm, output, found)
    if scene.results.estimate_error:
        last, measures = points[-1].result, {m.key: m.measure for m in made.judged}
        errors = MetricErrors(failure="a file of triangles has no polygons to print anew.")
        if pattern is None or regions is not None:
            simulated = SimulatedPrint(
                (made.pattern, points[-1].positions), regions, last.pressures
            )
            job, told = Job(comm, scene), values_of(*simulated.near, measures)
            errors = metric_errors(job, level, told, simulated, made.whole.pattern)
        found = replace(found, errors=errors, intervals=errors.intervals, told=errors.told)
    write_summary(comm, output, found)
    draw_pictures(comm, output)
    return found


def case_to_simulate(
    comm: MPI.Comm, scene: ActuatorScene, pattern: Path | str | None
) -> tuple[Case, Level, Floats, Printed | None]:
    """Return a case on its mesh with the level, the density of all triangles, and the print.

    It is collective.

    Raises:
        TorosError: As of `ActuatorScene.run_simulation`, before anything is solved.
    """
    if not scene.pressure.pressure > 0:
        raise ParameterError(
            f"pressure = {scene.pressure.pressure} Pa must be above 0 to simulate with it."
        )
    if pattern is None:
        level = scene.finest_level
        made = scene.case(comm, level)
        given = made.prescribed
        plain = np.zeros(len(made.pattern.panel))
        return made, level, plain if given is None else np.nan_to_num(given, nan=0.0), None
    path, drawing = Path(pattern), is_drawing(Path(pattern))
    has_polygons = on_first_rank(comm, lambda: path.is_dir() and (path / PRINT).exists())
    level = scene.level_of_print if drawing or has_polygons else scene.finest_level
    made = scene.case(comm, level)
    try:
        if drawing:
            print_of_whole: Printed = (made.whole.pattern, _drawn_print(comm, made, path))
        elif has_polygons:
            stored = read_print_polygons(comm, path)
            print_of_whole = stored.pattern, stored.regions
        else:
            source, printed = read_print(comm, path / PATTERN_FILE if path.is_dir() else path)
            density = printed.astype(np.float64)
            if _same(source, made.pattern):
                return replace(made, pattern=source), level, density, None
            there = make_transfer(source, made.pattern).at_cells(density)
            return made, level, (there >= 0.5).astype(np.float64), None
        fine = case_of_print(comm, made, *print_of_whole)
    except PanelError as caught:
        raise PanelError(f"{path} is the pattern of another skin: {caught}") from None
    assert fine.passive is not None
    return fine, level, fine.passive, print_of_whole


def _drawn_print(comm: MPI.Comm, case: Case, path: Path) -> list[BaseGeometry]:
    """Return a drawing with what is always printed, on the whole skin's panels (collective)."""
    pattern = case.whole.pattern
    drawn = read_drawing(comm, path, pattern)
    if case.prescribed is None:
        return drawn
    always = case.whole.at_cells(case.prescribed) == 1

    def joined() -> list[BaseGeometry]:
        regions = []
        for panel, region in enumerate(drawn):
            own = always[pattern.panel == panel]
            cells = pattern.flat_points[pattern.flat_triangles[(pattern.panel == panel) & always]]
            printed = pattern.outline(panel) if own.all() else shapely.polygons(cells)
            regions.append(shapely.union_all([region, *np.atleast_1d(printed)]))
        return regions

    return on_first_rank(comm, joined)


def _tell_pressure(comm: MPI.Comm, taken: float, source: Path) -> None:
    """Warn where the print of a run has another pressure by its design (collective)."""
    if not on_first_rank(comm, source.is_dir):
        return

    def chosen() -> list[float]:
        with suppress(OutputError):  # the print alone is enough to simulate it
            return [float(p) for p in summary_of(source).entries.get("pressures_pa", ())]
        return []

    designed = on_first_rank(comm, chosen)
    if np.allclose(designed, taken, rtol=SAME) or comm.rank != 0:
        return
    own, given = ", ".join(formatted(p, "pa") for p in designed), formatted(taken, "pa")
    several = len(set(designed)) > 1
    advice = f'Add --set pressure="{own}" for that one.'
    log.warning(
        "the design of the print in %s chose the pressure %s, and this simulation takes %s. %s",
        source, own, given, "It has one pressure for all chambers." if several else advice,
    )  # fmt: skip


def _same(one: Pattern, other: Pattern) -> bool:
    """Return whether two patterns have the same triangles, whose corners may have moved."""
    return (
        np.array_equal(one.flat_triangles, other.flat_triangles)
        and np.array_equal(one.sewn, other.sewn)
        and one.panel_names == other.panel_names
        and bool(np.allclose(one.points, other.points, rtol=0, atol=0.02 * other.size))
    )
