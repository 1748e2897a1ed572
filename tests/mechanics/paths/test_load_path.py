"""Paths of loads and the gradients of functionals of several of their steps."""

import numpy as np
import pytest
from helpers.scenes import square
from kit.slopes import slope
from mpi4py import MPI

from toros_fem.base.mpi import dot, total
from toros_fem.design.density.field import random_density
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.contact.settings import Contact, Ground, Pads
from toros_fem.mechanics.contact.solids import rigid_cylinder
from toros_fem.mechanics.equilibrium.options import NewtonOptions
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.load_path import LoadPath
from toros_fem.mechanics.skin.dead_loads import Weight
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import clamp, clamp_where
from toros_fem.meshes import Skin, sew


def test_gradient_of_two_steps(
    short_tube: Skin, short_solver: EquilibriumSolver, alone: MPI.Comm
) -> None:
    path = LoadPath(short_solver, [Load(2e3), Load(5e3)])
    density = random_density(short_tube, 2, spread=0.3)
    shape = short_solver.model.positions(short_solver.model.assembled).shape
    weights = [np.cos(np.arange(3.0) + k) * np.ones(shape) * 1e-3 for k in range(2)]
    weights = [w * short_tube.pattern.points[short_tube.owned_vertices] for w in weights]
    base = path.solve(density)
    found = path.gradient(density, base, weights)
    change = 0.1 * np.cos(1.0 * short_tube.owned_cells)
    raised = np.array([[100.0], [-200.0]])
    along = dot(alone, found.density, change) + float((found.pressures * raised).sum())

    def value(step: float) -> float:
        there = path.solve(density + step * change, np.array([[2e3], [5e3]]) + step * raised, base)
        return total(
            alone, sum((w * e.positions).sum() for w, e in zip(weights, there, strict=True))
        )

    rise = slope(lambda h: value(1e-2 * h)) / 1e-2
    assert along == pytest.approx(rise, rel=1e-6)


def test_a_step_that_does_not_matter_has_no_gradient(
    short_tube: Skin, short_solver: EquilibriumSolver
) -> None:
    path = LoadPath(short_solver, [Load(2e3), Load(4e3)])
    density = np.full(len(short_tube.owned_cells), 0.2)
    base = path.solve(density)
    along = np.ones_like(base[0].positions)
    found = path.gradient(density, base, [along, None])
    assert found.pressures[0, 0] != 0
    assert found.pressures[1, 0] == 0


def dragged(comm: MPI.Comm) -> LoadPath:
    """A sheet over a cylinder and the ground, dragged by one edge, and partly back."""
    pytest.importorskip("ipctk")
    points = square(n=5).points.copy()
    points[:, 2] = 3e-4
    pattern = square(points, n=5)
    cylinder = rigid_cylinder(
        "roll", 4e-3, 0.03, (0.0, 1.0, 0.0), (0.012, 0.01, -4.6e-3), edge_length=2e-3
    )
    touched = Contact(
        Ground((0.0, 0.0, -1e-4), (0.3, 0.1, 1.0)),
        [cylinder],
        self_contact=False,
        friction=0.5,
        thickness=5e-4,
        distance=1e-4,
        slip=1e-4,
    )
    edge = clamp_where(pattern, lambda x: x[:, 0] < 1e-9)
    exact = NewtonOptions(tolerance=1e-12)
    solver = EquilibriumSolver(sew(comm, pattern), Composite(), edge, exact, contact=touched)
    down = np.tile([0.0, 0.01, -0.05], (len(points), 1))
    steps = []
    for ahead, turn in ((0.0, 0.0), (2e-5, 5e-3), (3e-4, 5e-3), (2.5e-4, 2e-2)):
        moved = np.tile([-ahead, 0.3 * ahead, 0.0], (len(points), 1))
        pose = np.array([[0.0, 0.0, 0.0, 0.0, turn, 0.0]])
        steps.append(Load(0.0, force=down * (1 + 1e3 * ahead), displacement=moved, poses=pose))
    return LoadPath(solver, steps)


@pytest.mark.slow
@pytest.mark.parametrize("last", [True, False])
def test_gradient_through_friction(alone: MPI.Comm, last: bool) -> None:
    """Sticking and sliding vertices on ground and body; a functional of the last or all steps."""
    path = dragged(alone)
    skin, model = path.solver.skin, path.solver.model
    density = np.full(len(skin.owned_cells), 0.3)
    base = path.solve(density)
    parts = []
    for at in base[1:]:
        anchors = model.contact.friction.carried(at.sliding, np.array(at.poses))
        away = np.linalg.norm(skin.gather_vertices(at.positions) - anchors, axis=2)
        parts.append([away > 0.999e-4, (away > 1e-8) & (away < 0.999e-4)])
    slides, sticks = np.array(parts).sum(axis=(0, 3)).reshape(2, 2)
    assert slides.min() > 0, "on the ground and on the body"
    assert sticks.min() > 0
    weights = [
        np.cos(np.arange(3.0) + 5 * skin.owned_vertices[:, None] + k) * 1e-3 for k in range(4)
    ]
    slopes = [None, None, None, weights[3]] if last else weights
    found = path.gradient(density, base, slopes)
    change = 0.3 * np.cos(3.0 * skin.owned_cells)
    along = dot(alone, found.density, change)

    def value(step: float) -> float:
        there = path.solve(density + step * change, near=base)
        return total(
            alone,
            sum(
                (w * e.positions).sum() for w, e in zip(slopes, there, strict=True) if w is not None
            ),
        )

    rise = slope(lambda h: value(2e-4 * h)) / 2e-4
    assert along == pytest.approx(rise, rel=1e-6)


@pytest.mark.slow
def test_gradient_by_pressures_and_densities_on_pads(short_tube: Skin, alone: MPI.Comm) -> None:
    """A heavy tube on pads is inflated and emptied again: all that a walker has."""
    pytest.importorskip("ipctk")
    pattern = short_tube.pattern
    touched = Contact(
        Ground((-0.0112, 0.0, 0.0), (1.0, 0.0, 0.0)),
        friction=0.4,
        pads=Pads(pattern.points[:, 2] > 0.03, (0.0, 0.0, 1.0), 0.2, 0.7),
    )
    solver = EquilibriumSolver(
        short_tube,
        Composite(),
        clamp(pattern, ["base"]),
        NewtonOptions(tolerance=1e-12),
        weight=Weight(0.3, 0.6, (-9.81, 0.0, 0.0)),
        contact=touched,
    )
    pressures, raised = np.array([[4e3], [2e3]]), np.array([[-150.0], [50.0]])
    path = LoadPath(solver, [Load(float(p)) for p in pressures[:, 0]])
    density = 0.02 + 0.01 * np.cos(3.0 * short_tube.owned_cells)
    change = 0.01 * np.cos(2.0 * short_tube.owned_cells)
    weights = [
        1e-3 * np.cos(np.arange(3.0) + k + short_tube.owned_vertices[:, None]) for k in range(2)
    ]
    base = path.solve(density)
    found = path.gradient(density, base, weights)
    along = dot(alone, found.density, change) + float((found.pressures * raised).sum())

    def value(step: float) -> float:
        there = path.solve(density + step * change, pressures + step * raised, base)
        terms = ((w * e.positions).sum() for w, e in zip(weights, there, strict=True))
        return total(alone, sum(terms))

    rise = slope(lambda h: value(1e-3 * h)) / 1e-3
    assert along == pytest.approx(rise, rel=1e-6)
