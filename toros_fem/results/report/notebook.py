"""A run in a notebook: its skin in space, and its figures."""

from __future__ import annotations

from dataclasses import dataclass, field
from html import escape
from pathlib import Path

from toros_fem.base.validation import require_kind
from toros_fem.results.report.page_file import page_of
from toros_fem.results.runs.run_folder import read_run
from toros_fem.results.runs.summary_file import Summary, summary_of


@dataclass(frozen=True)
class EmbeddedPage:
    """A page of HTML that a notebook shows in a frame of its own, of a height in pixels."""

    page: str = field(repr=False)
    height: int

    def _repr_html_(self) -> str:
        # Scripts of the page run, apart from the notebook and from what it may do.
        return (
            f'<iframe sandbox="allow-scripts" srcdoc="{escape(self.page)}" '
            f'style="width: 100%; height: {self.height}px; border: 0"></iframe>'
        )


@dataclass(frozen=True)
class StoredRun(Summary):
    """What summary.json of a run in a folder holds, with its skin in space.

    The tables of a run, such as history.csv, are read by `pandas.read_csv` as they are.
    """

    folder: Path

    def show(self, height: int = 640) -> EmbeddedPage:
        """Return the skin in space, a height in pixels, which a notebook shows and a mouse turns.

        Raises:
            FileError: The folder holds no run.
            OutputError: A file cannot be read.
            MissingPackageError: A package of the extra `plot` is not installed.
        """
        return view_of(self.folder, height)


def read_summary(folder: Path | str) -> StoredRun:
    """Return the summary of a run, empty if there is none yet (one rank).

    Raises:
        OutputError: It cannot be read, is none, or is that of an earlier version.
    """
    require_kind("folder", folder, (str, Path), "the folder of a run")
    found = summary_of(Path(folder))
    return StoredRun(found.figures, found.entries, Path(folder))


def view_of(folder: Path, height: int) -> EmbeddedPage:
    """Return the page of a run, with nothing but its skin in space."""
    return EmbeddedPage(page_of(read_run(folder), alone=True), height)
