"""Fields for ParaView, tables as CSV, summaries as JSON."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path

import meshio
import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import OutputError, ParameterError
from toros_fem.base.validation import checked_floats, shown
from toros_fem.design.loop.options import Iteration
from toros_fem.meshes.pattern import Pattern


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
