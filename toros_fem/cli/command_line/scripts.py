"""The command line of scripts: each field of a configuration is an option."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from mpi4py import MPI

from toros_fem.base.errors import RunStoppedError, TorosError
from toros_fem.base.keys import Table
from toros_fem.base.mpi import ending_together
from toros_fem.base.scene import Scene
from toros_fem.cli.command_line.command import METAVARS, option_help, reader
from toros_fem.cli.command_line.exit_codes import exit_code, tell_alone
from toros_fem.cli.command_line.parser import SuggestingParser, UsageError
from toros_fem.cli.scene_files.materials import FILE, KIND_OF, numbers_of, roles_of
from toros_fem.cli.scene_files.writing import scene_text
from toros_fem.materials.library import named, read_library
from toros_fem.results.result import RunResult
from toros_fem.results.runs.folder import open_run

C = TypeVar("C", bound=Table | Scene)


def run_from_command_line(
    comm: MPI.Comm,
    about: str,
    config: C,
    run: Callable[..., str],
    output: Path,
    *,
    files: Mapping[str, str] | None = None,
) -> int:
    """Run a script with the values that the command line gives; return the exit code.

    Args:
        comm: Communicator.
        about: Help text.
        config: The configuration with its defaults. Where it has a method `coarse` the script has
            `--coarse`, whose values other options override.
        run: `run(comm, output, config, files, verbose=…)` with the paths that were given; returns
            the result in a sentence.
        output: Default folder.
        files: Further options that name a file or folder, with their help.
    """
    parser = SuggestingParser(
        first_rank=comm.rank == 0, usage="%(prog)s [options]", description=about
    )
    if hasattr(config, "coarse"):
        parser.add_argument("--coarse", action="store_true", help="a coarse mesh and few steps")
    parser.add_argument("--verbose", action="store_true", help="print all Newton steps")
    parser.add_argument("--output", type=Path, default=output, help=f"folder; default {output}")
    parser.add_argument(
        "--resume",
        action="store_true",
        help="go on with the run in the folder, which was stopped; the other options are the same",
    )
    for name, text in (files or {}).items():
        parser.add_argument(f"--{name}", type=Path, default=None, help=text, metavar="PATH")
    add_options(parser, config)
    _add_material_options(parser, config)
    try:
        given = vars(parser.parse_args())
    except UsageError as error:
        parser.exit(2, f"{error}\n")
    folder, verbose, quick, resume = (
        given.pop(name, False) for name in ("output", "verbose", "coarse", "resume")
    )
    paths = {name: given.pop(name) for name in files or {}}
    library = given.pop(FILE, None)

    def action() -> str:
        start = config.coarse() if quick and hasattr(config, "coarse") else config
        chosen = start.updated(**_with_materials(comm, config, given, library))
        inputs = {
            "about": about.partition("\n")[0],
            "config": chosen.as_dict(),
            "files": {name: None if path is None else str(path) for name, path in paths.items()},
        }
        roles = {role: given[role] for role in KIND_OF if role in given}
        if roles:
            inputs["materials"] = roles
        again = "the same command and --resume"
        named = {name: path for name, path in paths.items() if path is not None}
        text = None
        if isinstance(chosen, Scene) and chosen.KIND:
            there = {name: path.resolve() for name, path in named.items()}
            text = scene_text(type(chosen), chosen, there)
        with open_run(comm, folder, inputs, scene=text, resume=resume, again=again):
            told = run(comm, folder, chosen, named, verbose=verbose)
        return f"{told}; see {folder}/"

    return run_guarded(comm, action)


def run_scene_script(comm: MPI.Comm, about: str, scene: Scene, output: Path) -> int:
    """Design the scene of a script, or simulate what cannot be designed; return the exit code.

    Args:
        comm: Communicator.
        about: Help text.
        scene: The scene with its defaults.
        output: Default folder.
    """
    of: Any = scene
    action = "design" if hasattr(of, "run_design") else "simulation"

    def run(
        comm: MPI.Comm, output: Path, scene: Any, files: Mapping[str, Path], *, verbose: bool
    ) -> str:
        made: RunResult = getattr(scene, f"run_{action}")(comm, output, files, verbose=verbose)
        return made.sentence()

    return run_from_command_line(
        comm,
        about,
        scene,
        run,
        output,
        files=scene.DESIGN_FILES if action == "design" else scene.SIMULATION_FILES,
    )


def _add_material_options(parser: argparse.ArgumentParser, config: Table | Scene) -> None:
    """Add the names of materials, in the place of their numbers."""
    roles = roles_of(config)
    if not roles:
        return
    group = parser.add_argument_group("Materials by name, in the place of their numbers")
    for role in roles:
        text = f"name of a {KIND_OF[role]} of the library, by `toros materials`; default none"
        group.add_argument(f"--{role}", default=argparse.SUPPRESS, metavar="NAME", help=text)
    group.add_argument(
        f"--{FILE}",
        type=Path,
        default=None,
        metavar="PATH",
        help="file of materials of your own; default none",
    )


def _with_materials(
    comm: MPI.Comm,
    default: Table | Scene,
    given: Mapping[str, Any],
    path: Path | None,
) -> dict[str, Any]:
    """Return the given values with numbers in the place of names of materials (collective)."""
    if path is None and not any(role in given for role in KIND_OF):
        return dict(given)
    library = read_library(*([] if path is None else [path]), comm=comm)
    roles = {r: named(library, given[r], kind) for r, kind in KIND_OF.items() if r in given}
    rest = {name: value for name, value in given.items() if name not in roles}
    return {**numbers_of(roles, rest, default), **rest}


def add_options(parser: argparse.ArgumentParser, settings: Table | Scene) -> None:
    """Add an option for each key, in groups by the table that defines it.

    A value may have a unit, as in files. Options that are not given are absent from the result.
    """
    homes = _homes(type(settings))
    groups = {of: parser.add_argument_group(of.holds()) for of in homes.values()}
    for name, one in settings.described().items():
        form: dict[str, Any] = {"type": reader(one), "metavar": METAVARS.get(one.kind)}
        if one.kind is bool:
            form = {"action": argparse.BooleanOptionalAction}
        text = option_help(one, settings.value(name))
        flag = "--" + name.replace("_", "-")
        groups[homes[name]].add_argument(flag, default=argparse.SUPPRESS, help=text, **form)


def _homes(settings: type[Table | Scene]) -> dict[str, type[Table]]:
    """Return the table of each key."""
    tables = settings.tables().values() if issubclass(settings, Scene) else (settings,)
    return {name: of for of in tables for name in of.described()}


def run_guarded(comm: MPI.Comm, action: Callable[[], str]) -> int:
    """Print the text that an action returns, or its error in one line; return the exit code.

    An error of one rank alone ends all ranks, since the others wait for it.
    """
    try:
        with ending_together(comm, lambda error: tell_alone(comm, error)):
            text = action()
    except TorosError as error:
        if comm.rank == 0:
            stopped = isinstance(error, RunStoppedError)
            print(error if stopped else f"{type(error).__name__}: {error}", file=sys.stderr)
        return exit_code(error)
    if comm.rank == 0:
        print(text)
    return 0
