"""Filter, projection and random start, forward and backward."""

import numpy as np
import pytest
from helpers.scenes import square, table
from mpi4py import MPI

from toros_fem import errors
from toros_fem.density.cone import ConeFilter
from toros_fem.density.field import check_density, random_density
from toros_fem.density.filters import make_filter
from toros_fem.density.helmholtz import HelmholtzFilter
from toros_fem.density.projection import Projection
from toros_fem.meshes import Skin, cylinder, sew


def test_filter_against_its_definition(tube: Skin) -> None:
    pattern, radius = tube.pattern, 8e-3
    cone = ConeFilter(tube, radius)
    density = np.random.default_rng(0).random(len(pattern.panel))
    found = tube.gather_cells(cone.forward(density[tube.owned_cells]))
    distance = np.linalg.norm(pattern.centroids[:, None] - pattern.centroids[None], axis=2)
    weight = np.maximum(radius - distance, 0) * pattern.areas
    weight *= pattern.panel[:, None] == pattern.panel[None]
    assert found == pytest.approx(weight @ density / weight.sum(axis=1), rel=1e-12)


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


@pytest.mark.parametrize("name", ["cone", "helmholtz"])
def test_forward_and_backward_are_adjoint(name: str, tube: Skin, comm: MPI.Comm) -> None:
    flat = make_filter(name, tube, 8e-3)
    rng = np.random.default_rng(1)
    a, b, p, q = (rng.random(len(tube.pattern.panel))[tube.owned_cells] for _ in range(4))
    inner = lambda x, y: comm.allreduce(float(np.vdot(x, y)))  # noqa: E731
    assert inner(flat.forward(a), b) == pytest.approx(inner(a, flat.backward(b)), rel=1e-12)
    slopes = np.array([p, q])
    there, back = inner(flat.slope(a), slopes), inner(a, flat.slope_backward(slopes))
    assert there == pytest.approx(back, rel=1e-12)
    ones = np.ones(len(tube.owned_cells))
    assert flat.forward(ones) == pytest.approx(ones, rel=1e-11)
    assert flat.slope(ones) == pytest.approx(np.zeros((2, len(ones))), abs=1e-8)
    assert flat.at_points(ones) == pytest.approx(np.ones(len(tube.pattern.flat_points)), rel=1e-11)


@pytest.mark.parametrize("name", ["cone", "helmholtz"])
def test_filter_does_not_depend_on_ranks(name: str, tube: Skin) -> None:
    alone = sew(MPI.COMM_SELF, tube.pattern)
    density = np.random.default_rng(0).random(len(tube.pattern.panel))
    results = []
    for skin in (tube, alone):
        flat, mine = make_filter(name, skin, 8e-3), density[skin.owned_cells]
        slope = skin.gather_cells(flat.slope(mine).T)
        results.append((skin.gather_cells(flat.forward(mine)), slope, flat.at_points(mine)))
    for one, other in zip(*results, strict=True):
        assert one == pytest.approx(other, rel=1e-10, abs=1e-10)


def test_slope_is_the_gradient_of_the_cone(tube: Skin) -> None:
    """Against differences of the filtered field, which `at_points` gives at any points."""
    pattern = tube.pattern
    density = np.random.default_rng(0).random(len(pattern.panel))
    cone = ConeFilter(tube, 8e-3)
    slope = tube.gather_cells(cone.slope(density[tube.owned_cells]).T)
    step = 1e-7
    cells = np.random.default_rng(1).choice(len(pattern.panel), 20, replace=False)

    def value(cell: int, shift: np.ndarray) -> float:
        distance = np.linalg.norm(pattern.centroids[cell] + shift - pattern.centroids, axis=1)
        weight = np.maximum(8e-3 - distance, 0) * pattern.areas
        weight *= pattern.panel == pattern.panel[cell]
        return float(weight @ density / weight.sum())

    for cell in cells:
        for axis in range(2):
            shift = step * np.eye(2)[axis]
            difference = (value(cell, shift) - value(cell, -shift)) / (2 * step)
            assert slope[cell, axis] == pytest.approx(difference, rel=1e-4, abs=1e-2)


def test_at_points_is_the_filtered_field(tube: Skin) -> None:
    """Exact at the vertices, and the nearest triangle's where nothing is within reach."""
    pattern = tube.pattern
    density = np.random.default_rng(0).random(len(pattern.panel))
    cone = ConeFilter(tube, 8e-3)
    found = cone.at_points(density[tube.owned_cells])
    for point in (0, 11, len(found) - 1):
        panel = pattern.panel[np.any(pattern.flat_triangles == point, axis=1)][0]
        distance = np.linalg.norm(pattern.flat_points[point] - pattern.centroids, axis=1)
        weight = np.maximum(8e-3 - distance, 0) * pattern.areas * (pattern.panel == panel)
        assert found[point] == pytest.approx(weight @ density / weight.sum(), rel=1e-12)
    with pytest.warns(UserWarning, match="hardly filters"):
        narrow = ConeFilter(tube, 1e-4)
    assert narrow.forward(density[tube.owned_cells]) == pytest.approx(density[tube.owned_cells])
    lone = narrow.at_points((pattern.panel == pattern.panel_index("tip")).astype(float)[
        tube.owned_cells])  # fmt: skip
    tip = np.unique(pattern.flat_triangles[pattern.cells_of("tip")])
    assert np.all(lone[tip] == 1), "the nearest triangle is one of the same panel"
    assert lone.sum() == len(tip)


def test_cone_on_a_torus(comm: MPI.Comm) -> None:
    """A tile filters as the middle one of nine tiles does."""
    size, n, radius = 0.02, 6, 8e-3
    tile = sew(comm, square(n=n, size=size))
    density = np.random.default_rng(0).random(2 * n * n)
    cone = ConeFilter(tile, radius, lattice=size * np.eye(2))
    found = tile.gather_cells(cone.forward(density[tile.owned_cells]))
    pattern = tile.pattern
    every = [pattern.centroids + [i * size, j * size] for i in (-1, 0, 1) for j in (-1, 0, 1)]
    distance = np.linalg.norm(pattern.centroids[:, None] - np.concatenate(every)[None], axis=2)
    weight = np.maximum(radius - distance, 0) * np.tile(pattern.areas, 9)
    expected = weight @ np.tile(density, 9) / weight.sum(axis=1)
    assert found == pytest.approx(expected, rel=1e-12)
    slanted = ConeFilter(tile, 6e-3, lattice=size * np.array([[1.0, 0.0], [1.0, 1.0]]))
    straight = ConeFilter(tile, 6e-3, lattice=size * np.eye(2))
    mine = density[tile.owned_cells]
    assert slanted.forward(mine) == pytest.approx(straight.forward(mine), rel=1e-12)
    with pytest.raises(errors.ParameterError, match="wider than twice the radius"):
        ConeFilter(tile, 0.011, lattice=size * np.eye(2))
    with pytest.raises(errors.ParameterError, match="two vectors"):
        ConeFilter(tile, radius, lattice=np.ones(2))


def test_helmholtz_of_a_half_plane(comm: MPI.Comm) -> None:
    """Against the exact response to a straight edge."""
    skin = sew(comm, cylinder(comm, 0.05, 0.02, 1.2e-3))
    pattern, radius, edge = skin.pattern, 9e-3, 0.025
    step = (pattern.centroids[skin.owned_cells, 1] > edge).astype(float)
    step[pattern.panel[skin.owned_cells] == pattern.panel_index("tip")] = 1.0
    filtered = skin.gather_cells(HelmholtzFilter(skin, radius).forward(step))
    wall = pattern.cells_of("wall")
    d = (pattern.centroids[wall, 1] - edge) / radius
    exact = 0.5 + 0.5 * np.sign(d) * (1 - np.exp(-np.abs(d) * 2 * np.sqrt(3)))
    near = np.abs(d) < 1
    assert np.abs(filtered[wall[near]] - exact[near]).max() < 0.05
    assert np.abs(filtered[wall[near]] - exact[near]).mean() < 0.012
    assert filtered.min() >= 0
    assert filtered.max() <= 1


def test_helmholtz_crosses_seams_the_cone_does_not(tube: Skin) -> None:
    pattern = tube.pattern
    cap = pattern.panel[tube.owned_cells] == pattern.panel_index("base")
    density = cap.astype(float)
    wall = pattern.cells_of("wall")
    near = wall[pattern.centroids[wall, 1] < 3e-3]
    assert tube.gather_cells(HelmholtzFilter(tube, 8e-3).forward(density))[near].min() > 0.1
    assert tube.gather_cells(ConeFilter(tube, 8e-3).forward(density))[near].max() == 0
    # Left and right border of the wall are one line of the skin.
    left = pattern.centroids[:, 0] < 4e-3
    density = (left & (pattern.panel == pattern.panel_index("wall"))).astype(float)
    across = wall[pattern.centroids[wall, 0] > pattern.centroids[wall, 0].max() - 2e-3]
    found = tube.gather_cells(HelmholtzFilter(tube, 8e-3).forward(density[tube.owned_cells]))
    assert found[across].min() > 0.1


def test_filters_by_name(tube: Skin) -> None:
    assert make_filter("cone", tube, 8e-3).name == "cone"
    with pytest.raises(errors.ParameterError, match="filter = 'gauss'"):
        make_filter("gauss", tube, 8e-3)
    with pytest.raises(errors.ParameterError, match="radius = 0"):
        make_filter("helmholtz", tube, 0.0)
    with pytest.warns(UserWarning, match="under 1.5 edge lengths"):
        HelmholtzFilter(tube, 3e-3)


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
