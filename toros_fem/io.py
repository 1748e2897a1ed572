"""Fields for ParaView, history as CSV, summary as JSON."""

from __future__ import annotations

import csv
import dataclasses
import json
import platform
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TextIO

import dolfinx
import meshio
import numpy as np
import numpy.typing as npt
import petsc4py

import toros_fem
from toros_fem.meshes.pattern import Pattern
from toros_fem.optimise import Iteration

Floats = npt.NDArray[np.float64]


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


def versions() -> dict[str, str]:
    """Versions that a result depends on."""
    return {
        "toros_fem": toros_fem.__version__,
        "dolfinx": dolfinx.__version__,
        "petsc4py": petsc4py.__version__,
        "numpy": np.__version__,
        "python": sys.version.split()[0],
        "platform": platform.platform(),
    }


class HistoryFile:
    """The design loop's history as CSV, each row on disk before the next iteration starts."""

    def __init__(self, path: Path, extra: tuple[str, ...] = ()) -> None:
        self._file: TextIO = path.open("w", newline="", encoding="utf-8")
        names = [column.name for column in dataclasses.fields(Iteration)]
        self._writer = csv.DictWriter(self._file, [*names, *extra])
        self._writer.writeheader()

    def write(self, row: Iteration, **extra: float) -> None:
        """Append one row."""
        self._writer.writerow({**dataclasses.asdict(row), **extra})
        self._file.flush()

    def close(self) -> None:
        """Close the file."""
        self._file.close()
