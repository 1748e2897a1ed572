"""Refinement, and the error that it estimates."""

import numpy as np
import pytest
from helpers.scenes import square
from helpers.standing import solver_on_base
from mpi4py import MPI

from benchmarks.accuracy.bending import spine
from toros_fem.materials.sheet import Composite, Material
from toros_fem.measures.metrics import bend_angle
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium, EquilibriumError
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.readings.error_estimate import EDGE, edge_of, estimate_error, half_width
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Supports, build_in, symmetry_plane
from toros_fem.meshes import Pattern, cylinder, sew


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


def test_coarser_meshes_tell_the_error() -> None:
    """Each as if the error grew with the edge length; the largest counts."""
    changes = {1.5: 0.2, 2.25: 0.75}
    extents = (0.05, 0.1, 0.05)
    least = half_width({1.5: 0.0}, "angle_deg", extents, EDGE)
    assert half_width(changes, "angle_deg", extents, EDGE) == pytest.approx(0.65 * 0.6 + least)
    both = half_width({1.5: 0.4, 2.25: 0.4}, "angle_deg", extents, EDGE)
    assert both == pytest.approx(0.65 * 0.8 + least)
    assert least == 0.5


def test_what_no_mesh_tells_is_a_part_of_the_size() -> None:
    """Of lengths, in their unit; of a force nothing is known."""
    nothing, extents = {1.5: 0.0}, (0.1, 0.02, 0.02)
    assert half_width(nothing, "gap_mm", extents, EDGE) == pytest.approx(0.6)
    assert half_width(nothing, "length_m", extents, EDGE) == pytest.approx(0.6e-3)
    assert half_width(nothing, "length_ratio", extents, EDGE) == pytest.approx(0.45e-2)
    assert half_width(nothing, "force_n", extents, EDGE) == 0.0
    # Turns add up along a slender skin.
    slender = half_width(nothing, "angle_deg", extents, EDGE)
    assert slender == pytest.approx(0.5 * (5 / 2.1) ** 0.5)
    assert half_width(nothing, "angle_deg", (0.1, 0.1, 0.0), EDGE) == 0.5


def test_finer_meshes_leave_less_unseen() -> None:
    """It falls with the edge length from that of the study's meshes on."""
    of = [half_width({1.5: 0.0}, "angle_deg", (0.1, 0.1, 0.0), k * EDGE) for k in (2, 1, 0.5)]
    assert of == pytest.approx([0.5, 0.5, 0.25])
    assert edge_of(np.full(3, np.sqrt(3) / 4 * 9.0)) == pytest.approx(3.0)
