"""A walker with several chambers through a cycle of pressures, quasi-static; how far it gets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from toros_fem._types import Floats
from toros_fem.actuators.limb import tips
from toros_fem.analysis.pressure_path import PressurePathPoint
from toros_fem.errors import ParameterError
from toros_fem.meshes.pattern import Pattern
from toros_fem.objectives.rotation import best_rotation
from toros_fem.output.files import write_json, write_table
from toros_fem.output.writer import if_plotting, write_together


@dataclass(frozen=True, eq=False)
class Gait:
    """One cycle.

    Attributes:
        names: Chambers.
        phases: Share of the full pressure in each chamber at the end of each phase, (p, k); the
            cycle begins where the last phase ends.
        steps: Equilibria a phase.
        feet: Chamber that each foot belongs to, by its direction's row, (f,).
        grips: Share of the full pressure from which on a foot's leg is bent and grips the ground.
    """

    names: tuple[str, ...]
    phases: Floats
    steps: int
    feet: tuple[int, ...]
    grips: float = 0.9

    def __post_init__(self) -> None:
        if self.phases.ndim != 2 or self.phases.shape[1] != len(self.names):
            raise ParameterError(
                f"phases has shape {self.phases.shape}; with chambers {self.names} it must be "
                f"(…, {len(self.names)})."
            )
        if not self.gripping.any(axis=1).all():
            row = int(np.flatnonzero(~self.gripping.any(axis=1))[0])
            raise ParameterError(
                f"no foot grips the ground at step {row} of the cycle: all legs are under "
                f"{self.grips:g} of the full pressure there. Keep one bent at all times."
            )

    @property
    def gripping(self) -> npt.NDArray[np.bool_]:
        """Which feet grip the ground, row by row as `shares`, (rows, f)."""
        return np.asarray(self.shares[:, list(self.feet)] >= self.grips)

    @property
    def shares(self) -> Floats:
        """Share of the full pressure in each chamber, row by row, from the start to the start."""
        ends = np.concatenate([self.phases[-1:], self.phases])
        parts = np.arange(1, self.steps + 1)[:, None] / self.steps
        rows = [a + parts * (b - a) for a, b in pairwise(ends)]
        return np.concatenate([ends[:1], *rows])


def placed(
    gait: Gait,
    pattern: Pattern,
    points: Sequence[PressurePathPoint],
    directions: Floats,
    root: float,
) -> tuple[list[Floats], Floats]:
    """The robot on its way: upright, on the feet that grip, these staying where they are.

    Nothing is known of the ground or the weight. The body is turned to how it is assembled, as
    well as a rotation can; z = 0 is the mean height of feet whose legs are bent; feet whose legs
    are bent before and after a step are taken as fixed to the ground, on average along x, and all
    others as sliding freely. Where there are none, the body stays above where it was.

    Args:
        gait: The cycle.
        pattern: The whole robot.
        points: Its equilibria, one for each row of `gait.shares`, or for the first of them.
        directions: Unit vectors along the legs, (f, 2).
        root: Distance from the centre where legs begin, in m.

    Returns:
        Positions of all vertices, (n, 3), and the places of the feet, (rows, f, 3), in m.
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
        foot = tips(pattern, shape, directions)
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
    points: Sequence[PressurePathPoint],
    directions: Floats,
    root: float,
    density: Floats,
    metrics: Mapping[str, Any],
) -> dict[str, Any]:
    """Write table, pictures and figures of a cycle (collective); the figures are returned.

    Args:
        comm: Communicator.
        folder: Output folder, which exists.
        gait: The cycle.
        pattern: The whole robot.
        points: Its equilibria, one for each row of `gait.shares`, or for the first of them where
            the cycle came to an end; then there is no stride.
        directions: Unit vectors along the legs, (f, 2).
        root: Distance from the centre where legs begin, in m.
        density: Density of all triangles to colour by, (t,).
        figures: What else to write to gait.json.

    Raises:
        OutputError: A file cannot be written.
    """
    shapes, feet = placed(gait, pattern, points, directions, root)
    whole = len(points) == len(gait.shares)
    found = {
        **metrics,
        "stride_mm": 1e3 * float((feet[-1] - feet[0])[:, 0].mean()) if whole else None,
        "foot_lift_mm": 1e3 * float(feet[:, :, 2].max()),
        "newton_steps": sum(point.result.steps for point in points),
        "equilibria": len(points),
    }

    def write() -> None:
        rows = []
        for point, place in zip(points, feet, strict=True):
            row = {f"{n}_pa": p for n, p in zip(gait.names, point.result.pressures, strict=True)}
            for k, foot in enumerate(place):
                row |= {f"foot_{k}_{axis}_m": v for axis, v in zip("xyz", foot, strict=True)}
            rows.append({**row, **point.metrics})
        write_table(folder / "gait.csv", rows)
        write_json(folder / "gait.json", found)
        ends = range(0, len(points), gait.steps)
        shown = []
        for number, k in enumerate(ends):
            full = [n for n, s in zip(gait.names, gait.shares[k], strict=True) if s >= gait.grips]
            shown.append((f"{number}: {', '.join(full) or 'none'}", shapes[k]))

        def draw() -> None:
            from toros_fem.output.comparison_plot import plot_shapes, plot_tracks

            view = (15.0, 15.0)
            plot_shapes(folder / "gait.png", pattern.triangles, shown, density, view, columns=4)
            plot_tracks(folder / "tracks.png", feet, gait.steps)

        if_plotting(draw)

    write_together(comm, folder, write)
    return found
