"""Type of the content of scene files of a kind, and their JSON schema for editors."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Required

from pydantic import BeforeValidator, TypeAdapter

from toros_fem.base.keys import File, Key, given_of, typed
from toros_fem.base.scene import Scene
from toros_fem.cli.scene_files.materials import names_of
from toros_fem.products.kinds import ABOUT

# Table of materials; that of files, with the key of a file of materials; and the quick variant's.
MATERIAL, FILES, LIBRARY, QUICK = "material", "files", "materials", "coarse"
# What the tables hold that are no tables of the scene.
HOLDS: Mapping[str, str] = {
    FILES: "Files and folders, relative to the scene file",
    QUICK: "Values of the quick variant, --coarse, instead of those above",
}
DIALECT = "https://json-schema.org/draft/2020-12/schema"


def keys_of(kind: type[Scene]) -> dict[str, Mapping[str, Key]]:
    """Return the keys of each table of scene files of a kind."""
    tables: dict[str, Mapping[str, Key]] = {
        name: of.described() for name, of in kind.tables().items()
    }
    files, names = kind.files(), names_of(kind)
    if names:
        tables[MATERIAL] = {**names, **tables[MATERIAL]}
        files[LIBRARY] = "a file of materials"
    every = {name: one for keys in tables.values() for name, one in keys.items()}
    paths = {
        name: Key(name, File | None, Path, text, optional=True) for name, text in files.items()
    }
    several = {name: of.described() for name, of in kind.entries().items()}
    return {**tables, FILES: paths, QUICK: every, **several}


def file_type(kind: type[Scene]) -> TypeAdapter[dict[str, Any]]:
    """Return the type of the content of scene files of a kind: tables with the keys that one gives.

    It also makes the JSON schema for editors, where bounds of a value with a unit are left out:
    JSON schema knows no units.
    """
    holds = {**{name: of.holds() for name, of in kind.tables().items()}, **HOLDS}
    entries = kind.entries()
    content: dict[str, Any] = {"kind": Required[Literal[kind.KIND]]}
    for name, keys in keys_of(kind).items():
        of = entries.get(name)
        content[name] = given_of(name, holds[name] if of is None else of.holds(), keys)
        if of is not None:
            content[name] = several(content[name])
    return TypeAdapter(typed(kind.KIND, ABOUT[kind.KIND], content))


def scene_schema(kind: type[Scene]) -> dict[str, Any]:
    """Return the JSON schema (2020-12) of scene files of a kind."""
    return {"$schema": DIALECT, **file_type(kind).json_schema()}


def several(table: Any) -> Any:
    """Return the type of a table that may stand once, or several times."""
    listed: Any = list[table]

    def read(content: Any) -> Any:
        return [content] if isinstance(content, dict) else content

    return Annotated[listed, BeforeValidator(read, json_schema_input_type=table | listed)]
