"""The files of a finished run: summary, history, drawing, fields and pictures."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats
from toros_fem.base.files import write_json, write_table, write_together
from toros_fem.base.keys import Table
from toros_fem.base.scene import Scene
from toros_fem.base.validation import require_kind
from toros_fem.base.versions import versions
from toros_fem.design.lines.field import LineField
from toros_fem.design.loop.loop import DesignResult
from toros_fem.making.as_printed.as_printed import PrintedDesign
from toros_fem.making.panels.svg import write_svg
from toros_fem.making.print.print_file import NAME as PRINT
from toros_fem.making.print.print_file import write_print_polygons
from toros_fem.materials.sheet import Composite
from toros_fem.measures.metrics import Metric
from toros_fem.mechanics.paths.trace_point import TracePoint
from toros_fem.mechanics.readings.wrinkles import Tension, WrinkleField, wrinkles
from toros_fem.meshes.mirror import Mirrored
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.pattern_file import NAME, write_pattern
from toros_fem.results.files import write_fields
from toros_fem.results.frames.record import shown_skin, write_path, write_print
from toros_fem.results.frames.shown_skin import ShownSkin
from toros_fem.results.summary import design_summary, shape_problem


def write_results(
    folder: str | Path,
    result: DesignResult,
    printed: PrintedDesign,
    *,
    config: Scene | Table | None = None,
    figures: Mapping[str, Any] | None = None,
    seconds: Mapping[str, float] | None = None,
    field: LineField | None = None,
    start: LineField | None = None,
    pictures: bool = True,
) -> dict[str, Any]:
    """Write summary, history, drawing, fields and pictures of a design (collective).

    The files are summary.json, history.csv, print.npz, pattern.svg, pattern.npz, skin.vtu,
    pattern.png, manufacture.png, shape.png and convergence.png; of a design that began with
    densities also design.png, of line families lines.png, of a tension field wrinkles.png. Where
    the print has no equilibrium, the pictures and fields show the design's own shape.

    Args:
        folder: Output folder, made if missing.
        result: Result of the design loop.
        printed: The printed pattern, by `as_printed`.
        config: Configuration of the run, for "inputs" in the summary.
        figures: Further entries of the summary.
        seconds: Further wall times in s, those of `DesignReporter.seconds` for instance.
        field: Line families that the design was made of; None for none.
        start: Line families that these began with, for lines.png; None leaves them out.
        pictures: Whether to draw pictures; without them, what matters most is on disk at once.

    Returns:
        The summary, as in summary.json; equal on all ranks.

    Raises:
        OutputError: A file cannot be written; on all ranks.
        ParameterError: The result is not the design of a shape.
    """
    require_kind("folder", folder, (str, Path), "the path of a folder")
    problem = shape_problem(result)
    require_kind("printed", printed, PrintedDesign, "a PrintedDesign, by as_printed")
    folder = Path(folder)
    skin, final, whole = problem.skin, result.final, problem.whole
    summary = design_summary(result, printed, config=config, figures=figures, seconds=seconds)
    shown = printed.evaluation or final
    positions, target = skin.gather_vertices(shown.equilibrium.positions), problem.target
    composite, stiffened = problem.solver.model.composite, skin.gather_cells(shown.projected)
    fields = {
        "rho": skin.gather_cells(result.density),
        "rho_filtered": skin.gather_cells(final.filtered),
        "rho_projected": skin.gather_cells(final.projected),
    }
    if whole is not None:
        positions = whole.at_vertices(positions)
        target = None if target is None else whole.at_vertices(target)
        fields = {name: whole.at_cells(values) for name, values in fields.items()}
        stiffened = whole.at_cells(stiffened)
    folds = _wrinkles_of(printed.pattern, composite, stiffened, positions)
    fields |= _wrinkle_fields(folds)
    fields["printed"] = printed.cells.astype(np.float64)
    made = printed.evaluation is not None
    shown_print = shown_skin(problem, printed.regions if made else None)
    values = {
        "pressure_pa": shown.equilibrium.pressure,
        **problem.metrics_of(shown.equilibrium),
    }
    note = shown.equilibrium.condition.sentences
    if folds is not None:
        slack = 1 - folds.share(Tension.TAUT, printed.pattern.areas)
        note = f"{note} {slack:.0%} of the skin is wrinkled or slack.".strip()
    density = None if made else fields["rho_projected"]

    def write() -> None:
        write_json(folder / "summary.json", summary)
        write_table(folder / "history.csv", [row.columns() for row in result.history])
        write_print_polygons(folder / PRINT, printed.pattern, printed.regions, printed.limits)
        write_svg(folder / "pattern.svg", printed.pattern, printed.regions)
        # Of a part: its triangles are the first of the whole.
        write_pattern(folder / NAME, skin.pattern, printed.cells[: len(skin.pattern.panel)])
        write_print(folder, shown_print, positions, values, note, density)
        write_fields(folder / "skin.vtu", printed.pattern, positions, fields)
        if pictures:
            if_plotting(draw)

    def draw() -> None:
        from toros_fem.results.pictures.curve_plot import plot_convergence
        from toros_fem.results.pictures.design_plot import plot_design
        from toros_fem.results.pictures.line_plot import plot_line_field, plot_wrinkles
        from toros_fem.results.pictures.pattern_plot import plot_pattern, plot_printability
        from toros_fem.results.pictures.shape_plot import plot_shape

        plot_pattern(folder / "pattern.png", printed.pattern, printed.regions)
        plot_printability(
            folder / "manufacture.png",
            printed.pattern,
            printed.regions,
            printed.after,
            printed.limits,
        )
        plot_shape(
            folder / "shape.png",
            printed.pattern,
            positions,
            target,
            printed.regions,
            _title(problem.metrics, summary),
        )
        plot_convergence(folder / "convergence.png", result.history, problem.metrics)
        if result.initial is not None:
            plot_design(
                folder / "design.png",
                (result.initial.pattern, result.initial.density),
                printed.pattern,
                fields["rho_projected"],
                printed.regions,
            )
        if field is not None:
            plot_line_field(folder / "lines.png", field, printed.pattern, printed.regions, start)
        if folds is not None:
            plot_wrinkles(folder / "wrinkles.png", printed.pattern, folds)

    write_together(skin.comm, folder, write)
    return summary


def _wrinkles_of(
    pattern: Pattern, composite: Composite | None, density: Floats, positions: Floats
) -> WrinkleField | None:
    """Return the wrinkles of a tension field; None of other sheets."""
    if composite is None or not composite.membrane.relaxed:
        return None
    return wrinkles(pattern, composite, density, positions)


def _wrinkle_fields(folds: WrinkleField | None) -> dict[str, Floats]:
    """Return the fields of skin.vtu that show wrinkles."""
    if folds is None:
        return {}
    return {"wrinkling": folds.state.astype(np.float64), "tension": folds.direction}


def _title(metrics: Sequence[Metric], summary: Mapping[str, Any]) -> str:
    """Return the title of the picture of the shape: metrics, their targets and the pressure."""
    as_printed = summary["printed_failure"] is None
    values = summary if as_printed else summary["design"]
    # Of a distance or a gap the target is 0, which says nothing.
    found = ", ".join(
        f"{m.name} {m.formatted(values[m.key])}"
        + (f" of {m.formatted(m.target)}" if m.target else "")
        for m in metrics
    )
    shown = "as printed" if as_printed else "as designed, not as printed,"
    return f"{found} {shown} at {summary['pressure_pa'] / 1e3:.3g} kPa"


def write_comparison(
    comm: MPI.Comm,
    folder: str | Path,
    name: str,
    content: Mapping[str, Any],
    pattern: Pattern,
    panel: str,
    variants: Sequence[tuple[str, BaseGeometry, str]],
) -> None:
    """Write the table and the picture strip of several designs (collective).

    Args:
        comm: Communicator.
        folder: Output folder, made if missing.
        name: Name of both files, without ending.
        content: Content of the JSON file.
        pattern: The pattern.
        panel: Name of the panel to show.
        variants: For each variant its title, its print on that panel, in m, and a caption.

    Raises:
        OutputError: A file cannot be written; on all ranks.
    """
    folder = Path(folder)

    def draw() -> None:
        from toros_fem.results.pictures.pattern_plot import plot_variants

        plot_variants(folder / f"{name}.png", pattern, panel, variants)

    def write() -> None:
        write_json(folder / f"{name}.json", content)
        if_plotting(draw)

    write_together(comm, folder, write)


def write_pictures(
    comm: MPI.Comm, folder: str | Path, pictures: Mapping[str, Callable[[Path], None]]
) -> None:
    """Write pictures, each by a function of its path (collective).

    Args:
        comm: Communicator.
        folder: Output folder, made if missing.
        pictures: For the name of each file what draws it, called on the first rank only.

    Raises:
        OutputError: A file cannot be written; on all ranks.
    """
    folder = Path(folder)

    def draw() -> None:
        for name, picture in pictures.items():
            picture(folder / name)

    write_together(comm, folder, lambda: if_plotting(draw))


def write_pressure_path(
    comm: MPI.Comm,
    folder: str | Path,
    pattern: Pattern,
    points: Sequence[TracePoint],
    density: Floats,
    metrics: Sequence[Metric],
    *,
    whole: Mirrored | None = None,
    composite: Composite | None = None,
    config: Scene | Table | None = None,
    figures: Mapping[str, Any] | None = None,
    seconds: Mapping[str, float] | None = None,
) -> dict[str, Any]:
    """Write table, fields, pictures and summary of a pressure path (collective).

    Args:
        comm: Communicator.
        folder: Output folder, made if missing.
        pattern: The pattern.
        points: The equilibria.
        density: Density of all triangles, (t,), to colour by.
        metrics: Numbers that were measured, drawn over the pressure.
        whole: The whole skin that the pattern is a part of, by `meshes.mirrored`: volumes, fields
            and pictures are its own. None: the pattern is whole.
        composite: Materials; those of a tension field add the wrinkles of the last state to the
            fields and pictures. None adds nothing.
        config: Configuration of the run, for "inputs" in the summary.
        figures: Further entries of the summary.
        seconds: Wall times in s.

    Returns:
        The summary, as in summary.json; equal on all ranks.

    Raises:
        OutputError: A file cannot be written; on all ranks.
    """
    folder = Path(folder)
    parts, skin, shapes = 1, pattern, [p.positions for p in points]
    if whole is not None:
        parts, skin = len(whole.cell) // len(pattern.panel), whole.pattern
        shapes, density = [whole.at_vertices(x) for x in shapes], whole.at_cells(density)
    rows = [
        {"pressure_pa": p.result.pressure, "volume_m3": parts * p.result.volume, **p.metrics}
        for p in points
    ]
    summary: dict[str, Any] = {
        **(figures or {}),
        "stretch_use": points[-1].result.stretch_use,
        "newton_steps": sum(point.result.steps for point in points),
        "triangles": len(pattern.panel),
        "parts_by_symmetry": parts,
        "ranks": comm.size,
        "inputs": None if config is None else config.as_dict(),
        "versions": versions(),
        "seconds": dict(seconds or {}),
    }
    summary = dict(comm.bcast(summary, root=0))  # each rank has its own clock
    folds = _wrinkles_of(skin, composite, density, shapes[-1])

    def draw() -> None:
        from toros_fem.results.pictures.curve_plot import plot_pressure_path
        from toros_fem.results.pictures.line_plot import plot_wrinkles
        from toros_fem.results.pictures.shape_plot import plot_shapes

        chosen = np.linspace(0, len(points) - 1, 4).round().astype(int)
        titled = [(f"{1e-3 * points[k].result.pressure:.3g} kPa", shapes[k]) for k in chosen]
        plot_pressure_path(folder / "curve.png", rows, metrics)
        plot_shapes(folder / "shapes.png", skin.triangles, titled, density)
        if folds is not None:
            plot_wrinkles(folder / "wrinkles.png", skin, folds)

    def write() -> None:
        write_table(folder / "curve.csv", rows)
        write_path(folder, "pressure", ShownSkin(skin), points, whole, density)
        write_fields(
            folder / "skin.vtu", skin, shapes[-1], {"density": density} | _wrinkle_fields(folds)
        )
        write_json(folder / "summary.json", summary)
        if_plotting(draw)

    write_together(comm, folder, write)
    return summary


def if_plotting(draw: Callable[[], None]) -> None:
    """Draw pictures, or print which package is missing for them (one rank)."""
    try:
        draw()
    except ImportError as missing:
        print(f"no pictures: {missing}; pip install toros_fem[plot]", file=sys.stderr)
