"""What lines off by 0.1 and 0.2 mm do to a bend: ways to simulate it, on finer and finer meshes.

    python demos/bend.py --coarse --output output/bend
    python benchmarks/print_widths.py output/bend
    python benchmarks/print_widths.py output/bend --divide 1 2 4 --only border

The ways: *border* moves the vertices on the print's borders, as `toros tolerance` does. *Centroid*
prints a triangle if its centroid is, *covered* takes the covered fraction of each triangle as its
density, each on the design's own mesh. *Anew* snaps another mesh onto each print. *By density* is
to first order, by the area that the print wins in plain triangles or loses in printed ones.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import shapely
from mpi4py import MPI
from shapely.geometry.base import BaseGeometry

from toros_fem import ShapeDesign, ToleranceConfig
from toros_fem.making.print.print_file import StoredPrint, read_print_polygons
from toros_fem.making.print.printability import printed_cells
from toros_fem.making.print.regions import part_regions, regions_on
from toros_fem.meshes import Pattern, mirrored
from toros_fem.meshes.topology import edges_of
from toros_fem.products.actuators.case import ActuatorCase
from toros_fem.products.actuators.problem import actuator_problem
from toros_fem.products.tolerance.simulated import Drawn, simulated_tolerances
from toros_fem.products.tolerance.worn import offset_print
from toros_fem.products.tubes import bend
from toros_fem.products.tubes.tube import coarse_tube

COMM = MPI.COMM_SELF
WIDTHS = (-2e-4, -1e-4, 1e-4, 2e-4)
WAYS = ("border", "centroid", "covered", "anew", "density")
ANGLE = "angle_deg"
Regions = list[BaseGeometry]


class Bend:
    """The print of a bend on a mesh with shorter edges."""

    def __init__(self, stored: StoredPrint, divide: float) -> None:
        base = coarse_tube(bend.BendConfig())
        self.config = base.updated(edge_length=base.edge_length / divide)
        self.stored, self.case = stored, bend.case(COMM, self.config)
        self.drawn = self.regions(0.0)

    def regions(self, width: float) -> Regions:
        """Return the print on the part, with lines wider by a width in m."""
        stored, part = self.stored, self.case.pattern
        made = offset_print(stored.pattern, stored.regions, width / 2, stored.limits.resolution)
        whole = mirrored(part, self.case.symmetry).pattern
        return part_regions(part, regions_on(stored.pattern, made, whole))

    def problem(self, case: ActuatorCase) -> ShapeDesign:
        """Return the design problem of a case."""
        return actuator_problem(COMM, case, self.config)

    def by_border(self) -> list[float]:
        """Return the changes of the angle by widths, and to first order by 0.1 mm, in degrees."""
        begin = time.perf_counter()
        following = self.case.following(COMM, self.drawn)
        stored = self.stored
        found = simulated_tolerances(
            self.problem(following),
            lambda pattern: self.problem(following.on(pattern)),
            Drawn(self.drawn, (stored.pattern, stored.regions), stored.limits, None, None),
            ToleranceConfig(modulus=None, thickness=None, pressure_change=None),
            begin=begin,
        )
        changes = [found.change(v, ANGLE) or np.nan for v in found.variants]
        return [*changes, found.change(found.variants[2], ANGLE, predicted=True) or np.nan]

    def by_triangles(self, density: Callable[[Pattern, Regions], np.ndarray]) -> list[float]:
        """Return the changes of the angle where densities of one mesh follow the print."""
        problem = self.problem(self.case)
        return self._changes(lambda width: (problem, self.regions(width)), density)

    def anew(self) -> list[float]:
        """Return the changes of the angle on meshes that are snapped onto each print."""

        def made(width: float) -> tuple[ShapeDesign, Regions]:
            regions = self.regions(width)
            return self.problem(self.case.following(COMM, regions)), regions

        return self._changes(made, binary)

    def by_density(self) -> dict[str, float]:
        """Return the first order by 0.1 mm, of plain and of printed triangles on the border."""
        problem = self.problem(self.case.following(COMM, self.drawn))
        pattern = problem.skin.pattern
        owned = problem.skin.owned_cells
        made = problem.simulate_binary(printed_cells(pattern, self.drawn)[owned])
        printed = problem.skin.gather_cells(made.projected) > 0.5
        edges = edges_of(pattern.flat_triangles)
        sides = edges.sides[edges.inner]
        between = printed[sides[:, 0]] != printed[sides[:, 1]]
        sides, ends = sides[between], edges.ends[edges.inner][between]
        length = np.linalg.norm(np.diff(pattern.flat_points[ends], axis=1)[:, 0], axis=1)
        changes = []
        for kind in (False, True):
            cell = sides[printed[sides] == kind]
            won = np.bincount(cell, length * 0.5e-4, minlength=len(printed))
            changes.append((won / pattern.areas)[owned])
        plain, inside = problem.metric_derivatives(made, changes)[ANGLE]
        return {"plain": float(plain), "printed": float(inside)}

    def _changes(
        self,
        made: Callable[[float], tuple[ShapeDesign, Regions]],
        density: Callable[[Pattern, Regions], np.ndarray],
    ) -> list[float]:
        angles = []
        for width in (0.0, *WIDTHS):
            problem, regions = made(width)
            values = density(problem.skin.pattern, regions)[problem.skin.owned_cells]
            found = problem.solver.solve(problem.with_passive(values), self.config.pressure)
            angles.append(problem.metrics_of(found)[ANGLE])
        return [angle - angles[0] for angle in angles[1:]]


def binary(pattern: Pattern, regions: Regions) -> np.ndarray:
    """1 in triangles whose centroid is printed."""
    return printed_cells(pattern, regions).astype(np.float64)


def covered(pattern: Pattern, regions: Regions) -> np.ndarray:
    """The covered fraction of each triangle."""
    found = np.zeros(len(pattern.panel))
    for panel, region in enumerate(regions):
        cells = np.flatnonzero(pattern.panel == panel)
        triangles = shapely.polygons(pattern.corners[cells])
        found[cells] = shapely.area(triangles & region) / shapely.area(triangles)
    return np.clip(found, 0, 1)


def main(words: Sequence[str] | None = None) -> None:
    """Print a line for each way and mesh."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path, help="folder of a bend by demos/bend.py --coarse")
    parser.add_argument("--divide", type=float, nargs="+", default=[1.0], help="of the edges")
    parser.add_argument("--only", nargs="+", choices=WAYS, default=WAYS, help="ways to simulate")
    given = parser.parse_args(words)
    stored = read_print_polygons(COMM, given.run)
    print("change of the angle in degrees by lines wider by −0.2, −0.1, +0.1, +0.2 mm")
    for divide in given.divide:
        made = Bend(stored, divide)
        ways: dict[str, Callable[[], object]] = {
            "border": made.by_border,
            "centroid": partial(made.by_triangles, binary),
            "covered": partial(made.by_triangles, covered),
            "anew": made.anew,
            "density": made.by_density,
        }
        for way in given.only:
            print(f"edges / {divide:g}, {way}: {ways[way]()}", flush=True)


if __name__ == "__main__":
    main()
