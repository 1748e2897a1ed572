"""Files of printed tiles: written, read, and rejected if they are not valid."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.tiles import printed_tile
from mpi4py import MPI

from toros_fem import errors
from toros_fem.materials.sheet import Bladder, Composite, Membrane
from toros_fem.products.tiles.printed_tile import NAME, PrintedTile, read_tile, write_tile


def write_entries(comm: MPI.Comm, folder: Path, made: PrintedTile, **changes: Any) -> Path:
    """Write a printed tile with changed entries; None leaves one out."""
    if comm.rank == 0:
        write_tile(folder, made)
        with np.load(folder / NAME) as archive:
            entries = {**archive, **changes}
        np.savez(folder / NAME, **{k: v for k, v in entries.items() if v is not None})
    comm.barrier()
    return folder


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"size_x": None, "c1": None}, r"tile.npz lacks size_x, c1\. Write it by .*write_tile"),
        ({"size_y": -0.01}, "contains no printed tile: size_y = -0.01 .* greater than 0"),
        (
            {"fabric_poisson": 0.7},
            "poisson = 0.7 must be a finite number, at least 0 and at most 0.5",
        ),
        ({"c1": 0.9}, "c1 = 0.9 must be a finite number, above 1"),
        ({"reinforcement_thickness": "thin"}, "contains no printed tile: could not convert"),
        ({"edge_length": [1e-3, 1e-3]}, "contains no printed tile: .* size 1"),
        ({"mesh": "hexagons"}, "mesh = 'hexagons' must be one of"),
        ({"symmetry": "chiral"}, "cannot be chiral"),
        ({"printed": np.zeros(5)}, r"printed is float64 of shape \(5,\); it must be bool"),
    ],
)
def test_bad_files(alone: MPI.Comm, tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    folder = write_entries(alone, tmp_path, printed_tile(alone), **changes)
    with pytest.raises(errors.TileFileError, match=message):
        read_tile(alone, folder)


def test_a_sheet_that_wrinkles_is_read_back_so(alone: MPI.Comm, tmp_path: Path) -> None:
    made = printed_tile(alone)
    slack = replace(made.composite, membrane=Membrane("tension-field", 1e-4))
    write_tile(tmp_path, replace(made, composite=slack))
    assert read_tile(alone, tmp_path).composite == slack


def test_a_tile_is_a_membrane(alone: MPI.Comm) -> None:
    for composite in (Composite(), Composite(bending=None, bladder=Bladder(1e6, 1e-4))):
        with pytest.raises(errors.ParameterError, match="a printed tile is a membrane"):
            replace(printed_tile(alone), composite=composite)
