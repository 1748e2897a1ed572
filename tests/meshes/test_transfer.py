"""Transfer of densities and shapes between meshes of the same panels."""

import numpy as np
import pytest
from mpi4py import MPI
from scipy.spatial.transform import Rotation

from toros_fem.meshes import Pattern, bend, cylinder, rectangle, walker
from toros_fem.meshes.sheets import one_panel
from toros_fem.meshes.transfer import make_transfer, refine

FINE, COARSE = 4.5e-3, 9e-3


@pytest.fixture(scope="module")
def tubes(alone: MPI.Comm) -> tuple[Pattern, Pattern]:
    coarse, fine = (cylinder(alone, 0.06, 0.02, h) for h in (COARSE, FINE))
    return coarse, fine


def noise(pattern: Pattern) -> np.ndarray:
    return np.random.default_rng(4).random(len(pattern.panel))


def mean(pattern: Pattern, panel: str, values: np.ndarray) -> float:
    cells = pattern.cells_of(panel)
    return float(np.average(values[cells], weights=pattern.areas[cells]))


def test_same_mesh_is_the_identity(tubes: tuple[Pattern, Pattern]) -> None:
    _, fine = tubes
    transfer = make_transfer(fine, fine)
    assert np.abs(transfer.at_cells(noise(fine)) - noise(fine)).max() < 1e-12
    deformed = bend(2.0, 0.06)(fine.points)
    for moved in (transfer.at_vertices(deformed), transfer.positions(deformed)):
        assert np.abs(moved - deformed).max() < 1e-12 * fine.size


def test_refinement_copies_densities(alone: MPI.Comm) -> None:
    """Also where mesh edges lie on each other; and back: the mean of the four quarters."""
    pattern = walker(alone, 8e-3)
    finer = refine(pattern)
    transfer = make_transfer(pattern, finer.pattern)
    assert np.abs(transfer.at_cells(noise(pattern)) - noise(pattern)[finer.cell]).max() < 1e-12
    places = finer.at_vertices(pattern.points)
    assert np.abs(transfer.at_vertices(pattern.points) - places).max() < 1e-12 * pattern.size
    back = make_transfer(finer.pattern, pattern).at_cells(noise(finer.pattern))
    quarters = noise(finer.pattern).reshape(-1, 4).mean(axis=1)
    assert np.abs(back - quarters).max() < 1e-12


@pytest.mark.parametrize("downwards", [True, False], ids=["to fine", "to coarse"])
def test_integral_is_kept_where_panels_are_equal(comm: MPI.Comm, downwards: bool) -> None:
    """On unstructured meshes that have nothing but their outline in common."""
    source, target = (rectangle(comm, 0.07, 0.03, h, mesh="unstructured") for h in (7e-3, 3e-3))
    if not downwards:
        source, target = target, source
    transfer = make_transfer(source, target)
    assert np.abs(transfer.overlap.sum(axis=1) / target.areas - 1).max() < 1e-12
    assert np.abs(transfer.overlap.sum(axis=0) / source.areas - 1).max() < 1e-12
    before, after = source.areas @ noise(source), target.areas @ transfer.at_cells(noise(source))
    assert after == pytest.approx(before, rel=1e-12)
    plain = np.asarray(transfer.overlap @ noise(source)) / target.areas
    assert np.abs(transfer.at_cells(noise(source)) - plain).max() < 1e-12, "no correction"


def test_mean_and_range_are_kept_on_each_panel(tubes: tuple[Pattern, Pattern]) -> None:
    """Where round panels are polygons with other numbers of sides."""
    coarse, fine = tubes
    assert coarse.areas.sum() != pytest.approx(fine.areas.sum(), rel=1e-3)
    binary = (noise(coarse) > 0.6).astype(float)
    binary[coarse.cells_of("base")] = 1.0
    for source, target in ((coarse, fine), (fine, coarse)):
        values = binary if source is coarse else noise(fine)
        moved = make_transfer(source, target).at_cells(values)
        for panel in source.panel_names:
            part = values[source.cells_of(panel)]
            assert mean(target, panel, moved) == pytest.approx(
                mean(source, panel, values), rel=1e-12
            )
            assert moved[target.cells_of(panel)].min() >= part.min()
            assert moved[target.cells_of(panel)].max() <= part.max()


def test_rigid_motion_moves_the_finer_skin_alike(tubes: tuple[Pattern, Pattern]) -> None:
    """Its vertices are not on the flat triangles of the coarse skin; their offset turns too."""
    coarse, fine = tubes
    turn = Rotation.from_rotvec([0.4, -1.0, 0.7]).as_matrix()
    transfer = make_transfer(coarse, fine)
    moved = transfer.positions(coarse.points @ turn.T + 0.2)
    assert np.abs(moved - (fine.points @ turn.T + 0.2)).max() < 1e-12 * fine.size


def test_large_triangles_beside_small_ones(alone: MPI.Comm) -> None:
    """A tree of boxes finds the pairs of both."""
    pattern = rectangle(alone, 0.02, 0.02, 1e-3)
    graded = Pattern(
        pattern.flat_points * (pattern.flat_points / 0.02) ** 2,
        pattern.flat_triangles,
        pattern.panel,
        pattern.sewn,
        pattern.points,
        pattern.panel_names,
    )
    even = rectangle(alone, 0.02, 0.02, 3e-3, mesh="unstructured")
    for source, target in ((graded, even), (even, graded)):
        transfer = make_transfer(source, target)
        assert np.abs(transfer.overlap.sum(axis=1) / target.areas - 1).max() < 1e-9


def test_small_triangles_beyond_a_coarse_border(alone: MPI.Comm) -> None:
    """A fine border bulges over a straight coarse side: there is a nearest triangle too."""

    def raised(edge: float, bulge: float) -> Pattern:
        sheet = rectangle(alone, 0.02, 0.02, edge)
        x, y = sheet.flat_points.T / 0.02
        lift = 0.2 * np.maximum(0, x - 0.5) + bulge * np.maximum(0, np.sin(2 * np.pi * x))
        return one_panel(0.02 * np.stack([x, y * (1 + lift)], axis=1), sheet.flat_triangles)

    coarse, fine = raised(5e-3, 0.0), raised(5e-4, 0.04)
    transfer = make_transfer(coarse, fine)
    assert transfer.at_cells(np.ones(len(coarse.panel))) == pytest.approx(1, rel=1e-12)
    found = transfer.at_vertices(coarse.points)
    # The bulge is 0.8 mm high; a place outside is told by the coordinates that are not negative.
    assert np.linalg.norm(found - fine.points, axis=1).max() < 1e-3
