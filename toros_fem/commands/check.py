"""`toros check`: what is wrong with a scene file, and what the run will cost."""

from __future__ import annotations

import argparse
import logging
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.actuators.cost import Cost, Probe, cost, probe, probe_config, sized
from toros_fem.commands.command import Answer, Command
from toros_fem.commands.doctor import memory_gib
from toros_fem.commands.scene_options import add_scene_options, meshes_allowed, scene_of
from toros_fem.meshes.triangle_limit import expected_triangles, require_affordable
from toros_fem.scene_files.reading import Scene
from toros_fem.scenes.inflate import InflateConfig
from toros_fem.scenes.tile import TargetTileConfig

log = logging.getLogger(__name__)
# Part of the machine's memory above which a run is warned of.
CROWDED = 0.8


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
        "kind": scene.kind.name,
        "coarse": given.coarse,
        "inputs": scene.config.as_dict(),
    }
    lines = [f"{scene.path} is in order: {scene.kind.about}."]
    with meshes_allowed(given):
        if scene.kind.cases is not None:
            found, tried = _of_actuator(comm, scene, probing=not given.no_probe)
            figures |= _figures(comm, found, tried)
            lines += _lines(comm, found, tried)
        else:
            triangles = _triangles(scene)
            if triangles is not None:
                figures["triangles"] = triangles
                lines.append(f"triangles   about {triangles}")
            lines.append(f"time        not estimated for scenes of the kind {scene.kind.name!r}")
    return Answer("\n".join(lines), figures)


def _of_actuator(comm: MPI.Comm, scene: Scene, *, probing: bool) -> tuple[Cost, Probe | None]:
    """Return the cost of a design, and the probe that its time comes from (collective)."""
    assert scene.kind.cases is not None
    assert scene.kind.design is not None
    files = {name: scene.files.get(name) for name in scene.kind.design.files}
    maker, config = scene.kind.cases(comm, scene.config, **files)
    coarse = probe_config(config)
    made = sized(comm, maker, coarse, config)
    # What is too large for a quick look is too large for a probe.
    tried = probe(comm, made.case, coarse) if probing and made.case is not None else None
    return cost(config, made, comm.size), tried


def _triangles(scene: Scene) -> int | None:
    """Return the expected triangles of a scene without a case; None where they are not known."""
    config = scene.config
    if isinstance(config, InflateConfig):
        area = np.pi * config.diameter * (config.length + config.diameter / 2)
        area /= 1 if config.whole else 2
    elif isinstance(config, TargetTileConfig):
        area = config.size**2
    else:
        return None
    require_affordable(float(area), config.edge_length)
    return round(expected_triangles(float(area), config.edge_length))


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
    more = f", {found.largest} for the estimate of the error" * (found.largest > found.triangles)
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
    "check",
    "reads a scene file and says what is wrong, or what the design will cost",
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
