"""Directive that puts the sections of the accuracy table into a page."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.util.docutils import SphinxDirective
from sphinx.util.nodes import nested_parse_with_titles

from benchmarks.accuracy.command import sections
from benchmarks.bench import ROWS, read


class AccuracyCases(SphinxDirective):
    """Insert the committed rows of all cases, each with its heading."""

    def run(self) -> list[nodes.Node]:
        """Return the nodes of the sections."""
        parent = nodes.Element()
        parent.document = self.state.document
        lines = sections(read(ROWS / "accuracy.csv")).splitlines()
        nested_parse_with_titles(self.state, StringList(lines, source="accuracy.csv"), parent)
        return parent.children


def setup(app: Any) -> dict[str, Any]:
    """Register the directive."""
    app.add_directive("accuracy-cases", AccuracyCases)
    return {"parallel_read_safe": True}
