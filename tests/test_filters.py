"""Filter, projection and random start, forward and backward."""

import numpy as np
import pytest
from conftest import table
from mpi4py import MPI
from toros_fem.meshes import Skin, cylinder, sew

from toros_fem import errors
from toros_fem.density import check_density, random_density
from toros_fem.filters import ConeFilter
from toros_fem.projection import Continuation, Projection


def test_filter_against_its_definition(tube: Skin) -> None:
    pattern, radius = tube.pattern, 8e-3
    cone = ConeFilter(tube, radius)
    density = np.random.default_rng(0).random(len(pattern.panel))
    found = tube.gather_cells(cone.forward(density[tube.owned_cells]))
    distance = np.linalg.norm(pattern.centroids[:, None] - pattern.centroids[None], axis=2)
    weight = np.maximum(radius - distance, 0) * pattern.areas
    weight *= pattern.panel[:, None] == pattern.panel[None]
    assert found == pytest.approx(weight @ density / weight.sum(axis=1), rel=1e-12)


def test_filter_backward_is_the_transpose(tube: Skin, comm: MPI.Comm) -> None:
    cone = ConeFilter(tube, 8e-3)
    rng = np.random.default_rng(1)
    a, b = rng.random((2, len(tube.pattern.panel)))[:, tube.owned_cells]
    forward = comm.allreduce(float(cone.forward(a) @ b))
    backward = comm.allreduce(float(a @ cone.backward(b)))
    assert forward == pytest.approx(backward, rel=1e-13)
    ones = np.ones(len(tube.owned_cells))
    assert cone.forward(ones) == pytest.approx(ones, rel=1e-13)


def test_filter_of_a_half_plane(comm: MPI.Comm) -> None:
    """Against the exact response of the cone to a straight edge."""
    skin = sew(comm, cylinder(comm, 0.05, 0.02, 1.2e-3))
    pattern, radius = skin.pattern, 9e-3
    cone = ConeFilter(skin, radius)
    edge = 0.025
    step = (pattern.centroids[skin.owned_cells, 1] > edge).astype(float)
    filtered = skin.gather_cells(cone.forward(step))
    wall = np.flatnonzero(pattern.panel == pattern.panel_index("wall"))
    u, v = pattern.centroids[wall].T
    inner = (u > radius) & (u < u.max() - radius)
    rows = table("filter_halfplane")
    exact = np.interp(
        (v[inner] - edge) / radius,
        [float(r["d_over_R"]) for r in rows],
        [float(r["cone2D"]) for r in rows],
    )
    assert np.abs(filtered[wall[inner]] - exact).max() < 0.04
    assert np.abs(filtered[wall[inner]] - exact).mean() < 0.01


def test_filter_radius_too_small_is_said(tube: Skin) -> None:
    with pytest.warns(UserWarning, match="under 1.5 edge lengths"):
        ConeFilter(tube, 3e-3)
    with pytest.raises(errors.ParameterError, match="radius = -1"):
        ConeFilter(tube, -1.0)


def test_projection_against_the_table() -> None:
    for row in table("heaviside"):
        filtered = np.array([float(row["rho_tilde"])])
        for name, value in row.items():
            if name.startswith("beta="):
                projected = Projection(float(name[5:]), 0.5).forward(filtered)
                assert projected[0] == pytest.approx(float(value), abs=1e-9)


@pytest.mark.parametrize("eta", [0.3, 0.5, 0.7])
def test_projection_taylor(eta: float) -> None:
    rng = np.random.default_rng(2)
    x, direction, weight = rng.random((3, 200))
    x = 0.1 + 0.8 * x
    projection = Projection(20.0, eta)
    slope = projection.backward(x, weight) @ direction
    base = weight @ projection.forward(x)
    gaps = [
        abs(weight @ projection.forward(x + h * direction) - base - h * slope)
        for h in 1e-4 * 0.5 ** np.arange(5)
    ]
    assert np.log2(np.array(gaps[:-1]) / gaps[1:]) == pytest.approx(2, abs=0.05)


def test_random_density(tube: Skin, comm: MPI.Comm) -> None:
    whole = tube.gather_cells(random_density(tube, 7))
    alone = sew(MPI.COMM_SELF, tube.pattern)
    assert np.array_equal(whole, alone.gather_cells(random_density(alone, 7)))
    assert not np.array_equal(whole, tube.gather_cells(random_density(tube, 8)))
    assert whole.min() >= 0.4
    assert whole.max() <= 0.6
    with pytest.raises(errors.DensityError, match="spread"):
        random_density(tube, 7, spread=0.6)


def test_density_outside_is_named(tube: Skin, comm: MPI.Comm) -> None:
    density = np.full(len(tube.owned_cells), 0.5)
    check_density(tube, density)
    if comm.rank == comm.size - 1:
        density[2] = -0.25
    with pytest.raises(errors.DensityError, match=r"triangle \d+ is -0.25"):
        check_density(tube, density)


def test_parameters() -> None:
    with pytest.raises(errors.ParameterError, match="beta"):
        Projection(beta=0.0)
    with pytest.raises(errors.ParameterError, match="eta"):
        Projection(eta=1.5)
    schedule = Continuation(first=4, last=20, every=10)
    assert [schedule.beta(k) for k in (0, 9, 10, 20, 30, 99)] == [4, 4, 8, 16, 20, 20]
    with pytest.raises(errors.ParameterError, match="last"):
        Continuation(first=8, last=4)
