"""A skin, its pressures and its target as a design problem."""

import numpy as np
from helpers.designs import shape_design
from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.design.loop.problem import Evaluation
from toros_fem.design.loop.shape_design import ShapeProblem, carried_along
from toros_fem.measures.metrics import bend_angle
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.skin.supports import clamp
from toros_fem.meshes import bend, cylinder
from toros_fem.meshes.moving import with_flat_points


def test_shape_derivatives_are_those_of_moved_meshes(comm: MPI.Comm) -> None:
    """Lines of a tube move on its flat panel, across the seam too; each end is solved anew."""
    tube = cylinder(comm, 0.06, 0.02, 4.5e-3)
    design = shape_design(
        comm,
        tube,
        target=bend(np.radians(60), 0.06, neutral=0.01),
        supports=clamp(tube, ["base"]),
        pressure=5e3,
        printed_panels=["base", "tip"],
        filter_radius=9e-3,
        length_scale=None,
    )
    density = np.where(tube.centroids[:, 0] % 15e-3 < 6e-3, 1.0, 0.0)

    def simulated(problem: ShapeProblem) -> Evaluation[Equilibrium]:
        return problem.simulate_binary(density[problem.skin.owned_cells])

    def values(positions: Floats) -> Floats:
        means = [positions[part].mean(axis=0) for part in (tip, middle)]
        return np.array([bend_angle(tube, positions, sections=6), *np.concatenate(means)])

    middle = np.abs(tube.points[:, 2] - 0.02) < 6e-3
    tip, wall = tube.vertices_of("tip"), tube.panel_of_point == tube.panel_index("wall")
    inside = np.ones(len(tube.points), dtype=bool)
    for name in ("base", "tip"):
        inside[tube.vertices_of(name)] = False
    z, way = tube.points[:, 2] / 0.06, np.random.default_rng(3).normal(size=(len(tube.points), 2))
    smooth = np.stack([np.sin(np.pi * z), np.sin(2 * np.pi * z)], axis=1)
    moves = [
        2e-3 * (inside[:, None] * each)[tube.sewn] * wall[:, None] for each in (smooth, way / 10)
    ]
    base = simulated(design)
    found = design.shape_derivatives(base, moves, values)
    step = 0.02
    for move, rates in zip(moves, found.T, strict=True):
        ends = []
        for sign in (1, -1):
            moved = design.on(with_flat_points(tube, tube.flat_points + sign * step * move))
            here = simulated(moved).equilibrium.positions
            here = moved.skin.gather_vertices(here)
            ends.append(values(here - sign * step * carried_along(moved.skin.pattern, here, move)))
        expected = (ends[0] - ends[1]) / (2 * step)
        assert np.abs(rates - expected).max() < 5e-3 * np.abs(expected).max()
        assert np.abs(expected).max() > 1e-4
