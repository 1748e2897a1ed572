"""What cleaning does to the prints of all demos: widths, gaps, islands, wear and metrics.

    python benchmarks/clean_prints.py --coarse --seeds 5
    python benchmarks/clean_prints.py --only bend twist --seeds 1
    python benchmarks/clean_prints.py --report

Designs each demo from several seeds. The contours as they come and the print made of them are both
simulated on the same mesh. The print is also worn: eroded and swollen by 0.45 of the least width;
then no line, gap, piece or hole may part or vanish. Rows go to `clean_prints.json`, where runs that
are already there are skipped.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

from mpi4py import MPI
from shapely.geometry.base import BaseGeometry

sys.path.insert(0, str(Path(__file__).parent))

from demo_runs import DEMOS, without_curve

from toros_fem.base.errors import NoEquilibriumError
from toros_fem.base.validation import require_count
from toros_fem.making.print import panel_outline, printed_cells
from toros_fem.making.print.thickness import pieces_and_holes
from toros_fem.products.actuators.run import ActuatorResult, design_actuator
from toros_fem.products.gripper import gripper
from toros_fem.products.tubes import bend, bend_twist, contract, twist
from toros_fem.products.walker import walker

FILE = Path(__file__).parent / "clean_prints.json"
CASES = {
    "bend": bend.case,
    "contract": contract.case,
    "twist": twist.case,
    "bend_twist": bend_twist.case,
    "walker": walker.case,
    "gripper": gripper.case,
}
# Depth of wear over the least width.
WORN = 0.45


def row(name: str, seed: int, *, coarse: bool) -> dict[str, Any]:
    """Design a demo and return the figures of its contours and of its print."""
    demo = DEMOS[name]
    config: Any = without_curve(demo.coarse(demo.config) if coarse else demo.config)
    with tempfile.TemporaryDirectory() as folder:
        made = design_actuator(
            MPI.COMM_SELF, folder, CASES[name], config.updated(seed=seed), verbose=False
        )
    printed = made.printed
    figures: dict[str, Any] = {"demo": name, "coarse": coarse, "seed": seed}
    for kind, found in (("before", printed.before), ("after", printed.after)):
        summary = found.summary()
        for key in ("smallest_width_mm", "smallest_gap_mm", "islands", "pieces", "holes"):
            figures[f"{key}_{kind}"] = summary[key]
    cleaned = printed.cleaned
    figures["dropped"], figures["bridged"] = len(cleaned.dropped), len(cleaned.bridged)
    figures["area_changed"] = sum(
        one.symmetric_difference(two).area
        for one, two in zip(printed.contours, printed.regions, strict=True)
    ) / sum(region.area for region in printed.contours)
    figures["survives_wear"] = all(
        survives(region, panel_outline(printed.pattern, panel), WORN * printed.limits.width)
        for panel, region in enumerate(printed.regions)
    )
    metrics = {m.key: m for m in made.problem.metrics if m.target is not None}
    before, after = bare_metrics(made), {key: made.summary[key] for key in metrics}
    figures["metrics"] = {
        key: {"target": m.target, "before": before and before[key], "after": after[key]}
        for key, m in metrics.items()
    }
    return figures


def bare_metrics(made: ActuatorResult) -> dict[str, float] | None:
    """Return the metrics of the contours; None without an equilibrium."""
    printed, problem = made.printed, made.problem
    cells = printed_cells(printed.pattern, printed.contours)
    like = printed.evaluation or made.result.final
    try:
        found = problem.simulate_binary(cells[problem.skin.owned_cells], like)
    except NoEquilibriumError:
        return None
    return dict(problem.metrics_of(found.equilibrium))


def survives(region: BaseGeometry, outline: BaseGeometry, depth: float) -> bool:
    """Return whether nothing parts or vanishes when print, or fabric, is eroded by a depth."""
    fabric = outline.difference(region).buffer(-1e-4 * depth).buffer(1e-4 * depth)
    return all(
        pieces_and_holes(shape) == pieces_and_holes(shape.buffer(-depth))
        for shape in (region, fabric)
    )


def report(rows: list[dict[str, Any]]) -> str:
    """Return the table of docs/manufacture.md, the worst of all seeds of each demo."""
    lines = [
        "| demo | seeds | line, contours; print | gap, contours; print | islands, contours; print |"
        " wear | largest change of a metric |",
        "|---|---|---|---|---|---|---|",
    ]
    kinds = sorted({(r["demo"], r["coarse"]) for r in rows}, key=lambda k: (not k[1], k[0]))
    for name, coarse in kinds:
        own = [r for r in rows if (r["demo"], r["coarse"]) == (name, coarse)]

        def least(key: str, own: list[dict[str, Any]] = own) -> str:
            found = [r[key] for r in own if r[key] is not None]
            return f"{min(found):.2f}" if found else "none"

        changes = [
            abs(m["after"] - m["before"]) / abs(m["target"])
            for r in own
            for m in r["metrics"].values()
            if m["before"] is not None and m["after"] is not None and m["target"]
        ]
        islands = [max(r[f"islands_{kind}"] for r in own) for kind in ("before", "after")]
        kept = sum(r["survives_wear"] for r in own)
        lines.append(
            f"| {name}{', coarse' if coarse else ''} | {len(own)} "
            f"| {least('smallest_width_mm_before')}; {least('smallest_width_mm_after')} mm "
            f"| {least('smallest_gap_mm_before')}; {least('smallest_gap_mm_after')} mm "
            f"| {islands[0]}; {islands[1]} | {kept} of {len(own)} "
            f"| {100 * max(changes, default=float('nan')):.1f} % |"
        )
    return "\n".join(lines)


def main() -> None:
    """Run the demos and seeds that the command line gives, or print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--coarse", action="store_true", help="the demos' coarse variants")
    parser.add_argument("--seeds", type=int, default=1, help="number of seeds, from 0")
    parser.add_argument("--only", nargs="+", choices=CASES, default=list(CASES))
    parser.add_argument("--report", action="store_true", help="print the table, run nothing")
    options = parser.parse_args()
    require_count(1, seeds=options.seeds)
    rows: list[dict[str, Any]] = json.loads(FILE.read_text()) if FILE.exists() else []
    for name in () if options.report else options.only:
        for seed in range(options.seeds):
            known = {(r["demo"], r["coarse"], r["seed"]) for r in rows}
            if (name, options.coarse, seed) not in known:
                rows.append(row(name, seed, coarse=options.coarse))
                FILE.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    print(report(rows))


if __name__ == "__main__":
    main()
