"""Discrete choices: steps of designs that are kept, rounds of corrections, ways of hard solves.

The scenes are those whose choices do not hang on rounding: the same on several kinds of BLAS.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.designs import problem_of
from helpers.scenes import shared
from mpi4py import MPI

from benchmarks.stability.drawn import draw
from toros_fem.mechanics.equilibrium.equilibrium import EquilibriumError
from toros_fem.mechanics.skin.load import Load
from toros_fem.meshes import plane_centroids, walker
from toros_fem.products import gripper
from toros_fem.products import walker as walking
from toros_fem.products.gait import Gait
from toros_fem.products.gripper_load import grip_of
from toros_fem.products.kinds import KINDS

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("kept_meshes", "without_pictures")]

LINES = {
    "length": 0.06,
    "cross_sections": 5,
    "relaxed_edge_length": 7e-3,
    "relaxed_iterations": 3,
    "laid_width": 3e-3,
    "print_edge_length": 3e-3,
    "corrections": 2,
    "curve_pressure": None,
}
DENSITIES = {
    "length": 0.045,
    "edge_length": 1.7e-3,
    "filter_radius": 2.7e-3,
    "levels": 2,
    "iterations": 10,
    "constrained_iterations": 4,
    "level_iterations": 3,
    "polish_iterations": 2,
    "curve_pressure": None,
}
DESIGNS: dict[str, tuple[str, dict[str, Any]]] = {
    "bend": ("bend", DENSITIES | {"angle": 55.0, "corrections": 1}),
    "contract": ("contract", LINES),
    "twist": (
        "twist",
        LINES | {"twist": 90.0, "density_iterations": 2, "corrections": 1, "estimate_error": False},
    ),
}


def choices(folder: Path) -> dict[str, Any]:
    """What was chosen in a run, from the files that it wrote."""
    with (folder / "history.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    names = ("level", "stage", "iteration", "beta", "rejected")
    steps = [" ".join(f"{float(row[name]):g}" for name in names) for row in rows]
    found = {"level, stage, step, beta, rejected": steps, "reason": summary["reason"]}
    found["islands"] = summary["manufacture"]["islands"]
    found["kept densities"] = float(summary.get("densities_kept", True))
    laid = summary.get("lines", {"rounds": [], "families": []})
    found["mended"] = [float(row["mended"]) for row in laid["rounds"]]
    found["lines"] = [family["lines"] for family in laid["families"]]
    told = [row for row in summary["figures"] if row["interval"] is not None]
    found["errors are told"] = sorted(f"{row['name']}_error_{row['unit']}" for row in told)
    return found


def check_design(comm: MPI.Comm, name: str, folder: Path, pinned: Callable[..., None]) -> None:
    kind, values = DESIGNS[name]
    scene: Any = KINDS[kind].of(**values)
    scene.run_design(comm, folder)
    comm.barrier()
    pinned(f"decisions/{name}", choices(folder))


@pytest.mark.parametrize("name", ["bend", "twist"])
def test_design_alone(name: str, tmp_path: Path, pinned: Callable[..., None]) -> None:
    check_design(MPI.COMM_SELF, name, tmp_path / name, pinned)


def test_design(comm: MPI.Comm, tmp_path: Path, pinned: Callable[..., None]) -> None:
    check_design(comm, "contract", shared(comm, tmp_path) / "contract", pinned)


@pytest.mark.parametrize("seed", [23, 24, 31, 36, 37, 38, 40, 41])
def test_hard_solve(seed: int, pinned: Callable[..., None]) -> None:
    """Steps by kind, retries with a shift and levels of load on the way to an equilibrium."""
    scene = draw(seed, few_terms=True)
    load = scene.load
    try:
        found = scene.solver().solve(
            scene.density[scene.skin.owned_cells], Load(list(load.pressures), force=load.force)
        )
    except EquilibriumError as error:
        found = error.result
    levels = [row.pressure for row in found.history if not row.step]
    figures = {
        "reached": found.load_factor,
        "energy in J": found.energy,
        "Newton steps": found.steps,
        "modified steps": found.modified_steps,
        "inexact steps": sum(row.kind == "cg" for row in found.history),
        "shifted steps": sum(row.shift > 0 for row in found.history),
        "halved steps": sum(0 < row.step < 1 for row in found.history),
        "factorisations": found.factorisations,
        "solves on the way": len(levels),
        "why it ended": found.reason.split("(")[0].split(" at ")[0],
        "what it is": " ".join(found.condition.sentences)[:60],
    }
    pinned(f"decisions/hard_solve_{seed}", figures)


def test_stride(pinned: Callable[..., None]) -> None:
    """Three equilibria of a walker on the ground, with pads."""
    pytest.importorskip("ipctk")
    config = walking.WalkerScene.of(edge_length=7e-3, pressure=10e3)
    half = walker(MPI.COMM_SELF, config.skin.edge_length, config.star, planes=(1,))
    reach = config.reach(plane_centroids(half))
    printed = (half.panel == half.panel_index("bottom")) & (reach > 0.02)
    gait = Gait(walking.CHAMBERS, np.array([[1.0, 1, 1], [0.4, 0.4, 0.4]]), 1)
    full = 3 * [config.pressure.pressure]
    walk = config.follow(MPI.COMM_SELF, gait, half, printed, full)
    figures = {
        "failure": walk.failure,
        "stride in m": walk.stride,
        "slip in m": walk.slip,
        "feet in m": walk.feet,
        "touching": walk.touching.astype(float),
        "energy supplied in J": walk.supplied_energy,
        "energy lost in J": walk.lost_energy,
        "smallest distances in m": [p.result.smallest_distance for p in walk.points],
        "Newton steps": [p.result.steps for p in walk.points],
    }
    pinned("decisions/stride", figures, rel=1e-5, small=1e-9)


def test_lift(pinned: Callable[..., None]) -> None:
    """The force by which printed fingers hold their object, over its depth."""
    pytest.importorskip("ipctk")
    config = gripper.GripperScene.of(
        edge_length=3e-3, filter_radius=4.6e-3, stem_length=0.045, slip_limit=5e-4,
        lift_distance=5e-4, mass=0.02,
    )  # fmt: skip
    problem = problem_of(MPI.COMM_SELF, config)
    pattern = problem.skin.pattern
    density = (pattern.panel == pattern.panel_index("top")).astype(np.float64)
    made = grip_of(MPI.COMM_SELF, problem, config).pull(density, [15e3], None)
    figures = {
        "depths in m": [point.depth for point in made.points],
        "forces in N": [point.force for point in made.points],
        "normal forces in N": [float(point.normals.sum()) for point in made.points],
        "Newton steps": [point.result.steps for point in made.points],
        "figures": vars(made.figures),
    }
    pinned("decisions/lift", figures, rel=1e-5, small=1e-9)
