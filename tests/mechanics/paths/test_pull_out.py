"""A body is pulled out of a gripping skin: balance of forces, the limit of friction, reading."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.designs import case_of
from mpi4py import MPI

from toros_fem import errors
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.pull_out import PullPoint, largest_force, pull_out, slip_under
from toros_fem.mechanics.readings.holding import HoldingObjective
from toros_fem.meshes import sew
from toros_fem.products import gripper
from toros_fem.products.gripper_load import ALONG

pytest.importorskip("ipctk")


@pytest.mark.slow
def test_forces_of_a_pull_are_balanced(alone: MPI.Comm) -> None:
    config = gripper.GripperScene.of(edge_length=3e-3, stem_length=0.045)
    case = case_of(alone, config)
    skin, contact = sew(alone, case.pattern), config.held_contact
    inner = case.pattern.panel == case.pattern.panel_index("top")
    density = inner[skin.owned_cells].astype(np.float64)
    closing = EquilibriumSolver(skin, config.material.composite, case.supports, contact=contact)
    closed = closing.solve(density, 15e3)
    solver = EquilibriumSolver(
        skin, config.material.composite, case.supports, contact=replace(contact, friction=0.3)
    )
    points = []
    for point in pull_out(solver, density, 15e3, [0.0, 5e-5, 1e-3], ALONG, closed):
        points.append(point)
        supports = solver.reactions(point.result)[:, 0].sum()
        assert point.force == pytest.approx(-supports, rel=1e-5)
    first, sticking, sliding = points
    holding = HoldingObjective(
        skin,
        contact,
        contact.sizes(config.material.composite),
        case.supports.fixed,
        [-1, 0, 0],
        1.0,
    )
    assert holding.force(closed.positions) == pytest.approx(first.force, rel=1e-6)
    assert first.force < sticking.force < sliding.force
    # Friction of all vertices together is at most μ N.
    normal = np.linalg.norm(sliding.normals, axis=1).sum()
    upwards = sliding.normals[:, 0].sum()
    assert 0 < sliding.force - upwards <= 0.3 * normal
    for wrong, match in (([1e-4, 2e-4], "ascending from 0"), ([0.0, 0.0], "ascending from 0")):
        with pytest.raises(errors.ParameterError, match=match):
            pull_out(solver, density, 15e3, wrong, ALONG, closed)
    with pytest.raises(errors.ParameterError, match="no body number 1"):
        pull_out(solver, density, 15e3, [0.0], ALONG, closed, body=1)


def test_reading_a_pull() -> None:
    nothing = np.zeros((0, 3))
    points = [
        PullPoint(depth, force, nothing, nothing, None)  # type: ignore[arg-type]
        for depth, force in ((0.0, 0.2), (1e-3, 1.0), (2e-3, 0.8), (4e-3, 1.6))
    ]
    assert slip_under(points, 0.1) == 0.0
    assert slip_under(points, 0.6) == pytest.approx(0.5e-3)
    assert slip_under(points, 1.2) == pytest.approx(3e-3)
    assert slip_under(points, 2.0) is None
    assert largest_force(points, 2e-3) == 1.0
    assert largest_force(points, 3.5e-3) == pytest.approx(1.4)
    assert largest_force(points, 1.0) == 1.6
