"""The plain tube under pressure, on which the default jersey is calibrated.

    scripts/fenicsx python3 benchmarks/plain_tube.py

According to the paper the unreinforced 15 cm x 2 cm tube swells and lengthens, and saturates above
about 10 kPa. The table shows radius and length of the default fabric over the pressure, and the
growth of the radius for each further kPa.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
from mpi4py import MPI

from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.supports import clamp
from toros_fem.meshes import cylinder, sew
from toros_fem.products.tubes.tube import TubeConfig

PRESSURES = (0.5e3, 1e3, 2e3, 3e3, 4e3, 5e3, 7e3, 10e3, 15e3, 20e3, 30e3)


def main() -> None:
    """Print the table that the command line specifies."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--edge-length", type=float, default=3e-3, help="m")
    parser.add_argument("--json", type=Path, help="file for the rows")
    options = parser.parse_args()
    comm = MPI.COMM_WORLD
    config = TubeConfig(edge_length=options.edge_length, mesh="structured")
    length, diameter = config.length, config.diameter
    pattern = cylinder(comm, length, diameter, config.edge_length, mesh=config.mesh)
    skin = sew(comm, pattern)
    solver = EquilibriumSolver(skin, config.composite, clamp(pattern, ["base"]))
    density = np.zeros(len(skin.owned_cells))
    height = pattern.points[:, 2]
    middle = np.intersect1d(
        pattern.vertices_of("wall"), np.flatnonzero(np.abs(height - length / 2) < length / 6)
    )
    rows = []
    state = None
    for pressure in PRESSURES:
        result = solver.solve(density, pressure, start=state)
        state = result.state
        x = skin.gather_vertices(result.positions)
        radius = np.linalg.norm(x[middle, :2] - x[middle, :2].mean(axis=0), axis=1).mean()
        axial = np.polyfit(height[middle], x[middle, 2], 1)[0]
        rows.append(
            {
                "pressure_pa": pressure,
                "radius_ratio": radius / (diameter / 2),
                "length_ratio": axial,
                "stretch_use": result.stretch_use,
                "newton_steps": result.steps,
            }
        )
    if comm.rank == 0:
        print("kPa    radius  length  widening per kPa")
        before = {"pressure_pa": 0.0, "radius_ratio": 1.0}
        for row in rows:
            rise = (row["radius_ratio"] - before["radius_ratio"]) / (
                (row["pressure_pa"] - before["pressure_pa"]) / 1e3
            )
            print(
                f"{row['pressure_pa'] / 1e3:4.1f}  {row['radius_ratio']:7.3f} "
                f"{row['length_ratio']:7.3f}  {100 * rise:6.1f} %"
            )
            before = row
        if options.json:
            options.json.write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
