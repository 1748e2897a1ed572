"""Fields for ParaView, history as CSV, summary as JSON."""

from __future__ import annotations

from toros_fem._types import Floats

import csv
import dataclasses
import json
import platform
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import dolfinx
import meshio
import numpy as np
import numpy.typing as npt
import petsc4py

from toros_fem._version import __version__
from toros_fem.meshes.pattern import Pattern
from toros_fem.design.options import (Iteration)



def write_fields(
    path: Path, pattern: Pattern, positions: Floats, cell_fields: Mapping[str, Floats]
) -> None:
    """Write the deformed skin as a VTU file (one rank).

    Args:
        path: File ending in .vtu.
        pattern: The pattern.
        positions: Deformed positions of all assembled vertices (n, 3) in m. The displacement
            from the assembled shape is written too, so that either can be shown.
        cell_fields: Values of all triangles, (t,) each.
    """
    meshio.Mesh(
        positions,
        [("triangle", pattern.triangles)],
        point_data={"displacement": positions - pattern.points},
        cell_data={
            "panel": [pattern.panel.astype(np.float64)],
            **{name: [np.asarray(values)] for name, values in cell_fields.items()},
        },
    ).write(path)


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a mapping as JSON, numbers in full precision (one rank)."""
    path.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def write_table(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows of equal columns as CSV (one rank)."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def versions() -> dict[str, str]:
    """Versions that a result depends on."""
    return {
        "toros_fem": __version__,
        "dolfinx": dolfinx.__version__,
        "petsc4py": petsc4py.__version__,
        "numpy": np.__version__,
        "python": sys.version.split()[0],
        "platform": platform.platform(),
    }


class HistoryFile:
    """The design loop's history as CSV, each row on disk before the next iteration starts."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._mode = "w"  # what an earlier run left stays until this one has a row of its own

    def write(self, row: Iteration, **extra: float) -> None:
        """Append one row, with further columns that must be the same in each row."""
        columns = {**dataclasses.asdict(row), **extra}
        with self._path.open(self._mode, newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(columns))
            if self._mode == "w":
                writer.writeheader()
            writer.writerow(columns)
        self._mode = "a"
