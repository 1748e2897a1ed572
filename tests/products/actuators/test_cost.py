"""Cost of a design before it runs."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.designs import case_of
from mpi4py import MPI

from toros_fem.base.errors import MeshSizeError
from toros_fem.meshes import triangle_limit
from toros_fem.products.actuators.cost import (
    OF_RANK,
    Cost,
    Part,
    Probe,
    _density_parts,
    actuator_cost,
    probe,
    probe_level,
    require_affordable_meshes,
    sized,
)
from toros_fem.products.actuators.other_mesh import COARSER_MESHES
from toros_fem.products.tubes import bend, contract
from toros_fem.products.walker.walker import WalkerScene

SMALL = bend.BendScene.of(length=0.06, edge_length=1e-3, filter_radius=2e-3)


def test_the_probe_has_a_coarse_mesh() -> None:
    """Two edges of the coarsest useful mesh; lengths of filter and widths grow alike."""
    coarse = probe_level(SMALL)
    assert coarse.edge_length == pytest.approx(SMALL.coarsest_edge / 2)
    factor = coarse.edge_length / SMALL.skin.edge_length
    radius = coarse.regularisation.filter_radius
    assert radius == pytest.approx(factor * SMALL.design.filter_radius)
    assert probe_level(SMALL.updated(edge_length=3e-3)).edge_length == 3e-3


def test_triangles_of_the_finest_mesh(alone: MPI.Comm) -> None:
    found = actuator_cost(alone, SMALL, probing=False)
    pattern = case_of(alone, SMALL).pattern
    assert found.triangles == pytest.approx(len(pattern.panel), rel=0.07)
    unknowns = 3 * len(pattern.points) + len(pattern.edges.ends)
    assert found.unknowns == pytest.approx(unknowns, rel=0.1)
    assert found.largest == found.triangles
    without = actuator_cost(alone, SMALL.updated(estimate_error=False), probing=False)
    assert len(without.parts) == len(found.parts) - COARSER_MESHES
    assert found.memory < replace(found, ranks=2).memory


def test_a_finer_mesh_costs(alone: MPI.Comm) -> None:
    plain = actuator_cost(alone, SMALL, probing=False)
    checked = SMALL.updated(check_refinement=2.0)
    found = actuator_cost(alone, checked, probing=False)
    assert found.largest == found.parts[-2].triangles == 4 * found.triangles
    assert len(found.parts) == len(plain.parts) + 1
    beside = replace(found, beside=0)  # the larger one alone
    assert found.memory == pytest.approx(beside.memory + plain.memory - OF_RANK)
    without = actuator_cost(alone, checked.updated(estimate_error=False), probing=False)
    assert without.largest == without.triangles


def test_parts_of_a_design(alone: MPI.Comm) -> None:
    parts = {part.name: part for part in actuator_cost(alone, SMALL, probing=False).parts}
    first, second = parts["design, mesh 1 of 2"], parts["design, mesh 2 of 2"]
    assert second.triangles == pytest.approx(4 * first.triangles, rel=0.01)
    assert first.newton_steps[0] > SMALL.design.iterations
    more = SMALL.updated(iterations=2 * SMALL.design.iterations)
    longer = actuator_cost(alone, more, probing=False)
    assert longer.parts[0].newton_steps[0] > first.newton_steps[0]
    lines = actuator_cost(alone, contract.ContractScene(), probing=False)
    assert [part.name for part in lines.parts][:2] == ["relaxed design", "laying of lines"]
    once, twice = (
        actuator_cost(
            alone,
            contract.ContractScene().updated(check_refinement=1.5, corrections=rounds),
            probing=False,
        )
        for rounds in (0, 4)
    )
    assert (once.beside, twice.beside) == (1, 2), "the finer mesh may judge two prints"
    (few, many) = (
        part.newton_steps for cost in (once, twice) for part in cost.parts if "finer" in part.name
    )
    assert many == (few[0], 2 * few[1])
    again = actuator_cost(alone, contract.ContractScene(), probing=False, from_print=True)
    (own, *_) = (part for part in again.parts if part.name.startswith("design"))
    assert own.newton_steps[0] > 0
    assert not any("lines" in part.name or "relaxed" in part.name for part in again.parts)


def test_a_gait_and_its_repeat_count(alone: MPI.Comm) -> None:
    robot = WalkerScene().coarse()
    names = ["trial", "trial on another mesh"]
    cost = actuator_cost(alone, robot, probing=False)
    parts = {part.name: part for part in cost.parts}
    own, other = (parts[name] for name in names)
    assert own.triangles == pytest.approx(2 * cost.triangles, rel=1e-3)
    assert other.triangles < own.triangles / 2
    assert own.newton_steps == other.newton_steps
    assert own.newton_steps[0] >= 17  # the cycle has so many equilibria
    assert own.dearer > 1
    once = actuator_cost(alone, robot.updated(estimate_error=False), probing=False)
    assert [part.name for part in once.parts if part.name in names] == names[:1]
    still = actuator_cost(alone, robot.updated(gait_steps=None), probing=False)
    assert not any(part.name in names for part in still.parts)


def test_time_grows_with_the_mesh_and_the_steps() -> None:
    def seconds(triangles: int, steps: int) -> tuple[float, float]:
        part = Part("design", triangles, (steps, 2 * steps))
        return Cost(triangles, triangles, 0, 1, (part,), Probe(1000, 10, 1.0)).seconds

    contact = Part("trial", 1000, (50, 100), dearer=3.0)
    dear = Cost(1000, 1000, 0, 1, (contact,), Probe(1000, 10, 1.0)).seconds
    none = seconds(1000, 0)
    assert np.subtract(dear, none) == pytest.approx([15.0, 30.0])
    low, high = np.subtract(seconds(1000, 50), none)
    assert low == pytest.approx(5.0)
    assert high == pytest.approx(10.0)
    finer = np.subtract(seconds(4000, 50), none)
    # Between linear growth and that of the factorisation.
    assert 2 * low < finer[0] < 4**1.43 * low


def test_a_probe_makes_real_steps(alone: MPI.Comm) -> None:
    level = probe_level(SMALL)
    tried = probe(SMALL.problem(alone, SMALL.case(alone, level), level), seed=1)
    assert tried.newton_steps > 5
    assert tried.per_step == tried.seconds / tried.newton_steps > 0
    assert alone.allgather(tried) == [tried] * alone.size


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


def test_starts_are_shared_out_over_the_ranks() -> None:
    steps = [
        _density_parts(SMALL.updated(starts=starts), 1000, SMALL.options, ranks)[0].newton_steps
        for starts, ranks in ((1, 1), (4, 1), (4, 2), (3, 2))
    ]
    one, four, shared, uneven = np.array(steps)[:, 0]
    assert [four, shared, uneven] == [4 * one, 2 * one, 2 * one]
