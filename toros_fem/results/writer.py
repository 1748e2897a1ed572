"""The files of a finished run: summary, history, drawing, fields and pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.files import guarded, if_plotting, naming, replacing, write_table
from toros_fem.base.keys import Table
from toros_fem.base.scene import Scene
from toros_fem.base.validation import Floats, require_kind
from toros_fem.design.loop.loop import DesignResult
from toros_fem.design.loop.miss import shape_of
from toros_fem.design.loop.problem import Evaluation
from toros_fem.design.loop.shape_design import ShapeProblem
from toros_fem.making.as_printed import PrintedDesign
from toros_fem.making.panel_drawing import write_svg
from toros_fem.making.printability import PRINT, printed_cells, write_print_polygons
from toros_fem.materials.sheet import Composite
from toros_fem.measures.figures import TOLERANCE, Figure
from toros_fem.measures.metrics import Metric
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.paths.trace_point import TracePoint
from toros_fem.mechanics.readings.wrinkles import Tension, WrinkleField, wrinkles
from toros_fem.meshes.files import PATTERN_FILE, write_pattern
from toros_fem.meshes.pattern import Mirrored, Pattern, Regions
from toros_fem.meshes.transfer import make_transfer
from toros_fem.results.result import (
    PrintedResult,
    RunResult,
    shape_problem,
    state_figures,
    write_summary,
)
from toros_fem.results.runs.frames import Frame, ShownSkin
from toros_fem.results.runs.open_run import require_open
from toros_fem.results.runs.record import shown_skin, whole_cells, write_path, write_series
from toros_fem.results.runs.stored_run import notes_at


def write_results(
    folder: str | Path,
    result: DesignResult,
    printed: PrintedDesign,
    *,
    config: Table | None = None,
    seconds: Mapping[str, float] | None = None,
    intervals: Mapping[str, float] | None = None,
) -> dict[str, Any]:
    """Write history, drawing, fields, pictures and summary of a design (collective).

    The table toros_fem/results/files.csv says what each file holds. When all are there,
    summary.json follows, and then the pictures. Where the print has no equilibrium, pictures and
    fields show the design's own shape.

    Args:
        config: Configuration of the run, for "inputs" in the summary.
        seconds: Further wall times in s, those of `DesignReporter.seconds` for instance.
        intervals: Half-widths of the intervals of figures, as of `print_intervals`; None leaves
            them unknown, so that no target counts as reached.

    Returns:
        The summary, as in summary.json; equal on all ranks.

    Raises:
        OutputError: A file cannot be written; on all ranks.
        ParameterError: The result is not the design of a shape.
    """
    require_kind("folder", folder, (str, Path), "the path of a folder")
    shape_problem(result)
    require_kind("printed", printed, PrintedDesign, "a PrintedDesign, by as_printed")
    made = PrintedResult(
        result,
        printed,
        printed.metrics,
        intervals or {},
        config=config,
        seconds=seconds or {},
        shape=shape_of(printed.evaluation),
    )
    write_design(folder, made)
    summary = write_summary(made.problem.comm, folder, made)
    draw_pictures(made.problem.comm, folder)
    return summary


def write_design(folder: str | Path, found: PrintedResult) -> None:
    """Write the files of `write_results` without summary.json and its pictures (collective).

    Raises:
        OutputError: A file cannot be written; on all ranks.
    """
    folder, printed, final = Path(folder), found.printed, found.design.final
    shown, designed = printed.evaluation or final, found.problem
    problem = shown.problem
    assert isinstance(problem, ShapeProblem)
    whole, part = problem.whole, problem.skin.pattern
    pattern, cells = whole.pattern, printed.cells
    if printed.pattern is not pattern:
        cells = printed_cells(pattern, printed.regions)  # on the mesh of the design
    # Fields are those of the equilibrium on its mesh; pictures show what a finer one tells.
    positions = whole.at_vertices(problem.skin.gather_vertices(shown.equilibrium.positions))
    composite, stiffened = problem.solver.model.composite, whole_cells(problem, shown.projected)
    folds = wrinkles_of(pattern, composite, stiffened, positions)
    design = {
        "rho": found.design.density,
        "rho_filtered": final.filtered,
        "rho_projected": final.projected,
    }
    before = designed.skin
    transfer = None if before.pattern is part else make_transfer(before.pattern, part)
    fields = {"printed": cells.astype(np.float64)}
    for name, owned in design.items():
        every = before.gather_cells(owned)
        fields[name] = whole.at_cells(every if transfer is None else transfer.at_cells(every))
    drawn = problem.physics.shape_of(shown.equilibrium) if found.finer is None else found.finer
    values = {"pressure_pa": shown.equilibrium.pressure, **found.shown_metrics}
    note = shown.equilibrium.condition.sentences
    if folds is not None:
        slack = 1 - folds.share(Tension.TAUT, pattern.areas)
        note = f"{note} {slack:.0%} of the skin is wrinkled or slack.".strip()
    density = fields["rho_projected"] if printed.evaluation is None else None
    frame = Frame("print", 0, "", whole.at_vertices(drawn), density, values, note)
    seen = shown_skin(problem, printed.regions, shown.equilibrium.poses)
    poses = list(_pose_frames(shown, printed.regions)) if shown.poses else []

    def write() -> None:
        require_open(folder)
        write_table(folder / "history.csv", [row.columns() for row in found.design.history])
        write_print_polygons(folder / PRINT, printed.pattern, printed.regions, printed.limits)
        write_svg(folder / "pattern.svg", printed.pattern, printed.regions)
        # Of a part: its triangles are the first of the whole.
        write_pattern(folder / PATTERN_FILE, part, cells[: len(part.panel)])
        write_series(folder, seen, [frame])
        for skin, pose in poses:
            write_series(folder, skin, [pose])
        write_skin_fields(folder, pattern, positions, fields, folds)

    guarded(found.problem.comm, folder, write)


def _pose_frames(
    shown: Evaluation[Equilibrium], regions: Regions
) -> Iterator[tuple[ShownSkin, Frame]]:
    """Yield the shape of each pose on the print's mesh, with its skin and target (collective)."""
    for number, one in enumerate(shown.every, 1):
        problem, state = one.problem, one.equilibrium
        assert isinstance(problem, ShapeProblem)
        positions = problem.whole.at_vertices(problem.physics.shape_of(state))
        values = {"pressure_pa": state.pressure, **problem.metrics_of(state)}
        note = state.condition.sentences
        skin = shown_skin(problem, regions, state.poses)
        yield skin, Frame("pose", number, "", positions, None, values, note)


def draw_pictures(
    comm: MPI.Comm, folder: str | Path, more: Callable[[], None] = lambda: None
) -> None:
    """Draw the pictures of a folder with its summary, and further ones on one rank (collective).

    Raises:
        OutputError: A picture cannot be written; on all ranks.
    """

    def draw() -> None:
        from toros_fem.results.pictures.of_run import draw_run

        draw_run(folder)
        more()

    guarded(comm, folder, lambda: if_plotting(draw))


def wrinkles_of(
    pattern: Pattern, composite: Composite | None, density: Floats, positions: Floats
) -> WrinkleField | None:
    """Return the wrinkles of a tension field; None of other sheets."""
    if composite is None or not composite.membrane.relaxed:
        return None
    return wrinkles(pattern, composite, density, positions)


def write_skin_fields(
    folder: Path,
    pattern: Pattern,
    positions: Floats,
    fields: Mapping[str, Floats],
    folds: WrinkleField | None,
) -> None:
    """Write skin.vtu as `write_fields` does, and wrinkles.png of a tension field (one rank)."""
    path = folder / "skin.vtu"
    if folds is None:
        write_fields(path, pattern, positions, fields)
        return
    of_folds = {"wrinkling": folds.state.astype(np.float64), "tension": folds.direction}
    write_fields(path, pattern, positions, {**fields, **of_folds})

    def draw() -> None:
        from toros_fem.results.pictures.flat import draw_wrinkles
        from toros_fem.results.pictures.style import page

        with page(folder / "wrinkles.png") as figure:
            draw_wrinkles(figure, pattern, folds)

    if_plotting(draw)


def write_fields(
    path: Path, pattern: Pattern, positions: Floats, cell_fields: Mapping[str, Floats]
) -> None:
    """Write the deformed skin as a VTU file (one rank).

    The displacement from the assembled shape is written too, so that a viewer can show either.
    Positions, (n, 3), in m, are those of all assembled vertices, fields of all triangles, (t,) or
    (t, 3) for vectors.

    Raises:
        OutputError: The file cannot be written.
    """
    import meshio

    fields = meshio.Mesh(
        positions,
        [("triangle", pattern.triangles)],
        point_data={"displacement": positions - pattern.points},
        cell_data={
            "panel": [pattern.panel.astype(np.float64)],
            **{name: [np.asarray(values)] for name, values in cell_fields.items()},
        },
    )
    with naming(path), replacing(path) as beside:
        fields.write(beside, file_format="vtu")


@dataclass(frozen=True, eq=False, repr=False)
class PathResult(RunResult):
    """A skin followed over the pressure: what `write_pressure_path` writes.

    Attributes:
        density: Density of all triangles, (t,), to colour by.
        whole: The whole skin that the pattern is a part of, by `meshes.mirrored`: volumes, fields
            and pictures are its own.
        composite: Materials; those of a tension field add the wrinkles of the last state to the
            fields and pictures.
        tolerance: Part of its target that a metric may be off by and count as reached.
        intervals: Half-width of the interval of each metric at the last point, by key, if known.
        told: Values of metrics there that are told in place of the last point's, by key.
    """

    pattern: Pattern
    points: Sequence[TracePoint]
    density: Floats
    metrics: Sequence[Metric]
    whole: Mirrored
    composite: Composite | None = None
    config: Scene | None = None
    seconds: Mapping[str, float] = field(default_factory=dict)
    tolerance: float = TOLERANCE
    intervals: Mapping[str, float] = field(default_factory=dict)
    told: Mapping[str, float] = field(default_factory=dict)

    @property
    def figures(self) -> tuple[Figure, ...]:
        """Metrics, pressure and volume at the last point."""
        last = self.points[-1]
        told = {**last.metrics, **self.told}
        return (
            *(
                m.figure(told[m.key], self.intervals.get(m.key), self.tolerance)
                for m in self.metrics
            ),
            *state_figures(last.result.pressure, last.result, self.whole.parts),
        )

    @property
    def notes(self) -> list[str]:
        """What is not as usual at its points."""
        return notes_at((p.result.pressure, p.result.condition.sentences) for p in self.points)

    def entries(self) -> dict[str, Any]:
        """Return inputs and cost."""
        return {
            "newton_steps": sum(point.result.steps for point in self.points),
            "triangles": len(self.pattern.panel),
            "parts_by_symmetry": self.whole.parts,
            "inputs": None if self.config is None else self.config.as_dict(),
            "seconds": dict(self.seconds),
        }

    def description(self) -> str:
        """Return the metrics and the pressure in a sentence."""
        pressure = self.points[-1].result.pressure
        values = [f"{f.name} {f.shown}" for f in self.figures[: len(self.metrics)]]
        return f"{', '.join(values)} at {pressure / 1e3:.2f} kPa"


def write_pressure_path(comm: MPI.Comm, folder: str | Path, found: PathResult) -> None:
    """Write table, frames and fields of a pressure path into a folder (collective).

    Raises:
        OutputError: A file cannot be written; on all ranks.
    """
    folder, points, whole = Path(folder), found.points, found.whole
    skin, density, last = whole.pattern, whole.at_cells(found.density), points[-1]
    shape = whole.at_vertices(last.positions)
    rows = [
        {
            "pressure_pa": point.result.pressure,
            "volume_m3": whole.parts * point.result.volume,
            "stretch_use": point.result.stretch_use,
            **point.metrics,
        }
        for point in points
    ]
    folds = wrinkles_of(skin, found.composite, density, shape)

    def write() -> None:
        write_table(folder / "curve.csv", rows)
        write_path(folder, "pressure", ShownSkin(skin), points, whole, density)
        write_skin_fields(folder, skin, shape, {"density": density}, folds)

    guarded(comm, folder, write)
