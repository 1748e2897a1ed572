"""What a demo shows while it runs, and leaves behind when it ends."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from toros_fem._mpi import raise_together
from toros_fem.design import Evaluation
from toros_fem.errors import OutputError
from toros_fem.io import HistoryFile, versions, write_fields, write_json
from toros_fem.meshes.skin import Skin
from toros_fem.newton import NewtonStep
from toros_fem.optimise import DesignResult, Iteration

if TYPE_CHECKING:  # shapely is not installed everywhere
    from shapely.geometry.base import BaseGeometry

    from toros_fem.manufacture import Printability

Floats = npt.NDArray[np.float64]


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
        angle: Measures the angle reached, in degrees, from all vertices' positions.
        begin: `time.perf_counter()` at the start of the whole run.

    Raises:
        OutputError: The folder cannot be made or written to; here and in all methods.
    """

    def __init__(
        self,
        skin: Skin,
        folder: Path,
        iterations: int,
        angle: Callable[[Floats], float],
        begin: float,
    ) -> None:
        self._skin, self._folder, self._planned, self._measure = skin, folder, iterations, angle
        self._whole_begin = begin
        self._begin = time.perf_counter()
        self._history = HistoryFile(folder / "history.csv")
        self.angles: list[float] = []
        self._on_first_rank(lambda: folder.mkdir(parents=True, exist_ok=True))
        if skin.comm.rank == 0:
            print(
                "  it   objective  angle/deg  volume   grey  rejected  newton  seconds", flush=True
            )

    def __call__(self, row: Iteration, evaluation: Evaluation) -> None:
        """Callback of the design loop (collective)."""
        positions = self._skin.gather_vertices(evaluation.equilibrium.state.reshape(-1, 3))
        angle = self._measure(positions)
        self.angles.append(angle)

        def show() -> None:
            self._history.write(row, angle_deg=angle)
            self._clear()
            print(
                f"{row.iteration:4d}  {row.objective:10.4e}  {angle:9.2f}"
                f"  {row.volume_fraction:6.3f}  {row.grey_level:5.3f}  {row.rejected:8d}"
                f"  {row.newton_steps:6d}  {row.seconds:7.2f}",
                flush=True,
            )
            self._bar(row.iteration)

        self._on_first_rank(show)

    def finish(
        self,
        result: DesignResult,
        target: Floats,
        threshold: float,
        inputs: dict[str, Any],
        figures: dict[str, Any],
    ) -> dict[str, Any]:
        """Write summary, pattern, fields and pictures (collective); the summary is returned.

        Args:
            result: What the design loop arrived at.
            target: Target positions of all vertices, (n, 3), in m.
            threshold: η, the filtered density from which on cloth is printed.
            inputs: Everything that went in.
            figures: Figures of this demo to add to the summary: `angle_target_deg` and others.
        """
        skin, pattern, final = self._skin, self._skin.pattern, result.final
        positions = skin.gather_vertices(final.equilibrium.state.reshape(-1, 3))
        fields = {
            "rho": skin.gather_cells(result.density),
            "rho_filtered": skin.gather_cells(final.filtered),
            "rho_projected": skin.gather_cells(final.projected),
        }
        # A given panel is shown as it is built, not as the filter sees it.
        designed = skin.gather_cells(result.designed.astype(np.float64)) > 0
        shown = np.where(designed, fields["rho_filtered"], fields["rho_projected"])
        first, last = result.history[0], result.history[-1]
        now = time.perf_counter()
        seconds = {
            "setup": self._begin - self._whole_begin,
            **result.seconds,
            "total": now - self._whole_begin,
        }
        summary = {
            "objective_first": first.objective,
            "objective_last": last.objective,
            "gradient_norm_first": first.gradient_norm,
            "gradient_norm_last": last.gradient_norm,
            "angle_deg": self.angles[-1],
            **figures,
            "pressure_pa": final.equilibrium.pressure,
            "volume_m3": final.equilibrium.volume,
            "stretch_use": final.equilibrium.stretch_use,
            "volume_fraction": last.volume_fraction,
            "grey_level": last.grey_level,
            "iterations": last.iteration,
            "rejected": sum(row.rejected for row in result.history),
            "newton_steps": sum(row.newton_steps for row in result.history),
            "factorisations": sum(row.factorisations for row in result.history),
            "triangles": len(pattern.panel),
            "vertices": len(pattern.points),
            "ranks": skin.comm.size,
            "reason": result.reason,
            "seconds": seconds,
            "versions": versions(),
            "inputs": inputs,
        }
        printed = self._inspect(shown, threshold)
        summary["manufacture"] = skin.comm.bcast(printed and printed[1].summary(), root=0)

        def write() -> None:
            self._clear()
            write_json(self._folder / "summary.json", summary)
            write_fields(self._folder / "skin.vtu", pattern, positions, fields)
            if printed:
                self._draw(result, positions, target, fields["rho_projected"], printed, summary)

        self._on_first_rank(write)
        return summary

    def _inspect(
        self, shown: Floats, threshold: float
    ) -> tuple[list[BaseGeometry], Printability] | None:
        """What is printed on each panel, and whether it can be; on the first rank (collective)."""
        found: list[tuple[list[BaseGeometry], Printability]] = []

        def measure() -> None:
            try:
                from toros_fem.contours import averaged, printed_regions
                from toros_fem.manufacture import printability
            except ImportError as missing:
                print(f"no SVG: {missing}; pip install toros_fem[export]", file=sys.stderr)
                return
            pattern = self._skin.pattern
            regions = printed_regions(pattern, averaged(pattern, shown), shown, threshold)
            found.append((regions, printability(pattern, regions)))

        self._on_first_rank(measure)
        return found[0] if found else None

    def _draw(
        self,
        result: DesignResult,
        positions: Floats,
        target: Floats,
        projected: Floats,
        printed: tuple[list[BaseGeometry], Printability],
        summary: dict[str, Any],
    ) -> None:
        from toros_fem.export import write_svg
        from toros_fem.manufacture import PrintLimits

        pattern, folder = self._skin.pattern, self._folder
        regions, measured = printed
        write_svg(folder / "pattern.svg", pattern, regions)
        try:
            from toros_fem.plotting import (
                plot_convergence,
                plot_manufacture,
                plot_pattern,
                plot_shape,
            )
        except ImportError as missing:
            print(f"no pictures: {missing}; pip install toros_fem[plot]", file=sys.stderr)
            return
        plot_pattern(folder / "pattern.png", pattern, regions)
        plot_manufacture(folder / "manufacture.png", pattern, regions, measured, PrintLimits())
        wanted = float(summary["angle_target_deg"])
        title = (
            f"{summary['angle_deg']:.0f}° reached of {wanted:.0f}° at "
            f"{summary['pressure_pa'] / 1e3:g} kPa"
        )
        plot_shape(folder / "shape.png", pattern, positions, target, projected, title)
        plot_convergence(folder / "convergence.png", result.history, self.angles, wanted)

    def _on_first_rank(self, action: Callable[[], None]) -> None:
        """Do something with files on one rank; all ranks raise if it fails (collective)."""
        error: Exception | None = None
        if self._skin.comm.rank == 0:
            try:
                action()
            except OSError as caught:
                error = OutputError(
                    f"{self._folder} could not be written: {caught}. Take another folder, or "
                    "make room; what was written before stays."
                )
            except Exception as caught:  # the other ranks wait to hear of it
                error = caught
        raise_together(self._skin.comm, error)

    def _bar(self, iteration: int) -> None:
        if not sys.stderr.isatty():
            return
        done = iteration / self._planned
        elapsed = time.perf_counter() - self._begin
        left = f"{elapsed / done * (1 - done):.0f} s left" if done > 0 else ""
        filled = round(30 * done)
        bar = "█" * filled + "·" * (30 - filled)
        print(f"\r{bar} {iteration}/{self._planned} {left}", end="", file=sys.stderr, flush=True)

    def _clear(self) -> None:
        if sys.stderr.isatty():
            print("\r\033[K", end="", file=sys.stderr, flush=True)
