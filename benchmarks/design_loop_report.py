"""docs/performance.md and its picture from the rows of `design_loop.py` and `scale.py`."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import scale
from matplotlib.ticker import NullFormatter

Row = Mapping[str, Any]

FOLDER = Path(__file__).parent
COLOURS = {"coarse to fine": "#0a7fc2", "one mesh, whole": "#b8860b", "one mesh, half": "#4c9a4c"}
WAYS = {"levels": "coarse to fine", "before": "one mesh, whole"}
TITLES = {
    "bend": "bend, R = {radius:.3g} mm", "contract": "contract, R = {radius:.3g} mm",
    "twist": "twist, R = {radius:.3g} mm", "bend_twist": "bend and twist, R = {radius:.3g} mm",
    "walker": "walker, R = {radius:.3g} mm", "gripper": "gripper, R = {radius:.3g} mm",
}  # fmt: skip
# As in printed values: degrees and per cent.
UNITS = {"deg": "°", "percent": " %", "mm": " mm"}
DPI = 80


def write_docs(folder: Path, designs: Path, sizes: Path) -> None:
    """Write performance.md and performance.png into the documentation's folder.

    Args:
        folder: The folder.
        designs: Rows of `design_loop.py`.
        sizes: Rows of `scale.py`.
    """
    rows = json.loads(designs.read_text(encoding="utf-8"))["rows"]
    folder.mkdir(parents=True, exist_ok=True)
    draw(folder / "performance.png", rows)
    grown = json.loads(sizes.read_text(encoding="utf-8"))
    (folder / "performance.md").write_text(text(rows, grown), encoding="utf-8")


def text(rows: Sequence[Row], sizes: Sequence[Row]) -> str:
    """Return performance.md."""
    prose = (FOLDER / "design_loop_text.md").read_text(encoding="utf-8")
    for mark, content in (
        ("<!-- machine -->", machine(rows)),
        ("<!-- total -->", total(rows)),
        ("<!-- gain -->", gain(rows)),
        ("<!-- designs -->", designs_table(rows)),
        ("<!-- cost -->", cost_table(rows)),
        ("<!-- cores -->", cores_table(rows)),
        ("<!-- scale -->", scale.table(list(sizes))),
        ("<!-- ours -->", ours_table(rows)),
    ):
        assert mark in prose, mark
        prose = prose.replace(mark, content.strip())
    return prose


def way(row: Row) -> str:
    """Return the way of a design in words."""
    return "one mesh, half" if row["way"] == "levels" and row["levels"] == 1 else WAYS[row["way"]]


def title(row: Row) -> str:
    """Return scene and filter radius."""
    return TITLES[row["scene"]].format(radius=row["radius_mm"])


def cores(row: Row) -> str:
    """Return ranks and threads in words."""
    if row["ranks"] > 1:
        return f"{row['ranks']} ranks"
    return "1 rank" if row["threads"] == 1 else f"1 rank, {row['threads']} threads"


def values(row: Row, key: str) -> str:
    """Return the metrics under a key, each with its unit."""
    found = []
    for name, value in row[key].items():
        unit = UNITS.get(name.rpartition("_")[2], "")
        found.append("none" if value is None else f"{value:.{0 if key == 'asked' else 1}f}{unit}")
    return ", ".join(found)


def duration(seconds: float) -> str:
    """Return a time in s, or in min from ten minutes on."""
    return f"{seconds / 60:.1f} min" if seconds >= 600 else f"{seconds:.0f} s"


def number(count: int) -> str:
    """Return a number with a space between thousands."""
    return f"{count:,}".replace(",", " ")


def table(head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table."""
    parts = [head, ["---"] * len(head), *lines]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in parts) + "\n"


def beside(rows: Sequence[Row], row: Row) -> Row | None:
    """Return the design of the way before of the same case on the same cores."""
    for other in rows:
        same = all(other[key] == row[key] for key in ("case", "ranks", "threads"))
        if same and row["way"] == "levels" and other["way"] == "before":
            return other
    return None


def machine(rows: Sequence[Row]) -> str:
    """Return processor and versions in a sentence."""
    found = rows[0]["machine"]
    versions = found["versions"]
    return (
        f"Measured with {found['cores']} cores ({found['processor']}), dolfinx "
        f"{versions['dolfinx']}, Python {versions['python']}."
    )


def total(rows: Sequence[Row]) -> str:
    """Return the minutes of all designs with their files."""
    return f"{sum(row['seconds'] + row['files_seconds'] for row in rows) / 60:.0f}"


def gain(rows: Sequence[Row]) -> str:
    """Return by how much each design is faster than in the way before."""
    lines = []
    for row in rows:
        old = beside(rows, row)
        if old is not None:
            times = f"{old['seconds'] / row['seconds']:.1f} times as fast"
            lines.append(
                f"- {title(row)}, {cores(row)}: {duration(old['seconds'])} → "
                f"{duration(row['seconds'])}, {times}; printed {values(old, 'printed')} → "
                f"{values(row, 'printed')} of {values(row, 'asked')}"
            )
    return "\n".join(lines)


def designs_table(rows: Sequence[Row]) -> str:
    """Return time, memory and result of each design."""
    head = (
        "design", "triangles", "way", "cores", "levels", "time", "peak memory", "printed", "asked",
        "T printed", "pressure", "islands",
    )  # fmt: skip
    return table(
        head,
        (
            (
                title(row),
                number(row["triangles"]),
                way(row),
                cores(row),
                f"{row['levels']}",
                duration(row["seconds"]),
                f"{row['peak_gib']:.2f} GiB",
                values(row, "printed"),
                values(row, "asked"),
                "none" if row["printed_objective"] is None else f"{row['printed_objective']:.2e}",
                f"{1e-3 * row['pressure_pa']:.1f} kPa",
                f"{row['islands']}",
            )
            for row in rows
        ),
    )


def cost_table(rows: Sequence[Row]) -> str:
    """Return what the steps of each design cost."""
    head = (
        "design", "way", "cores", "steps", "rejected", "Newton steps", "factorisations",
        "finest mesh: steps", "its factorisations", "a step: median", "mean", "s a step",
        "gradient / forward",
    )  # fmt: skip
    return table(
        head,
        (
            (
                title(row),
                way(row),
                cores(row),
                f"{row['steps']}",
                f"{row['rejected']}",
                f"{row['newton_steps']}",
                f"{row['factorisations']}",
                f"{row['finest_steps']}",
                f"{row['finest_factorisations']}",
                f"{row['median_factorisations']:g}",
                f"{row['mean_factorisations']:.1f}",
                f"{row['median_step_seconds']:.2f}",
                f"{row['gradient_over_forward']:.3f}",
            )
            for row in rows
        ),
    )


def cores_table(rows: Sequence[Row]) -> str:
    """Return how much faster both cores are than one, for whole designs and at equal work."""
    head = (
        "design", "way", "cores", "time", "s per factorisation", "s per Newton step",
        "whole design", "per factorisation", "per Newton step",
    )  # fmt: skip
    lines = []
    for row in rows:
        twins = [r for r in rows if (r["case"], r["way"]) == (row["case"], row["way"])]
        one = next((r for r in twins if (r["ranks"], r["threads"]) == (1, 1)), None)
        if one is None or len(twins) < 2:
            continue
        rates = ("seconds", "seconds_per_factorisation", "seconds_per_newton_step")
        ratios = ["1"] * 3 if row is one else [f"{one[key] / row[key]:.2f}" for key in rates]
        lines.append((
            title(row), way(row), cores(row), duration(row["seconds"]),
            *(f"{row[key]:.3f}" for key in rates[1:]), *ratios,
        ))  # fmt: skip
    return table(head, lines)


def ours_table(rows: Sequence[Row]) -> str:
    """Return a design step on the finest mesh of each case, as the table of others has it."""
    shown = [row for row in rows if row["way"] == "levels"]
    head = ("ours", "triangles simulated", "cores", "factorisations a step", "s a step")
    return table(
        head,
        (
            (
                title(row),
                number(row["triangles"] // row["parts_by_symmetry"]),
                cores(row),
                f"{row['median_factorisations']:g}",
                f"{row['median_step_seconds']:.2f}",
            )
            for row in shown
        ),
    )


def draw(path: Path, rows: Sequence[Row]) -> None:
    """Draw the objective over seconds, a panel for each scene and size, all ways on one core."""
    titles = list(dict.fromkeys(title(row) for row in rows))
    across = min(len(titles), 3)
    down = -(-len(titles) // across)
    figure, axes = plt.subplots(
        down, across, figsize=(1 + 3.4 * across, 3.2 * down), squeeze=False, layout="constrained"
    )
    for panel in axes.ravel()[len(titles) :]:
        panel.set_axis_off()
    for panel, name in zip(axes.ravel(), titles, strict=False):
        own = [row for row in rows if title(row) == name]
        one = [row for row in own if (row["ranks"], row["threads"]) == (1, 1)] or own[:1]
        for row in one:
            _curve(panel, row)
        panel.set_xscale("log")
        panel.set_yscale("log")
        for axis in (panel.xaxis, panel.yaxis):
            axis.set_minor_formatter(NullFormatter())
        panel.set_title(f"{name}, {cores(one[0])}", fontsize=9)
        panel.set_xlabel("seconds")
        panel.set_ylabel("objective T")
        panel.grid(alpha=0.3)
        panel.legend(fontsize=8)
    figure.savefig(path, dpi=DPI)
    plt.close(figure)


def _curve(panel: Any, row: Row) -> None:
    """Draw one design; a dot marks the start of each level, a cross its end."""
    seconds, objective, level = zip(*row["history"], strict=True)
    colour = COLOURS[way(row)]
    panel.plot(seconds, objective, color=colour, lw=1, label=way(row))
    starts = [k for k in range(len(level)) if k == 0 or level[k] != level[k - 1]]
    panel.plot(
        [seconds[k] for k in starts], [objective[k] for k in starts], "o", color=colour, ms=4
    )
    panel.plot(seconds[-1:], objective[-1:], "x", color=colour, ms=6)
