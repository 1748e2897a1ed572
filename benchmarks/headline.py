"""Headline figures: design the demos again and compare with the figures of the documentation.

    python benchmarks/headline.py --only bend twist
    python benchmarks/headline.py --quick

README.md and demos/README.md publish the figures in `headline.json`, each with the largest
deviation that is acceptable on another machine. Another mesh, or a Newton iteration that fails on
one machine alone, leads to a neighbouring design and not to the same one.
A long run takes 4 to 25 minutes; `--quick` takes the coarse variants, of those demos that publish
figures of them. The exit code is 1 if a figure deviates. The tests repeat short runs only
(`expected.py`).
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

from mpi4py import MPI

sys.path.insert(0, str(Path(__file__).parent))

from demo_runs import DEMOS, value_of, without_curve

FILE = Path(__file__).parent / "headline.json"


def compare(figures: dict[str, list[float]], summary: dict[str, Any]) -> list[dict[str, Any]]:
    """Return a row for each figure: published, computed, and whether it deviates."""
    rows = []
    for key, (published, tolerance) in figures.items():
        computed = value_of(summary, key)
        deviates = computed is None or not abs(computed - published) <= tolerance
        rows.append({
            "figure": key, "published": published, "tolerance": tolerance, "computed": computed,
            "deviates": deviates,
        })  # fmt: skip
    return rows


def run(name: str, entry: dict[str, Any], *, quick: bool) -> list[dict[str, Any]]:
    """Run a demo and compare its figures (collective)."""
    demo = DEMOS[entry["demo"]]
    config = (demo.coarse(demo.config) if quick else demo.config).updated(**entry["inputs"])
    comm = MPI.COMM_WORLD
    with tempfile.TemporaryDirectory() as folder:
        shared = Path(comm.bcast(folder, root=0)) / name
        summary = demo.run(comm, shared, without_curve(config))
        comm.barrier()  # the first rank writes into its folder until here
    return compare(entry["quick" if quick else "long"], summary)


def main() -> int:
    """Compare the runs that the command line names; return the exit code."""
    entries = json.loads(FILE.read_text(encoding="utf-8"))
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=list(entries), help="runs; default all")
    parser.add_argument("--quick", action="store_true", help="the coarse variants")
    options = parser.parse_args()
    kind = "quick" if options.quick else "long"
    chosen = {n: e for n, e in entries.items() if n in (options.only or entries) and kind in e}
    if not chosen:
        parser.error(f"none of these runs publishes {kind} figures")
    rows = []
    for name, entry in chosen.items():
        found = run(name, entry, quick=options.quick)
        rows += [{"run": name, **row} for row in found]
    if MPI.COMM_WORLD.rank == 0:
        print("\nrun           figure                       published  tolerance   computed")
        for r in rows:
            computed = "-" if r["computed"] is None else f"{r['computed']:.4g}"
            print(
                f"{r['run']:12s}  {r['figure']:26s}  {r['published']:10.4g} {r['tolerance']:10.3g} "
                f"{computed:>10s}{'  DEVIATES' if r['deviates'] else ''}"
            )
    return int(any(r["deviates"] for r in rows))


if __name__ == "__main__":
    sys.exit(main())
