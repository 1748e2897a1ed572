"""`toros tolerance`: what a finished design does that is not made as drawn."""

from __future__ import annotations

import argparse
from pathlib import Path

from mpi4py import MPI

from toros_fem.cli.command_line.command import Answer, Command
from toros_fem.cli.command_line.scripts import add_options, given_config
from toros_fem.cli.scene_files.scene_of_run import scene_of_run
from toros_fem.meshes.triangle_limit import triangle_limit
from toros_fem.products.tolerance.of_run import tolerances_of_run
from toros_fem.products.tolerance.result import shown, text_table
from toros_fem.products.tolerance.settings import ToleranceConfig
from toros_fem.products.tolerance.writing import FILES, write_tolerances


def _options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("run", type=Path, metavar="RUN", help="folder of a finished design")
    parser.add_argument(
        "--output",
        type=Path,
        default=None,
        metavar="FOLDER",
        help="folder for the files, made if missing; default RUN, where `toros view` shows them",
    )
    add_options(parser, ToleranceConfig())


def _run(comm: MPI.Comm, given: argparse.Namespace) -> Answer:
    config = given_config(given, ToleranceConfig())
    output = given.output or given.run
    with triangle_limit(None):  # what was designed was allowed
        scene, files = scene_of_run(comm, given.run)
        found = tolerances_of_run(comm, given.run, scene, files, config)
    write_tolerances(comm, output, found)
    drawn, own = (
        ", ".join(f"{m.name} {shown(m, values[m.key])}" for m in found.metrics if m.key in values)
        for values in (found.nominal, found.own_mesh)
    )
    thinnest = [
        f"{name} {1e3 * width:.2f} mm"
        for name, width in (("line", found.smallest_width), ("gap", found.smallest_gap))
        if width is not None
    ]
    notes = [f"{v.words}: {note}" for v in found.variants for note in v.notes]
    nominal, more = found.seconds
    lines = [
        f"As drawn: {drawn} at {found.pressure / 1e3:.2f} kPa, {found.triangles} triangles that "
        f"follow the print; on the mesh of the design {own}.",
        *([f"Thinnest {', '.join(thinnest)}."] if thinnest else []),
        "Changes as simulated [to first order]:",
        text_table(found),
        *notes,
        *found.worst_sentences,
        f"{nominal:.1f} s and {found.steps[0]} Newton steps as drawn, {more:.1f} s and "
        f"{found.steps[1]} for {len(found.variants)} variants; see {output}/{FILES[2]}",
    ]
    return Answer("\n".join(lines), {"folder": output, "files": FILES, **found.summary()})


COMMAND = Command(
    "Lines wider or narrower than drawn, stiffer or softer materials, another pressure: how angle\n"
    "or other metrics, objective, lines and gaps move, as simulated and to first order. The\n"
    "command names the worst. The folder gets tolerance.json, tolerance.csv and tolerance.png.",
    (
        "toros tolerance run",
        "toros tolerance run --width 0.2e-3 --thickness 0.1",
        "mpirun -n 2 toros tolerance run --output worn --json",
    ),
    _options,
    _run,
)
