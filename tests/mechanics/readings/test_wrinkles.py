"""Wrinkles of sheared sheets against the exact tension field; their states against the forms."""

from dataclasses import replace

import numpy as np
import pytest
import ufl
from dolfinx import fem
from helpers.models import affine, sheet_model
from helpers.scenes import TABLE_A, square
from mpi4py import MPI
from scipy.optimize import brentq

from toros_fem.forms.kinematics import Triangle, edge_products
from toros_fem.forms.membrane import tension_field
from toros_fem.materials.sheet import Bending, Composite, Membrane
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.newton import NewtonOptions
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.readings.wrinkles import Tension, WrinkleField, wrinkle_field, wrinkles
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes import Pattern, sew
from toros_fem.meshes.sheets import rectangle

SIZE, SHEAR, RESIDUAL = 0.02, 0.1, 1e-5
SHEET = Composite(
    fabric=TABLE_A, reinforcement=TABLE_A, c1=1.8, c2=2.0, bending=None,
    membrane=Membrane("tension-field", RESIDUAL),
)  # fmt: skip
OPTIONS = NewtonOptions(tolerance=1e-9)


def exact(shear: float) -> tuple[float, float]:
    """Angle of the tension of F = [[1, γ], [0, 1]] and shear force per length in N/m."""

    def psi(shear: float) -> float:
        """ψ(λ₁, w(λ₁)) over μ h, with λ = μ, of material A."""
        x = shear / 2 + np.hypot(1, shear / 2) - 1
        a, b = 0.64, 1.0

        def across(y: float) -> float:
            return float(2 * y / (1 - y * y / a) + (x + y) / (1 - (x + y) ** 2 / b))

        y = brentq(across, -x, 0.0, xtol=1e-15)
        logs = -a * np.log(1 - x * x / a) - a * np.log(1 - y * y / a)
        return float(logs - b / 2 * np.log(1 - (x + y) ** 2 / b))

    step = 1e-4
    slope = (psi(shear + step) - psi(shear - step)) / (2 * step)
    # C = [[1, γ], [γ, 1 + γ²]]
    return float(np.arctan2(2 * shear, -(shear**2)) / 2), 15 * slope


def sheared(
    comm: MPI.Comm, pattern: Pattern, held: np.ndarray, composite: Composite = SHEET
) -> tuple[EquilibriumSolver, Equilibrium, np.ndarray]:
    """Shear a sheet by its held vertices; return its reactions too.

    Without bending it stays in its plane.
    """
    fixed = np.repeat(held[:, None], 3, axis=1)
    fixed[:, 2] |= composite.bending is None
    moved = np.zeros(pattern.points.shape)
    moved[:, 0] = SHEAR * pattern.points[:, 1] * held
    skin = sew(comm, pattern)
    solver = EquilibriumSolver(skin, composite, Supports(fixed, displacement=moved), OPTIONS)
    result = solver.solve(np.zeros(len(skin.owned_cells)), 0.0)
    return solver, result, solver.reactions(result)


def angles(field: WrinkleField) -> np.ndarray:
    return np.arctan2(field.flat[:, 1], field.flat[:, 0]) % np.pi


@pytest.mark.parametrize("thickness", [None, 2e-5])
def test_sheared_sheet(alone: MPI.Comm, thickness: float | None) -> None:
    """Held along its whole border: wrinkled at one angle, with the exact shear force."""
    composite, scale = SHEET, 1.0
    if thickness is not None:  # thin, so that bending hardly counts, but free to leave its plane
        thin = replace(TABLE_A, thickness=thickness)
        composite = replace(SHEET, fabric=thin, reinforcement=thin, bending=Bending())
        scale = thickness / TABLE_A.thickness
    pattern = square(n=6, size=SIZE)
    x, y, _ = pattern.points.T
    low, top = y < 1e-9, y > SIZE * (1 - 1e-9)
    held = low | top | (x < 1e-9) | (x > SIZE * (1 - 1e-9))
    solver, result, reactions = sheared(alone, pattern, held, composite)
    field = wrinkle_field(solver, np.zeros(len(solver.skin.owned_cells)), result)
    angle, force = exact(SHEAR)
    assert np.all(field.state == Tension.WRINKLED)
    assert field.share(Tension.WRINKLED, pattern.areas) == 1.0
    assert angles(field) == pytest.approx(angle, abs=1e-6)
    d = np.array([np.cos(angle), np.sin(angle), 0.0])
    onward = d + [SHEAR * d[1], 0.0, 0.0]
    onward /= np.linalg.norm(onward)
    along = np.abs(field.direction @ onward)
    assert along == pytest.approx(1.0, abs=1e-9)
    # Virtual work of the shear: force per length times area.
    work = (reactions[:, 0] * pattern.points[:, 1]).sum() / SIZE**2
    assert work == pytest.approx(scale * force, rel=3 * RESIDUAL)
    # The sheet that takes compression is stiffer by 2/(1 + ν).
    assert work < 0.8 * scale * 15 * SHEAR


def test_wagner_web(alone: MPI.Comm) -> None:
    """A wide web between two rails, free at its ends: what more width adds is the exact force."""
    forces = []
    for width in (5 * SIZE, 7 * SIZE):
        pattern = rectangle(alone, width, SIZE, SIZE / 5, "crossed")
        y = pattern.points[:, 1]
        top = y > SIZE * (1 - 1e-9)
        solver, result, reactions = sheared(alone, pattern, (y < 1e-9) | top)
        forces.append(reactions[top, 0].sum())
        field = wrinkle_field(solver, np.zeros(len(solver.skin.owned_cells)), result)
        middle = np.abs(pattern.centroids[:, 0] - width / 2) < SIZE
        assert np.all(field.state[middle] == Tension.WRINKLED)
        angle, force = exact(SHEAR)
        assert angles(field)[middle] == pytest.approx(angle, abs=1e-2)
    assert (forces[1] - forces[0]) / (2 * SIZE) == pytest.approx(force, rel=3 * RESIDUAL)


def test_states_are_those_of_the_energy(alone: MPI.Comm) -> None:
    """Taut, wrinkled and slack triangles of two materials, by eq. (1) and by the forms."""
    stiff = replace(TABLE_A, young=10 * TABLE_A.young, poisson=0.1)
    composite = replace(SHEET, reinforcement=stiff)
    model = sheet_model(alone, composite)
    skin, pattern = model.skin, model.skin.pattern
    rng = np.random.default_rng(5)
    density = rng.uniform(0, 1, len(pattern.panel))
    state = affine(model, np.array([[1.04, 0.05], [0, 0.98], [0.02, 0.0]]))
    noise = 0.03 * SIZE * rng.uniform(-1, 1, pattern.points.shape)
    model.positions(state)[:] += noise[skin.owned_vertices]
    positions = skin.gather_vertices(model.positions(state))
    field = wrinkles(pattern, composite, density, positions)
    assert set(field.state) == set(Tension)

    model.set_density(density[skin.owned_cells])
    model.set_state(state)
    t = Triangle(ufl.split(model.q)[:3], ufl.Jacobian(skin.mesh), model.design.density)
    e = t.strain([measure.value for measure in edge_products(t.edges)])
    mu, lam = (
        TABLE_A.thickness * t.mix(plain, printed)
        for plain, printed in ((TABLE_A.mu, stiff.mu), (TABLE_A.lam, stiff.lam))
    )
    taut, wrinkled, _, _ = tension_field(e, mu, lam, composite.c1, composite.c2)
    number = ufl.conditional(taut, 2.0, ufl.conditional(wrinkled, 1.0, 0.0))
    both = ufl.as_vector([number, *e.C])
    cells = np.arange(len(skin.owned_cells), dtype=np.int32)
    values = fem.Expression(both, np.array([[1 / 3, 1 / 3]])).eval(skin.mesh, cells)
    values = values.reshape(-1, 4)
    assert np.array_equal(values[:, 0], field.state[skin.owned_cells])
    some = field.state[skin.owned_cells] > 0
    n, m = field.flat[skin.owned_cells][some].T
    one, two, shear = values[some, 1:].T
    length = np.hypot(one - two, 2 * shear)
    assert n * n - m * m == pytest.approx((one - two) / length, abs=1e-12)
    assert 2 * n * m == pytest.approx(2 * shear / length, abs=1e-12)
    assert not field.flat[field.state == Tension.SLACK].any()


@pytest.mark.parametrize(("across", "state"), [(0.72, Tension.WRINKLED), (0.74, Tension.TAUT)])
def test_states_near_the_bound_of_stretches(across: float, state: Tension) -> None:
    """At λ₁ = 1.75, of at most 1.8, ∂ψ/∂λ₂ of eq. (1) vanishes at λ₂ = 0.7256 where λ = μ."""
    pattern = square(size=SIZE)
    stretched = pattern.points * [1.75, across, 1.0]
    field = wrinkles(pattern, SHEET, np.zeros(len(pattern.panel)), stretched)
    assert np.all(field.state == state)


def test_a_sheet_that_is_turned_is_slack(alone: MPI.Comm) -> None:
    """Rounding makes no tension."""
    pattern = square(size=SIZE)
    c, s = np.cos(0.3), np.sin(0.3)
    turned = pattern.points @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    turned = turned @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    assert np.linalg.norm(turned - pattern.points, axis=1).max() > 0.1 * SIZE
    field = wrinkles(pattern, SHEET, np.zeros(len(pattern.panel)), turned)
    assert np.all(field.state == Tension.SLACK)
    assert not field.direction.any()
