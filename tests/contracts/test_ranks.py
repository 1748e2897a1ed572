"""Several ranks find what one finds, from the mesh to a design; `test_pairs` does so for stages."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from helpers.designs import full, shape_design
from helpers.pillow import pillow
from helpers.scenes import TABLE_A
from helpers.standing import solver_on_base
from helpers.worn import printed_tube
from mpi4py import MPI

import toros_fem as tf
from toros_fem.design.density.filters import make_filter
from toros_fem.design.loop.fields import random_density
from toros_fem.design.loop.levels import optimize_levels
from toros_fem.design.loop.loop import optimize
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.design.relaxed.problem import FixedDirections, relaxed_problem
from toros_fem.materials.sheet import Bending, Bladder, Composite
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.readings.wrinkles import wrinkle_field
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.dead_loads import spread_force
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import build_in, clamp, displace
from toros_fem.mechanics.terms.loads import Weight
from toros_fem.meshes import Pattern, Skin, bend, cylinder, rectangle, sew

Found = dict[str, Any]


@cache
def tube(edge: float = 4.5e-3) -> Pattern:
    return cylinder(MPI.COMM_SELF, 0.06, 0.02, edge)


def drawn(skin: Skin) -> np.ndarray:
    return np.asarray(np.random.default_rng(5).random(len(skin.pattern.panel))[skin.owned_cells])


def densities(comm: MPI.Comm) -> Found:
    """A filtered field at all points of the panels, and two random starts."""
    skin = sew(comm, tube())
    found: Found = {"random": skin.gather_cells(random_density(skin, 7))}
    for name in ("cone", "helmholtz"):
        found[name] = make_filter(name, skin, 8e-3).at_points(drawn(skin))
    plain = full(skin, EquilibriumSolver(skin, Composite(), clamp(skin.pattern, ["base"])))
    problem = relaxed_problem(plain, FixedDirections(4, 0.3), 0.015)
    found["start"] = skin.gather_cells(problem.fields.start(3).reshape(-1, 4))
    return found


def cantilever(comm: MPI.Comm) -> Found:
    """A sheet that bends under its weight."""
    pattern = rectangle(MPI.COMM_SELF, 0.06, 0.02, 5e-3, "unstructured")
    skin, supports = sew(comm, pattern), build_in(pattern, pattern.points[:, 0] < 1e-9)
    sheet = Composite(fabric=TABLE_A, bending=Bending())
    solver = EquilibriumSolver(skin, sheet, supports)
    weight = np.asarray(pattern.vertex_areas[:, None] * [0.0, 0.0, -10.0])
    result = solver.solve(np.zeros(len(skin.owned_cells)), Load(0.0, force=weight))
    return {"positions": skin.gather_vertices(result.positions)}


def wrinkles(comm: MPI.Comm) -> Found:
    """Half of a flat pillow, whose sheet wrinkles."""
    solver = pillow(comm)
    density = 0.1 + 0.8 * drawn(solver.skin)
    result = solver.solve(density, 300.0)
    field = wrinkle_field(solver, density, result)
    along = np.einsum("ki,kj->kij", field.flat, field.flat)  # a direction has no sign
    found = {"state": field.state, "along": along}
    return {**found, "x": solver.skin.gather_vertices(result.positions)}


def everything(comm: MPI.Comm) -> Found:
    """Two chambers, a moved end, weight, a held load and a bladder; cold, then warm."""
    pattern = tube()
    upper = pattern.points[pattern.triangles].mean(axis=1)[:, 2] > 0.03
    supports = clamp(pattern, ["base"]) | displace(pattern, ["tip"], [0.004, 0.0, 0.006])
    composite = dataclasses.replace(Composite(), bladder=Bladder(0.29e6, 0.2e-3))
    skin = sew(comm, pattern)
    solver = EquilibriumSolver(
        skin, composite, supports, chambers=Chambers(("lower", "upper"), upper.astype(int)),
        weight=Weight(0.2, 2.0),
    )  # fmt: skip
    force = spread_force(pattern, "wall", [0.0, 0.1, 0.0])
    cold = solver.solve(drawn(skin), Load((4e3, 1e3), force=force))
    warm = solver.solve(drawn(skin), Load((2e3, 3e3), force=force), start=cold)
    found: Found = {"reactions": solver.reactions(warm)}
    for name, result in (("cold", cold), ("warm", warm)):
        found[name] = skin.gather_vertices(result.positions)
        found[f"{name} volumes"] = np.array(result.volumes)
    return found


def design(comm: MPI.Comm) -> Found:
    """Ten steps, of which four keep widths."""
    skin = sew(comm, tube())
    solver = solver_on_base(skin)
    options = DesignOptions((Stage(6), Stage(4, constrained=True)))
    result = optimize(full(skin, solver, beta=20.0), options, start=random_density(skin, 3))
    first, last = result.history[0], result.history[-1]
    return {
        name: np.array([getattr(row, name) for row in (first, last)])
        for name in ("objective", "gradient_norm", "pressure")
    } | {"widths": np.array([last.g_r])}


def levels(comm: MPI.Comm) -> Found:
    """All of what is carried over to a finer mesh, and a step from there."""
    problems = (
        shape_design(
            comm, tube(factor * 3.2e-3), target=bend(np.radians(45), 0.06, neutral=0.01),
            supports=clamp(tube(factor * 3.2e-3), ["base"]), printed_panels=["base", "tip"],
            filter_radius=factor * 5e-3, pressure=5e3, pressure_bounds=(1e3, 20e3),
        )
        for factor in (3.0, 2.0)
    )  # fmt: skip
    options = [DesignOptions((Stage(2),)), DesignOptions((Stage(1, constrained=True),))]
    rows = optimize_levels(problems, options, seed=3).history
    return {"objective": np.array([row.objective for row in rows])}


def tolerances(comm: MPI.Comm) -> Found:
    found = tf.tolerances(*printed_tube(comm))
    return {
        f"{v.quantity} {v.label}": np.array([v.values[key] for key in v.values])
        for v in found.variants
    }


ROWS: dict[str, tuple[Callable[[MPI.Comm], Found], float]] = {
    "densities": (densities, 1e-10),
    "cantilever": (cantilever, 1e-7),
    "wrinkles": (wrinkles, 1e-6),
    "everything": (everything, 1e-6),
    "design": (design, 1e-6),
    "levels": (levels, 1e-6),
    "tolerances": (tolerances, 1e-6),
}


@pytest.mark.parametrize(("call", "tolerance"), ROWS.values(), ids=ROWS)
def test_same_on_ranks(call: Callable[[MPI.Comm], Found], tolerance: float, comm: MPI.Comm) -> None:
    if comm.size == 1:
        pytest.skip("needs two ranks to compare with one")
    found, alone = call(comm), call(MPI.COMM_SELF)
    assert list(found) == list(alone)
    for name, expected in alone.items():
        largest = np.abs(expected).max()
        assert largest > 0
        assert found[name] == pytest.approx(expected, abs=tolerance * largest), name
