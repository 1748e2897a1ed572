"""Make the pictures of pages that are no run of a scene, from committed tables or short commands.

    python3 demos/three_field.py --coarse --output output/three_field
    python3 docs/draw_pictures.py              # all of them, after docs/copy_pictures.py
    python3 docs/draw_pictures.py limits.png   # one of them

`make pictures` does all of it. The text in a file says what the picture tells; that of a picture of
a committed table is a sentence of the table, so that a test finds it if it is stale.
"""

from __future__ import annotations

import csv
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import groupby, pairwise
from pathlib import Path

import numpy as np
from copy_pictures import ROOT, with_facts
from matplotlib.axes import Axes
from matplotlib.ticker import NullFormatter
from mpi4py import MPI
from PIL import Image

from benchmarks import intervals
from benchmarks.accuracy import paths, snapping, tubes
from benchmarks.bench import ROWS, read, values_of
from benchmarks.figures import DEMOS, folder_of
from benchmarks.measured.command import COMPARED
from benchmarks.measured.compared import Compared, by_curve, place
from benchmarks.scale import STEP, growth
from toros_fem.base.errors import OutputError
from toros_fem.base.validation import Floats
from toros_fem.cli.commands.main import run
from toros_fem.forms.lines import fabric_factor
from toros_fem.materials.sheet import Bending, Composite
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.trace_point import TracePoint
from toros_fem.mechanics.skin.supports import clamp
from toros_fem.meshes import sew
from toros_fem.products.tubes import bend_metric
from toros_fem.results.pictures.of_run import facts_of
from toros_fem.results.pictures.raster import View
from toros_fem.results.pictures.shapes import plot_states
from toros_fem.results.pictures.shown import DrawnSkin
from toros_fem.results.pictures.style import (
    ACCENT,
    DARK,
    INK,
    SECOND,
    SERIES,
    SIZE,
    SOFT,
    TALL,
    page,
)
from toros_fem.results.report.page_file import write_report
from toros_fem.results.runs.frames import FOLDER, read_frames, read_skin
from toros_fem.results.runs.stored_run import read_run

DOCS = ROOT / "docs"
BEND = folder_of(next(demo for demo in DEMOS if demo.name == "bend"), "coarse")
THREE_FIELD = ROOT / "output" / "three_field"
# Ratio of the moduli, and c, of the table of crossed lines.
MODULI, CROSSING = 260, 0.71
# Twist and shortening that the paper measured.
PAPER = ("300°", "8 %")
# Parts of a step in the picture of the time that it takes.
PARTS = {
    "factorisation": ("factor_s",),
    "assembly, solution": ("assembly_s", "solve_s"),
    "all else": (
        "energy_s", "force_s", "sensitivity_s", "filter_s", "widths_s", "perimeter_s",
        "objective_s", "metrics_s", "mma_s",
    ),
}  # fmt: skip
# Pressure in Pa that fills the tube.
FILLED = 100.0
BROWSER = (
    "--headless=new", "--no-sandbox", "--hide-scrollbars", "--use-gl=angle",
    "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--virtual-time-budget=30000",
)  # fmt: skip


def number(cell: str) -> float:
    """Return the number that a cell of a table begins with."""
    return float(cell.replace("°", " ").replace("−", "-").split()[0])


def crossed() -> tuple[list[float], list[str], Floats]:
    """Return angles in degrees, shares in words, and the factors simulated and by the formula.

    The nets have lines of equal width, and E_p/E_f = 260.
    """
    with (DOCS / "crossed_lines.csv").open(encoding="utf-8", newline="") as file:
        rows = [*csv.DictReader(file)]
    shares = [*dict.fromkeys(row["shares"] for row in rows)]
    angles = [*dict.fromkeys(float(row["angle_deg"]) for row in rows)]
    values = [[float(row["simulated"]), float(row["formula"])] for row in rows]
    return angles, shares, np.reshape(values, (len(angles), len(shares), 2))


def crossed_told() -> str:
    """Return what the picture of crossed lines tells."""
    *_, values = crossed()
    off = np.abs(values[..., 1] / values[..., 0] - 1).max()
    return f"The formula for crossed lines is within {100 * off:.0f} % of simulated nets"


def draw_crossed(path: Path) -> None:
    """Draw the stiffening by crossed lines over their angle."""
    angles, shares, values = crossed()
    smooth = np.radians(np.linspace(20, 90, 100))
    with page(path, crossed_told(), SIZE) as figure:
        axes = figure.add_axes((0.09, 0.12, 0.72, 0.76))
        for k, name in enumerate(shares):
            parts = [float(part) for part in name.split("+")]
            curve = fabric_factor(
                parts, [1.0, np.cos(2 * smooth)], [0.0, np.sin(2 * smooth)], CROSSING * MODULI
            )
            axes.plot(np.degrees(smooth), curve, color=DARK, lw=1.4)
            axes.plot(angles, values[:, k, 0], "o", color=ACCENT, ms=5)
            label(axes, (90, float(curve[-1])), name, DARK, 12)
        axes.text(0.02, 0.95, "● simulated", color=ACCENT, transform=axes.transAxes)
        axes.text(0.02, 0.89, "— formula", color=DARK, transform=axes.transAxes)
        label(axes, (90, 17), "share of the area\nof both families", SOFT, 12)
        axes.set(yscale="log", xlim=(18, 92), yticks=[1, 2, 3, 5, 10], ylim=(0.9, 18),
                 xlabel="angle between the lines (°)",
                 ylabel="factor on the stiffness of the fabric")  # fmt: skip
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.grid(axis="y")


def label(axes: Axes, at: tuple[float, float], words: str, colour: str, right: float = 6) -> None:
    """Write words at the right of a point."""
    axes.annotate(words, at, (right, 0), textcoords="offset points", color=colour, va="center",
                  fontsize=8, annotation_clip=False)  # fmt: skip


def hand_drawn() -> dict[str, list[list[str]]]:
    """Return the rows of simulated lines by what they do, "twist" and "shortening"."""
    found: dict[str, list[list[str]]] = {}
    with (DOCS / "limits.csv").open(encoding="utf-8", newline="") as file:
        for name, *row in list(csv.reader(file))[1:]:
            found.setdefault(name, []).append(row)
    return found


def limits_told() -> str:
    """Return what the picture of the limits tells."""
    twist, short = (
        max(number(row[4]) for row in rows if row[1] == "26 MPa") for rows in hand_drawn().values()
    )
    return f"Drawn lines of 26 MPa reach {twist:.0f}° and {short:.1f} %, less than closed forms say"


def draw_limits(path: Path) -> None:
    """Draw simulated twist and shortening beside the closed forms and the paper's figures."""
    tables = hand_drawn()
    where = {"left": 0.36, "right": 0.97, "bottom": 0.09, "top": 0.84, "hspace": 0.35}
    keys = (("●", "simulated", DARK, 0.36), ("◇", "closed form, as printed", SECOND, 0.50),
            ("□", "closed form, ideal", SOFT, 0.76))  # fmt: skip
    with page(path, limits_told(), TALL) as figure:
        heights = [len(rows) for rows in tables.values()]
        grid = figure.subplots(2, 1, height_ratios=heights, gridspec_kw=where)
        for axes, (name, rows), paper in zip(grid, tables.items(), PAPER, strict=True):
            for k, row in enumerate(rows):
                values = [number(cell) for cell in row[4:] if cell]
                axes.plot(values, [k] * len(values), color=SOFT, lw=0.8, zorder=1)
                for value, (_, _, colour, _), mark in zip(values, keys, "oDs", strict=False):
                    inside = colour if mark == "o" else "white"
                    axes.plot(value, k, mark, color=colour, ms=6, mfc=inside)
            asked = float(paper.rstrip("° %"))
            axes.axvline(asked, color=ACCENT, ls="--", lw=1.2, zorder=0)
            axes.annotate(f"paper: {paper}", (asked, 1), (0, 3), color=ACCENT, fontsize=8,
                          xycoords=("data", "axes fraction"), textcoords="offset points",
                          ha="center")  # fmt: skip
            axes.set_yticks(range(len(rows)), [", ".join(row[:4]) for row in rows])
            axes.set(xlim=(0, None), ylim=(len(rows) - 0.4, -0.6), xlabel=f"{name} ({paper[-1]})")
            axes.grid(axis="x")
        for mark, words, colour, x in keys:
            figure.text(x, 0.905, f"{mark} {words}", color=colour)
        figure.text(0.02, 0.905, "lines, modulus, angle, pressure", color=SOFT)


def times() -> tuple[list[int], dict[str, list[float]]]:
    """Return the sizes in triangles, and the seconds of the parts of a step."""
    found = values_of(read(ROWS / "scale.csv"), "scale")
    by_size = dict(sorted((int(key[2]), figures) for key, figures in found.items()))
    assert sorted(name for names in PARTS.values() for name in names) == sorted(STEP)
    parts = {
        part: [sum(figures[name] or 0.0 for name in names) for figures in by_size.values()]
        for part, names in PARTS.items()
    }
    return list(by_size), parts


def times_told() -> str:
    """Return what the picture of the time of a step tells."""
    sizes, parts = times()
    first = next(iter(parts.values()))
    share = first[-1] / sum(values[-1] for values in parts.values())
    return (
        f"With {sizes[-1] / 1e3:.0f} k triangles, {100 * share:.0f} % of one pass is factorisation"
    )


def draw_times(path: Path) -> None:
    """Draw the time of the parts of a step over the size."""
    sizes, parts = times()
    with page(path, times_told(), SIZE) as figure:
        axes = figure.add_axes((0.09, 0.12, 0.68, 0.76))
        for k, (name, values) in enumerate(parts.items()):
            colour = ACCENT if k == 0 else DARK
            axes.plot(sizes, values, "o-", color=colour, ms=4, lw=1.4)
            label(axes, (sizes[-1], values[-1]), f"{name}: ~ n^{growth(sizes, values)}", colour)
        axes.set(xscale="log", yscale="log")
        axes.set(xlabel="triangles n", ylabel="CPU time of one pass (s)")
        axes.xaxis.set_major_formatter(lambda x, _: f"{x:,.0f}".replace(",", " "))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.grid(axis="y")


# Kinds of prints on long tubes have the colour of those on short ones.
LONG = "long "


def intervals_told() -> str:
    """Return what the picture of told intervals tells."""
    found = intervals.told_figures(read(ROWS / "intervals.csv"))
    held = sum(one.error <= one.width for one in found)
    part = f"{100 * held / len(found):.0f} %"
    return f"{held} of {len(found)} intervals contain the value of a finer mesh ({part})"


def draw_intervals(path: Path) -> None:
    """Draw errors over time, and half-widths over true errors, in parts of the change from rest."""
    found = intervals.told_figures(read(ROWS / "intervals.csv"))
    sizes = sorted({one.size for one in found}, reverse=True)
    short = [kind for kind in intervals.KINDS if not kind.startswith(LONG)]
    colours = dict(zip(short, (*SERIES, SOFT), strict=True))
    colours |= {k: colours[k.removeprefix(LONG)] for k in intervals.KINDS if k not in colours}
    with page(path, intervals_told(), SIZE) as figure:
        left, right = figure.subplots(
            1, 2, gridspec_kw={"left": 0.08, "right": 0.98, "bottom": 0.12, "top": 0.86,
                               "wspace": 0.25},
        )  # fmt: skip
        for kind, colour in colours.items():
            own = [one for one in found if one.kind == kind]
            mark = "^" if kind.startswith(LONG) else "o"
            rows = [[one for one in own if one.size == size] for size in sizes]
            rows = [row for row in rows if row]
            time = [np.nanmedian([one.seconds for one in row]) for row in rows]
            told = [np.median([one.error / one.change for one in row]) for row in rows]
            left.plot(time, 100 * np.array(told), f"{mark}-", color=colour, ms=4, lw=1.2)
            right.plot(
                [100 * one.error / one.change for one in own],
                [100 * one.width / one.change for one in own],
                mark, color=colour, ms=3, alpha=0.7, label=kind,
            )  # fmt: skip
        ends = np.array([0.05, 100.0])
        right.plot(ends, ends, color=INK, lw=0.8)
        right.plot(ends, 3 * ends, color=SOFT, lw=0.8, ls="--")
        right.text(0.5, 0.4, "as wide as the error", color=INK, rotation=38, ha="center", va="top")
        right.text(
            0.105, 0.36, "three times", color=SOFT, rotation=38, ha="center", va="bottom",
            fontsize=8,
        )  # fmt: skip
        left.set(xscale="log", yscale="log", xlabel="time of the solve (s)")
        left.set(xticks=[0.5, 1, 2, 4], yticks=[0.5, 1, 2, 5, 10, 20])
        left.set_ylabel("error of reported values (% of the change), median")
        right.set(xscale="log", yscale="log", xlim=ends, ylim=ends)
        right.set(xlabel="true error (% of the change)", ylabel="half-width (% of the change)")
        for axes in (left, right):
            axes.xaxis.set_major_formatter("{x:g}")
            axes.yaxis.set_major_formatter("{x:g}")
            axes.yaxis.set_minor_formatter(NullFormatter())
            axes.xaxis.set_minor_formatter(NullFormatter())
            axes.grid()
        right.legend(loc="lower right", frameon=False)


def limit_points_told() -> str:
    """Return what the picture of the limit points tells."""
    found = values_of(read(ROWS / "accuracy.csv"), "path-")
    roof, tube, lid = (
        found[place]["limit 1"]
        for place in (
            ("path-roof", "12.7 mm", "32"), ("path-tube", "", "24"), ("path-lid", "", "16"),
        )
    )  # fmt: skip
    return (
        f"The load falls beyond {roof:.0f} N on the roof, {tube:.0f} Pa in the tube, "
        f"{lid:.0f} Pa under the lid"
    )


def draw_limit_points(path: Path) -> None:
    """Draw the paths of roof, tube and lid through their limit points."""
    with page(path, limit_points_told(), (8.0, 3.6)) as figure:
        where = {"left": 0.08, "right": 0.98, "bottom": 0.15, "top": 0.78, "wspace": 0.32}
        grid = figure.subplots(1, 3, gridspec_kw=where)
        thick = " and ".join(f"{1e3 * h:g}" for h in snapping.ROOF_THICKNESSES)
        titles = (f"hinged roof, {thick} mm thick", "bulging tube", "printed lid")
        for axes, title in zip(grid, titles, strict=True):
            axes.set_title(title)
            axes.axhline(0, color=SOFT, lw=0.8)
            axes.grid(axis="y")
        for thickness in snapping.ROOF_THICKNESSES:
            scene, top = snapping.roof(32, thickness)
            points, _, _ = paths.follow(scene, paths.ROOF_OPTIONS)
            down = [-1e3 * float(point.positions[top, 2]) for point in points]
            draw_path(grid[0], down, points, snapping.ROOF_LOAD / 1e3)
            load = snapping.ROOF_LOAD / 1e3 * points[-1].load_factor
            grid[0].annotate(f"{1e3 * thickness:g}", (down[-1], load), (0, 3), ha="center",
                             textcoords="offset points", fontsize=8, color=DARK)  # fmt: skip
        known = paths.published_roof()
        grid[0].plot(known[:, 1], snapping.ROOF_LOAD / 1e3 * known[:, 0], "+", color=INK)
        grid[0].text(0.04, 0.90, "+ Sze et al.", transform=grid[0].transAxes, fontsize=8)
        grid[0].set(xlabel="deflection of the middle (mm)", ylabel="load (kN)")

        tube = snapping.unbounded_tube(24)
        points, _, _ = paths.follow(tube, paths.TUBE_OPTIONS)
        stretch = [snapping.middle_radius(tube.pattern, point.positions) for point in points]
        draw_path(grid[1], stretch, points, 1.0)
        radius = tubes.RADIUS * np.cos(np.pi / 24)
        bulging = [p.load_factor for p, s in zip(points, stretch, strict=True) if s > 4]
        exact = [snapping.bulge(paths.table_a().fabric, 1e3 * f, radius)[1] for f in bulging]
        grid[1].plot(exact[::3], bulging[::3], "+", color=INK)
        grid[1].annotate("+ closed form", (exact[0], bulging[0]), (6, 6),
                         textcoords="offset points", fontsize=8)  # fmt: skip
        grid[1].set(xlabel="hoop stretch of the middle", ylabel="pressure (kPa)")

        lid, middle = snapping.lid(16)
        points, _, _ = paths.follow(lid, paths.LID_OPTIONS)
        height = [1e3 * float(point.positions[middle, 2]) for point in points]
        draw_path(grid[2], height, points, 1e3)
        grid[2].set(xlabel="height of the middle (mm)", ylabel="pressure (Pa)")
        for x, words, colour in ((0.07, "— stable", DARK), (0.20, "- - unstable", ACCENT)):
            figure.text(x, 0.865, words, color=colour)


def draw_path(axes: Axes, x: Sequence[float], points: Sequence[TracePoint], unit: float) -> None:
    """Draw the loads of a path, its unstable parts dashed."""
    loads = [unit * point.load_factor for point in points]
    both = [a.stable and b.stable for a, b in pairwise(points)]
    for stable, steps in groupby(range(len(both)), both.__getitem__):
        here = list(steps)
        part = slice(here[0], here[-1] + 2)
        axes.plot(x[part], loads[part], color=DARK if stable else ACCENT,
                  ls="-" if stable else "--", lw=1.4)  # fmt: skip


def draw_empty(path: Path) -> None:
    """Draw the print of the coarse bend without pressure, moulded, and filled."""
    frame = read_frames(BEND / FOLDER, "print")[-1]
    shown = read_skin(BEND / FOLDER / frame.skin)
    pattern = shown.pattern
    skin, drawn = sew(MPI.COMM_SELF, pattern), DrawnSkin(shown)
    density = np.round(drawn.print_share)[skin.owned_cells]
    states, told = [], []
    for rest, pressure in (("flat", 0.0), ("assembled", 0.0), ("flat", FILLED)):
        composite = Composite(bending=Bending(rest=rest))
        solver = EquilibriumSolver(skin, composite, clamp(pattern, ["base"]))
        positions = skin.gather_vertices(solver.solve(density, pressure).positions)
        angle = bend_metric(180.0).measure(pattern, positions)
        told.append(f"{round(angle):d}°".replace("-", "−"))
        moulded = ", moulded" if rest == "assembled" else ""
        x, y, z = positions.T  # the tubes lie
        lying = drawn.surfaces(np.stack([z, y, -x], axis=1))
        states.append([(f"{pressure:g} Pa{moulded}: {told[-1]}", lying)])
    title = f"Empty, the tube turns by {told[0]}; moulded or filled, it is straight"
    plot_states(path, states, View(), title)


def by_command(*words: str, file: str) -> Callable[[Path], None]:
    """Return a function that copies a picture of what a command writes."""

    def draw(path: Path) -> None:
        with tempfile.TemporaryDirectory() as folder:
            if run(MPI.COMM_SELF, [*words, "--output", folder]):
                raise RuntimeError(f"toros {' '.join(words)} failed")
            shutil.copy(Path(folder) / file, path)

    return draw


def of_fields(name: str) -> Callable[[Path], None]:
    """Return a function that copies a picture of demos/three_field.py."""
    return lambda path: shutil.copy(THREE_FIELD / name, path) and None


def in_browser(
    write: Callable[[Path], Path], height: int, style: str = ""
) -> Callable[[Path], None]:
    """Return a function that draws a page of the coarse bend as a browser shows it.

    Args:
        write: Writes the page of a copy of the run, and returns its path.
        height: In pixels.
        style: Rules that leave parts of the page out.
    """

    def draw(path: Path) -> None:
        browser = shutil.which("chromium") or shutil.which("google-chrome")
        if browser is None:
            raise OutputError("it needs Chromium")
        with tempfile.TemporaryDirectory() as folder:
            shot, run_folder = Path(folder) / "shot.png", Path(folder) / "bend"
            shutil.copytree(BEND, run_folder)
            shown = write(run_folder)
            text = shown.read_text(encoding="utf-8")
            shown.write_text(text.replace("</style>", f"{style}</style>", 1), encoding="utf-8")
            size = f"--window-size=960,{height}"
            words = [browser, *BROWSER, size, f"--screenshot={shot}", shown.as_uri()]
            subprocess.run(words, check=True, capture_output=True)
            shutil.copy(shot, path)

    return draw


def measured_told(compared: Compared) -> str:
    """Return what the picture of a measurement tells."""
    return compared.told(read(ROWS / "measured.csv"))


def draw_measured(compared: Compared, path: Path) -> None:
    """Draw measured points as dots and simulated ones as lines, for some curves of a case."""
    curves = by_curve(read(ROWS / "measured.csv"), compared.name)
    with page(path, measured_told(compared), (4.6, 3.0)) as figure:
        axes = figure.add_axes((0.13, 0.16, 0.57, 0.66))
        shown = [curve.split(", ") for curve in compared.shown or curves]
        same = [part for part in shown[0] if len(shown) > 1 and all(part in one for one in shown)]
        for number, parts in enumerate(shown):
            curve, own = ", ".join(parts), ", ".join(part for part in parts if part not in same)
            colour = SERIES[number % len(SERIES)]
            found = sorted((place(row), row.value, row.reference) for row in curves[curve])
            at, simulated, known = np.array(found, dtype=float).T
            axes.plot(at, known, "o", color=colour, ms=3.5)
            axes.plot(at, simulated, color=colour, lw=1.4, label=own)
        axes.set(xlabel=compared.heads[0], ylabel=compared.heads[1])
        axes.margins(y=0.08)
        # A curve that fails must not hide the others.
        most = max(row.reference or 0.0 for rows in curves.values() for row in rows)
        axes.set_ylim(min(0.0, axes.get_ylim()[0]), min(1.5 * most, axes.get_ylim()[1]))
        axes.grid(axis="y")
        figure.legend(
            loc="upper left", bbox_to_anchor=(0.71, 0.83), frameon=False, fontsize=6.5,
            title=", ".join(same), title_fontsize=7, handlelength=1.0,
        )  # fmt: skip
        figure.text(0.72, 0.14, "● measured\n— simulated", color=INK, fontsize=8)
    with Image.open(path) as picture:  # few colours: a checkout is to stay small
        picture.convert("RGB").quantize(64).save(path, optimize=True)


# What the pictures of committed tables tell.
TOLD: Mapping[str, Callable[[], str]] = {
    **{f"images/validation/{one.name}.png": partial(measured_told, one) for one in COMPARED},
    "crossed_lines.png": crossed_told,
    "intervals.png": intervals_told,
    "limit_points.png": limit_points_told,
    "limits.png": limits_told,
    "performance.png": times_told,
}
# Pictures of the coarse bend.
OF_BEND = (
    "curves_empty.png", "images/make_one.png", "images/report.png", "images/tolerance_bend.png",
)  # fmt: skip
# All pictures below docs/, and who draws them.
DRAWN: Mapping[str, Callable[[Path], None]] = {
    "characterisation.png": by_command(
        "fit", "examples/stockinette.csv", "--direction", "x", "--thickness", "3 mm",
        file="fit.png",
    ),
    "crossed_lines.png": draw_crossed,
    "curves_empty.png": draw_empty,
    "intervals.png": draw_intervals,
    "limit_points.png": draw_limit_points,
    "limits.png": draw_limits,
    "performance.png": draw_times,
    "images/fig4.png": of_fields("fig4.png"),
    "images/fig5.png": of_fields("fig5.png"),
    "images/make_one.png": in_browser(
        lambda folder: folder / "manufacture" / "make_it.html", 940,
        "header, section:not(#step-3) { display: none; }",
    ),
    "images/report.png": in_browser(write_report, 1480),
    "images/tolerance_bend.png": by_command("tolerance", str(BEND), file="tolerance.png"),
    **{
        f"images/validation/{one.name}.png": partial(draw_measured, one) for one in COMPARED
    },
}  # fmt: skip


def main(chosen: Sequence[str]) -> int:
    """Draw the chosen pictures, or all; return the exit code, 1 where one cannot be drawn."""
    failed = False
    for name in chosen or DRAWN:
        path = DOCS / name
        try:
            DRAWN[name](path)
        except (OSError, OutputError, subprocess.SubprocessError) as missing:
            failed = True
            print(f"docs/{name} stays as it is: {missing}")
            continue
        facts = {"Description": TOLD[name]()} if name in TOLD else {}
        facts |= facts_of(read_run(BEND)) if name in OF_BEND else {}
        facts["Title"] = f"docs/{name}"
        path.write_bytes(with_facts(path.read_bytes(), facts))
    return int(failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
