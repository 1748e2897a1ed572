"""The print of lines that come as polygons, simulated on a mesh of its own."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from shapely import affinity
from shapely.geometry.base import BaseGeometry

from toros_fem._types import Bools, Floats
from toros_fem.design.problem import DesignProblem, Evaluation, Pressure
from toros_fem.errors import PanelError
from toros_fem.fabrication.as_printed import PrintedDesign, print_regions
from toros_fem.fabrication.printability import DEFAULT_LIMITS, PrintLimits
from toros_fem.meshes.mirror import Mirrored
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.transfer import make_transfer, scaled_points

# Corners of regions that are joined across a cut lie on a grid of this fraction of the skin's size.
GRID = 1e-9


def printed_lines(
    problem: DesignProblem,
    pattern: Pattern,
    regions: Sequence[BaseGeometry],
    limits: PrintLimits = DEFAULT_LIMITS,
    *,
    island_area: float = 0.0,
    hole_area: float = 0.0,
    near: tuple[Pattern, Floats] | None = None,
    pressure: Pressure | None = None,
) -> PrintedDesign:
    """Clean, measure and simulate lines that come as polygons (collective).

    A triangle of the problem's mesh is printed if its centroid is. The error is that of a mesh
    whose edges follow the lines, `ActuatorCase.following`, and is given in docs/manufacture.md.

    Args:
        problem: The design problem, on the mesh that the print is simulated on.
        pattern: The pattern that the polygons belong to: the same panels on any mesh.
        regions: Polygons on each of its panels, in m.
        limits: Limits of the printer; narrower lines and gaps are listed.
        island_area: Free islands smaller than this, in m², are removed.
        hole_area: Holes smaller than this, in m², are filled.
        near: A pattern with the same panels and positions of all its vertices, (n, 3), in m, to
            start from: those of the relaxed design, or of the print on a coarser mesh. None starts
            from the assembled shape.
        pressure: In Pa, of all chambers or of each; None takes the problem's own.

    Raises:
        PanelError: The panels are others, or the number of regions is not theirs.
        ParameterError: An area is negative.
    """
    part, whole = problem.skin.pattern, problem.whole
    start = None
    if near is not None:
        start = problem.state_at(make_transfer(near[0], part).positions(near[1]))

    def contours() -> list[BaseGeometry]:
        found = regions_on(pattern, regions, part)
        return found if whole is None else mirrored_regions(part, whole, found)

    def simulate(cells: Bools) -> Evaluation:
        return problem.simulate_binary(cells, start=start, pressure=pressure)

    onto = part if whole is None else whole.pattern
    return print_regions(problem, onto, contours, simulate, limits, island_area, hole_area)


def regions_on(
    source: Pattern, regions: Sequence[BaseGeometry], target: Pattern
) -> list[BaseGeometry]:
    """Return polygons on the panels of another mesh of the same pattern.

    Where a panel has a slightly different size on it, the polygons are scaled.

    Args:
        source: The pattern that the polygons belong to.
        regions: Polygons on each of its panels, in m.
        target: The other mesh.

    Raises:
        PanelError: The panels are others, or the number of regions is not theirs.
    """
    if len(regions) != len(source.panel_names):
        raise PanelError(
            f"there are {len(regions)} regions for {len(source.panel_names)} panels; give one for "
            "each panel, an empty polygon where nothing is printed."
        )
    if sorted(source.panel_names) != sorted(target.panel_names):
        raise PanelError(
            f"the panels are named {list(source.panel_names)} and {list(target.panel_names)}; "
            "polygons can only be put on the same panels."
        )
    if source is target:
        return list(regions)
    there = scaled_points(source, target)
    found = []
    for name in target.panel_names:
        points = np.unique(target.flat_triangles[target.cells_of(name)])
        map_ = _affine(there[points], target.flat_points[points])
        found.append(affinity.affine_transform(regions[source.panel_index(name)], map_))
    return found


def mirrored_regions(
    part: Pattern, whole: Mirrored, regions: Sequence[BaseGeometry]
) -> list[BaseGeometry]:
    """Return polygons on each panel of a whole skin from those on its part.

    Args:
        part: The part.
        whole: The whole, by `meshes.mirrored`.
        regions: Polygons on each panel of the part, in m.
    """
    count = len(part.panel)
    pieces: list[list[BaseGeometry]] = [[] for _ in whole.pattern.panel_names]
    for image in range(len(whole.cell) // count):
        cells = slice(image * count, (image + 1) * count)
        corners, panels = whole.pattern.flat_triangles[cells], whole.pattern.panel[cells]
        for panel, region in enumerate(regions):
            here = np.flatnonzero(part.panel[whole.cell[cells]] == panel)
            points = np.unique(corners[here])
            map_ = _affine(part.flat_points[whole.flat[points]], whole.pattern.flat_points[points])
            pieces[panels[here[0]]].append(affinity.affine_transform(region, map_))
    grid = GRID * whole.pattern.size
    return [p[0] if len(p) == 1 else shapely.union_all(p, grid_size=grid) for p in pieces]


def _affine(source: Floats, target: Floats) -> list[float]:
    """Return the affine map between points (k, 2) as a, b, d, e, x, y of shapely."""
    middle = source.mean(axis=0)
    columns = np.column_stack([source - middle, np.ones(len(source))])
    found = np.linalg.lstsq(columns, target, rcond=None)[0]
    linear, offset = found[:2].T, found[2] - found[:2].T @ middle
    return [*linear.ravel().tolist(), *offset.tolist()]
