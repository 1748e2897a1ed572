"""Options of the commands that read a scene file."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

from toros_fem.cli.command_line.parser import UsageError
from toros_fem.cli.scene_files.reading import SceneFile, read_scene
from toros_fem.meshes.triangle_limit import MOST_TRIANGLES, triangle_limit
from toros_fem.products.own_mesh.metrics import MEASURES, Measured
from toros_fem.products.own_mesh.own_mesh import OwnMeshScene
from toros_fem.results.runs.folder import EVERY


def add_scene_options(parser: argparse.ArgumentParser) -> None:
    """Add the scene file, its quick variant, changes of its values, and large meshes."""
    parser.add_argument("file", type=Path, metavar="FILE", help="scene file, by `toros new`")
    parser.add_argument(
        "--coarse",
        action="store_true",
        help="the scene's quick variant: a coarse mesh and few steps; default no",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="another value of a key of the scene file, as it would stand there, in its unit or in "
        "SI units; may be given several times; default none",
    )
    parser.add_argument(
        "--allow-large",
        action="store_true",
        help=f"also allow meshes of more than {MOST_TRIANGLES} triangles; default no",
    )


def add_run_options(parser: argparse.ArgumentParser) -> None:
    """Add the run's folder, and the options of `add_progress_options`."""
    parser.add_argument(
        "--output",
        type=Path,
        required=True,
        metavar="RUN",
        help="folder of the run, made if missing; files of an earlier run in it are moved aside",
    )
    add_progress_options(parser)


def add_metric_option(parser: argparse.ArgumentParser) -> None:
    """Add metrics of own meshes, which `scene_of` reads."""
    parser.add_argument(
        "--metric",
        action="append",
        default=[],
        metavar="WORDS",
        help='a number more to judge an own mesh by: "bend of z > 70 mm against z < 5 mm", as in '
        f"the tables [[metric]] of its file; measures are {', '.join(MEASURES)} and tip; may be "
        "given several times; default none",
    )


def add_progress_options(parser: argparse.ArgumentParser) -> None:
    """Add how often the state is written, and the log of Newton steps."""
    parser.add_argument(
        "--every",
        type=int,
        default=EVERY,
        metavar="N",
        help=f"iterations between two writes of the state; at least 1; default {EVERY}",
    )
    parser.add_argument(
        "--verbose", action="store_true", help="print every Newton step; default no"
    )


def scene_of(comm: MPI.Comm, given: argparse.Namespace) -> SceneFile:
    """Read the scene that the options name (collective).

    Raises:
        SceneError: The file cannot be read, a key or value is wrong, or a file that it names is
            not there.
    """
    scene = read_scene(given.file, comm=comm, coarse=given.coarse, changes=given.set)
    scene.require_files(comm)
    if words := getattr(given, "metric", []):
        if not isinstance(scene.config, OwnMeshScene):
            raise UsageError(
                f"--metric is for own meshes; scenes of the kind {scene.kind.KIND!r} have "
                "metrics of their own."
            )
        metrics = (*scene.config.metric, *map(Measured.from_words, words))
        scene = replace(scene, config=scene.config.updated(metric=metrics))
    return scene


@contextmanager
def meshes_allowed(given: argparse.Namespace) -> Iterator[None]:
    """Lift the limit on triangles inside a `with` block, if the options ask for it."""
    with triangle_limit(None if given.allow_large else MOST_TRIANGLES):
        yield
