"""`toros export`: the files for printer and cutter, from what a run has stored."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from mpi4py import MPI

from toros_fem.base.files import write_together
from toros_fem.base.mpi import on_first_rank
from toros_fem.cli.command_line.command import Answer, Command
from toros_fem.cli.command_line.scripts import add_options, given_config
from toros_fem.making.panels.options import ManufactureOptions
from toros_fem.making.panels.svg import write_svg
from toros_fem.making.print.print_file import read_print_polygons
from toros_fem.making.print.printability import printability, printed_cells
from toros_fem.making.sheets.manifest import NAME as MANIFEST
from toros_fem.making.sheets.page import NAME as PAGE
from toros_fem.making.sheets.reading import read_regions
from toros_fem.making.sheets.write import FOLDER, made_as, write_manufacture
from toros_fem.meshes.pattern_file import NAME, read_pattern, write_pattern
from toros_fem.results.result import read_content
from toros_fem.results.writer import if_plotting


def _options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("run", type=Path, metavar="RUN", help="folder of a finished design")
    parser.add_argument(
        "--output",
        type=Path,
        default=None,
        metavar="FOLDER",
        help=f"folder for the files, made if missing; default RUN/{FOLDER}",
    )
    add_options(parser, ManufactureOptions())


def _run(comm: MPI.Comm, given: argparse.Namespace) -> Answer:
    stored = read_print_polygons(comm, given.run)
    run = given.run.parent if given.run.suffix == ".npz" else given.run
    summary = on_first_rank(comm, lambda: read_content(run))
    # What is simulated is the part of a symmetric skin; its triangles are the first of the whole.
    part = read_pattern(comm, run / NAME) if _exists(comm, run / NAME) else stored.pattern
    options = given_config(given, made_as(summary))
    output = given.output or run / FOLDER
    made = printability(stored.pattern, stored.regions, stored.limits)

    def write() -> dict[str, Any]:
        title = run.resolve().name
        manifest = write_manufacture(
            output, stored.pattern, stored.regions, options, summary=summary, title=title
        )
        # What is simulated again is what the files hold.
        printed = printed_cells(stored.pattern, read_regions(output, stored.pattern))
        write_pattern(output / NAME, part, printed[: len(part.panel)])
        write_svg(output / "pattern.svg", stored.pattern, stored.regions)

        def draw() -> None:
            from toros_fem.results.pictures.pattern_plot import plot_pattern, plot_printability

            plot_pattern(output / "pattern.png", stored.pattern, stored.regions)
            plot_printability(
                output / "manufacture.png", stored.pattern, stored.regions, made, stored.limits
            )

        if_plotting(draw)
        return manifest

    found: list[dict[str, Any]] = []
    write_together(comm, output, lambda: found.append(write()))
    manifest = comm.bcast(found[0] if found else None, root=0)
    files = [file["name"] for file in manifest["files"]]
    figures = {
        "folder": output,
        "files": [*files, MANIFEST, PAGE, "pattern.svg", NAME, "pattern.png", "manufacture.png"],
        "sheets": len(manifest["sheets"]),
        "print": manifest["print"],
        "manufacture": made.summary(),
    }
    sheets, mass = len(manifest["sheets"]), manifest["print"]["print_mass_g"]
    return Answer(
        f"{output}/{PAGE}: {len(files)} machine files of {sheets} sheet{'s' * (sheets > 1)}, "
        f"{mass:.2f} g of print, and how to make it",
        figures,
    )


def _exists(comm: MPI.Comm, path: Path) -> bool:
    return on_first_rank(comm, path.is_file)


COMMAND = Command(
    "From the print that a design stores (print.npz): print_1.3mf and .stl for the printer's bed,\n"
    "cut_1.svg and .dxf for the cutter, and so on for each bed and sheet; bladder.svg and .dxf;\n"
    "manufacture.json with all of their content; and make_it.html, which shows how to make the\n"
    "skin. The print is as high as the design takes it to be, unless --layer-height says\n"
    "otherwise. Also pattern.svg, pattern.npz, pattern.png, and manufacture.png with islands,\n"
    "narrow lines and gaps.",
    (
        "toros export run",
        "toros export run --bed-width 0.3 --bed-depth 0.3 --seam-allowance 7e-3",
        "toros export run --output for-the-printer",
    ),
    _options,
    _run,
)
