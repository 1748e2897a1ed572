"""Force, torque and stiffness of held panels, free rigid plates, and loads for a reading."""

from functools import cache

import numpy as np
import pytest
from mpi4py import MPI
from scipy.spatial.transform import Rotation

from toros_fem.base.errors import PanelError, ParameterError
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.contact.contact import Contact
from toros_fem.mechanics.equilibrium.newton import NewtonOptions
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.rigid_panels import panel_stiffness, solve_for, solve_rigid, wrench
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import clamp, displace, rigid_displacement
from toros_fem.meshes import Skin

POSE = np.array([2e-3, -1e-3, -3e-3, 0.1, -0.2, 0.15])
TIGHT = NewtonOptions(tolerance=1e-12)


@cache
def held_tube(tube: Skin) -> tuple[EquilibriumSolver, np.ndarray]:
    """A tube with a stripe, held at both caps."""
    pattern = tube.pattern
    density = np.where(pattern.points[pattern.triangles].mean(axis=1)[:, 0] > 5e-3, 0.8, 0.1)
    supports = clamp(pattern, ["base", "tip"])
    return EquilibriumSolver(tube, Composite(), supports, TIGHT), density[tube.owned_cells]


def at_pose(skin: Skin, pose: np.ndarray, pressure: float = 3e3) -> Load:
    moved = rigid_displacement(skin.pattern, ["tip"], pose[:3], pose[3:])
    return Load(pressure, displacement=moved)


def turned_on(pose: np.ndarray, step: np.ndarray) -> np.ndarray:
    turned = Rotation.from_rotvec(step[3:]) * Rotation.from_rotvec(pose[3:])
    return np.concatenate([pose[:3] + step[:3], turned.as_rotvec()])


def test_wrench_is_the_slope_of_the_energy(tube: Skin, comm: MPI.Comm) -> None:
    """By virtual work: E with −P V in it changes by force · shift + torque · turn."""
    solver, density = held_tube(tube)
    rest = solver.solve(density, at_pose(tube, POSE))
    found = wrench(solver, rest, ["tip"])
    step, slopes = 1e-4, []
    for mode in range(6):
        energies = []
        for way in (-step, step):
            other = POSE.copy()
            if mode < 3:
                other[mode] += way * tube.pattern.size
            else:
                other = turned_on(POSE, way * np.eye(6)[mode])
            energies.append(solver.solve(density, at_pose(tube, other), rest).energy)
        length = tube.pattern.size if mode < 3 else 1.0
        slopes.append((energies[1] - energies[0]) / (2 * step * length))
    scale = np.repeat([np.abs(found[:3]).max(), np.abs(found[3:]).max()], 3)
    assert found / scale == pytest.approx(np.array(slopes) / scale, abs=2e-5)


def test_both_ends_pull_against_each_other(tube: Skin, comm: MPI.Comm) -> None:
    """The pressure of a closed skin has no resultant: about one point both wrenches cancel."""
    solver, density = held_tube(tube)
    rest = solver.solve(density, at_pose(tube, POSE))
    moved = rigid_displacement(tube.pattern, ["tip"], POSE[:3], POSE[3:])
    ends = np.concatenate([tube.pattern.vertices_of(name) for name in ("base", "tip")])
    there = solver.positions(rest)[ends]
    assert there == pytest.approx((tube.pattern.points + moved)[ends], abs=1e-14)
    about = (0.01, 0.02, 0.03)
    tip, base = (wrench(solver, rest, [name], about) for name in ("tip", "base"))
    assert tip + base == pytest.approx(0, abs=1e-7 * np.abs(tip).max())
    both = wrench(solver, rest, ["tip", "base"], about)
    assert both == pytest.approx(0, abs=1e-7 * np.abs(tip).max())


def test_stiffness_by_taylor(tube: Skin, comm: MPI.Comm) -> None:
    solver, density = held_tube(tube)
    rest = solver.solve(density, at_pose(tube, POSE))
    stiffness, force = panel_stiffness(solver, rest, ["tip"]), wrench(solver, rest, ["tip"])
    along = np.array([1e-3, 0.5e-3, -1e-3, 0.1, -0.05, 0.08])
    scale = np.repeat([1.0, tube.pattern.size], 3)
    left = []
    for length in (0.1, 0.05, 0.025):
        step = length * along
        moved = solver.solve(density, at_pose(tube, turned_on(POSE, step)), rest)
        off = wrench(solver, moved, ["tip"]) - force - stiffness @ step
        left.append(np.linalg.norm(off / scale))
    rates = np.log2(np.array(left[:-1]) / left[1:])
    assert rates == pytest.approx(2, abs=0.1)


def test_a_free_plate_rests(tube: Skin, comm: MPI.Comm) -> None:
    """It bears no wrench, and is where the energy is least."""
    solver, density = held_tube(tube)
    found, pose = solve_rigid(solver, density, 3e3, ["tip"])
    pulls = np.abs(solver.reactions(found)[tube.pattern.vertices_of("tip")]).sum()
    bears = wrench(solver, found, ["tip"]) / np.repeat([1.0, tube.pattern.size], 3)
    assert np.abs(bears).max() < 1e-6 * pulls
    assert np.abs(pose[3:]).max() > 5e-3, "the stripe bends the tube"
    assert found.converged
    for mode in range(6):
        step = np.eye(6)[mode] * (1e-4 if mode < 3 else 1e-2)
        for way in (-step, step):
            near = solver.solve(density, at_pose(tube, pose + way), found)
            assert near.energy > found.energy

    held = (True,) * 3 + (False,) * 3
    _, shifted = solve_rigid(solver, density, 3e3, ["tip"], free=held)
    assert np.all(shifted[3:] == 0)
    assert np.abs(shifted[:3] - pose[:3]).max() > 1e-5

    weight = np.array([0.0, 0.0, -0.2, 0.0, 0.0, 0.0])
    loaded, sunk = solve_rigid(
        solver, density, 3e3, ["tip"], applied=weight, pose=pose, start=found
    )
    assert wrench(solver, loaded, ["tip"])[2] == pytest.approx(-0.2, rel=1e-4)
    predicted = np.linalg.solve(panel_stiffness(solver, found, ["tip"]), weight)
    assert sunk[2] - pose[2] == pytest.approx(predicted[2], rel=0.05)


def test_a_number_for_a_reading(tube: Skin, comm: MPI.Comm) -> None:
    """The pressure at which the blocked tip pushes by a force."""
    solver, density = held_tube(tube)

    def push(found: object) -> float:
        return -float(wrench(solver, found, ["tip"])[2])  # type: ignore[arg-type]

    pressure, found = solve_for(
        solver, density, lambda p: Load(p), push, 0.2, (1e3, 5e3), tolerance=0.1
    )
    assert found.pressure == pressure
    assert push(found) == pytest.approx(0.2, abs=1e-3)
    with pytest.raises(ParameterError, match="both on one side"):
        solve_for(solver, density, lambda p: Load(p), push, 50.0, (1e3, 2e3), tolerance=1.0)


def test_what_is_not_held_bears_nothing(tube: Skin, comm: MPI.Comm) -> None:
    pattern = tube.pattern
    solver = EquilibriumSolver(tube, Composite(), clamp(pattern, ["base"]))
    rest = solver.solve(np.full(len(tube.owned_cells), 0.1), 1e3)
    with pytest.raises(ParameterError, match="nothing holds panel 'tip'") as raised:
        wrench(solver, rest, ["tip"])
    assert "displace" in str(raised.value)
    with pytest.raises(ParameterError, match="no rigid plate"):
        solve_rigid(solver, rest.density, 1e3, ["tip"])
    with pytest.raises(PanelError):
        wrench(solver, rest, ["lid"])


def test_stiffness_beside_chambers(tube: Skin, comm: MPI.Comm) -> None:
    """Two of equal pressure, whose wall is far from the tip, are one; at their wall it is told."""
    pattern = tube.pattern
    upper = pattern.points[pattern.triangles].mean(axis=1)[:, 2] > 0.03
    supports = clamp(pattern, ["base", "tip"])
    density, pressed = np.full(len(tube.owned_cells), 0.2), 2e3
    found = []
    for chambers in (None, Chambers(("lower", "upper"), upper.astype(np.int64))):
        solver = EquilibriumSolver(tube, Composite(), supports, TIGHT, chambers=chambers)
        rest = solver.solve(density, pressed)
        found.append(panel_stiffness(solver, rest, ["tip"]))
    one, two = found
    assert two == pytest.approx(one, abs=1e-5 * np.abs(one).max())
    of_tip = Chambers(("rest", "tip"), (pattern.panel == pattern.panel_index("tip")).astype(int))
    solver = EquilibriumSolver(tube, Composite(), supports, chambers=of_tip)
    with pytest.raises(ParameterError, match="Close the panel by a cap"):
        panel_stiffness(solver, solver.solve(density, pressed), ["tip"])


def test_the_stiffness_knows_no_contact(tube: Skin, comm: MPI.Comm) -> None:
    supports = clamp(tube.pattern, ["base", "tip"])
    solver = EquilibriumSolver(tube, Composite(), supports, contact=Contact())
    rest = solver.solve(np.full(len(tube.owned_cells), 0.1), 1e3)
    with pytest.raises(ParameterError, match="knows no contact"):
        panel_stiffness(solver, rest, ["tip"])


def test_a_panel_is_held_in_some_components(tube: Skin) -> None:
    pattern = tube.pattern
    tip = pattern.vertices_of("tip")
    up = displace(pattern, ["tip"], [1e-3, 0, 2e-3], turn=[0, 0, 0.1], components="z")
    assert np.array_equal(up.fixed[tip], np.tile([False, False, True], (len(tip), 1)))
    assert up.displacement is not None
    assert up.displacement[tip] == pytest.approx(np.tile([0, 0, 2e-3], (len(tip), 1)))
    turned = displace(pattern, ["tip"], [0, 0, 0], turn=[0, 0, np.pi], about=[0, 0, 0])
    assert turned.displacement is not None
    assert turned.displacement[tip, :2] == pytest.approx(-2 * pattern.points[tip, :2])
    with pytest.raises(ParameterError, match="must name axes"):
        displace(pattern, ["tip"], [0, 0, 0], components="w")
