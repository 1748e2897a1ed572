"""Print bodies: the polygons of a print extruded to its height, as STL and 3MF."""

from __future__ import annotations

import ctypes
import locale
import uuid
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.packages import required
from toros_fem.making.options import DEFAULT, ManufactureOptions
from toros_fem.making.panels.marks import cross_shapes
from toros_fem.making.panels.panel_drawing import PanelDrawing

# Corners lie on a grid of 0.1 µm, which single precision in mm resolves on beds of 1 m.
GRID = 1e-7
# Half the width in m of the cut that separates parts which touch at a point.
NICK = 5e-6
# Width of the lines of a printed cross, over its size.
CROSS_LINE = 0.2
# Name of the material of a print, and the colour it is shown in.
PRINT, COLOUR = "print", (30, 30, 30, 255)


PrintBody = tuple[str, Floats, Ints]
"""Name of a closed body, its vertices (n, 3) in m, and its triangles (t, 3), counter-clockwise seen
from outside."""


def print_bodies(
    drawings: Sequence[PanelDrawing], options: ManufactureOptions = DEFAULT
) -> list[PrintBody]:
    """Return the bodies to print on a bed: one for each panel with print, and one for its crosses.

    The crosses are bodies of their own, named "… registration", which a slicer can leave out. They
    show a cutter with a camera where the print lies.
    """
    height, base = options.layer_height, options.fabric_offset or 0.0
    found: list[PrintBody] = []
    for drawing in drawings:
        if drawing.printed.is_empty:
            continue
        found.append((drawing.name, *print_body(drawing.printed, height, base)))
        if len(drawing.crosses):
            bars = shapely.linestrings(cross_shapes(drawing.crosses, drawing.cross_size))
            wide = CROSS_LINE * drawing.cross_size / 2
            region = shapely.union_all(shapely.buffer(bars, wide, cap_style="flat"))
            marks = print_body(region, height, base)
            found.append((f"{drawing.name} registration", *marks))
    return found


def print_body(region: BaseGeometry, height: float, base: float = 0.0) -> tuple[Floats, Ints]:
    """Return the body over a region, from a base in m: vertices (n, 3) in m, and triangles (t, 3).

    Corners are rounded to 0.1 µm. Parts that touch at a point only are separated by a cut of 10 µm,
    since four faces would meet at the edge above it.
    """
    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(separated(region)))
    corners = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3]
    # Corners are found again by their places on the grid.
    places, number = np.unique(
        np.rint(corners.reshape(-1, 2) / GRID).astype(np.int64), axis=0, return_inverse=True
    )
    top = number.reshape(-1, 3)
    u, v = places[top[:, 1]] - places[top[:, 0]], places[top[:, 2]] - places[top[:, 0]]
    left = u[:, 0] * v[:, 1] > u[:, 1] * v[:, 0]
    top = np.where(left[:, None], top, top[:, ::-1])
    half = np.stack([top, np.roll(top, -1, axis=1)], axis=2).reshape(-1, 2)
    count = len(places)
    border = ~np.isin(half[:, 0] * count + half[:, 1], half[:, 1] * count + half[:, 0])
    i, j = half[border].T
    walls = [np.stack([i, j, j + count], axis=1), np.stack([i, j + count, i + count], axis=1)]
    triangles = np.concatenate([top + count, top[:, ::-1], *walls])
    level = np.repeat([base, base + height], count)
    return np.column_stack([np.tile(places * GRID, (2, 1)), level]), triangles


def separated(region: BaseGeometry) -> BaseGeometry:
    """Return a region with its corners on a grid of 0.1 µm, and no two borders that touch."""
    shape = shapely.set_precision(region, GRID)
    while True:
        rings = shapely.get_rings(shapely.get_parts(shape))
        points = [shapely.get_coordinates(ring)[:-1] for ring in rings]
        places, count = np.unique(
            np.concatenate([np.empty((0, 2)), *points]), axis=0, return_counts=True
        )
        touching = places[count > 1]
        if not len(touching):
            return shape
        nicks = shapely.box(*(touching - NICK).T, *(touching + NICK).T)
        shape = shapely.set_precision(shape.difference(shapely.union_all(nicks)), GRID)


def stl_of(bodies: Sequence[PrintBody]) -> bytes:
    """Return bodies as one binary STL file; its numbers are in mm."""
    corners = np.concatenate([1e3 * vertices[triangles] for _, vertices, triangles in bodies])
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    faces = np.zeros(
        len(corners), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("further", "<u2")]
    )
    faces["normal"] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    faces["corners"] = corners
    return b"toros_fem".ljust(80) + np.array(len(faces), "<u4").tobytes() + faces.tobytes()


def threemf_of(bodies: Sequence[PrintBody]) -> bytes:
    """Return bodies as the objects of a 3MF file in mm, at their places on the bed."""
    lib3mf = required("lib3mf")
    wrapper = lib3mf.get_wrapper()
    model = wrapper.CreateModel()
    model.SetUnit(lib3mf.ModelUnit.MilliMeter)
    group = model.AddBaseMaterialGroup()
    material = group.AddMaterial(PRINT, wrapper.RGBAToColor(*COLOUR))
    point: Any = ctypes.c_float * 3
    corners: Any = ctypes.c_uint32 * 3
    for number, (name, vertices, triangles) in enumerate(bodies):
        item = model.AddMeshObject()
        item.SetName(name)
        places = [lib3mf.Position(point(*corner)) for corner in 1e3 * vertices]
        item.SetGeometry(places, [lib3mf.Triangle(corners(*ends.tolist())) for ends in triangles])
        item.SetObjectLevelProperty(group.GetResourceID(), material)
        # By default identifiers are random, and equal prints would differ.
        item.SetUUID(_identifier(f"object {number}"))
        placed = model.AddBuildItem(item, wrapper.GetIdentityTransform())
        placed.SetUUID(_identifier(f"item {number}"))
    model.SetBuildUUID(_identifier("build"))
    # lib3mf leaves the process in the locale "C", where text has no signs but those of ASCII.
    before = locale.setlocale(locale.LC_ALL)
    try:
        return bytes(model.QueryWriter("3mf").WriteToBuffer())
    finally:
        locale.setlocale(locale.LC_ALL, before)


def _identifier(name: str) -> str:
    return str(uuid.uuid5(uuid.NAMESPACE_OID, name))
