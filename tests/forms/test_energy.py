"""Energy, first variation and tangent against each other and against `ufl.derivative`."""

import dataclasses

import dolfinx
import numpy as np
import pytest
import ufl
from dolfinx import fem
from helpers.models import (
    automatic_tangent,
    bent_tube,
    drawn,
    pressurize,
    upper_rows,
)
from mpi4py import MPI
from scipy.sparse import csr_matrix, triu

from toros_fem.base.mpi import norm, total
from toros_fem.materials.sheet import Bending, Composite, Material
from toros_fem.mechanics.skin.model import SkinModel
from toros_fem.mechanics.skin.supports import Supports, clamp
from toros_fem.meshes import Pattern, Skin, cylinder, sew

# So thick that stretching does not hide what bending adds.
THICK = Composite(Material(1e5, 0.3, 5e-3), Material(26e5, 0.3, 5e-3))
# Bending, whether the tube is cut by an oblique mirror, ends that are closed, face of the print.
SCENES = {
    "average": (Bending("average"), False, "both", None),
    "quadratic, mirrored": (Bending("quadratic"), True, None, None),
    "midedge, hinged": (Bending("midedge", "hinged"), False, "both", None),
    "midedge, mirrored": (Bending("midedge", rest="assembled"), True, None, None),
    "average, outside": (Bending("average"), False, "both", "outside"),
    "midedge, free, inside": (Bending("midedge"), False, "base", "inside"),
    "midedge, mirrored, outside": (Bending("midedge"), True, None, "outside"),
}


@pytest.fixture(scope="module", params=SCENES)
def loaded(request: pytest.FixtureRequest, tube: Skin, comm: MPI.Comm) -> SkinModel:
    """A tube, or half of one cut by an oblique mirror, with a random design."""
    bending, mirrored, caps, side = SCENES[request.param]
    skin = tube if caps == "both" else sew(comm, cylinder(comm, 0.06, 0.02, 4.5e-3, caps=caps))
    if mirrored:
        # The guided borders themselves are free, so that all derivatives there are seen.
        points, border = skin.pattern.points, skin.pattern.free_edges
        along = points[border[:, 1]] - points[border[:, 0]]
        along /= np.linalg.norm(along, axis=1)[:, None]
        normals = np.array([0.1, -0.2, 1.0]) - (along @ [0.1, -0.2, 1.0])[:, None] * along
        fixed = np.repeat(np.abs(points[:, 2:] - 0.03) < 6e-3, 3, axis=1)
        supports = Supports(fixed, border, normals)
    else:
        supports = clamp(skin.pattern, ["base"])
    composite = dataclasses.replace(THICK, bending=bending, print_side=side)
    model = SkinModel(skin, composite, supports)
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
