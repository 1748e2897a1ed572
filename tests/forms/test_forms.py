"""The energy against hand values, limits, invariance, and its own automatic derivative."""

import dataclasses

import dolfinx
import numpy as np
import pytest
import ufl
from dolfinx import fem
from helpers.models import (
    SIZE,
    affine,
    automatic_tangent,
    bent_tube,
    drawn,
    pressurize,
    sheet_model,
    upper_rows,
)
from helpers.scenes import TABLE_A, table
from mpi4py import MPI
from scipy.sparse import csr_matrix, triu

from toros_fem._mpi import norm, total
from toros_fem.materials import CURVATURES, Bending, Composite, Material
from toros_fem.mechanics.model import SkinModel
from toros_fem.mechanics.stretch_bounds import StretchBounds, principal_stretches
from toros_fem.mechanics.supports import Supports, clamp
from toros_fem.meshes import Pattern, Skin, cylinder, sew


def stress(stretch: float, other: float, c1: float, c2: float) -> float:
    """Nominal stress of material A by the formula of the reference tables."""
    mu = lam = 50e3
    a, b = (c1 - 1) ** 2, (c2 - 1) ** 2
    own = 2 * mu * (stretch - 1) / (1 - (stretch - 1) ** 2 / a)
    total = stretch + other - 2
    return own + lam * total / (1 - total**2 / b)


@pytest.mark.parametrize("stretches", [(1.3, 0.9), (1.2, 1.2), (0.8, 0.95), (1.0, 1.0)])
def test_energy_and_force_of_an_affine_sheet(
    comm: MPI.Comm, stretches: tuple[float, float]
) -> None:
    c1, c2 = 1.8, 2.0
    model = sheet_model(comm, Composite(fabric=TABLE_A, c1=c1, c2=c2, bending=None))
    model.set_density(np.zeros(len(model.skin.owned_cells)))
    pressurize(model, 0.0)
    one, two = stretches
    state = affine(model, np.array([[one, 0], [0, two], [0, 0]]))
    a, b, mu = 0.64, 1.0, 50e3
    psi = (
        -mu * a * np.log(1 - (one - 1) ** 2 / a)
        - mu * a * np.log(1 - (two - 1) ** 2 / a)
        - mu / 2 * b * np.log(1 - (one + two - 2) ** 2 / b)
    )
    assert model.energy(state) == pytest.approx(psi * 3e-4 * SIZE**2, rel=1e-12, abs=1e-16)
    force = model.skin.gather_vertices(model.residual(state).reshape(-1, 3))
    border = model.skin.pattern.points[:, 0] > SIZE * (1 - 1e-9)
    pull = force[border].sum(axis=0) / (3e-4 * SIZE)
    assert pull[0] == pytest.approx(stress(one, two, c1, c2), rel=1e-11, abs=1e-6)
    assert pull[1:] == pytest.approx([0, 0], abs=1e-6)


def test_stress_formula_agrees_with_the_tables() -> None:
    """The closed form the forces are held against, at the tables' printed digits."""
    for row in table("gent_uniaxial"):
        if row["mat"] != "A":
            continue
        one, two = float(row["stretch"]), float(row["lateral_stretch"])
        c1, c2 = float(row["c1"]), float(row["c2"])
        expected = float(row["nominal_stress_Pa"])
        slope = 1e-8 * 2e6  # what half a unit of the last digit of the stretch is worth
        assert stress(one, two, c1, c2) == pytest.approx(expected, rel=1e-6, abs=slope)
        assert stress(two, one, c1, c2) == pytest.approx(0, abs=slope)
    for row in table("gent_equibiaxial_planestrain"):
        if row["mat"] != "A":
            continue
        stretch = float(row["stretch"])
        for column, pair in (
            ("P11_equibiaxial_Pa", (stretch, stretch)),
            ("P11_strip_l2=1_Pa", (stretch, 1.0)),
            ("P22_strip_Pa", (1.0, stretch)),
        ):
            if row[column]:
                assert stress(*pair, 1.8, 2.0) == pytest.approx(float(row[column]), rel=1e-7)


def test_limit_without_bounds(comm: MPI.Comm) -> None:
    model = sheet_model(comm, Composite(fabric=TABLE_A, c1=1e4, c2=1e4, bending=None))
    model.set_density(np.zeros(len(model.skin.owned_cells)))
    F = np.array([[1.3, 0.2], [-0.1, 0.8], [0.3, 0.1]])
    one, two = np.linalg.svd(F, compute_uv=False)
    by_hand = 15 * ((one - 1) ** 2 + (two - 1) ** 2) + 7.5 * (one + two - 2) ** 2
    energy = model.energy(affine(model, F))
    assert energy == pytest.approx(by_hand * SIZE**2, rel=1e-7)


def test_rotation_costs_nothing(comm: MPI.Comm) -> None:
    model = sheet_model(comm, Composite())
    model.set_density(np.full(len(model.skin.owned_cells), 0.3))
    pressurize(model, 0.0)
    R = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    turned = affine(model, R[:, :2])
    scale = 1e14 * model.energy_rounding()  # area times modulus times (c2 - 1)^2
    assert abs(model.energy(turned)) < 1e-14 * scale
    assert norm(comm, model.residual(turned)) < 1e-13 * scale / SIZE
    # A deformed sheet keeps its energy, and its forces turn along.
    bent = affine(model, np.array([[1.2, 0.1], [0, 0.9], [0.1, 0.2]]))
    model.positions(bent)[:, 2] += 20 * model.positions(bent)[:, 0] ** 2
    turned = bent.copy()
    model.positions(turned)[:] = model.positions(bent) @ R.T
    assert model.energy(turned) == pytest.approx(model.energy(bent), rel=1e-12)
    force = model.residual(bent)
    model.positions(force)[:] = model.positions(force) @ R.T
    assert norm(comm, model.residual(turned) - force) < 1e-11 * norm(comm, force)


@pytest.mark.parametrize("curvature", CURVATURES)
def test_bending_of_a_rolled_sheet(comm: MPI.Comm, curvature: str) -> None:
    """The regular n-gon prism: one hinge of 2 pi / n per triangle, curvature 2 pi / (n chord)."""
    pattern = cylinder(comm, 0.06, 0.02, 4e-3, mesh="structured", caps=False)
    # Without Poisson's ratio the free ends of the prism want no other angle than they have.
    cloth = Material(0.1e6, 0.0, 0.5e-3)
    composite = Composite(
        fabric=cloth, reinforcement=Material(26e6, 0.0, 0.5e-3), bending=Bending(curvature)
    )
    model = SkinModel(sew(comm, pattern), composite, clamp(pattern, ["wall"]))
    model.set_density(np.zeros(len(model.skin.owned_cells)))
    sides = round(np.pi * 0.02 / 4e-3)
    bend = 2 * np.pi / (sides * 0.02 * np.sin(np.pi / sides))
    D = cloth.thickness**3 / 12 * (cloth.lam + 2 * cloth.mu)
    expected = 0.5 * D * bend**2 * pattern.areas.sum()
    assert model.energy(model.assembled) == pytest.approx(expected, rel=1e-9)
    # Full interpolation: the reinforcement bends by its own modulus.
    model.set_density(np.ones(len(model.skin.owned_cells)))
    assert model.energy(model.assembled) == pytest.approx(expected * 260, rel=1e-9)


# So thick that stretching does not hide what bending adds.
THICK = Composite(Material(1e5, 0.3, 5e-3), Material(26e5, 0.3, 5e-3))
SCENES = {
    "average": (Bending("average"), False),
    "quadratic, mirrored": (Bending("quadratic"), True),
    "midedge, hinged": (Bending("midedge", "hinged"), False),
    "midedge, mirrored": (Bending("midedge", rest="assembled"), True),
}


@pytest.fixture(scope="module", params=SCENES)
def loaded(request: pytest.FixtureRequest, tube: Skin, comm: MPI.Comm) -> SkinModel:
    """A tube, or half of one cut by an oblique mirror, with a random design."""
    bending, mirrored = SCENES[request.param]
    skin, supports = tube, clamp(tube.pattern, ["base"])
    if mirrored:
        skin = sew(comm, cylinder(comm, 0.06, 0.02, 4.5e-3, caps=False))
        # The guided borders themselves are free, so that all derivatives there are seen.
        points, border = skin.pattern.points, skin.pattern.free_edges
        along = points[border[:, 1]] - points[border[:, 0]]
        along /= np.linalg.norm(along, axis=1)[:, None]
        normals = np.array([0.1, -0.2, 1.0]) - (along @ [0.1, -0.2, 1.0])[:, None] * along
        fixed = np.repeat(np.abs(points[:, 2:] - 0.03) < 6e-3, 3, axis=1)
        supports = Supports(fixed, border, normals)
    model = SkinModel(skin, dataclasses.replace(THICK, bending=bending), supports)
    rng = np.random.default_rng(3)
    model.set_density(rng.random(len(skin.pattern.panel))[skin.owned_cells])
    pressurize(model, 2e3 if model.closed else 0.0)
    return model


def test_closed_form_variation_equals_the_automatic_one(loaded: SkinModel) -> None:
    state = bent_tube(loaded)
    closed = loaded.residual(state)
    test = ufl.TestFunction(loaded.space)
    form = fem.form(ufl.derivative(loaded.ufl_forms.energy, loaded.q, test))
    vector = fem.assemble_vector(form)
    vector.scatter_reverse(dolfinx.la.InsertMode.add)
    automatic = vector.array[: loaded.size_local] * loaded.free
    assert norm(loaded.skin.comm, closed - automatic) <= 1e-13 * norm(loaded.skin.comm, closed)


def test_tangent_is_symmetric_and_the_derivative_of_the_residual(loaded: SkinModel) -> None:
    comm = loaded.skin.comm
    state = bent_tube(loaded)
    matrix = automatic_tangent(loaded, state)
    assert (matrix - matrix.copy().transpose()).norm() <= 1e-12 * matrix.norm()
    direction = drawn(loaded, 5)
    x, y = matrix.createVecs()
    x.array[:] = direction
    matrix.mult(x, y)
    base = loaded.residual(state)
    errors = []
    for k in range(5):
        step = 1e-5 * 2.0**-k
        gap = loaded.residual(state + step * direction) - base - step * y.array
        errors.append(norm(comm, gap))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert rates == pytest.approx(2, abs=0.05)


def test_closed_form_tangent_equals_the_automatic_one(loaded: SkinModel) -> None:
    comm = loaded.skin.comm
    state = bent_tube(loaded)
    closed = upper_rows(loaded, state)
    matrix = automatic_tangent(loaded, state)
    begin = loaded.space.dofmap.index_map.local_range[0]
    rows, columns, values = matrix.getValuesCSR()
    automatic = triu(csr_matrix((values, columns, rows), shape=closed.shape), k=begin)
    assert norm(comm, (closed - automatic).tocsr().data) <= 1e-12 * norm(comm, closed.data)
    assert total(comm, closed.nnz) > 0


def test_patch_that_meets_a_vertex_twice(comm: MPI.Comm) -> None:
    """On a tetrahedron all three flaps of a triangle are one vertex: blocks fall together."""
    points = 0.01 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], dtype=float)
    triangles = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
    side = np.linalg.norm(points[1] - points[0])
    flat = side * np.array([[0, 0], [1, 0], [0.5, np.sqrt(0.75)]])
    pattern = Pattern(
        flat_points=np.concatenate([flat + [2 * side * k, 0] for k in range(4)]),
        flat_triangles=np.arange(12).reshape(4, 3),
        panel=np.arange(4),
        sewn=triangles.ravel(),
        points=points,
        panel_names=("a", "b", "c", "d"),
    )
    fixed = np.zeros((4, 3), dtype=bool)
    fixed[:2] = fixed[2, :2] = True
    thick = Material(young=1e5, poisson=0.3, thickness=5e-3)
    model = SkinModel(sew(MPI.COMM_SELF, pattern), Composite(fabric=thick), Supports(fixed))
    model.set_density(np.zeros(4))
    pressurize(model, 100.0)
    state = model.assembled + 1e-3 * np.random.default_rng(1).standard_normal(18) * model.free
    closed = upper_rows(model, state)
    rows, columns, values = automatic_tangent(model, state).getValuesCSR()
    automatic = triu(csr_matrix((values, columns, rows), shape=closed.shape))
    assert abs(closed - automatic).max() <= 1e-13 * abs(automatic).max()


def test_residual_is_the_derivative_of_the_energy(loaded: SkinModel) -> None:
    comm = loaded.skin.comm
    state = bent_tube(loaded)
    direction = drawn(loaded, 6)
    slope = comm.allreduce(float(loaded.residual(state) @ direction))
    base = loaded.energy(state)
    errors = []
    for k in range(5):
        step = 2e-5 * 2.0**-k
        errors.append(abs(loaded.energy(state + step * direction) - base - step * slope))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert rates == pytest.approx(2, abs=0.05)


def test_stretches_against_singular_values() -> None:
    F = np.random.default_rng(1).standard_normal((200, 3, 2))
    F[0] = [[1, 0], [0, 1], [0, 0]]
    big, small = principal_stretches(F)
    expected = np.linalg.svd(F, compute_uv=False)
    assert np.stack([big, small], axis=1) == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_feasibility_is_told_by_the_stretches() -> None:
    """At stretches (2.5, 2.5) both factors of eq. (1) are negative, their product positive."""
    bounds = StretchBounds(MPI.COMM_SELF, np.eye(2)[None], 1.8, 10.0)
    flat = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]], dtype=float)
    assert (1 - 1.5**2 / 0.64) ** 2 > 0
    assert bounds.worst(2.5 * flat) > 1
    assert bounds.worst(1.5 * flat) == pytest.approx(0.5 / 0.8)
    assert bounds.worst(flat * [1, 0, 0]) == np.inf, "a collapsed triangle"
    assert bounds.worst(np.full((1, 3, 3), np.nan)) == np.inf
    step = bounds.largest_step(flat, flat, 0.9)
    assert step == pytest.approx(0.72, abs=1e-5), "0.9 of the way from 1 to the bound 1.8"
    assert bounds.largest_step(flat, 0.1 * flat, 0.9) == 1.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"c1": 1.0}, "c1 = 1.0"),
        ({"c2": 0.5}, "c2 = 0.5"),
        ({"c1": float("inf")}, "c1 = inf"),
    ],
)
def test_bad_bounds(changes: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Composite(**changes)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "changes",
    [{"young": -1.0}, {"young": float("nan")}, {"poisson": 0.6}, {"thickness": 0.0}],
)
def test_bad_material(changes: dict[str, float]) -> None:
    name = next(iter(changes))
    good = {"young": 1e5, "poisson": 0.3, "thickness": 5e-4}
    with pytest.raises(ValueError, match=f"{name} = "):
        Material(**{**good, **changes})
