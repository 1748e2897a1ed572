"""Nets of lines as exact polygons, by two rules on coarse meshes."""

import numpy as np
import pytest
import shapely
from mpi4py import MPI
from printed_lines import NETS, converge, densities, wall_lines
from shapely import affinity

from toros_fem.meshes import Pattern, mirrored
from toros_fem.products.tubes.tube import TubeConfig, plain_tube


def tube(planes: tuple[int, ...] = (), edge: float = 2.8e-3) -> Pattern:
    return plain_tube(MPI.COMM_SELF, TubeConfig(edge_length=edge), planes)[0]


@pytest.mark.parametrize("name", list(NETS))
def test_lines_go_around_the_tube(name: str) -> None:
    """Turned by half a tube they are the same; they cover what crossed lines do."""
    net, pattern = NETS[name], tube()
    lines = wall_lines(pattern, net)
    corners = pattern.corners[pattern.cells_of("wall")]
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    around = high[0] - low[0]
    left, right = (
        shapely.intersection(lines, shapely.box(x, low[1], x + around / 2, high[1]))
        for x in (low[0], low[0] + around / 2)
    )
    turned = affinity.translate(left, around / 2)
    assert turned.symmetric_difference(right).area < 1e-9 * lines.area
    bare = [
        1 - family.lines * family.width / np.cos(np.radians(family.degrees)) / around
        for family in net.families
    ]
    assert lines.area / (around * high[1]) == pytest.approx(1 - np.prod(bare), rel=0.02)


def test_half_a_net_is_half_of_the_whole() -> None:
    net = NETS["contract-8"]
    half, whole = tube((1,)), tube()
    assert len(mirrored(half, (1,)).pattern.panel) == pytest.approx(len(whole.panel), rel=0.1)
    assert 2 * wall_lines(half, net).area == pytest.approx(wall_lines(whole, net).area, rel=2e-3)


def test_covered_fractions_keep_the_area() -> None:
    pattern = tube((1,), 2e-3)
    lines = wall_lines(pattern, NETS["contract-8"])
    wall = pattern.cells_of("wall")
    covered, printed = (densities(pattern, lines, rule) for rule in ("covered", "centroid"))
    assert pattern.areas[wall] @ covered[wall] == pytest.approx(lines.area, rel=2e-3)
    assert set(np.unique(printed)) == {0.0, 1.0}
    assert np.all(covered[printed == 1] > 0)
    assert np.all(covered[printed == 0] < 1)
    caps = np.setdiff1d(np.arange(len(covered)), wall)
    assert np.all(covered[caps] == 1)


@pytest.mark.slow
def test_rules_on_coarse_meshes() -> None:
    """Fractions make one stiff sheet of lines that are thinner than triangles."""
    found = {}
    for rule in ("centroid", "covered"):
        rows = list(converge("contract-8", rule, "unstructured", (2.8e-3, 1.9e-3)))
        assert [row["warm"] for row in rows] == [False, True]
        assert all(row["newton_steps"] > 0 for row in rows)
        found[rule] = rows[-1]
    assert found["covered"]["printed_over_drawn"] == pytest.approx(1, abs=2e-3)
    assert found["covered"]["shortening_percent"] < 0.5 * found["centroid"]["shortening_percent"]
