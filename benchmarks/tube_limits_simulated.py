"""Simulated tubes for `tube_limits.py`: stiff helical lines on the default fabric."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from drawn_lines import helices
from mpi4py import MPI

from toros_fem.measures.metrics import Metric, shortening, swelling, twist_angle
from toros_fem.measures.rotation import best_rotation
from toros_fem.mechanics.equilibrium.solver import EquilibriumError, EquilibriumSolver
from toros_fem.mechanics.paths.trace import trace
from toros_fem.meshes import Pattern, sew
from toros_fem.products.tubes.tube import TubeConfig, plain_tube

Floats = npt.NDArray[np.float64]
Row = dict[str, Any]


@dataclass(frozen=True)
class Case:
    """One tube.

    Attributes:
        lines: Number of lines of each family around the tube.
        degrees: Their angle to the axis.
        width: Width of each line in m.
        crossed: Whether there is a left-handed family too.
        edge: Edge length of the mesh in m.
        young: Modulus of the lines in Pa.
    """

    lines: int
    degrees: float
    width: float = 3e-3
    crossed: bool = False
    edge: float = 2.5e-3
    young: float = TubeConfig().reinforcement_young

    @property
    def inputs(self) -> Row:
        """The case as it stands in the rows."""
        return {
            "kind": "shortening" if self.crossed else "twist",
            "lines": self.lines,
            "angle_deg": float(self.degrees),
            "width_mm": round(1e3 * self.width, 6),
            "edge_mm": round(1e3 * self.edge, 6),
            "young_mpa": round(1e-6 * self.young, 6),
        }


def simulate(case: Case, pressures: Sequence[float]) -> list[Row]:
    """Return a row for each of the rising pressures in Pa that has an equilibrium."""
    begin = time.perf_counter()
    config = TubeConfig(edge_length=case.edge, reinforcement_young=case.young)
    pattern, supports, density = plain_tube(MPI.COMM_SELF, config)
    for angle in (case.degrees, -case.degrees)[: 2 if case.crossed else 1]:
        density[helices(pattern, case.lines, np.radians(angle), case.width)] = 1.0
    skin = sew(MPI.COMM_SELF, pattern)
    solver = EquilibriumSolver(skin, config.composite, supports)
    wall = pattern.cells_of("wall")
    areas = pattern.areas[wall]
    fraction = float(areas @ density[wall] / areas.sum())
    inputs = {**case.inputs, "triangles": len(density), "fraction": fraction}
    metrics = [
        Metric("twist", "deg", 0.0, lambda p, x: float(np.degrees(twist_angle(p, x)))),
        Metric("shortening", "percent", 0.0, lambda p, x: 100 * shortening(p, x)),
        Metric("swelling", "ratio", 0.0, swelling),
        Metric("middle_twist", "deg", 0.0, lambda p, x: middle(p, x)[0]),
        Metric("middle_length", "ratio", 0.0, lambda p, x: middle(p, x)[1]),
    ]
    rows: list[Row] = []
    try:
        for point in trace(solver, density[skin.owned_cells], pressures, metrics):
            figures = {"pressure_kpa": 1e-3 * float(np.max(point.pressure)), **point.metrics}
            rows.append({**inputs, **figures})
    except EquilibriumError as caught:
        print(f"no equilibrium beyond {rows[-1]['pressure_kpa'] if rows else 0} kPa: {caught}")
    seconds = time.perf_counter() - begin
    return [{**row, "seconds": seconds} for row in rows]


def middle(pattern: Pattern, positions: Floats) -> tuple[float, float]:
    """Return twist in degrees and length ratio of a tube that is all like the middle third.

    The end plates have no effect on it, as in the closed forms.
    """
    height = pattern.points[:, 2]
    length = float(np.ptp(height))
    band = 0.02 * length
    wall = pattern.vertices_of("wall")
    rings = [
        wall[np.abs(height[wall] - height.min() - fraction * length) < band]
        for fraction in (1 / 3, 2 / 3)
    ]
    low, high = (best_rotation(pattern.points[ring], positions[ring]) for ring in rings)
    turn = low.T @ high
    angle = np.degrees(np.arctan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1]))
    before, after = (
        np.linalg.norm(np.diff([points[ring].mean(axis=0) for ring in rings], axis=0))
        for points in (pattern.points, positions)
    )
    return 3 * float(angle), float(after / before)
