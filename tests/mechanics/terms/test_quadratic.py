"""Quadratic displacement in the plane: no locking in bending, nothing else changes."""

import numpy as np
import pytest
from helpers.models import affine
from helpers.scenes import square
from mpi4py import MPI

from toros_fem.materials.sheet import Bending, Composite, Material
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.dead_loads import point_force
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.patch_space import pattern_edges
from toros_fem.mechanics.skin.supports import Supports, clamp, pin, symmetry_plane
from toros_fem.mechanics.terms.model import make_model
from toros_fem.meshes import cylinder, mirrored, sew
from toros_fem.meshes.sheets import rectangle

SHEET = Material(1e6, 0.3, 1e-3)
WIDE = Composite(SHEET, SHEET, c1=1e3, c2=1e3, bending=None)  # eq. (1) without its bounds


def test_a_uniform_strain_needs_no_bubbles(comm: MPI.Comm) -> None:
    """The patch test: no force acts on vertices and bubbles inside."""
    skin, F = sew(comm, square(n=4)), np.array([[1.2, 0.1], [0.05, 0.9], [0.3, -0.2]])
    pattern, everywhere = skin.pattern, np.ones(len(skin.pattern.panel), dtype=bool)
    model = make_model(skin, WIDE, pin(pattern), quadratic=everywhere)
    plain = make_model(skin, WIDE, pin(pattern))
    for one in (model, plain):
        one.set_density(np.ones(len(skin.owned_cells)))
    stretched = affine(model, F)
    assert model.energy(stretched) == pytest.approx(plain.energy(affine(plain, F)), rel=1e-12)
    force = model.variation(stretched)
    edge, (bubbles,) = pattern_edges(skin)[0], model.patch.dofs
    owned = bubbles[:, 0] < len(force)
    of_edges, inner = force[bubbles[owned]], pattern.edges.count[edge[owned]] == 2
    inside = np.all(np.abs(pattern.points[:, :2] - 0.01) < 0.0099, axis=1)[skin.owned_vertices]
    largest = comm.allreduce(float(np.abs(of_edges).max(initial=0.0)), op=MPI.MAX)
    assert largest > 0, "border edges are pulled"
    assert np.abs(of_edges[inner]).max(initial=0.0) < 1e-9 * largest
    assert np.abs(model.positions(force)[inside]).max(initial=0.0) < 1e-9 * largest


def test_a_line_one_triangle_wide_bends(comm: MPI.Comm) -> None:
    """A cantilever of 30 squares under a force at its tip, in its plane: F l³/(3 E h I)."""
    length, width, force = 0.03, 1e-3, 1e-6
    pattern = rectangle(comm, length, width, width, "union-jack")
    skin = sew(comm, pattern)
    fixed = np.zeros(pattern.points.shape, dtype=bool)
    fixed[:, 2] = True
    fixed[pattern.points[:, 0] < 1e-9] = True
    loads = point_force(pattern, (length, width / 2, 0.0), (0.0, force, 0.0))
    expected = force * length**3 / (3 * SHEET.membrane_stiffness * width**3 / 12)
    ways = []
    for quadratic in (False, True):
        cells = np.full(len(pattern.panel), quadratic)
        solver = EquilibriumSolver(skin, WIDE, Supports(fixed), quadratic=cells)
        found = solver.solve(np.ones(len(skin.owned_cells)), Load(0.0, force=loads))
        tip = skin.gather_vertices(found.positions)[pattern.points[:, 0] > length - 1e-9, 1]
        ways.append((tip.mean() - width / 2) / expected)
    assert ways[0] < 0.35, "constant strains lock"
    assert ways[1] == pytest.approx(1.0, abs=0.02)


def test_half_a_skin_is_half_of_the_whole(alone: MPI.Comm) -> None:
    """In the symmetry plane bubbles move along their edges only."""
    pattern = cylinder(alone, 0.04, 0.02, 4e-3, planes=(1,))
    composite = Composite(bending=Bending("midedge"))
    whole = mirrored(pattern, (1,))
    stripe = np.abs(pattern.points[pattern.triangles].mean(axis=1)[:, 2] - 0.02) < 6e-3

    def solved(part: bool) -> Equilibrium:
        own = pattern if part else whole.pattern
        supports = clamp(own, ["base"])
        if part:
            supports |= symmetry_plane(own, 1)
        printed = stripe if part else stripe[whole.cell]
        solver = EquilibriumSolver(sew(alone, own), composite, supports, quadratic=printed)
        return solver.solve(printed[solver.skin.owned_cells].astype(float), 4e3)

    half, both = solved(True), solved(False)
    there = np.zeros_like(whole.pattern.points)
    at = np.zeros_like(pattern.points)
    skins = sew(alone, pattern), sew(alone, whole.pattern)
    at[:], there[:] = (
        s.gather_vertices(e.positions) for s, e in zip(skins, (half, both), strict=True)
    )
    assert np.abs(whole.at_vertices(at) - there).max() < 1e-8
    assert 2 * half.energy == pytest.approx(both.energy, rel=1e-8)
