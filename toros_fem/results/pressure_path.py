"""Result of a path of pressures, and its files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.base.files import guarded, write_table
from toros_fem.base.scene import Scene
from toros_fem.materials.sheet import Composite
from toros_fem.measures.figures import TOLERANCE, Figure
from toros_fem.measures.metrics import Metric
from toros_fem.mechanics.paths.trace_point import TracePoint
from toros_fem.meshes.mirror import Mirrored
from toros_fem.meshes.pattern import Pattern
from toros_fem.results.frames.record import write_path
from toros_fem.results.frames.shown_skin import ShownSkin
from toros_fem.results.result import RunResult, state_figures
from toros_fem.results.runs.warnings import notes_at
from toros_fem.results.writer import wrinkles_of, write_skin_fields


@dataclass(frozen=True, eq=False, repr=False)
class PathResult(RunResult):
    """A skin followed over the pressure: what `write_pressure_path` writes.

    Attributes:
        density: Density of all triangles, (t,), to colour by.
        whole: The whole skin that the pattern is a part of, by `meshes.mirrored`: volumes, fields
            and pictures are its own.
        composite: Materials; those of a tension field add the wrinkles of the last state to the
            fields and pictures.
        tolerance: Part of its target that a metric may be off by and count as reached.
        intervals: Half-width of the interval of each metric at the last point, by key, if known.
        told: Values of metrics there that are told in place of the last point's, by key.
    """

    pattern: Pattern
    points: Sequence[TracePoint]
    density: Floats
    metrics: Sequence[Metric]
    whole: Mirrored
    composite: Composite | None = None
    config: Scene | None = None
    seconds: Mapping[str, float] = field(default_factory=dict)
    tolerance: float = TOLERANCE
    intervals: Mapping[str, float] = field(default_factory=dict)
    told: Mapping[str, float] = field(default_factory=dict)

    @property
    def figures(self) -> tuple[Figure, ...]:
        """Metrics, pressure and volume at the last point."""
        last = self.points[-1]
        told = {**last.metrics, **self.told}
        return (
            *(
                m.figure(told[m.key], self.intervals.get(m.key), self.tolerance)
                for m in self.metrics
            ),
            *state_figures(last.result.pressure, last.result, self.whole.parts),
        )

    @property
    def notes(self) -> list[str]:
        """What is not as usual at its points."""
        return notes_at((p.result.pressure, p.result.condition.sentences) for p in self.points)

    def entries(self) -> dict[str, Any]:
        """Return inputs and cost."""
        return {
            "newton_steps": sum(point.result.steps for point in self.points),
            "triangles": len(self.pattern.panel),
            "parts_by_symmetry": self.whole.parts,
            "inputs": None if self.config is None else self.config.as_dict(),
            "seconds": dict(self.seconds),
        }

    def description(self) -> str:
        """Return the metrics and the pressure in a sentence."""
        pressure = self.points[-1].result.pressure
        values = [f"{f.name} {f.shown}" for f in self.figures[: len(self.metrics)]]
        return f"{', '.join(values)} at {pressure / 1e3:.2f} kPa"


def write_pressure_path(comm: MPI.Comm, folder: str | Path, found: PathResult) -> None:
    """Write table, frames and fields of a pressure path into a folder (collective).

    Raises:
        OutputError: A file cannot be written; on all ranks.
    """
    folder, points, whole = Path(folder), found.points, found.whole
    skin, density, last = whole.pattern, whole.at_cells(found.density), points[-1]
    shape = whole.at_vertices(last.positions)
    rows = [
        {
            "pressure_pa": point.result.pressure,
            "volume_m3": whole.parts * point.result.volume,
            "stretch_use": point.result.stretch_use,
            **point.metrics,
        }
        for point in points
    ]
    folds = wrinkles_of(skin, found.composite, density, shape)

    def write() -> None:
        write_table(folder / "curve.csv", rows)
        write_path(folder, "pressure", ShownSkin(skin), points, whole, density)
        write_skin_fields(folder, skin, shape, {"density": density}, folds)

    guarded(comm, folder, write)
