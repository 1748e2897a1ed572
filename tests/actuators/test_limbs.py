"""Limbs, grasps and gaits; a part of a symmetric skin is designed and printed as the whole."""

from typing import Any

import numpy as np
import pytest
from helpers.symmetry import rests
from mpi4py import MPI
from scipy.spatial.transform import Rotation

from toros_fem import errors
from toros_fem.actuators.gait import Gait, placed
from toros_fem.actuators.gripper import _surface, _turned
from toros_fem.actuators.limb import (
    limb_cross_sections,
    limb_vertices,
    rest_on_body,
    tip_angle_metric,
    tips,
)
from toros_fem.analysis.pressure_path import PressurePathPoint, trace_pressure_path
from toros_fem.density.field import random_density
from toros_fem.density.filters import make_filter
from toros_fem.design.loop import optimize
from toros_fem.design.options import DesignOptions, Stage
from toros_fem.design.shape_problem import ShapeProblem
from toros_fem.equilibrium.solver import EquilibriumSolver
from toros_fem.fabrication.as_printed import as_printed
from toros_fem.fabrication.printability import PrintLimits
from toros_fem.materials import Bending, Composite
from toros_fem.mechanics.supports import Supports
from toros_fem.meshes import WALKER, Pattern, Skin, mirrored, plane_centroids, sew, stand, walker
from toros_fem.objectives.gap import Body
from toros_fem.objectives.shape import ShapeObjective

ALONG = np.append(WALKER.directions[0], 0.0)
DOWN = (0.0, 0.0, -1.0)


@pytest.fixture(scope="module")
def quarter(comm: MPI.Comm) -> Pattern:
    return walker(comm, 7e-3, planes=(0, 1))


@pytest.mark.parametrize("degrees", [-40.0, 0.0, 90.0, 200.0])
def test_measured_angle_of_a_leg(comm: MPI.Comm, quarter: Pattern, degrees: float) -> None:
    figure = tip_angle_metric(degrees, ALONG, DOWN, WALKER.root)
    bent = stand(np.radians(degrees), 0.03, directions=[ALONG[:2]], root=WALKER.root)
    # The outer third goes on straight.
    assert figure.measure(quarter, bent(quarter.points)) == pytest.approx(degrees, abs=0.5)


def test_sections_of_a_leg(quarter: Pattern) -> None:
    found = limb_cross_sections(quarter, ALONG, WALKER.root, 5, 0.1, 0.03)
    assert set(np.unique(found.labels)) == {-1, 0, 1, 2, 3, 4}
    inside = quarter.points @ ALONG > WALKER.root
    assert np.array_equal(found.labels >= 0, inside)
    assert found.position_weights.sum() == pytest.approx(3 * 0.1)
    with pytest.raises(errors.ParameterError, match="no vertex lies further"):
        limb_vertices(quarter, ALONG, 1.0)


def design(
    comm: MPI.Comm, pattern: Pattern, planes: tuple[int, ...], supports: Supports
) -> ShapeProblem:
    """A leg to be turned down, on a part or on the whole."""
    skin = sew(comm, pattern)
    whole = mirrored(pattern, planes) if planes else None
    target = stand(1.0, 0.03, directions=WALKER.directions, root=WALKER.root)
    composite = Composite(bending=Bending(seams="hinged"))
    return ShapeProblem(
        EquilibriumSolver(skin, composite, supports),
        ShapeObjective(skin, target(pattern.points)),
        make_filter("cone", skin, 0.011, whole=whole),
        4e3,
        whole=whole,
    )


def test_a_part_is_designed_as_the_whole(comm: MPI.Comm, quarter: Pattern) -> None:
    """Objective and gradient, with the whole held at one vertex of each symmetry plane."""
    part = design(comm, quarter, (0, 1), rests(quarter, (0, 1)))
    assert part.whole is not None
    pattern = part.whole.pattern
    whole = design(comm, pattern, (), rests(pattern, ()))
    drawn = part.solver.skin.gather_cells(random_density(part.solver.skin, 5, 0.5, 0.5))
    drawn = np.where(quarter.panel == 1, 0.5 + 0.5 * drawn, 0.3 * drawn)

    def evaluated(problem: ShapeProblem, density: np.ndarray) -> tuple[float, np.ndarray]:
        skin = problem.solver.skin
        found = problem.evaluate(density[skin.owned_cells])
        assert found.gradient is not None
        size = skin.pattern.size**2
        return found.shape * size, skin.gather_cells(found.gradient) * size

    value, gradient = evaluated(part, drawn)
    value_whole, gradient_whole = evaluated(whole, part.whole.at_cells(drawn))
    assert value_whole == pytest.approx(value, rel=1e-6)
    scale = np.abs(gradient).max()
    assert 4 * gradient_whole == pytest.approx(part.whole.at_cells(gradient), abs=1e-5 * scale)


def test_a_part_is_printed_whole(comm: MPI.Comm, quarter: Pattern) -> None:
    supports = rest_on_body(quarter, WALKER.body_radius, (0, 1))
    problem = design(comm, quarter, (0, 1), supports)
    skin = problem.solver.skin
    result = optimize(problem, DesignOptions((Stage(2),)), start=random_density(skin, 1))
    made = as_printed(problem, result, PrintLimits())
    assert problem.whole is not None
    assert made.pattern is problem.whole.pattern
    for region in made.regions:
        for flip in ([-1, 1], [1, -1]):
            there = np.array(region.bounds).reshape(2, 2)
            assert np.sort(there * flip, axis=0) == pytest.approx(there, abs=1e-9)
    cells = made.cells[: len(quarter.panel)]
    assert np.array_equal(made.cells, problem.whole.at_cells(cells.astype(float)) > 0)
    assert made.evaluation is not None
    assert skin.gather_cells(made.evaluation.projected) == pytest.approx(cells.astype(float))


def test_a_path_is_followed(tube: Skin, tube_solver: EquilibriumSolver) -> None:
    density = np.full(len(tube.owned_cells), 0.3)
    points = list(trace_pressure_path(tube_solver, density, [500.0, 1e3, 2e3]))
    alone = tube_solver.solve(density, 2e3)
    assert points[-1].result.volume == pytest.approx(alone.volume, rel=1e-8)
    assert [point.result.pressure for point in points] == [500.0, 1e3, 2e3]
    begun = list(trace_pressure_path(tube_solver, density, [2e3], start=alone.positions))
    assert begun[0].result.steps <= 1


def test_feet_that_grip_stay(comm: MPI.Comm) -> None:
    """A robot that only swings its legs gets ahead by what the gripping ones swing back."""
    pattern = walker(comm, 8e-3)
    gait = Gait(("front", "rear"), np.array([[1.0, 0], [1, 1], [0, 1]]), 1, (0, 1, 1, 0))
    swing = np.array([0.0, -3e-3, -3e-3, 0.0])  # of the front legs: back while they grip
    place = plane_centroids(pattern)
    assert len(place) == len(pattern.panel)
    points = []
    tilt = Rotation.from_rotvec([0.2, -0.1, 0.3]).as_matrix()
    legs = (pattern.points[:, :2] @ WALKER.directions.T > WALKER.root).any(axis=1)
    for back in swing:
        moved = pattern.points.copy()
        moved[legs & (moved[:, 0] > 0), 0] += back
        result: Any = None
        points.append(PressurePathPoint(0.0, moved @ tilt.T + 0.7, {}, result))
    shapes, feet = placed(gait, pattern, points, WALKER.directions, WALKER.root)
    assert feet[0, :, 2] == pytest.approx(0.0, abs=1e-9)
    front = WALKER.directions[:, 0] > 0
    # Phase 1: the front feet do not grip before; then they hold, later the rear ones do.
    step = np.diff(feet[:, :, 0], axis=0)
    assert step[1, front] == pytest.approx(0.0, abs=1e-12)
    assert step[2, ~front] == pytest.approx(0.0, abs=1e-12)
    assert len(shapes) == 4
    assert tips(pattern, shapes[0], WALKER.directions) == pytest.approx(feet[0])
    with pytest.raises(errors.ParameterError, match="phases has shape"):
        Gait(("one",), np.zeros((2, 2)), 1, (0,))
    with pytest.raises(errors.ParameterError, match="no foot grips the ground at step 2"):
        Gait(("front", "rear"), np.array([[1.0, 0], [0, 0], [0, 1]]), 1, (0, 1))


def test_a_step_on_other_feet_loses_no_ground(comm: MPI.Comm) -> None:
    """From front feet to rear feet at once: the body stays above where it got to."""
    pattern = walker(comm, 8e-3)
    gait = Gait(("front", "rear"), np.array([[1.0, 1], [1, 0], [0, 1]]), 1, (0, 1, 1, 0))
    legs = (pattern.points[:, :2] @ WALKER.directions.T > WALKER.root).any(axis=1)
    points = []
    for back in np.array([0.0, -3e-3, -3e-3, -3e-3]):
        moved = pattern.points.copy()
        moved[legs, 0] += back
        result: Any = None
        points.append(PressurePathPoint(0.0, moved, {}, result))
    shapes, feet = placed(gait, pattern, points, WALKER.directions, WALKER.root)
    body = ~legs & (np.hypot(*pattern.points[:, :2].T) < 0.01)
    ahead = [shape[body, 0].mean() for shape in shapes]
    assert np.diff(ahead) == pytest.approx([3e-3, 0.0, 0.0], abs=1e-9)
    assert (feet[-1] - feet[0])[:, 0] == pytest.approx(0.0, abs=1e-9)


def test_fingers_are_shown_from_outside() -> None:
    """Turning a finger into the room must not turn it inside out."""
    ball = Body("sphere", 0.04, (0.03, 0.0, 0.02))
    points, faces = _surface(ball)
    for angle in (0.0, 1.0):
        a, b, c = np.moveaxis(_turned(points, ball, angle)[faces], 1, 0)
        volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
        assert volume == pytest.approx(4 / 3 * np.pi * 0.02**3, rel=0.02)
