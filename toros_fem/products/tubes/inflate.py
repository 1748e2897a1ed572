"""A tube without reinforcement that swells and lengthens, then saturates (paper Fig. 8a)."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import In, Modulus, Table, key
from toros_fem.base.scene import Scene
from toros_fem.measures.figures import Figure
from toros_fem.measures.metrics import Metric, shortening, swelling
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.trace import trace
from toros_fem.mechanics.paths.trace_point import TracePoint
from toros_fem.meshes import mirrored, sew
from toros_fem.products.tables.sheets import SkinSheets
from toros_fem.products.tubes.tube import SymmetricTube, plain_planes, plain_tube
from toros_fem.results.console import print_step
from toros_fem.results.pressure_path import PathResult, write_pressure_path
from toros_fem.results.result import RunResult, write_summary

METRICS = (
    Metric("radius", "percent", None, lambda of, x: 100 * swelling(of, x)),
    Metric("length", "percent", None, lambda of, x: 100 * (1 - shortening(of, x))),
)
# First pressure of a tension field over the last one.
SLACK = 0.01


@dataclass(frozen=True)
class Curve(Table):
    """Pressure.

    Raises:
        ParameterError: The curve ends below the pressure.
    """

    pressure: Modulus = key(10e3, "the tube counts as saturated above")
    highest_pressure: Modulus = key(20e3, "last pressure")
    levels: Annotated[int, In(at_least=2)] = key(40, "number of equal steps to the last pressure")

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.pressure < self.highest_pressure:
            raise ParameterError(
                f"pressure = {self.pressure:g} Pa must be below highest_pressure = "
                f"{self.highest_pressure:g} Pa, where the curve ends. Raise highest_pressure.",
                "pressure",
            )


@dataclass(frozen=True)
class InflateScene(Scene):
    """The inflated tube."""

    skin: SymmetricTube = SymmetricTube()
    material: SkinSheets = SkinSheets()
    pressure: Curve = Curve()

    KIND: ClassVar[str] = "inflate"
    COARSE: ClassVar[Mapping[str, float]] = {"edge_length": 2.0, "levels": 0.5}
    FEW: ClassVar[tuple[str, ...]] = (
        "length",
        "diameter",
        "pressure",
        "highest_pressure",
        "levels",
    )

    @property
    def pressures(self) -> Floats:
        """The pressures of the path in Pa, with the one at which the tube counts as saturated."""
        # A tension field without pressure is slack, and has no shape.
        asked = self.pressure
        first = 0.0 if self.material.wrinkling is None else SLACK * asked.highest_pressure
        levels = np.linspace(first, asked.highest_pressure, asked.levels + 1)
        near = np.isclose(levels, asked.pressure, rtol=1e-9, atol=0.0)
        if near.any():
            return np.asarray(levels, dtype=np.float64)
        return np.sort(np.append(levels, asked.pressure)).astype(np.float64)

    def run_simulation(
        self,
        comm: MPI.Comm,
        output: Path | str,
        files: Mapping[str, Path] | None = None,
        *,
        verbose: bool = False,
    ) -> RunResult:
        """Inflate the tube and write curve, fields and pictures (collective).

        Args:
            comm: Communicator.
            output: Folder for the results.
            files: It takes none.
            verbose: Whether to print every Newton step.
        """
        begin, seams = time.perf_counter(), self.material.seams
        planes = () if self.skin.whole else plain_planes(seams)
        pattern, supports, density = plain_tube(comm, self.skin, planes, seams=seams)
        skin = sew(comm, pattern)
        log = print_step(comm) if verbose else None
        solver = EquilibriumSolver(skin, self.material.composite, supports, log=log)
        levels = self.pressures
        metrics = [metric.of_whole(planes) for metric in METRICS]
        points = list(trace(solver, density[skin.owned_cells], [*map(float, levels)], metrics))
        path = PathResult(
            pattern,
            points,
            density,
            METRICS,
            mirrored(pattern, planes),
            self.material.composite,
            self,
            {"total": time.perf_counter() - begin},
        )
        write_pressure_path(comm, output, path)
        found = InflationResult(path, self.pressure.pressure)
        write_summary(comm, output, found)
        return found


@dataclass(frozen=True, eq=False)
class InflationResult(RunResult):
    """A tube that swells, and a pressure in Pa at which it counts as saturated."""

    path: PathResult
    pressure: float

    @property
    def half(self) -> TracePoint:
        """The equilibrium at that pressure."""
        return min(self.path.points, key=lambda point: abs(point.result.pressure - self.pressure))

    @property
    def growth_ratio(self) -> float:
        """Growth of the radius above that pressure, over its growth below."""
        first, half, last = (
            point.metrics["radius_percent"]
            for point in (self.path.points[0], self.half, self.path.points[-1])
        )
        return (last - half) / (half - first)

    @property
    def figures(self) -> tuple[Figure, ...]:
        """Radius and length at the highest pressure, and at that of the saturation."""
        at = self.half.metrics
        names = ("radius", "length")
        return (
            *self.path.figures,
            *(Figure(f"{n}_when_saturated", "percent", at[f"{n}_percent"]) for n in names),
        )

    def entries(self) -> dict[str, Any]:
        """Return how the radius grows, inputs and cost."""
        points = self.path.points
        radius = [point.metrics["radius_percent"] for point in points]
        steepest = points[1 + int(np.argmax(np.diff(radius)))].result.pressure
        growth = {"growth_above_over_below": self.growth_ratio, "steepest_pa": steepest}
        return {**growth, **self.path.entries()}

    def sentence(self) -> str:
        """Return it in a sentence."""
        at, last = self.half, self.path.points[-1]
        return (
            f"radius {at.metrics['radius_percent']:.0f} % and length "
            f"{at.metrics['length_percent']:.0f} % at {at.result.pressure / 1e3:g} kPa, "
            f"{last.metrics['radius_percent']:.0f} % and {last.metrics['length_percent']:.0f} % at "
            f"{last.result.pressure / 1e3:g} kPa: above, the radius grows by "
            f"{100 * self.growth_ratio:.0f} % of its growth below"
        )
