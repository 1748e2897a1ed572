"""Forces of an actuator: how its blocked end pushes, how stiff it is, and what a pump gives.

The free end is a panel that moves as a rigid plate. Inflated without a load it comes to a pose at
each pressure. Held at rest, or where it was at a lower pressure, it pushes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation

from toros_fem.base.errors import PanelError, ParameterError, TorosError
from toros_fem.base.files import guarded, if_plotting, write_json, write_table
from toros_fem.base.mpi import free_dropped
from toros_fem.base.validation import Floats, unit_vector, vector
from toros_fem.design.loop.case import Case
from toros_fem.making.printability import case_of_print, read_print_polygons
from toros_fem.measures.figures import formatted
from toros_fem.measures.metrics import Metric
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium, EquilibriumError
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.rigid_panels import panel_stiffness, solve_rigid, wrench
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Planes, Supports, centre_of, clamp, rigid_displacement
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.skin import sew
from toros_fem.products.actuators.estimates import SAFETY
from toros_fem.products.actuators.scene import ActuatorScene, Level
from toros_fem.products.common.options import ForceOptions
from toros_fem.products.tolerance_of_run import printed_summary

FILES = ("force.json", "force.csv", "force.png")
# Of the air around, in Pa.
ATMOSPHERE = 101_325.0
POSE = ("shift_x_m", "shift_y_m", "shift_z_m", "turn_x_rad", "turn_y_rad", "turn_z_rad")
COMPONENTS = ("fx", "fy", "fz", "tx", "ty", "tz")


@dataclass(frozen=True, eq=False)
class ForceMap:
    """How a panel pushes at pressures p₁ to pₙ where it is held, and how it rests where it is free.

    Arrays with a place have it first: place 0 is at rest, place j where the free panel is at pⱼ.

    Attributes:
        panel: Its name.
        pressures: In Pa, (n,), rising.
        poses: Shift in m of the panel's centre and rotation vector in rad, (n + 1, 6).
        metrics: Values at each place by key, (n + 1,).
        pushes: Force in N and torque in N m about its centre that the skin exerts on what holds the
            panel, (n + 1, n, 6); NaN where the pressure is below the place's, or there is none.
        stiffness: Resistance of the free panel at each pressure, (n, 6, 6), as of
            `panel_stiffness`.
        volumes: Of the free skin in m³, (n + 1,), that of place 0 as assembled.
        failures: Why there are no pushes at places and pressures, as sentences.
        half_widths: Half-width of the interval of each push; None where it was not estimated.
    """

    panel: str
    pressures: Floats
    poses: Floats
    metrics: Mapping[str, Floats]
    pushes: Floats
    stiffness: Floats
    volumes: Floats
    failures: tuple[str, ...] = ()
    half_widths: Floats | None = None

    @property
    def pump_work(self) -> Floats:
        """Least work in J that fills the free skin with air up to each pressure, (n,).

        It is ∫ ln(P/P₀) d(P V) with absolute pressures P, that of the air around P₀: slow, at one
        temperature, and without losses.
        """
        absolute = ATMOSPHERE + np.append(0.0, self.pressures)
        return _integral(np.log(absolute / ATMOSPHERE), absolute * self.volumes)

    @property
    def work(self) -> Floats:
        """Work in J that the pressure does on the free skin up to each pressure, (n,): ∫ p dV."""
        return _integral(np.append(0.0, self.pressures), self.volumes)

    def directions(self, given: Sequence[float] | None) -> Floats:
        """Return the direction of the force at each place, (n + 1, 3).

        Without a given one it is that in which the free panel goes on from there, and at the last
        place that by which it came.
        """
        if given is not None:
            return np.tile(unit_vector("direction", given), (len(self.poses), 1))
        return _units(self.poses[:, :3])

    def axes(self) -> Floats:
        """Return the axis about which the free panel turns on from each place, (n + 1, 3)."""
        turns = Rotation.from_rotvec(self.poses[:, 3:])
        steps = (turns[1:] * turns[:-1].inv()).as_rotvec()
        return _units(np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)]))


def force_map(
    solver: EquilibriumSolver,
    density: Floats,
    pressures: Sequence[float] | Floats,
    panel: str,
    metrics: Mapping[str, Any] | None = None,
    *,
    free_turns: bool = False,
    point: Sequence[float] | None = None,
) -> ForceMap:
    """Return how a panel pushes where it is blocked, over pressures (collective).

    Args:
        solver, density: A solver whose supports hold the panel, and the design.
        pressures: In Pa, (n,), rising.
        panel: Name of the panel.
        metrics: Functions of the pattern and the positions of all vertices, by key, that say where
            the panel is.
        free_turns: Whether the held panel may turn: then it exerts no torque.
        point: Assembled point in m that poses and torques are about, (3,), and moves with the
            panel; None takes the centre of its area.

    Raises:
        ParameterError: Pressures do not rise, or the supports do not hold the panel.
        EquilibriumError: The free skin has no equilibrium.
    """
    rising = np.asarray(pressures, dtype=np.float64)
    if rising.ndim != 1 or not len(rising) or not (np.diff(rising, prepend=0.0) > 0).all():
        raise ParameterError(
            f"pressures = {rising.tolist()} must be above 0, and rise from one to the next."
        )
    skin, count = solver.skin, len(rising)
    about = centre_of(skin.pattern, [panel], skin.pattern.points)
    if point is not None:
        about = vector("point", point)
    measures = dict(metrics or {})
    values: dict[str, list[float]] = {key: [] for key in measures}

    def measure(positions: Floats) -> None:
        for key, function in measures.items():
            values[key].append(float(function(skin.pattern, positions)))

    poses: list[Floats] = [np.zeros(6)]
    free: list[Equilibrium] = []
    measure(skin.pattern.points)
    stiffness: Floats = np.zeros((count, 6, 6))
    # On the mesh of a print, whose borders are curves, the assembled shape may be out of bounds.
    rest = solver.start_at(skin.pattern.points)
    at: Floats | Equilibrium | None = rest
    for number, pressure in enumerate(rising):
        found, pose = solve_rigid(
            solver, density, float(pressure), [panel], about=about, pose=poses[-1], start=at
        )
        at = found
        free.append(found)
        poses.append(pose)
        stiffness[number] = panel_stiffness(solver, found, [panel], about + pose[:3])
        measure(solver.positions(found))

    pushes: Floats = np.full((count + 1, count, 6), np.nan)
    failures: list[str] = []
    loose = (False,) * 3 + (free_turns,) * 3
    for place, pose in enumerate(poses):
        held: Floats | Equilibrium | None = rest if place == 0 else free[place - 1]
        moved = rigid_displacement(skin.pattern, [panel], pose[:3], pose[3:], about)
        for number in range(max(place - 1, 0), count):
            try:
                if free_turns:
                    blocked, _ = solve_rigid(
                        solver, density, float(rising[number]), [panel], free=loose, about=about,
                        pose=pose, start=held,
                    )  # fmt: skip
                else:
                    load = Load(float(rising[number]), displacement=moved)
                    blocked = solver.solve(density, load, held)
            except EquilibriumError as caught:  # raised by all ranks or by none
                failures.append(f"At {rising[number]:g} Pa, place {place}: {caught}")
                break
            held = blocked
            pushes[place, number] = -wrench(solver, blocked, [panel], about + pose[:3])
    at_rest = solver.model.volumes(solver.model.assembled).sum()
    volumes = np.array([at_rest, *(found.volume for found in free)])
    return ForceMap(
        panel,
        rising,
        np.array(poses),
        {key: np.array(of_key) for key, of_key in values.items()},
        pushes,
        stiffness,
        volumes,
        tuple(failures),
    )


def forces_of_run(
    comm: MPI.Comm,
    run: Path | str,
    scene: ActuatorScene,
    files: Mapping[str, Path],
    options: ForceOptions | None = None,
) -> ForceMap:
    """Return how the free end of a finished design pushes (collective).

    The whole skin is simulated, with its mirror images, on a mesh along the print's borders.

    Args:
        run: Folder of the design.
        scene, files: The scene that it was made from, and the files of this.
        options: What is told; None takes the defaults.

    Raises:
        FileError: The folder holds no finished design.
        PanelError: It has no such panel.
        ParameterError: The skin touches something.
        NoEquilibriumError: The print, or the skin with a free rigid end, has no equilibrium.
    """
    folder, options = Path(run), options or ForceOptions()
    own = [float(p) for p in printed_summary(comm, folder).entries["pressures_pa"]]
    if options.pressure is None and len(set(own)) > 1:
        raise ParameterError(
            f"the design has the pressures {', '.join(formatted(p, 'pa') for p in own)}; forces "
            "are told at one pressure of all chambers. Give it: --pressure."
        )
    largest = own[0] if options.pressure is None else options.pressure
    pressures = largest * np.arange(1, options.steps + 1) / options.steps
    scene = scene.with_files(comm, files)
    level = scene.level_of_print
    stored = read_print_polygons(comm, folder)

    def mapped(level: Level, ratio: float = 1.0) -> ForceMap:
        case = scene.case(comm, level)
        fine = case_of_print(comm, case, stored.pattern, stored.regions, coarser=ratio)
        solver, density = whole_solver(comm, fine, options.panel)
        part = len(fine.pattern.points)  # its vertices and triangles are the first of the whole

        def value(metric: Metric, _: Pattern, positions: Floats) -> float:
            return metric.value(fine.pattern, positions[:part])

        return force_map(
            solver,
            density[solver.skin.owned_cells],
            pressures,
            options.panel,
            {metric.key: partial(value, metric) for metric in fine.judged},
            free_turns=options.turns == "free",
            point=options.vector("point"),
        )

    found = mapped(level)
    if options.without_intervals:
        return found
    free_dropped(comm)
    try:
        ratio, other = scene.coarser(level)
        change = np.abs(mapped(other, ratio).pushes - found.pushes)
    except TorosError as caught:  # raised by all ranks or by none
        return replace(found, failures=(*found.failures, f"There are no intervals: {caught}"))
    return replace(found, half_widths=np.asarray(SAFETY * change / (ratio - 1)))


def whole_solver(comm: MPI.Comm, case: Case, panel: str) -> tuple[EquilibriumSolver, Floats]:
    """Return a solver of the whole skin of a print whose supports hold a panel, and its density.

    It is collective; the density is that of all triangles, (t,).

    Raises:
        PanelError: There is no such panel, or it is held already.
        ParameterError: The skin touches something.
    """
    if case.contact is not None:
        raise ParameterError(
            "this skin touches itself or bodies, and forces of a panel know no contact. A gripper "
            "tells its holding force in its summary; from Python, leave the contact out."
        )
    pattern, density = case.pattern, case.prescribed
    assert density is not None
    assert case.composite is not None
    planes = Planes(pattern, case.supports)
    fixed = case.supports.fixed
    # What symmetry planes alone hold is free in the whole.
    fixed = fixed & (~planes.of_symmetry() | fixed.all(axis=1, keepdims=True))
    whole = case.whole
    supports = Supports(fixed[whole.vertex])
    if panel not in pattern.panel_names:
        names = ", ".join(map(repr, whole.pattern.panel_names[:8]))
        raise PanelError(
            f"no panel is named {panel!r}; there are {names}. Name the free end: --panel."
        )
    if supports.fixed[whole.pattern.vertices_of(panel)].all():
        raise PanelError(f"panel {panel!r} is held, so that it does not move. Name the free end.")
    solver = EquilibriumSolver(
        sew(comm, whole.pattern),
        case.composite,
        supports | clamp(whole.pattern, [panel]),
        chambers=case.chambers and Chambers(case.chambers.names, case.chambers.of_cell[whole.cell]),
        weight=case.weight,
        quadratic=None if case.quadratic is None else case.quadratic[whole.cell],
    )
    return solver, whole.at_cells(density)


def rows_of(found: ForceMap, direction: Sequence[float] | None = None) -> list[dict[str, Any]]:
    """Return a row for each place and pressure, in SI units, as force.csv has them."""
    along, about, rows = found.directions(direction), found.axes(), []
    for place, pose in enumerate(found.poses):
        held_at = 0.0 if place == 0 else float(found.pressures[place - 1])
        for number, pressure in enumerate(found.pressures):
            push = found.pushes[place, number]
            if np.isnan(push).any():
                continue
            row: dict[str, Any] = {"held_where_free_at_pa": held_at, "pressure_pa": float(pressure)}
            row |= {key: float(values[place]) for key, values in found.metrics.items()}
            row["force_n"] = float(push[:3] @ along[place])
            row["torque_n_m"] = float(push[3:] @ about[place])
            if found.half_widths is not None:
                wide = found.half_widths[place, number]
                row["force_half_width_n"] = float(wide[:3] @ np.abs(along[place]))
                row["torque_half_width_n_m"] = float(wide[3:] @ np.abs(about[place]))
            row |= {
                f"{name}_{'n' if name[0] == 'f' else 'n_m'}": float(value)
                for name, value in zip(COMPONENTS, push, strict=True)
            }
            row |= dict(zip(POSE, map(float, pose), strict=True))
            rows.append(row)
    return rows


def summary_of_forces(found: ForceMap, direction: Sequence[float] | None = None) -> dict[str, Any]:
    """Return all that a map tells, as JSON holds it."""
    return {
        "panel": found.panel,
        "pressures_pa": found.pressures.tolist(),
        "poses_m_rad": found.poses.tolist(),
        "metrics": {key: values.tolist() for key, values in found.metrics.items()},
        "stiffness_n_m_rad": found.stiffness.tolist(),
        "volumes_m3": found.volumes.tolist(),
        "work_j": found.work.tolist(),
        "pump_work_j": found.pump_work.tolist(),
        "pushes": rows_of(found, direction),
        "failures": list(found.failures),
    }


def sentence_of(found: ForceMap, direction: Sequence[float] | None = None) -> str:
    """Return the largest blocked force and torque, held at rest, as a sentence."""
    rows = [row for row in rows_of(found, direction) if row["held_where_free_at_pa"] == 0]
    if not rows:
        return f"Held at rest, panel {found.panel!r} has no equilibrium"
    last = rows[-1]

    def value(key: str, unit: str, scale: float = 1.0) -> str:
        wide = last.get(f"{key}_half_width_{unit}")
        size = f"{scale * last[f'{key}_{unit}']:.3g}"
        return size if wide is None else f"{size} ± {scale * wide:.2g}"

    return (
        f"Held at rest, panel {found.panel!r} pushes with {value('force', 'n')} N and turns with "
        f"{value('torque', 'n_m', 1e3)} N mm at {formatted(last['pressure_pa'], 'pa')}"
    )


def write_forces(
    comm: MPI.Comm,
    folder: Path | str,
    found: ForceMap,
    direction: Sequence[float] | None = None,
) -> None:
    """Write force.json, force.csv and force.png into a folder (collective).

    Raises:
        OutputError: A file cannot be written; on all ranks.
    """
    folder = Path(folder)

    def write() -> None:
        write_json(folder / FILES[0], summary_of_forces(found, direction))
        write_table(folder / FILES[1], rows_of(found, direction))
        if_plotting(lambda: plot_forces(folder / FILES[2], found, direction))

    guarded(comm, folder, write)


def plot_forces(path: Path, found: ForceMap, direction: Sequence[float] | None = None) -> None:
    """Write a picture of force and torque over the pressure, a line for each place (one rank)."""
    from matplotlib import colormaps

    from toros_fem.results.pictures.style import page

    rows = rows_of(found, direction)
    with page(path, sentence_of(found, direction), (8.0, 3.6)) as figure:
        where = {"left": 0.10, "right": 0.72, "bottom": 0.14, "top": 0.80, "wspace": 0.32}
        grid = figure.subplots(1, 2, gridspec_kw=where)
        key = next(iter(found.metrics), None)
        for axes, name, scale, unit in (
            (grid[0], "force", 1.0, "n"), (grid[1], "torque", 1e3, "n_m"),
        ):  # fmt: skip
            for place in range(len(found.poses)):
                held_at = 0.0 if place == 0 else found.pressures[place - 1]
                own = [row for row in rows if row["held_where_free_at_pa"] == held_at]
                if len(own) < 2:
                    continue
                colour = colormaps["viridis"](0.85 * place / len(found.poses))
                x = np.array([1e-3 * row["pressure_pa"] for row in own])
                y = np.array([scale * row[f"{name}_{unit}"] for row in own])
                at = "at rest" if place == 0 else f"free at {formatted(held_at, 'pa')}"
                if key is not None:
                    unit_of = key.rpartition("_")[2]
                    at += f": {formatted(round(float(found.metrics[key][place]), 2), unit_of)}"
                axes.plot(x, y, color=colour, marker="o", ms=3, label=at)
                wide = [row.get(f"{name}_half_width_{unit}") for row in own]
                if None not in wide:
                    half = scale * np.array(wide, dtype=np.float64)
                    axes.fill_between(x, y - half, y + half, color=colour, alpha=0.18, lw=0)
            axes.set_xlabel("pressure (kPa)")
            axes.grid(axis="y")
        grid[0].set_ylabel("force along its way (N)")
        grid[1].set_ylabel("torque along its turn (N mm)")
        figure.legend(
            *grid[0].get_legend_handles_labels(), title="held where it is", frameon=False,
            loc="center left", bbox_to_anchor=(0.73, 0.47), alignment="left",
        )  # fmt: skip


def _integral(values: Floats, over: Floats) -> Floats:
    """Return ∫ values d(over) from the first place to each other, by a monotone cubic between."""
    primitive = PchipInterpolator(over, values).antiderivative()
    return np.asarray(primitive(over[1:]) - primitive(over[0]))


def _units(places: Floats) -> Floats:
    """Return the directions from each place to the next, the last again, (n + 1, 3)."""
    steps = np.diff(places, axis=0)
    lengths = np.linalg.norm(steps, axis=1, keepdims=True)
    units = np.divide(steps, lengths, out=np.zeros_like(steps), where=lengths > 0)
    return np.concatenate([units, units[-1:]])
