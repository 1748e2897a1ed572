"""The page make_it.html: pictures of every sheet, and the order of work in five steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from importlib import resources
from string import Template
from typing import Any

from toros_fem.making.sheets.pictures import seam_colour, seam_picture, sheet_picture
from toros_fem.making.sheets.sewing_order import CLOSING
from toros_fem.making.sheets.sheets import Layout
from toros_fem.measures.figures import formatted, split_key

NAME = "make_it.html"
# What a sewer has to know of each kind of seam.
WORDS = {
    "dart": "a dart: sew from its wide end to its tip",
    "flat": "joins two pieces that still lie flat",
    "edge": "joins two edges of one piece",
    "ring": "a ring: pin all notches before you sew",
    "closing": "the last one: leave the opening for the bladder",
}


def page(made: Mapping[str, Any], layout: Layout, film: Layout | None, title: str) -> str:
    """Return the page as HTML that needs no other file.

    Args:
        made: The manifest.
        layout: Panels at their places.
        film: Sheets of the bladder at their places; None without one.
        title: Name of the design.
    """
    folder = resources.files("toros_fem.making.sheets")
    template = folder.joinpath("make_it.html").read_text("utf-8")
    parts = {
        "title": escape(title),
        "version": escape(f"toros_fem {made['versions']['toros_fem']}"),
        "face": escape(made["options"]["print_side"]),
        "needs": _pairs(_needs(made)),
        "beds": "".join(_bed(made, layout, k) for k in range(len(layout.beds))),
        "sheets": "".join(_sheet(made, layout, k) for k in range(len(layout.sheets))),
        "sewing": _sewing(made, layout),
        "insert": _insert(made, film),
        "inflate": _inflate(made),
        "files": _pairs([(f["name"], f["shows"]) for f in made["files"]]),
    }
    return Template(template).substitute(parts)


def _needs(made: Mapping[str, Any]) -> list[tuple[str, str]]:
    sheets, printed, options = made["sheets"], made["print"], made["options"]
    wide, deep = sheets[0]["size_mm"]
    found = [
        (
            "fabric",
            f"{_count(len(sheets), 'sheet')} of {wide:g} × {deep:g} mm, grain along the depth",
        ),
        (
            "print",
            f"{printed['print_area_mm2'] / 100:.1f} cm², "
            f"{1e3 * options['layer_height']:g} mm high: "
            f"{printed['print_volume_mm3'] / 1e3:.2f} cm³, {printed['print_mass_g']:.2f} g",
        ),
        ("seams", _seam_count(made)),
    ]
    if options["copies"] > 1:
        found.insert(0, ("to make", f"{options['copies']} skins, which are all sewn alike"))
    materials = made["materials"]
    if "fabric_young" in materials and "thickness" in materials:
        thick = materials["thickness"]
        both = materials.get("reinforcement_thickness") or thick
        found.append(
            (
                "designed for",
                f"fabric of E h = {materials['fabric_young'] * thick:.3g} N/m, "
                f"printed fabric of E h = {materials['reinforcement_young'] * both:.3g} N/m",
            )
        )
    if made["pressure_pa"] is not None:
        found.append(("pressure", f"{made['pressure_pa'] / 1e3:.3g} kPa"))
    return found


def _seam_count(made: Mapping[str, Any]) -> str:
    length = sum(seam["length_mm"] for seam in made["seams"])
    return f"{_count(len(made['seams']), 'seam')}, {length:.0f} mm together"


def _bed(made: Mapping[str, Any], layout: Layout, k: int) -> str:
    bed = made["beds"][k]
    wide, deep = bed["size_mm"]
    files = _names(made, "print", "bed", k + 1)
    told = f"{bed['print_mass_g']:.2f} g of print. {files}" if files else "Nothing is printed here."
    sheet, corner = layout.bed_on_sheet(k)
    where = f"sheet {sheet + 1}"
    if layout.grid != (1, 1):
        where += (
            f", {1e3 * corner[0]:g} mm from its left and {1e3 * corner[1]:g} mm from its near edge"
        )
    return (
        f'<figure class="on-bed">{sheet_picture(layout.beds[k], layout.bed, f"bed {k + 1}")}'
        f"<figcaption><b>bed {k + 1}</b>, {wide:g} × {deep:g} mm, {where}: "
        f"{escape(', '.join(bed['panels']))}. {told}"
        "</figcaption></figure>"
    )


def _sheet(made: Mapping[str, Any], layout: Layout, k: int) -> str:
    sheet = made["sheets"][k]
    wide, deep = sheet["size_mm"]
    return (
        f'<figure class="to-cut">{sheet_picture(layout.sheets[k], layout.sheet, f"sheet {k + 1}")}'
        f"<figcaption><b>sheet {k + 1}</b>, {wide:g} × {deep:g} mm, {sheet['fabric_used']:.0%} of "
        f"it used: {escape(', '.join(sheet['panels']))}. {_names(made, 'cut', 'sheet', k + 1)}"
        "</figcaption></figure>"
    )


def _sewing(made: Mapping[str, Any], layout: Layout) -> str:
    if not made["seams"]:
        return "<p>Nothing is sewn.</p>"
    pictures = "".join(
        f"<figure>{seam_picture(drawings, layout.sheet, f'seams on sheet {k}')}"
        f"<figcaption>sheet {k}</figcaption></figure>"
        for k, drawings in enumerate(layout.sheets, 1)
    )
    return (
        "<p>Edges with the same number belong together: right sides together, double notch on "
        "double notch, single notches on single ones. Sew on the dashed lines, with a stretch "
        f'stitch, in this order.</p><div class="pictures">{pictures}</div><div class="wide"><table>'
        "<thead><tr><th>order</th><th>seam</th><th>edge to edge</th><th>length</th><th>notches</th>"
        f"<th></th></tr></thead><tbody>{_rows(made)}</tbody></table></div>"
    )


def _rows(made: Mapping[str, Any]) -> str:
    by_number = {seam["number"]: seam for seam in made["seams"]}
    rows = []
    for place, step in enumerate(made["sewing"], 1):
        seam = by_number[step["seam"]]
        one, other = map(escape, seam["panels"])
        edges = f"{one} to {other}" if one != other else f"{one} to itself"
        note = WORDS[step["kind"]]
        if step["kind"] == CLOSING:
            note += f", {step['opening_mm']:.0f} mm"
        rows.append(
            f'<tr><td>{place}</td><td><i style="background:{seam_colour(step["seam"])}">'
            f"{step['seam']}</i></td><td>{edges}</td><td>{seam['length_mm']:.1f} mm</td>"
            f"<td>{len(seam['notches_mm'])}</td><td>{note}</td></tr>"
        )
    return "".join(rows)


def _insert(made: Mapping[str, Any], film: Layout | None) -> str:
    closing = [step for step in made["sewing"] if step["kind"] == CLOSING]
    openings = ", ".join(f"{step['opening_mm']:.0f} mm of seam {step['seam']}" for step in closing)
    if not closing:
        return "<p>No bladder goes in.</p>"
    weld = ""
    if film is not None:
        wide, deep = made["bladder"]["film_mm"]
        weld = (
            "<p>Cut the sheets of film, lay them on each other, and weld them along the dashed "
            "lines, edges with the same number together. The end of the tab stays open for the "
            "tube.</p>"
            f'<figure class="to-cut">{sheet_picture(film.sheets[0], film.sheet, "bladder")}'
            f"<figcaption>film of {wide:.0f} × {deep:.0f} mm. {_names(made, 'bladder')}"
            "</figcaption></figure>"
        )
    return (
        f"{weld}<p>Turn the skin right side out. Fold the bladder, push it in through the opening "
        f"({openings}) and spread it, without a twist. Its tab and tube leave through the opening."
        "</p>"
    )


def _inflate(made: Mapping[str, Any]) -> str:
    closing = [f"seam {step['seam']}" for step in made["sewing"] if step["kind"] == CLOSING]
    if not closing:
        return "<p>Nothing is inflated.</p>"
    told = []
    for key, value in made["metrics"].items():
        if value is not None:
            name, unit = split_key(key) or key.rsplit("_", 1)
            told.append(f"{name.replace('_', ' ')} {formatted(value, unit)}")
    found = f" The simulated print has {escape(', '.join(told))} there." if told else ""
    pressure = made["pressure_pa"]
    to = "" if pressure is None else f" to {pressure / 1e3:.3g} kPa"
    return (
        f"<p>Sew the rest of {' and of '.join(closing)} around the tube. Inflate it slowly{to}, "
        f"behind a shield, and look for open seams.{found}</p>"
    )


def _names(made: Mapping[str, Any], kind: str, key: str = "", number: int = 0) -> str:
    found = [
        f["name"] for f in made["files"] if f["kind"] == kind and (not key or f.get(key) == number)
    ]
    return ", ".join(f'<a href="{escape(name)}">{escape(name)}</a>' for name in found)


def _pairs(rows: Sequence[tuple[str, str]]) -> str:
    return "".join(f"<dt>{escape(name)}</dt><dd>{escape(text)}</dd>" for name, text in rows)


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}" if number == 1 else f"{number} {thing}s"
