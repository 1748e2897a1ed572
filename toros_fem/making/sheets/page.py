"""The page make_it.html: pictures of every sheet, and the order of work in five steps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from importlib import resources
from typing import Any

from toros_fem.making.packages import required
from toros_fem.making.sheets.manifest import ONE_SHEET
from toros_fem.making.sheets.manufacture import Manufacture
from toros_fem.making.sheets.pictures import seam_colour, seam_picture, sheet_picture
from toros_fem.making.sheets.sewing_order import CLOSING
from toros_fem.measures.figures import Figure

NAME = "make_it.html"
# What a sewer has to know of each kind of seam.
WORDS = {
    "dart": "a dart: sew from its wide end to its tip",
    "flat": "joins two pieces that still lie flat",
    "edge": "joins two edges of one piece",
    "ring": "a ring: pin all notches before you sew",
    "closing": "the last one: leave the opening for the bladder",
}


def page(
    made: Manufacture,
    manifest: Mapping[str, Any],
    title: str,
    summary: Mapping[str, Any] | None = None,
) -> str:
    """Return the page, with a title, as HTML that needs no other file.

    Raises:
        MissingPackageError: jinja2 is not installed.
    """
    jinja2, safe = required("jinja2"), required("markupsafe").Markup
    text = resources.files("toros_fem.making.sheets").joinpath(NAME).read_text("utf-8")
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    places, film = made.layout, made.film
    shown: str = environment.from_string(text).render(
        title=title,
        made=manifest,
        corners=[places.bed_on_sheet(k)[1] for k in range(len(places.beds))],
        beds_on_sheet=places.grid[0] * places.grid[1],
        pictures={
            "beds": [safe(sheet_picture(b, f"bed {k}")) for k, b in enumerate(places.beds, 1)],
            "sheets": [
                safe(sheet_picture(s, f"sheet {k}")) for k, s in enumerate(places.sheets, 1)
            ],
            "seams": [
                safe(seam_picture(s, f"seams on sheet {k}")) for k, s in enumerate(places.sheets, 1)
            ],
            "film": None if film is None else safe(sheet_picture(film, "bladder")),
        },
        closing=[step for step in manifest["sewing"] if step["kind"] == CLOSING],
        seam_of={seam["number"]: seam for seam in manifest["seams"]},
        colour_of=seam_colour,
        words=WORDS,
        height_unknown=manifest["print"]["height_from"] == ONE_SHEET,
        metrics=_metrics(summary),
    )
    return shown


def _metrics(summary: Mapping[str, Any] | None) -> str:
    """Return the figures of a run's print that decide whether it is reached, in words."""
    figures = [
        Figure(*(row.get(one.name) for one in fields(Figure)))
        for row in (summary or {}).get("figures", [])
        if row["value"] is not None
    ]
    return ", ".join(figure.words for figure in figures if figure.state)
