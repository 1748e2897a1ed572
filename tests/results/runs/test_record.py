"""A design records its shapes while it runs, those of the whole skin."""

import dataclasses
from pathlib import Path

import numpy as np
from helpers.designs import make_problem
from helpers.scenes import shared
from mpi4py import MPI

from toros_fem.design.loop.loop import optimize
from toros_fem.design.loop.options import Stage
from toros_fem.measures.cross_sections import CrossSections, label_cross_sections
from toros_fem.measures.miss import AlignedObjective, MirroredObjective, compared_axes, is_aligned
from toros_fem.measures.regions import Body, GapObjective
from toros_fem.measures.shape import Nodes, ShapeObjective, SumObjective
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.meshes import Skin, bend, cylinder, mirrored, sew
from toros_fem.results.reporter import DesignReporter
from toros_fem.results.runs.frames import read_frames, read_skin
from toros_fem.results.runs.record import repeated


def test_steps_are_on_disk_with_their_shape(
    comm: MPI.Comm, tmp_path: Path, tube: Skin, tube_solver: EquilibriumSolver
) -> None:
    folder = shared(comm, tmp_path) / "run"
    target = bend(np.radians(60), 0.06, neutral=0.01)(tube.pattern.points)
    problem = dataclasses.replace(make_problem(tube, tube_solver), target=target)
    with DesignReporter(comm, folder) as reporter:
        result = optimize(problem, [Stage(1)], seed=3, callback=reporter)
    frames = read_frames(folder / "frames", "iteration")
    comm.barrier()
    assert [frame.number for frame in frames] == [0, 1]
    last, row = frames[-1], result.history[-1]
    assert last.values["objective"] == row.objective
    positions = tube.gather_vertices(result.final.equilibrium.positions)
    assert np.abs(last.positions - positions).max() < 1e-8
    assert last.density is not None
    assert np.allclose(last.density, tube.gather_cells(result.final.projected), atol=1e-7)
    skin = read_skin(folder / "frames" / last.skin)
    assert np.array_equal(skin.pattern.triangles, tube.pattern.triangles)
    assert skin.target is not None
    assert np.array_equal(skin.target, target)
    assert skin.passive is not None
    assert np.isnan(skin.passive).sum() == len(tube.pattern.cells_of("wall"))
    assert skin.compared == (True, True, True)


def test_copies_of_a_skin_are_one_pattern(tube: Skin) -> None:
    pattern = tube.pattern
    three, regions = repeated(pattern, ["a", "b", "c"], 3)  # type: ignore[list-item]
    count = len(pattern.points)
    assert len(three.points) == 3 * count
    assert np.array_equal(three.triangles[-len(pattern.triangles) :], pattern.triangles + 2 * count)
    assert len(three.panel_names) == 3 * len(pattern.panel_names)
    assert len(set(three.panel_names)) == len(three.panel_names)
    assert regions == ["a", "b", "c"] * 3
    assert np.allclose(three.areas.sum(), 3 * pattern.areas.sum())


def test_what_a_design_compares_is_known(comm: MPI.Comm, tube: Skin) -> None:
    """Of sums, of aligned and of mirrored objectives too; a small weight counts as none.

    Whether it is compared after a rigid motion is seen through mirrors and sums too.
    """
    target, count = tube.pattern.points, len(tube.pattern.points)
    every = np.arange(count)
    whole = ShapeObjective(tube, target)
    height = ShapeObjective(tube, target, np.tile([0.0, 0.0, 1.0], (count, 1)))
    labels = label_cross_sections(tube.pattern, every, (0, 0, 1), 3, border=False)
    across = np.tile([1.0, 1.0, 0.0], (3, 1)) / 3
    sections = CrossSections(labels, across, np.ones(3))(tube, target)
    leg = CrossSections(labels, 0.02 * across, np.ones(3))(tube, target)
    half = sew(comm, cylinder(comm, 0.06, 0.02, 6e-3, planes=(1,)))
    images = mirrored(half.pattern, (1,))
    goal = images.pattern.points

    def moved(nodes: Nodes) -> ShapeObjective:
        return ShapeObjective(nodes, goal)

    parts = MirroredObjective(half, images, moved)
    aligned = AlignedObjective(tube, target, sections)
    gap = GapObjective(tube, Body("sphere", 0.01, (0, 0, 0.1)), np.ones(count))
    for objective, found in (
        (whole, (True, True, True)),
        (height, (False, False, True)),
        (sections, (True, True, False)),
        (leg, (False, False, False)),
        (SumObjective(height, leg), (False, False, True)),
        (aligned, (True, True, False)),
        (parts, (True, True, True)),
        (gap, (False,) * 3),
    ):
        assert compared_axes(objective) == found
    both = MirroredObjective(
        half, images, lambda nodes: AlignedObjective(nodes, goal, moved(nodes))
    )
    for objective in (aligned, both, SumObjective(aligned, gap), SumObjective(aligned, leg)):
        assert is_aligned(objective)
    for objective in (whole, parts, gap, SumObjective(aligned, height), SumObjective(gap)):
        assert not is_aligned(objective)
