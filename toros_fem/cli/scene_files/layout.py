"""Tables and keys of scene files: those of a kind, names of materials, files, the quick variant."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from toros_fem.base.keys import Key
from toros_fem.base.scene import Scene
from toros_fem.cli.scene_files.materials import names_of

# Table of materials; that of files, with the key of a file of materials; and the quick variant's.
MATERIAL, FILES, LIBRARY, QUICK = "material", "files", "materials", "coarse"
# What the tables hold that are no tables of the scene.
HOLDS: Mapping[str, str] = {
    FILES: "Files and folders, relative to the scene file",
    QUICK: "Values of the quick variant, --coarse, instead of those above",
}


def keys_of(kind: type[Scene]) -> dict[str, Mapping[str, Key]]:
    """Return the keys of each table that stands once in scene files of a kind."""
    tables: dict[str, Mapping[str, Key]] = {
        name: of.described() for name, of in kind.tables().items()
    }
    files, names = kind.files(), names_of(kind)
    if names:
        tables[MATERIAL] = {**names, **tables[MATERIAL]}
        files[LIBRARY] = "a file of materials"
    every = {name: one for keys in tables.values() for name, one in keys.items()}
    paths = {name: Key(name, Path, text, optional=True) for name, text in files.items()}
    return {**tables, FILES: paths, QUICK: every}
