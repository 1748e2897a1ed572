"""Cost of a scene before it runs, and the probe that its time comes from."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from mpi4py import MPI

from toros_fem.base.scene import Scene
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.meshes import sew
from toros_fem.meshes.triangle_limit import expected_triangles, require_affordable
from toros_fem.products.actuators.cost import (
    Cost,
    Part,
    Probe,
    cost,
    probe,
    probe_level,
    probe_problem,
    simple_cost,
    sized,
)
from toros_fem.products.actuators.scene import ActuatorScene
from toros_fem.products.tile_design.case import tile_problem
from toros_fem.products.tile_design.tile import TileScene, tile_case
from toros_fem.products.tubes.inflate import InflateScene
from toros_fem.products.tubes.tube import plain_planes, plain_tube

# Edges around the tube of an inflation's probe, at least.
PROBE_AROUND = 36


def scene_cost(
    comm: MPI.Comm, scene: Scene, files: Mapping[str, Path], *, probing: bool
) -> tuple[Cost, Probe | None] | None:
    """Return cost and probe of a design or an inflation; None for other kinds (collective).

    Args:
        comm: Communicator.
        scene: The scene.
        files: Files that it takes, by name.
        probing: Whether to try some steps on a coarse mesh.

    Raises:
        MeshSizeError: A mesh would have more triangles than the limit.
    """
    if isinstance(scene, ActuatorScene):
        return _actuator(comm, scene, files, probing=probing)
    if isinstance(scene, TileScene):
        return _tile(comm, scene, probing=probing)
    if isinstance(scene, InflateScene):
        return _inflation(comm, scene, probing=probing)
    return None


def _actuator(
    comm: MPI.Comm, scene: ActuatorScene, files: Mapping[str, Path], *, probing: bool
) -> tuple[Cost, Probe | None]:
    """Return the cost of a design, and the probe that its time comes from (collective)."""
    scene = scene.with_files(comm, files)
    made = sized(comm, scene, probe_level(scene))
    # What is too large for a quick look is too large for a probe.
    tried = probe(comm, scene, made.case) if probing and made.case is not None else None
    return cost(scene, made, comm.size), tried


def _tile(comm: MPI.Comm, config: TileScene, *, probing: bool) -> tuple[Cost, Probe | None]:
    """Return the cost of the design of a tile, and its probe on the mesh of the starts."""
    require_affordable(config.skin.size**2, config.skin.edge_length / 2)  # the mesh of the prints
    case = tile_case(comm, config)
    assert case.coarse is not None
    assert case.fine is not None
    pattern = case.tile.pattern
    count, rounds = len(pattern.panel), config.design.corrections
    trials = (
        2 * config.design.starts * config.design.trial_iterations
        + 2 * config.design.draft_iterations
    )
    finish = 2 * config.design.finish_iterations + 2
    most = 2 * (finish + rounds * (config.design.correction_iterations + 1))
    parts = (
        Part("random starts", len(case.coarse.pattern.panel), (3 * trials, 12 * trials)),
        Part("design and corrections", count, (3 * finish, 10 * most)),
        Part("prints", len(case.fine.pattern.panel), (20, 60 * (1 + rounds))),
    )
    tried = None
    if probing:
        problem = tile_problem(comm, replace(case, tile=case.coarse), config)
        tried = probe_problem(problem, len(case.coarse.pattern.panel), config.design.seed)
    unknowns = 3 * len(pattern.points)
    return simple_cost(count, len(case.fine.pattern.panel), unknowns, comm.size, parts), tried


def _inflation(comm: MPI.Comm, config: InflateScene, *, probing: bool) -> tuple[Cost, Probe | None]:
    """Return the cost of inflating a tube, and the probe: one equilibrium of a coarser one."""
    planes = () if config.skin.whole else plain_planes(config.material.seams)
    area = (
        np.pi
        * config.skin.diameter
        * (config.skin.length + config.skin.diameter / 2)
        / 2 ** len(planes)
    )
    require_affordable(area, config.skin.edge_length)
    triangles = round(expected_triangles(area, config.skin.edge_length))
    longest = min(np.pi * config.skin.diameter / PROBE_AROUND, config.skin.length / 6)
    coarse = config.updated(edge_length=max(config.skin.edge_length, float(longest)))
    pattern, supports, density = plain_tube(comm, coarse.skin, planes, seams=coarse.material.seams)
    tried = None
    if probing:
        skin = sew(comm, pattern)
        solver = EquilibriumSolver(skin, coarse.material.composite, supports)
        begin = time.perf_counter()
        found = solver.solve(density[skin.owned_cells], coarse.pressure.pressure)
        seconds = comm.bcast(time.perf_counter() - begin)
        tried = Probe(len(pattern.panel), found.steps, seconds)
    parts = (
        Part("pressures", triangles, (4 * config.pressure.levels, 15 * config.pressure.levels)),
    )
    # A closed surface has half as many vertices as triangles, and three edges for two of them.
    unknowns = round((3.0 if config.material.bending == "midedge" else 1.5) * triangles)
    return simple_cost(triangles, triangles, unknowns, comm.size, parts), tried
