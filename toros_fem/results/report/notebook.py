"""A run in a notebook: its skin in space, and its figures."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from pathlib import Path

from toros_fem.results.report.page_file import page_of
from toros_fem.results.report.run_folder import read_run
from toros_fem.results.runs.summary_file import Summary, read_summary


@dataclass(frozen=True)
class View:
    """A page that a notebook shows in a frame of its own.

    Attributes:
        page: The page as HTML.
        height: Height of the frame in pixels.
    """

    page: str
    height: int

    def _repr_html_(self) -> str:
        # Scripts of the page run, apart from the notebook and from what it may do.
        return (
            f'<iframe sandbox="allow-scripts" srcdoc="{escape(self.page)}" '
            f'style="width: 100%; height: {self.height}px; border: 0"></iframe>'
        )


@dataclass(frozen=True)
class StoredRun:
    """A run in its folder, finished or not.

    Its tables, such as history.csv and curve.csv, are read by `pandas.read_csv` as they are.

    Attributes:
        folder: The folder.
    """

    folder: Path | str

    @property
    def summary(self) -> Summary:
        """Its figures and further entries; empty for a run that was stopped.

        Raises:
            OutputError: summary.json cannot be read.
        """
        return read_summary(Path(self.folder))

    def show(self, height: int = 640) -> View:
        """Return the skin in space, which a notebook shows and a mouse turns (one rank).

        Args:
            height: Height in pixels.

        Raises:
            OutputError: The folder holds no run, or a file cannot be read.
            MissingPackageError: A package of the extra `plot` is not installed.
        """
        return View(page_of(read_run(self.folder), alone=True), height)

    def _repr_html_(self) -> str:
        return self.summary._repr_html_()
