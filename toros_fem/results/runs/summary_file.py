"""What summary.json of a run holds, read again."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from html import escape
from math import isfinite
from pathlib import Path
from typing import Any

from toros_fem.base.errors import OutputError
from toros_fem.base.files import read_json
from toros_fem.base.validation import is_number
from toros_fem.measures.figures import NONE, Figure
from toros_fem.results.runs.files import SUMMARY


@dataclass(frozen=True)
class Summary:
    """What summary.json of a run holds: figures by their keys, as "angle_deg", further entries.

    It is empty for a run that was stopped.
    """

    figures: Mapping[str, Figure]
    entries: Mapping[str, Any]

    def __bool__(self) -> bool:
        """Whether there is one."""
        return bool(self.figures or self.entries)

    def value(self, key: str) -> float | None:
        """Return the value of a figure; None if there is no such figure, or no equilibrium."""
        return self.figures[key].value if key in self.figures else None

    @property
    def meshes(self) -> dict[float, Mapping[str, float]]:
        """Values of metrics on each mesh, by its edge length over that of the print's mesh."""
        told = (self.entries.get("errors") or {}).get("meshes") or {}
        return {float(ratio): values for ratio, values in told.items()}

    def own_value(self, key: str) -> float | None:
        """Return a value on the print's mesh, as of `value`; a finer one may tell the figure."""
        return self.meshes.get(1.0, {}).get(key, self.value(key))

    def _repr_html_(self) -> str:
        return figures_html(self.figures.values())


def figures_html(figures: Iterable[Figure]) -> str:
    """Return the table of figures that a notebook shows."""
    rows = [
        (figure.label, figure.shown, figure.asked or NONE, figure.state or "") for figure in figures
    ]
    cells = ("".join(f"<td>{escape(text)}</td>" for text in row) for row in rows)
    body = "".join(f"<tr>{row}</tr>" for row in cells)
    return f"<table><tr><th></th><th>value</th><th>target</th><th>state</th></tr>{body}</table>"


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


def _figure(row: Mapping[str, Any]) -> Figure:
    """Return the figure of an entry; a KeyError, TypeError or ValueError says that it is none."""
    found = Figure(*(row[one.name] for one in fields(Figure)))
    named = isinstance(found.name, str) and isinstance(found.unit, str)
    widths = (found.interval, found.tolerance)
    numbers = [one for one in (found.value, found.target, *widths) if one is not None]
    finite = all(is_number(one) and isfinite(one) for one in numbers)
    if not named or not finite or any(one is not None and one < 0 for one in widths):
        raise ValueError
    return found


def summary_of(folder: Path) -> Summary:
    """Return the summary of a run, as of `read_content`."""
    content = read_content(folder)
    try:
        rows = content.pop("figures", [])
        found = [_figure(row) for row in rows]
    except (KeyError, TypeError, ValueError):
        path = folder / SUMMARY
        raise OutputError(f'{path}: an entry of "figures" is no figure. Run again.') from None
    return Summary({figure.key: figure for figure in found}, content)
