"""`toros view`: a run as a page for the browser, and as an animation."""

from __future__ import annotations

import webbrowser
from dataclasses import MISSING
from pathlib import Path
from typing import Annotated, ClassVar

from mpi4py import MPI

from toros_fem.base.keys import File, Flag, OneOf, key
from toros_fem.base.mpi import on_first_rank
from toros_fem.cli.command_line.command import Answer, Command


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
