"""JSON schema of scene files, by which editors complete keys and mark wrong values."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from toros_fem.base.keys import NONE, Key, Table
from toros_fem.base.scene import Scene
from toros_fem.base.units import DIMENSIONS
from toros_fem.cli.scene_files.materials import FILE, KIND_OF, TABLE, roles_of
from toros_fem.products.kinds import ABOUT

DIALECT = "https://json-schema.org/draft/2020-12/schema"
NUMBER = r"^\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*"
BOUNDS: Mapping[str, str] = {
    "above": "exclusiveMinimum",
    "at_least": "minimum",
    "below": "exclusiveMaximum",
    "at_most": "maximum",
}


def scene_schema(kind: type[Scene]) -> dict[str, Any]:
    """Return the JSON schema (2020-12) of scene files of a kind.

    Bounds of a value with a unit are left to the reader: JSON schema knows no units.
    """
    scene = kind()
    tables = {name: _table(of) for name, of in scene.tables().items()}
    every = {name: one for of in scene.tables().values() for name, one in _keys(of).items()}
    names = {role: {"type": "string", "description": f"name of a {KIND_OF[role]}"}
             for role in roles_of(scene)}  # fmt: skip
    if names:
        tables[TABLE]["properties"] |= names
    for name, of in scene.entries().items():
        one = _table(of)
        tables[name] = {"description": of.holds(), "anyOf": [one, {"type": "array", "items": one}]}
    paths = {name: {"type": "string", "description": text} for name, text in kind.files().items()}
    paths |= {FILE: {"type": "string", "description": "a file of materials"}} if names else {}
    tables["files"] = _object("Files and folders, relative to the scene file", paths)
    tables["coarse"] = _object("Values of the quick variant, --coarse", every | names)
    found = _object(ABOUT[kind.KIND], {"kind": {"const": kind.KIND}, **tables})
    return {"$schema": DIALECT, **found, "required": ["kind"]}


def _object(description: str, properties: Mapping[str, Any]) -> dict[str, Any]:
    return {"description": description, "type": "object", "properties": dict(properties),
            "additionalProperties": False}  # fmt: skip


def _table(of: type[Table]) -> dict[str, Any]:
    return _object(of.holds(), _keys(of))


def _keys(of: type[Table]) -> dict[str, Any]:
    return {name: _key(one) for name, one in of.described().items()}


def _key(key: Key) -> dict[str, Any]:
    """Return the schema of the values of a key."""
    ways: list[dict[str, Any]] = []
    if key.words:
        ways.append({"enum": list(key.words)})
    elif key.kind in (str, bool):
        ways.append({"type": "string" if key.kind is str else "boolean"})
    else:
        bounds = {word: getattr(key.within, name) for name, word in BOUNDS.items()}
        plain = {word: bound for word, bound in bounds.items() if math.isfinite(bound)}
        ways.append({"type": "integer" if key.kind is int else "number", **plain})
    if key.kind is float:
        units = ["%"] if key.within.unit is None else DIMENSIONS[key.within.unit][1]
        pattern = f"{NUMBER}({'|'.join(map(re.escape, units))})\\s*$"
        ways.append({"type": "string", "pattern": pattern})
    if key.optional:
        ways.append({"const": NONE})
    return {"description": key.help, **(ways[0] if len(ways) == 1 else {"anyOf": ways})}
