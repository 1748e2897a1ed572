"""A case: its objective, and that a part of a symmetric skin is designed as the whole."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from mpi4py import MPI

from toros_fem.base.errors import PanelError
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.fields import random_density
from toros_fem.design.loop.loop import optimize
from toros_fem.design.loop.options import Stage
from toros_fem.design.loop.shape_design import ShapeProblem
from toros_fem.making.as_printed import as_printed, printed_lines
from toros_fem.measures.cross_sections import (
    CrossSectionObjective,
    CrossSections,
    label_cross_sections,
)
from toros_fem.measures.regions import Body, GapObjective
from toros_fem.measures.shape import Nodes, Part, ShapeObjective, ShapePart
from toros_fem.mechanics.skin.dead_loads import point_force
from toros_fem.mechanics.skin.supports import Supports, clamp, pin
from toros_fem.meshes import WALKER, Pattern, Skin, bend, cylinder, stand, walker
from toros_fem.products.actuators.legs import rest_on_body
from toros_fem.products.actuators.scene import ActuatorScene
from toros_fem.products.tubes import SectionTubeScene, bend_metric

LEG = ActuatorScene.of(
    seams="hinged",
    filter_radius=0.011,
    pressure=4e3,
    constrained_iterations=0,
)


@pytest.fixture(scope="module")
def quarter(alone: MPI.Comm) -> Pattern:
    return walker(alone, 7e-3, planes=(0, 1))


def leg_problem(
    comm: MPI.Comm, pattern: Pattern, planes: tuple[int, ...], supports: Supports
) -> ShapeProblem:
    """A leg to be turned down, on a part or on the whole."""
    target = stand(1.0, 0.03, directions=WALKER.directions, root=WALKER.root)
    case = Case(pattern, target(pattern.points), supports, 4e3, metrics=(), symmetry=planes)
    case = replace(case, composite=LEG.material.composite)
    return LEG.problem(comm, case, LEG.finest_level)


def test_a_part_is_printed_whole(alone: MPI.Comm, quarter: Pattern) -> None:
    supports = rest_on_body(quarter, WALKER.body_radius, (0, 1))
    problem = leg_problem(alone, quarter, (0, 1), supports)
    skin = problem.solver.skin
    result = optimize(problem, [Stage(2)], start=random_density(skin, 1))
    made = as_printed(problem, result)
    on = made.evaluation.problem
    assert made.pattern is on.whole.pattern
    for region in made.regions:
        for flip in ([-1, 1], [1, -1]):
            there = np.array(region.bounds).reshape(2, 2)
            assert np.sort(there * flip, axis=0) == pytest.approx(there, abs=1e-9)
    cells = made.cells[: len(on.skin.pattern.panel)]
    assert np.array_equal(made.cells, on.whole.at_cells(cells.astype(float)) > 0)
    part = on.skin.gather_cells(made.evaluation.projected)
    drawn = sum(region.area for region in made.regions) / 4
    assert on.skin.pattern.areas @ part == pytest.approx(drawn, rel=1e-3)
    assert (np.abs(part - cells) > 0.5).mean() < 0.02


def test_objective_is_the_sum_of_its_parts(short_tube: Skin) -> None:
    tube, pattern = short_tube, short_tube.pattern
    target = pattern.points * [1.0, 1.0, 1.1]
    labels = label_cross_sections(pattern, pattern.vertices_of("wall"), (0, 0, 1), 3)
    sections = CrossSections(labels, np.ones((4, 3)), np.ones(4))
    touching, body = np.ones(len(pattern.points)), Body("sphere", 0.03, (0.0, 0.0, 0.1))
    weights = 1.0 + np.arange(len(pattern.points)) / len(pattern.points)
    case = Case(pattern, target, clamp(pattern, ["base"]), 4e3)
    positions = (1.2 * pattern.points)[tube.owned_vertices]
    terms = {
        "shape": ShapeObjective(tube, target).forward(positions),
        "weighted": ShapeObjective(tube, target, weights).forward(positions),
        "sections": CrossSectionObjective(tube, target, sections).forward(positions),
        "gap": GapObjective(tube, body, touching, 2.0).forward(positions),
    }

    def gap(nodes: Nodes, target: np.ndarray) -> GapObjective:
        return GapObjective(nodes, body, touching, 2.0)

    parts: dict[str, Part] = {
        "shape": ShapePart(),
        "weighted": ShapePart(weights),
        "sections": sections,
        "gap": gap,
    }
    for names in (["shape"], ["sections"], ["gap", "weighted"], ["sections", "weighted"]):
        made = replace(case, parts=[parts[name] for name in names]).objective(tube)
        total = sum(terms[name] for name in names)
        assert made.forward(positions) == pytest.approx(total, rel=1e-12)


def test_a_case_whose_mesh_follows_lines(alone: MPI.Comm) -> None:
    """Targets are those of the vertices; the print of lines on half a tube is that of the whole."""
    config = SectionTubeScene.of(length=0.06, edge_length=3e-3, filter_radius=6e-3, pressure=4e3)
    target = bend(np.radians(60), 0.06, neutral=0.01)
    level = config.finest_level
    case = config.tube_case(alone, level, target, [bend_metric(60.0)], (1,))
    corners = case.pattern.corners[case.pattern.cells_of("wall")]
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    rings = [shapely.box(low[0], v, high[0], v + 4e-3) for v in (0.01, 0.03)]
    rings = shapely.union_all([*rings, shapely.box(low[0] + 0.01, 0.01, low[0] + 0.014, 0.034)])
    regions = [rings if name == "wall" else shapely.Polygon() for name in case.pattern.panel_names]
    found = case.following(alone, regions)
    assert np.abs(found.goal - target(found.pattern.points)).max() < 0.02 * 3e-3
    problem = config.problem(alone, found, level)
    printed = printed_lines(problem, case.pattern, regions)
    assert printed.evaluation is not None
    assert printed.pattern is problem.whole.pattern, "its mesh has been that of the print"
    exact = 2 * rings.area / printed.pattern.areas[printed.pattern.cells_of("wall")].sum()
    wall = printed.pattern.cells_of("wall")
    areas = printed.pattern.areas[wall]
    assert areas @ printed.cells[wall] / areas.sum() == pytest.approx(exact, rel=0.01)
    assert printed.after.lines.smallest.width == pytest.approx(4e-3, rel=1e-3)
    with pytest.raises(PanelError, match="1 regions for 3 panels"):
        case.following(alone, regions[:1])


def test_forces_and_pins_are_carried_to_the_mesh_of_a_print(alone: MPI.Comm) -> None:
    """The total and the moment stay; in place of a pinned vertex the nearest one is held."""
    tube = cylinder(alone, 0.06, 0.02, 4e-3)
    force = point_force(tube, (0.01, 0.0, 0.021), (1.0, 0.2, -0.3))
    case = Case(tube, tube.points, pin(tube), 4e3, metrics=(), force=force)
    regions = [shapely.Polygon() for _ in tube.panel_names]
    wall = tube.panel_index("wall")
    low = np.array(tube.outline(wall).bounds[:2])
    regions[wall] = shapely.box(*(low + [5e-3, 5e-3]), *(low + [9e-3, 40e-3]))
    found = case.following(alone, regions)
    assert found.force.sum(axis=0) == pytest.approx([1.0, 0.2, -0.3], rel=1e-9)
    moments = [np.cross(p.pattern.points, p.force).sum(axis=0) for p in (case, found)]
    assert moments[1] == pytest.approx(moments[0], abs=2e-4)
    assert np.array_equal(found.supports.fixed.sum(axis=0), case.supports.fixed.sum(axis=0))
    found.supports.require_no_rigid_motion(found.pattern)
