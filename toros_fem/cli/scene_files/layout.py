"""Tables and keys of scene files of a kind, and their JSON schema for editors."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from toros_fem.base.keys import NONE, File, Key
from toros_fem.base.scene import Scene
from toros_fem.base.units import DIMENSIONS
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
NUMBER = r"^\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*"
TYPES = {float: "number", int: "integer", bool: "boolean", str: "string", Path: "string"}
BOUNDS: Mapping[str, str] = {
    "above": "exclusiveMinimum",
    "at_least": "minimum",
    "below": "exclusiveMaximum",
    "at_most": "maximum",
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
    paths = {
        name: Key(name, File | None, Path, text, optional=True) for name, text in files.items()
    }
    return {**tables, FILES: paths, QUICK: every}


def scene_schema(kind: type[Scene]) -> dict[str, Any]:
    """Return the JSON schema (2020-12) of scene files of a kind.

    Bounds of a value with a unit are left to the reader: JSON schema knows no units.
    """
    holds = {**{name: of.holds() for name, of in kind.tables().items()}, **HOLDS}
    tables = {name: _table(holds[name], keys) for name, keys in keys_of(kind).items()}
    for name, of in kind.entries().items():
        one = _table(of.holds(), of.described())
        tables[name] = {"description": of.holds(), "anyOf": [one, {"type": "array", "items": one}]}
    found = _object(ABOUT[kind.KIND], {"kind": {"const": kind.KIND}, **tables})
    return {"$schema": DIALECT, **found, "required": ["kind"]}


def _object(description: str, properties: Mapping[str, Any]) -> dict[str, Any]:
    return {"description": description, "type": "object", "properties": dict(properties),
            "additionalProperties": False}  # fmt: skip


def _table(holds: str, keys: Mapping[str, Key]) -> dict[str, Any]:
    return _object(holds, {name: _key(one) for name, one in keys.items()})


def _key(key: Key) -> dict[str, Any]:
    """Return the schema of the values of a key."""
    bounds = {word: getattr(key.within, name) for name, word in BOUNDS.items()}
    finite = {word: bound for word, bound in bounds.items() if math.isfinite(bound)}
    plain: dict[str, Any] = {"type": TYPES[key.kind], **finite}
    ways = [{"enum": list(key.words)} if key.words else plain]
    if key.kind is float:
        units = ["%"] if key.within.unit is None else DIMENSIONS[key.within.unit][1]
        pattern = f"{NUMBER}({'|'.join(map(re.escape, units))})\\s*$"
        ways.append({"type": "string", "pattern": pattern})
    if key.optional:
        ways.append({"const": NONE})
    return {"description": key.help, **(ways[0] if len(ways) == 1 else {"anyOf": ways})}
