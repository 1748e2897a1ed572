"""Prints as files: nothing is lost, and what is no print is refused."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from mpi4py import MPI

from toros_fem.base.errors import PatternFileError
from toros_fem.base.mpi import on_first_rank
from toros_fem.making.print.print_file import NAME, read_print_polygons, write_print_polygons
from toros_fem.making.print.printability import PrintLimits
from toros_fem.meshes import cylinder, write_pattern

LIMITS = PrintLimits(0.5e-3, 0.7e-3, 1e-6)
HOLE = [(5e-3, 1e-3), (6e-3, 1e-3), (6e-3, 15e-4)]
REGIONS = [
    shapely.Polygon([(0, 0), (0.01, 0), (0.01, 1 / 300)], [HOLE]),
    shapely.MultiPolygon([shapely.box(0, 0, 1e-3, 1e-3), shapely.box(2e-3, 0, 3e-3, 1e-3)]),
    shapely.Polygon(),
]  # fmt: skip


@pytest.fixture
def folder(alone: MPI.Comm, tmp_path: Path) -> Path:
    place = tmp_path
    tube = cylinder(alone, 0.06, 0.02, 6e-3)
    on_first_rank(alone, lambda: write_print_polygons(place / NAME, tube, REGIONS, LIMITS))
    return place


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"version": 99}, "has version 99"),
        ({"region_sizes": np.array([1, 2])}, "the polygons do not fit the panels"),
        ({"region_sizes": np.array([-1, 2, 3])}, "the polygons do not fit the panels"),
        ({"region_sizes": None}, "lacks region_sizes"),
        ({"region_bytes": b"not this"}, "is not valid"),
        ({"line_width": -1.0}, "width = -1.0"),
    ],
)
def test_other_files_are_refused(
    alone: MPI.Comm, folder: Path, changes: dict[str, Any], message: str
) -> None:
    path = folder / NAME

    def rewrite() -> None:
        with np.load(path) as archive:
            entries = {**archive, **changes}
        np.savez(path, **{key: value for key, value in entries.items() if value is not None})

    on_first_rank(alone, rewrite)
    with pytest.raises(PatternFileError, match=message):
        read_print_polygons(alone, folder)


def test_a_pattern_is_no_print(alone: MPI.Comm, folder: Path) -> None:
    tube = cylinder(alone, 0.06, 0.02, 6e-3)
    on_first_rank(alone, lambda: write_pattern(folder / NAME, tube))
    with pytest.raises(PatternFileError, match="another kind of file"):
        read_print_polygons(alone, folder)
