"""The names that a script may import, each with its signature and what its objects have."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from types import ModuleType
from typing import Any, get_origin

import numpy as np

import toros_fem


def public() -> Iterator[tuple[str, Any]]:
    """Yield each public name and its object; all errors are public."""
    for face in (toros_fem, toros_fem.meshes):
        for name in face.__all__:
            yield name, getattr(face, name)
    for name, value in vars(toros_fem.base.errors).items():
        if inspect.isclass(value) and issubclass(value, Exception):
            yield name, value


def shown(value: Any) -> str:
    """Return an annotation or a value as a person would write it: without modules, addresses."""
    text = value if isinstance(value, str) else repr(value)
    text = re.sub(r"<function (\w+) at 0x[0-9a-f]+>|<class '([\w.]+)'>", r"\1\2", text)
    return re.sub(r"\b(?:[A-Za-z_]\w*\.)+(?=[A-Za-z])", "", text)


def default(value: Any) -> str:
    """Return a default value; numbers of numpy are plain ones."""
    return (
        repr(value)
        if isinstance(value, str)
        else shown(value.item() if isinstance(value, np.generic) else value)
    )


def signature(of: Callable[..., Any]) -> str:
    """Return arguments with annotations and defaults, and what is returned."""
    found = inspect.signature(of)
    parts: list[str] = []
    for one in found.parameters.values():
        if one.name == "self":
            continue
        if one.kind is one.KEYWORD_ONLY and not any(part[0] == "*" for part in parts):
            parts.append("*")
        stars = "*" * ((one.kind is one.VAR_POSITIONAL) + 2 * (one.kind is one.VAR_KEYWORD))
        note = "" if one.annotation is one.empty else f": {shown(one.annotation)}"
        value = "" if one.default is one.empty else f" = {default(one.default)}"
        parts.append(f"{stars}{one.name}{note}{value}")
    back = found.return_annotation
    arrow = "" if back in (found.empty, None, "None") else f" -> {shown(back)}"
    return f"({', '.join(parts)}){arrow}"


def has(kind: type) -> str:
    """Return the public methods and properties that the package gives a class."""
    own = {field.name for field in fields(kind)} if is_dataclass(kind) else set()
    found: dict[str, Any] = {}
    for base in reversed(kind.__mro__):
        if base.__module__.partition(".")[0] == "toros_fem":
            found |= {name: v for name, v in vars(base).items() if name[0] != "_"}
    calls = classmethod | staticmethod
    return ", ".join(
        f"{name}()" if inspect.isfunction(value) or isinstance(value, calls) else name
        for name, value in sorted(found.items())
        if name not in own
    )


def described(value: Any) -> str:
    """Return what a public object is."""
    if isinstance(value, ModuleType):
        return "module"
    if get_origin(value) is not None:
        return "type"
    if isinstance(value, Mapping):
        return "mapping of " + ", ".join(map(str, value))
    if not inspect.isclass(value):
        return signature(value) if callable(value) else f"constant {type(value).__name__}"
    if issubclass(value, Enum):
        return "choice of " + ", ".join(f"{one.name} = {one.value}" for one in value)
    parts = []
    if issubclass(value, Exception):
        bases = [base.__name__ for base in value.__mro__[1:] if base not in (BaseException, object)]
        parts.append("error, a " + ", ".join(bases))
    if inspect.isfunction(value.__init__) and not getattr(value, "_is_protocol", False):
        parts.append(signature(value))
    members = has(value)
    return "; ".join(["class", *parts, *([f"has {members}"] if members else [])])


def test_public_names(pinned: Callable[..., None]) -> None:
    """Each name once; no two things have the same name."""
    found: dict[str, Any] = {}
    for name, value in public():
        assert found.setdefault(name, value) is value, name
    pinned(
        "public_names",
        {
            name: described(value) + ("; of the package itself" * (name in toros_fem.__all__))
            for name, value in sorted(found.items())
        },
    )
