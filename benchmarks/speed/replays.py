"""Recorded solves: densities, loads and starts that are the same in every state of the code.

Densities are made from the numbers of the triangles, meshes are structured, and nothing but the
public names of the package is used: so this file runs with another checkout too, which the
environment names. A warm solve starts from the equilibrium of a neighbouring design, in a solver
that knows it; finding that is not timed.

    PYTHONPATH=CHECKOUT python benchmarks/speed/replays.py

reads names of replays, one in a line, and answers each with a line of JSON.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from mpi4py import MPI

import toros_fem as tf

LENGTH, DIAMETER = 0.15, 0.02  # m, of the tube
ANSWER = "ANSWER "


@dataclass(frozen=True)
class Replay:
    """One solve.

    Attributes:
        edge: Edge length of the tube in m.
        density: Returns the densities from the pattern.
        pressure: In Pa.
        before: Densities of the equilibrium that it starts from; None starts cold.
        trial: Whether it is solved as a step of a design is: a trial, then the rest.
        options: Of the materials; bending for instance.
        floor: Whether the tube swells against a floor.
    """

    edge: float
    density: Callable[[Any], Any]
    pressure: float = 5e3
    before: Callable[[Any], Any] | None = None
    trial: bool = False
    options: dict[str, Any] = field(default_factory=dict)
    floor: bool = False


def plain(pattern: Any) -> Any:
    """Fabric alone."""
    return np.zeros(len(pattern.panel))


def helix(pattern: Any) -> Any:
    """Three stiff lines around the tube."""
    u, v = pattern.centroids.T
    around = u / (np.pi * DIAMETER) * 3 + v / LENGTH
    return (around % 1 < 0.25).astype(float)


def grey(pattern: Any) -> Any:
    """Noise by the number of the triangle."""
    return np.modf(0.5 + 43.758 * np.sin(12.9898 * np.arange(len(pattern.panel))))[0] % 1


def spine(pattern: Any, wave: float = 0.0) -> Any:
    """A grey strip along the tube, with a wave on it by the number of the triangle."""
    x, y, _ = pattern.points[pattern.triangles].mean(axis=1).T
    strip = 0.6 * np.exp(-((np.arctan2(y, x) / 0.8) ** 4)) + 0.1
    return np.clip(strip + wave * np.sin(np.arange(len(strip))), 0, 1)


def moved(pattern: Any) -> Any:
    """The neighbour of `spine`, as a step of a design leaves it."""
    return spine(pattern, 0.03)


COARSE, FINE = 2.85e-3, 1.4e-3
REPLAYS = {
    "cold, plain": Replay(COARSE, plain),
    "cold, membrane": Replay(COARSE, plain, options={"bending": None}),
    "warm": Replay(COARSE, moved, before=spine),
    "cold, helix": Replay(COARSE, helix, 10e3),
    "cold, grey": Replay(COARSE, grey),
    "cold, strip": Replay(COARSE, spine),
    "trial": Replay(COARSE, moved, before=spine, trial=True),
    "contact": Replay(2 * COARSE, plain, floor=True),
    "warm, fine": Replay(FINE, moved, before=spine),
    "trial, fine": Replay(FINE, moved, before=spine, trial=True),
}
QUICK = tuple(REPLAYS)[:3]


@cache
def _pattern(edge: float) -> Any:
    return tf.meshes.cylinder(MPI.COMM_SELF, LENGTH, DIAMETER, edge, mesh="structured")


def _solver(replay: Replay) -> Any:
    pattern = _pattern(replay.edge)
    contact = None
    if replay.floor:
        contact = tf.Contact(ground=tf.Ground((-0.0112, 0.0, 0.0), (1.0, 0.0, 0.0)))
    skin, composite = tf.sew(MPI.COMM_SELF, pattern), tf.Composite(**replay.options)
    return tf.EquilibriumSolver(skin, composite, tf.clamp(pattern, ["base"]), contact=contact)


@cache
def _begin(edge: float, density: Callable[[Any], Any], pressure: float) -> Any:
    """Return the equilibrium that warm solves start near to."""
    solver = _solver(Replay(edge, density))
    cells = solver.skin.owned_cells
    return solver.solve(density(_pattern(edge))[cells], pressure).state


def play(name: str) -> dict[str, float]:
    """Solve one replay in a solver of its own; return its CPU seconds, counts and result."""
    replay = REPLAYS[name]
    pattern, solver = _pattern(replay.edge), _solver(replay)
    cells, start = solver.skin.owned_cells, None
    density = replay.density(pattern)[cells]
    if replay.before is not None:
        near = _begin(replay.edge, replay.before, replay.pressure)
        before = replay.before(pattern)[cells]
        start = solver.solve(before, replay.pressure, start=near.copy()).state
    solves = _counted(solver)
    begin = time.process_time()
    result = solver.solve(density, replay.pressure, start=start, trial=replay.trial)
    steps, factorisations = result.steps, result.factorisations
    if replay.trial:
        result = solver.finish(result)
        steps, factorisations = steps + result.steps, factorisations + result.factorisations
    seconds = time.process_time() - begin
    return {
        "seconds": seconds,
        "Newton steps": steps,
        "factorisations": factorisations,
        "linear solves": solves[0],
        "triangles": len(pattern.triangles),
        "residual": result.residual,
        "volume": result.volume,
    }


def _counted(solver: Any) -> list[int]:
    """Return a list whose one number grows with each solution of a linear system."""
    factor, count = solver._factor, [0]
    solve = factor.solve

    def counted(*given: Any, **named: Any) -> Any:
        count[0] += 1
        return solve(*given, **named)

    factor.solve = counted
    return count


def main() -> None:
    """Answer the replays that the standard input names."""
    print(f"{ANSWER}{json.dumps({'package': tf.__file__})}", flush=True)
    for line in sys.stdin:
        try:
            found: dict[str, Any] = play(line.strip())
        except Exception as error:  # the other side is to know it
            found = {"failure": f"{type(error).__name__}: {error}"}
        print(f"{ANSWER}{json.dumps(found)}", flush=True)


if __name__ == "__main__":
    main()
