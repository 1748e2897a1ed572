"""Printed tiles on other meshes, and as sheets to print."""

from dataclasses import asdict, replace

import numpy as np
import pytest
import shapely
from helpers.tiles import printed_tile
from mpi4py import MPI

from toros_fem import errors
from toros_fem.products.tiles import pulled_sheet as demo
from toros_fem.products.tiles.sheet import (
    print_layout,
    region_of_triangles,
    remesh,
    swatch,
    tile_sheet,
)


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
    with pytest.raises(errors.ParameterError, match="margin = -0.01"):
        print_layout([sheet], made.printed, -0.01)


def test_swatch_is_large_enough_to_clamp(alone: MPI.Comm) -> None:
    made = printed_tile(alone)
    mesh = made.tile(alone)
    region = region_of_triangles(mesh.pattern.corners[made.printed])
    cloth, printed = swatch(mesh, region, made.printed)
    counts = np.ceil(0.05 / np.array(made.size))
    assert printed.area == pytest.approx(counts.prod() * region.area, rel=1e-6)
    assert np.ptp(cloth.flat_points, axis=0) == pytest.approx(counts * made.size + [0.04, 0])
    low, high = np.reshape(printed.bounds, (2, 2))
    assert low[0] >= 0.02 - 1e-9
    assert high[0] <= 0.02 + counts[0] * made.size[0] + 1e-9


def test_lines_of_neighbouring_tiles_are_joined(alone: MPI.Comm) -> None:
    made = demo.cross_tile(alone)
    mesh = made.tile(alone)
    _, (region,) = print_layout([tile_sheet(mesh, "x", 3, 2)], made.printed, 0.0)
    assert len(shapely.get_parts(region)) == 1
    single = region_of_triangles(mesh.pattern.corners[made.printed])
    assert region.area == pytest.approx(6 * single.area, rel=1e-9)
    with pytest.raises(errors.ParameterError, match="direction = 'z' must be one of 'x', 'y'"):
        tile_sheet(mesh, "z", 1, 1)
    with pytest.raises(errors.ParameterError, match="along = 0"):
        tile_sheet(mesh, "x", 0, 1)
