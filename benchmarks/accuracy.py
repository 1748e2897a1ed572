"""Accuracy of the shapes and its cost, in all cases with a known answer.

    python benchmarks/accuracy.py --case plate-clamped
    python benchmarks/accuracy.py --quick --json rows.json
    python benchmarks/accuracy.py --json rows.json --output output/accuracy
    python benchmarks/accuracy.py --from rows.json --docs

Each case runs over at least four refinements (`--quick`: two) and prints value, error against its
reference and observed order. Pictures of error against time go to the output folder. `--docs`
writes docs/accuracy.md and its pictures from the rows.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent))
sys.path.insert(0, str(Path(__file__).parent))

from accuracy_bending import BENDING
from accuracy_case import Case, Row, as_dicts, rows_of
from accuracy_contact import CONTACT
from accuracy_gradients import GRADIENTS
from accuracy_membrane import MEMBRANE
from accuracy_patterns import PATTERNS
from accuracy_report import draw, write_docs

CASES: tuple[Case, ...] = (*MEMBRANE, *BENDING, *CONTACT, *PATTERNS, *GRADIENTS)
HEAD = (
    "formulation  mesh          triangles          value      reference     error  order  seconds"
)


def line(row: Row) -> str:
    """A row of the table."""
    order = "     " if row.observed_order is None else f"{row.observed_order:5.2f}"
    return (
        f"{row.formulation:12s} {row.mesh:13s} {row.triangles:9d} {row.value:14.7g} "
        f"{row.reference:14.7g} {row.relative_error:9.1e} {order} {row.seconds:8.3f}"
    )


def measure(cases: list[Case], *, quick: bool) -> list[Row]:
    """Run cases and print their tables."""
    rows = []
    for case in cases:
        print(f"\n{case.name}: {case.quantity}\n  {case.source}\n{HEAD}", flush=True)
        for row in rows_of(case, quick=quick):
            print(line(row), flush=True)
            rows.append(row)
    return rows


def complete(case: Case, rows: list[Row]) -> bool:
    """Return whether there is a row for each refinement."""
    count = sum(row.case == case.name for row in rows)
    return count == len(case.formulations) * len(case.meshes) * len(case.sizes)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    known = [case.name for case in CASES]
    parser.add_argument("--case", action="append", choices=known, metavar="NAME",
                        help="only this case; may be repeated. " + ", ".join(known))  # fmt: skip
    parser.add_argument("--quick", action="store_true", help="two refinements of each")
    parser.add_argument("--json", type=Path, help="file for the rows")
    parser.add_argument("--output", type=Path, default=Path("output/accuracy"), help="for pictures")
    parser.add_argument("--from", type=Path, dest="rows", help="rows of an earlier run")
    parser.add_argument("--docs", action="store_true", help="write docs/accuracy.md")
    options = parser.parse_args()
    if options.rows:
        content = json.loads(options.rows.read_text(encoding="utf-8"))
        rows = [Row(**entry) for entry in content]
    else:
        chosen = [case for case in CASES if not options.case or case.name in options.case]
        rows = measure(chosen, quick=options.quick)
    if options.json:
        options.json.write_text(json.dumps(as_dicts(rows), indent=1) + "\n", encoding="utf-8")
    draw(options.output, CASES, rows)
    if options.docs:
        missing = [case.name for case in CASES if not complete(case, rows)]
        if missing:
            parser.error(f"--docs needs all refinements of every case; {missing[0]} lacks some")
        write_docs(Path(__file__).parent.parent / "docs", CASES, rows)


if __name__ == "__main__":
    main()
