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
from toros_fem.cli.command_line.scripts import UsageError
from toros_fem.cli.scene_files.schema import scene_schema
from toros_fem.cli.scene_files.writing import scene_text
from toros_fem.products.kinds import KINDS


def _options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "kind",
        choices=tuple(KINDS),
        metavar="KIND",
        help="kind of the scene, one of: "
        + "; ".join(f"{kind.name} ({kind.about})" for kind in KINDS.values()),
    )
    parser.add_argument(
        "file", type=Path, metavar="FILE", help="file to write, mine.toml for instance"
    )
    parser.add_argument(
        "--force", action="store_true", help="overwrite a file that is there; default no"
    )
    parser.add_argument(
        "--schema",
        action="store_true",
        help="also write a JSON schema beside it, by which an editor completes keys and marks "
        "wrong values; default no",
    )


def _run(comm: MPI.Comm, given: argparse.Namespace) -> Answer:
    kind, path = KINDS[given.kind], given.file
    texts = {path: scene_text(kind)}
    if given.schema:
        beside = path.with_suffix(".schema.json")
        texts[path] = f"#:schema ./{beside.name}\n{texts[path]}"
        texts[beside] = json.dumps(scene_schema(kind), indent=1, ensure_ascii=False) + "\n"

    if on_first_rank(comm, path.exists) and not given.force:
        raise UsageError(f"toros new: {path} is there already; give another name, or --force.")
    write_together(comm, path.parent, lambda: _write(texts))
    figures = {"file": path, "kind": kind.name}
    return Answer(f"{path}: {kind.about}. Next: toros check {path}", figures)


def _write(texts: Mapping[Path, str]) -> None:
    for path, text in texts.items():
        path.write_text(text, encoding="utf-8")


COMMAND = Command(
    "new",
    "writes a commented scene file",
    "The file has every number of a scene with its meaning, unit, default and bounds. Change what\n"
    "differs in your case, and let `toros check` look at it.",
    ("toros new bend mine.toml", "toros new gripper gripper.toml --force --schema"),
    _options,
    _run,
)
