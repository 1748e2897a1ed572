"""Sheets, and grids, rings and polygons."""

from __future__ import annotations

from collections.abc import Generator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import gmsh
import numpy as np
import pytest
from helpers.models import pressurize
from helpers.scenes import TABLE_A, table
from helpers.surfaces import cap
from mpi4py import MPI

from toros_fem.base.mpi import norm
from toros_fem.design.density.filters import make_filter
from toros_fem.materials.sheet import Bending, Composite, Material
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.supports import Supports, clamp_where, symmetry_plane
from toros_fem.mechanics.terms.model import make_model
from toros_fem.meshes import Pattern, cylinder, moulded, sew
from toros_fem.meshes.sheets import polygon_mesh
from toros_fem.meshes.transfer import refine
from toros_fem.meshes.triangles import edges_of, flat_areas

TRIANGLE = np.array([[0.0, 0.0], [0.01, 0.0], [0.0, 0.01]])


def test_diagonals_of_the_wall() -> None:
    """Each rectangle is cut the other way by "left"; by turns; or in four."""
    rising = {}
    for mesh in ("structured", "left", "union-jack", "crossed"):
        tube = cylinder(MPI.COMM_SELF, 0.06, 0.02, 4e-3, mesh=mesh, caps=None)
        sides = tube.corners - np.roll(tube.corners, 1, axis=1)
        across = sides[(np.abs(sides) > 1e-6).all(axis=2)]
        rising[mesh] = (across[:, 0] * across[:, 1] > 0).mean()
    assert rising == pytest.approx(
        {"structured": 0, "left": 1, "union-jack": 0.5, "crossed": 0.5}, abs=0.01
    )


RADIUS, AT = 0.01, 0.03


def half_sphere(rows: int) -> Pattern:
    surface, _ = cap(rows, np.pi / 2, RADIUS)
    return moulded(surface.points + [0, 0, AT], surface.triangles)


def rim_of(pattern: Pattern) -> Supports:
    """The rim held, and closed by its plane."""
    return replace(clamp_where(pattern, lambda x: x[:, 2] < AT + 1e-6), planes=((2, AT),))


def test_charts_are_congruent_and_apart() -> None:
    pattern = half_sphere(4)
    for i in range(3):
        flat = pattern.corners[:, i] - pattern.corners[:, i - 1]
        there = pattern.points[pattern.triangles]
        space = there[:, i] - there[:, i - 1]
        assert np.linalg.norm(flat, axis=1) == pytest.approx(np.linalg.norm(space, axis=1))
    low, high = pattern.corners.min(axis=1), pattern.corners.max(axis=1)
    one, two = np.triu_indices(len(low), 1)
    apart = (low[one] > high[two]) | (low[two] > high[one])
    assert apart.any(axis=1).all()
    assert refine(pattern).pattern.moulded


@pytest.mark.parametrize("curvature", ["average", "midedge"])
def test_without_load_it_is_at_rest(alone: MPI.Comm, curvature: str) -> None:
    pattern = half_sphere(4)
    skin = sew(alone, pattern)
    held = rim_of(pattern)
    bending = Bending(curvature=curvature, rest="assembled")
    soft = Material(26e6, 0.3, 0.5e-3)
    solver = EquilibriumSolver(skin, Composite(reinforcement=soft, bending=bending), held)
    model, density = solver.model, np.full(len(skin.owned_cells), 0.5)
    model.set_density(density)
    pressurize(model, 0.0)
    scale = model.mean_modulus() * RADIUS
    assert abs(model.energy(model.assembled)) < 1e-12 * scale * RADIUS
    assert norm(alone, model.residual(model.assembled)) < 1e-12 * scale
    flat = make_model(skin, Composite(bending=Bending(curvature=curvature)), held)
    flat.set_density(density)
    assert flat.energy(flat.assembled) > 1e-9 * scale * RADIUS, "moments, in a shape bent from flat"
    loaded = solver.solve(density, 1e3)
    assert loaded.volume > 1.001 * model.volumes(model.assembled).sum()


def test_half_a_sphere_grows_as_the_sphere_of_eq_1(alone: MPI.Comm) -> None:
    """At second order, up to stretches of 1.46."""
    rows = [r for r in table("gent_cylinder_inflation") if r["mat"] == "A"]
    sheet = Composite(fabric=TABLE_A, c1=1.8, c2=2.0, bending=None)
    for pressure in ("1000", "10000"):
        row = next(r for r in rows if r["P_Pa"] == pressure)
        off = []
        for n in (4, 8):
            pattern = half_sphere(n)
            fixed = np.zeros((len(pattern.points), 3), dtype=bool)
            fixed[0, :2] = True  # the pole
            fixed[np.argmax(pattern.points[:, 0]), 1] = True
            supports = Supports(fixed) | symmetry_plane(pattern, 2, AT)
            skin = sew(alone, pattern)
            solver = EquilibriumSolver(skin, sheet, supports)
            found = solver.solve(np.zeros(len(skin.owned_cells)), float(pressure))
            stretch = (found.volume / (2 / 3 * np.pi * RADIUS**3)) ** (1 / 3)
            off.append(abs(stretch / float(row["lambda_sphere"]) - 1))
        assert off[1] < 0.006
        assert np.log2(off[0] / off[1]) == pytest.approx(2, abs=0.3)


def test_the_filter_without_panels_takes_it(alone: MPI.Comm) -> None:
    skin = sew(alone, half_sphere(4))
    density = np.random.default_rng(0).random(len(skin.owned_cells))
    assert np.std(make_filter("helmholtz", skin, 6e-3).forward(density)) < 0.7 * np.std(density)


@pytest.fixture
def session() -> Generator[None]:
    """Gmsh as another program has it open."""
    gmsh.initialize(["-noenv"], readConfigFiles=False, interruptible=False)
    yield
    gmsh.finalize()


def test_it_is_closed_where_it_was_not_open() -> None:
    assert not gmsh.isInitialized()
    polygon_mesh(TRIANGLE, 0.01)
    assert not gmsh.isInitialized()


def test_threads_wait_for_each_other() -> None:
    edges = [2e-3, 1e-3, 5e-4, 2.5e-4]
    with ThreadPoolExecutor(4) as pool:
        meshes = list(pool.map(lambda edge: polygon_mesh(TRIANGLE, edge), edges))
    for edge, (points, triangles) in zip(edges, meshes, strict=True):
        alone = polygon_mesh(TRIANGLE, edge)
        assert np.array_equal(points, alone[0])
        assert np.array_equal(triangles, alone[1])


@pytest.mark.usefixtures("session")
def test_a_model_of_the_user_is_left_alone() -> None:
    gmsh.model.add("mine")
    polygon_mesh(TRIANGLE, 0.01)
    assert gmsh.isInitialized()
    assert gmsh.model.getCurrent() == "mine"
    assert gmsh.model.list() == ["", "mine"]


@pytest.mark.usefixtures("session")
def test_options_of_the_user_are_left_alone() -> None:
    own = {
        "General.Terminal": 1, "Mesh.Algorithm": 5, "Mesh.RandomSeed": 3, "Mesh.MeshSizeMin": 2e-3,
        "Mesh.MeshSizeMax": 0.5, "General.NumThreads": 2,
    }  # fmt: skip
    for name, value in own.items():
        gmsh.option.setNumber(name, value)
    polygon_mesh(TRIANGLE, 0.01)
    assert {name: gmsh.option.getNumber(name) for name in own} == own


def test_polygons_share_their_common_side() -> None:
    corners = np.array([[0.0, 0.0], [0.02, 0.0], [0.02, 0.02], [0.0, 0.02], [0.05, 0.01]])
    flat, triangles = polygon_mesh(
        corners, 6e-3, counts=[4, 3, 4, 3, 6], faces=[np.array([0, 1, 2, 3]), np.array([1, 4, 2])]
    )
    edges = edges_of(triangles)
    assert flat_areas(flat[triangles]).min() > 0
    assert flat_areas(flat[triangles]).sum() == pytest.approx(4e-4 + 3e-4, rel=1e-9)
    middle = flat[edges.ends[edges.inner]].mean(axis=1)
    assert np.count_nonzero(np.abs(middle[:, 0] - 0.02) < 1e-12) == 3, "edges on it, all inner"
    assert len(np.unique(np.round(flat, 9), axis=0)) == len(flat)
