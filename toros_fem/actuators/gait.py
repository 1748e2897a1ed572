"""A walker with several chambers in a quasi-static cycle of pressures, and its stride."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from shapely.geometry.base import BaseGeometry

from toros_fem._types import Bools, Floats
from toros_fem._validate import require_between, require_count
from toros_fem.actuators.legs import tip_positions
from toros_fem.analysis.trace_point import TracePoint
from toros_fem.errors import ParameterError
from toros_fem.frames.record import write_path
from toros_fem.frames.shown_skin import ShownSkin
from toros_fem.meshes.cut_triangles import cut_triangles
from toros_fem.meshes.pattern import Pattern
from toros_fem.objectives.rotation import best_rotation
from toros_fem.output.files import write_json, write_table
from toros_fem.output.writer import if_plotting, write_together


@dataclass(frozen=True, eq=False)
class Gait:
    """One cycle of pressures.

    Attributes:
        names: Names of the chambers.
        phases: Fraction of the full pressure in each chamber at the end of each phase, (p, k). The
            cycle starts where the last phase ends.
        steps: Number of equilibria in each phase.
        feet: Chamber of each foot's leg, (f,).
        grip_fraction: A foot grips the ground while its leg has at least this fraction of the full
            pressure, since the leg is then bent.

    Raises:
        ParameterError: The phases do not fit the chambers, or there is a step at which no foot
            grips the ground.
    """

    names: tuple[str, ...]
    phases: Floats
    steps: int
    feet: tuple[int, ...]
    grip_fraction: float = 0.9

    def __post_init__(self) -> None:
        require_count(1, steps=self.steps)
        require_between(0.0, 1.0, grip_fraction=self.grip_fraction)
        if self.phases.ndim != 2 or self.phases.shape[1] != len(self.names):
            raise ParameterError(
                f"phases has shape {self.phases.shape}; with chambers {self.names} it must be "
                f"(…, {len(self.names)})."
            )
        if not self.gripping.any(axis=1).all():
            row = int(np.flatnonzero(~self.gripping.any(axis=1))[0])
            raise ParameterError(
                f"no foot grips the ground at step {row} of the cycle: all legs are below "
                f"grip_fraction = {self.grip_fraction:g} of the full pressure there. Keep one leg "
                "bent at all times."
            )

    @property
    def gripping(self) -> Bools:
        """Which feet grip the ground at each equilibrium, (rows, f)."""
        return np.asarray(self.pressure_fractions[:, list(self.feet)] >= self.grip_fraction)

    @property
    def pressure_fractions(self) -> Floats:
        """Fraction of the full pressure in each chamber over the whole cycle, (rows, k)."""
        ends = np.concatenate([self.phases[-1:], self.phases])
        progress = np.arange(1, self.steps + 1)[:, None] / self.steps
        rows = [a + progress * (b - a) for a, b in pairwise(ends)]
        return np.concatenate([ends[:1], *rows])


def walking_positions(
    gait: Gait,
    pattern: Pattern,
    points: Sequence[TracePoint],
    directions: Floats,
    root: float,
) -> tuple[list[Floats], Floats]:
    """Return the robot's positions on the ground: upright, its gripping feet at rest.

    Ground and weight are not modelled. The body is rotated to its assembled orientation, as well
    as a rotation can. z = 0 is the mean height of the feet with bent legs. Feet that grip before
    and after a step are fixed to the ground, on average along x, and all others slide freely.
    Where no foot does, the body stays where it is.

    Args:
        gait: The cycle.
        pattern: The whole robot.
        points: Its equilibria, one for each row of `gait.pressure_fractions`, or for the first of
            them.
        directions: Unit vectors along the legs, (f, 2).
        root: Distance from the centre where the legs begin, in m.

    Returns:
        Positions of all vertices at each equilibrium, (n, 3), and of the feet, (rows, f, 3), in m.
    """
    body = np.flatnonzero((pattern.points[:, :2] @ directions.T <= root).all(axis=1))
    grip = gait.gripping
    shapes: list[Floats] = []
    feet: list[Floats] = []
    ahead = 0.0
    for k, point in enumerate(points):
        middle = point.positions[body].mean(axis=0)
        turn = best_rotation(pattern.points[body], point.positions[body])
        shape = (point.positions - middle) @ turn
        foot = tip_positions(pattern, shape, directions)
        both = grip[k] & grip[k - 1]
        if k > 0 and both.any():
            ahead = (feet[-1] - foot)[both, 0].mean()
        shift = np.array([ahead, 0.0, -foot[grip[k], 2].mean()])
        shapes.append(shape + shift)
        feet.append(foot + shift)
    return shapes, np.array(feet)


def write_gait(
    comm: MPI.Comm,
    folder: Path,
    gait: Gait,
    pattern: Pattern,
    points: Sequence[TracePoint],
    directions: Floats,
    root: float,
    regions: Sequence[BaseGeometry],
    figures: Mapping[str, Any],
    measured: tuple[str, float] | None = None,
) -> dict[str, Any]:
    """Write table, pictures and figures of a cycle and return the figures (collective).

    Args:
        comm: Communicator.
        folder: Output folder, which exists.
        gait: The cycle.
        pattern: The whole robot.
        points: Its equilibria, one for each row of `gait.pressure_fractions`, or for the first of
            them if the cycle is not complete; then there is no stride.
        directions: Unit vectors along the legs, (f, 2).
        root: Distance from the centre where the legs begin, in m.
        regions: Print on each of its panels, polygons in m.
        figures: Further entries of gait.json.
        measured: A measured stride in m, drawn beside that of the cycle, after who measured it;
            None for none.

    Raises:
        OutputError: A file cannot be written.
    """
    shapes, feet = walking_positions(gait, pattern, points, directions, root)
    complete = len(points) == len(gait.pressure_fractions)
    stride = float((feet[-1] - feet[0])[:, 0].mean()) if complete else None
    found = {
        **figures,
        "stride_mm": stride and 1e3 * stride,
        "measured_stride_mm": measured and 1e3 * measured[1],
        "foot_lift_mm": 1e3 * float(feet[:, :, 2].max()),
        "newton_steps": sum(point.result.steps for point in points),
        "equilibria": len(points),
    }

    def write() -> None:
        rows = []
        for point, places in zip(points, feet, strict=True):
            row = {f"{n}_pa": p for n, p in zip(gait.names, point.result.pressures, strict=True)}
            for k, foot in enumerate(places):
                row |= {f"foot_{k}_{axis}_m": v for axis, v in zip("xyz", foot, strict=True)}
            rows.append({**row, **point.metrics})
        write_table(folder / "gait.csv", rows)
        write_json(folder / "gait.json", found)
        skin = ShownSkin(pattern, regions=regions)
        write_path(folder, "gait", skin, points, shapes=shapes, chambers=gait.names)
        shown = []
        for number, k in enumerate(range(0, len(points), gait.steps)):
            fractions = zip(gait.names, gait.pressure_fractions[k], strict=True)
            full = [name for name, fraction in fractions if fraction >= gait.grip_fraction]
            shown.append((f"{number}: {', '.join(full) or 'none'}", shapes[k]))

        def draw() -> None:
            from toros_fem.output.curve_plot import plot_tracks
            from toros_fem.output.shape_plot import plot_shapes

            plot_shapes(
                folder / "gait.png",
                pattern.triangles,
                shown,
                np.zeros(len(pattern.triangles)),
                view=(15.0, 15.0),
                columns=4,
                printed=cut_triangles(pattern, regions),
            )
            plot_tracks(folder / "tracks.png", feet, gait.steps, stride, measured)

        if_plotting(draw)

    write_together(comm, folder, write)
    return found
