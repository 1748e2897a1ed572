"""A tube that bends when inflated (paper Fig. 8b): design its reinforcement pattern.

    python demos/bend.py --coarse
    mpirun -n 2 python demos/bend.py --coarse --output output/bend-2

The tube, 15 cm long and 2 cm wide, lies along z. Its end z = 0 is clamped; its two end caps are
reinforced all over, as end plates are; its wall is designed, and the pressure with it. It is to
bend towards +x, with the inner side of the bend keeping its length: a skin under pressure does not
shorten by itself. The end plate at the tip counts as much as all the rest, so that the angle is
reached and not only the shape. Constraints on the widths of lines and gaps are switched on when the
free design has found its way; the pattern is then thresholded, cleaned of islands, and simulated
again as it is printed.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from toros_fem.meshes import bend

from toros_fem.cli import command_line
from toros_fem.measure import bend_angle
from toros_fem.scene import Scene, design, merged
from toros_fem.tube import TUBE, tube_scene

DEFAULTS: dict[str, Any] = {
    **TUBE,
    "angle": 180.0,  # degrees
    "neutral": 0.01,  # m; the inner side of the bend keeps its length
}
COARSE = {"edge_length": 2.85e-3, "radius": 4.4e-3, "iterations": 40, "constrained": 30}


def scene(comm: MPI.Comm, inputs: dict[str, Any]) -> Scene:
    """The tube, what is held of it, and what it is to become."""
    o = inputs
    target = bend(np.radians(o["angle"]), o["length"], neutral=o["neutral"])
    return tube_scene(comm, o, target, bend_angle, o["angle"])


def run(comm: MPI.Comm, output: Path, *, verbose: bool = False, **inputs: Any) -> dict[str, Any]:
    """Design the tube; returns the summary that is also written to `output`.

    Args:
        comm: Communicator.
        output: Folder for summary, history, pattern, fields and pictures.
        verbose: Whether to print every step of the equilibrium solver.
        inputs: What differs from `DEFAULTS` and `toros_fem.scene.Settings`.
    """
    begin = time.perf_counter()
    whole = merged(DEFAULTS, inputs)
    return design(comm, output, scene(comm, whole), whole, begin=begin, verbose=verbose).summary


def last_line(summary: dict[str, Any]) -> str:
    """The result in a sentence."""
    angle = summary["angle_deg"]
    printed = "no equilibrium" if angle is None else f"{angle:.1f}"
    if summary.get("angle_error_deg") is not None:
        printed += f" ± {summary['angle_error_deg']:.1f}"
    drop = summary["objective_first"] / summary["objective_last"]
    return (
        f"{printed} of {summary['angle_target_deg']:g} degrees as printed "
        f"({summary['design']['angle_deg']:.1f} as designed) at "
        f"{summary['pressure_pa'] / 1e3:.2f} kPa, objective down {drop:.0f} times, "
        f"{summary['manufacture']['islands']} islands, {summary['seconds']['total']:.0f} s"
    )


if __name__ == "__main__":
    sys.exit(
        command_line(MPI.COMM_WORLD, __doc__, run, DEFAULTS, COARSE, Path("output/bend"), last_line)
    )
