"""`toros simulate`: a plain skin or a given pattern, inflated."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

from toros_fem.cli.command_line.command import Answer, Command
from toros_fem.cli.command_line.parser import UsageError
from toros_fem.cli.command_line.running import action_of, run_scene
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
    parser.add_argument(
        "--pattern",
        type=Path,
        default=None,
        metavar="DESIGN",
        help="folder of a finished design whose print is simulated; default the skin where only "
        "what the scene prescribes is printed",
    )


def _run(comm: MPI.Comm, given: argparse.Namespace) -> Answer:
    scene = scene_of(comm, given)
    action = action_of(scene, "simulate")
    if given.pattern is not None:
        if "pattern" not in action.files:
            raise UsageError(
                f"toros simulate: scenes of the kind {scene.kind.KIND!r} take no --pattern."
            )
        scene = replace(scene, files={**scene.files, "pattern": given.pattern})
    with meshes_allowed(given):
        return run_scene(
            comm, scene, "simulate", given.output, every=given.every, verbose=given.verbose
        )


COMMAND = Command(
    "The pressure rises to the scene's in curve_steps equal steps. The run's folder gets\n"
    "summary.json, curve.csv, skin.vtu, curve.png and shapes.png.",
    (
        "toros simulate mine.toml --output plain",
        'toros simulate mine.toml --output other --pattern designed --set pressure="8 kPa"',
        "mpirun -n 2 toros simulate mine.toml --output plain --coarse",
    ),
    _options,
    _run,
)
