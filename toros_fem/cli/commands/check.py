"""`toros check`: what is wrong with a scene file, and what the run will cost."""

from __future__ import annotations

import argparse
import logging
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.cli.command_line.command import Answer, Command
from toros_fem.cli.command_line.scene_options import add_scene_options, meshes_allowed, scene_of
from toros_fem.cli.commands.doctor import memory_gib
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

log = logging.getLogger(__name__)
# Part of the machine's memory above which a run is warned of.
CROWDED = 0.8
# Edges around the tube of an inflation's probe, at least.
PROBE_AROUND = 36


def _options(parser: argparse.ArgumentParser) -> None:
    add_scene_options(parser)
    parser.add_argument(
        "--no-probe",
        action="store_true",
        help="leave out the probe, and with it the time; default no",
    )


def _run(comm: MPI.Comm, given: argparse.Namespace) -> Answer:
    scene = scene_of(comm, given)
    figures: dict[str, Any] = {
        "file": scene.path,
        "kind": scene.kind.KIND,
        "coarse": given.coarse,
        "inputs": scene.config.as_dict(),
        "materials": {role: entry.name for role, entry in scene.materials.items()},
    }
    lines = [f"{scene.path} is in order: {scene.kind.ABOUT}."]
    lines += [
        f"{role:15s}{entry.name}: {entry.title} ({entry.trust})"
        for role, entry in scene.materials.items()
    ]
    with meshes_allowed(given):
        if isinstance(scene.config, ActuatorScene):
            found, tried = _of_actuator(comm, scene.config, scene.files, probing=not given.no_probe)
            figures |= _figures(comm, found, tried)
            lines += _lines(comm, found, tried)
        elif isinstance(scene.config, TileScene):
            found, tried = _of_tile(comm, scene.config, probing=not given.no_probe)
            figures |= _figures(comm, found, tried)
            lines += _lines(comm, found, tried)
        elif isinstance(scene.config, InflateScene):
            found, tried = _of_inflation(comm, scene.config, probing=not given.no_probe)
            figures |= _figures(comm, found, tried)
            lines += _lines(comm, found, tried)
        else:
            lines.append(f"The cost of scenes of the kind {scene.kind.KIND!r} is not estimated.")
    return Answer("\n".join(lines), figures)


def _of_actuator(
    comm: MPI.Comm, scene: ActuatorScene, files: Mapping[str, Path], *, probing: bool
) -> tuple[Cost, Probe | None]:
    """Return the cost of a design, and the probe that its time comes from (collective)."""
    scene = scene.with_files(comm, files)
    made = sized(comm, scene, probe_level(scene))
    # What is too large for a quick look is too large for a probe.
    tried = probe(comm, scene, made.case) if probing and made.case is not None else None
    return cost(scene, made, comm.size), tried


def _of_tile(comm: MPI.Comm, config: TileScene, *, probing: bool) -> tuple[Cost, Probe | None]:
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


def _of_inflation(
    comm: MPI.Comm, config: InflateScene, *, probing: bool
) -> tuple[Cost, Probe | None]:
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


def _figures(comm: MPI.Comm, found: Cost, tried: Probe | None) -> dict[str, Any]:
    figures: dict[str, Any] = {
        "triangles": found.triangles,
        "largest_triangles": found.largest,
        "unknowns": found.unknowns,
        "memory_gib": found.memory / 2**30,
        "machine_gib": memory_gib(),
        "ranks": comm.size,
        "parts": [
            {"name": p.name, "triangles": p.triangles, "newton_steps": p.newton_steps}
            for p in found.parts
        ],
        "minutes": None,
        "probe": None,
    }
    if tried is not None:
        low, high = found.seconds(tried.per_step, tried.triangles)
        figures["minutes"] = [low / 60, high / 60]
        figures["probe"] = {
            "triangles": tried.triangles,
            "newton_steps": tried.newton_steps,
            "seconds": tried.seconds,
        }
    return figures


def _lines(comm: MPI.Comm, found: Cost, tried: Probe | None) -> list[str]:
    memory, machine = found.memory / 2**30, memory_gib()
    if machine is not None and memory > CROWDED * machine and comm.rank == 0:
        log.warning(
            "about %.1f GiB are needed, and this machine has %.1f GiB: take longer edges, or leave "
            "out estimate_error, which refines the mesh",
            memory,
            machine,
        )
    of = "" if machine is None else f" of {machine:.1f} GiB"
    more = f", {found.largest} on a refined one" * (found.largest > found.triangles)
    lines = [
        f"triangles   about {found.triangles} on the finest mesh{more}",
        f"unknowns    about {found.unknowns} on the finest mesh",
        f"memory      about {memory:.1f} GiB{of}, to a quarter",
    ]
    if tried is None:
        return [*lines, "time        not estimated without a probe"]
    low, high = found.seconds(tried.per_step, tried.triangles)
    ranks = "1 rank" if comm.size == 1 else f"{comm.size} ranks"
    lines += [
        f"time        {_duration(low)} to {_duration(high)} on {ranks}",
        f"probe       {tried.newton_steps} Newton steps on {tried.triangles} triangles in "
        f"{tried.seconds:.1f} s; other meshes by the measured growth",
    ]
    for part in found.parts:
        few, many = (f"{n}" for n in part.newton_steps)
        lines.append(f"  {part.name}: {few} to {many} Newton steps on {part.triangles} triangles")
    return lines


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} minutes" if seconds < 5400 else f"{seconds / 3600:.1f} hours"


COMMAND = Command(
    "Everything is read. An error names file, line and key, and the nearest right key. Otherwise\n"
    "it says how many triangles and unknowns there will be, the memory, and the time, from a few\n"
    "real steps on a coarse mesh. Meshes of too many triangles are refused before they are made.",
    (
        "toros check mine.toml",
        'toros check mine.toml --coarse --set edge_length="2 mm"',
        "toros check mine.toml --no-probe --json",
    ),
    _options,
    _run,
)
