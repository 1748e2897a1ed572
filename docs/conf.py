"""Settings of the documentation site, `make docs`."""

import os
import re
import sys
from dataclasses import MISSING
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.domains.python import PyObject

from toros_fem import __version__
from toros_fem.base.keys import Table

sys.path.insert(0, str(Path(__file__).parent / "_extensions"))

project = "toros_fem"
author = "The toros_fem developers"
copyright = author
version = release = __version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    "sphinx-mathjax-offline",
    "public_names",
    "tables",
]
exclude_patterns = ["_extensions"]
nitpicky = False

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
# Each page is also read as plain Markdown, where `$$ … $$ (label)` would show its label.
myst_dmath_allow_labels = False

napoleon_use_ivar = True
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
autodoc_type_aliases = {name: name for name in ("Floats", "Ints", "Bools", "LocalInts")}
maximum_signature_line_length = 80
python_use_unqualified_type_names = True
add_module_names = False
default_role = "code"

html_theme = "furo"
html_title = f"toros_fem {release}"
html_copy_source = False
html_show_sphinx = False
html_static_path = ["_static"]
html_css_files = ["site.css"]


# Pages of the checkout outside of docs/, and where they are on the site.
OUTSIDE = {
    "README": "index",
    "demos/README": "demos",
    "CHANGELOG": "project/changelog",
    "CONTRIBUTING": "project/contributing",
}


def link_inside(app: Any, doctree: nodes.document) -> None:
    """Lead links to pages outside of docs/ to their place on the site."""
    for link in doctree.findall(addnodes.pending_xref):
        place = os.path.relpath(app.srcdir / link["reftarget"], app.srcdir.parent)
        link["reftarget"] = OUTSIDE.get(place, link["reftarget"])


def escape_bars(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Escape the bars of |x| outside of code: reStructuredText takes them for substitutions."""
    for number, line in enumerate(lines):
        parts = re.split(r"(`[^`]*`)", line)
        parts[::2] = [part.replace("|", r"\|") for part in parts[::2]]
        lines[number] = "".join(parts)


def readable_signature(
    app: Any,
    what: str,
    name: str,
    obj: Any,
    options: Any,
    signature: str | None,
    returns: str | None,
) -> tuple[str | None, str | None]:
    """Name array types as the source does; leave out what tells nothing."""
    if what == "class" and (getattr(obj, "_is_protocol", False) or issubclass(obj, Table)):
        return "", returns
    plain = [
        text and re.sub(r"TypeAliasForwardRef\('(\w+)'\)", r"\1", text).replace("<factory>", "...")
        for text in (signature, returns)
    ]
    return plain[0], plain[1]


def list_settings(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """List the fields of a configuration: they have their meaning as data, not in a docstring."""
    if what != "class" or not issubclass(obj, Table) or obj is Table:
        return
    lines.append("")
    lines += [
        f":ivar {one.name}: {one.help}"
        + (f"; default ``{one.default}``" if one.default is not MISSING else "")
        for one in obj.described().values()
    ]
    lines.append("")


def join_names(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Join names that one entry documents: Sphinx takes a space for that between type and name."""
    for number, line in enumerate(lines):
        found = re.match(r":(?:param|ivar) ((?:\w+, )+\w+):", line)
        if found:
            lines[number] = line.replace(found[1], found[1].replace(", ", ","), 1)


def setup(app: Any) -> None:
    """Connect what this site adds to Sphinx."""
    for fields in PyObject.doc_field_types:
        if fields.name == "variable":
            fields.label = "Attributes"
    app.connect("doctree-read", link_inside)
    app.connect("autodoc-process-signature", readable_signature)
    app.connect("autodoc-process-docstring", escape_bars, priority=400)
    app.connect("autodoc-process-docstring", join_names, priority=600)
    app.connect("autodoc-process-docstring", list_settings, priority=700)
