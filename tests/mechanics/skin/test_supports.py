"""Supports that move, and supports that hold nothing but rigid motion."""

import numpy as np
import pytest
from helpers.scenes import TABLE_A, box, square, table
from mpi4py import MPI

from toros_fem.base.mpi import norm
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import (
    Supports,
    clamp,
    clamp_where,
    displace,
    pin,
)
from toros_fem.meshes import Skin, cylinder, sew

SIZE = 0.02


def strip(n: int) -> tuple[Skin, Supports, np.ndarray]:
    """A flat sheet held along x at two sides, and nowhere across; its pulled side."""
    pattern = square(n=n, size=SIZE)
    points = pattern.points
    fixed = np.zeros(points.shape, dtype=bool)
    fixed[:, 2] = True
    pulled = points[:, 0] > SIZE * (1 - 1e-9)
    fixed[(points[:, 0] < 1e-9) | pulled, 0] = True
    fixed[0, 1] = True
    return sew(MPI.COMM_SELF, pattern), Supports(fixed), pulled


@pytest.mark.parametrize("stretch", ["1.10000000", "1.40000000", "0.90000000"])
def test_pulled_strip_has_the_exact_reaction(stretch: str) -> None:
    """On a mesh so fine that the pulled triangles alone could not take the way."""
    rows = [r for r in table("gent_uniaxial") if r["mat"] == "A"]
    row = min(rows, key=lambda r: abs(float(r["stretch"]) - float(stretch)))
    pull = float(row["stretch"])
    skin, fixed, pulled = strip(12)
    composite = Composite(fabric=TABLE_A, c1=float(row["c1"]), c2=float(row["c2"]), bending=None)
    way = np.where(pulled[:, None], [(pull - 1) * SIZE, 0, 0], 0)
    supports = Supports(fixed.fixed, displacement=way)
    solver = EquilibriumSolver(skin, composite, supports)
    result = solver.solve(np.zeros(len(skin.owned_cells)), 0.0)
    assert "supports moved by up to" in result.reason
    found = skin.gather_vertices(result.positions)
    expected = skin.pattern.points * [pull, float(row["lateral_stretch"]), 0]
    assert found / SIZE == pytest.approx(expected / SIZE, abs=2e-8)
    force = solver.reactions(result)[pulled].sum(axis=0)
    stress = float(row["nominal_stress_Pa"])
    assert force[0] / (SIZE * TABLE_A.thickness) == pytest.approx(stress, rel=1e-6, abs=0.02)
    assert np.abs(force[1:]).max() < 1e-9 * abs(force[0])
    assert solver.reactions(result).sum(axis=0) == pytest.approx(0, abs=1e-9 * abs(force[0]))


def test_pulled_tube(tube: Skin, comm: MPI.Comm) -> None:
    """Its end is where it was put, by any way; what pulls there is held at the other."""
    pattern = tube.pattern
    base = clamp(pattern, ["base"])
    density = np.full(len(tube.owned_cells), 0.1)
    solver = EquilibriumSolver(
        tube, Composite(), base | displace(pattern, ["tip"], [0.01, 0, 0.006])
    )
    result = solver.solve(density, 2e3)
    tip = pattern.vertices_of("tip")
    there = tube.gather_vertices(result.positions)[tip]
    assert there == pytest.approx(pattern.points[tip] + [0.01, 0, 0.006], abs=1e-15)
    force = solver.reactions(result)
    fixed, scale = solver.model.supports.fixed, np.abs(force).max()
    assert np.all(force[~fixed] == 0)
    assert scale > 0
    # A closed body's pressure has no resultant.
    assert np.abs(force.sum(axis=0)).max() < 1e-8 * scale
    # A warm start that moves the end, and one that takes it back to its assembled place.
    way = np.where(pattern.points[:, 2:] > 0.0599, [-0.004, 0.0, 0.008], 0.0)
    warm = solver.solve(density, Load(2e3, displacement=way), start=result)
    cold = solver.solve(density, Load(2e3, displacement=way))
    assert norm(comm, warm.state - cold.state) < 1e-6 * norm(comm, cold.state)
    rest = solver.solve(density, Load(2e3, displacement=0 * way), start=cold)
    plain = EquilibriumSolver(tube, Composite(), base | clamp(pattern, ["tip"]))
    other = plain.solve(density, 2e3, start=result)
    assert norm(comm, rest.state - other.state) < 1e-6 * norm(comm, rest.state)


def test_a_pull_too_far_tells_how_far_it_came(comm: MPI.Comm) -> None:
    skin, fixed, pulled = strip(4)
    way = np.where(pulled[:, None], [1.5 * SIZE, 0, 0], 0)
    solver = EquilibriumSolver(
        skin, Composite(fabric=TABLE_A, bending=None), Supports(fixed.fixed, displacement=way)
    )
    found = solver.solve(np.zeros(len(skin.owned_cells)), 0.0, raise_on_failure=False)
    assert not found.converged
    assert 0.5 < found.load_factor < 0.7
    assert "supports moved by up to 0.03 m" in found.reason
    whole = solver.solve(np.zeros(len(skin.owned_cells)), Load(0.0, displacement=0 * way + 0.01))
    assert whole.residual <= 1e-10, "moved as a whole nothing pulls"


def test_displacements_join_and_are_checked(tube: Skin) -> None:
    pattern = tube.pattern
    up = displace(pattern, ["tip"], [0, 0, 1e-3])
    both = clamp(pattern, ["base"]) | up
    tip = pattern.vertices_of("tip")
    assert np.all(both.displacement[tip] == [0, 0, 1e-3])
    assert np.abs(both.displacement).sum() == pytest.approx(1e-3 * len(tip))
    last = (both | clamp(pattern, ["tip"])).displacement
    assert not last.any(), "the second counts"


def test_pins_bear_nothing(tube: Skin, comm: MPI.Comm) -> None:
    """Of a free skin under pressure, flat on all sides, and of a tube with bending and a design."""
    skin, sheet = sew(comm, box()), Composite(fabric=TABLE_A, bending=None)
    density = np.random.default_rng(0).random(len(tube.pattern.panel))[tube.owned_cells]
    for solver, printed, pressure, area in (
        (EquilibriumSolver(skin, sheet, pin(skin.pattern)), 0.0, 1e3, SIZE**2),
        (EquilibriumSolver(tube, Composite(), pin(tube.pattern, "base")), density, 2e3, 3e-4),
    ):
        found = solver.solve(np.zeros(len(solver.skin.owned_cells)) + printed, pressure)
        assert np.abs(solver.reactions(found)).max() < 1e-8 * pressure * area


def test_pins_hold_six_components(comm: MPI.Comm) -> None:
    for made in (square(), cylinder(comm, 0.06, 0.02, 5e-3, mesh="structured")):
        assert pin(made).fixed.sum() == 6
        pin(made).require_no_rigid_motion(made)


def test_region_by_coordinates(comm: MPI.Comm) -> None:
    pattern = cylinder(comm, 0.06, 0.02, 4.5e-3)
    fixed = clamp_where(pattern, lambda x: x[:, 2] < 1e-6).fixed
    np.testing.assert_array_equal(fixed, clamp(pattern, ["base"]).fixed)
