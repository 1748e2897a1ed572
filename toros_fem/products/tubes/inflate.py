"""A tube without reinforcement that swells and lengthens, then saturates (paper Fig. 8a)."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import In, Modulus, Table, key
from toros_fem.base.scene import Scene
from toros_fem.measures.metrics import Metric, shortening, swelling
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.trace import trace
from toros_fem.meshes import mirrored, sew
from toros_fem.products.tables.sheets import SkinSheets
from toros_fem.products.tubes.tube import SymmetricTube, plain_planes, plain_tube
from toros_fem.results.console import print_step
from toros_fem.results.writer import write_pressure_path

METRICS = (
    Metric("radius", "percent", 100.0, lambda of, x: 100 * swelling(of, x)),
    Metric("length", "percent", 100.0, lambda of, x: 100 * (1 - shortening(of, x))),
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

    def coarse(self) -> Self:
        """Return the same path on a coarse mesh with fewer pressures."""
        return self.updated(edge_length=2.85e-3, levels=20)

    def run_simulation(
        self,
        comm: MPI.Comm,
        output: Path | str,
        files: Mapping[str, Path] | None = None,
        *,
        verbose: bool = False,
    ) -> dict[str, Any]:
        """Inflate the tube and write curve, fields and pictures; return the summary (collective).

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
        radius = np.array([point.metrics["radius_percent"] for point in points])
        half = int(np.argmin(np.abs(levels - self.pressure.pressure)))
        figures = {
            "radius_percent": radius[-1],
            "length_percent": points[-1].metrics["length_percent"],
            "radius_percent_at_pressure": radius[half],
            "length_percent_at_pressure": points[half].metrics["length_percent"],
            "growth_above_over_below": (radius[-1] - radius[half]) / (radius[half] - radius[0]),
            "steepest_kpa": 1e-3 * float(levels[1:][np.argmax(np.diff(radius))]),
        }
        return write_pressure_path(
            comm, output, pattern, points, density, METRICS,
            whole=mirrored(pattern, planes),
            composite=self.material.composite, config=self,
            figures=figures, seconds={"total": time.perf_counter() - begin},
        )  # fmt: skip

    def told_simulation(self, summary: Mapping[str, Any]) -> str:
        """Return the result in words."""
        inputs = summary["inputs"]
        return (
            f"radius {summary['radius_percent_at_pressure']:.0f} % and length "
            f"{summary['length_percent_at_pressure']:.0f} % at {inputs['pressure'] / 1e3:g} kPa, "
            f"{summary['radius_percent']:.0f} % and {summary['length_percent']:.0f} % at "
            f"{inputs['highest_pressure'] / 1e3:g} kPa: above, the radius grows by "
            f"{100 * summary['growth_above_over_below']:.0f} % of its growth below"
        )
