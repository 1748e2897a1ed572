"""One evaluation of a given design and two steps of MMA, for each kind of scene.

The keys of the tables are quantities. Where code is renamed, `figures_of` and its kin change; the
tables in tests/golden do not.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from helpers.designs import problem_of as scene_problem
from helpers.scenes import ROOT
from mpi4py import MPI

from toros_fem.design.loop.loop import optimize
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.design.loop.problem import DesignProblem, Evaluation, Slopes
from toros_fem.design.loop.shape_design import ShapeProblem
from toros_fem.design.relaxed.problem import FixedDirections, FreeDirections, relaxed_problem
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.trace import trace
from toros_fem.meshes import sew
from toros_fem.meshes.skin import Skin
from toros_fem.products import gripper, inflate, own_mesh, tubes
from toros_fem.products import walker as walking
from toros_fem.products.actuators.scene import ActuatorScene
from toros_fem.products.tiles import tile
from toros_fem.products.tiles.problem import tile_problem
from toros_fem.products.tubes import plain_tube

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("kept_meshes")]

TUBE: dict[str, Any] = {"edge_length": 5.5e-3, "filter_radius": 8.5e-3}
STAR: dict[str, Any] = {"edge_length": 3.6e-3, "filter_radius": 5.5e-3}
FINGER: dict[str, Any] = {"edge_length": 3e-3, "filter_radius": 4.6e-3}
HELD = own_mesh.Held(where="z < 4 mm")
ACTUATORS: dict[str, ActuatorScene] = {
    "bend": tubes.BendScene.of(**TUBE),
    "bend whole": tubes.BendScene.of(**TUBE, whole=True),
    "bend wrinkling": tubes.BendScene.of(**TUBE, wrinkling="tension-field", filter="helmholtz"),
    "bend knit bladder": tubes.BendScene.of(
        **TUBE, knit_ratio=3.0, bladder_thickness=3e-4, print_side="outside"
    ),
    "contract": tubes.ContractScene.of(**TUBE),
    "twist": tubes.TwistScene.of(**TUBE),
    "twist length": tubes.TwistScene.of(**TUBE, keep_length=True),
    "bend-twist": tubes.BendTwistScene.of(**TUBE),
    "walker": walking.WalkerScene.of(**STAR),
    "walker stride": walking.WalkerScene.of(**STAR, motion="crawl", aim="stride"),
    "gripper": gripper.GripperScene.of(**FINGER),
    "gripper box": gripper.GripperScene.of(**FINGER, shape="box"),
}
RELAXED: dict[str, FixedDirections | FreeDirections] = {
    "contract": FixedDirections(),
    "twist": FreeDirections(),
    "bend-twist": FreeDirections(),
}


def waves(skin: Skin) -> np.ndarray:
    """A smooth density of owned triangles, the same on any number of ranks."""
    middle = skin.pattern.points[skin.pattern.triangles].mean(axis=1)[skin.owned_cells]
    x, y, z = middle.T / 0.02
    return np.asarray(0.5 + 0.4 * np.sin(2 * x + 1) * np.cos(3 * y + z) * np.sin(1.5 * z + 0.5))


def problem_of(comm: MPI.Comm, name: str) -> ShapeProblem:
    return scene_problem(comm, ACTUATORS[name])


def state_figures(skin: Skin, found: Equilibrium) -> dict[str, Any]:
    vertices = skin.gather_vertices(found.positions)
    return {
        "energy in J": found.energy,
        "volumes in m3": list(found.volumes),
        "pressures in Pa": list(found.pressures),
        "stretch use": found.stretch_use,
        "smallest distance in m": found.smallest_distance,
        "positions in m": vertices,
    }


def figures_of(problem: DesignProblem, at: Evaluation, slopes: Slopes) -> dict[str, Any]:
    """Quantities of an evaluation with its gradients."""
    gather, found = problem.skin.gather_cells, at.equilibrium
    fields = slopes.gradient.reshape(len(problem.skin.owned_cells), -1)
    pressures = slopes.pressure_gradient
    figures = {
        "objective": at.objective,
        "shape term": at.shape,
        "perimeter in m": at.perimeter,
        "width constraints": None if at.length_scale is None else list(at.length_scale),
        "width slopes": [gather(slope) for slope in slopes.length_scale_gradients],
        "slope": gather(fields),
        "slope by pressure": None if pressures is None else list(pressures),
        "filtered": gather(at.filtered.reshape(fields.shape)),
        "reinforced": list(problem.fields.reinforcement(at.projected)),
        "residual slopes": [
            gather(row.reshape(fields.shape)) for row in slopes.residuals.gradients
        ],
        **problem.metrics_of(found),
    }
    if isinstance(found, Equilibrium):
        return figures | state_figures(problem.skin, found)
    return figures | {
        "stress in N/m": list(found.stress),
        "contraction": list(found.contraction),
        "shear": list(found.shear),
    }


def steps_figures(problem: DesignProblem, start: np.ndarray) -> dict[str, Any]:
    """Quantities of two steps of MMA, with the width constraints where there are any."""
    constrained = problem.length_scale is not None
    options = DesignOptions((Stage(2, constrained=constrained),))
    found = optimize(problem, options, start=start)
    fields = found.density.reshape(len(problem.skin.owned_cells), -1)
    rows = [
        {
            "objective": row.objective,
            "KKT": row.kkt if row.iteration else 0.0,
            "change": row.change,
            "rejected": row.rejected,
            "volume fraction": row.volume_fraction,
            "pressure in Pa": row.pressure,
        }
        for row in found.history
    ]
    return {"design": problem.skin.gather_cells(fields), "steps": rows, "reason": found.reason}


@pytest.mark.parametrize("name", list(ACTUATORS))
def test_actuator(comm: MPI.Comm, name: str, pinned: Callable[..., None]) -> None:
    problem = problem_of(comm, name)
    density = waves(problem.skin)
    pinned(f"evaluation/{name}", figures_of(problem, *problem.evaluate(density)))
    pinned(f"two_steps/{name}", steps_figures(problem, density), rel=1e-4)


@pytest.mark.parametrize("name", list(RELAXED))
def test_relaxed(comm: MPI.Comm, name: str, pinned: Callable[..., None]) -> None:
    problem = relaxed_problem(problem_of(comm, name), RELAXED[name], 0.015, 1e-3)
    start = problem.fields.start(5)
    at, slopes = problem.evaluate(start)
    cost = problem.terms[0].price * at.measures["shares"]
    figures = figures_of(problem, at, slopes) | {"cost of lines": cost}
    pinned(f"evaluation/relaxed_{name}", figures)
    pinned(f"two_steps/relaxed_{name}", steps_figures(problem, start), rel=1e-4)


def test_own_mesh(comm: MPI.Comm, pinned: Callable[..., None]) -> None:
    scene = own_mesh.OwnMeshScene.of(scale=1e-3, held=(HELD,), bend=60.0, cross_sections=6)
    mesh = ROOT / "demos" / "surfaces" / "finger.stl"
    problem = scene_problem(comm, scene.with_files(comm, {"mesh": mesh}))
    density = waves(problem.skin)
    pinned("evaluation/own_mesh", figures_of(problem, *problem.evaluate(density)))
    pinned("two_steps/own_mesh", steps_figures(problem, density), rel=1e-4)


@pytest.mark.parametrize("target", ["tetragonal", "auxetic", "anisotropic"])
def test_tile(comm: MPI.Comm, target: str, pinned: Callable[..., None]) -> None:
    config = tile.TileScene.of(
        target=target, edge_length=1e-3, filter_radius=1.5e-3, perimeter_weight=1e-3
    )
    problem = tile_problem(tile.tile_case(comm, config), config)
    x, y = 2 * np.pi * problem.skin.pattern.centroids.T / config.skin.size
    density = 0.5 + 0.25 * (np.cos(x) + np.sin(x + 2 * y))[problem.skin.owned_cells]
    density = np.clip(density, 0.02, 0.98)
    pinned(f"evaluation/{target}_tile", figures_of(problem, *problem.evaluate(density)))
    pinned(f"two_steps/{target}_tile", steps_figures(problem, density), rel=1e-4)


@pytest.mark.parametrize("wrinkling", [None, "tension-field"])
def test_inflated(comm: MPI.Comm, wrinkling: str | None, pinned: Callable[..., None]) -> None:
    config = inflate.InflateScene.of(edge_length=5.5e-3, mesh="structured", wrinkling=wrinkling)
    pattern, supports, density = plain_tube(comm, config.skin)
    skin = sew(comm, pattern)
    solver = EquilibriumSolver(skin, config.material.composite, supports)
    pressures = [2e2, 5e3, 10e3, 20e3]
    figures = {
        f"{point.result.pressure:g} Pa": state_figures(skin, point.result) | point.metrics
        for point in trace(solver, density[skin.owned_cells], pressures, inflate.METRICS)
    }
    pinned(f"evaluation/inflated_{wrinkling or 'plain'}", figures)
