"""The demo of a sheet of tiles: print file, pull test, files."""

from pathlib import Path

import numpy as np
from helpers.tiles import printed_tile
from mpi4py import MPI

from toros_fem.products.tiles import pulled_sheet as demo
from toros_fem.products.tiles.printed_tile import write_tile

SIZE = 0.01
SMALL = demo.TileSheetScene.of(along=3, across=1, strain_steps=2, edge_length=SIZE / 14)


def test_a_tile_from_a_file(alone: MPI.Comm, tmp_path: Path) -> None:
    """On its own mesh, in one direction."""
    made = printed_tile()
    write_tile(tmp_path, made)
    config = SMALL.updated(edge_length=None, direction="y", strain_steps=1, margin=0.0)
    summary = config.run_simulation(alone, tmp_path / "read", {"tile": tmp_path}).summary()
    assert list(summary["directions"]) == ["y"]
    assert summary["triangles"] == 3 * len(made.tile(alone)[1])
    assert summary["tile_m"] == made.size
    assert summary["printed_share"] == made.region.area / np.prod(made.size)
    assert summary["inputs"]["tile"] == str(tmp_path)
