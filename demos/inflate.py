"""A tube without reinforcement swells and lengthens, then saturates (paper Fig. 8a).

    python demos/inflate.py --coarse

The tube of `bend.py` with plain walls, from 0 to 20 kPa: radius of its middle third and
distance of its ends, over what they were. Up to some kPa the fabric stretches by more and more;
above about 10 kPa it is close to its stretch bounds, and the curve bends down.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.actuators.case import merged, settings_of
from toros_fem.actuators.tube import TUBE, plain_tube
from toros_fem.analysis.pressure_path import trace_pressure_path
from toros_fem.command_line import command_line
from toros_fem.equilibrium.solver import EquilibriumSolver
from toros_fem.meshes import sew
from toros_fem.objectives.metrics import Metric, shortening, swelling
from toros_fem.output.writer import write_pressure_path

DEFAULTS: dict[str, Any] = {
    **TUBE,
    "highest": 20e3,  # Pa
    "levels": 40,
    "pressure": 10e3,  # above, the tube is called saturated
}
COARSE = {"edge_length": 2.85e-3, "levels": 20}
FIGURES = (
    Metric("radius", "percent", 100.0, lambda of, x: 100 * swelling(of, x)),
    Metric("length", "percent", 100.0, lambda of, x: 100 * (1 - shortening(of, x))),
)


def run(comm: MPI.Comm, output: Path, *, verbose: bool = False, **inputs: Any) -> dict[str, Any]:
    """Inflate the tube; returns the summary that is also written to `output`.

    Args:
        comm: Communicator.
        output: Folder for summary, curve, fields and pictures.
        verbose: Whether to print every step of the equilibrium solver.
        inputs: What differs from `DEFAULTS` and `toros_fem.scene.ActuatorConfig`.
    """
    begin = time.perf_counter()
    o = merged(DEFAULTS, inputs)
    pattern, supports, density = plain_tube(comm, o)
    skin = sew(comm, pattern)
    solver = EquilibriumSolver(skin, settings_of(o).composite, supports)
    levels = np.linspace(0.0, o["highest"], o["levels"] + 1)
    points = list(
        trace_pressure_path(solver, density[skin.owned_cells], [*map(float, levels)], FIGURES)
    )
    radius = np.array([point.metrics["radius_percent"] for point in points])
    half = int(np.argmin(np.abs(levels - o["pressure"])))
    summary = {
        "radius_percent": radius[-1],
        "length_percent": points[-1].metrics["length_percent"],
        "radius_percent_at_pressure": radius[half],
        "length_percent_at_pressure": points[half].metrics["length_percent"],
        "growth_above_over_below": (radius[-1] - radius[half]) / (radius[half] - radius[0]),
        "steepest_kpa": 1e-3 * float(levels[1:][np.argmax(np.diff(radius))]),
        "inputs": o,
    }
    seconds = {"total": time.perf_counter() - begin}
    return write_pressure_path(
        comm, output, pattern, points, density, FIGURES, figures=summary, seconds=seconds
    )


def sentence(summary: dict[str, Any]) -> str:
    """The result in words."""
    o = summary["inputs"]
    return (
        f"radius {summary['radius_percent_at_pressure']:.0f} % and length "
        f"{summary['length_percent_at_pressure']:.0f} % at {o['pressure'] / 1e3:g} kPa, "
        f"{summary['radius_percent']:.0f} % and {summary['length_percent']:.0f} % at "
        f"{o['highest'] / 1e3:g} kPa: {100 * summary['growth_above_over_below']:.0f} % of the "
        f"growth before"
    )


if __name__ == "__main__":
    sys.exit(
        command_line(
            MPI.COMM_WORLD, __doc__, run, DEFAULTS, COARSE, Path("output/inflate"), sentence
        )
    )
