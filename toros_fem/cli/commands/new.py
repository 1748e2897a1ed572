"""`toros new`: a commented scene file to begin with."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import MISSING
from pathlib import Path
from typing import Annotated, ClassVar

from mpi4py import MPI

from toros_fem.base.files import naming, replace_file
from toros_fem.base.keys import File, Flag, OneOf, Text, key
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.packages import program
from toros_fem.cli.command import Answer, Command
from toros_fem.cli.process import UsageError
from toros_fem.cli.scene_files import KIND_OF, names_of, scene_schema, scene_text, short_scene_text
from toros_fem.materials.library.files import named, read_library
from toros_fem.products.kinds import ABOUT, KINDS


class New(Command, kw_only=True):
    """Writes a commented scene file.

    The file has the keys that you are likely to change, each with its meaning, unit and bounds;
    --all writes every key. Change what differs in your case, and let `toros check` look at it.
    """

    kind: Annotated[str, OneOf(tuple(KINDS))] = key(
        MISSING, "kind of the scene: " + "; ".join(f"{k} ({a})" for k, a in ABOUT.items())
    )
    file: File = key(MISSING, "file to write, mine.toml for instance")
    force: Flag = key(False, "overwrite a file that is there")
    all: Flag = key(False, "write every key, with its default")
    fabric: Text | None = key(None, "fabric by name, of `toros materials`; none takes jersey-light")
    print: Text | None = key(
        None,
        "reinforcement by name, of `toros materials`; none takes printed-tpu-95a-on-jersey, on "
        "another fabric printed-tpu-95a",
    )
    bladder: Text | None = key(None, "bladder by name, of `toros materials`")
    schema: Flag = key(
        False,
        "also write a JSON schema beside it, by which an editor completes keys and marks wrong "
        "values",
    )

    WORDS: ClassVar = ("kind", "file")
    EXAMPLES: ClassVar = (
        "toros new bend mine.toml",
        "toros new bend mine.toml --fabric rib-knit --print tpu-85a",
        "toros new gripper gripper.toml --force --schema",
    )

    def __call__(self, comm: MPI.Comm) -> Answer:
        """Write the file (collective)."""
        kind, path = KINDS[self.kind], self.file
        given = {"fabric": self.fabric, "reinforcement": self.print, "bladder": self.bladder}
        names = {role: name for role, name in given.items() if name is not None}
        if self.all and names:
            raise UsageError("toros new: --all writes numbers of materials; give no names with it.")
        if unknown := names.keys() - names_of(kind):
            raise UsageError(f"toros new: scenes of the kind {kind.KIND!r} have no {min(unknown)}.")
        library = read_library(comm=comm) if names else {}
        for role, name in names.items():
            named(library, name, KIND_OF[role])
        whole = scene_text(kind.example(), kind.EXAMPLE_FILES)
        texts = {path: whole if self.all else short_scene_text(kind, names)}
        if self.schema:
            beside = path.with_suffix(".schema.json")
            texts[path] = f"#:schema ./{beside.name}\n{texts[path]}"
            texts[beside] = json.dumps(scene_schema(kind), indent=1, ensure_ascii=False) + "\n"

        there = on_first_rank(comm, lambda: [str(path) for path in texts if os.path.lexists(path)])
        if there and not self.force:
            raise UsageError(
                f"toros new: {there[0]} is there already; give another name, or --force."
            )
        on_first_rank(comm, lambda: _write(texts))
        figures = {"file": path, "kind": kind.KIND}
        return Answer(f"{path}: {ABOUT[kind.KIND]}. Next: {program()} check {path}", figures)


def _write(texts: Mapping[Path, str]) -> None:
    for path, text in texts.items():
        with naming(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            replace_file(path, text.encode())
