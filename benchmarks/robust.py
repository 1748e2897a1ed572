"""Robust designs of the bending tube: spread of the angle over print widths, and cost.

    OMP_NUM_THREADS=1 scripts/fenicsx python3 benchmarks/robust.py --json benchmarks/robust.json
    scripts/fenicsx python3 benchmarks/robust.py --from benchmarks/robust.json --docs

Designs the coarse bending tube of `demos/bend.py` plain and robust, one after the other, from the
same starts. Each print is simulated again with its lines 0.1 mm narrower and wider: on a mesh that
follows its borders, whose vertices move with them, of the design's edge length and of a finer one.
Costs are factorisations, and seconds of the processor, in which other processes do not count.

The JSON file is written after each design. Designs that are in it already are not repeated; delete
the file after a change of the code. `--docs` writes the table into docs/optimisation.md. A pair of
designs takes about four minutes of one core.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from mpi4py import MPI
from page_tables import replaced

sys.path.insert(0, str(Path(__file__).parent.parent))

from toros_fem.actuators.problem import actuator_problem
from toros_fem.actuators.run import design_actuator
from toros_fem.actuators.tube import coarse_tube
from toros_fem.design.robust import SPREAD_WEIGHT
from toros_fem.fabrication.as_printed import PrintedDesign
from toros_fem.fabrication.print_file import read_print_polygons
from toros_fem.fabrication.print_spread import print_spread
from toros_fem.fabrication.printed_lines import printed_lines
from toros_fem.scenes.bend import BendConfig, case

PAGE = Path(__file__).parent.parent / "docs" / "optimisation.md"
BEGIN, END = "<!-- table of benchmarks/robust.py -->", "<!-- end of the table -->"
WIDTH = 1e-4
# Edge length of the finer mesh that prints are simulated on, in m.
FINE = 1.4e-3

Row = dict[str, Any]


def designed(folder: Path, seed: int, weight: float | None) -> Row:
    """Return figures of one design."""
    comm = MPI.COMM_WORLD
    changes = {"seed": seed, "estimate_error": False, "curve_pressure": None}
    if weight is not None:
        changes |= {"width_tolerance": WIDTH, "spread_weight": weight}
    config = coarse_tube(BendConfig()).updated(**changes)
    begin = time.process_time()
    made = design_actuator(comm, folder, case, config)
    seconds = time.process_time() - begin
    return {
        "seed": seed,
        "weight": weight,
        "angle_deg": made.summary["angle_deg"],
        "shape": made.result.final.shape,
        "factorisations": made.summary["factorisations"],
        "steps": made.summary["iterations"],
        "cpu_seconds": seconds,
        "smallest_width_mm": made.summary["manufacture"]["smallest_width_mm"],
        "border_mm": made.summary["manufacture"]["border_mm"],
        "coarse": spread_of(folder, config),
        "fine": spread_of(folder, config.updated(edge_length=FINE)),
    }


def spread_of(folder: Path, config: BendConfig) -> Row | None:
    """Return the angles of a print with narrower and wider lines on the mesh of a configuration."""
    comm = MPI.COMM_WORLD
    plain = config.updated(
        width_tolerance=None, line_width=None, gap_width=None, constrained_iterations=0
    )
    problem = actuator_problem(comm, case(comm, plain), plain)
    stored = read_print_polygons(comm, folder)
    printed: PrintedDesign = printed_lines(problem, stored.pattern, stored.regions, stored.limits)
    found = print_spread(problem, printed, WIDTH / 2)
    if found is None:
        return None
    narrow, wide = (values["angle_deg"] for values in found.metrics)
    return {"narrower_deg": narrow, "wider_deg": wide, "spread_deg": abs(narrow - wide)}


def table(rows: list[Row]) -> str:
    """Return the table of all designs."""
    lines = [
        "| seed | design | angle as printed | ± 0.1 mm, 2.85 mm mesh | ± 0.1 mm, 1.4 mm mesh | "
        "factorisations | seconds of the processor |",
        "|---|---|---|---|---|---|---|",
    ]
    plain = {row["seed"]: row for row in rows if row["weight"] is None}
    for row in rows:
        base = plain.get(row["seed"], row)
        spreads = [
            "no equilibrium" if row[mesh] is None else f"{row[mesh]['spread_deg']:.2f}°"
            for mesh in ("coarse", "fine")
        ]
        name = "plain" if row["weight"] is None else f"robust, κ = {row['weight']:g}"
        costs = [
            f"{row[key]:.0f}" + (f" ({row[key] / base[key]:.1f} ×)" if row is not base else "")
            for key in ("factorisations", "cpu_seconds")
        ]
        cells = [str(row["seed"]), name, f"{row['angle_deg']:.1f}°", *spreads, *costs]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> None:
    """Run what is asked for on the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=[2, 3])
    parser.add_argument("--weights", type=float, nargs="+", default=[SPREAD_WEIGHT])
    parser.add_argument("--output", type=Path, help="folder of the runs; none keeps none")
    parser.add_argument("--json", type=Path, help="file of the rows, written after each")
    parser.add_argument("--from", dest="source", type=Path, help="rows to show instead")
    parser.add_argument("--docs", action="store_true", help="write the table into the page")
    given = parser.parse_args()
    file = given.source or given.json
    rows: list[Row] = []
    if file is not None and file.exists():
        rows = json.loads(file.read_text(encoding="utf-8"))
    done = {(row["seed"], row["weight"]) for row in rows}
    wanted = [(seed, weight) for seed in given.seeds for weight in (None, *given.weights)]
    with tempfile.TemporaryDirectory() as scratch:
        for seed, weight in [] if given.source else wanted:
            if (seed, weight) in done:
                continue
            folder = (given.output or Path(scratch)) / f"{seed}_{weight or 'plain'}"
            rows.append(designed(folder, seed, weight))
            if given.json:
                given.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    print(table(rows))
    if given.docs:
        page = PAGE.read_text(encoding="utf-8")
        PAGE.write_text(replaced(page, BEGIN, END, table(rows)), encoding="utf-8")


if __name__ == "__main__":
    main()
