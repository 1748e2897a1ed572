"""Make the gallery: docs/gallery/index.md, and the small files for printer and cutter beside it.

    python3 docs/copy_pictures.py
    python3 docs/make_gallery.py

The figures are those of `benchmarks/rows/figures.csv`, the pictures those in demos/pictures/, and
the files those of the same runs. `make pictures` does all of it.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from copy_pictures import COPIES, PICTURES, ROOT, SIZE

from benchmarks.bench import ROWS, Rows, read
from benchmarks.figures import ACROSS, DEMOS, Demo, folder_of, told_of

GALLERY = ROOT / "docs" / "gallery"
PAGE = GALLERY / "index.md"
# Files of a run to be had, with what they are, and the size in bytes up to which they are kept.
FILES = {"print_1.3mf": "print", "cut_1.svg": "panels"}
LARGEST = 500_000
# Pictures in the order in which they are shown, with their words; the first has its own line.
SHOWN = {
    "hero.png": "inflation", "profile.png": "stiffness",
    "inflation.png": "inflation", "inflation.gif": "film", "gait.gif": "gait",
    "shape.png": "shape", "curve.png": "curve", "gait.png": "phases", "tracks.png": "tracks",
    "lift.png": "lift", "lines.png": "lines", "pattern.png": "pattern", "deformed.png": "deformed",
    "miss.png": "miss", "design.png": "design",
}  # fmt: skip
HEAD = """\
# Gallery

Simulated prints of the demos; pictures and files are of the `--coarse` runs. To print one, leave
`--coarse` out: a coarse print is a preview.
± is the [error of the mesh](../accuracy.md#the-interval-of-a-result).
[Demos](../../demos/README.md) has the paper's values, and what falls short;
[reports](../report.md#the-pictures) explain pictures.
`worst` is the largest deviation from the asked stiffness. Files above 0.5 MB are not stored here;
the command makes them."""


def page(rows: Rows) -> str:
    """Return the page of the rows of figures.csv, with the files that the gallery has."""
    return "\n\n".join([HEAD, *(_section(demo, rows) for demo in shown_demos())]) + "\n"


def pictures_of(demo: Demo) -> dict[str, str]:
    """Return the pictures of a demo's run, by the file that each is in there."""
    return {file: picture for picture, (run, file) in COPIES.items() if run == demo.name}


def shown_demos() -> list[Demo]:
    """Return the demos with sections; one that has a single picture is shown with its scene."""
    return [demo for demo in DEMOS if len(pictures_of(demo)) > 1]


def place_of(demo: Demo) -> Path:
    """Return the folder of a demo's files."""
    return GALLERY / folder_of(demo, SIZE).name


def _section(demo: Demo, rows: Rows) -> str:
    own = pictures_of(demo)
    first, *others = (_image(words, own[file]) for file, words in SHOWN.items() if file in own)
    for other in DEMOS:
        pictures = pictures_of(other)
        if other.scene == demo.scene and len(pictures) == 1:
            others.append(_image("".join(other.changes), *pictures.values()))
    scene = f"../../demos/scenes/{demo.scene}.toml"
    place = place_of(demo)
    links = [f"[scene]({scene})"] + [
        f"[{words}]({place.name}/{file})"
        for file, words in FILES.items()
        if (place / file).exists()
    ]
    items = "\n".join(f"- {line}" for line in (*_results(demo, rows), ", ".join(links)))
    return "\n\n".join([f"## {demo.name}", first, *_table(others), items])


def _image(words: str, picture: str) -> str:
    return f"![{words}](../../demos/{PICTURES.name}/{picture})"


def _table(images: Sequence[str]) -> Iterator[str]:
    """Yield images in rows beside each other, as a table; one stands for itself."""
    if len(images) < 2:
        yield from images
    else:
        columns = min(ACROSS, len(images))
        lines = [f"|{'|'.join(images[k : k + columns])}|" for k in range(0, len(images), columns)]
        yield "\n".join([lines[0], "|" + "---|" * columns, *lines[1:]])


def _results(demo: Demo, rows: Rows) -> Iterator[str]:
    """Yield command, time, figures and states of a demo on each mesh."""
    changes = "".join(f" --set {change}" for change in demo.changes)
    command = f"`scripts/toros {demo.command} demos/scenes/{demo.scene}.toml{changes} --coarse`"
    for size, words in ((SIZE, command), ("full", "without `--coarse`")):
        told, took = told_of(demo, rows, size)
        if told:
            yield f"{', '.join(filter(None, (words, took)))}: {told}"


def main() -> int:
    """Copy the files of the runs that there are, and write the page."""
    for demo in shown_demos():
        made = folder_of(demo, SIZE) / "manufacture"
        if not made.is_dir():
            continue
        shutil.rmtree(place_of(demo), ignore_errors=True)
        for file in FILES:
            if (made / file).exists() and (made / file).stat().st_size <= LARGEST:
                place_of(demo).mkdir(parents=True, exist_ok=True)
                shutil.copyfile(made / file, place_of(demo) / file)
    GALLERY.mkdir(exist_ok=True)
    PAGE.write_text(page(read(ROWS / "figures.csv")), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
