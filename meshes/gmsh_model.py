"""A model of gmsh whose session, options and models of others are left as they were."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from threading import RLock
from typing import Any

import numpy as np

from toros_fem.base.array_types import Floats, Ints
from toros_fem.meshes.triangles import flat_areas

NAME = "toros_fem"
# gmsh has one current model in a process.
_ALONE = RLock()


@contextmanager
def gmsh_model(edge_length: float, options: Mapping[str, float] | None = None) -> Iterator[Any]:
    """Open an empty model whose mesh has edges of a length in m, and drop it (one rank).

    It yields the module `gmsh`; other threads wait until the model is dropped. The options are
    further ones, by their names.
    """
    with _ALONE:
        yield from _model(edge_length, options or {})


def _model(edge_length: float, options: Mapping[str, float]) -> Iterator[Any]:
    import gmsh  # here, because it is slow, and structured meshes do not need it

    ours = not gmsh.isInitialized()
    if ours:
        gmsh.initialize(["-noenv"], readConfigFiles=False, interruptible=False)
    current = "" if ours else gmsh.model.getCurrent()
    wanted = {
        "General.Terminal": 0, "General.NumThreads": 1, "Mesh.Algorithm": 6, "Mesh.RandomSeed": 1,
        "Mesh.MeshSizeMin": edge_length, "Mesh.MeshSizeMax": edge_length, **options,
    }  # fmt: skip
    before = {name: gmsh.option.getNumber(name) for name in wanted}
    try:
        for name, value in wanted.items():
            gmsh.option.setNumber(name, value)
        gmsh.model.add(NAME)
        try:
            yield gmsh
        finally:
            gmsh.model.setCurrent(NAME)
            gmsh.model.remove()
    finally:
        for name, value in before.items():
            gmsh.option.setNumber(name, value)
        if ours:
            gmsh.finalize()
        elif current:
            gmsh.model.setCurrent(current)


def meshed(gmsh: Any) -> tuple[Floats, Ints, Ints]:
    """Mesh the surfaces of the current model.

    Returned are the points (n, 3) that triangles use, the triangles (t, 3), and the edges on the
    model's curves whose ends are among the points, (k, 2).
    """
    gmsh.model.mesh.generate(2)
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    corners = gmsh.model.mesh.getElementsByType(2)[1]
    ends = gmsh.model.mesh.getElementsByType(1)[1].reshape(-1, 2)
    used, triangles = np.unique(corners, return_inverse=True)
    place = np.argsort(tags)[np.searchsorted(np.sort(tags), used)]
    ends = ends[np.isin(ends, used).all(axis=1)]
    return (
        np.asarray(coordinates, dtype=np.float64).reshape(-1, 3)[place],
        triangles.reshape(-1, 3).astype(np.int64),
        np.searchsorted(used, ends).astype(np.int64),
    )


def faces_mesh(
    corners: Floats, faces: Sequence[Sequence[Sequence[int]]], edge_length: float
) -> tuple[Floats, Ints, Ints]:
    """Mesh polygons with holes that share corners and sides (one rank: gmsh is serial).

    Each side stays one edge; inside, edges have the length in m whatever the sides have. A face is
    a list of rings of corners, numbers among (k, 2) in m, the outer one first. Returned are flat
    points (m, 2) in m, the corners first, counter-clockwise triangles (t, 3), and the face of each.
    """
    options = {"Mesh.MeshSizeExtendFromBoundary": 0, "Mesh.MeshSizeMin": 0.0}
    with gmsh_model(edge_length, options) as gmsh:
        geo = gmsh.model.geo
        points = [geo.addPoint(x, y, 0, edge_length) for x, y in corners]
        sides: dict[tuple[int, int], int] = {}

        def loop(ring: Sequence[int]) -> int:
            found = []
            for a, b in zip(ring, [*ring[1:], ring[0]], strict=True):
                if (b, a) not in sides:
                    sides[a, b] = geo.addLine(points[a], points[b])
                    geo.mesh.setTransfiniteCurve(sides[a, b], 2)
                found.append(sides[a, b] if (a, b) in sides else -sides[b, a])
            return int(geo.addCurveLoop(found))

        surfaces = [geo.addPlaneSurface([loop(ring) for ring in rings]) for rings in faces]
        geo.synchronize()
        gmsh.model.mesh.generate(2)
        tags, places, _ = gmsh.model.mesh.getNodes()
        ends = [gmsh.model.mesh.getElementsByType(2, tag)[1].reshape(-1, 3) for tag in surfaces]
    # A point of the model is the node of the same number.
    place = np.argsort(tags, kind="stable")
    flat = places.reshape(-1, 3)[place, :2]
    triangles = np.searchsorted(tags[place], np.concatenate(ends)).astype(np.int64)
    face = np.repeat(np.arange(len(faces)), [len(one) for one in ends])
    clockwise = flat_areas(flat[triangles]) < 0
    return flat, np.where(clockwise[:, None], triangles[:, ::-1], triangles), face
