"""Printed tiles: their files, on other meshes, and as sheets to print."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from helpers.tiles import printed_tile
from mpi4py import MPI

from toros_fem import errors
from toros_fem.base.archive import read_archive, write_archive
from toros_fem.products.tiles.printed_tile import (
    NAME,
    print_layout,
    read_tile,
    region_of_triangles,
    remesh,
    swatch,
    tile_sheet,
    write_tile,
)
from toros_fem.products.tiles.pulled_sheet import cross_tile

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


def test_remesh_keeps_the_print(alone: MPI.Comm) -> None:
    made = printed_tile(alone)
    same = remesh(alone, made, made.edge_length)
    assert (same.printed == made.printed).all()
    plain = [{**asdict(one), "printed": None} for one in (same, made)]
    assert plain[0] == plain[1]
    finer = remesh(alone, made, made.edge_length / 6)
    areas = [one.tile(alone).pattern.areas[one.printed].sum() for one in (made, finer)]
    assert areas[1] == pytest.approx(areas[0], rel=2e-2)
    for all_or_none in (np.ones_like, np.zeros_like):
        whole = remesh(alone, replace(made, printed=all_or_none(made.printed)), 2e-3)
        assert (whole.printed == all_or_none(whole.printed)).all()


@pytest.mark.parametrize("name", ["x", "y"])
def test_print_is_continuous_across_tiles(alone: MPI.Comm, name: str) -> None:
    made = printed_tile(alone)
    mesh = made.tile(alone)
    sheet = tile_sheet(mesh, name, 4, 3)
    area = mesh.pattern.areas[made.printed].sum()
    cloth, (region,) = print_layout([sheet], made.printed, 0.015)
    assert region.area == pytest.approx(12 * area, rel=1e-9)
    axis = sheet.axis
    size = np.array(made.size) * ((4, 3) if axis == 0 else (3, 4))
    size[axis] += 0.03
    assert np.ptp(cloth.flat_points, axis=0) == pytest.approx(size)
    bounds = np.reshape(region.bounds, (2, 2))
    assert bounds[0, axis] == pytest.approx(0.015)
    assert bounds[1, axis] == pytest.approx(size[axis] - 0.015)
    # A completely printed sheet is one rectangle without borders between tiles.
    _, (whole,) = print_layout([sheet], np.ones_like(made.printed), 0.015)
    assert whole.geom_type == "Polygon"
    assert len(whole.interiors) == 0
    assert len(whole.exterior.coords) == 5
    assert whole.area == pytest.approx(12 * np.prod(made.size), rel=1e-9)
    assert print_layout([sheet], np.zeros_like(made.printed), 0.0)[1][0].is_empty


def test_swatch_is_large_enough_to_clamp(alone: MPI.Comm) -> None:
    made = printed_tile(alone)
    mesh = made.tile(alone)
    region = region_of_triangles(mesh.pattern.corners[made.printed])
    cloth, printed = swatch(mesh, region)
    counts = np.ceil(0.05 / np.array(made.size))
    assert printed.area == pytest.approx(counts.prod() * region.area, rel=1e-6)
    assert np.ptp(cloth.flat_points, axis=0) == pytest.approx(counts * made.size + [0.04, 0])
    low, high = np.reshape(printed.bounds, (2, 2))
    assert low[0] >= 0.02 - 1e-9
    assert high[0] <= 0.02 + counts[0] * made.size[0] + 1e-9


def test_lines_of_neighbouring_tiles_are_joined(alone: MPI.Comm) -> None:
    made = cross_tile(alone)
    mesh = made.tile(alone)
    _, (region,) = print_layout([tile_sheet(mesh, "x", 3, 2)], made.printed, 0.0)
    assert len(shapely.get_parts(region)) == 1
    single = region_of_triangles(mesh.pattern.corners[made.printed])
    assert region.area == pytest.approx(6 * single.area, rel=1e-9)
