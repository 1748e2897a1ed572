"""A tube without reinforcement that swells and lengthens, then saturates (paper Fig. 8a)."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import In, Modulus, Table, key
from toros_fem.base.scene import Scene
from toros_fem.base.validation import Floats
from toros_fem.measures.figures import Figure
from toros_fem.measures.metrics import Metric, shortening, swelling
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.trace import trace
from toros_fem.mechanics.paths.trace_point import TracePoint
from toros_fem.meshes.pattern import mirrored
from toros_fem.meshes.skin import sew
from toros_fem.meshes.triangles import expected_triangles, require_affordable
from toros_fem.products.actuators.cost import Cost
from toros_fem.products.common.plausibility import Group, Inflated, with_lengths
from toros_fem.products.common.tables import SkinSheets
from toros_fem.products.tubes import SymmetricTube, plain_planes, plain_tube
from toros_fem.results.reporter import print_step, with_progress
from toros_fem.results.result import write_summary
from toros_fem.results.writer import PathResult, draw_pictures, write_pressure_path

METRICS = (
    Metric("radius", "percent", None, lambda of, x: 100 * swelling(of, x)),
    Metric("length", "percent", None, lambda of, x: 100 * (1 - shortening(of, x))),
)
# First pressure of a tension field over the last one.
SLACK = 0.01
# Edges around the tube of a probe, at least, and along it.
PROBE_AROUND, PROBE_ALONG = 36, 6


class Curve(Table):
    """Pressure.

    Raises:
        ParameterError: The curve ends below the pressure.
    """

    pressure: Modulus = key(10e3, "the tube counts as saturated above")
    highest_pressure: Modulus = key(20e3, "last pressure")
    levels: Annotated[int, In(at_least=2)] = key(40, "number of equal steps to the last pressure")

    def __post_init__(self) -> None:
        if not self.pressure < self.highest_pressure:
            raise ParameterError(
                f"pressure = {self.pressure:g} Pa must be below highest_pressure = "
                f"{self.highest_pressure:g} Pa, where the curve ends. Raise highest_pressure.",
                "pressure",
            )


class InflateScene(Scene):
    """The inflated tube."""

    skin: SymmetricTube = SymmetricTube()
    material: SkinSheets = SkinSheets()
    pressure: Curve = Curve()

    KIND: ClassVar = "inflate"
    COARSE: ClassVar = {"edge_length": 2.0, "levels": 0.5}
    FEW: ClassVar = ("length", "diameter", "edge_length", "pressure", "highest_pressure", "levels")

    def groups(self) -> Iterator[Group]:
        """Yield the dimensionless groups of the scene."""
        highest = self.pressure.highest_pressure
        sheet, sizes = self.material.composite, self.skin
        skin = Inflated(sheet, highest, sizes.diameter / 2, "highest_pressure")
        own = [
            skin.slenderness("length", sizes.length),
            skin.load("pressure", self.pressure.pressure),
            Group("edges", "edge_length", skin.girth / sizes.edge_length),
        ]
        return with_lengths(self, skin.girth, [*own, *skin.groups()])

    @property
    def planes(self) -> tuple[int, ...]:
        """Symmetry planes that the tube is cut at."""
        return () if self.skin.whole else plain_planes(self.material.seams)

    @property
    def pressures(self) -> Floats:
        """The pressures of the path in Pa, with the one at which the tube counts as saturated."""
        # A tension field without pressure is slack, and has no shape.
        asked = self.pressure
        first = 0.0 if self.material.wrinkling is None else SLACK * asked.highest_pressure
        levels = np.linspace(first, asked.highest_pressure, asked.levels + 1)
        if not np.isclose(levels, asked.pressure, rtol=1e-9, atol=0.0).any():
            levels = np.sort(np.append(levels, asked.pressure))
        return levels.astype(np.float64)

    def solver(self, comm: MPI.Comm, *, verbose: bool = False) -> tuple[EquilibriumSolver, Floats]:
        """Return the solver of the tube, and the density of all triangles, (t,) (collective)."""
        pattern, supports, density = plain_tube(
            comm, self.skin, self.planes, seams=self.material.seams
        )
        log = print_step(comm) if verbose else None
        skin = sew(comm, pattern)
        return EquilibriumSolver(skin, self.material.composite, supports, log=log), density

    def run_simulation(
        self,
        comm: MPI.Comm,
        output: Path | str,
        files: Mapping[str, Path] | None = None,
        *,
        verbose: bool = False,
    ) -> InflationResult:
        """Inflate the tube and write curve, fields and pictures; it takes no files (collective)."""
        scene = self.of_first_rank(comm)
        begin, planes = time.perf_counter(), scene.planes
        solver, density = scene.solver(comm, verbose=verbose)
        owned, pattern = density[solver.skin.owned_cells], solver.skin.pattern
        metrics = [metric.of_whole(planes) for metric in METRICS]
        path = trace(solver, owned, [*map(float, scene.pressures)], metrics)
        found = InflationResult(
            pattern,
            list(with_progress(comm, path, len(scene.pressures), "pressure")),
            density,
            METRICS,
            mirrored(pattern, planes),
            scene.material.composite,
            scene,
            {"total": time.perf_counter() - begin},
            saturation=scene.pressure.pressure,
        )
        write_pressure_path(comm, output, found)
        write_summary(comm, output, found)
        draw_pictures(comm, output)
        return found

    def expected_cost(self, comm: MPI.Comm) -> Cost:
        """Return the cost of the curve.

        Raises:
            MeshSizeError: The mesh would have more triangles than the limit.
        """
        sizes, edge = self.skin, self.skin.edge_length
        around = np.pi * sizes.diameter
        area = around * (sizes.length + sizes.diameter / 2) / 2 ** len(self.planes)
        require_affordable(area, edge)
        triangles = round(expected_triangles(area, edge))
        # A closed surface has half as many vertices as triangles, and three edges for two of them.
        unknowns = round((3.0 if self.material.bending == "midedge" else 1.5) * triangles)
        return Cost(triangles, triangles, unknowns, comm.size)


@dataclass(frozen=True, eq=False, repr=False)
class InflationResult(PathResult):
    """A tube that swells, and the pressure in Pa from which on it counts as saturated."""

    saturation: float = 0.0

    @property
    def half(self) -> TracePoint:
        """The equilibrium at that pressure."""
        return min(self.points, key=lambda point: abs(point.result.pressure - self.saturation))

    @property
    def growth_ratio(self) -> float:
        """Growth of the radius above that pressure, over its growth below."""
        states = (self.points[0], self.half, self.points[-1])
        first, half, last = (state.metrics["radius_percent"] for state in states)
        return (last - half) / (half - first)

    @property
    def figures(self) -> tuple[Figure, ...]:
        """Radius and length at the highest pressure, and at that of the saturation."""
        at = self.half.metrics
        saturated = (Figure(f"{one.name}_when_saturated", one.unit, at[one.key]) for one in METRICS)
        return (*super().figures, *saturated)

    def entries(self) -> dict[str, Any]:
        """Return how the radius grows, inputs and cost."""
        radius = [point.metrics["radius_percent"] for point in self.points]
        steepest = self.points[1 + int(np.argmax(np.diff(radius)))].result.pressure
        growth = {"growth_above_over_below": self.growth_ratio, "steepest_pa": steepest}
        return {**growth, **super().entries()}

    def description(self) -> str:
        """Return it in a sentence."""
        (radius, length, at), (last_radius, last_length, end) = (
            (*(state.metrics[one.key] for one in METRICS), state.result.pressure / 1e3)
            for state in (self.half, self.points[-1])
        )
        return (
            f"radius {radius:.0f} % and length {length:.0f} % at {at:g} kPa, {last_radius:.0f} % "
            f"and {last_length:.0f} % at {end:g} kPa: above, the radius grows by "
            f"{100 * self.growth_ratio:.0f} % of its growth below"
        )
