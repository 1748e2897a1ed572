#!/usr/bin/env python3
"""Paths through limit points: a hinged roof, a bulging tube and a printed lid that pops.

The roof of Sze, Liu & Lo (2004, section 3.8) snaps through, the thin one also back. The tube
without stretch bounds passes its limit pressure and bulges; the closed form of a bulge in a long
tube is its reference. The lid is a skin of the package: a printed sheet, moulded so that it sags.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from accuracy_scenes import entry, rows_where, table_a
from accuracy_tubes import RADIUS
from limit_points_scenes import (
    LID_SAG,
    ROOF_LOAD,
    ROOF_THICKNESSES,
    Scene,
    bulge,
    lid,
    middle_radius,
    roof,
    unbounded_tube,
)

from toros_fem.mechanics.paths.arc_length import ArcLengthOptions
from toros_fem.mechanics.paths.limit_points import limit_points
from toros_fem.mechanics.paths.trace import trace
from toros_fem.mechanics.paths.trace_point import TracePoint

Row = dict[str, Any]
ROOF = "sze38_hinged_roof"
STABLE, UNSTABLE = "#1f5aa6", "#c8501e"


def follow(
    scene: Scene, displacement: Callable[[TracePoint], float], options: ArcLengthOptions, **of: Any
) -> Row:
    """Return points and limit points of a path, with the measure of the displacement."""
    points = list(
        trace(
            scene.solver,
            scene.density,
            scene.pressure,
            by="arc-length",
            force=scene.force,
            options=options,
        )
    )
    measured = [displacement(point) for point in points]
    turns = limit_points(points)
    return {
        **of,
        "triangles": len(scene.pattern.panel),
        "load_factor": [point.load_factor for point in points],
        "displacement": measured,
        "negative_eigenvalues": [point.negative_eigenvalues for point in points],
        "newton_steps": sum(point.result.steps for point in points),
        "factorisations": sum(point.result.factorisations for point in points),
        "limits": [turn.load_factor for turn in turns],
        "largest_residual": max(point.result.residual for point in points),
    }


def roof_path(count: int, thickness: float) -> Row:
    """Return the path of the roof: load in N, central deflection in mm."""
    scene, top = roof(count, thickness)
    options = ArcLengthOptions(first=0.01, lowest=None, highest=1.0, largest_increment=0.05)
    found = follow(
        scene,
        lambda point: -1e3 * float(point.positions[top, 2]),
        options,
        count=count,
        thickness_mm=1e3 * thickness,
    )
    if thickness == ROOF_THICKNESSES[0]:
        rows = rows_where(ROOF)
        known = np.array([[float(word) for word in row.values()] for row in rows])
        # On the rising branch the deflection is a function of the load; the other way is as good.
        rising = int(np.argmax(found["load_factor"])) + 2
        load = np.interp(known[:, 1], found["displacement"][:rising], found["load_factor"][:rising])
        found["largest_error_of_load"] = float(np.abs(load - known[:, 0]).max() / known[-1, 0])
    return found


def tube_path(sides: int) -> Row:
    """Return the path of the tube: pressure in kPa, hoop stretch of its middle."""
    scene = unbounded_tube(sides)
    options = ArcLengthOptions(first=0.3, lowest=1.2, highest=None)
    found = follow(
        scene, lambda point: middle_radius(scene.pattern, point.positions), options, sides=sides
    )
    polygon = np.cos(np.pi / sides)
    homogeneous = entry("stvk_limit_pressures", "Pmax_Pa", mat="A") / polygon
    fallen = np.flatnonzero(np.array(found["displacement"]) > 4.0)
    exact = [
        bulge(table_a().fabric, 1e3 * found["load_factor"][k], RADIUS * polygon)[1] for k in fallen
    ]
    errors = np.array(found["displacement"])[fallen] / np.array(exact) - 1
    return {
        **found,
        "homogeneous_limit_pa": homogeneous,
        "limit_pa": 1e3 * found["limits"][0],
        "limit_error": float(1e3 * found["limits"][0] / homogeneous - 1),
        "bulge": exact,
        "largest_error_of_bulge": float(np.abs(errors).max()),
    }


def lid_path(count: int) -> Row:
    """Return the path of the lid: pressure in kPa, height of its middle in mm."""
    scene, middle = lid(count)
    options = ArcLengthOptions(
        first=0.0, first_increment=0.01, lowest=None, highest=0.4, largest_movement=0.01
    )
    return follow(
        scene, lambda point: 1e3 * float(point.positions[middle, 2]), options, count=count
    )


def draw(path: Path, found: dict[str, list[Row]]) -> None:
    """Write a picture: load over displacement, stable solid, unstable dashed."""
    figure, (left, centre, right) = plt.subplots(1, 3, figsize=(13.5, 4.4), layout="constrained")
    for row in by(found["roof"], "thickness_mm"):
        branches(left, row, 1e-3 * ROOF_LOAD)
        k = int(np.argmax(row["displacement"]))
        left.annotate(
            f"{row['thickness_mm']:.4g} mm",
            (row["displacement"][k], 1e-3 * ROOF_LOAD * row["load_factor"][k]),
            (-4, -2),
            textcoords="offset points",
            ha="right",
            va="top",
        )
    known = np.array([[float(word) for word in row.values()] for row in rows_where(ROOF)])
    left.plot(known[:, 1], 1e-3 * ROOF_LOAD * known[:, 0], "k+", ms=8, label="Sze et al.")
    left.set(xlabel="central deflection in mm", ylabel="load in kN", title="hinged roof")
    tube = found["tube"][-1]
    branches(centre, tube, 1.0)
    fallen = np.array(tube["displacement"]) > 4.0
    centre.plot(
        tube["bulge"], np.array(tube["load_factor"])[fallen], "k+", ms=8, label="closed form, bulge"
    )
    centre.axhline(
        1e-3 * tube["homogeneous_limit_pa"], color="0.6", lw=1, label="limit, homogeneous tube"
    )
    centre.set(xlabel="hoop stretch in the middle", ylabel="pressure in kPa", title="bulging tube")
    branches(right, found["lid"][-1], 1e3)
    right.axvline(-1e3 * LID_SAG, color="0.6", lw=1, ls=":", label="as moulded")
    right.set(xlabel="height of the middle in mm", ylabel="pressure in Pa", title="printed lid")
    for axes in (left, centre, right):
        axes.axhline(0, color="0.8", lw=0.8)
        axes.plot([], [], "-", color=STABLE, label="stable")
        axes.plot([], [], "--", color=UNSTABLE, label="unstable")
        axes.grid(alpha=0.3)
        axes.legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=130)
    plt.close(figure)


def by(rows: Sequence[Row], key: str) -> list[Row]:
    """Return the last row, of the finest mesh, for each value of a key."""
    return list({row[key]: row for row in rows}.values())


def branches(axes: plt.Axes, row: Row, unit: float) -> None:
    """Draw a path in its unit of the load; a segment is stable if both its ends are."""
    load, place = unit * np.array(row["load_factor"]), np.array(row["displacement"])
    stable = np.array(row["negative_eigenvalues"]) == 0
    both = stable[:-1] & stable[1:]
    ends = [0, *(np.flatnonzero(both[1:] != both[:-1]) + 1), len(both)]
    for one, two in pairwise(ends):
        style, colour = ("-", STABLE) if both[one] else ("--", UNSTABLE)
        axes.plot(place[one : two + 1], load[one : two + 1], style, color=colour, lw=1.6)


def main() -> None:
    """Run all paths, print their limits and write them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="coarse meshes only")
    parser.add_argument("--json", type=Path, help="file for the rows")
    parser.add_argument("--picture", type=Path, help="PNG file for the paths")
    arguments = parser.parse_args()
    counts = (8,) if arguments.quick else (8, 16, 32)
    found = {
        "roof": [roof_path(n, h) for h in ROOF_THICKNESSES for n in counts],
        "tube": [tube_path(n) for n in ((12,) if arguments.quick else (12, 24))],
        "lid": [lid_path(n) for n in ((8,) if arguments.quick else (8, 16))],
    }
    for name, rows in found.items():
        for row in rows:
            limits = ", ".join(f"{limit:.5g}" for limit in row["limits"])
            errors = {key: value for key, value in row.items() if "error" in key}
            print(f"{name:5s} {row['triangles']:5d} triangles: limits {limits} {errors}")
    if arguments.json:
        arguments.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    if arguments.picture:
        draw(arguments.picture, found)


if __name__ == "__main__":
    main()
