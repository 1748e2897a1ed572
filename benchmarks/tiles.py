"""Run time against error of a tile's profile: the same patterns on finer and finer meshes.

    python benchmarks/tiles.py --quick
    python benchmarks/tiles.py --json tiles.json

Three patterns on a tile of 1 cm: stripes, which are exact on every mesh; crossing lines with
borders on mesh lines; and rings, whose border is a staircase like that of a print. The pull is 10 %
at 0°, 15° and 45°. Errors are relative to the limit extrapolated from the three finest meshes.
Seconds are those of all three directions on one core: from the flat sheet, and from a similar
design with all gradients.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

sys.path.insert(0, str(Path(__file__).parent.parent))

from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.skin.periodicity import Periodic
from toros_fem.meshes import sew, tile
from toros_fem.products.tiles.solver import TileSolver
from toros_fem.products.tiles.stiffness_profile import ProfileSolver

Floats = npt.NDArray[np.float64]
Inside = Callable[[Floats, Floats], npt.NDArray[np.bool_]]

SIDE = 0.01
STRAIN = 0.1
ANGLES = np.radians([0.0, 15.0, 45.0])
EDGES = (10, 20, 40, 80, 160)
# Whether a point is printed; x and y are in units of the side.
PATTERNS: dict[str, Inside] = {
    "stripes": lambda x, y: abs(y - 0.5) < 0.2,
    "lines": lambda x, y: (abs(x - 0.5) < 0.1) | (abs(y - 0.5) < 0.1),
    "rings": lambda x, y: abs(np.hypot(x - 0.5, y - 0.5) - 0.41) < 0.11,
}


def measure(pattern: str, edges: int) -> dict[str, Any]:
    """Solve for one profile on one mesh; return stiffness in N/m, steps and seconds."""
    patch = tile(MPI.COMM_SELF, SIDE, SIDE / edges)
    skin = sew(MPI.COMM_SELF, patch.pattern)
    inside = PATTERNS[pattern](*(patch.pattern.centroids.T / SIDE))
    density = inside[skin.owned_cells].astype(np.float64)
    solver = TileSolver(skin, Composite(bending=None), Periodic(patch))
    profile = ProfileSolver(solver, ANGLES, STRAIN)
    begin = time.perf_counter()
    found = profile.solve(density, gradients=False)
    cold = time.perf_counter() - begin
    begin = time.perf_counter()
    again = profile.solve(0.999 * density, found.state)
    warm = time.perf_counter() - begin
    return {
        "pattern": pattern,
        "edges": edges,
        "triangles": len(patch.pattern.panel),
        "stiffness_n_per_m": found.stiffness.tolist(),
        "steps": found.steps,
        "steps_near": again.steps,
        "seconds": cold,
        "seconds_near_with_gradients": warm,
    }


def add_errors(rows: list[dict[str, Any]]) -> None:
    """Add errors against the limit of the three finest meshes, and observed orders, to rows."""
    values = np.array([row["stiffness_n_per_m"] for row in rows])
    first, second, last = values[-3:]
    steps = second - last
    # The limit of a geometric series. Where the differences do not shrink, the last value is taken.
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = (first - second) / steps
    limit = last - np.where(ratio > 1, steps / (ratio - 1), 0.0)
    for row, value in zip(rows, values, strict=True):
        row["error"] = np.abs(value / limit - 1).tolist()
    for row, after in pairwise(rows):
        with np.errstate(divide="ignore", invalid="ignore"):
            order = np.log2(np.array(row["error"]) / after["error"])
        after["order"] = np.where(np.isfinite(order), order, 0.0).tolist()


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="three meshes only")
    parser.add_argument("--json", type=Path, help="file for the rows")
    options = parser.parse_args()
    edges = EDGES[:3] if options.quick else EDGES
    rows: list[dict[str, Any]] = []
    names = "  ".join(f"{np.degrees(a):>4.0f}°: N/m     error " for a in ANGLES)
    print(f"pattern  edges triangles  {names}  steps  near  seconds   near, with gradients")
    for pattern in PATTERNS:
        part = [measure(pattern, count) for count in edges]
        add_errors(part)
        rows += part
        for row in part:
            pairs = zip(row["stiffness_n_per_m"], row["error"], strict=True)
            cells = "  ".join(f"{s:11.3f} {e:9.1e}" for s, e in pairs)
            print(
                f"{pattern:8s} {row['edges']:5d} {row['triangles']:9d}  {cells}  {row['steps']:5d}"
                f" {row['steps_near']:5d} {row['seconds']:8.2f}"
                f" {row['seconds_near_with_gradients']:8.2f}"
            )
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
