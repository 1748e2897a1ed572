"""`toros view` and `toros export`: a run as a page and a film, and its machine files again."""

from __future__ import annotations

import logging
import webbrowser
from dataclasses import MISSING
from pathlib import Path
from typing import Annotated, Any, ClassVar

from mpi4py import MPI

from toros_fem.base.files import guarded, if_plotting
from toros_fem.base.keys import File, Flag, OneOf, key
from toros_fem.base.mpi import on_first_rank
from toros_fem.cli.command import Answer, Command
from toros_fem.making.options import ManufactureOptions

log = logging.getLogger(__name__)
UNKNOWN_HEIGHT = (
    "%s has no summary.json, which tells the height of the print: %g mm is taken. Give "
    "--layer-height."
)


class View(Command, kw_only=True):
    """Writes the report of a run, a page for the browser.

    RUN/report.html shows the skin in space, over the pressure and over the iterations, its flat
    pattern, the curves and all figures. It needs no network. A run that is not finished is
    shown as far as it has come.
    """

    run: File = key(MISSING, "folder of the run")
    animation: Annotated[str, OneOf(("pressure", "iteration", "gait", "load"))] | None = key(
        None, "also write a film of the shapes over a series, as GIF and APNG"
    )
    open: Flag = key(False, "open the page in the browser")

    WORDS: ClassVar = ("run",)
    TAKES: ClassVar = {"animation": "SERIES"}
    EXAMPLES: ClassVar = (
        "toros view run",
        "toros view run --open",
        "toros view run --animation pressure",
    )

    def __call__(self, comm: MPI.Comm) -> Answer:
        """Write the page, and the animation (collective)."""
        from toros_fem.results.pictures.film import write_animation
        from toros_fem.results.report.page_file import write_report

        def write() -> tuple[Path, Path | None]:
            page = write_report(self.run)
            film = None if self.animation is None else write_animation(self.run, self.animation)
            if self.open:
                webbrowser.open(page.resolve().as_uri())
            return page, film

        page, film = on_first_rank(comm, write)
        files = [str(path) for path in (page, film) if path is not None]
        return Answer("\n".join(files), {"report": page, "animation": film})


class Export(Command, ManufactureOptions, kw_only=True):
    """Writes the files for printer and cutter again.

    From the print that a design stores (print.npz): print_1.3mf and .stl for the printer's bed,
    cut_1.svg and .dxf for the cutter, and so on for each bed and sheet;
    manufacture.json with all of their content; and make_it.html, which shows how to make the
    skin. The print is as high as the design takes it to be, unless --layer-height says
    otherwise. Also pattern.svg, pattern.npz, print.npz, and pattern.png with islands, narrow
    lines and gaps.
    """

    run: File = key(MISSING, "folder of a finished design")
    output: File | None = key(
        None, "folder for the files, made if missing; none takes RUN/manufacture"
    )

    WORDS: ClassVar = ("run",)
    TAKES: ClassVar = {"output": "FOLDER"}
    EXAMPLES: ClassVar = (
        "toros export run",
        "toros export run --bed-width 0.3 --bed-depth 0.3 --seam-allowance 7e-3",
        "toros export run --output for-the-printer",
    )

    def __call__(self, comm: MPI.Comm) -> Answer:
        """Write the files (collective)."""
        from toros_fem.making.machine_files import FOLDER, made_as, write_manufacture
        from toros_fem.making.manifest import NAME as MANIFEST
        from toros_fem.making.manifest import PAGE
        from toros_fem.making.panel_drawing import write_svg
        from toros_fem.making.printability import (
            PRINT,
            printability,
            printed_cells,
            read_print_polygons,
            write_print_polygons,
        )
        from toros_fem.meshes.files import PATTERN_FILE, read_pattern, write_pattern
        from toros_fem.results.runs.stored_run import read_content

        stored = read_print_polygons(comm, self.run)
        run = self.run.parent if self.run.suffix == ".npz" else self.run
        summary = on_first_rank(comm, lambda: read_content(run))
        # A part of a symmetric skin is simulated; its triangles are the first of the whole.
        there = on_first_rank(comm, (run / PATTERN_FILE).is_file)
        part = read_pattern(comm, run / PATTERN_FILE) if there else stored.pattern
        options = self.updating(made_as(summary))
        if not summary and "layer_height" not in vars(self)["given"] and comm.rank == 0:
            log.warning(UNKNOWN_HEIGHT, run, 1e3 * options.layer_height)
        output = self.output or run / FOLDER
        drawings = ["pattern.svg", PATTERN_FILE, PRINT, "pattern.png"]
        made = printability(stored.pattern, stored.regions, stored.limits)

        def write() -> dict[str, Any]:
            manifest = write_manufacture(
                output, stored.pattern, stored.regions, options,
                summary=summary, title=run.resolve().name, others=drawings,
            )  # fmt: skip
            printed = printed_cells(stored.pattern, stored.regions)
            write_pattern(output / PATTERN_FILE, part, printed[: len(part.panel)])
            write_print_polygons(output / PRINT, stored.pattern, stored.regions, stored.limits)
            write_svg(output / "pattern.svg", stored.pattern, stored.regions)

            def draw() -> None:
                from toros_fem.results.pictures.flat import draw_pattern
                from toros_fem.results.pictures.style import page

                with page(output / "pattern.png") as figure:
                    draw_pattern(figure, stored.pattern, stored.regions, made, stored.limits)

            if_plotting(draw)
            return manifest

        manifest = guarded(comm, output, write)
        files, sheets = [file["name"] for file in manifest["files"]], len(manifest["sheets"])
        figures = {
            "folder": output,
            "files": [*files, MANIFEST, PAGE, *drawings],
            "sheets": sheets,
            "print": manifest["print"],
            "manufacture": made.summary(),
        }
        mass = manifest["print"]["print_mass_g"]
        return Answer(
            f"{output}/{PAGE}: {len(files)} machine files of {sheets} sheet{'s' * (sheets > 1)}, "
            f"{mass:.2f} g of print, and how to make it",
            figures,
        )
