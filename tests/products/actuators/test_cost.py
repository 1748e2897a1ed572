"""Cost of a design before it runs."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.designs import case_of
from mpi4py import MPI

from toros_fem.base.errors import MeshSizeError
from toros_fem.meshes import triangle_limit
from toros_fem.products import tubes
from toros_fem.products.actuators.cost import (
    OF_RANK,
    actuator_cost,
    expected_time,
    probe_level,
    require_affordable_meshes,
    sized,
)

SMALL = tubes.BendScene.of(length=0.06, edge_length=1e-3, filter_radius=2e-3)


def test_the_probe_has_a_coarse_mesh() -> None:
    """Two edges of the coarsest useful mesh; lengths of filter and widths grow alike."""
    coarse = probe_level(SMALL)
    assert coarse.edge_length == pytest.approx(SMALL.coarsest_edge / 2)
    factor = coarse.edge_length / SMALL.skin.edge_length
    radius = coarse.regularisation.filter_radius
    assert radius == pytest.approx(factor * SMALL.design.filter_radius)
    assert probe_level(SMALL.updated(edge_length=3e-3)).edge_length == 3e-3


def test_triangles_of_the_finest_mesh(alone: MPI.Comm) -> None:
    found = actuator_cost(alone, SMALL)
    pattern = case_of(alone, SMALL).pattern
    assert found.triangles == pytest.approx(len(pattern.panel), rel=0.07)
    unknowns = 3 * len(pattern.points) + len(pattern.edges.ends)
    assert found.unknowns == pytest.approx(unknowns, rel=0.1)
    assert found.largest == found.triangles
    assert found.memory < replace(found, ranks=2).memory


def test_a_finer_mesh_costs(alone: MPI.Comm) -> None:
    plain = actuator_cost(alone, SMALL)
    checked = SMALL.updated(check_refinement=2.0)
    found = actuator_cost(alone, checked)
    assert found.largest == 4 * found.triangles
    beside = replace(found, beside=0)  # the larger one alone
    assert found.memory == pytest.approx(beside.memory + plain.memory - OF_RANK)
    without = actuator_cost(alone, checked.updated(estimate_error=False))
    assert without.largest == without.triangles


def test_lines_keep_another_print_beside_the_check(alone: MPI.Comm) -> None:
    once, twice = (
        actuator_cost(
            alone, tubes.ContractScene().updated(check_refinement=1.5, corrections=rounds)
        )
        for rounds in (0, 4)
    )
    assert (once.beside, twice.beside) == (1, 2), "the finer mesh may judge two prints"
    own = tubes.ContractScene().updated(check_refinement=1.5)
    assert actuator_cost(alone, own, from_print=True).beside == 1


def test_time_grows_with_seeds_and_the_mesh(alone: MPI.Comm) -> None:
    """By real steps, whose time differs from run to run."""
    cost = actuator_cost(alone, SMALL)
    low, high = expected_time(alone, SMALL, cost)
    assert 0 < low < high
    more = SMALL.updated(seeds=100)
    assert expected_time(alone, more, cost)[1] > 10 * high
    finer = replace(cost, triangles=100 * cost.triangles)
    assert expected_time(alone, SMALL, finer)[0] > 10 * low
    assert len(set(alone.allgather((low, high)))) == 1


def test_meshes_are_checked_by_the_area_of_the_coarsest(alone: MPI.Comm) -> None:
    with triangle_limit(3000), pytest.raises(MeshSizeError, match="edge_length = 0.001 m gives ab"):
        require_affordable_meshes(alone, SMALL)
    require_affordable_meshes(alone, SMALL)


def test_the_mesh_of_the_check_is_one_of_a_design(alone: MPI.Comm) -> None:
    checked = SMALL.updated(check_refinement=4)
    with triangle_limit(20000):
        require_affordable_meshes(alone, SMALL)
        require_affordable_meshes(alone, checked.updated(estimate_error=False))
        with pytest.raises(MeshSizeError, match="Take a smaller check_refinement"):
            require_affordable_meshes(alone, checked)


def test_a_first_mesh_that_is_too_large_itself(alone: MPI.Comm) -> None:
    """Its area is known all the same."""
    with triangle_limit(200):
        with pytest.raises(MeshSizeError) as caught:
            sized(alone, SMALL, SMALL.finest_level)
        area = caught.value.area
    assert area == pytest.approx(np.pi * 0.02 * 0.07 / 2)
    other = SMALL.updated(edge_length=2e-3)
    found, _ = sized(alone, other, other.finest_level)
    assert found == pytest.approx(area, rel=0.02)
