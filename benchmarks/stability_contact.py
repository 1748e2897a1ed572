"""The cases of `stability.py` that fold onto themselves, again with self-contact.

    scripts/fenicsx python3 benchmarks/stability_contact.py --rows output/stability/contact.jsonl \
        --json benchmarks/stability_contact.json --docs

They are the cases of stability.json in which the solver gave up. Layers are kept apart by the
fabric's thickness, by the defaults of `Contact`. States are checked as there, and for surfaces that
cross. The exit code is 1 if a state is wrong, or if a case is not solved that the oracle solved.
"""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

from case_options import parsed, parser_of
from page_tables import replaced
from shared_rows import complete
from stability import LONGEST, PAGE, Stage, attempt
from stability_report import Case

from toros_fem.mechanics.contact import Contact

FOUND = Path(__file__).parent / "stability.json"
MARKS = ("<!-- with contact -->", "<!-- end of with contact -->")


def folded_cases() -> dict[str, Case]:
    """Return the cases in which the solver gave up, those that have a solution first."""
    whole = json.loads(FOUND.read_text(encoding="utf-8"))
    chosen = [found for found in whole["findings"] if found["verdict"] != "wrong"]
    chosen.sort(key=lambda found: found["verdict"] != "failed")
    rows = [(found["verdict"], whole["rows"][found["row"]]) for found in chosen]
    names = ("scene", "design", "contrast", "load", "start")
    cases = [(verdict, Case(**{name: row[name] for name in names})) for verdict, row in rows]
    return {f"{verdict}: {case.label()}": case for verdict, case in cases}


@cache
def stage_of(name: str) -> Stage:
    """Return a scene with self-contact, made once in a process."""
    return Stage(name, Contact())


def play_case(case: Case) -> dict[str, Any]:
    """Return the outcome of a case."""
    return asdict(attempt(stage_of(case.scene), case))


def outcome(found: dict[str, Any]) -> str:
    """Return the verdict of a row; a solve that takes too long is neither right nor wrong."""
    late = found["row"]["result"] == "exception" and found["row"]["seconds"] >= LONGEST
    return f"stopped after {LONGEST:g} s" if late else str(found["verdict"])


def markdown(rows: dict[str, dict[str, Any]]) -> str:
    """Return the table of all cases."""
    lines = ["| case | without contact | with self-contact | steps |", "|---|---|---|---|"]
    for key, found in rows.items():
        verdict, label = key.split(": ", 1)
        before = "failed" if verdict == "failed" else "the oracle gives up too"
        steps = found["row"]["newton_steps"]
        lines.append(f"| {label} | {before} | {outcome(found)} | {steps} |")
    return "\n".join(lines)


def main() -> int:
    """Command line."""
    parser = parser_of(__doc__, PAGE)
    parser.add_argument("--cases", type=int, help="number of cases, the first ones; default: all")
    options = parsed(parser)
    if options.source:
        rows = json.loads(options.source.read_text(encoding="utf-8"))["rows"]
    else:
        rows = complete(
            dict(list(folded_cases().items())[: options.cases]),
            play_case,
            options.rows,
            options.workers,
            lambda key, row: print(f"{row['verdict']}: {key}: {row['row']['reason']}", flush=True),
        )
    if options.json:
        text = json.dumps({"rows": rows}, indent=1, allow_nan=False)
        options.json.write_text(text + "\n", encoding="utf-8")
    if options.docs:
        page = options.page.read_text(encoding="utf-8")
        options.page.write_text(replaced(page, *MARKS, markdown(rows)), encoding="utf-8")
    failed = [key for key, row in rows.items() if outcome(row) == "wrong"]
    failed += [
        key
        for key, row in rows.items()
        if key.startswith("failed") and row["verdict"] != "converged"
    ]
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
