"""Directives that list every key of every kind of scene, and the usual ranges of their groups."""

from __future__ import annotations

from typing import Any, ClassVar

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.util.docutils import SphinxDirective
from sphinx.util.nodes import nested_parse_with_titles

from toros_fem.base.scene import Scene
from toros_fem.cli.scene_files.layout import keys_of
from toros_fem.products.kinds import ABOUT, KINDS
from toros_fem.products.plausibility import RANGES


def page_of(kind: type[Scene]) -> list[str]:
    """Return heading and tables of a kind in Markdown."""
    lines = [f"## {kind.KIND}", "", f"{ABOUT[kind.KIND][0].upper()}{ABOUT[kind.KIND][1:]}.", ""]
    scene, keys = kind(), keys_of(kind)
    for section, of in kind.tables().items():
        lines += [f"**[{section}]** {of.holds()}", "", "| key | meaning | default |"]
        lines.append("|---|---|---|")
        for key, one in keys[section].items():
            value = scene.value(key) if key in of.described() else one.default
            default = one.written(value).strip('"').replace(" ", "&nbsp;")
            lines.append(f"| `{key}` | {one.help.replace('|', '&#124;')} | {default} |")
        lines.append("")
    for name, of in kind.entries().items():
        lines += [f"**[{name}]** {of.holds()}; may stand several times", "", "| key | meaning |"]
        lines += [
            "|---|---|",
            *(f"| `{key}` | {one.help} |" for key, one in of.described().items()),
            "",
        ]
    return lines


def ranges() -> list[str]:
    """Return the table of dimensionless groups in Markdown."""
    lines = ["| group | usual | refused outside of | source |", "|---|---|---|---|"]
    for name, one in RANGES.items():
        usual, possible = (f"{low:g} to {high:g}" for low, high in (one.usual, one.possible))
        lines.append(f"| {name}: {one.words} | {usual} | {possible} | {one.source} |")
    return [line.replace("-inf", "−∞").replace("inf", "∞") for line in lines]


class Listing(SphinxDirective):
    """List something in Markdown."""

    option_spec: ClassVar = {}

    def lines(self) -> list[str]:
        """Return the lines."""
        raise NotImplementedError

    def run(self) -> list[nodes.Node]:
        """Return their nodes."""
        parent = nodes.Element()
        parent.document = self.state.document
        nested_parse_with_titles(self.state, StringList(self.lines(), source="KINDS"), parent)
        return parent.children


class SceneKeys(Listing):
    """List the keys of all kinds, a section for each kind."""

    def lines(self) -> list[str]:
        """Return all sections."""
        return [line for kind in KINDS.values() for line in page_of(kind)]


class UsualRanges(Listing):
    """List the dimensionless groups."""

    def lines(self) -> list[str]:
        """Return the table."""
        return ranges()


def setup(app: Any) -> dict[str, Any]:
    """Register the directives."""
    app.add_directive("scene-keys", SceneKeys)
    app.add_directive("usual-ranges", UsualRanges)
    return {"parallel_read_safe": True}
