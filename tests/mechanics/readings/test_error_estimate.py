"""Refinement, and the error that it estimates."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.models import dense_tangent
from helpers.scenes import square
from helpers.standing import solver_on_base
from mpi4py import MPI
from shapely import box, intersection, unary_union

from benchmarks.accuracy.bending import spine
from toros_fem.making.print.printability import printed_fractions
from toros_fem.materials.sheet import Composite, Material, Membrane
from toros_fem.measures.metrics import bend_angle
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium, EquilibriumError
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.readings.error_estimate import LimitShape, estimate_error, half_width
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Supports, build_in, symmetry_plane
from toros_fem.meshes import Pattern, cylinder, sew
from toros_fem.meshes.following import snapped


def angle(pattern: Pattern, positions: np.ndarray) -> float:
    return float(np.degrees(bend_angle(pattern, positions)))


def test_supports_and_forces_of_a_refined_sheet(alone: MPI.Comm) -> None:
    """A built-in cantilever, bent by a load that each mesh spreads for itself."""
    pattern = square(n=6)
    size = pattern.points[:, 0].max()
    supports = build_in(pattern, pattern.points[:, 0] < 1e-9)
    sheet = Composite(reinforcement=Material(26e6, 0.3, 0.5e-3))
    solver = EquilibriumSolver(sew(alone, pattern), sheet, supports)

    def weight(of: Pattern) -> np.ndarray:
        return np.outer(of.vertex_areas, [0.0, 0.0, 1.0])

    def tip(of: Pattern, positions: np.ndarray) -> float:
        return float(positions[of.points[:, 0] > size * (1 - 1e-9), 2].mean())

    density = np.ones(len(solver.skin.owned_cells))
    result = solver.solve(density, Load(0.0, force=weight(pattern)))
    (found,) = estimate_error(solver, result, [tip], weight)
    D = 26e6 * 0.5e-3**3 / 12 / (1 - 0.3**2)
    exact = size**4 / (8 * D)  # of a wide strip; the narrow one is up to 1/(1 - nu^2) softer
    assert exact < found.refined < exact / (1 - 0.3**2)
    assert abs(found.value - exact) < found.error < 0.5 * exact
    assert str(found).startswith(f"{found.value:.6g}")


def test_half_a_tube_is_refined_with_its_plane(alone: MPI.Comm) -> None:
    """A square cut at a symmetry plane, its other borders held: the refined one is held alike."""
    pattern = square(n=4)
    edge = pattern.points[:, 1] > 0.02 * (1 - 1e-9)
    supports = symmetry_plane(pattern, 0) | build_in(pattern, edge)
    solver = EquilibriumSolver(sew(alone, pattern), Composite(), supports)
    density = np.ones(len(solver.skin.owned_cells))

    def weight(of: Pattern) -> np.ndarray:
        return np.asarray(of.vertex_areas[:, None] * [0.0, 0.0, 1.0])

    def corner(of: Pattern, positions: np.ndarray) -> float:
        return float(positions[np.argmin(of.points[:, 0] + of.points[:, 1]), 2])

    def fixed(of: Pattern) -> Supports:
        far = of.points[:, 1] > 0.02 * (1 - 1e-9)
        return symmetry_plane(of, 0) | build_in(of, far)

    result = solver.solve(density, Load(0.0, force=weight(pattern)))
    (by_rule,) = estimate_error(solver, result, [corner], weight)
    (by_hand,) = estimate_error(solver, result, [corner], weight, fixed)
    assert by_rule.refined == pytest.approx(by_hand.refined, rel=1e-8)
    assert by_rule.refined != by_rule.value


def test_a_refined_mesh_that_is_not_reached_at_once(
    alone: MPI.Comm, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The load is raised anew, with the same result; unless the estimate is to be direct."""
    pattern = cylinder(alone, 0.05, 0.02, 6e-3)
    solver = solver_on_base(sew(alone, pattern))
    density = spine(pattern)[solver.skin.owned_cells]
    result = solver.solve(density, 1e3)
    (at_once,) = estimate_error(solver, result, [angle], direct=True)

    def fails(_: EquilibriumSolver, trial: Equilibrium) -> Equilibrium:
        raise EquilibriumError("made to fail", trial)

    monkeypatch.setattr(EquilibriumSolver, "finish", fails)
    with pytest.raises(EquilibriumError, match="made to fail"):
        estimate_error(solver, result, [angle], direct=True)
    (anew,) = estimate_error(solver, result, [angle])
    assert anew.refined == pytest.approx(at_once.refined, rel=1e-5)
    assert anew.error == pytest.approx(3 * abs(anew.refined - anew.value), rel=1e-12)


def test_an_interval_counts_what_each_mesh_tells(alone: MPI.Comm) -> None:
    """The correction and the change from rest, or the change from a coarser mesh."""
    pattern = square(n=3)
    at_rest = float(pattern.points[:, 0].mean())
    # The left third is printed: it is as wide as two edges of its size.
    density = (pattern.centroids[:, 0] < 0.02 / 3).astype(float)
    shape = LimitShape(pattern, 1.10 * pattern.points, 1.12 * pattern.points, density)
    edge = np.sqrt(4 / np.sqrt(3) * 0.02**2 / len(density))
    assert shape.edges_to_width == pytest.approx(edge / (2 * 0.02 / 3))

    def middle(_: Pattern, positions: np.ndarray) -> float:
        return float(positions[:, 0].mean())

    own = 0.02 + 0.03 * shape.edges_to_width * 0.12
    rest = shape.half_width(middle)

    def interval(others: dict[float, float]) -> float:
        return half_width(rest, {r: abs(1.12 - other) * at_rest for r, other in others.items()})

    told = interval({1.5: 1.09})
    assert told == pytest.approx(1.7 * 0.03 / (1.5 - 1) * at_rest, rel=1e-9)
    assert interval({2.0: 1.09}) < told
    assert interval({2.0: 1.115}) == pytest.approx(1.7 * own * at_rest, rel=1e-9)
    gaps = replace(shape, density=1 - density)
    assert gaps.edges_to_width == pytest.approx(shape.edges_to_width)
    for plain in (np.zeros_like(density), None):
        found = replace(shape, density=plain).edges_to_width
        assert found == pytest.approx(edge / pattern.size)


@pytest.mark.parametrize(("order", "counts"), [(0.5, 1.0), (1.2, 1.2), (2.0, 1.5)])
@pytest.mark.parametrize("ratios", [(1.5, 2.25), (2.0, 3.0, 4.5)])
def test_coarser_meshes_tell_the_order_of_the_error(
    order: float, counts: float, ratios: tuple[float, ...]
) -> None:
    """Within bounds: the interval of an error of this order is its error, with a factor."""
    changes = {r: 0.3 * (r**order - 1) for r in ratios}
    near = ratios[0]
    error = 0.3 * (near**order - 1) / (near**counts - 1)
    assert half_width(0.0, changes) == pytest.approx(1.7 * error, rel=1e-9)
    assert half_width(0.0, {**changes, near: 0.0}) == 0.0


@pytest.mark.parametrize(("pressure", "at_once"), [(4e3, False), (6e3, True)])
def test_a_soft_skin_moves_less_than_its_first_step(
    alone: MPI.Comm, pressure: float, at_once: bool
) -> None:
    """Where Newton's first step without smoothing raises the energy, all steps count."""
    pattern = cylinder(alone, 0.1, 0.02, 5e-3, mesh="unstructured")
    regions = [pattern.outline(k) for k in range(len(pattern.panel_names))]
    wall = pattern.panel_index("wall")
    left, low, right, high = regions[wall].bounds
    middle, reach, half = (left + right) / 2, 0.35 * (right - left), 0.6e-3
    lines = [box(middle - half, low, middle + half, high)]
    for k in range(6):
        at = low + (high - low) * (k + 0.5) / 6
        lines.append(box(middle - reach, at - half, middle + reach, at + half))
    regions[wall] = intersection(regions[wall], unary_union(lines))
    pattern = snapped(alone, pattern, regions)
    soft = Material(26e6, 0.3, 0.5e-3)
    composite = Composite(reinforcement=soft, membrane=Membrane(strain="smoothed"))
    solver = solver_on_base(sew(alone, pattern), composite)
    result = solver.solve(printed_fractions(pattern, regions)[solver.skin.owned_cells], pressure)
    motion, model, x = solver.unsmoothed_motion(result), solver.model, result.state
    with model.sheet.unsmoothed(1.0):
        residual = model.residual(x)
        left_over = model.residual(x + motion)
        fall = model.energy(x) - model.energy(x + motion)
        work = float(-residual @ motion) / 2
        ratio = np.linalg.norm(left_over) / np.linalg.norm(residual)
        assert fall > 0.5 * work > 0
        if at_once:
            assert dense_tangent(model, x) @ motion == pytest.approx(-residual, abs=1e-9)
            assert ratio > 1e-2
        else:
            step = np.linalg.solve(dense_tangent(model, x), -residual)
            assert model.energy(x + step) > model.energy(x)
            assert ratio < 1e-3
