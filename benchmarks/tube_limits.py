"""Limits of the twist and the shortening of the tube: helical lines against closed forms.

    python benchmarks/tube_limits.py --quick
    python benchmarks/tube_limits.py --json limits.json --picture docs/limits.png

The paper's 15 cm x 2 cm tube twists by 300 degrees (15 kPa) and shortens by 8 % (10 kPa). Here its
wall has plain patterns: one family of helical lines to twist, two crossed ones to shorten. They are
simulated over angle, number and width at rising pressures, and compared with homogeneous tubes in
equilibrium (`tube_limits_model.py`): fibres without width and stretch, and lines with both. Cases
that are already in the JSON file are not run again.
"""

from __future__ import annotations

import argparse
import json
import sys
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

sys.path.insert(0, str(Path(__file__).parent))

import tube_limits_model as model
from tube_limits_simulated import Case, simulate

Row = dict[str, Any]

PRESSURES = (2e3, 5e3, 10e3, 15e3, 20e3)
SHOWN = {"twist": 15e3, "shortening": 10e3}  # the paper's pressures
TARGET = {"twist": 300.0, "shortening": 8.0}
ANGLES = {"twist": range(10, 86), "shortening": range(5, 46)}
TITLES = {"twist": "twist in degrees", "shortening": "shortening in per cent"}
COLOURS = {2: "tab:blue", 3: "tab:purple", 4: "tab:orange", 6: "tab:green"}
MARKS = {1.5: "^", 2.0: "s", 3.0: "o"}
QUICK = (Case(4, 45.0, edge=3e-3), Case(3, 25.0, crossed=True, edge=3e-3))


def cases() -> list[Case]:
    """Return all cases to simulate, the rough sweep first."""
    found = [Case(n, a) for n, a in product((2, 4, 6), (20, 30, 40, 50, 60, 70, 75))]
    found += [Case(n, a, crossed=True) for n, a in product((3, 4), (10, 15, 20, 25, 30, 35))]
    found += [Case(n, a, 2e-3) for n, a in product((4, 6), (40, 50, 60))]
    # Thin lines need small triangles: where they are as wide as an edge they fray. One case of each
    # kind of the rough sweep is run again, to see the effect of the mesh.
    fine: Row = {"edge": 1.8e-3}
    found += [Case(4, a, 2e-3, **fine) for a in (60, 65)]
    found += [Case(n, 25, 2e-3, True, **fine) for n in (3, 4)]
    found += [Case(3, 65, 2e-3, **fine), Case(6, 60, 2e-3, **fine)]
    found += [Case(4, 60, **fine), Case(3, 25, crossed=True, **fine)]
    # A stiffer print: 100 MPa have been measured.
    found += [Case(4, 65, 2e-3, young=100e6, **fine), Case(4, 25, 2e-3, True, young=100e6, **fine)]
    found += [Case(6, 25, 1.5e-3, True, 1.4e-3), Case(4, 65, 1.5e-3, edge=1.4e-3)]
    # Around the best of those.
    found += [Case(6, 30, 1.5e-3, True, 1.4e-3), Case(6, 25, 1.5e-3, True, 1.4e-3, 100e6)]
    found += [Case(4, 60, 2e-3, young=100e6, **fine), Case(3, 60, 2e-3, **fine)]
    return found


def value(kind: str, state: model.State) -> float:
    """Return the twist of a state as it unwinds right-handed lines, or its shortening."""
    return -state.twist if kind == "twist" else state.shortening


def simulated_value(row: Row) -> float:
    """Return the same of a simulated tube."""
    return -row["twist_deg"] if row["kind"] == "twist" else row["shortening_percent"]


@cache
def ideal(kind: str, angle: float) -> list[model.State]:
    """Return the states of fibres without width and stretch at all pressures."""
    states = model.thin_helices if kind == "twist" else model.thin_net
    return states(np.radians(angle), PRESSURES)


@cache
def printed(kind: str, angle: float, width: float, young: float) -> list[model.State]:
    """Return the states of lines of a total width in m; none where they would cover the wall."""
    radians = np.radians(angle)
    if kind == "twist":
        fraction = model.covered_fraction(1, width, radians)
        return model.striped_helices(radians, fraction, PRESSURES, young) if fraction < 0.8 else []
    fraction = model.covered_fraction(1, width, radians, families=2)
    return model.stretching_net(radians, fraction, PRESSURES, young)


def largest(kind: str, step: int) -> list[Row]:
    """Return for each model and pressure the angle with the largest value."""
    young = Case(1, 0.0).young
    rows: list[Row] = []
    for name, widths in (("no width, no stretch", (0,)), ("printed lines", (6, 8, 12))):
        found: dict[float, Row] = {}
        for angle, width in product(ANGLES[kind][::step], widths):
            states = printed(kind, angle, 1e-3 * width, young) if width else ideal(kind, angle)
            for pressure, state in zip(PRESSURES, states, strict=False):
                row = {
                    "kind": kind,
                    "model": name,
                    "pressure_kpa": 1e-3 * pressure,
                    "angle_deg": float(angle),
                    "width_mm": width,
                    "value": value(kind, state),
                    "swelling": state.radius,
                    "length": state.length,
                    "stretch": state.stretches[1],
                    "fibre": state.fibre,
                }
                if pressure not in found or row["value"] > found[pressure]["value"]:
                    found[pressure] = row
        rows += found.values()
    return rows


def compared(row: Row) -> Row:
    """Return a simulated row with the values of the models."""
    kind, index = row["kind"], PRESSURES.index(1e3 * row["pressure_kpa"])
    width = 1e-3 * row["lines"] * row["width_mm"]
    states = printed(kind, row["angle_deg"], width, 1e6 * row["young_mpa"])
    radius, angle = row["swelling_ratio"], np.radians(row["angle_deg"])
    if kind == "twist":
        kinematic = -model.unstretched_twist(radius, row["middle_length_ratio"], angle)
    else:
        kinematic = 100 * (1 - model.unstretched_length(radius, angle))
    return {
        **row,
        "value": simulated_value(row),
        "ideal": value(kind, ideal(kind, row["angle_deg"])[index]),
        "printed": value(kind, states[index]) if states else None,
        # Lines that keep their length, on a tube of the simulated radius (and length).
        "kinematic": kinematic if np.isfinite(kinematic) else None,
    }


def print_models(rows: list[Row]) -> None:
    """Print a table of the models' best angles."""
    print("\n| | model | kPa | angle | lines, mm in all | value | λ_r | λ_z | λ₁ | fibre |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for r in rows:
        print(
            f"| {r['kind']} | {r['model']} | {r['pressure_kpa']:g} | {r['angle_deg']:g}° "
            f"| {r['width_mm'] or '-'} | {r['value']:.3g} | {r['swelling']:.3f} "
            f"| {r['length']:.3f} | {r['stretch']:.3f} | {r['fibre']:.3f} |"
        )


def print_simulated(rows: list[Row]) -> None:
    """Print a table of the simulated tubes at the paper's pressures, beside the models."""
    print(
        "\n| | lines | mm | MPa | angle | edge mm | kPa | simulated | kinematic | printed | ideal |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    for r in rows:
        if 1e3 * r["pressure_kpa"] == SHOWN[r["kind"]]:
            beside = " | ".join(
                "-" if r[name] is None else f"{r[name]:.3g}"
                for name in ("kinematic", "printed", "ideal")
            )
            print(
                f"| {r['kind']} | {r['lines']} | {r['width_mm']:g} | {r['young_mpa']:g} "
                f"| {r['angle_deg']:g}° | {r['edge_mm']:g} | {r['pressure_kpa']:g} "
                f"| {r['value']:.3g} | {beside} |"
            )
    for kind in SHOWN:
        of = [r for r in rows if r["kind"] == kind]
        if of:
            best = max(of, key=lambda r: r["value"])
            print(f"largest {kind}: {best}")


def picture(path: Path, rows: list[Row], step: int) -> None:
    """Draw twist and shortening over the angle: models as lines, simulated tubes as points."""
    figure, panels = plt.subplots(1, 2, figsize=(11, 6), layout="constrained")
    for kind, axes in zip(SHOWN, panels, strict=True):
        _curves(axes, kind, step)
        _points(axes, kind, [r for r in rows if r["kind"] == kind])
        axes.axhline(TARGET[kind], color="tab:red", lw=1, ls=":", label="the paper's figure")
        axes.set_xlabel("angle of the lines to the axis in degrees")
        axes.set_ylabel(TITLES[kind])
        axes.set_title(f"{kind} at {1e-3 * SHOWN[kind]:g} kPa, lines of 26 MPa")
        axes.set_ylim(bottom=0)
        axes.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=2)
    panels[1].set_xlim(right=46)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _curves(axes: Axes, kind: str, step: int) -> None:
    index, young = PRESSURES.index(SHOWN[kind]), Case(1, 0.0).young
    angles = np.array(ANGLES[kind][::step])
    axes.plot(
        angles,
        [value(kind, ideal(kind, angle)[index]) for angle in angles],
        color="black",
        label="model: no width, no stretch",
    )
    for width, style in ((6, "--"), (12, "-.")):
        states = [printed(kind, angle, 1e-3 * width, young) for angle in angles]
        known = [(a, value(kind, s[index])) for a, s in zip(angles, states, strict=True) if s]
        each = " each way" if kind == "shortening" else ""
        label = f"model: {width} mm of lines around{each}"
        axes.plot(*np.transpose(known), style, color="dimgray", lw=1.2, label=label)


def _points(axes: Axes, kind: str, rows: list[Row]) -> None:
    shown = [
        r
        for r in rows
        if 1e3 * r["pressure_kpa"] == SHOWN[kind] and r["young_mpa"] == 1e-6 * Case(1, 0.0).young
    ]
    for count, width in sorted({(r["lines"], r["width_mm"]) for r in shown}):
        of = [r for r in shown if (r["lines"], r["width_mm"]) == (count, width)]
        axes.plot(
            [r["angle_deg"] for r in of],
            [r["value"] for r in of],
            MARKS[width],
            color=COLOURS[count],
            ms=6,
            clip_on=False,
            zorder=3,
            mec="white",
            mew=0.5,
            label=f"{count} lines of {width:g} mm",
        )


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="two coarse tubes, few angles")
    parser.add_argument("--json", type=Path, help="file for the rows")
    parser.add_argument("--picture", type=Path, help="file for the picture")
    options = parser.parse_args()
    done: list[Row] = []
    if options.json and options.json.exists():
        done = json.loads(options.json.read_text(encoding="utf-8"))["simulated"]
    step = 10 if options.quick else 3
    models = [row for kind in SHOWN for row in largest(kind, 10 if options.quick else 5)]
    rows: list[Row] = []
    for case in QUICK if options.quick else cases():
        known = [r for r in done if case.inputs.items() <= r.items()]
        rows += [compared(row) for row in known or simulate(case, PRESSURES)]
        if options.json:
            written = {"models": models, "simulated": rows}
            options.json.write_text(json.dumps(written, indent=1) + "\n", encoding="utf-8")
        if not known:
            print(case, [f"{r['value']:.3g}" for r in rows if case.inputs.items() <= r.items()])
    print_models(models)
    print_simulated(rows)
    if options.picture:
        picture(options.picture, rows, step)


if __name__ == "__main__":
    main()
