"""The report of a run: one page with everything in it, which a browser opens offline."""

from __future__ import annotations

import base64
import hashlib
from importlib import resources
from pathlib import Path

from toros_fem.base.errors import OutputError
from toros_fem.base.files import naming, replace_file
from toros_fem.base.packages import required, template
from toros_fem.results.report import tables
from toros_fem.results.report.scene import packed_scene
from toros_fem.results.runs.files import FILES
from toros_fem.results.runs.run_folder import Run, read_run

NAME = "report.html"


def write_report(folder: str | Path) -> Path:
    """Write report.html into a run's folder and return its path (one rank).

    Everything comes from files in the folder. A run that was stopped, or is still going on, is
    shown as far as it has come.

    Raises:
        FileError: The folder holds no run.
        OutputError: A file cannot be read, or the page not be written.
        MissingPackageError: A package of the extra `plot` is not installed.
    """
    run = read_run(folder)
    page, path = page_of(run), run.folder / NAME
    with naming(path):
        replace_file(path, page.encode())
    return path


def page_of(run: Run, *, alone: bool = False) -> str:
    """Return the page of a run, or its view in space alone, as HTML that needs no other file.

    Raises:
        OutputError: A file of the run holds a value that no run writes.
        MissingPackageError: A package of the extra `plot` is not installed.
    """
    try:
        return _page(run, alone=alone)
    except (AttributeError, LookupError, TypeError, ValueError) as caught:
        raise OutputError(
            f"{run.folder}: a file, most likely summary.json, holds a value that no run writes "
            f"({caught!r}). Run the scene again."
        ) from caught


def _page(run: Run, *, alone: bool) -> str:
    filled = template("toros_fem.results.report", "page/report.html", "plot").render
    required("matplotlib", "plot")
    from toros_fem.results.report import charts

    scene, data, patterns = packed_scene(run) if run.series else ({"series": {}}, "", [])
    # The page's own scripts run, and no other that a name or a message brings along.
    scripts = [f"\n/*\n{_text('three.LICENSE')}*/\n{_text('three.min.js')}", _text("viewer.js")]
    shown: str = filled(
        run=run,
        alone=alone,
        tables=tables,
        style=_text("report.css"),
        curve=charts.over_pressure(run),
        convergence=charts.over_iterations(run),
        patterns=patterns,
        files={n: text for n, text in FILES.items() if n != NAME and (run.folder / n).is_file()},
        scene=scene,
        data=data,
        scripts=scripts,
        hashes=[base64.b64encode(hashlib.sha256(s.encode()).digest()).decode() for s in scripts],
    )
    return shown


def _text(name: str) -> str:
    folder = resources.files("toros_fem.results.report")
    return folder.joinpath("page", name).read_text(encoding="utf-8")
