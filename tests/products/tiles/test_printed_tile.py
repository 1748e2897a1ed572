"""Printed tiles: their files, on other meshes, and as sheets to print."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from helpers.tiles import printed_tile
from mpi4py import MPI

from toros_fem import errors
from toros_fem.base.files import read_archive, write_archive
from toros_fem.products.tiles.report import (
    NAME,
    PrintedTile,
    print_layout,
    read_tile,
    swatch,
    write_tile,
)

SOFT = {"young": "soft", "poisson": 0.3, "thickness": 1e-3}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"size": None}, "it lacks 'size'"),
        ({"size": [0.01, -0.01]}, "is not valid: size_y = -0.01 .* greater than 0"),
        ({"composite": {"c1": 0.9}}, "c1 = 0.9 must be a finite number, above 1"),
        ({"composite": {"fabric": SOFT}}, "is not valid: .*young = 'soft'"),
        ({"composite": {"fabrics": 1}}, "unknown parameter 'fabrics'; did you mean 'fabric'"),
        ({"edge_length": [1e-3, 1e-3]}, "is not valid: edge_length"),
        ({"mesh": "crossed"}, "unexpected keyword argument 'mesh'"),
    ],
)
def test_bad_files(alone: MPI.Comm, tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    write_tile(tmp_path, printed_tile())
    path, failure = tmp_path / NAME, errors.FileError
    content = read_archive(path, "tile", lambda archive: archive, failure, "")
    numbers = {**content.numbers, **changes}
    numbers = {name: value for name, value in numbers.items() if value is not None}
    write_archive(path, replace(content, numbers=numbers))
    with pytest.raises(failure, match=message):
        read_tile(alone, tmp_path)
    write_archive(path, replace(content, arrays={**content.arrays, "region_sizes": np.ones(2)}))
    with pytest.raises(failure, match="the polygons do not fit"):
        read_tile(alone, tmp_path)


@pytest.mark.parametrize("edge", [0.5e-3, 1e-3, 2e-3])
def test_meshes_along_the_print(comm: MPI.Comm, edge: float) -> None:
    """All of them have its area."""
    made = replace(printed_tile(), edge_length=edge)
    mesh, printed = made.tile(comm)
    areas = mesh.pattern.areas
    assert areas.sum() == pytest.approx(np.prod(made.size), rel=1e-9)
    assert areas[printed].sum() == pytest.approx(made.region.area, rel=1e-6)
    for region, part in ((shapely.box(0, 0, *made.size), 1.0), (shapely.Polygon(), 0.0)):
        whole = replace(made, region=region)
        mesh, printed = whole.tile(comm)
        assert printed.mean() == part


def test_print_is_continuous_across_tiles(alone: MPI.Comm) -> None:
    made = printed_tile()
    mesh, _ = made.tile(alone)
    cloth, region = print_layout(mesh, made.region, (4, 3), 0.015)
    assert region.area == pytest.approx(12 * made.region.area, rel=1e-6)
    size = np.array(made.size) * (4, 3) + [0.03, 0]
    assert np.ptp(cloth.flat_points, axis=0) == pytest.approx(size)
    bounds = np.reshape(region.bounds, (2, 2))
    assert bounds[:, 0] == pytest.approx([0.015, size[0] - 0.015])
    # A completely printed sheet is one rectangle without borders between tiles.
    _, whole = print_layout(mesh, shapely.box(0, 0, *made.size), (4, 3), 0.015)
    assert whole.geom_type == "Polygon"
    assert len(whole.interiors) == 0
    assert len(whole.exterior.coords) == 5
    assert whole.area == pytest.approx(12 * np.prod(made.size), rel=1e-6)
    assert print_layout(mesh, shapely.Polygon(), (4, 3), 0.0)[1].is_empty


def test_swatch_is_large_enough_to_clamp(alone: MPI.Comm) -> None:
    made, (mesh, _) = printed_tile(), printed_tile().tile(alone)
    cloth, printed = swatch(mesh, made.region)
    counts = np.ceil(0.05 / np.array(made.size))
    assert printed.area == pytest.approx(counts.prod() * made.region.area, rel=1e-6)
    assert np.ptp(cloth.flat_points, axis=0) == pytest.approx(counts * made.size + [0.04, 0])
    low, high = np.reshape(printed.bounds, (2, 2))
    assert low[0] >= 0.02 - 1e-9
    assert high[0] <= 0.02 + counts[0] * made.size[0] + 1e-9


def test_lines_of_neighbouring_tiles_are_joined(alone: MPI.Comm) -> None:
    ways = shapely.linestrings([[(-0.01, -0.01), (0.02, 0.02)], [(-0.01, 0.02), (0.02, -0.01)]])
    lines = shapely.union_all(shapely.buffer(ways, 0.5e-3, cap_style="flat"))
    made = PrintedTile(lines & shapely.box(0, 0, 0.01, 0.01), (0.01, 0.01), 1e-3)
    mesh, _ = made.tile(alone)
    _, region = print_layout(mesh, made.region, (3, 2), 0.0)
    assert len(shapely.get_parts(region)) == 1
    assert region.area == pytest.approx(6 * made.region.area, rel=1e-6)
