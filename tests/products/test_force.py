"""Forces of a panel that is blocked, against closed forms and virtual work."""

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.base.errors import PanelError, ParameterError
from toros_fem.design.loop.case import Case
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.rigid_panels import wrench
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import clamp, symmetry_planes
from toros_fem.meshes import Skin, cylinder, mirrored, sew
from toros_fem.meshes.sheets import WALL
from toros_fem.products.force import ForceMap, force_map, rows_of, sentence_of, whole_solver

PRESSURES = (1.5e3, 3e3)


def striped(skin: Skin) -> tuple[EquilibriumSolver, np.ndarray]:
    pattern = skin.pattern
    density = np.where(pattern.points[pattern.triangles].mean(axis=1)[:, 0] > 5e-3, 0.8, 0.1)
    supports = clamp(pattern, ["base", "tip"])
    return EquilibriumSolver(skin, Composite(), supports), density[skin.owned_cells]


@pytest.fixture(scope="module")
def found(tube: Skin) -> ForceMap:
    def height(_: object, positions: np.ndarray) -> float:
        return float(positions[tube.pattern.vertices_of("tip"), 2].mean())

    return force_map(*striped(tube), PRESSURES, "tip", {"height_m": height})


def test_a_blocked_tube_pushes_by_its_closed_form(comm: MPI.Comm) -> None:
    """Held at its length, its wall bears λ h b a width along the axis, b its hoop strain."""
    radius, pressure = 0.01, 300.0
    skin = sew(comm, cylinder(comm, 0.2, 2 * radius, 2.5e-3, mesh="structured"))
    pattern, cloth = skin.pattern, Composite(c1=1e5, c2=1e5, bending=None)
    solver = EquilibriumSolver(skin, cloth, clamp(pattern, ["base", "tip"]))
    printed = np.where(pattern.panel == pattern.panel_index(WALL), 0.0, 1.0)
    blocked = solver.solve(printed[skin.owned_cells], pressure)
    push = -wrench(solver, blocked, ["tip"])
    fabric = cloth.fabric
    around = fabric.thickness * (2 * fabric.mu + fabric.lam)
    hoop = pressure * radius / (around - pressure * radius)
    along = 2 * np.pi * radius * fabric.thickness * fabric.lam * hoop
    expected = pressure * np.pi * (radius * (1 + hoop)) ** 2 - along
    assert push[2] == pytest.approx(expected, rel=0.04)
    assert np.abs(push[:2]).max() < 0.01 * push[2]


def test_a_map_of_places_and_pressures(found: ForceMap, tube: Skin, comm: MPI.Comm) -> None:
    assert found.pushes.shape == (3, 2, 6)
    given = ~np.isnan(found.pushes[..., 0])
    assert given.tolist() == [[True, True], [True, True], [False, True]]
    largest = np.abs(found.pushes[0, 1])  # held at rest; where it rests when free nothing pushes
    for number in range(2):
        assert np.abs(found.pushes[number + 1, number]).max() < 1e-5 * largest.max()
    for stiffness in found.stiffness:
        assert stiffness == pytest.approx(stiffness.T, abs=1e-4 * np.abs(stiffness).max())
        assert np.linalg.eigvalsh(stiffness).min() > 0
    heights = found.metrics["height_m"]
    assert heights - heights[0] == pytest.approx(found.poses[:, 2], abs=1e-5)


def test_work_of_the_pressure_and_of_a_pump(found: ForceMap, comm: MPI.Comm) -> None:
    """With one more pressure, the work by trapezoids; a slow pump gives that and what is left."""
    above, volumes = np.append(0.0, found.pressures), found.volumes
    by_trapezoids = ((above[1:] + above[:-1]) / 2 * np.diff(volumes)).cumsum()
    assert found.work == pytest.approx(by_trapezoids, rel=0.15)
    absolute = 101_325 + above
    # ∫ ln(P/P₀) d(P V) = ln(P/P₀) P V − ∫ V dP, and V hardly changes against P₀ ΔV.
    exact = np.log(absolute / 101_325) * absolute * volumes
    left = ((volumes[1:] + volumes[:-1]) / 2 * np.diff(above)).cumsum()
    assert found.pump_work == pytest.approx(exact[1:] - left, rel=0.15)
    assert (found.pump_work > found.work).all()


def test_a_panel_that_may_turn_bears_no_torque(tube: Skin, comm: MPI.Comm) -> None:
    free = force_map(*striped(tube), PRESSURES[1:], "tip", free_turns=True)
    push = free.pushes[0, 0]
    assert np.abs(push[3:]).max() < 1e-6 * np.abs(push[:3]).max()
    rows = rows_of(free)
    assert [row["held_where_free_at_pa"] for row in rows] == [0.0, PRESSURES[1]]
    along = free.directions(None)[0]
    assert rows[0]["force_n"] == pytest.approx(push[:3] @ along)
    assert rows_of(free, (0, 0, 2))[0]["force_n"] == pytest.approx(push[2])
    assert "pushes with" in sentence_of(free)


def test_half_a_skin_is_told_as_a_whole(comm: MPI.Comm) -> None:
    """The same push as of the whole, whose mirror image has the same triangles."""
    pattern = cylinder(comm, 0.06, 0.02, 4.5e-3, planes=(1,))
    wall = pattern.panel == pattern.panel_index(WALL)
    density = np.where(wall, 0.1, 1.0)
    case = Case(
        pattern, pattern.points, clamp(pattern, ["base"]) | symmetry_planes(pattern, (1,)), 2e3,
        composite=Composite(), passive=density, symmetry=(1,),
    )  # fmt: skip
    solver, of_whole = whole_solver(comm, case, "tip")
    whole = mirrored(pattern, (1,)).pattern
    assert len(solver.skin.pattern.points) == len(whole.points)
    held = np.concatenate([whole.vertices_of(name) for name in ("base", "tip")])
    assert not np.delete(solver.model.supports.fixed, held, axis=0).any(), "free at the cut"
    push = -wrench(solver, solver.solve(of_whole[solver.skin.owned_cells], 2e3), ["tip"])
    half = EquilibriumSolver(
        sew(comm, pattern),
        Composite(),
        clamp(pattern, ["base", "tip"]) | symmetry_planes(pattern, (1,)),
    )
    of_half = -wrench(half, half.solve(density[half.skin.owned_cells], 2e3), ["tip"])
    assert push[[0, 2, 4]] == pytest.approx(2 * of_half[[0, 2, 4]], rel=1e-5, abs=1e-7)
    with pytest.raises(PanelError, match="Name the free end: --panel"):
        whole_solver(comm, case, "toe")
    with pytest.raises(PanelError, match="is held"):
        whole_solver(comm, case, "base")


def test_pressures_rise(tube: Skin, comm: MPI.Comm) -> None:
    with pytest.raises(ParameterError, match="rise from one to the next"):
        force_map(*striped(tube), (2e3, 1e3), "tip")
    solver, density = striped(tube)
    moved = Load(1e3, displacement=np.zeros_like(tube.pattern.points))
    assert solver.solve(density, moved).converged
