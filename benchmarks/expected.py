"""Make the key figures in demos/expected/ anew: short coarse runs that the tests repeat.

    python benchmarks/expected.py
    python benchmarks/expected.py --only twist walker

To be run after a change that is meant to change results, and only then: look at what moves.
"""

from __future__ import annotations

import argparse
import importlib
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from mpi4py import MPI

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))
FOLDER = ROOT / "demos" / "expected"
SHORT = {"iterations": 4, "constrained": 2, "polish": 0}
SHORT_TUBE = {**SHORT, "edge_length": 5.5e-3, "radius": 8.5e-3}
# What each run changes besides, and how far its figures may be off on another machine or on other
# numbers of ranks: (over their size, absolutely).
RUNS: dict[str, tuple[dict[str, Any], dict[str, tuple[float, float]]]] = {
    "inflate": (
        {"levels": 8},
        {"radius_percent": (1e-4, 0), "length_percent": (1e-4, 0), "stretch_use": (1e-4, 0)},
    ),
    "bend": (SHORT_TUBE, {"design.angle_deg": (0.02, 1.0), "pressure_pa": (0.05, 0)}),
    "contract": (SHORT_TUBE, {"design.shortening_percent": (0.02, 0.03), "pressure_pa": (0.05, 0)}),
    "twist": (SHORT_TUBE, {"design.twist_deg": (0.02, 1.0), "pressure_pa": (0.05, 0)}),
    "bend_twist": (
        SHORT_TUBE,
        {"design.angle_deg": (0.02, 1.0), "design.twist_deg": (0.02, 1.0)},
    ),
    "walker": (
        {**SHORT, "edge_length": 3.6e-3, "radius": 5.5e-3, "gait_steps": 1},
        {
            "design.angle_deg": (0.02, 1.0),
            "gait.foot_lift_mm": (0.02, 0.1),
            "gait.stride_mm": (0.05, 0.02),
        },
    ),
    "gripper": (
        {**SHORT, "edge_length": 3e-3, "radius": 4.6e-3},
        {"design.gap_mm": (0.05, 0.1), "design.angle_deg": (0.02, 1.0)},
    ),
}


def inputs_of(name: str) -> dict[str, Any]:
    """What a run of a demo is given."""
    return {**importlib.import_module(f"demos.{name}").COARSE, **RUNS[name][0]}


def value_of(summary: dict[str, Any], key: str) -> float:
    """An entry of a summary, by its names with dots between."""
    found: Any = summary
    for name in key.split("."):
        found = found[name]
    return float(found)


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=list(RUNS), default=list(RUNS))
    for name in parser.parse_args().only:
        begin = time.perf_counter()
        demo = importlib.import_module(f"demos.{name}")
        with tempfile.TemporaryDirectory() as folder:
            summary = demo.run(MPI.COMM_WORLD, Path(folder), **inputs_of(name))
        metrics = {
            key: {"value": value_of(summary, key), "relative": share, "absolute": room}
            for key, (share, room) in RUNS[name][1].items()
        }
        text = json.dumps({"inputs": inputs_of(name), "figures": metrics}, indent=2)
        (FOLDER / f"{name}.json").write_text(text + "\n", encoding="utf-8")
        print(f"{name}: {time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
