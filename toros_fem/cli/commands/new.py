"""`toros new`: a commented scene file to begin with."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from pathlib import Path

from mpi4py import MPI

from toros_fem.base.files import write_together
from toros_fem.base.mpi import on_first_rank
from toros_fem.cli.command_line.command import Answer, Command
from toros_fem.cli.command_line.parser import UsageError
from toros_fem.cli.scene_files.materials import KIND_OF, roles_of
from toros_fem.cli.scene_files.schema import scene_schema
from toros_fem.cli.scene_files.writing import DEFAULTS, scene_text, short_scene_text
from toros_fem.materials.library import named, read_library
from toros_fem.products.kinds import KINDS

OPTIONS = {"fabric": "--fabric", "reinforcement": "--print", "bladder": "--bladder"}


def _options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "kind",
        choices=tuple(KINDS),
        metavar="KIND",
        help="kind of the scene, one of: "
        + "; ".join(f"{kind.KIND} ({kind.ABOUT})" for kind in KINDS.values()),
    )
    parser.add_argument(
        "file", type=Path, metavar="FILE", help="file to write, mine.toml for instance"
    )
    parser.add_argument(
        "--force", action="store_true", help="overwrite a file that is there; default no"
    )
    parser.add_argument(
        "--all", action="store_true", help="write every key, with its default; default no"
    )
    for role, option in OPTIONS.items():
        parser.add_argument(
            option,
            dest=role,
            metavar="NAME",
            help=f"{role} by name, of `toros materials`; default {DEFAULTS.get(role, 'none')}",
        )
    parser.add_argument(
        "--schema",
        action="store_true",
        help="also write a JSON schema beside it, by which an editor completes keys and marks "
        "wrong values; default no",
    )


def _run(comm: MPI.Comm, given: argparse.Namespace) -> Answer:
    kind, path = KINDS[given.kind], given.file
    names = {role: name for role in OPTIONS if (name := getattr(given, role)) is not None}
    if given.all and names:
        raise UsageError("toros new: --all writes the numbers of materials; give no names with it.")
    if unknown := set(names) - set(roles_of(kind)):
        raise UsageError(f"toros new: scenes of the kind {kind.KIND!r} have no {min(unknown)}.")
    library = read_library(comm=comm) if names else {}
    for role, name in names.items():
        named(library, name, KIND_OF[role])
    texts = {path: scene_text(kind) if given.all else short_scene_text(kind, names)}
    if given.schema:
        beside = path.with_suffix(".schema.json")
        texts[path] = f"#:schema ./{beside.name}\n{texts[path]}"
        texts[beside] = json.dumps(scene_schema(kind), indent=1, ensure_ascii=False) + "\n"

    there = on_first_rank(comm, lambda: [str(path) for path in texts if path.exists()])
    if there and not given.force:
        raise UsageError(f"toros new: {there[0]} is there already; give another name, or --force.")
    write_together(comm, path.parent, lambda: _write(texts))
    figures = {"file": path, "kind": kind.KIND}
    return Answer(f"{path}: {kind.ABOUT}. Next: toros check {path}", figures)


def _write(texts: Mapping[Path, str]) -> None:
    for path, text in texts.items():
        path.write_text(text, encoding="utf-8")


COMMAND = Command(
    "The file has the keys that you are likely to change, each with its meaning, unit and bounds;\n"
    "--all writes every key. Change what differs in your case, and let `toros check` look at it.",
    (
        "toros new bend mine.toml",
        "toros new bend mine.toml --fabric rib-knit --print tpu-85a",
        "toros new gripper gripper.toml --force --schema",
    ),
    _options,
    _run,
)
