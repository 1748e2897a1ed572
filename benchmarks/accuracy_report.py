"""Pictures and docs/accuracy.md from the rows of `accuracy.py`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from accuracy_case import GROUPS, Case, Row
from matplotlib.ticker import LogLocator, NullFormatter

COLOURS = {"average": "#b8860b", "quadratic": "#0a7fc2", "midedge": "#d1242f"}
OTHER = "#132033"
DPI = 80
# Below it references end, and an order says nothing.
EXACT = 1e-7
# What the bending terms are compared by.
ENOUGH = 1e-2
IRREGULAR = ("union-jack", "crossed", "unstructured", "jittered")

TITLES = {
    "membrane": "Membrane",
    "bending": "Bending",
    "contact": "Contact",
    "patterns": "Kinematics of patterns",
    "gradients": "Gradients",
}


def draw(folder: Path, cases: Sequence[Case], rows: Sequence[Row]) -> None:
    """Write a work-precision picture of each case that has several refinements."""
    folder.mkdir(parents=True, exist_ok=True)
    for case in cases:
        own = [row for row in rows if row.case == case.name and row.relative_error > 0]
        drawn = case.group != "gradients" and len({row.triangles for row in own}) > 1
        if drawn and max(row.relative_error for row in own) > EXACT:
            _picture(folder / f"{case.name}.png", case, own)


def _picture(path: Path, case: Case, rows: Sequence[Row]) -> None:
    meshes = [mesh for mesh in case.meshes if any(row.mesh == mesh for row in rows)]
    figure, axes = plt.subplots(
        1, len(meshes), figsize=(1 + 2.6 * len(meshes), 3.2), sharex=True, sharey=True,
        squeeze=False, layout="constrained",
    )  # fmt: skip
    for panel, mesh in zip(axes[0], meshes, strict=True):
        for formulation in case.formulations:
            part = [row for row in rows if (row.mesh, row.formulation) == (mesh, formulation)]
            panel.loglog(
                [row.seconds for row in part],
                [row.relative_error for row in part],
                "o-",
                ms=4,
                color=COLOURS.get(formulation, OTHER),
                label=formulation,
            )
        if case.within is not None:
            panel.axhline(case.within, color="0.6", lw=0.8, ls=":")
        panel.set_title(mesh, fontsize=10)
        panel.set_xlabel("seconds")
        panel.grid(alpha=0.3)
        for axis in (panel.xaxis, panel.yaxis):  # powers of ten are enough
            axis.set_minor_formatter(NullFormatter())
            axis.set_major_locator(LogLocator(numticks=5))
    axes[0, 0].set_ylabel("relative error")
    axes[0, 0].legend(fontsize=8)
    figure.suptitle(f"{case.name}: {case.quantity}", fontsize=11)
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def write_docs(folder: Path, cases: Sequence[Case], rows: Sequence[Row]) -> None:
    """Write accuracy.md and its pictures into the documentation's folder."""
    pictures = folder / "accuracy"
    draw(pictures, cases, rows)
    text = []
    for group in GROUPS:
        text.append(f"\n## {TITLES[group]}\n")
        for case in cases:
            own = [row for row in rows if row.case == case.name]
            if case.group == group and own:
                picture = pictures / f"{case.name}.png"
                text.append(_section(case, own, picture=picture.exists()))
    prose = (Path(__file__).parent / "accuracy_text.md").read_text(encoding="utf-8")
    for mark, content in (
        ("<!-- summary -->", _summary(cases, rows)),
        ("<!-- comparison -->", _comparison(cases, rows)),
        ("<!-- cases -->", "\n".join(text)),
    ):
        prose = prose.replace(mark, content.strip())
    (folder / "accuracy.md").write_text(prose, encoding="utf-8")


def _section(case: Case, rows: Sequence[Row], *, picture: bool) -> str:
    columns = len(case.sizes)
    lines = [f"### {case.name}\n", f"{case.about}\n"]
    lines += [f"{case.quantity}: **{case.reference:.9g}** ({case.source}). {case.note}\n"]
    errors = "".join(f" error {k + 1} |" for k in range(columns))
    lines.append(f"| formulation | mesh |{errors} order | triangles | value | seconds |")
    lines.append("|---|---|" + "---|" * (columns + 4))
    for formulation in case.formulations:
        for mesh in case.meshes:
            part = [row for row in rows if (row.formulation, row.mesh) == (formulation, mesh)]
            if not part:
                continue
            cells = [f"{row.relative_error:.1e}" for row in part] + ["-"] * (columns - len(part))
            last = part[-1]
            known = last.observed_order is not None and case.group != "gradients"
            known &= last.relative_error > EXACT
            order = f"{last.observed_order:.1f}" if known else "-"
            cells += [order, f"{last.triangles}", f"{last.value:.7g}", f"{last.seconds:.2g}"]
            lines.append(f"| {formulation} | {mesh} | " + " | ".join(cells) + " |")
    if picture:
        lines.append(f"\n![error over seconds](accuracy/{case.name}.png)")
    return "\n".join(lines) + "\n"


def _summary(cases: Sequence[Case], rows: Sequence[Row]) -> str:
    """Return what the finest meshes of every case with a required accuracy reach."""
    lines = ["| case | required | finest error, worst mesh | reached |", "|---|---|---|---|"]
    for case in cases:
        own = [row for row in rows if row.case == case.name]
        if case.within is None or not own:
            continue
        best = [f for f in case.formulations if f in ("midedge", "membrane")]
        worst = max(
            min(r.relative_error for r in own if (r.mesh, r.formulation) == (mesh, best[0]))
            for mesh in case.meshes
            if any((r.mesh, r.formulation) == (mesh, best[0]) for r in own)
        )
        met = "yes" if worst <= case.within else "**no**"
        lines.append(f"| {case.name} | {case.within:g} | {worst:.1e} | {met} |")
    return "\n".join(lines) + "\n"


def _comparison(cases: Sequence[Case], rows: Sequence[Row]) -> str:
    names = tuple(COLOURS)
    lines = ["| case | mesh | " + " | ".join(names) + " |", "|---|---|" + "---|" * len(names)]
    for case in cases:
        for mesh in case.meshes:
            if case.group != "bending" or mesh not in IRREGULAR:
                continue
            cells = []
            for name in names:
                searched = (case.name, mesh, name)
                found = [row for row in rows if (row.case, row.mesh, row.formulation) == searched]
                cells.append(_time_to(found))
            if any(cells):
                lines.append(f"| {case.name} | {mesh} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _time_to(rows: Sequence[Row]) -> str:
    """Seconds from which on the error is small enough, by interpolation; else the last error."""
    if not rows:
        return ""
    if rows[-1].relative_error > ENOUGH:
        return f"({100 * rows[-1].relative_error:.2g} %)"
    above = [k for k, row in enumerate(rows) if row.relative_error > ENOUGH]
    if not above:
        return f"{rows[0].seconds:.2g} s or less"
    before, after = rows[above[-1]], rows[above[-1] + 1]
    error = np.log([before.relative_error, max(after.relative_error, 1e-16)])
    time = np.log([before.seconds, after.seconds])
    return f"{float(np.exp(np.interp(-np.log(ENOUGH), -error, time))):.2g} s"
