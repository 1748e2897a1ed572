"""Mesh files as meshio reads them, quietly, and what it passes over."""

from __future__ import annotations

import contextlib
import io
import itertools
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import meshio
import numpy as np
from dolfinx.io import XDMFFile
from mpi4py import MPI

from toros_fem._types import Ints
from toros_fem.errors import SurfaceError, TorosError

# Coordinates of a point by the geometry types of XDMF that hold points one by one.
WIDTHS = {"XYZ": 3, "XY": 2}


def load(path: Path, failure: type[TorosError], formats: str) -> Any:
    """The file as meshio reads it, which prints and may leave Python where it cannot.

    Args:
        path: The file.
        failure: The error to raise.
        formats: What to save it as if it cannot be read, "OBJ or PLY".
    """
    if not path.is_file():
        raise failure(f"there is no file {path}.")
    said = io.StringIO()
    try:
        with (
            contextlib.redirect_stdout(said),
            contextlib.redirect_stderr(said),
            np.errstate(over="ignore"),
        ):
            return meshio.read(path)
    except ImportError as error:
        # meshio wants h5py for any XDMF; dolfinx reads HDF5 as well.
        if path.suffix.lower() in (".xdmf", ".xmf"):
            return _xdmf(path, failure)
        raise failure(
            f"{path} cannot be read as a mesh, since meshio lacks a package for its format "
            f"({error}). Save it as {formats}, or install that package."
        ) from error
    except (Exception, SystemExit) as error:
        why = said.getvalue().strip() or f"{type(error).__name__}: {error}"
        raise failure(
            f"{path} cannot be read as a mesh ({' '.join(why.split())}). Save it as {formats}."
        ) from error


def _xdmf(path: Path, failure: type[TorosError]) -> Any:
    """Points and triangles of the first grid of an XDMF file."""
    try:
        grid = ET.parse(path).find(".//Grid[Topology][Geometry]")
    except ET.ParseError as error:
        raise failure(f"{path} cannot be read as XML: {error}.") from error
    if grid is None or grid.find("Topology[@TopologyType='Triangle']") is None:
        raise failure(
            f"{path} has no first grid of the type 'Triangle', the only one that is read without "
            "the Python package h5py. Install it, or save the surface as MSH."
        )
    kinds = [str(of.get("GeometryType", "XYZ")) for of in grid.findall("Geometry")]
    if kinds[0] not in WIDTHS:
        raise failure(
            f"the first grid of {path} has the geometry type {kinds[0]!r}; without the Python "
            f"package h5py {' and '.join(WIDTHS)} are read. Install it, or save the surface as MSH."
        )
    try:
        items = [grid.find(f"{name}/DataItem") for name in ("Geometry", "Topology")]
        texts = [item.text or "" for item in items if item is not None]
        if all(item is not None and item.get("Format", "XML") == "XML" for item in items):
            points, corners = (np.array(text.split(), dtype=np.float64) for text in texts)
        else:
            with XDMFFile(MPI.COMM_SELF, str(path), "r") as file:
                name = grid.get("Name", "mesh")
                points, corners = file.read_geometry_data(name), file.read_topology_data(name)
        cells = corners.reshape(-1, 3).astype(np.int64)
        return meshio.Mesh(points.reshape(-1, WIDTHS[kinds[0]]), [("triangle", cells)])
    except (RuntimeError, ValueError) as error:
        raise failure(f"{path} cannot be read as a mesh: {error}") from error


def obj_lines(path: Path) -> Ints:
    """Ends of line elements of an OBJ file, (k, 2), which meshio passes over.

    Raises:
        SurfaceError: A line element names its vertices by something else than numbers.
    """
    ends: list[tuple[int, int]] = []
    vertices = 0
    with path.open(encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, 1):
            word = line.split()
            if word[:1] == ["v"]:
                vertices += 1
            if word[:1] != ["l"]:
                continue
            try:
                chain = [int(item.split("/")[0]) for item in word[1:]]
            except ValueError as error:
                raise SurfaceError(
                    f"line {number} of {path}, {line.strip()!r}, does not name vertices by their "
                    "numbers. Export it again, or delete the line."
                ) from error
            # Negative numbers count back from the last vertex so far.
            ends += itertools.pairwise(k - 1 if k >= 0 else vertices + k for k in chain)
    return np.array(ends, dtype=np.int64).reshape(-1, 2)
