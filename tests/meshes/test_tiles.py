"""Tiles repeat side by side and have the requested symmetry."""

import numpy as np
import pytest
import shapely
from helpers.tiles import repeating
from mpi4py import MPI

from toros_fem.base.errors import PatternError
from toros_fem.meshes import SYMMETRIES, Tile, tile
from toros_fem.meshes.tiles import KINDS
from toros_fem.meshes.triangles import edge_keys

SIZE = (0.03, 0.02)
SQUARE = 0.02
EDGE = 3e-3
SYMMETRIC = [
    (mesh, symmetry)
    for mesh in ("crossed", "union-jack", "unstructured")
    for symmetry in SYMMETRIES
]


def side(symmetry: str) -> float | tuple[float, float]:
    return SIZE if symmetry in ("none", "orthotropic") else SQUARE


def check_torus(found: Tile, area: float) -> None:
    pattern = found.pattern
    triangles = pattern.triangles
    edges = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2)
    count = len(np.unique(edge_keys(edges, len(pattern.points))))
    assert len(pattern.points) - count + len(triangles) == 0
    assert len(pattern.free_edges) == 0
    assert pattern.panel_names == ("tile",)
    assert pattern.areas.sum() == pytest.approx(area, rel=1e-12)
    assert (pattern.areas > 0).all()
    corners = pattern.points[triangles, :2] + found.wraps @ found.lattice
    assert (corners == pattern.corners).all()
    size = np.diagonal(found.lattice)
    assert (found.lattice == np.diag(size)).all()
    assert (pattern.points[:, :2] >= 0).all()
    assert (pattern.points[:, :2] < size).all()
    assert (pattern.points[:, 2] == 0).all()
    assert (pattern.flat_points.min(axis=0) == 0).all()
    assert (pattern.flat_points.max(axis=0) == size).all()


def apart(found: Tile, one: np.ndarray, two: np.ndarray) -> float:
    """The largest distance on the torus between points (t, 2) of two lists."""
    fraction = (one - two) @ np.linalg.inv(found.lattice)
    return float(np.abs((fraction - np.rint(fraction)) @ found.lattice).max())


@pytest.mark.parametrize("symmetry", SYMMETRIES)
@pytest.mark.parametrize("fraction", [0.4, 0.32, 0.2])
def test_coarse_unstructured_tori(alone: MPI.Comm, symmetry: str, fraction: float) -> None:
    """Where edges reach across a tile, or from one line of symmetry to another."""
    found = tile(alone, SQUARE, fraction * SQUARE, "unstructured", symmetry)
    check_torus(found, 4e-4)
    found.symmetry_maps(symmetry)
    if symmetry in ("none", "orthotropic"):
        for length in (0.04, 0.11):
            found = tile(alone, (SQUARE, length), fraction * SQUARE, "unstructured", symmetry)
            check_torus(found, SQUARE * length)


@pytest.mark.parametrize("mesh", KINDS)
def test_repeated(alone: MPI.Comm, mesh: str) -> None:
    small = tile(alone, SIZE, EDGE, mesh)
    for along, across in ((2, 2), (3, 1), (1, 1)):
        many = small.repeated(along, across)
        check_torus(many.tile, along * across * 6e-4)
        assert (many.tile.lattice == np.diag([along * SIZE[0], across * SIZE[1]])).all()
        assert np.bincount(many.cell) == pytest.approx(along * across)
        first, count = many.tile.pattern, len(small.wraps)
        assert (many.cell[:count] == np.arange(count)).all()
        assert (first.corners[:count] == small.pattern.corners).all()
        assert apart(small, first.centroids, small.pattern.centroids[many.cell]) < 1e-15
        assert first.areas == pytest.approx(small.pattern.areas[many.cell], rel=1e-9)
    twice = small.repeated(2, 1).tile.repeated(1, 2).tile
    assert len(twice.pattern.points) == 4 * len(small.pattern.points)
    check_torus(twice, 4 * 6e-4)


@pytest.mark.parametrize("mesh", KINDS)
def test_sheet_is_free_at_its_outer_border_only(alone: MPI.Comm, mesh: str) -> None:
    small = tile(alone, SIZE, EDGE, mesh)
    sheet, cell = small.sheet(3, 2)
    size = [3 * SIZE[0], 2 * SIZE[1]]
    assert sheet.panel_names == ("sheet",)
    assert len(sheet.seams) == 0
    assert sheet.areas.sum() == pytest.approx(6 * 6e-4, rel=1e-12)
    ends = sheet.points[sheet.free_edges]
    at_border = [(ends[:, :, k] == value).all(axis=1) for k in (0, 1) for value in (0, size[k])]
    assert np.sum(at_border, axis=0) == pytest.approx(1)
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    assert lengths.sum() == pytest.approx(2 * sum(size), rel=1e-12)
    assert apart(small, sheet.centroids, small.pattern.centroids[cell]) < 1e-15
    assert (np.bincount(cell) == 6).all()


@pytest.mark.parametrize(("mesh", "symmetry"), SYMMETRIC)
def test_symmetry_maps_are_a_group(alone: MPI.Comm, mesh: str, symmetry: str) -> None:
    found = tile(alone, side(symmetry), EDGE, mesh, symmetry)
    check_torus(found, found.lattice[0, 0] * found.lattice[1, 1])
    symmetry_maps = found.symmetry_maps(symmetry)
    count = len(found.wraps)
    assert symmetry_maps.shape == (len(SYMMETRIES[symmetry]), count)
    assert (symmetry_maps[0] == np.arange(count)).all()
    assert (np.sort(symmetry_maps, axis=1) == np.arange(count)).all()
    areas, centroids, corners = found.pattern.areas, found.pattern.centroids, found.pattern.corners
    for operation, image in zip(SYMMETRIES[symmetry], symmetry_maps, strict=True):
        assert areas[image] == pytest.approx(areas, rel=1e-9)
        assert apart(found, centroids @ operation.T, centroids[image]) < 1e-14
        gap = (corners @ operation.T)[:, :, None] - corners[image][:, None]
        fraction = gap @ np.linalg.inv(found.lattice)
        away = np.abs((fraction - np.rint(fraction)) @ found.lattice).max(axis=3)
        assert away.min(axis=2).max() < 1e-14, "corners onto corners"
    rows = {tuple(row) for row in symmetry_maps}
    assert len(rows) == len(symmetry_maps)
    assert {tuple(two[one]) for one in symmetry_maps for two in symmetry_maps} == rows


@pytest.mark.parametrize("mesh", KINDS)
def test_nearest_triangles(alone: MPI.Comm, mesh: str) -> None:
    """Its own centroids on any copy, and those of a finer mesh within a triangle's size."""
    sides, length = np.array([0.01, 0.006]), 1e-3
    own = tile(alone, tuple(sides), length, mesh)
    count = len(own.pattern.panel)
    for shift in ((0, 0), (1, 0), (-2, 3)):
        found, away = own.nearest(own.pattern.centroids + shift * sides)
        assert np.array_equal(found, np.arange(count))
        assert away.max() < 1e-15
    fine = tile(alone, tuple(sides), length / 2, mesh)
    found, away = own.nearest(fine.pattern.centroids)
    assert set(found) == set(range(count)), "each has a part"
    assert away.max() < length
    gaps = fine.pattern.centroids[:, None] - own.pattern.centroids
    gaps -= sides * np.rint(gaps / sides)
    assert away == pytest.approx(np.linalg.norm(gaps, axis=2).min(axis=1), abs=1e-15)


@pytest.mark.parametrize("edge_length", [SQUARE / 3, SQUARE / 4])
def test_crossed_square_turns_by_90_degrees(alone: MPI.Comm, edge_length: float) -> None:
    """Whether its sides are divided evenly or not, and whatever symmetry it was made with."""
    found = tile(alone, SQUARE, edge_length)
    turned = found.symmetry_maps("chiral")[1]
    assert (turned[turned[turned[turned]]] == np.arange(len(turned))).all()
    assert (turned != np.arange(len(turned))).all()
    assert len(found.symmetry_maps("tetragonal")) == 8
    quadrant = found.pattern.centroids // (SQUARE / 2)
    if edge_length == SQUARE / 4:  # about the middle, counter-clockwise
        assert (quadrant[turned] == np.column_stack([1 - quadrant[:, 1], quadrant[:, 0]])).all()


def test_repeated_tiles_are_symmetric(alone: MPI.Comm) -> None:
    found = tile(alone, SQUARE, EDGE, "unstructured", "tetragonal")
    assert len(found.repeated(2, 2).tile.symmetry_maps("tetragonal")) == 8
    wide = found.repeated(2, 1).tile
    assert len(wide.symmetry_maps("orthotropic")) == 4


def test_mesh_without_the_symmetry(alone: MPI.Comm) -> None:
    for mesh in ("right", "unstructured"):
        found = tile(alone, SQUARE, EDGE, mesh)
        assert (found.symmetry_maps("none") == np.arange(len(found.wraps))).all()
        for symmetry in ("orthotropic", "chiral", "tetragonal"):
            with pytest.raises(PatternError, match=f"not {symmetry}: .* symmetry='{symmetry}'"):
                found.symmetry_maps(symmetry)
    quarters = tile(alone, SQUARE, EDGE, "unstructured", "orthotropic")
    with pytest.raises(PatternError, match="not chiral"):
        quarters.symmetry_maps("chiral")


@pytest.mark.parametrize("mesh", KINDS)
@pytest.mark.parametrize("edge", [None, 0.6e-3, 2.4e-3])
def test_along_a_region(comm: MPI.Comm, mesh: str, edge: float | None) -> None:
    """Opposite borders have the same vertices, where lines and discs cross them too."""
    rng = np.random.default_rng(2)
    discs = shapely.buffer(shapely.points(rng.uniform(0, SIZE[1], (3, 2))), 2e-3)
    line = shapely.LineString([(0, 0), SIZE]).buffer(1e-3)
    region = repeating(shapely.union_all([*discs, line]), SIZE)
    given = tile(comm, SIZE, EDGE, mesh)
    made, inside = given.following(comm, region, edge)
    check_torus(made, SIZE[0] * SIZE[1])
    assert made.pattern.areas[inside].sum() == pytest.approx(region.area, rel=2e-3)
    printed = shapely.union_all(shapely.polygons(made.pattern.corners[inside]))
    assert printed.symmetric_difference(region).area < 0.03 * region.area
    # Each border of the region on the torus is an edge: copies side by side agree.
    many, cell = made.sheet(2, 2)
    assert len(shapely.get_parts(shapely.union_all(shapely.polygons(many.corners)))) == 1
    assert many.areas[inside[cell]].sum() == pytest.approx(4 * region.area, rel=2e-3)
