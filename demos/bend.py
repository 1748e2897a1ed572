"""A tube that bends when inflated (paper Fig. 8b): design its reinforcement pattern.

    python demos/bend.py --coarse
    mpirun -n 2 python demos/bend.py --coarse --output output/bend-2

The tube, 15 cm long and 2 cm wide, lies along z. Its end z = 0 is clamped; its two end caps are
reinforced all over, as end plates are; its wall is designed. It is to bend towards +x, with the
inner side of the bend keeping its length: a skin under pressure does not shorten by itself.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from toros_fem.meshes import bend, cylinder, sew

from toros_fem.density import random_density
from toros_fem.design import DesignProblem
from toros_fem.equilibrium import EquilibriumSolver
from toros_fem.errors import ParameterError, TorosError
from toros_fem.filters import ConeFilter
from toros_fem.measure import bend_angle
from toros_fem.mma import MMAOptions
from toros_fem.objective import ShapeObjective
from toros_fem.optimise import DesignOptions, optimise
from toros_fem.parameters import Composite, Material
from toros_fem.projection import Projection
from toros_fem.report import Reporter, print_step
from toros_fem.supports import clamp

DEFAULTS: dict[str, Any] = {
    "length": 0.15,  # m
    "diameter": 0.02,  # m
    "edge_length": 1.6e-3,  # m
    "mesh": "unstructured",
    "angle": 180.0,  # degrees
    "neutral": 0.01,  # m; the inner side of the bend keeps its length
    "pressure": 5e3,  # Pa
    "fabric_young": 0.1e6,  # Pa
    "reinforcement_young": 26e6,  # Pa
    "poisson": 0.3,
    "thickness": 0.5e-3,  # m
    "c1": 1.9,
    "c2": 2.6,
    "radius": 2.4e-3,  # m, of the filter
    "beta": 20.0,
    "eta": 0.5,
    "move": 0.2,
    "iterations": 100,
    "seed": 2,
}
COARSE = {"edge_length": 2.85e-3, "radius": 4.3e-3, "angle": 90.0, "iterations": 60}


def run(comm: MPI.Comm, output: Path, *, verbose: bool = False, **inputs: Any) -> dict[str, Any]:
    """Design the tube; returns the summary that is also written to `output`.

    Args:
        comm: Communicator.
        output: Folder for summary, history, pattern, fields and pictures.
        verbose: Whether to print every step of the equilibrium solver.
        inputs: What differs from `DEFAULTS`.
    """
    begin = time.perf_counter()
    unknown = sorted(set(inputs) - set(DEFAULTS))
    if unknown:
        raise ParameterError(f"{unknown[0]!r} is no parameter; there are {', '.join(DEFAULTS)}.")
    o = {**DEFAULTS, **inputs}
    pattern = cylinder(comm, o["length"], o["diameter"], o["edge_length"], mesh=o["mesh"])
    skin = sew(comm, pattern)
    sheet = {"poisson": o["poisson"], "thickness": o["thickness"]}
    composite = Composite(
        fabric=Material(young=o["fabric_young"], **sheet),
        reinforcement=Material(young=o["reinforcement_young"], **sheet),
        c1=o["c1"],
        c2=o["c2"],
    )
    target = bend(np.radians(o["angle"]), o["length"], neutral=o["neutral"])(pattern.points)
    wall = pattern.panel_index("wall")
    problem = DesignProblem(
        solver=EquilibriumSolver(
            skin, composite, clamp(pattern, ["base"]), log=print_step(comm) if verbose else None
        ),
        objective=ShapeObjective(skin, target),
        filter=ConeFilter(skin, o["radius"]),
        pressure=o["pressure"],
        projection=Projection(o["beta"], o["eta"]),
        passive=np.where(pattern.panel[skin.owned_cells] == wall, np.nan, 1.0),
    )
    options = DesignOptions(iterations=o["iterations"], mma=MMAOptions(move=o["move"]))

    def angle(positions: npt.NDArray[np.float64]) -> float:
        return float(np.degrees(bend_angle(pattern, positions)))

    reporter = Reporter(skin, output, o["iterations"], angle, begin)
    result = optimise(problem, random_density(skin, o["seed"]), options, reporter)
    figures = {"angle_target_deg": o["angle"], "seed": o["seed"]}
    return reporter.finish(result, target, o["eta"], o, figures)


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--coarse", action="store_true", help="about 3000 triangles, 90 degrees")
    parser.add_argument("--verbose", action="store_true", help="show every Newton step")
    parser.add_argument("--output", type=Path, default=Path("output/bend"), help="output folder")
    for name, value in DEFAULTS.items():
        parser.add_argument(
            "--" + name.replace("_", "-"), type=type(value), help=f"default {value}"
        )
    options = vars(parser.parse_args())
    output, coarse, verbose = (options.pop(name) for name in ("output", "coarse", "verbose"))
    given = {name: value for name, value in options.items() if value is not None}
    comm = MPI.COMM_WORLD
    try:
        summary = run(comm, output, verbose=verbose, **({**COARSE, **given} if coarse else given))
    except TorosError as error:
        if comm.rank == 0:
            print(f"{type(error).__name__}: {error}", file=sys.stderr)
        return 2
    if comm.rank == 0:
        drop = summary["objective_first"] / summary["objective_last"]
        print(
            f"{summary['angle_deg']:.1f} of {summary['angle_target_deg']:g} degrees, objective "
            f"down {drop:.0f} times, {summary['seconds']['total']:.0f} s; see {output}/"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
