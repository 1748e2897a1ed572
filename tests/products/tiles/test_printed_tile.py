"""Files of printed tiles: written, read, and rejected if they are not valid."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.tiles import printed_tile
from mpi4py import MPI

from toros_fem import errors
from toros_fem.base.archive import read_archive, write_archive
from toros_fem.materials.sheet import Bladder, Composite, Knit, Material, Membrane
from toros_fem.products.tiles.printed_tile import NAME, read_tile, write_tile


def test_a_tile_is_read_with_all_of_its_materials(alone: MPI.Comm, tmp_path: Path) -> None:
    """A sheet that wrinkles stays one, and a material keeps its own bounds."""
    wrinkled = Composite(
        Material(0.2e6, 0.4, 3e-4, c1=1.8), c2=3.0, bending=None,
        membrane=Membrane(wrinkling="tension-field"),
    )  # fmt: skip
    for composite in (wrinkled, Composite(bending=None, knit=Knit(1.5, 0.3))):
        made = replace(printed_tile(alone), composite=composite)
        write_tile(tmp_path, made)
        found = read_tile(alone, tmp_path)
        assert found.composite == composite
        assert np.array_equal(found.printed, made.printed)
        assert len(found.tile(alone).wraps) == len(found.printed)


SOFT = {"young": "soft", "poisson": 0.3, "thickness": 1e-3}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"size": None}, "it lacks 'size'"),
        ({"size": [0.01, -0.01]}, "is not valid: size_y = -0.01 .* greater than 0"),
        ({"composite": {"c1": 0.9}}, "c1 = 0.9 must be a finite number, above 1"),
        (
            {"composite": {"fabric": {"young": "soft", "poisson": 0.3, "thickness": 1e-3}}},
            "is not valid: .*young = 'soft'",
        ),
        ({"composite": {"fabrics": 1}}, "unknown parameter 'fabrics'; did you mean 'fabric'"),
        ({"edge_length": [1e-3, 1e-3]}, "is not valid: edge_length"),
        ({"mesh": "hexagons"}, "mesh = 'hexagons' must be one of"),
        ({"symmetry": "chiral"}, "cannot be chiral"),
    ],
)
def test_bad_files(alone: MPI.Comm, tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    write_tile(tmp_path, printed_tile(alone))
    path, failure = tmp_path / NAME, errors.TileFileError
    content = read_archive(path, "tile", lambda archive: archive, failure, "")
    numbers = {**content.numbers, **changes}
    numbers = {name: value for name, value in numbers.items() if value is not None}
    write_archive(path, replace(content, numbers=numbers))
    with pytest.raises(failure, match=message):
        read_tile(alone, tmp_path)
    write_archive(path, replace(content, arrays={"printed": np.zeros(5)}))
    with pytest.raises(failure, match=r"printed is float64 of shape \(5,\); it must be bool"):
        read_tile(alone, tmp_path)


def test_a_tile_is_a_membrane(alone: MPI.Comm) -> None:
    for composite in (Composite(), Composite(bending=None, bladder=Bladder(1e6, 1e-4))):
        with pytest.raises(errors.ParameterError, match="a printed tile is a membrane"):
            replace(printed_tile(alone), composite=composite)
