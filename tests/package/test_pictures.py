"""Pictures of README, demos and docs are those of the runs in the table of figures."""

import importlib
import re
import sys
from pathlib import Path

import pytest
from PIL import Image

from benchmarks.bench import ROWS, read
from benchmarks.figures import figure_of
from toros_fem.measures.miss import is_of_shape

ROOT = Path(__file__).resolve().parents[2]


sys.path.append(str(ROOT / "docs"))
MAKER, PAINTER = (importlib.import_module(name) for name in ("copy_pictures", "draw_pictures"))


def test_every_picture_comes_from_a_run() -> None:
    found = {path.name for path in MAKER.PICTURES.iterdir()}
    assert found == set(MAKER.COPIES)


def test_every_picture_of_a_page_is_drawn_and_shown() -> None:
    """All below docs/: `make pictures` draws each, and a page shows it."""
    found = {path.relative_to(PAINTER.DOCS) for path in PAINTER.DOCS.rglob("*.png")}
    assert {str(path) for path in found if not path.parts[0].startswith(("_", "."))} == set(
        PAINTER.DRAWN
    )
    pages = [(page.parent, page.read_text(encoding="utf-8")) for page in PAINTER.DOCS.rglob("*.md")]
    shown = {
        (folder / name).resolve()
        for folder, text in pages
        for name in re.findall(r"!\[[^]]*\]\(([\w./]+\.png)\)", text)
    }
    assert {(PAINTER.DOCS / name).resolve() for name in PAINTER.DRAWN} <= shown


@pytest.mark.parametrize("picture", PAINTER.DRAWN)
def test_a_drawn_picture_tells_what_its_table_tells(picture: str) -> None:
    """One that is older than its table is stale: `make pictures` draws it anew."""
    with Image.open(PAINTER.DOCS / picture) as image:
        told = image.info
    assert told["Title"] == f"docs/{picture}"
    if picture in PAINTER.TOLD:
        assert told["Description"] == PAINTER.TOLD[picture]()


def test_every_picture_is_shown_somewhere() -> None:
    """In a page of docs or demos, or in the README."""
    pages = [ROOT / "README.md", ROOT / "demos/README.md", *(ROOT / "docs").rglob("*.md")]
    text = "\n".join(page.read_text(encoding="utf-8") for page in pages)
    shown = set(re.findall(r"pictures/([\w.]+)\)", text))
    assert shown <= set(MAKER.COPIES)
    assert {name for name in MAKER.COPIES if name.endswith(("_hero.png", "_lines.png"))} <= shown


@pytest.mark.parametrize("picture", [name for name in MAKER.COPIES if not name.endswith("gif")])
def test_a_picture_tells_run_and_figures_of_the_table(picture: str) -> None:
    """One that is older than the table, or newer, is stale: `make pictures` makes both."""
    run, _ = MAKER.COPIES[picture]
    with Image.open(MAKER.PICTURES / picture) as image:
        told = image.info
    assert told["Title"] == f"{run}, {MAKER.SIZE}"
    rows = [
        row
        for row in read(ROWS / "figures.csv")
        if (row.case, row.variant) == (run, MAKER.SIZE) and "." not in row.figure
    ]
    asked = [figure_of(row) for row in rows if row.reference is not None]
    figures = [figure for figure in asked if not is_of_shape(figure)]
    words = [figure.words for figure in figures] or [figure_of(row).words for row in rows]
    assert words
    if figures:
        assert told["Description"] == ", ".join(words)
    else:
        assert set(told["Description"].split(", ")) <= set(words)
