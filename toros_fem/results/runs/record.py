"""What is recorded of a run while it computes: its design's steps, its print, and its paths."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from shapely.geometry.base import BaseGeometry

from toros_fem.base.validation import Floats, Ints
from toros_fem.design.loop.options import Iteration
from toros_fem.design.loop.problem import Evaluation
from toros_fem.design.loop.shape_design import ShapeProblem
from toros_fem.measures.miss import compared_axes, is_aligned
from toros_fem.mechanics.paths.trace_point import TracePoint
from toros_fem.meshes.pattern import Mirrored, Pattern, Regions
from toros_fem.results.runs.frames import (
    FOLDER,
    Frame,
    ShownSkin,
    forget_from,
    thin,
    write_frame,
    write_skin,
)

if TYPE_CHECKING:
    from toros_fem.mechanics.contact.contact import Contact

# Series that a finished design is followed by.
FOLLOWING = ("print", "pose", "pressure", "gait", "load")


def whole_cells(problem: ShapeProblem, owned: Floats) -> Floats:
    """Return values of the whole skin's triangles, (t,), of those of each rank (collective)."""
    return problem.whole.at_cells(problem.skin.gather_cells(owned))


def gathered_frame(row: Iteration, evaluation: Evaluation[Any]) -> tuple[ShownSkin, Frame] | None:
    """Return the frame of a design's step, by its row, and its skin on every rank (collective).

    None where the design is not that of a shape. The frame does not name its skin's file yet.
    """
    problem = evaluation.problem
    if not isinstance(problem, ShapeProblem):
        return None
    state = evaluation.equilibrium
    positions = problem.whole.at_vertices(problem.physics.shape_of(state))
    density = whole_cells(problem, problem.fields.shown(evaluation.projected))
    note = state.condition.sentences
    frame = Frame("iteration", row.iteration, "", positions, density, row.columns(), note)
    return shown_skin(problem, poses=state.poses), frame


def shown_skin(
    problem: ShapeProblem,
    regions: Regions | None = None,
    poses: Sequence[Sequence[float]] | None = None,
) -> ShownSkin:
    """Return the whole skin of a design problem, with its print, on every rank (collective).

    The poses are those of the bodies that it touches, as of an `Equilibrium`; None leaves them
    where they are made.
    """
    whole, passive, target = problem.whole, problem.fields.passive, problem.target
    passive = None if passive is None else whole_cells(problem, passive)
    if passive is not None and not np.isnan(passive).any():  # nothing is designed
        passive = None
    target = None if target is None else whole.at_vertices(target)
    aligned = is_aligned(problem.objective)
    touched = _touched(problem.solver.contact, poses)
    compared = compared_axes(problem.objective)
    return ShownSkin(whole.pattern, target, aligned, passive, regions, *touched, compared)


def _touched(
    contact: Contact | None, poses: Sequence[Sequence[float]] | None
) -> tuple[tuple[Floats, Ints] | None, Floats | None]:
    """Return bodies and grounds of what a skin touches, as of a `ShownSkin`.

    Bodies that move freely are left out where their poses are not known.
    """
    if contact is None:
        return None, None
    bodies = [body for body in contact.bodies if not body.free or poses is not None]
    if poses is not None:
        bodies = [body.moved(np.asarray(pose)) for body, pose in zip(bodies, poses, strict=True)]
    first = np.cumsum([0, *(len(body.points) for body in bodies)])
    cells = [body.triangles + k for body, k in zip(bodies, first, strict=False)]
    grounds = np.array([(ground.point, ground.normal) for ground in contact.grounds])
    return (
        (np.concatenate([b.points for b in bodies]), np.concatenate(cells)) if bodies else None,
        grounds if len(grounds) else None,
    )


def write_step(folder: Path, skin: ShownSkin, frame: Frame) -> None:
    """Write the frame of a design's step, and thin out those before it (one rank).

    Frames of later steps and of what follows a design are deleted: they are of an older run, or of
    steps that a resumed run does again.
    """
    for series in FOLLOWING:
        forget_from(folder / FOLDER, series, 0)
    write_series(folder, skin, [frame])
    thin(folder / FOLDER, frame.series)


def write_path(
    folder: Path,
    series: str,
    skin: ShownSkin,
    points: Sequence[TracePoint],
    whole: Mirrored,
    density: Floats | None = None,
    chambers: Sequence[str] = (),
) -> None:
    """Write the frames of a path, "pressure" or "gait", into a run's folder (one rank).

    The equilibria are those of a part of the whole. Where the skin has no print, a density of
    all triangles, (t,), is shown. Pressures of chambers are recorded by their names.
    """
    frames = []
    for number, point in enumerate(points):
        state = point.result
        positions = whole.at_vertices(point.positions)
        pressures = zip(chambers, state.pressures, strict=False)
        values = {"pressure_pa": state.pressure, **point.metrics}
        values |= {f"{name}_pa": pressure for name, pressure in pressures}
        note = state.condition.sentences
        frames.append(Frame(series, number, "", positions, density, values, note))
    write_series(folder, skin, frames)


def write_series(folder: Path, skin: ShownSkin, frames: Sequence[Frame]) -> None:
    """Write frames of a run, one at least, and their skin into its folder (one rank).

    They do not name their skin's file yet. Frames of the series from the first of them on, of an
    older run, are deleted.
    """
    folder = folder / FOLDER
    folder.mkdir(exist_ok=True)
    forget_from(folder, frames[0].series, frames[0].number)
    name = write_skin(folder, skin)
    for frame in frames:
        write_frame(folder, replace(frame, skin=name))


def repeated(pattern: Pattern, regions: Regions, count: int) -> tuple[Pattern, list[BaseGeometry]]:
    """Return copies of a skin as one pattern, all at the same positions, and their print."""

    def numbered(values: Ints, size: int) -> Ints:
        return np.concatenate([values + k * size for k in range(count)])

    copies = replace(
        pattern,
        flat_points=np.tile(pattern.flat_points, (count, 1)),
        flat_triangles=numbered(pattern.flat_triangles, len(pattern.flat_points)),
        panel=numbered(pattern.panel, len(pattern.panel_names)),
        sewn=numbered(pattern.sewn, len(pattern.points)),
        points=np.tile(pattern.points, (count, 1)),
        panel_names=tuple(f"{name} {k + 1}" for k in range(count) for name in pattern.panel_names),
    )
    return copies, [*regions] * count
