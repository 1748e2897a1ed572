"""Dependence of the bending tube on its random start.

    python benchmarks/seeds.py --coarse --seeds 5
    python benchmarks/seeds.py --seeds 3 --json seeds.json

Designs the pattern of `demos/bend.py` and the pressure from several seeds. Prints the figures of
each print, and their spread.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

sys.path.insert(0, str(Path(__file__).parent.parent))

from toros_fem.base.validation import require_count
from toros_fem.products.tubes import bend
from toros_fem.products.tubes.tube import coarse_tube

COLUMNS = {
    "angle_deg": "printed/deg",
    "designed_deg": "designed/deg",
    "shape": "T printed",
    "pressure_pa": "P/Pa",
    "grey_level": "grey",
    "islands": "islands",
    "width_mm": "line/mm",
    "gap_mm": "gap/mm",
    "seconds": "seconds",
}


def row(seed: int, summary: dict[str, Any]) -> dict[str, Any]:
    """Return the figures of one seed."""
    made = summary["manufacture"]
    return {
        "seed": seed,
        "angle_deg": summary["angle_deg"],
        "designed_deg": summary["design"]["angle_deg"],
        "shape": summary["printed_objective"],
        "pressure_pa": summary["pressure_pa"],
        "grey_level": summary["grey_level"],
        "islands": made["islands"],
        "width_mm": made["smallest_width_mm"],
        "gap_mm": made["smallest_gap_mm"],
        "satisfied": summary["length_scale"]["satisfied"],
        "seconds": summary["seconds"]["total"],
    }


def main() -> None:
    """Run the seeds that the command line gives."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--coarse", action="store_true", help="the demo's coarse variant")
    parser.add_argument("--seeds", type=int, default=5, help="number of seeds, starting at 0")
    parser.add_argument("--json", type=Path, help="file for the rows")
    options = parser.parse_args()
    require_count(1, seeds=options.seeds)
    whole = bend.BendConfig(whole=True, design_pressure=True, corrections=0, curve_pressure=None)
    config = coarse_tube(whole) if options.coarse else whole
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(options.seeds):
            summary = bend.run(MPI.COMM_SELF, Path(folder), config.updated(seed=seed))
            rows.append(row(seed, summary))
            if options.json:
                options.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    print("\nseed    " + "  ".join(f"{title:>12s}" for title in COLUMNS.values()))
    for line in rows:
        cells = (line[name] for name in COLUMNS)
        print(f"{line['seed']:<8d}" + "  ".join(_number(value) for value in cells))
    for name, reduce in (("least", np.min), ("median", np.median), ("largest", np.max)):
        known = ([r[key] for r in rows if r[key] is not None] for key in COLUMNS)
        values = (float(reduce(column)) if column else None for column in known)
        print(f"{name:8s}" + "  ".join(_number(value) for value in values))
    print(f"constraints satisfied by {sum(r['satisfied'] for r in rows)} of {len(rows)}")


def _number(value: float | None) -> str:
    return f"{'-':>12s}" if value is None else f"{value:12.4g}"


if __name__ == "__main__":
    main()
