"""`toros resume`: a run goes on where it was stopped."""

from __future__ import annotations

import argparse
from pathlib import Path

from mpi4py import MPI

from toros_fem.cli.command_line.command import Answer, Command
from toros_fem.cli.command_line.running import resume_scene
from toros_fem.cli.command_line.scene_options import add_progress_options
from toros_fem.meshes.triangle_limit import triangle_limit


def _options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("run", type=Path, metavar="RUN", help="folder of the run")
    add_progress_options(parser)


def _run(comm: MPI.Comm, given: argparse.Namespace) -> Answer:
    with triangle_limit(None):  # what the run began with was allowed
        return resume_scene(comm, given.run, every=given.every, verbose=given.verbose)


COMMAND = Command(
    "The run goes on from its last state, with the inputs that it began with (RUN/scene.toml), on\n"
    "any number of ranks. On the same number its result is the same to the last digit.",
    ("toros resume run", "mpirun -n 2 toros resume run"),
    _options,
    _run,
)
