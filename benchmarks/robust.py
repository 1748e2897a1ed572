"""Robust designs of the bending tube: spread of the angle over print widths, and cost.

    scripts/fenicsx python3 benchmarks/robust.py --output runs --json benchmarks/robust.json
    scripts/fenicsx python3 benchmarks/robust.py --from benchmarks/robust.json --docs
    scripts/fenicsx python3 benchmarks/robust.py --output runs --picture docs/images/robust.png

Designs the bending tube of `demos/bend.py` plain and robust, one after the other, from the same
starts: the coarse one, or with `--default` the one of the default mesh. Each print is simulated
again with its lines 0.1 mm narrower and wider: on a coarse and a finer mesh that follow its
borders, whose vertices move with them. Costs are factorisations of tangents of the same size,
without the simulations of prints in the corrections.

The JSON file is written after each design. Designs that are in it already, and runs that are in the
output folder, are not repeated; delete them after a change of the code. `--docs` writes the table
into docs/optimisation.md. A pair of designs takes about four minutes of one core.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Path2D
from mpi4py import MPI
from page_tables import replaced

sys.path.insert(0, str(Path(__file__).parent.parent))

from toros_fem.design.loop.robust import SPREAD_WEIGHT
from toros_fem.making.print.contours import panel_outline
from toros_fem.making.print.print_file import read_print_polygons
from toros_fem.making.print.regions import part_regions, regions_on
from toros_fem.meshes import mirrored
from toros_fem.products.actuators.problem import actuator_problem
from toros_fem.products.actuators.run import design_actuator
from toros_fem.products.tolerance.settings import ToleranceConfig
from toros_fem.products.tolerance.simulated import Drawn, simulated_tolerances
from toros_fem.products.tubes.bend import BendConfig, case
from toros_fem.products.tubes.tube import coarse_tube

PAGE = Path(__file__).parent.parent / "docs" / "optimisation.md"
BEGIN, END = "<!-- table of benchmarks/robust.py -->", "<!-- end of the table -->"
WIDTH = 1e-4
# Edge lengths of the meshes that prints are simulated on, in m.
COARSE, FINE = 2.85e-3, 1.4e-3

Row = dict[str, Any]


def designed(folder: Path, seed: int, weight: float | None, *, coarse: bool) -> Row:
    """Return figures of one design, from its folder if it is there."""
    changes: Row = {"seed": seed, "estimate_error": False, "curve_pressure": None}
    if weight is not None:
        changes |= {"width_tolerance": WIDTH, "spread_weight": weight}
    config = (coarse_tube(BendConfig()) if coarse else BendConfig()).updated(**changes)
    file = folder / "summary.json"
    if not file.exists():
        design_actuator(MPI.COMM_WORLD, folder, case, config)
    made = json.loads(file.read_text(encoding="utf-8"))
    return {
        "mesh": "coarse" if coarse else "default",
        "seed": seed,
        "weight": weight,
        "angle_deg": made["angle_deg"],
        "shape": made["design"]["shape"],
        "factorisations": made["factorisations"],
        "steps": made["iterations"],
        "smallest_width_mm": made["manufacture"]["smallest_width_mm"],
        "border_mm": made["manufacture"]["border_mm"],
        "coarse": spread_of(folder, config.updated(edge_length=COARSE)),
        "fine": spread_of(folder, config.updated(edge_length=FINE)),
    }


def spread_of(folder: Path, config: BendConfig) -> Row | None:
    """Return the angles of a print with narrower and wider lines on the mesh of a configuration."""
    comm = MPI.COMM_WORLD
    plain = config.updated(width_tolerance=None, constrained_iterations=0)
    made, stored = case(comm, plain), read_print_polygons(comm, folder)
    whole = mirrored(made.pattern, made.symmetry).pattern
    regions = part_regions(made.pattern, regions_on(stored.pattern, stored.regions, whole))
    following = made.following(comm, regions)
    drawn = Drawn(regions, (stored.pattern, stored.regions), stored.limits, None, plain.pressure)
    found = simulated_tolerances(
        actuator_problem(comm, following, plain),
        lambda pattern: actuator_problem(comm, following.on(pattern), plain),
        drawn,
        ToleranceConfig(width=WIDTH, modulus=None, thickness=None, pressure_change=None),
        begin=time.perf_counter(),
    )
    angles = {v.change: v.values.get("angle_deg") for v in found.variants}
    narrow, wide = angles[-WIDTH], angles[WIDTH]
    if narrow is None or wide is None:
        return None
    return {
        "angle_deg": found.nominal["angle_deg"],
        "narrower_deg": narrow,
        "wider_deg": wide,
        "spread_deg": abs(narrow - wide),
    }


def table(rows: list[Row]) -> str:
    """Return the table of all designs."""
    lines = [
        "| design mesh | seed | design | angle as printed | spread, mesh of 2.85 mm | "
        "spread, mesh of 1.4 mm | border of the print | factorisations |",
        "|---|---|---|---|---|---|---|---|",
    ]
    plain = {(row["mesh"], row["seed"]): row for row in rows if row["weight"] is None}
    for row in rows:
        base = plain.get((row["mesh"], row["seed"]), row)
        spreads = [
            "no equilibrium" if row[mesh] is None else f"{row[mesh]['spread_deg']:.2f}°"
            for mesh in ("coarse", "fine")
        ]
        name = "plain" if row["weight"] is None else f"robust, κ = {row['weight']:g}"
        cost = f"{row['factorisations']}"
        if row is not base:
            cost += f" ({row['factorisations'] / base['factorisations']:.1f} times)"
        border = f"{row['border_mm']:.0f} mm"
        cells = [
            row["mesh"],
            str(row["seed"]),
            name,
            f"{row['angle_deg']:.1f}°",
            *spreads,
            border,
            cost,
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def draw(file: Path, folders: dict[str, Path]) -> None:
    """Draw the walls of prints below each other."""
    figure = Figure(figsize=(9, 2.9 * len(folders)), layout="constrained")
    for axes, (title, folder) in zip(
        np.atleast_1d(figure.subplots(len(folders), sharex=True)), folders.items(), strict=True
    ):
        stored = read_print_polygons(MPI.COMM_WORLD, folder)
        pattern, wall = stored.pattern, stored.pattern.panel_index("wall")
        outline = panel_outline(pattern, wall)
        for shape, colour in ((outline, "#eddbb7"), (stored.regions[wall], "#223253")):
            for part in shapely.get_parts(shape):
                rings = [part.exterior, *part.interiors]
                path = Path2D.make_compound_path(
                    *[Path2D(1e3 * shapely.get_coordinates(r)[:, ::-1], closed=True) for r in rings]
                )
                axes.add_patch(PathPatch(path, facecolor=colour, edgecolor="none"))
        low, high = np.reshape(outline.bounds, (2, 2))[:, ::-1] * 1e3
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", ylabel="mm")
        axes.set_title(title)
    axes.set_xlabel("mm")
    figure.savefig(file, dpi=110)


def main() -> None:
    """Run what is asked for on the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=[2, 3])
    parser.add_argument("--weights", type=float, nargs="+", default=[SPREAD_WEIGHT])
    parser.add_argument("--default", action="store_true", help="the default mesh, not the coarse")
    parser.add_argument("--output", type=Path, help="folder of the runs; none keeps none")
    parser.add_argument("--json", type=Path, help="file of the rows, written after each")
    parser.add_argument("--from", dest="source", type=Path, help="rows to show instead")
    parser.add_argument("--docs", action="store_true", help="write the table into the page")
    parser.add_argument("--picture", type=Path, help="picture of the first seed's prints")
    given = parser.parse_args()
    file = given.source or given.json
    rows: list[Row] = []
    if file is not None and file.exists():
        rows = json.loads(file.read_text(encoding="utf-8"))
    mesh = "default" if given.default else "coarse"
    done = {(row["seed"], row["weight"]) for row in rows if row["mesh"] == mesh}
    wanted = [(seed, weight) for seed in given.seeds for weight in (None, *given.weights)]
    with tempfile.TemporaryDirectory() as scratch:
        place = given.output or Path(scratch)
        folders = {(s, w): place / f"{s}_{w or 'plain'}" for s, w in wanted}
        for (seed, weight), folder in folders.items():
            if given.source or (seed, weight) in done:
                continue
            rows.append(designed(folder, seed, weight, coarse=not given.default))
            if given.json:
                given.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
        if given.picture:
            shown = [(s, w) for s, w in wanted if s == given.seeds[0]]
            titles = ["plain" if w is None else f"robust, κ = {w:g}" for _, w in shown]
            draw(given.picture, dict(zip(titles, [folders[k] for k in shown], strict=True)))
    print(table(rows))
    if given.docs:
        page = PAGE.read_text(encoding="utf-8")
        PAGE.write_text(replaced(page, BEGIN, END, table(rows)), encoding="utf-8")


if __name__ == "__main__":
    main()
