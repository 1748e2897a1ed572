"""Unstructured meshes of flat polygons, by gmsh."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from toros_fem.base.array_types import Floats, Ints
from toros_fem.meshes.triangle_limit import require_affordable
from toros_fem.meshes.triangles import flat_areas


def polygon_meshes(
    outlines: Sequence[tuple[Floats, Sequence[int]]], edge_length: float
) -> list[tuple[Floats, Ints]]:
    """Mesh flat polygons with a prescribed number of edges on each side.

    Call it on one rank: gmsh is serial. The sides are divided evenly, so that two sides of equal
    length and number of edges can be sewn together.

    Args:
        outlines: For each polygon its corners (k, 2) in m, counter-clockwise, and the number of
            edges on the side that starts at each corner.
        edge_length: Target edge length inside, in m.

    Returns:
        For each polygon flat points (m, 2) in m and counter-clockwise triangles (t, 3).

    Raises:
        MeshSizeError: There would be more triangles than the limit.
    """
    require_affordable(sum(_area(corners) for corners, _ in outlines), edge_length)
    import gmsh  # here, because it is slow, and structured meshes do not need it

    ours = not gmsh.isInitialized()
    if ours:
        gmsh.initialize(["-noenv"], readConfigFiles=False, interruptible=False)
    current = "" if ours else gmsh.model.getCurrent()
    results = []
    try:
        for name, value in (
            ("General.Terminal", 0),
            ("General.NumThreads", 1),
            ("Mesh.Algorithm", 6),
            ("Mesh.RandomSeed", 1),
            ("Mesh.MeshSizeMin", edge_length),
            ("Mesh.MeshSizeMax", edge_length),
        ):
            gmsh.option.setNumber(name, value)
        for corners, counts in outlines:
            gmsh.model.add("toros_fem panel")
            geo = gmsh.model.geo
            points = [geo.addPoint(x, y, 0, edge_length) for x, y in corners]
            lines = [geo.addLine(a, b) for a, b in zip(points, np.roll(points, -1), strict=True)]
            for line, count in zip(lines, counts, strict=True):
                geo.mesh.setTransfiniteCurve(line, int(count) + 1)
            geo.addPlaneSurface([geo.addCurveLoop(lines)])
            geo.synchronize()
            gmsh.model.mesh.generate(2)
            tags, coordinates, _ = gmsh.model.mesh.getNodes()
            nodes = gmsh.model.mesh.getElementsByType(2)[1].reshape(-1, 3)
            used, triangles = np.unique(nodes, return_inverse=True)
            place = np.argsort(tags)[np.searchsorted(np.sort(tags), used)]
            flat = coordinates.reshape(-1, 3)[place, :2]
            results.append((flat, _counter_clockwise(flat, triangles.reshape(-1, 3))))
            gmsh.model.remove()
    finally:
        if ours:
            gmsh.finalize()
        elif current:
            gmsh.model.setCurrent(current)
    return results


def _area(corners: Floats) -> float:
    x, y = corners.T
    return float(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2)


def _counter_clockwise(flat: Floats, triangles: Ints) -> Ints:
    clockwise = flat_areas(flat[triangles]) < 0
    return np.where(clockwise[:, None], triangles[:, ::-1], triangles).astype(np.int64)
