"""A gripper of three fingers that close on a sphere or a box when inflated (paper Fig. 1).

    python demos/gripper.py --coarse
    python demos/gripper.py --coarse --shape box

Each finger is a flat one of two panels, clamped at its root in a mount; the three hang around the
object at 120°. Half a finger is designed, by symmetry. Its target is built from the object:
straight until it touches, then around it, at half a finger's thickness from its surface. The
distance of the inner panel from the object counts besides. What is printed is simulated again; the
gap that it leaves is reported, and what the object's weight changes when it hangs on the fingers.
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
from toros_fem.meshes import Pattern, curl, finger

from toros_fem.cli import command_line, last_line
from toros_fem.equilibrium import EquilibriumError
from toros_fem.grasp import Body
from toros_fem.grasp_report import write_grasp
from toros_fem.limb import limb_figure, limb_sections
from toros_fem.measure import Figure
from toros_fem.scene import Outcome, Scene, design, make_problem, merged, settings_of
from toros_fem.supports import Supports, symmetry_plane

DEFAULTS: dict[str, Any] = {
    "shape": "sphere",  # or "box"
    "size": 0.04,  # m, diameter or edge
    "finger_length": 0.09,  # m
    "finger_width": 0.025,  # m
    "root": 0.015,  # m, in the mount
    "edge_length": 1.2e-3,  # m
    "depth": 0.02,  # m, of the inflated finger between inner and outer side, a first guess
    "wrap": 90.0,  # degrees by which the finger goes around the object
    "sections": 8,  # of the finger
    "place": 0.05,  # weight of the finger's centre line, over that of its orientation
    "lever": 0.03,  # m; the tip off by 0.1 rad counts as if all were off by 3 mm
    "touch": 1.0,  # weight of the inner panel's distance from the object
    "mass": 0.03,  # kg, of the object
    "seams": "hinged",
    "pressure": 10e3,
}
COARSE = {"edge_length": 2.4e-3, "radius": 3.7e-3, "iterations": 40, "constrained": 30}
ALONG, TOWARD = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
STRIP = 1 / 3  # of the width that is to lie on the object


def body(inputs: dict[str, Any]) -> Body:
    """The object, beside the straight finger, where this is to begin to bend."""
    o = inputs
    half, thick = o["size"] / 2, o["depth"] / 2
    found = Body(o["shape"], o["size"], (0.0, 0.0, half + thick))
    around = found.radius + thick
    begin = o["finger_length"] - np.radians(o["wrap"]) * around
    # A box's bottom is as far below the bend's begin as its edges are round.
    middle = begin if o["shape"] == "sphere" else begin + found.radius - half
    return Body(o["shape"], o["size"], (float(middle), 0.0, half + thick))


def strip(pattern: Pattern, inputs: dict[str, Any]) -> npt.NDArray[np.bool_]:
    """Vertices of the inner panel that are to touch: a strip along its middle, from the bend on."""
    o, inner = inputs, np.zeros(len(pattern.points), dtype=bool)
    inner[pattern.vertices_of("top")] = True
    around = body(o).radius + o["depth"] / 2
    begin = o["finger_length"] - np.radians(o["wrap"]) * around
    x, y, _ = pattern.points.T
    end = o["finger_length"] - o["finger_width"] / 4
    return np.asarray(inner & (x > begin) & (x < end) & (np.abs(y) < STRIP * o["finger_width"] / 2))


def gap_figure(inputs: dict[str, Any]) -> Figure:
    """Mean distance in mm of the strip from the object, inside or outside, by flat area."""
    thing = body(inputs)

    def measure(pattern: Pattern, positions: npt.NDArray[np.float64]) -> float:
        inner = strip(pattern, inputs)
        distance, _ = thing.distance(positions[inner])
        return float(1e3 * np.average(np.abs(distance), weights=pattern.vertex_areas[inner]))

    return Figure("gap", "mm", 0.0, measure)


def scene(comm: MPI.Comm, inputs: dict[str, Any]) -> Scene:
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
    around = thing.radius + o["depth"] / 2
    bend = np.radians(o["wrap"])
    target = curl(
        bend,
        bend * around,
        origin=(o["finger_length"] - bend * around, 0, 0),
        along=ALONG,
        toward=TOWARD,
    )
    goal = target(pattern.points)
    turned = limb_figure(0.0, ALONG, TOWARD, o["root"])
    held = np.zeros((len(pattern.points), 3), dtype=bool)
    held[pattern.points[:, 0] <= o["root"] * (1 + 1e-9)] = True
    return Scene(
        pattern=pattern,
        target=goal,
        supports=Supports(held) | symmetry_plane(pattern, 1),
        figures=(gap_figure(o), replace(turned, asked=turned.measure(pattern, goal))),
        sections=limb_sections(pattern, ALONG, o["root"], o["sections"], o["place"], o["lever"]),
        grasp=(thing, strip(pattern, o).astype(float), o["touch"]),
        # Which side is to stretch is told; otherwise the start knows neither up nor down.
        start=np.where(pattern.panel == pattern.panel_index("top"), 0.65, 0.35),
        symmetry=(1,),
    )


def run(comm: MPI.Comm, output: Path, *, verbose: bool = False, **inputs: Any) -> dict[str, Any]:
    """Design the finger; returns the summary, with what the object's weight does under "load".

    Args:
        comm: Communicator.
        output: Folder for summary, history, pattern, fields and pictures.
        verbose: Whether to print every step of the equilibrium solver.
        inputs: What differs from `DEFAULTS` and `toros_fem.scene.Settings`.
    """
    begin = time.perf_counter()
    o = merged(DEFAULTS, inputs)
    made = scene(comm, o)
    done = design(comm, output, made, o, begin=begin, verbose=verbose)
    return {**done.summary, "load": loaded(comm, output, o, made, done)}


def loaded(
    comm: MPI.Comm, output: Path, o: dict[str, Any], made: Scene, done: Outcome
) -> dict[str, Any]:
    """The printed finger with a third of the object's weight on it, along the finger."""
    pattern, shown = made.pattern, done.printed.evaluation or done.result.final
    problem = make_problem(comm, made, settings_of(o))
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
    gap = made.figures[0].measure(pattern, under)
    figures = {"mass_kg": o["mass"], "sag_mm": 1e3 * float(sag), "gap_mm": gap}
    whole = problem.whole
    assert whole is not None
    write_grasp(comm, output, whole.pattern.triangles, whole.at_vertices(free),
                done.printed.cells.astype(float), body(o), figures)  # fmt: skip
    return figures


def sentence(summary: dict[str, Any]) -> str:
    """The result in words."""
    load = summary["load"]
    held = f"{1e3 * load['mass_kg']:.0f} g "
    held += f"sag by {load['sag_mm']:.1f} mm" if "sag_mm" in load else "are not held"
    return f"{last_line(summary)}; {held}"


if __name__ == "__main__":
    sys.exit(
        command_line(
            MPI.COMM_WORLD, __doc__, run, DEFAULTS, COARSE, Path("output/gripper"), sentence
        )
    )
