"""A walker with several chambers through a cycle of pressures, quasi-static; how far it gets."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from toros_fem.errors import ParameterError
from toros_fem.io import write_json, write_table
from toros_fem.limb import tips
from toros_fem.meshes.pattern import Pattern
from toros_fem.path import PathPoint
from toros_fem.report import write_together

Floats = npt.NDArray[np.float64]


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
    grips: float = 0.5

    def __post_init__(self) -> None:
        if self.phases.ndim != 2 or self.phases.shape[1] != len(self.names):
            raise ParameterError(
                f"phases has shape {self.phases.shape}; with chambers {self.names} it must be "
                f"(…, {len(self.names)})."
            )

    @property
    def shares(self) -> Floats:
        """Share of the full pressure in each chamber, row by row, from the start to the start."""
        ends = np.concatenate([self.phases[-1:], self.phases])
        parts = np.arange(1, self.steps + 1)[:, None] / self.steps
        rows = [a + parts * (b - a) for a, b in pairwise(ends)]
        return np.concatenate([ends[:1], *rows])


def foot_tracks(
    gait: Gait, pattern: Pattern, points: Sequence[PathPoint], directions: Floats
) -> tuple[Floats, Floats]:
    """Tracks of feet and body along x, the feet that grip staying where they are.

    Nothing is known of the ground: feet whose legs are bent before and after a step are taken as
    fixed to it, on average, and all others as sliding freely.

    Args:
        gait: The cycle.
        pattern: The whole robot.
        points: Its equilibria, one for each row of `gait.shares`.
        directions: Unit vectors along the legs, (f, 2).

    Returns:
        Places of the feet, (rows, f, 3), and the x of the body, (rows,), in m.
    """
    feet = np.array([tips(pattern, point.positions, directions) for point in points])
    grip = gait.shares[:, list(gait.feet)] >= gait.grips
    body = np.zeros(len(points))
    for k in range(1, len(points)):
        both = grip[k] & grip[k - 1]
        slid = (feet[k] - feet[k - 1])[both, 0]
        body[k] = body[k - 1] - (slid.mean() if len(slid) else 0.0)
    feet[:, :, 0] += body[:, None]
    return feet, body


def write_gait(
    comm: MPI.Comm,
    folder: Path,
    gait: Gait,
    pattern: Pattern,
    points: Sequence[PathPoint],
    directions: Floats,
    density: Floats,
    figures: Mapping[str, Any],
) -> dict[str, Any]:
    """Write table, pictures and figures of a cycle (collective); the figures are returned.

    Args:
        comm: Communicator.
        folder: Output folder, which exists.
        gait: The cycle.
        pattern: The whole robot.
        points: Its equilibria, one for each row of `gait.shares`.
        directions: Unit vectors along the legs, (f, 2).
        density: Density of all triangles to colour by, (t,).
        figures: What else to write to gait.json.

    Raises:
        OutputError: A file cannot be written.
    """
    feet, body = foot_tracks(gait, pattern, points, directions)
    found = {
        **figures,
        "stride_mm": 1e3 * float(body[-1]),
        "foot_lift_mm": 1e3 * float(np.ptp(feet[:, :, 2], axis=0).max()),
        "newton_steps": sum(point.result.steps for point in points),
        "equilibria": len(points),
    }

    def write() -> None:
        rows = []
        for point, place, x in zip(points, feet, body, strict=True):
            row = {f"{n}_pa": p for n, p in zip(gait.names, point.result.pressures, strict=True)}
            for k, foot in enumerate(place):
                row |= {f"foot_{k}_{axis}_m": v for axis, v in zip("xyz", foot, strict=True)}
            rows.append({**row, "body_x_m": x, **point.figures})
        write_table(folder / "gait.csv", rows)
        write_json(folder / "gait.json", found)
        try:
            from toros_fem.comparison import plot_shapes, plot_tracks
        except ImportError as missing:
            print(f"no pictures: {missing}; pip install toros_fem[plot]", file=sys.stderr)
            return
        ends = range(0, len(points), gait.steps)
        shapes = []
        for number, k in enumerate(ends):
            full = ", ".join(
                n for n, s in zip(gait.names, gait.shares[k], strict=True) if s >= gait.grips
            )
            moved = points[k].positions + [body[k], 0, 0]
            shapes.append((f"{number}: {full or 'none'}", moved))
        plot_shapes(
            folder / "gait.png", pattern.triangles, shapes, density, view=(20.0, 20.0), columns=4
        )
        plot_tracks(folder / "tracks.png", feet, gait.steps)

    write_together(comm, folder, write)
    return found
