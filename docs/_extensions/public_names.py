"""Directive that documents the public names of modules, each name once on the whole site."""

from __future__ import annotations

import importlib
import inspect
import re
import sys
from typing import Any, ClassVar

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.errors import ExtensionError
from sphinx.util.docutils import SphinxDirective
from sphinx.util.nodes import nested_parse_with_titles

import toros_fem

DIRECTIVES = {
    "class": ("autoclass", ("   :members:",)),
    "exception": ("autoexception", ("   :members:", "   :show-inheritance:")),
    "function": ("autofunction", ()),
}


def kind_of(thing: Any) -> str:
    """Return the key of `DIRECTIVES` for a public object, or "data"."""
    if inspect.isclass(thing):
        return "exception" if issubclass(thing, BaseException) else "class"
    return "function" if inspect.isfunction(thing) else "data"


def comment_of(name: str) -> list[str]:
    """Return the comment above the place where a public constant gets its value."""
    value = re.compile(rf"^((?:#.*\n)+){name}(?:: .*)? = ", re.MULTILINE)
    for path, module in list(sys.modules.items()):
        if path.startswith("toros_fem.") and name in vars(module):
            found = value.search(inspect.getsource(module))
            if found:
                return [line.lstrip("# ") for line in found.group(1).splitlines()]
    raise ExtensionError(f"the public constant {name} has no comment above it")


def public_names(module: str) -> list[str]:
    """Return `__all__`, or of a module without it the names without underscore that it defines."""
    room = importlib.import_module(module)
    names = getattr(room, "__all__", None)
    if names is None:
        names = [
            name
            for name, thing in vars(room).items()
            if getattr(thing, "__module__", None) == module
            and name[0] != "_"
            and kind_of(thing) != "data"
        ]
    return [n for n in names if not n.startswith("__") and not inspect.ismodule(getattr(room, n))]


def qualified(module: str, name: str) -> str:
    """Return the shortest public name: that of the package itself where it has the name too."""
    thing = getattr(importlib.import_module(module), name)
    if name in toros_fem.__all__ and getattr(toros_fem, name) is thing:
        return f"toros_fem.{name}"
    return f"{module}.{name}"


class PublicNames(SphinxDirective):
    """Document the names of a module, or of the modules in the content, which a room has."""

    required_arguments = 1
    has_content = True
    option_spec: ClassVar = {}

    def run(self) -> list[nodes.Node]:
        """Return the nodes of all names, module by module."""
        room = self.arguments[0]
        parts = " ".join(self.content).split()
        modules = [f"{room}.{part}" for part in parts] or [room]
        lines = [line for module in modules for line in self.lines(module)]
        block = StringList(["```{eval-rst}", *lines, "```"], source=room)
        parent = nodes.Element()
        parent.document = self.state.document
        nested_parse_with_titles(self.state, block, parent)
        return parent.children

    def lines(self, module: str) -> list[str]:
        """Return the text of all names of a module, in the order of `__all__` or of their code."""
        room, lines = importlib.import_module(module), []
        self.env.note_dependency(str(room.__file__))
        for name in public_names(module):
            kind, place = kind_of(getattr(room, name)), qualified(module, name)
            if kind == "data":
                comment = [f"   {line}" for line in comment_of(name)]
                lines += [f".. py:data:: {place}", "", *comment, ""]
                continue
            directive, options = DIRECTIVES[kind]
            lines += [f".. {directive}:: {place}", *options, ""]
        return lines


def setup(app: Any) -> dict[str, Any]:
    """Register the directive."""
    app.add_directive("public-names", PublicNames)
    return {"parallel_read_safe": True}
