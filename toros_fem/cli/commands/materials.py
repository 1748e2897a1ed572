"""`toros materials`: the library of fabrics, prints and rubbers, by name."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

from mpi4py import MPI

from toros_fem.base.keys import OneOf, key
from toros_fem.cli.command_line.command import Answer, Command
from toros_fem.materials.library.files import named, read_library
from toros_fem.materials.library.material import MATERIAL_KINDS
from toros_fem.materials.library.table import material_details, table_text


@dataclass(frozen=True, kw_only=True)
class Materials(Command):
    """Lists materials that scenes know by name.

    Each has its modulus, thickness, range of stretches, trust and source. Scenes name them:
    fabric = "jersey-light", reinforcement = "tpu-95a", bladder = "dragon-skin-20".
    """

    name: str | None = key(None, "show all of this material; none: a table of all")
    file: tuple[Path, ...] = key(
        (),
        "file of materials of your own, over the shipped ones; may be given several times",
    )
    kind: Annotated[str, OneOf(MATERIAL_KINDS)] | None = key(None, "only this kind; none: all")

    WORDS: ClassVar = ("name",)
    TAKES: ClassVar = {"file": "FILE", "kind": "KIND"}
    EXAMPLES: ClassVar = (
        "toros materials",
        "toros materials tpu-95a",
        "toros materials --kind rubber --file my_materials.toml --json",
    )

    def __call__(self, comm: MPI.Comm) -> Answer:
        """Read and tell them (collective)."""
        library = read_library(*self.file, comm=comm)
        if self.name is not None:
            entry = named(library, self.name, self.kind)
            return Answer(material_details(entry), entry.as_dict())
        found = [entry for entry in library.values() if self.kind in (None, entry.kind)]
        return Answer(table_text(found), {"materials": [entry.as_dict() for entry in found]})
