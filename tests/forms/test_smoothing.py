"""Edge-based smoothing: what it leaves as it is, and what it mends."""

from dataclasses import replace

import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.materials.sheet import Composite, Membrane
from toros_fem.mechanics.assembly.model import SkinModel, make_model
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.readings.error_estimate import limit_shape
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes import Pattern, cylinder, rectangle, sew

SIZE = 0.02
SMOOTHED = Composite(membrane=Membrane(strain="smoothed"))


def model_of(comm: MPI.Comm, pattern: Pattern, composite: Composite) -> SkinModel:
    fixed = np.ones(pattern.points.shape, dtype=bool)
    return make_model(sew(comm, pattern), composite, Supports(fixed))


def drawn(model: SkinModel) -> np.ndarray:
    """Return densities by the triangles' numbers in the pattern: equal on any partition."""
    every = np.random.default_rng(3).uniform(0, 1, len(model.skin.pattern.panel))
    return every[model.skin.owned_cells]


def test_an_even_strain_stays_what_it_is(comm: MPI.Comm) -> None:
    """Across seams, for any densities."""
    pattern = cylinder(comm, 0.05, SIZE, 5e-3, caps=None)
    energies = []
    for composite in (SMOOTHED, Composite()):
        model = model_of(comm, pattern, replace(composite, bending=None))
        model.set_density(drawn(model))
        angle = np.arctan2(*pattern.points[:, 1::-1].T)
        around = 1.3 * SIZE / 2 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        there = np.column_stack([around, 1.1 * pattern.points[:, 2]])
        energies.append(model.energy(model.state_of(there[model.skin.owned_vertices])))
    assert energies[0] == pytest.approx(energies[1], rel=2e-3)
    assert energies[0] != energies[1], "a polygon is not even"


@pytest.mark.parametrize("rows", [1, 2])
def test_a_strip_bends_in_its_plane_and_locks_less(comm: MPI.Comm, rows: int) -> None:
    """Of triangles in rows, as thin as a printed line: those of constant strain lock."""
    length, width, curvature = 0.04, 4e-3, 2.0
    pattern = rectangle(comm, length, width, width / rows)
    x, y = (pattern.points[:, :2] - pattern.points[:, :2].min(axis=0) - [0, width / 2]).T
    radius, nu = 1 / curvature, SMOOTHED.fabric.poisson
    out = radius - y - nu * curvature / 2 * (y**2 - width**2 / 12)
    place = np.column_stack([out * np.sin(x / radius), radius - out * np.cos(x / radius), 0 * x])
    sheet = SMOOTHED.fabric
    exact = sheet.membrane_stiffness * width**3 / 12 * curvature**2 / 2 * length
    ratio = []
    for composite in (SMOOTHED, Composite()):
        model = model_of(comm, pattern, replace(composite, bending=None))
        model.set_density(np.zeros(len(model.skin.owned_cells)))
        state = model.state_of(place[model.skin.owned_vertices])
        ratio.append(model.energy(state) / exact)
    assert 0 < ratio[0] - 1 < 0.2 * (ratio[1] - 1)


def test_ranks_find_the_same_limit(comm: MPI.Comm, alone: MPI.Comm) -> None:
    """Smoothing sees triangles of other ranks."""
    found = []
    for on in (comm, alone):
        pattern = cylinder(on, 0.05, SIZE, 5e-3, mesh="structured")
        skin = sew(on, pattern)
        fixed = np.zeros(pattern.points.shape, dtype=bool)
        fixed[pattern.vertices_of("base")] = True
        solver = EquilibriumSolver(skin, SMOOTHED, Supports(fixed))
        helix = (pattern.centroids @ [1.0, 1.0]) % 0.02 < 0.008
        result = solver.solve(helix.astype(float)[skin.owned_cells], 2e3)
        found.append(limit_shape(solver, result))
    assert found[0].limit == pytest.approx(found[1].limit, abs=1e-9)
    assert np.abs(found[0].limit - found[0].computed).max() > 1e-5
