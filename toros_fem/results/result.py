"""Result of a run: its figures, its summary.json, and how a notebook shows it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mpi4py import MPI

from toros_fem.base.errors import OutputError
from toros_fem.base.files import guarded, write_json
from toros_fem.base.versions import versions
from toros_fem.measures.figures import Figure, overall, verdict_of
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.results.report.notebook import EmbeddedPage, view_of
from toros_fem.results.report.tables import as_text
from toros_fem.results.runs.files import SUMMARY
from toros_fem.results.runs.folder import require_open, run_of
from toros_fem.results.runs.summary_file import Summary, figures_html
from toros_fem.results.runs.warnings import warnings_of


class RunResult(ABC):
    """What a run has found.

    Attributes:
        folder: Where its files are; None before its summary is written.
    """

    folder: Path | None = None

    @property
    @abstractmethod
    def figures(self) -> tuple[Figure, ...]:
        """The numbers that it tells, the most important first."""

    @abstractmethod
    def entries(self) -> dict[str, Any]:
        """Return the further entries of its summary; keys of numbers end in their units."""

    @abstractmethod
    def description(self) -> str:
        """Return it in a sentence."""

    @property
    def binding(self) -> Sequence[str]:
        """What keeps it from its targets, as far as it is known."""
        return ()

    @property
    def notes(self) -> Sequence[str]:
        """What is not as usual in its equilibria, as sentences."""
        return ()

    def sentence(self) -> str:
        """Return whether all targets are reached, what binds, and the description."""
        verdict, binds = verdict_of(self.figures), "; ".join(self.binding)
        said = (verdict, binds and f"What binds: {binds}", self.description())
        return ". ".join(filter(None, said))

    def value(self, key: str) -> float | None:
        """Return the value of a figure by its key, such as "angle_deg"; KeyError without it."""
        return {figure.key: figure for figure in self.figures}[key].value

    def summary(self) -> dict[str, Any]:
        """Return the content of summary.json: the list "figures", "verdict", further entries."""
        figures = self.figures
        verdict = {
            "state": overall(figures),
            "words": verdict_of(figures) or None,
            "binding": list(self.binding),
        }
        return {"figures": [one.as_dict() for one in figures], "verdict": verdict, **self.entries()}

    def show(self, height: int = 640) -> EmbeddedPage:
        """Return the skin in space, as of `StoredRun.show`; its files must be written."""
        if self.folder is None:
            raise OutputError("this result has no files yet: write them by write_summary.")
        return view_of(self.folder, height)

    def __repr__(self) -> str:
        # Not its fields, which are all arrays of the run; nor its sentence, which ranks share.
        return f"{type(self).__name__}({'' if self.folder is None else repr(str(self.folder))})"

    def __str__(self) -> str:
        content = {**self.summary(), "warnings": list(self.notes)}
        del content["figures"]
        return as_text(Summary({figure.key: figure for figure in self.figures}, content))

    def _repr_html_(self) -> str:
        return figures_html(self.figures)


def state_figures(pressure: float, state: Equilibrium | None, parts: int) -> tuple[Figure, ...]:
    """Return the figures of an equilibrium that every skin has, of one of its equal parts.

    The pressure is in Pa. Others are unknown where there is no equilibrium.
    """
    return (
        Figure("pressure", "pa", pressure),
        Figure("volume", "m3", None if state is None else parts * state.volume),
        Figure("stretch", "use", None if state is None else state.stretch_use),
    )


def write_summary(comm: MPI.Comm, folder: Path | str, result: RunResult) -> dict[str, Any]:
    """Write summary.json and return its content, the first rank's on all ranks (collective).

    Raises:
        OutputError: It cannot be written; on all ranks. The folder holds a run that is not open; on
            all ranks.
    """
    folder = Path(folder)
    content = {**result.summary(), "ranks": comm.size, "versions": versions()}
    run = run_of(folder)
    logged = [] if run is None else run.warnings.texts
    said = [*logged, *result.notes, *warnings_of(content)]
    content["warnings"] = list(dict.fromkeys(said))
    content = dict(comm.bcast(content, root=0))  # each rank has its own clock

    def write() -> None:
        require_open(folder)
        write_json(folder / SUMMARY, content)

    guarded(comm, folder, write)
    object.__setattr__(result, "folder", folder)  # of frozen dataclasses, which it is no field of
    return content
