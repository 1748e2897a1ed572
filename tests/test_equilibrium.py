"""Equilibrium against exact states, and its errors."""

import numpy as np
import pytest
from conftest import TABLE_A, square, table
from mpi4py import MPI
from toros_fem.meshes import Pattern, Skin, cylinder, sew
from toros_fem.meshes.pattern import Panel

from toros_fem import errors
from toros_fem._mpi import norm
from toros_fem.equilibrium import EquilibriumSolver
from toros_fem.model import SkinModel
from toros_fem.parameters import Composite, NewtonOptions
from toros_fem.supports import Supports, clamp

RADIUS = 0.01


def fabric(skin: Skin) -> np.ndarray:
    return np.zeros(len(skin.owned_cells))


@pytest.mark.parametrize("stretch", ["1.10000000", "1.40000000", "0.90000000"])
def test_uniaxial_tension_finds_the_lateral_stretch(comm: MPI.Comm, stretch: str) -> None:
    rows = [r for r in table("gent_uniaxial") if r["mat"] == "A"]
    row = min(rows, key=lambda r: abs(float(r["stretch"]) - float(stretch)))
    pull = float(row["stretch"])
    size = 0.02
    flat = square(size=size).flat_points
    # The held borders keep their assembled place, so the stretch is put in there.
    points = np.column_stack([flat[:, 0] * pull, flat[:, 1], 0 * flat[:, 0]])
    pattern = square(points, size=size)
    held = np.zeros((len(points), 3), dtype=bool)
    held[:, 2] = True
    ends = (flat[:, 0] < 1e-9) | (flat[:, 0] > size - 1e-9)
    held[ends, 0] = True
    held[0, 1] = True
    composite = Composite(fabric=TABLE_A, c1=float(row["c1"]), c2=float(row["c2"]), bending=False)
    skin = sew(comm, pattern)
    result = EquilibriumSolver(skin, composite, Supports(held)).solve(fabric(skin), 0.0)
    assert result.converged
    found = skin.gather_vertices(result.state.reshape(-1, 3))
    expected = flat * [pull, float(row["lateral_stretch"])]
    assert found[:, :2] / size == pytest.approx(expected / size, abs=2e-8)


@pytest.mark.parametrize("row", table("gent_cylinder_ngon"), ids=lambda r: f"{r['mat']}-"
                         f"{r['n_circumference']}-{r['P_Pa']}")  # fmt: skip
def test_exact_polygonal_tube(comm: MPI.Comm, row: dict[str, str]) -> None:
    """The exact state of the inflated n-gon tube leaves no force at its inner vertices."""
    sides, pressure = int(row["n_circumference"]), float(row["P_Pa"])
    edge = 2 * np.pi * RADIUS / sides
    pattern = cylinder(comm, 6 * edge, 2 * RADIUS, edge, mesh="structured")
    factor = 1.0 if row["mat"] == "A" else 100.0
    cloth = type(TABLE_A)(TABLE_A.young * factor, TABLE_A.poisson, TABLE_A.thickness)
    skin = sew(comm, pattern)
    composite = Composite(fabric=cloth, c1=1.8, c2=2.0, bending=False)
    model = SkinModel(skin, composite, clamp(pattern, ["base", "tip"]))
    model.set_density(fabric(skin))
    model.set_pressure(pressure)
    swell, lengthen = float(row["lambda_theta"]), float(row["lambda_z"])
    state = model.assembled.reshape(-1, 3) * [swell, swell, lengthen]
    # The capped tube's axial force is that of the pressure on the polygon it encloses; inside
    # the wall it is in equilibrium by itself. Rings next to the clamped ones feel no end.
    force = model.residual(state.ravel())
    load = pressure * norm(comm, model.load(state.ravel()))
    assert norm(comm, force) <= 1e-8 * load


def test_capped_cylinder_away_from_its_ends(comm: MPI.Comm) -> None:
    sides = 16
    edge = 2 * np.pi * RADIUS / sides
    pattern = cylinder(comm, 0.12, 2 * RADIUS, edge, mesh="structured")
    skin = sew(comm, pattern)
    composite = Composite(fabric=TABLE_A, c1=1.8, c2=2.0, bending=False)
    solver = EquilibriumSolver(skin, composite, clamp(pattern, ["base"]))
    result = solver.solve(fabric(skin), 5e3)
    x = skin.gather_vertices(result.state.reshape(-1, 3))
    height = pattern.points[:, 2]
    middle = np.abs(height - 0.06) < 0.0101
    wall = np.intersect1d(pattern.vertices_of("wall"), np.flatnonzero(middle))
    row = next(
        r for r in table("gent_cylinder_ngon")
        if (r["mat"], r["n_circumference"], r["P_Pa"]) == ("A", "16", "5000")
    )  # fmt: skip
    centre = x[wall].mean(axis=0)
    radius = np.linalg.norm(x[wall, :2] - centre[:2], axis=1)
    assert radius / RADIUS == pytest.approx(float(row["lambda_theta"]), rel=1e-3)
    slope = np.polyfit(height[wall], x[wall, 2], 1)[0]
    assert slope == pytest.approx(float(row["lambda_z"]), rel=1e-3)


def test_result_tells_what_happened(tube_solver: EquilibriumSolver) -> None:
    skin, comm = tube_solver.skin, tube_solver.skin.comm
    rng = np.random.default_rng(0)
    density = rng.random(len(skin.pattern.panel))[skin.owned_cells]
    result = tube_solver.solve(density, 5e3)
    assert result.converged
    assert result.reason == "A stable equilibrium was found at 5000 Pa."
    assert result.residual <= 1e-9
    assert 0 < result.steps <= result.factorisations
    assert result.history[-1].residual == result.residual
    energies = [row.energy for row in result.history]
    assert np.all(np.diff(energies) <= 1e-12 * abs(energies[-1])), "each step lowers the energy"
    assert 0 < result.stretch_use < 1
    model = tube_solver.model
    assert norm(comm, model.residual(result.state)) < 1e-8 * 5e3 * norm(
        comm, model.load(result.state)
    )
    again = tube_solver.solve(density, 5e3, start=result.state)
    assert again.steps == 0
    # The same state by another way: up in small steps, and back down from a higher pressure.
    higher = tube_solver.solve(density, 8e3, start=result.state)
    back = tube_solver.solve(density, 5e3, start=higher.state)
    assert norm(comm, back.state - result.state) < 1e-7 * norm(comm, result.state)


def test_unstable_start_is_left(comm: MPI.Comm) -> None:
    """A flat pillow is stationary under no pressure, and no minimum once inflated."""
    size = 0.05
    one = square(n=6, size=size)
    # The lower panel is laid mirrored, so that it faces down and its diagonals cross the upper.
    below = one.points * [-1, 1, 1] + [size, 0, 0]
    pattern = Pattern.from_panels(
        [
            Panel("top", one.flat_points, one.flat_triangles, one.points),
            Panel("bottom", one.flat_points, one.flat_triangles, below),
        ],
        tolerance=1e-6,
    )
    assert len(pattern.free_edges) == 0
    skin = sew(comm, pattern)
    held = np.zeros((len(pattern.points), 3), dtype=bool)
    flat = pattern.points[:, :2]
    corner = [int(np.argmin(np.linalg.norm(flat - p, axis=1))) for p in ([0, 0], [size, 0])]
    held[corner[0]] = True
    held[corner[1], 1:] = True
    held[int(np.argmin(np.linalg.norm(flat - [size, size], axis=1))), 2] = True
    solver = EquilibriumSolver(skin, Composite(), Supports(held))
    result = solver.solve(fabric(skin), 500.0)
    assert result.converged
    assert result.volume > 0.1 * size**3
    model = solver.model
    matrix = model.create_tangent()
    model.assemble_tangent(matrix, result.state)
    dense = matrix.convert("dense").getDenseArray() if comm.size == 1 else None
    if dense is not None:
        assert np.linalg.eigvalsh(dense).min() > 0


def test_beyond_the_limit_point(comm: MPI.Comm) -> None:
    """Without the barrier the tube has a limit pressure; above it nothing holds."""
    limit = float(table("stvk_limit_pressures")[0]["capped_cyl_lambda_theta_at_Pmax"])
    assert limit == pytest.approx(2.28856)
    pattern = cylinder(comm, 0.04, 2 * RADIUS, 5e-3, mesh="structured")
    skin = sew(comm, pattern)
    composite = Composite(fabric=TABLE_A, c1=1e3, c2=1e3, bending=False)
    solver = EquilibriumSolver(
        skin, composite, clamp(pattern, ["base"]), NewtonOptions(max_steps=40, min_increment=0.05)
    )
    below = solver.solve(fabric(skin), 1.2e3)
    assert below.converged
    with pytest.raises(errors.EquilibriumError, match="at pressure = 2500 Pa") as caught:
        solver.solve(fabric(skin), 2.5e3)
    last = caught.value.result
    assert not last.converged
    assert np.isfinite(last.state).all()
    assert "Lower the pressure" in last.reason
    # The long tube's limit; this one is short and held at its base, which carries it further.
    assert 1811 < last.pressure < 2500
    silent = solver.solve(fabric(skin), 2.5e3, raise_on_failure=False)
    assert not silent.converged
    assert silent.pressure == last.pressure


def test_bad_input(tube_solver: EquilibriumSolver, comm: MPI.Comm) -> None:
    skin = tube_solver.skin
    for pressure in (-1.0, float("nan"), float("inf")):
        with pytest.raises(errors.ParameterError, match="pressure = "):
            tube_solver.solve(fabric(skin), pressure)
    bad = fabric(skin)
    if comm.rank == comm.size - 1:  # one rank alone sees it, all must raise
        bad[0] = 1.5
    with pytest.raises(errors.DensityError, match="1.5"):
        tube_solver.solve(bad, 1e3)
    bad = fabric(skin)
    if comm.rank == 0:
        bad[0] = np.nan
    with pytest.raises(errors.DensityError, match="NaN"):
        tube_solver.solve(bad, 1e3)
    with pytest.raises(errors.DensityError, match="shape"):
        tube_solver.solve(np.zeros(3), 1e3)
    with pytest.raises(errors.ParameterError, match="leaves the stretch bounds"):
        tube_solver.solve(fabric(skin), 1e3, start=3 * tube_solver.model.assembled)
    with pytest.raises(errors.PanelError, match="no panel is named 'side'"):
        clamp(skin.pattern, ["side"])


def test_open_skin_under_pressure(comm: MPI.Comm) -> None:
    pattern = cylinder(comm, 0.04, 0.02, 5e-3, mesh="structured", caps=False)
    skin = sew(comm, pattern)
    solver = EquilibriumSolver(skin, Composite(), clamp(pattern, ["wall"]))
    with pytest.raises(errors.OpenSkinError, match="edges are free"):
        solver.solve(fabric(skin), 1e3)
