"""`toros design`: a pattern for a scene."""

from __future__ import annotations

import argparse

from mpi4py import MPI

from toros_fem.commands.command import Answer, Command
from toros_fem.commands.scene_options import (
    action_of,
    add_run_options,
    add_scene_options,
    meshes_allowed,
    scene_of,
)


def _options(parser: argparse.ArgumentParser) -> None:
    add_scene_options(parser)
    add_run_options(parser)


def _run(comm: MPI.Comm, given: argparse.Namespace) -> Answer:
    scene = scene_of(comm, given)
    action = action_of(scene, "design")
    files = {name: scene.files.get(name) for name in action.files}
    with meshes_allowed(given):
        summary = action.run(comm, given.output, scene.config, verbose=given.verbose, **files)
    return Answer(f"{action.sentence(summary)}; see {given.output}/", summary)


COMMAND = Command(
    "design",
    "designs the pattern of a scene",
    "The pattern is designed, printed on the computer, simulated again and written, with pictures\n"
    "and all figures in summary.json.",
    (
        "toros design mine.toml --output run",
        "toros design mine.toml --output quick --coarse",
        "toros design mine.toml --output other --set angle=90 --set design_pressure=true",
        "mpirun -n 2 toros design mine.toml --output run",
    ),
    _options,
    _run,
)
