"""How fine a mesh must be to simulate a print of thin lines, and by which rule.

    scripts/fenicsx python3 benchmarks/printed_lines.py --quick
    scripts/fenicsx python3 benchmarks/printed_lines.py --json printed_lines.json

Nets of straight lines on the tube of the demos, known as exact polygons, are simulated on finer and
finer meshes. Three rules turn polygons into densities: "centroid", printed or not, by the centroid
of the triangle, as `printed_cells` does; "snapped", the same on a mesh whose vertices are moved
onto the borders of the polygons; and "covered", the fraction of the triangle that is covered. Each
mesh starts from the shape on the one before. Seconds are processor time of one core.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely
from mpi4py import MPI
from shapely.geometry.base import BaseGeometry

from toros_fem.making.print.printability import printed_cells
from toros_fem.measures.metrics import shortening, twist_angle
from toros_fem.mechanics.equilibrium.solver import EquilibriumError, EquilibriumSolver
from toros_fem.meshes import Pattern, mirrored, sew
from toros_fem.meshes.snap import snapped
from toros_fem.meshes.transfer import make_transfer
from toros_fem.products.tubes.tube import TubeConfig, plain_tube

Floats = npt.NDArray[np.float64]
Row = dict[str, Any]

RULES = ("snapped", "centroid", "covered")
EDGES = (1.5e-3, 1.06e-3, 0.75e-3, 0.53e-3)
# Points in each triangle from which "covered" is measured: those of a grid with so many rows.
ROWS = 10


@dataclass(frozen=True)
class Family:
    """Parallel lines: their number around the tube, angle to the axis, and width in m."""

    lines: int
    degrees: float
    width: float


@dataclass(frozen=True)
class Net:
    """Families of lines on the tube, a pressure in Pa, and symmetry planes of the net."""

    families: tuple[Family, ...]
    pressure: float
    planes: tuple[int, ...]

    @property
    def thinnest(self) -> float:
        """Width of the thinnest lines in m."""
        return min(family.width for family in self.families)


NETS = {
    "contract-12": Net((Family(12, 30, 0.75e-3), Family(12, -30, 0.75e-3)), 10e3, (1,)),
    "contract-8": Net((Family(8, 30, 1.1e-3), Family(8, -30, 1.1e-3)), 10e3, (1,)),
    "twist": Net((Family(8, -60, 0.8e-3), Family(2, -6, 4e-3)), 15e3, ()),
}


def wall_lines(pattern: Pattern, net: Net) -> BaseGeometry:
    """Return the lines on a tube's wall, or on the half of it that a pattern has."""
    corners = pattern.corners[pattern.cells_of("wall")]
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    around = high[0]  # the half tube's wall lies where it does in the whole
    beyond = np.array([-0.1, 1.1]) * high[1]
    strips = []
    for family in net.families:
        angle = np.radians(family.degrees)
        across = np.array([np.cos(angle), -np.sin(angle)]) * family.width / 2
        wound = int(np.ceil(abs(np.tan(angle)) * high[1] / around)) + 1
        for k in range(-wound * family.lines, (wound + 1) * family.lines):
            at = k * around / family.lines + np.tan(angle) * beyond
            a, b = np.column_stack([at, beyond])
            strips.append(shapely.Polygon([a - across, b - across, b + across, a + across]))
    return shapely.intersection(shapely.union_all(strips), shapely.box(*low, *high))


def on_wall(pattern: Pattern, lines: BaseGeometry) -> list[BaseGeometry]:
    """Return the lines as the region of the wall, and nothing on the other panels."""
    return [lines if name == "wall" else shapely.Polygon() for name in pattern.panel_names]


def densities(pattern: Pattern, lines: BaseGeometry, rule: str) -> Floats:
    """Return the density of each triangle, (t,): lines on the wall, printed caps."""
    wall = pattern.panel_index("wall")
    if rule != "covered":
        found = printed_cells(pattern, on_wall(pattern, lines)).astype(np.float64)
    else:
        grid = np.array([(i, j) for i in range(ROWS) for j in range(ROWS - i)]) + 1 / 3
        at = np.column_stack([grid, ROWS - grid.sum(axis=1)]) / ROWS
        points = np.einsum("kc,tcx->tkx", at, pattern.corners)
        shapely.prepare(lines)
        found = shapely.contains_xy(lines, points[..., 0], points[..., 1]).mean(axis=1)
    return np.where(pattern.panel == wall, found, 1.0)


def converge(name: str, rule: str, mesh: str, edges: Sequence[float]) -> Iterator[Row]:
    """Simulate one net on meshes of falling edge length in m; yield a row for each."""
    net = NETS[name]
    before: tuple[Pattern, Floats] | None = None
    for edge in edges:
        config = TubeConfig(edge_length=edge, mesh=mesh)
        pattern, supports, _ = plain_tube(MPI.COMM_SELF, config, net.planes)
        lines = wall_lines(pattern, net)
        begin = time.process_time()
        if rule == "snapped":
            pattern = snapped(MPI.COMM_SELF, pattern, on_wall(pattern, lines))
        density, wall = densities(pattern, lines, rule), pattern.cells_of("wall")
        row: Row = {
            "net": name,
            "rule": rule,
            "mesh": mesh,
            "edge_mm": round(1e3 * edge, 6),
            "edges_across": net.thinnest / edge,
            "triangles": len(density),
            "printed_over_drawn": float(pattern.areas[wall] @ density[wall] / lines.area),
        }
        skin = sew(MPI.COMM_SELF, pattern)
        solver = EquilibriumSolver(skin, config.composite, supports)
        start = None
        if before is not None:
            start = solver.start_at(make_transfer(before[0], pattern).positions(before[1]))
        ready = time.process_time()
        try:
            found = solver.solve(density[skin.owned_cells], net.pressure, start=start)
        except EquilibriumError as caught:
            yield {**row, "twist_deg": None, "shortening_percent": None, "reason": str(caught)}
            continue
        end = time.process_time()
        positions = skin.gather_vertices(found.positions)
        before = pattern, positions
        whole = mirrored(pattern, net.planes)
        shape = whole.at_vertices(positions)
        yield {
            **row,
            "twist_deg": float(np.degrees(twist_angle(whole.pattern, shape))),
            "shortening_percent": 100 * shortening(whole.pattern, shape),
            "warm": start is not None,
            "newton_steps": found.steps,
            "factorisations": found.factorisations,
            "setup_seconds": ready - begin,
            "seconds": end - ready,
        }


def main() -> None:
    """Print the table that the command line specifies."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="two coarse meshes of one net")
    parser.add_argument("--nets", nargs="+", choices=NETS, default=list(NETS))
    parser.add_argument("--rules", nargs="+", choices=RULES, default=list(RULES))
    parser.add_argument("--mesh", choices=("unstructured", "structured"), default="unstructured")
    parser.add_argument("--edges", nargs="+", type=float, default=EDGES, help="falling, in m")
    parser.add_argument("--json", type=Path, help="file for the rows")
    options = parser.parse_args()
    nets, edges = options.nets, options.edges
    if options.quick:
        nets, edges = ["contract-8"], (2.8e-3, 2e-3)
    rows = []
    print(
        "net          rule      edge   across  triangles  printed    twist  shorter  steps      s"
    )
    for net in nets:
        for rule in options.rules:
            for row in converge(net, rule, options.mesh, edges):
                rows.append(row)
                _print(row)
                if options.json:
                    options.json.write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")


def _print(row: Row) -> None:
    start = (
        f"{row['net']:12} {row['rule']:9} {row['edge_mm']:4.2f} {row['edges_across']:8.2f} "
        f"{row['triangles']:10} {row['printed_over_drawn']:8.3f} "
    )
    if row["twist_deg"] is None:
        print(start, row["reason"])
        return
    print(
        start + f"{row['twist_deg']:7.1f}° {row['shortening_percent']:6.2f} % "
        f"{row['newton_steps']:5} {row['seconds']:6.1f}",
        flush=True,
    )


if __name__ == "__main__":
    main()
