"""Write the figures in demos/expected/ anew: short coarse runs that a regression test repeats.

    python benchmarks/expected.py
    python benchmarks/expected.py --only twist walker

Only to be run after a change that is meant to change results: look at what moves. The figures of
the long runs, those of the README, are in `headline.py`.
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

sys.path.insert(0, str(Path(__file__).parent))

from demo_runs import DEMOS, ROOT, Demo, value_of, without_curve

from toros_fem.base.config import Config

FOLDER = ROOT / "demos" / "expected"
SHORT = {
    "iterations": 4,
    "constrained_iterations": 2,
    "polish_iterations": 0,
    "corrections": 0,
    "estimate_error": False,
}
SHORT_TUBE = {**SHORT, "edge_length": 5.5e-3, "filter_radius": 8.5e-3}
WHOLE = {"whole": True}
SHORT_LINES = {
    "relaxed_edge_length": 6e-3,
    "relaxed_iterations": 3,
    "laid_width": 3e-3,
    "second_laid_width": 3e-3,
    "print_edge_length": 3e-3,
    "corrections": 0,
    "estimate_error": False,
}
# Endings of the names of further runs of a demo: on a part of the tube, with a designed pressure,
# or with the length kept.
PART, PRESSURE, LENGTH = "_part", "_pressure", "_length"
# The changes of each run from the coarse one, and the tolerances of its figures on another machine
# or another number of ranks: (relative, absolute). A run is named for its demo.
RUNS: dict[str, tuple[dict[str, Any], dict[str, tuple[float, float]]]] = {
    "inflate": (
        {"levels": 8, **WHOLE},
        {"radius_percent": (1e-4, 0), "length_percent": (1e-4, 0), "stretch_use": (1e-4, 0)},
    ),
    "inflate_part": (
        {"levels": 8},
        {"radius_percent": (1e-4, 0), "length_percent": (1e-4, 0), "stretch_use": (1e-4, 0)},
    ),
    "bend": ({**SHORT_TUBE, **WHOLE}, {"design.angle_deg": (0.02, 1.0)}),
    "bend_part": (SHORT_TUBE, {"design.angle_deg": (0.02, 1.0)}),
    "bend_pressure": (
        {**SHORT_TUBE, "design_pressure": True},
        {"design.angle_deg": (0.02, 1.0), "pressure_pa": (0.05, 0)},
    ),
    "contract": ({**SHORT_LINES, **WHOLE}, {"design.shortening_percent": (0.02, 0.03)}),
    "contract_part": (
        SHORT_LINES,
        {"design.shortening_percent": (0.02, 0.03), "shortening_percent": (0.05, 0.1)},
    ),
    "twist": (
        SHORT_LINES,
        {
            "design.twist_deg": (0.02, 1.0),
            "design.length_ratio": (0.01, 0),
            "twist_deg": (0.05, 3.0),
            "lines.printed_fraction": (0.02, 0),
        },
    ),
    "twist_length": (
        {**SHORT_LINES, "keep_length": True},
        {"design.twist_deg": (0.02, 1.0), "design.length_ratio": (0.01, 0)},
    ),
    "bend_twist": (
        SHORT_LINES,
        {"design.angle_deg": (0.02, 1.0), "design.twist_deg": (0.02, 1.0)},
    ),
    "walker": (
        {**SHORT, "edge_length": 3.6e-3, "filter_radius": 5.5e-3, "gait_steps": None},
        {"design.angle_deg": (0.02, 1.0)},
    ),
    "gripper": (
        {**SHORT, "edge_length": 3e-3, "filter_radius": 4.6e-3, "lift_distance": None},
        {"design.gap_mm": (0.05, 0.1), "design.angle_deg": (0.02, 1.0)},
    ),
}


def demo_name(name: str) -> str:
    """Return the name of the demo of a short run."""
    for ending in (PART, PRESSURE, LENGTH):
        name = name.removesuffix(ending)
    return name


def demo_of(name: str) -> Demo:
    """Return the demo of a short run."""
    return DEMOS[demo_name(name)]


def config_of(name: str) -> Config:
    """Return the configuration of a demo's short run."""
    demo = demo_of(name)
    config: Config = demo.coarse(demo.config).updated(**RUNS[name][0])
    return config


def inputs_of(name: str) -> dict[str, Any]:
    """Return the values of a short run that differ from the demo's defaults."""
    defaults = demo_of(name).config.as_dict()
    return {key: v for key, v in config_of(name).as_dict().items() if v != defaults[key]}


def main() -> None:
    """Run the demos that the command line names."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=list(RUNS), default=list(RUNS))
    for name in parser.parse_args().only:
        begin = time.perf_counter()
        with tempfile.TemporaryDirectory() as folder:
            config = without_curve(config_of(name))
            summary = demo_of(name).run(MPI.COMM_WORLD, Path(folder), config)
        figures = {
            key: {"value": value_of(summary, key), "relative": relative, "absolute": absolute}
            for key, (relative, absolute) in RUNS[name][1].items()
        }
        text = json.dumps({"inputs": inputs_of(name), "figures": figures}, indent=2)
        (FOLDER / f"{name}.json").write_text(text + "\n", encoding="utf-8")
        print(f"{name}: {time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
