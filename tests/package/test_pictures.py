"""Pictures of README, demos and docs are those of the runs in the table of figures."""

import importlib
import re
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image

from benchmarks.bench import ROWS, read
from benchmarks.figures import figure_of
from toros_fem.measures.miss import is_of_shape

ROOT = Path(__file__).resolve().parents[2]


sys.path.append(str(ROOT / "docs"))
MAKER, PAINTER, GALLERY = (
    importlib.import_module(name) for name in ("copy_pictures", "draw_pictures", "make_gallery")
)


def told_by_table(run: str) -> tuple[list[str], list[str]]:
    """Return what the table tells of a coarse run: figures with a target, and all."""
    rows = [
        row
        for row in read(ROWS / "figures.csv")
        if (row.case, row.variant) == (run, MAKER.SIZE) and "." not in row.figure
    ]
    asked = [figure_of(row) for row in rows if row.reference is not None]
    words = [figure.words for figure in asked if not is_of_shape(figure)]
    return words, [figure_of(row).words for row in rows]


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
    if picture in PAINTER.OF_BEND:
        assert told["Description"] == ", ".join(told_by_table("bend")[0])


def test_the_gallery_is_what_its_command_makes_of_the_table() -> None:
    """One that differs is stale: `make pictures` makes it."""
    rows = read(ROWS / "figures.csv")
    text = GALLERY.PAGE.read_text(encoding="utf-8")
    assert text == GALLERY.page(rows)
    other = [
        replace(row, value=12.3, note="± 4.5, missed")
        if (row.case, row.variant, row.figure) == ("bend", "coarse", "angle_deg")
        else row
        for row in rows
    ]
    before, changed = text.splitlines(), GALLERY.page(other).splitlines()
    (line,) = [line for old, line in zip(before, changed, strict=True) if line != old]
    assert line.startswith("- `scripts/toros design demos/scenes/bend.toml --coarse`, ")
    assert re.search(r" (s|min): angle 12\.3 ± 4\.5° of 180° \(missed\); shape", line)


def test_the_gallery_shows_every_picture_once() -> None:
    text = GALLERY.PAGE.read_text(encoding="utf-8")
    shown = re.findall(r"pictures/([\w.]+)\)", text)
    assert sorted(shown) == sorted(MAKER.COPIES)


def test_files_of_the_gallery_are_small_and_there_once() -> None:
    """A checkout is to stay small."""
    files = [path for path in GALLERY.GALLERY.rglob("*") if path.is_file()]
    contents = [path.read_bytes() for path in (*files, *MAKER.PICTURES.iterdir())]
    assert len(files) > 10
    assert sum(path.stat().st_size for path in files) < 6e6
    assert len(set(contents)) == len(contents)
    linked = {
        (GALLERY.GALLERY / name).resolve()
        for name in re.findall(r"\]\((\w+/[\w.]+)\)", GALLERY.PAGE.read_text(encoding="utf-8"))
    }
    assert linked == set(files) - {GALLERY.PAGE}


def texts_of(path: Path) -> dict[str, str]:
    """Texts of a PNG, or the lines of the last comment of a GIF."""
    if path.suffix == ".png":
        with Image.open(path) as image:
            return {str(key): str(value) for key, value in image.info.items()}
    blocks, text = path.read_bytes().rpartition(b"!\xfe")[2], b""
    while blocks[0]:
        text, blocks = text + blocks[1 : 1 + blocks[0]], blocks[1 + blocks[0] :]
    assert blocks == b"\0;", "it ends after the comment"
    return dict(line.split(": ", 1) for line in text.decode().splitlines())


@pytest.mark.parametrize("picture", MAKER.COPIES)
def test_a_picture_tells_run_and_figures_of_the_table(picture: str) -> None:
    """One that is older than the table, or newer, is stale: `make pictures` makes both."""
    run, _ = MAKER.COPIES[picture]
    told = texts_of(MAKER.PICTURES / picture)
    assert told["Title"] == f"{run}, {MAKER.SIZE}"
    asked, every = told_by_table(run)
    if asked:
        assert told["Description"] == ", ".join(asked)
    else:
        assert every
        assert set(told["Description"].split(", ")) <= set(every)
