"""`toros design`: a pattern for a scene."""

from __future__ import annotations

import argparse

from mpi4py import MPI

from toros_fem.cli.command_line.command import Answer, Command
from toros_fem.cli.command_line.running import run_scene
from toros_fem.cli.command_line.scene_options import (
    add_metric_option,
    add_run_options,
    add_scene_options,
    meshes_allowed,
    scene_of,
)


def _options(parser: argparse.ArgumentParser) -> None:
    add_scene_options(parser)
    add_run_options(parser)
    add_metric_option(parser)


def _run(comm: MPI.Comm, given: argparse.Namespace) -> Answer:
    scene = scene_of(comm, given)
    with meshes_allowed(given):
        return run_scene(
            comm, scene, "design", given.output, every=given.every, verbose=given.verbose
        )


COMMAND = Command(
    "The pattern is designed, cleaned so that it can be printed, simulated again and written,\n"
    "with pictures and all figures in summary.json. The state is written while it runs: a run\n"
    "that was stopped goes on by `toros resume`.",
    (
        "toros design mine.toml --output run",
        "toros design mine.toml --output quick --coarse",
        "toros design mine.toml --output other --set angle=90 --set design_pressure=true",
        "mpirun -n 2 toros design mine.toml --output run",
    ),
    _options,
    _run,
)
