"""Simulation of an actuator's plain skin, or of a given print, up to the scene's pressure."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import PanelError, ParameterError
from toros_fem.measures.metrics import UNITS
from toros_fem.mechanics.equilibrium.solver import EquilibriumError, EquilibriumSolver
from toros_fem.mechanics.paths.trace import trace
from toros_fem.mechanics.paths.trace_point import TracePoint
from toros_fem.meshes import mirrored, sew
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.pattern_file import NAME, read_print
from toros_fem.meshes.transfer import make_transfer
from toros_fem.products.actuators.case import ActuatorCase
from toros_fem.products.actuators.problem import CaseMaker
from toros_fem.products.actuators.run import error_figures
from toros_fem.products.actuators.scene import ActuatorScene
from toros_fem.results.console import print_step
from toros_fem.results.writer import write_pressure_path

C = TypeVar("C", bound=ActuatorScene)
FILES = {"pattern": f"output folder of a design, or its {NAME}; none: nothing is printed"}


def simulation_run(case: CaseMaker[C], default: C) -> Callable[..., dict[str, Any]]:
    """Return the simulation of an actuator, which writes all results and returns the summary.

    It is called as `run(comm, output, config, pattern=…, verbose=…)`, with the arguments of
    `simulate_actuator`; without a configuration it takes the default.

    Args:
        case: Makes what to simulate, of the communicator and a configuration.
        default: The configuration with its defaults.
    """

    def run(
        comm: MPI.Comm,
        output: Path | str,
        config: C | None = None,
        *,
        pattern: Path | str | None = None,
        verbose: bool = False,
    ) -> dict[str, Any]:
        return simulate_actuator(
            comm, output, case, config or default, pattern=pattern, verbose=verbose
        )

    return run


def simulate_actuator(
    comm: MPI.Comm,
    output: Path | str,
    case: CaseMaker[C],
    config: C,
    *,
    pattern: Path | str | None = None,
    verbose: bool = False,
) -> dict[str, Any]:
    """Inflate an actuator without designing it, and write curve, fields and pictures (collective).

    The pressure rises to that of `config` in `curve_steps` equal steps. Where it cannot be followed
    to its end, the summary's "failure" says why.

    Args:
        comm: Communicator.
        output: Folder for the results.
        case: Makes what to simulate, of the communicator and a configuration.
        config: Its numbers; the finest of its meshes is taken.
        pattern: Output folder of a design, or the pattern file in it. On the mesh of that design
            the simulation is that of its print. On another mesh a triangle is printed where at
            least half of it is. None: only what is always printed is.
        verbose: Whether to print every Newton step.

    Returns:
        The summary, as in summary.json.

    Raises:
        ParameterError: The pressure is 0, or a number is out of its bounds.
        PatternFileError: The pattern cannot be read.
        PanelError: It is that of another skin.
        EquilibriumError: There is no equilibrium at the first pressure.
    """
    begin = time.perf_counter()
    if not config.pressure.pressure > 0:
        raise ParameterError(
            f"pressure = {config.pressure.pressure} Pa must be above 0 to simulate with it."
        )
    made, density = _printed(comm, case, config, pattern)
    skin = sew(comm, made.pattern)
    log = print_step(comm) if verbose else None
    solver = EquilibriumSolver(
        skin,
        config.material.composite,
        made.supports,
        log=log,
        chambers=made.chambers,
        contact=made.contact,
    )
    own = density[skin.owned_cells]
    pressures = np.linspace(0.0, config.pressure.pressure, config.results.curve_steps + 1)[1:]
    points: list[TracePoint] = []
    failure = None
    try:
        points.extend(trace(solver, own, [*map(float, pressures)], made.metrics))
    except EquilibriumError as caught:  # raised by all ranks or by none
        failure = str(caught)
        if not points:
            raise
    figures: dict[str, Any] = {
        **points[-1].metrics,
        "pressure_pa": points[-1].result.pressure,
        "failure": failure,
        "pattern": None if pattern is None else str(pattern),
    }
    if config.results.estimate_error:
        figures |= error_figures(solver, own, points[-1].result, made.metrics)
    return write_pressure_path(
        comm, output, made.pattern, points, density, made.metrics,
        whole=mirrored(made.pattern, made.symmetry) if made.symmetry else None,
        composite=config.material.composite, config=config,
        figures=figures, seconds={"total": time.perf_counter() - begin},
    )  # fmt: skip


def simulation_sentence(summary: dict[str, Any]) -> str:
    """Return the result of a simulation in one sentence, from its summary."""
    found = []
    for key, value in summary.items():
        name, _, unit = key.rpartition("_")
        if unit not in UNITS or name.endswith(("_refined", "_error")):
            continue
        error = summary.get(f"{name}_error_{unit}")
        digits = 3 if unit == "ratio" else 1
        shown = f"{name} {value:.{digits}f}"
        found.append(shown + ("" if error is None else f" ± {error:.{digits}f}"))
        found[-1] += f" {UNITS[unit][0]}"
    what = "plain skin" if summary["pattern"] is None else "as printed"
    ended = "" if summary["failure"] is None else f"; it ends there: {summary['failure']}"
    return f"{', '.join(found)} at {summary['pressure_pa'] / 1e3:.2f} kPa, {what}{ended}"


def _printed(
    comm: MPI.Comm, case: CaseMaker[C], config: C, pattern: Path | str | None
) -> tuple[ActuatorCase, Floats]:
    """Return the case on the mesh to simulate on, and the density of all triangles, (t,)."""
    made = case(comm, config.at_level(config.level_count - 1))
    if pattern is None:
        count = len(made.pattern.panel)
        passive = np.zeros(count) if made.passive is None else made.passive
        return made, np.nan_to_num(passive, nan=0.0)
    path = Path(pattern)
    source, printed = read_print(comm, path / NAME if path.is_dir() else path)
    density = printed.astype(np.float64)
    if _same(source, made.pattern):
        return replace(made, pattern=source), density
    if config.design.start == "relaxed":  # the mesh of laid lines, whose edges follow them
        fine = case(comm, config.of_print)
        if _same(source, fine.pattern):
            return replace(fine, pattern=source), density
    try:
        transfer = make_transfer(source, made.pattern)
    except PanelError as caught:
        raise PanelError(f"{path} is the pattern of another skin: {caught}") from None
    return made, (transfer.at_cells(density) >= 0.5).astype(np.float64)


def _same(one: Pattern, other: Pattern) -> bool:
    """Return whether two patterns have the same triangles, whose corners may have moved."""
    return (
        np.array_equal(one.flat_triangles, other.flat_triangles)
        and np.array_equal(one.sewn, other.sewn)
        and one.panel_names == other.panel_names
        and bool(np.allclose(one.points, other.points, rtol=0, atol=0.02 * other.size))
    )
