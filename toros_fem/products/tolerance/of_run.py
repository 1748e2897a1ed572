"""Tolerances of a finished run, from what its folder holds."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import FileError, NoEquilibriumError
from toros_fem.base.mpi import on_first_rank
from toros_fem.making.print.print_file import read_print_polygons
from toros_fem.making.print.regions import case_of_print
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.pattern_file import NAME, read_pattern
from toros_fem.products.actuators.scene import ActuatorScene
from toros_fem.products.options import ToleranceConfig
from toros_fem.products.tolerance.result import Tolerances
from toros_fem.products.tolerance.simulated import Drawn, simulated_tolerances
from toros_fem.results.frames.files import FOLDER, read_frames
from toros_fem.results.frames.shown_skin import read_skin
from toros_fem.results.runs.files import SUMMARY
from toros_fem.results.runs.summary_file import Summary, summary_of


def tolerances_of_run(
    comm: MPI.Comm,
    run: Path | str,
    scene: ActuatorScene,
    files: Mapping[str, Path],
    config: ToleranceConfig | None = None,
) -> Tolerances:
    """Return how a finished design moves if it is not made as drawn (collective).

    The simulation starts from the shape of the print that the run has stored. The files are those
    that the design has taken, by name. None takes the default tolerances.

    Raises:
        FileError: The folder holds no finished design of an actuator.
        NoEquilibriumError: The print has no equilibrium.
        TorosError: A file cannot be read, or does not fit.
    """
    folder = Path(run)
    summary = on_first_rank(comm, lambda: finished_summary(folder))
    failure = summary.entries["printed_failure"]
    if failure:
        raise NoEquilibriumError(f"the print has no equilibrium: {failure}")
    scene = scene.with_files(comm, files)
    level = scene.print_level if scene.design.start == "relaxed" else scene.finest_level
    case = scene.case(comm, level)
    stored = read_print_polygons(comm, folder)
    fine = case_of_print(comm, case, stored.pattern, stored.regions)
    near = on_first_rank(comm, lambda: _shape(folder))
    problem = scene.problem(comm, fine, level)

    values = {m.key: summary.own_value(m.key) for m in case.judged}
    drawn = Drawn(
        (stored.pattern, stored.regions),
        stored.limits,
        near,
        summary.entries["pressures_pa"],
        {key: value for key, value in values.items() if value is not None},
    )
    return simulated_tolerances(problem, drawn, config)


def finished_summary(folder: Path) -> Summary:
    """Return the summary of a finished design (one rank).

    Raises:
        FileError: The folder holds none.
    """
    found = summary_of(folder)
    if "printed_failure" not in found.entries:
        what = "has no print" if found else "is missing"
        raise FileError(f"{folder / SUMMARY} {what}: give the folder of a finished design.")
    return found


def _shape(folder: Path) -> tuple[Pattern, Floats] | None:
    """Return the pattern that was designed and the shape of its print; None if none is stored."""
    frames = read_frames(folder / FOLDER, "print")
    if not frames:
        return None
    part = read_pattern(MPI.COMM_SELF, folder / NAME)
    whole = read_skin(folder / FOLDER / frames[-1].skin).pattern
    positions = part.points.copy()
    # The triangles of a part are the first of the whole.
    positions[part.triangles] = frames[-1].positions[whole.triangles[: len(part.panel)]]
    return part, positions
