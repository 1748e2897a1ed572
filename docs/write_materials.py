"""Writes the tables of docs/materials.md, from the library of materials."""

from __future__ import annotations

from pathlib import Path

from toros_fem.materials.library import read_library
from toros_fem.materials.library.table import table_markdown

PAGE = Path(__file__).parent / "materials.md"
BEGIN = "<!-- tables of the library, by docs/write_materials.py; do not edit -->\n"
END = "<!-- end of the tables -->\n"


def page_text(text: str) -> str:
    """Return the page with the tables of the shipped library."""
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n{table_markdown(read_library().values())}\n{END}{after}"


if __name__ == "__main__":
    PAGE.write_text(page_text(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
