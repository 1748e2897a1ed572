"""A gripper of three fingers that close on a sphere or a box when inflated (paper Fig. 1).

    python demos/gripper.py --coarse
    python demos/gripper.py --coarse --shape box

Each finger is a flat one of two panels, clamped at its root in a mount; the three hang around the
object at 120°. Half a finger is designed, by symmetry; a line along its inner panel is printed in
any case, so that this keeps its length. The target is built from the object: straight until the
finger touches, then around it. The distance of the inner panel from the object counts besides. What
is printed is simulated again; the gap that it leaves is reported, and what the object's weight
changes when it hangs on the fingers.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from toros_fem.actuators.case import ActuatorCase, ActuatorResult, design, merged
from toros_fem.actuators.gripper import write_grasp
from toros_fem.actuators.limb import limb_cross_sections, tip_angle_metric
from toros_fem.command_line import command_line, last_line
from toros_fem.equilibrium.solver import EquilibriumError
from toros_fem.mechanics.supports import Supports, symmetry_plane
from toros_fem.meshes import Pattern, curl, finger, plane_centroids
from toros_fem.objectives.gap import Body
from toros_fem.objectives.metrics import Metric

DEFAULTS: dict[str, Any] = {
    "shape": "sphere",  # or "box"
    "size": 0.04,  # m, diameter or edge
    "finger_length": 0.09,  # m
    "finger_width": 0.025,  # m
    "root": 0.015,  # m, in the mount
    "backbone": 6e-3,  # m, width of a line that is printed along the inner panel in any case
    "edge_length": 1.2e-3,  # m
    "depth": 0.016,  # m, of the inflated finger where it is straight, a first guess
    "wrap": 90.0,  # degrees by which the finger goes around the object
    "tail": 0.015,  # m of the finger that is to lie straight under a box
    "sections": 8,  # of the finger
    "place": 0.05,  # weight of the finger's centre line, over that of its orientation
    "lever": 0.02,  # m; the tip off by 0.1 rad counts as if all were off by 2 mm
    "touch": 5.0,  # weight of the inner panel's distance from the object
    "mass": 0.03,  # kg, of the object
    "seams": "hinged",
    "pressure": 10e3,
}
COARSE = {"edge_length": 2.4e-3, "radius": 3.7e-3, "iterations": 40, "constrained": 30}
ALONG, TOWARD = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
STRIP = 1 / 3  # of the width that is to lie on the object


def begin_of(inputs: dict[str, Any]) -> float:
    """Where the finger begins to bend, in m from its root, so that its tip ends as it should.

    The inner panel keeps its length: it goes around the object's own radius.
    """
    o = inputs
    tail = o["tail"] if o["shape"] == "box" else 0.0
    radius = Body(o["shape"], o["size"], (0.0, 0.0, 0.0)).radius
    return float(o["finger_length"] - tail - np.radians(o["wrap"]) * radius)


def body(inputs: dict[str, Any]) -> Body:
    """The object, beside the straight finger, round where this is to bend."""
    o, half = inputs, inputs["size"] / 2
    radius = Body(o["shape"], o["size"], (0.0, 0.0, 0.0)).radius
    return Body(o["shape"], o["size"], (begin_of(o) + radius - half, 0.0, half + o["depth"] / 2))


def strip(pattern: Pattern, inputs: dict[str, Any]) -> npt.NDArray[np.bool_]:
    """Vertices of the inner panel that are to touch: a strip along its middle, from the bend on."""
    o, inner = inputs, np.zeros(len(pattern.points), dtype=bool)
    inner[pattern.vertices_of("top")] = True
    begin = begin_of(o)
    x, y, _ = pattern.points.T
    end = o["finger_length"] - o["finger_width"] / 4
    return np.asarray(inner & (x > begin) & (x < end) & (np.abs(y) < STRIP * o["finger_width"] / 2))


def gap_metric(inputs: dict[str, Any]) -> Metric:
    """Mean distance in mm of the strip from the object, inside or outside, by flat area."""
    thing = body(inputs)

    def measure(pattern: Pattern, positions: npt.NDArray[np.float64]) -> float:
        inner = strip(pattern, inputs)
        distance, _ = thing.distance(positions[inner])
        return float(1e3 * np.average(np.abs(distance), weights=pattern.vertex_areas[inner]))

    return Metric("gap", "mm", 0.0, measure)


def scene(comm: MPI.Comm, inputs: dict[str, Any]) -> ActuatorCase:
    """Half a finger, what is held of it, and what it is to become."""
    o, thing = inputs, body(inputs)
    pattern = finger(
        comm,
        o["edge_length"],
        length=o["finger_length"],
        width=o["finger_width"],
        root=o["root"],
        planes=(1,),
    )
    bend = np.radians(o["wrap"])
    target = curl(
        bend,
        bend * thing.radius,
        origin=(begin_of(o), 0, o["depth"] / 2),
        along=ALONG,
        toward=TOWARD,
    )
    goal = target(pattern.points)
    turned = tip_angle_metric(0.0, ALONG, TOWARD, o["root"])
    inner = pattern.panel == pattern.panel_index("top")
    across = np.abs(plane_centroids(pattern)[:, 1])
    fixed = np.zeros((len(pattern.points), 3), dtype=bool)
    fixed[pattern.points[:, 0] <= o["root"] * (1 + 1e-9)] = True
    return ActuatorCase(
        pattern=pattern,
        target=goal,
        supports=Supports(fixed) | symmetry_plane(pattern, 1),
        passive=np.where(inner & (across < o["backbone"] / 2), 1.0, np.nan),
        metrics=(gap_metric(o), replace(turned, target=turned.measure(pattern, goal))),
        sections=limb_cross_sections(
            pattern, ALONG, o["root"], o["sections"], o["place"], o["lever"]
        ),
        grasp=(thing, strip(pattern, o).astype(float), o["touch"]),
        # Which side is to stretch is told; otherwise the start knows neither up nor down.
        start=np.where(inner, 0.65, 0.35),
        symmetry=(1,),
    )


def run(comm: MPI.Comm, output: Path, *, verbose: bool = False, **inputs: Any) -> dict[str, Any]:
    """Design the finger; returns the summary, with what the object's weight does under "load".

    Args:
        comm: Communicator.
        output: Folder for summary, history, pattern, fields and pictures.
        verbose: Whether to print every step of the equilibrium solver.
        inputs: What differs from `DEFAULTS` and `toros_fem.scene.ActuatorConfig`.
    """
    begin = time.perf_counter()
    o = merged(DEFAULTS, inputs)
    made = scene(comm, o)
    done = design(comm, output, made, o, begin=begin, verbose=verbose)
    return {**done.summary, "load": loaded(comm, output, o, made, done)}


def loaded(
    comm: MPI.Comm, output: Path, o: dict[str, Any], made: ActuatorCase, done: ActuatorResult
) -> dict[str, Any]:
    """The printed finger with a third of the object's weight on it, along the finger."""
    pattern, shown = made.pattern, done.printed.evaluation or done.result.final
    problem = done.problem
    skin, solver = problem.solver.skin, problem.solver
    touching = strip(pattern, o)
    # Half a finger bears a sixth of it; it hangs where the finger has gone around.
    share = pattern.vertex_areas * touching * (pattern.points[:, 0] > o["finger_length"] - 0.02)
    force = np.outer(share / share.sum(), [o["mass"] * 9.81 / 6, 0, 0])
    try:
        found = solver.solve(
            shown.projected,
            shown.equilibrium.pressures,
            force=force,
            start=shown.equilibrium.positions,
        )
    except EquilibriumError as caught:  # raised by all ranks or by none
        return {"mass_kg": o["mass"], "failure": str(caught)}
    free = skin.gather_vertices(shown.equilibrium.positions)
    under = skin.gather_vertices(found.positions)
    sag = np.average((under - free)[:, 0], weights=share)
    gap = made.metrics[0].measure(pattern, under)
    metrics = {"mass_kg": o["mass"], "sag_mm": 1e3 * float(sag), "gap_mm": gap}
    whole = problem.whole
    assert whole is not None
    write_grasp(comm, output, whole.pattern.triangles, whole.at_vertices(free),
                done.printed.cells.astype(float), body(o), metrics)  # fmt: skip
    return metrics


def sentence(summary: dict[str, Any]) -> str:
    """The result in words."""
    load = summary["load"]
    fixed = f"{1e3 * load['mass_kg']:.0f} g "
    fixed += f"sag by {load['sag_mm']:.1f} mm" if "sag_mm" in load else "are not held"
    return f"{last_line(summary)}; {fixed}"


if __name__ == "__main__":
    sys.exit(
        command_line(
            MPI.COMM_WORLD, __doc__, run, DEFAULTS, COARSE, Path("output/gripper"), sentence
        )
    )
