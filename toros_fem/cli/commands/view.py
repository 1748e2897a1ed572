"""`toros view`: a run as a page for the browser, and as an animation."""

from __future__ import annotations

import argparse
import webbrowser
from pathlib import Path

from mpi4py import MPI

from toros_fem.base.mpi import on_first_rank
from toros_fem.cli.command_line.command import Answer, Command
from toros_fem.results.report.animation import write_animation
from toros_fem.results.report.page_file import write_report
from toros_fem.results.report.run_folder import SERIES


def _options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("run", type=Path, metavar="RUN", help="folder of the run")
    parser.add_argument(
        "--animation",
        choices=tuple(SERIES),
        default=None,
        metavar="SERIES",
        help=f"also write a GIF of the shapes over a series, one of {', '.join(SERIES)}; "
        "default none",
    )
    parser.add_argument(
        "--open", action="store_true", help="open the page in the browser; default no"
    )


def _run(comm: MPI.Comm, given: argparse.Namespace) -> Answer:
    def write() -> tuple[Path, Path | None]:
        page = write_report(given.run)
        film = None if given.animation is None else write_animation(given.run, given.animation)
        if given.open:
            webbrowser.open(page.resolve().as_uri())
        return page, film

    page, film = on_first_rank(comm, write)
    files = [str(path) for path in (page, film) if path is not None]
    return Answer("\n".join(files), {"report": page, "animation": film})


COMMAND = Command(
    "RUN/report.html shows the skin in space, over the pressure and over the iterations, its flat\n"
    "pattern, the curves and all figures. It needs no network. A run that is not finished is\n"
    "shown as far as it has come.",
    ("toros view run", "toros view run --open", "toros view run --animation pressure"),
    _options,
    _run,
)
