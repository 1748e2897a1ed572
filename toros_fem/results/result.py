"""Result of a run: its figures, its summary.json, and how both are read again."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from mpi4py import MPI

from toros_fem.base.errors import OutputError
from toros_fem.base.files import read_json, write_json, write_together
from toros_fem.base.versions import versions
from toros_fem.measures.figures import Figure
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.results.runs.folder import SUMMARY


class RunResult(ABC):
    """What a run has found."""

    @property
    @abstractmethod
    def figures(self) -> tuple[Figure, ...]:
        """The numbers that it tells, the most important first."""

    @abstractmethod
    def entries(self) -> dict[str, Any]:
        """Return the further entries of its summary; keys of numbers end in their units."""

    @abstractmethod
    def sentence(self) -> str:
        """Return it in a sentence."""

    def value(self, key: str) -> float | None:
        """Return the value of a figure by its key, such as "angle_deg".

        Raises:
            KeyError: There is no such figure.
        """
        return {figure.key: figure for figure in self.figures}[key].value

    def summary(self) -> dict[str, Any]:
        """Return the content of summary.json: the list "figures", and further entries."""
        return {"figures": [figure.as_dict() for figure in self.figures], **self.entries()}


def state_figures(pressure: float, state: Equilibrium | None, parts: int) -> tuple[Figure, ...]:
    """Return the figures of an equilibrium that every skin has.

    Args:
        pressure: In Pa.
        state: The equilibrium; None where there is none.
        parts: Number of equal parts of the skin, of which this is one.
    """
    return (
        Figure("pressure", "pa", pressure),
        Figure("volume", "m3", None if state is None else parts * state.volume),
        Figure("stretch", "use", None if state is None else state.stretch_use),
    )


@dataclass(frozen=True)
class Summary:
    """What summary.json of a run holds; empty for a run that was stopped.

    Attributes:
        figures: The figures by their keys, such as "angle_deg".
        entries: Further entries.
    """

    figures: Mapping[str, Figure]
    entries: Mapping[str, Any]

    def __bool__(self) -> bool:
        """Whether there is one."""
        return bool(self.figures or self.entries)

    def value(self, key: str) -> float | None:
        """Return the value of a figure; None if there is no such figure, or no equilibrium."""
        return self.figures[key].value if key in self.figures else None


def write_summary(comm: MPI.Comm, folder: Path | str, result: RunResult) -> dict[str, Any]:
    """Write summary.json and return its content, the first rank's on all ranks (collective).

    Raises:
        OutputError: It cannot be written; on all ranks.
    """
    content = {**result.summary(), "ranks": comm.size, "versions": versions()}
    content = dict(comm.bcast(content, root=0))  # each rank has its own clock
    write_together(comm, folder, lambda: write_json(Path(folder) / SUMMARY, content))
    return content


def read_content(folder: Path) -> dict[str, Any]:
    """Return what summary.json of a run holds, empty if there is none yet (one rank).

    Raises:
        OutputError: It cannot be read, is none, or is that of an earlier version.
    """
    path = folder / SUMMARY
    content = read_json(path)
    if content and "figures" not in content:
        raise OutputError(
            f'{path} has no list "figures": it was written by an earlier version of toros_fem, '
            "whose runs are not read any more. Run the scene again."
        )
    return content


def read_summary(folder: Path) -> Summary:
    """Return the summary of a run, empty if there is none yet (one rank).

    Raises:
        OutputError: It cannot be read, is none, or is that of an earlier version.
    """
    content = read_content(folder)
    try:
        rows = content.pop("figures", [])
        found = [Figure(*(row[one.name] for one in fields(Figure))) for row in rows]
    except (KeyError, TypeError):
        path = folder / SUMMARY
        raise OutputError(f'{path}: an entry of "figures" is no figure. Run again.') from None
    return Summary({figure.key: figure for figure in found}, content)
