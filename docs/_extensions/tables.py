"""Directive that puts a table from code or from committed rows into a page."""

from __future__ import annotations

from typing import Any, ClassVar

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.util.docutils import SphinxDirective
from sphinx.util.nodes import nested_parse_with_titles
from table_texts import table_of


class TableOf(SphinxDirective):
    """Insert the table that has the name of the argument."""

    required_arguments = 1
    option_spec: ClassVar = {}

    def run(self) -> list[nodes.Node]:
        """Return the nodes of the table, with its sections."""
        parent = nodes.Element()
        parent.document = self.state.document
        lines = StringList(table_of(self.arguments[0]), source=self.arguments[0])
        nested_parse_with_titles(self.state, lines, parent)
        return parent.children


def setup(app: Any) -> dict[str, Any]:
    """Register the directive."""
    app.add_directive("table-of", TableOf)
    return {"parallel_read_safe": True}
