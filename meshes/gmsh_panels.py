"""Unstructured meshes of flat polygons, by gmsh."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from toros_fem.base.array_types import Floats, Ints
from toros_fem.meshes.triangles import flat_areas


def polygon_mesh(
    corners: Floats,
    edge_length: float,
    *,
    counts: Sequence[int] | None = None,
    faces: Sequence[Ints] | None = None,
) -> tuple[Floats, Ints]:
    """Mesh a flat polygon, or several ones that share corners and sides (one rank: gmsh is serial).

    The sides are divided evenly, so that two sides of equal length and number of edges can be sewn
    together.

    Args:
        corners: Corners (k, 2) in m.
        edge_length: Target edge length inside, in m.
        counts: Number of edges on the side that starts at each corner; None: one.
        faces: Corners of each polygon, counter-clockwise; None: one polygon, of all of them.

    Returns:
        Flat points (m, 2) in m and counter-clockwise triangles (t, 3).
    """
    import gmsh  # here, because it is slow, and structured meshes do not need it

    ours = not gmsh.isInitialized()
    if ours:
        gmsh.initialize(["-noenv"], readConfigFiles=False, interruptible=False)
    current = "" if ours else gmsh.model.getCurrent()
    options = {
        "General.Terminal": 0, "General.NumThreads": 1, "Mesh.Algorithm": 6, "Mesh.RandomSeed": 1,
        "Mesh.MeshSizeMin": edge_length, "Mesh.MeshSizeMax": edge_length,
    }  # fmt: skip
    before = {name: gmsh.option.getNumber(name) for name in options}
    try:
        for name, value in options.items():
            gmsh.option.setNumber(name, value)
        gmsh.model.add("toros_fem panel")
        geo = gmsh.model.geo
        points = [geo.addPoint(x, y, 0, edge_length) for x, y in corners]
        sides: dict[tuple[int, int], int] = {}
        for face in [np.arange(len(corners))] if faces is None else faces:
            loop = []
            for a, b in zip(face.tolist(), np.roll(face, -1).tolist(), strict=True):
                if (b, a) not in sides:
                    sides[a, b] = geo.addLine(points[a], points[b])
                    geo.mesh.setTransfiniteCurve(sides[a, b], 1 + (int(counts[a]) if counts else 1))
                loop.append(sides[a, b] if (a, b) in sides else -sides[b, a])
            geo.addPlaneSurface([geo.addCurveLoop(loop)])
        geo.synchronize()
        gmsh.model.mesh.generate(2)
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        nodes = gmsh.model.mesh.getElementsByType(2)[1]
        gmsh.model.remove()
    finally:
        for name, value in before.items():
            gmsh.option.setNumber(name, value)
        if ours:
            gmsh.finalize()
        elif current:
            gmsh.model.setCurrent(current)
    used, triangles = np.unique(nodes, return_inverse=True)
    place = np.argsort(tags)[np.searchsorted(np.sort(tags), used)]
    flat = np.asarray(coordinates).reshape(-1, 3)[place, :2]
    triangles = triangles.reshape(-1, 3).astype(np.int64)
    clockwise = flat_areas(flat[triangles]) < 0
    return flat, np.where(clockwise[:, None], triangles[:, ::-1], triangles)
