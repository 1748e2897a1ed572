"""What every demo does besides its scene: run it, say how it ended, read the command line."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpi4py import MPI

from toros_fem.actuators.case import Scene, Settings, design, merged
from toros_fem.design.config import DesignSettings, known_inputs
from toros_fem.errors import TorosError
from toros_fem.objectives.metrics import UNITS

Run = Callable[..., dict[str, Any]]


def run_of(build: Callable[[MPI.Comm, dict[str, Any]], Scene], defaults: dict[str, Any]) -> Run:
    """The function run(comm, output, verbose=False, **inputs) of a demo.

    It designs the scene, writes what comes of it to the folder `output` and returns the summary.
    `inputs` are what differs from the defaults and from `toros_fem.scene.Settings`.

    Args:
        build: Makes the scene from all inputs.
        defaults: Numbers of the demo, and what differs from `Settings`.
    """

    def run(
        comm: MPI.Comm, output: Path, *, verbose: bool = False, **inputs: Any
    ) -> dict[str, Any]:
        begin = time.perf_counter()
        whole = merged(defaults, inputs)
        return design(comm, output, build(comm, whole), whole, begin=begin, verbose=verbose).summary

    return run


def last_line(summary: dict[str, Any]) -> str:
    """The result of a design in a sentence."""
    reached = []
    for key in (key for key in summary if "_target_" in key):
        name, unit = key.split("_target_")
        word, _ = UNITS.get(unit, (unit, ""))
        value, error = (summary.get(f"{name}_{kind}{unit}") for kind in ("", "error_"))
        printed = "no equilibrium" if value is None else f"{value:.1f}"
        if error is not None:
            printed += f" ± {error:.1f}"
        designed = summary["design"][f"{name}_{unit}"]
        reached.append(
            f"{name} {printed} of {summary[key]:g} {word} as printed ({designed:.1f} as designed)"
        )
    drop = summary["objective_first"] / summary["objective_last"]
    return (
        f"{', '.join(reached)} at {summary['pressure_pa'] / 1e3:.2f} kPa, "
        f"objective down {drop:.0f} times, "
        f"{summary['manufacture']['islands']} islands, {summary['seconds']['total']:.0f} s"
    )


def command_line(
    comm: MPI.Comm,
    about: str,
    run: Run,
    defaults: dict[str, Any],
    coarse: dict[str, Any],
    output: Path,
    sentence: Callable[[dict[str, Any]], str] = last_line,
    settings: DesignSettings | None = None,
) -> int:
    """Run a demo with what the command line says; the exit code is returned.

    Every number is an option of its own, `--edge-length` for `edge_length`.

    Args:
        comm: Communicator.
        about: Help text.
        run: `run(comm, output, verbose=…, **inputs)`, which returns the summary.
        defaults: Numbers of the demo; those of the settings are added.
        coarse: What `--coarse` puts in their place.
        output: Default folder.
        sentence: What is said at the end, from the summary.
        settings: Other numbers that may be given; None for those of `toros_fem.scene`.
    """
    parser = argparse.ArgumentParser(
        description=about, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--coarse", action="store_true", help="a small mesh, in about a minute")
    parser.add_argument("--verbose", action="store_true", help="show every Newton step")
    parser.add_argument("--output", type=Path, default=output, help=f"folder, default {output}")
    options = parsed(parser, known_inputs(settings or Settings(), defaults, {}))
    folder, small, verbose = (options.pop(name) for name in ("output", "coarse", "verbose"))
    inputs = {**coarse, **options} if small else options
    return run_guarded(
        comm, lambda: f"{sentence(run(comm, folder, verbose=verbose, **inputs))}; see {folder}/"
    )


def parsed(parser: argparse.ArgumentParser, defaults: dict[str, Any]) -> dict[str, Any]:
    """What the command line gives, each of the defaults an option of its own."""
    for name, value in defaults.items():
        flag = "--" + name.replace("_", "-")
        parser.add_argument(flag, type=type(value), help=f"default {value}", metavar="X")
    return {name: value for name, value in vars(parser.parse_args()).items() if value is not None}


def run_guarded(comm: MPI.Comm, action: Callable[[], str]) -> int:
    """Print what an action returns, or its error in one line; the exit code is returned."""
    try:
        said = action()
    except TorosError as error:
        if comm.rank == 0:
            print(f"{type(error).__name__}: {error}", file=sys.stderr)
        return 2
    if comm.rank == 0:
        print(said)
    return 0
