"""An X-shaped walker that stands up or crawls when inflated (paper Figs. 9, 10).

    python demos/walker.py --coarse
    python demos/walker.py --coarse --motion crawl

Two flat panels, top and bottom, sewn along an X: a body and four legs along the diagonals. A
quarter is designed, one leg by symmetry, at 20 kPa: the leg is to turn down by 90° (stand),
or by 60° while the body reaches out (crawl). What is printed is the whole robot. It is then
simulated with three chambers, body, front legs and rear legs, through one cycle of a gait.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem._validate import require_choice
from toros_fem.actuators.case import ActuatorCase, ActuatorResult, design, merged, settings_of
from toros_fem.actuators.gait import Gait, write_gait
from toros_fem.actuators.limb import limb_cross_sections, rest_on_body, tip_angle_metric
from toros_fem.analysis.pressure_path import PressurePathPoint, trace_pressure_path
from toros_fem.command_line import command_line, last_line
from toros_fem.equilibrium.solver import EquilibriumError, EquilibriumSolver
from toros_fem.mechanics.chambers import Chambers
from toros_fem.meshes import (
    Pattern,
    Star,
    compose,
    plane_centroids,
    sew,
    stand,
    walker,
)

DEFAULTS: dict[str, Any] = {
    "motion": "stand",  # or "crawl"
    "leg_length": 0.06,  # m, from the body's circle
    "leg_width": 0.024,  # m
    "body_radius": 0.02,  # m
    "fillet": 6e-3,  # m
    "edge_length": 1.8e-3,  # m
    "curved": 0.03,  # m of each leg that bends, from its root on; the rest is to stay straight
    "sections": 6,  # of the leg
    "place": 0.02,  # weight of the leg's centre line, over that of its orientation
    "lever": 0.03,  # m; the leg's tip off by 0.1 rad counts as if all were off by 3 mm
    "reach": 6e-3,  # m by which the body is to reach out along x to either side, if it crawls
    "gait_steps": 2,  # equilibria a phase of the gait; 0 leaves it out
    "low": 0.86,  # pressure in a chamber that is let down, over the design's
    "seams": "hinged",
    "radius": 2.75e-3,
    "pressure": 20e3,  # Pa, given: as the paper's
    "pressure_min": 0.0,
    "pressure_max": 0.0,
}
COARSE = {
    "edge_length": 2.8e-3,
    "radius": 4.3e-3,
    "iterations": 40,
    "constrained": 30,
}
ANGLE = {"stand": 90.0, "crawl": 60.0}  # degrees
CHAMBERS = ("body", "front", "rear")
# Rear feet grip, the body reaches out, front feet grip, rear feet let go, the body draws in.
PHASES = np.array([[0, 0, 1], [1, 0, 1], [1, 1, 1], [1, 1, 0], [0, 1, 0], [0, 1, 1]], dtype=bool)


def star(inputs: dict[str, Any]) -> Star:
    """The robot's sizes."""
    o = inputs
    return Star(4, o["leg_length"], o["leg_width"], o["body_radius"], o["fillet"], np.pi / 4)


def scene(comm: MPI.Comm, inputs: dict[str, Any]) -> ActuatorCase:
    """A quarter of the robot, what is held of it, and what it is to become."""
    o, body = inputs, star(inputs)
    require_choice("motion", o["motion"], tuple(ANGLE))
    angle = ANGLE[o["motion"]]
    pattern = walker(comm, o["edge_length"], body, planes=(0, 1))
    along = np.append(body.directions[0], 0.0)
    target = stand(np.radians(angle), o["curved"], directions=body.directions[:1], root=body.root)
    if o["motion"] == "crawl":
        target = compose(target, lambda points: points + [o["reach"], 0, 0])
    return ActuatorCase(
        pattern=pattern,
        target=target(pattern.points),
        supports=rest_on_body(pattern, body.body_radius, (0, 1)),
        metrics=(tip_angle_metric(angle, along, (0, 0, -1), body.root),),
        sections=limb_cross_sections(
            pattern, along, body.root, o["sections"], o["place"], o["lever"]
        ),
        # Which side is to stretch is told; otherwise the start knows neither up nor down.
        start=np.where(pattern.panel == pattern.panel_index("top"), 0.35, 0.65),
        symmetry=(0, 1),
    )


def chambers(pattern: Pattern, body: Star) -> Chambers:
    """Body, the two legs at x > 0, and the two at x < 0."""
    place = plane_centroids(pattern)
    leg = (place @ body.directions.T > body.root).any(axis=1)
    return Chambers(CHAMBERS, np.where(leg, np.where(place[:, 0] > 0, 1, 2), 0))


def walk(
    comm: MPI.Comm, output: Path, inputs: dict[str, Any], done: ActuatorResult
) -> dict[str, Any]:
    """The whole robot, as it is printed, through one cycle of the gait."""
    o, body, printed = inputs, star(inputs), done.printed
    pattern = printed.pattern
    skin = sew(comm, pattern)
    shown = printed.evaluation or done.result.final
    quarter, whole = done.problem.solver.skin, done.problem.whole
    assert whole is not None
    start = whole.at_vertices(quarter.gather_vertices(shown.equilibrium.positions))
    # Held where they are in the design's shape, which is no more than to hold rigid motions.
    rest = rest_on_body(pattern, body.body_radius)
    rest = replace(rest, displacement=np.where(rest.fixed, start - pattern.points, 0.0))
    solver = EquilibriumSolver(
        skin, settings_of(o).composite, rest, chambers=chambers(pattern, body)
    )
    feet = tuple(1 if x > 0 else 2 for x in body.directions[:, 0])
    gait = Gait(CHAMBERS, np.where(PHASES, 1.0, o["low"]), o["gait_steps"], feet)
    density = printed.cells.astype(np.float64)
    legs = [
        tip_angle_metric(
            ANGLE[o["motion"]], np.append(d, 0), (0, 0, -1), body.root, name=f"leg_{k}"
        )
        for k, d in enumerate(body.directions)
    ]
    pressure = shown.equilibrium.pressure
    # All chambers full is how the design is known: from there to where the cycle begins.
    shares = [np.ones(len(CHAMBERS)), *gait.shares]
    levels = [(pressure * share).tolist() for share in shares]
    metrics = {"chambers": CHAMBERS, "pressure_pa": pressure, "triangles": len(density)}
    points: list[PressurePathPoint] = []
    try:
        path = trace_pressure_path(
            solver, density[skin.owned_cells], levels, legs, start[skin.owned_vertices]
        )
        points.extend(path)
    except EquilibriumError as caught:  # raised by all ranks or by none
        metrics["failure"] = str(caught)
    points = points[1:]
    if not points:
        return metrics
    return write_gait(
        comm, output, gait, pattern, points, body.directions, body.root, density, metrics
    )


def run(comm: MPI.Comm, output: Path, *, verbose: bool = False, **inputs: Any) -> dict[str, Any]:
    """Design the walker and let it walk; returns the summary, that of the gait under "gait".

    Args:
        comm: Communicator.
        output: Folder for summary, history, pattern, fields, pictures and the gait's table.
        verbose: Whether to print every step of the equilibrium solver.
        inputs: What differs from `DEFAULTS` and `toros_fem.scene.ActuatorConfig`.
    """
    begin = time.perf_counter()
    o = merged(DEFAULTS, inputs)
    done = design(comm, output, scene(comm, o), o, begin=begin, verbose=verbose)
    if not o["gait_steps"]:
        return done.summary
    return {**done.summary, "gait": walk(comm, output, o, done)}


def sentence(summary: dict[str, Any]) -> str:
    """The result in words."""
    gait = summary.get("gait")
    walked = ""
    if gait and "failure" in gait:
        walked = f"; its gait ends after {gait.get('equilibria', 0)} equilibria: {gait['failure']}"
    elif gait:
        walked = f"; a stride of {gait['stride_mm']:.1f} mm"
    return last_line(summary) + walked


if __name__ == "__main__":
    sys.exit(
        command_line(
            MPI.COMM_WORLD, __doc__, run, DEFAULTS, COARSE, Path("output/walker"), sentence
        )
    )
