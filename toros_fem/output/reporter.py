"""What a demo shows while it runs, and leaves behind when it ends."""

from __future__ import annotations

from toros_fem._types import Floats

import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from shapely.geometry.base import BaseGeometry

from toros_fem._mpi import on_first_rank
from toros_fem.design.problem import (Evaluation)
from toros_fem.design.shape_problem import (ShapeProblem)
from toros_fem.errors import OutputError
from toros_fem.fabrication.svg import (write_svg)
from toros_fem.output.files import (HistoryFile, versions, write_fields, write_json, write_table)
from toros_fem.objectives.metrics import (Metric)
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.skin import Skin
from toros_fem.equilibrium.newton import (NewtonStep)
from toros_fem.design.loop import (DesignResult)
from toros_fem.analysis.pressure_path import (PressurePathPoint)
from toros_fem.fabrication.as_printed import (PrintedDesign)
from toros_fem.design.options import (Iteration)



def print_step(comm: MPI.Comm) -> Callable[[NewtonStep], None]:
    """A log for `EquilibriumSolver` that prints every step on the first rank."""

    def show(row: NewtonStep) -> None:
        if comm.rank == 0:
            print(f"\r    {row}", flush=True)

    return show


class Reporter:
    """One line an iteration, a progress bar on a terminal, and the history on disk.

    Args:
        skin: The skin being designed.
        folder: Output folder, made if missing.
        iterations: How many are planned.
        figures: What is computed of every shape, the most important first.
        begin: `time.perf_counter()` at the start of the whole run.

    Raises:
        OutputError: The folder cannot be made or written to; here and in all methods.
    """

    def __init__(
        self,
        skin: Skin,
        folder: Path,
        iterations: int,
        metrics: Sequence[Metric],
        begin: float,
    ) -> None:
        self._skin, self._folder, self._planned, self._figures = skin, folder, iterations, metrics
        self._whole_begin = begin
        self._begin = time.perf_counter()
        self._history = HistoryFile(folder / "history.csv")
        self.reached: list[dict[str, float]] = []
        self._on_first_rank(lambda: folder.mkdir(parents=True, exist_ok=True))
        if skin.comm.rank == 0:
            columns = "".join(f"  {f.name}/{f.unit:s}".rjust(12) for f in metrics)
            print(
                f"  it   objective{columns}  kPa     volume   grey   g_r      g_t     rejected"
                "  newton  seconds",
                flush=True,
            )

    def __call__(self, row: Iteration, evaluation: Evaluation) -> None:
        """Callback of the design loop (collective)."""
        reached = self._reached(evaluation)
        self.reached.append(reached)

        def show() -> None:
            self._history.write(row, **reached)
            self._clear()
            columns = "".join(
                f"{value:{max(12, 3 + len(name))}.2f}" for name, value in reached.items()
            )
            print(
                f"{row.iteration:4d}  {row.objective:10.4e}{columns}"
                f"  {row.pressure / 1e3:6.3f}  {row.volume_fraction:6.3f}  {row.grey_level:5.3f}"
                f"  {row.g_r:7.1e}  {row.g_t:7.1e}  {row.rejected:8d}  {row.newton_steps:6d}"
                f"  {row.seconds:7.2f}",
                flush=True,
            )
            self._bar(row.iteration)

        self._on_first_rank(show)

    def finish(
        self,
        problem: ShapeProblem,
        result: DesignResult,
        printed: PrintedDesign,
        target: Floats,
        inputs: dict[str, Any],
        metrics: dict[str, Any],
    ) -> dict[str, Any]:
        """Write summary, pattern, fields and pictures (collective); the summary is returned.

        Figures, volume and shape are those of the printed pattern, simulated as it is, None if it
        has no equilibrium; what the optimiser saw, with its grey borders, stands beside them
        under "design". Without a printed shape the pictures show the design's.

        Args:
            problem: What was designed.
            result: What the design loop arrived at.
            printed: What is printed of it.
            target: Target positions of all vertices, (n, 3), in m.
            inputs: Everything that went in.
            figures: What else to add to the summary.
        """
        skin, final, whole = self._skin, result.final, problem.whole
        made = printed.evaluation
        shown = made or final
        positions = skin.gather_vertices(shown.equilibrium.positions)
        fields = {
            "rho": skin.gather_cells(result.density),
            "rho_filtered": skin.gather_cells(final.filtered),
            "rho_projected": skin.gather_cells(final.projected),
        }
        parts = 1
        if whole is not None:
            parts = len(whole.cell) // len(skin.pattern.panel)
            positions, target = whole.at_vertices(positions), whole.at_vertices(target)
            fields = {name: whole.at_cells(values) for name, values in fields.items()}
        fields["printed"] = printed.cells.astype(np.float64)
        first, last = result.history[0], result.history[-1]
        limits, widths = problem.length_scale, final.length_scale
        seconds = {"setup": self._begin - self._whole_begin, **result.seconds}
        printed_figures = made and self._reached(made)
        summary = {
            **{f.key: printed_figures and printed_figures[f.key] for f in self._figures},
            **{f"{f.name}_target_{f.unit}": f.target for f in self._figures},
            **metrics,
            "pressure_pa": final.equilibrium.pressure,
            "volume_m3": made and parts * made.equilibrium.volume,
            "stretch_use": made and made.equilibrium.stretch_use,
            "printed_objective": made and made.shape,
            "printed_failure": printed.failure or None,
            "objective_first": first.objective,
            "objective_last": last.objective,
            "design": {
                **self.reached[-1],
                "shape": last.shape,
                "perimeter_m": final.perimeter and parts * final.perimeter,
                "volume_m3": parts * final.equilibrium.volume,
                "kkt_residual": last.kkt if np.isfinite(last.kkt) else None,
            },
            "gradient_norm_first": first.gradient_norm,
            "gradient_norm_last": last.gradient_norm,
            "volume_fraction": last.volume_fraction,
            "grey_level": last.grey_level,
            "length_scale": None if limits is None or widths is None else limits.summary(widths),
            "manufacture": printed.after.summary(),
            "dropped": {
                "islands": len(printed.cleaned.dropped),
                "islands_mm2": 1e6 * sum(piece.area for piece in printed.cleaned.dropped),
                "holes_filled": len(printed.cleaned.filled),
                "before": printed.before.summary(),
            },
            "iterations": last.iteration,
            "rejected": sum(row.rejected for row in result.history),
            "newton_steps": sum(row.newton_steps for row in result.history),
            "factorisations": sum(row.factorisations for row in result.history),
            "triangles": len(skin.pattern.panel),
            "vertices": len(skin.pattern.points),
            "parts_by_symmetry": parts,
            "ranks": skin.comm.size,
            "reason": result.reason,
            "seconds": seconds,
            "versions": versions(),
            "inputs": inputs,
        }

        def write() -> None:
            self._clear()
            seconds["total"] = time.perf_counter() - self._whole_begin
            write_json(self._folder / "summary.json", summary)
            write_fields(self._folder / "skin.vtu", printed.pattern, positions, fields)
            self._draw(result, printed, positions, target, summary)

        self._on_first_rank(write)
        seconds["total"] = time.perf_counter() - self._whole_begin
        return summary

    def _reached(self, evaluation: Evaluation) -> dict[str, float]:
        positions = self._skin.gather_vertices(evaluation.equilibrium.positions)
        pattern = self._skin.pattern
        return {f.key: float(f.measure(pattern, positions)) for f in self._figures}

    def _draw(
        self,
        result: DesignResult,
        printed: PrintedDesign,
        positions: Floats,
        target: Floats,
        summary: dict[str, Any],
    ) -> None:
        pattern, folder = printed.pattern, self._folder
        write_svg(folder / "pattern.svg", pattern, printed.regions)
        what = "as printed" if printed.evaluation else "as designed, not as printed,"
        reached = summary if printed.evaluation else self.reached[-1]
        found = ", ".join(
            f"{f.name} {f.formatted(reached[f.key])} of {f.formatted(f.target)}" for f in self._figures
        )
        title = f"{found} {what} at {summary['pressure_pa'] / 1e3:.3g} kPa"
        cells = printed.cells.astype(np.float64)

        def draw() -> None:
            from toros_fem.output import plots as plotting

            plotting.plot_pattern(folder / "pattern.png", pattern, printed.regions)
            plotting.plot_printability(
                folder / "manufacture.png", pattern, printed.regions, printed.after, printed.limits
            )
            plotting.plot_shape(folder / "shape.png", pattern, positions, target, cells, title)
            plotting.plot_convergence(
                folder / "convergence.png", result.history, self._figures, self.reached
            )

        if_plotting(draw)

    def _on_first_rank(self, action: Callable[[], None]) -> None:
        write_together(self._skin.comm, self._folder, action)

    def _bar(self, iteration: int) -> None:
        if not sys.stderr.isatty():
            return
        done = min(iteration / self._planned, 1.0)  # polishing comes on top
        elapsed = time.perf_counter() - self._begin
        left = f"{elapsed / done * (1 - done):.0f} s left" if done > 0 else ""
        filled = round(30 * done)
        bar = "█" * filled + "·" * (30 - filled)
        print(f"\r{bar} {iteration}/{self._planned} {left}", end="", file=sys.stderr, flush=True)

    def _clear(self) -> None:
        if sys.stderr.isatty():
            print("\r\033[K", end="", file=sys.stderr, flush=True)


def write_comparison(
    comm: MPI.Comm,
    folder: Path,
    name: str,
    content: dict[str, Any],
    pattern: Pattern,
    panel: str,
    variants: Sequence[tuple[str, BaseGeometry, str]],
) -> None:
    """Write the table and the picture strip of several designs (collective).

    Args:
        comm: Communicator.
        folder: Output folder, which exists.
        name: Of the two files, without ending.
        content: What goes into the JSON file.
        pattern: The pattern.
        panel: Name of the panel to show.
        variants: For each its title, what it prints on that panel, in m, and a caption.

    Raises:
        OutputError: A file cannot be written.
    """

    def write() -> None:
        write_json(folder / f"{name}.json", content)

        def draw() -> None:
            from toros_fem.output.comparison_plot import (plot_variants)

            plot_variants(folder / f"{name}.png", pattern, panel, variants)

        if_plotting(draw)

    write_together(comm, folder, write)


def write_path(
    comm: MPI.Comm,
    folder: Path,
    pattern: Pattern,
    points: Sequence[PressurePathPoint],
    density: Floats,
    metrics: Sequence[Metric],
    summary: dict[str, Any],
    begin: float,
) -> None:
    """Write what a sequence of pressures came to (collective): table, fields, pictures, summary.

    Args:
        comm: Communicator.
        folder: Output folder, made if missing.
        pattern: The pattern.
        points: The equilibria.
        density: Density of all triangles, (t,), to colour by.
        figures: What was measured, to be drawn over the pressure.
        summary: Written to summary.json, versions and the wall time since `begin` added.
        begin: `time.perf_counter()` at the start of the whole run.

    Raises:
        OutputError: A file cannot be written.
    """

    def write() -> None:
        folder.mkdir(parents=True, exist_ok=True)
        rows = [
            {"pressure_pa": p.result.pressure, "volume_m3": p.result.volume, **p.metrics}
            for p in points
        ]
        write_table(folder / "curve.csv", rows)
        write_fields(folder / "skin.vtu", pattern, points[-1].positions, {"density": density})
        write_json(folder / "summary.json", summary)
        chosen = [points[k] for k in np.linspace(0, len(points) - 1, 4).round().astype(int)]
        shapes = [(f"{1e-3 * p.result.pressure:.3g} kPa", p.positions) for p in chosen]

        def draw() -> None:
            from toros_fem.output.comparison_plot import (plot_curves, plot_shapes)

            plot_curves(folder / "curve.png", rows, metrics)
            plot_shapes(folder / "shapes.png", pattern.triangles, shapes, density)

        if_plotting(draw)

    summary["versions"] = versions()
    summary["seconds"] = {"total": time.perf_counter() - begin}
    write_together(comm, folder, write)


def if_plotting(draw: Callable[[], None]) -> None:
    """Draw pictures, or say what is missing for it."""
    try:
        draw()
    except ImportError as missing:
        print(f"no pictures: {missing}; pip install toros_fem[plot]", file=sys.stderr)


def write_together(comm: MPI.Comm, folder: Path, action: Callable[[], None]) -> None:
    """Do something with files on the first rank; all ranks raise if it fails (collective)."""

    def guarded() -> None:
        try:
            action()
        except OSError as caught:
            raise OutputError(
                f"{folder} could not be written: {caught}. Take another folder, or make room; "
                "what was written before stays."
            ) from None

    on_first_rank(comm, guarded)
