"""`toros explain`: what a key of a scene file means."""

from __future__ import annotations

import argparse
from typing import Any

from mpi4py import MPI

from toros_fem.base.keys import nearest
from toros_fem.cli.command_line.command import Answer, Command
from toros_fem.cli.command_line.parser import UsageError
from toros_fem.products.kinds import KINDS


def _options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("key", metavar="KEY", help="key of a scene file, such as filter_radius")
    parser.add_argument(
        "--kind",
        choices=tuple(KINDS),
        metavar="KIND",
        help="kind of the scene; default all that have the key",
    )


def _run(comm: MPI.Comm, given: argparse.Namespace) -> Answer:
    del comm
    name = given.key.rpartition(".")[2]
    kinds = [KINDS[given.kind]] if given.kind else list(KINDS.values())
    tables = {kind.KIND: {**kind.tables(), **kind.entries()} for kind in kinds}
    found: dict[tuple[str, str], dict[str, str]] = {}
    for kind in kinds:
        for table, of in tables[kind.KIND].items():
            if name in of.described():
                key = of.described()[name]
                once = table in kind.tables()
                value = kind().value(name) if once else key.default
                place = found.setdefault((table, key.help), {})
                place[kind.KIND] = key.written(value).strip('"')
    if not found:
        every = {k for all_of in tables.values() for of in all_of.values() for k in of.described()}
        raise UsageError(f"toros explain: unknown key {name!r}; {nearest(name, sorted(every))}")
    lines, entries = [], list[dict[str, Any]]()
    for (table, text), defaults in found.items():
        lines += [f"[{table}] {name}: {text}"]
        lines += [f"  default {value:14} of {kind}" for kind, value in defaults.items()]
        entries.append({"table": table, "help": text, "default": defaults})
    return Answer("\n".join(lines), {"key": name, "found": entries})


COMMAND = Command(
    "Meaning, unit, bounds and the default in each kind of scene, as `toros new` writes them.",
    ("toros explain filter_radius", "toros explain design.levels --kind walker"),
    _options,
    _run,
)
