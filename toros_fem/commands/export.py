"""`toros export`: the files for printer and cutter, from what a run has stored."""

from __future__ import annotations

import argparse
from pathlib import Path

from mpi4py import MPI

from toros_fem.command_line.command import Answer, Command
from toros_fem.fabrication.print_file import read_print_polygons
from toros_fem.fabrication.printability import printability
from toros_fem.fabrication.svg import write_svg
from toros_fem.meshes.pattern_file import NAME, write_pattern
from toros_fem.output.writer import if_plotting, write_together


def _options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("run", type=Path, metavar="RUN", help="folder of a finished design")
    parser.add_argument(
        "--output",
        type=Path,
        default=None,
        metavar="FOLDER",
        help="folder for the files, made if missing; default RUN/export",
    )


def _run(comm: MPI.Comm, given: argparse.Namespace) -> Answer:
    stored = read_print_polygons(comm, given.run)
    output = given.output or given.run / "export"
    made = printability(stored.pattern, stored.regions, stored.limits)

    def write() -> None:
        write_svg(output / "pattern.svg", stored.pattern, stored.regions)
        write_pattern(output / NAME, stored.pattern)

        def draw() -> None:
            from toros_fem.output.pattern_plot import plot_pattern, plot_printability

            plot_pattern(output / "pattern.png", stored.pattern, stored.regions)
            plot_printability(
                output / "manufacture.png", stored.pattern, stored.regions, made, stored.limits
            )

        if_plotting(draw)

    write_together(comm, output, write)
    figures = {
        "folder": output,
        "files": ["pattern.svg", NAME, "pattern.png", "manufacture.png"],
        "manufacture": made.summary(),
    }
    return Answer(f"{output}/: pattern.svg in true scale, {NAME} and pictures", figures)


COMMAND = Command(
    "export",
    "writes the files for printer and cutter again",
    "From the print that a design stores (print.npz): pattern.svg, in true scale, 1 unit = 1 mm,\n"
    "with separate paths to print and to cut; pattern.npz, the sewing pattern; pattern.png, and\n"
    "manufacture.png with islands, narrow lines and gaps.",
    ("toros export run", "toros export run --output for-the-printer"),
    _options,
    _run,
)
