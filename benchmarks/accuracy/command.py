"""The benchmark `accuracy`: all cases with a known answer, and the tables of their pages.

The tables state the error on the default mesh and on the finest one. Neither is the best of
several: a mesh that is right by chance does not count.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import groupby

import numpy as np

from benchmarks.accuracy.bending import BENDING
from benchmarks.accuracy.contact import CONTACT
from benchmarks.accuracy.known import GROUPS, Known, rows_of
from benchmarks.accuracy.membrane import MEMBRANE
from benchmarks.accuracy.paths import path_cases, roof_table
from benchmarks.accuracy.patterns import PATTERNS
from benchmarks.accuracy.tiles import tile_cases, tile_table
from benchmarks.bench import Case, Command, Row, Rows, Table, markdown

KNOWN: tuple[Known, ...] = (*MEMBRANE, *BENDING, *CONTACT, *PATTERNS)
BY_NAME = {known.name: known for known in KNOWN}
# Below it references end, and an order says nothing.
EXACT = 1e-7
# What the bending terms are compared by, on the meshes that people get.
ENOUGH, TIME = 1e-2, "time to 1 %"
IRREGULAR = ("union-jack", "crossed", "unstructured", "jittered")
TERMS = ("average", "midedge")


def cases(quick: bool) -> list[Case]:
    """Return all cases, one for each formulation and kind of mesh."""
    known = [
        Case(k.name, partial(_rows, k, formulation, mesh, quick), f"{formulation} {mesh}")
        for k in KNOWN
        for formulation in k.formulations
        for mesh in k.meshes
    ]
    return [*known, *path_cases(quick), *tile_cases(quick)]


def _rows(known: Known, formulation: str, mesh: str, quick: bool) -> list[Row]:
    one = replace(known, formulations=(formulation,), meshes=(mesh,))
    return list(rows_of(one, quick=quick))


def condense(rows: Rows) -> list[Row]:
    """Keep all errors, the rest of the finest mesh, and the time to a small error."""
    found: list[Row] = []
    for (name, variant), group in groupby(rows, lambda row: (row.case, row.variant)):
        own = list(group)
        if name not in BY_NAME:
            found += own
            continue
        last = f"{BY_NAME[name].sizes[-1]}"
        found += [row for row in own if row.figure in ("error", TIME) or row.size == last]
        known = any(row.figure == TIME for row in own)
        if BY_NAME[name].group == "bending" and variant.endswith(IRREGULAR) and not known:
            found.append(_time([row for row in own if row.figure == "error"]))
    return found


def _time(rows: Rows) -> Row:
    """Return the seconds from which on the error is small enough; None if it never is."""
    last, errors = rows[-1], [row.value or 0.0 for row in rows]
    seconds = [row.seconds or 0.0 for row in rows]
    above = [k for k, error in enumerate(errors) if error > ENOUGH]
    value: float | None = None
    if not above:
        value = seconds[0]
    elif above[-1] + 1 < len(rows):
        ends = slice(above[-1], above[-1] + 2)
        error = np.log(np.maximum(errors[ends], 1e-16))
        value = float(np.exp(np.interp(-np.log(ENOUGH), -error, np.log(seconds[ends]))))
    return Row(last.case, last.variant, "", TIME, value, "s", machine=last.machine,
               measured=last.measured, note="" if above else "or less")  # fmt: skip


def errors_of(rows: Rows, name: str) -> dict[str, dict[int, float]]:
    """Return the errors of a case by variant and size."""
    found: dict[str, dict[int, float]] = {}
    for row in rows:
        if row.case == name and row.figure == "error" and row.value is not None:
            found.setdefault(row.variant, {})[int(row.size)] = row.value
    return found


def summary(rows: Rows) -> str:
    """Return what every case with a required accuracy reaches, on the worst kind of mesh."""
    lines = []
    for known in KNOWN:
        default = "midedge" if "midedge" in known.formulations else "membrane"
        errors = [e for v, e in errors_of(rows, known.name).items() if v.startswith(default)]
        if known.within is None or not errors:
            continue
        middle, finest = (
            max(by_size[size] for by_size in errors)
            for size in (known.default_size, known.sizes[-1])
        )
        met = "" if finest <= known.within else ", **missed**"
        lines.append((known.name, f"{known.within:g}{met}", f"{middle:.1e}", f"{finest:.1e}"))
    return markdown(("case", "required", "default mesh", "finest mesh"), lines)


def comparison(rows: Rows) -> str:
    """Return when the error of each bending term is small enough, on the worst kind of mesh."""
    lines = []
    spent = {(row.case, row.variant): row for row in rows if row.figure == TIME}
    for known in BENDING:
        errors = errors_of(rows, known.name)
        meshes = [mesh for mesh in known.meshes if mesh in IRREGULAR]
        cells = []
        for term in TERMS if meshes else ():
            found = {mesh: spent[known.name, f"{term} {mesh}"].value for mesh in meshes}
            late = [
                errors[f"{term} {mesh}"][known.sizes[-1]]
                for mesh, value in found.items()
                if value is None
            ]
            slowest = max((value for value in found.values() if value is not None), default=0.0)
            cells.append(f"({100 * max(late):.2g} %)" if late else f"{slowest:.2g} s")
        if cells:
            lines.append((known.name, len(meshes), *cells))
    return markdown(("case", "kinds of meshes", *TERMS), lines)


def sections(rows: Rows) -> str:
    """Return the section of each case, with the errors of all its meshes."""
    text = []
    for group, title in GROUPS.items():
        text.append(f"## {title}")
        text += [
            _section(known, rows)
            for known in KNOWN
            if known.group == group and errors_of(rows, known.name)
        ]
    return "\n\n".join(text)


def _section(known: Known, rows: Rows) -> str:
    finest = {
        (row.variant, row.figure): row
        for row in rows
        if row.case == known.name and row.size == f"{known.sizes[-1]}"
    }
    lines = []
    for variant, errors in errors_of(rows, known.name).items():
        value, triangles = finest[variant, "value"], finest[variant, "triangles"].value
        order = finest.get((variant, "order"))
        known_order = order is not None and order.value is not None
        shown = known_order and errors[known.sizes[-1]] > EXACT
        cells = [f"{errors[size]:.1e}" for size in known.sizes]
        cells.append(f"{order.value:.1f}" if shown and order else "-")
        spent = value.seconds or 0.0
        shown_time = f"{spent:.0f}" if spent >= 100 else f"{spent:.2g}"
        cells += [f"{triangles:.0f}", f"{value.value:.7g}", shown_time]
        lines.append((*variant.split(), *cells))
    heads = [f"error {k + 1}" for k in range(len(known.sizes))]
    table = markdown(
        ("formulation", "mesh", *heads, "order", "triangles", "value", "seconds"), lines
    )
    about = f"{known.quantity}: **{known.reference:.9g}** ({known.source}). {known.note}".rstrip()
    return f"### {known.name}\n\n{known.about}\n\n{about}\n\n{table}"


COMMAND = Command(
    about=__doc__,
    cases=cases,
    condense=condense,
    bad=lambda row: row.figure == "value" and not np.isfinite(row.value or np.nan),
    tables=(
        Table("accuracy.md", "accuracy, summary", summary),
        Table("accuracy.md", "accuracy, bending terms", comparison),
        Table("limit_points.md", "limits of the roof", roof_table),
        Table("tiles.md", "time and error of tiles", tile_table),
    ),
)
