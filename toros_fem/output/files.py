"""Fields for ParaView, tables as CSV, summaries as JSON."""

from __future__ import annotations

import csv
import io
import json
import platform
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import dolfinx
import meshio
import numpy as np
import petsc4py

from toros_fem._types import Floats
from toros_fem._validate import checked_floats, shown
from toros_fem._version import __version__
from toros_fem.design.options import Iteration
from toros_fem.errors import OutputError, ParameterError
from toros_fem.meshes.pattern import Pattern
from toros_fem.runs.files import replace_file


def write_fields(
    path: Path, pattern: Pattern, positions: Floats, cell_fields: Mapping[str, Floats]
) -> None:
    """Write the deformed skin as a VTU file (one rank).

    The displacement from the assembled shape is written too, so that a viewer can show either.

    Args:
        path: File ending in .vtu.
        pattern: The pattern.
        positions: Deformed positions of all assembled vertices, (n, 3), in m.
        cell_fields: Values of all triangles by name, (t,) each, or (t, 3) for vectors.

    Raises:
        OutputError: The file cannot be written.
        ParameterError: The file does not end in .vtu, or an array does not fit the pattern.
    """
    path, count = Path(path), len(pattern.panel)
    if path.suffix != ".vtu":
        raise ParameterError(f"path = {shown(str(path))} must end in .vtu.")
    what = f"{pattern.points.shape}, in m"
    positions = checked_floats("positions", positions, what, pattern.points.shape, finite=False)
    for name, values in cell_fields.items():
        if np.shape(values)[:1] != (count,):
            raise ParameterError(
                f"cell_fields[{name!r}] has shape {np.shape(values)}; it must be ({count},), or "
                f"({count}, 3)."
            )
    fields = meshio.Mesh(
        positions,
        [("triangle", pattern.triangles)],
        point_data={"displacement": positions - pattern.points},
        cell_data={
            "panel": [pattern.panel.astype(np.float64)],
            **{name: [np.asarray(values)] for name, values in cell_fields.items()},
        },
    )
    try:
        fields.write(path)
    except OSError as caught:
        raise OutputError(
            f"{path} could not be written: {caught}. Make its folder first, or choose another."
        ) from None


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a mapping as JSON, numbers in full precision (one rank)."""
    replace_file(path, (json.dumps(content, indent=2, ensure_ascii=False) + "\n").encode())


def write_table(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows as CSV (one rank); a column that a row does not have stays empty there."""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, columns)
    writer.writeheader()
    writer.writerows(rows)
    replace_file(path, text.getvalue().encode())


def versions() -> dict[str, str]:
    """Return the versions that a result depends on."""
    return {
        "toros_fem": __version__,
        "dolfinx": dolfinx.__version__,
        "petsc4py": petsc4py.__version__,
        "numpy": np.__version__,
        "python": sys.version.split()[0],
        "platform": platform.platform(),
    }


class HistoryFile:
    """The design loop's history as CSV; each row is on disk before the next iteration starts."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._mode = "w"  # the file of an earlier run stays until this run has a row of its own

    def write(self, row: Iteration) -> None:
        """Append one row (one rank); all rows must have the same columns."""
        columns = row.columns()
        with self._path.open(self._mode, newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(columns))
            if self._mode == "w":
                writer.writeheader()
            writer.writerow(columns)
        self._mode = "a"
