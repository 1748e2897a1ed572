"""A walker with several chambers in a cycle of pressures on the ground: stride, slip, energy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from mpi4py import MPI

from toros_fem.base.files import guarded, if_plotting, write_table
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.validation import Bools, Floats
from toros_fem.measures.figures import Figure
from toros_fem.mechanics.contact.layers import ContactSizes, opened
from toros_fem.mechanics.paths.trace_point import TracePoint
from toros_fem.mechanics.skin.supports import Planes, Supports
from toros_fem.meshes.pattern import Mirrored, Pattern, Regions
from toros_fem.products.actuators.legs import tip_positions
from toros_fem.results.runs.frames import ShownSkin
from toros_fem.results.runs.record import write_path
from toros_fem.results.runs.stored_run import notes_at

# The ground lies so far below the lowest point of the start, over the distance of contact.
CLEARANCE = 0.5
# Positions of the gait side by side in a picture.
IN_A_ROW = 4


@dataclass(frozen=True, eq=False)
class Gait:
    """One cycle of pressures.

    Attributes:
        names: Names of the chambers.
        phases: Fraction of the full pressure in each chamber at the end of each phase, (p, k). The
            cycle starts where the last phase ends.
        steps: Number of equilibria in each phase.
    """

    names: tuple[str, ...]
    phases: Floats
    steps: int

    @property
    def pressure_fractions(self) -> Floats:
        """Fraction of the full pressure in each chamber over the whole cycle, (rows, k)."""
        ends = np.concatenate([self.phases[-1:], self.phases])
        progress = np.arange(1, self.steps + 1)[:, None] / self.steps
        rows = [a + progress * (b - a) for a, b in pairwise(ends)]
        return np.concatenate([ends[:1], *rows])


@dataclass(frozen=True, eq=False)
class Walk:
    """What a robot does on the ground in one cycle of pressures.

    Attributes:
        points: The equilibria of a part of the robot, one for each row of the gait's pressure
            fractions, or for the first of them.
        whole: The whole robot and that part.
        feet: Positions of the tips of the legs at each equilibrium, (rows, f, 3), in m, heights
            from the ground.
        touching: Which of them touch the ground, (rows, f).
        pressures: Full pressure of each chamber in Pa.
        failure: Why the path ends before the cycle does; empty where it does not.
        measured: Who measured the stride of such a robot, and it in m; None for none.
        intervals: Half-width of the interval of each figure, by key, as far as they are known.
    """

    NAME: ClassVar[str] = "gait"

    gait: Gait
    points: Sequence[TracePoint]
    whole: Mirrored
    feet: Floats
    touching: Bools
    pressures: tuple[float, ...] = ()
    failure: str = ""
    measured: tuple[str, float] | None = None
    intervals: Mapping[str, float] = field(default_factory=dict)

    @property
    def complete(self) -> bool:
        """Whether the equilibria are those of a whole cycle, so that it has a stride."""
        return len(self.points) == len(self.gait.pressure_fractions)

    @property
    def stride(self) -> float:
        """Distance in m by which the feet get ahead along x, in the mean."""
        return float((self.feet[-1] - self.feet[0])[:, 0].mean())

    @property
    def slip(self) -> float:
        """Way in m that the feet slide backwards on the ground, in the mean of all feet."""
        back = np.minimum(np.diff(self.feet[:, :, 0], axis=0), 0.0)
        both = self.touching[1:] & self.touching[:-1]
        return float(-(back * both).sum(axis=0).mean())

    @property
    def uncertain(self) -> dict[str, float]:
        """Parts of half-widths in mm: rounding decides how far feet slide back as a leg snaps."""
        return dict.fromkeys(("stride_mm", "slip_mm"), 1e3 * self.slip)

    @property
    def work(self) -> Floats:
        """Work P ΔV in J of the pressure of each chamber in each step, (rows − 1, k)."""
        pressures = np.array([point.result.pressures for point in self.points])
        volumes = self.whole.parts * np.array([point.result.volumes for point in self.points])
        return np.asarray((pressures[1:] + pressures[:-1]) / 2 * np.diff(volumes, axis=0))

    @property
    def supplied_energy(self) -> float:
        """Sum of P ΔV in J over the steps in which a chamber takes up work."""
        return float(np.maximum(self.work, 0.0).sum())

    @property
    def lost_energy(self) -> float:
        """Work in J over the closed cycle: what friction and snapping turn into heat."""
        return float(self.work.sum())

    @property
    def notes(self) -> list[str]:
        """What is not as usual at its points, as sentences."""
        return notes_at((p.result.pressure, p.result.condition.sentences) for p in self.points)

    @property
    def figures(self) -> tuple[Figure, ...]:
        """The most important numbers; None where the cycle ends too early for them."""
        found, known = self.entries(), self.intervals
        keys = {f"{name}_mm": name for name in ("stride", "slip", "smallest_distance")}
        return tuple(Figure(name, "mm", found[key], known.get(key)) for key, name in keys.items())

    @property
    def words(self) -> str:
        """It in words."""
        if self.failure or not self.complete:
            return f"its gait ends after {len(self.points)} equilibria: {self.failure}"
        return ", ".join(figure.words for figure in self.figures[:2])

    def entries(self) -> dict[str, Any]:
        """Return it as summaries hold it; None where the cycle ends too early for a number."""
        states = [point.result for point in self.points]
        distances = [d for d in (state.smallest_distance for state in states) if d is not None]
        complete = self.complete
        return {
            "chambers": self.gait.names,
            "pressures_pa": self.pressures,
            "failure": self.failure or None,
            "equilibria": len(states),
            "stride_mm": 1e3 * self.stride if complete else None,
            "slip_mm": 1e3 * self.slip if complete else None,
            "measured_stride_mm": 1e3 * self.measured[1] if self.measured and states else None,
            "smallest_distance_mm": 1e3 * min(distances) if states else None,
            "foot_lift_mm": 1e3 * float(self.feet[:, :, 2].max()) if states else None,
            "supplied_energy_j": self.supplied_energy if states else None,
            "lost_energy_j": self.lost_energy if complete else None,
        }


def flat_on_ground(
    comm: MPI.Comm, pattern: Pattern, supports: Supports, sizes: ContactSizes
) -> tuple[Floats, float]:
    """Return a flat robot as it lies on the ground, and the height of the ground (collective).

    Args:
        pattern, supports: The robot, or a part of it, and its symmetry planes.

    Returns:
        Positions of all vertices, (n, 3), in m, with the layers apart, and the height in m of a
        ground that the lowest of them nearly touch.
    """
    planes = Planes(pattern, supports).through_origin()
    start = on_first_rank(comm, lambda: opened(pattern, sizes, planes))
    return start, float(start[:, 2].min()) - sizes.thickness / 2 - CLEARANCE * sizes.distance


def walk_of(
    gait: Gait,
    points: Sequence[TracePoint],
    whole: Mirrored,
    directions: Floats,
    ground: float,
    reach: float,
) -> Walk:
    """Return what a robot does along a path of equilibria.

    Args:
        gait, points, whole: As of `Walk`.
        directions: Unit vectors along the legs of the whole in the assembled skin, (f, 2).
        ground: Height of the ground in m.
        reach: Distance in m of the middle surface from the ground at which a foot touches it.
    """
    shapes = [whole.at_vertices(point.positions) - [0, 0, ground] for point in points]
    along = whole.pattern.points[:, :2] @ directions.T
    # Halves of the legs: a leg that lies touches with more than its tip.
    outer = along > 0.5 * along.max(axis=0)
    lowest = [[shape[leg, 2].min() for leg in outer.T] for shape in shapes]
    feet = np.array([tip_positions(whole.pattern, shape, directions) for shape in shapes])
    return Walk(gait, points, whole, feet, np.array(lowest) <= reach)


def write_gait(
    comm: MPI.Comm,
    folder: Path,
    walk: Walk,
    regions: Regions,
) -> None:
    """Write table, frames and pictures of a cycle (collective).

    The regions are the print on each panel of the whole, polygons in m.

    Raises:
        OutputError: A file cannot be written.
    """
    gait, points = walk.gait, walk.points
    shapes = [walk.whole.at_vertices(point.positions) for point in points]
    ground = min(float(x[:, 2].min()) for x in shapes)
    grounds = np.array([[[0.0, 0.0, ground], [0.0, 0.0, 1.0]]])
    skin = ShownSkin(walk.whole.pattern, regions=regions, grounds=grounds)

    def draw() -> None:
        from toros_fem.results.pictures.curves import cycle_title, draw_tracks
        from toros_fem.results.pictures.raster import View
        from toros_fem.results.pictures.shapes import plot_states
        from toros_fem.results.pictures.shown import DrawnSkin
        from toros_fem.results.pictures.style import page

        robot, shown = DrawnSkin(skin), []
        for number, k in enumerate(range(0, len(points), gait.steps)):
            fractions = zip(gait.names, gait.pressure_fractions[k], strict=True)
            full = ", ".join(name for name, fraction in fractions if fraction >= 0.5)
            filled = f"{full} inflated" if full else "nothing inflated"
            shown.append((f"phase {number}: {filled}", robot.surfaces(shapes[k])))
        stride = walk.figures[0] if walk.complete else None
        title = cycle_title(stride, "A cycle of the gait")
        rows = [shown[k : k + IN_A_ROW] for k in range(0, len(shown), IN_A_ROW)]
        nearest = int(np.argmin(walk.feet[0, :, 1]))  # to the viewer
        begin, way = np.append(walk.feet[0, nearest, :2], ground), None
        if stride is not None:
            way = begin, begin + [walk.stride, 0.0, 0.0]
        plot_states(folder / "gait.png", rows, View(15.0, 15.0), title, ground, way)
        with page(folder / "tracks.png") as figure:
            draw_tracks(figure, walk.feet, gait.steps, stride, walk.measured)

    def write() -> None:
        rows = []
        for point, places in zip(points, walk.feet, strict=True):
            row = {f"{n}_pa": p for n, p in zip(gait.names, point.result.pressures, strict=True)}
            for k, foot in enumerate(places):
                row |= {f"foot_{k}_{axis}_m": v for axis, v in zip("xyz", foot, strict=True)}
            rows.append({**row, **point.metrics})
        write_table(folder / "gait.csv", rows)
        write_path(folder, "gait", skin, points, whole=walk.whole, chambers=gait.names)
        if_plotting(draw)

    guarded(comm, folder, write)
