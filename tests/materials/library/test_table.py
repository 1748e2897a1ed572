"""Tables of the library, on the terminal and in the documentation."""

import runpy
from dataclasses import replace

from helpers.scenes import ROOT

from toros_fem.cli.commands.materials import material_details, table_text
from toros_fem.materials.library.files import read_library
from toros_fem.materials.library.material import TRUSTS

LIBRARY = read_library()
SITE = runpy.run_path(str(ROOT / "docs" / "_extensions" / "table_texts.py"))


def test_page_has_the_tables_of_the_library() -> None:
    page = (ROOT / "docs" / "materials.md").read_text(encoding="utf-8")
    assert "```{table-of} materials\n" in page
    markdown = "\n".join(SITE["table_of"]("materials"))
    for word, meaning in TRUSTS.items():
        assert f"| {word} | {meaning} |\n" in markdown


def test_each_material_is_in_each_table() -> None:
    text, markdown = table_text(LIBRARY.values()), "\n".join(SITE["table_of"]("materials"))
    for name, entry in LIBRARY.items():
        assert f"\n{name} " in text
        assert f"\n| {name} | " in markdown
        assert f"\n- `{name}`, " in markdown
        assert entry.trust in material_details(entry)
    assert max(map(len, text.splitlines())) <= 96
    heads = [line for line in markdown.splitlines() if line.startswith("| name |")]
    assert ["c₁, c₂" in head for head in heads] == [True, False, False]
    fabrics = [entry for entry in LIBRARY.values() if entry.kind == "fabric"]
    assert "Prints" not in table_text(fabrics)
    assert table_text(fabrics).startswith("Fabrics\nname ")


def test_details() -> None:
    both = replace(LIBRARY["tpu-95a-on-jersey"], c1=1.5, density=0.3, note="a note")
    text = material_details(both)
    for line in (
        "tpu-95a-on-jersey: TPU 95A", "E h         13 kN/m", "c1          1.5",
        "mass        300 g/m²", "sheet       print and fabric as one", "note        a note",
        "stretches   1 to 1.1",
    ):  # fmt: skip
        assert f"\n{line}" in f"\n{text}"
    assert "knit ratio  1.52" in material_details(LIBRARY["rib-knit"])
