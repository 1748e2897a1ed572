"""Command line of the demos."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpi4py import MPI

from toros_fem.errors import TorosError
from toros_fem.scene import merged


def command_line(
    comm: MPI.Comm,
    about: str,
    run: Callable[..., dict[str, Any]],
    defaults: dict[str, Any],
    coarse: dict[str, Any],
    output: Path,
    last_line: Callable[[dict[str, Any]], str],
) -> int:
    """Run a demo with what the command line says; the exit code is returned.

    Every number is an option of its own, `--edge-length` for `edge_length`.

    Args:
        comm: Communicator.
        about: Help text.
        run: `run(comm, output, verbose=…, **inputs)`, which returns the summary.
        defaults: Numbers of the demo; those of `Settings` are added.
        coarse: What `--coarse` puts in their place.
        output: Default folder.
        last_line: What is said at the end, from the summary.
    """
    parser = argparse.ArgumentParser(
        description=about, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--coarse", action="store_true", help="a small mesh, in about a minute")
    parser.add_argument("--verbose", action="store_true", help="show every Newton step")
    parser.add_argument("--output", type=Path, default=output, help=f"folder, default {output}")
    for name, value in merged(defaults, {}).items():
        flag = "--" + name.replace("_", "-")
        parser.add_argument(flag, type=type(value), help=f"default {value}", metavar="X")
    options = vars(parser.parse_args())
    folder, small, verbose = (options.pop(name) for name in ("output", "coarse", "verbose"))
    given = {name: value for name, value in options.items() if value is not None}
    inputs = {**coarse, **given} if small else given
    try:
        summary = run(comm, folder, verbose=verbose, **inputs)
    except TorosError as error:
        if comm.rank == 0:
            print(f"{type(error).__name__}: {error}", file=sys.stderr)
        return 2
    if comm.rank == 0:
        print(f"{last_line(summary)}; see {folder}/")
    return 0
