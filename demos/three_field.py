"""What each part of the three-field scheme does (paper Figs. 4, 5): the bending tube five times.

    python demos/three_field.py --coarse

Same scene, same start, same number of steps: densities filtered only; with projection; with
constraints on the widths of lines and gaps; with a penalty on the perimeter; with both. Each design
is thresholded at eta and simulated again as it would be printed: that, and not the optimiser's own
figure, tells what a variant is worth. Writes a table, `three_field.json`, and a picture strip.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.actuators.case import design, merged
from toros_fem.actuators.tube import COARSE_TUBE, TUBE, bend_metric, tube_scene
from toros_fem.command_line import command_line
from toros_fem.meshes import bend
from toros_fem.output.writer import write_comparison

DEFAULTS: dict[str, Any] = {
    **TUBE,
    "angle": 180.0,  # degrees
    "neutral": 0.01,  # m; the inner side of the bend keeps its length
    "polish": 0,  # the bare variants are compared
    "perimeter": 2e-4,  # weight of the perimeter term in the variants that have it
}
COARSE = COARSE_TUBE
# β of almost 0 makes the projection the identity.
PLAIN = 1e-3


def variants(inputs: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """What each variant changes; all take the same number of steps."""
    o = inputs
    steps = o["iterations"] + o["constrained"]
    free = {"iterations": steps, "constrained": 0, "perimeter": 0.0}
    return {
        "filter only": {**free, "beta": PLAIN},
        "projection": free,
        "widths": {"perimeter": 0.0},
        "perimeter": {**free, "perimeter": o["perimeter"]},
        "widths and perimeter": {},
    }


def run(comm: MPI.Comm, output: Path, *, verbose: bool = False, **inputs: Any) -> dict[str, Any]:
    """Design all variants; returns the table that is also written to `output`.

    Args:
        comm: Communicator.
        output: Folder for table and picture strip, and a folder for each variant.
        verbose: Whether to print every step of the equilibrium solver.
        inputs: What differs from `DEFAULTS` and `toros_fem.scene.ActuatorConfig`.
    """
    whole = merged(DEFAULTS, inputs)
    rows: list[dict[str, Any]] = []
    pictures = []
    for name, changes in variants(whole).items():
        begin = time.perf_counter()
        if comm.rank == 0:
            print(f"\n{name}", flush=True)
        o = {**whole, **changes}
        target = bend(np.radians(o["angle"]), o["length"], neutral=o["neutral"])
        scene = tube_scene(comm, o, target, [bend_metric(o["angle"])])
        folder = output / name.replace(" ", "_")
        done = design(comm, folder, scene, o, begin=begin, verbose=verbose)
        rows.append(row(name, done.summary))
        wall = done.printed.contours[scene.pattern.panel_index("wall")]
        pictures.append((name, wall, caption(rows[-1])))
    if comm.rank == 0:
        print("\n" + table(rows))
    content = {"rows": rows, "inputs": whole}
    write_comparison(comm, output, "three_field", content, scene.pattern, "wall", pictures)
    return content


def row(name: str, summary: dict[str, Any]) -> dict[str, Any]:
    """The figures of one variant; widths, islands and border are those of the bare contours."""
    made = summary["dropped"]["before"]
    return {
        "variant": name,
        "shape_designed": summary["design"]["shape"],
        "shape_printed": summary["printed_objective"],
        "angle_designed_deg": summary["design"]["angle_deg"],
        "angle_printed_deg": summary["angle_deg"],
        "pressure_pa": summary["pressure_pa"],
        "grey_level": summary["grey_level"],
        "islands": made["islands"],
        "pieces": made["pieces"],
        "holes": made["holes"],
        "smallest_width_mm": made["smallest_width_mm"],
        "smallest_gap_mm": made["smallest_gap_mm"],
        "border_mm": made["border_mm"],
        "iterations": summary["iterations"],
        "seconds": summary["seconds"]["total"],
    }


def number(value: float | None, form: str = ".2f") -> str:
    """A number that there may not be."""
    return "-" if value is None else f"{value:{form}}"


def caption(r: dict[str, Any]) -> str:
    """What stands below a picture."""
    return (
        f"T {r['shape_designed']:.1e} → {number(r['shape_printed'], '.1e')}\n"
        f"{r['angle_designed_deg']:.0f}° → {number(r['angle_printed_deg'], '.0f')}° printed\n"
        f"grey {r['grey_level']:.3f}, islands {r['islands']}\n"
        f"line ≥ {number(r['smallest_width_mm'])} mm, border {r['border_mm'] / 1e3:.2f} m"
    )


def table(rows: list[dict[str, Any]]) -> str:
    """All variants as lines of text."""
    lines = [
        "variant                T designed  T printed  angle  printed  grey   islands  line/mm"
        "  gap/mm  border/m  kPa"
    ]
    lines += [
        f"{r['variant']:21s}  {r['shape_designed']:10.2e}  {number(r['shape_printed'], '.2e'):>9s}"
        f"  {r['angle_designed_deg']:5.1f}  {number(r['angle_printed_deg'], '.1f'):>7s}"
        f"  {r['grey_level']:5.3f}"
        f"  {r['islands']:7d}  {number(r['smallest_width_mm']):>7s}"
        f"  {number(r['smallest_gap_mm']):>6s}  {r['border_mm'] / 1e3:8.2f}"
        f"  {r['pressure_pa'] / 1e3:4.1f}"
        for r in rows
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(
        command_line(
            MPI.COMM_WORLD,
            __doc__,
            run,
            DEFAULTS,
            COARSE,
            Path("output/three_field"),
            lambda summary: f"{len(summary['rows'])} variants designed",
        )
    )
