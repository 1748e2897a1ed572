"""`toros materials`: the library of fabrics, prints and rubbers, by name."""

from __future__ import annotations

import argparse
from pathlib import Path

from mpi4py import MPI

from toros_fem.cli.command_line.command import Answer, Command
from toros_fem.materials.library import MATERIAL_KINDS, named, read_library
from toros_fem.materials.library.table import material_details, table_text


def _options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "name",
        nargs="?",
        default=None,
        metavar="NAME",
        help="show all of this material; default a table of all",
    )
    parser.add_argument(
        "--file",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help="file of materials of your own, over the shipped ones; may be given several times; "
        "default none",
    )
    parser.add_argument(
        "--kind",
        choices=MATERIAL_KINDS,
        default=None,
        metavar="KIND",
        help=f"only this kind, one of {', '.join(MATERIAL_KINDS)}; default all",
    )


def _run(comm: MPI.Comm, given: argparse.Namespace) -> Answer:
    library = read_library(*given.file, comm=comm)
    if given.name is not None:
        entry = named(library, given.name, given.kind)
        return Answer(material_details(entry), entry.as_dict())
    found = [entry for entry in library.values() if given.kind in (None, entry.kind)]
    return Answer(table_text(found), {"materials": [entry.as_dict() for entry in found]})


COMMAND = Command(
    "Each has its modulus, thickness, range of stretches, trust and source. Scenes name them:\n"
    'fabric = "jersey-light", reinforcement = "tpu-95a", bladder = "dragon-skin-20".',
    (
        "toros materials",
        "toros materials tpu-95a",
        "toros materials --kind rubber --file my_materials.toml --json",
    ),
    _options,
    _run,
)
