"""Differences between dolfinx 0.9 and 0.11, found by features, and what petsc4py lacks."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import cpp, fem, mesh
from dolfinx.graph import adjacencylist
from mpi4py import MPI
from petsc4py import PETSc


def adjacency(values: npt.NDArray[np.int32], offsets: npt.NDArray[np.int32]) -> Any:
    """Return a C++ adjacency list."""
    found = adjacencylist(values, offsets)
    return getattr(found, "_cpp_object", found)  # from 0.10 it is wrapped


def index_map(
    comm: MPI.Comm, owned: int, ghosts: npt.NDArray[np.int64], owners: npt.NDArray[np.int32]
) -> Any:
    """Return an index map with given ghosts (collective)."""
    try:
        return cpp.common.IndexMap(comm, owned, ghosts, owners)
    except TypeError:  # from 0.11 a message tag is required
        return cpp.common.IndexMap(comm, owned, ghosts, owners, 1 << 8)


def coordinate_map(geometry: Any) -> Any:
    """Return the C++ coordinate element of a mesh geometry."""
    geometry = getattr(geometry, "_cpp_object", geometry)
    maps = getattr(geometry, "cmaps", None)
    if isinstance(maps, list):  # from 0.11; before, cmaps is a method or missing
        return maps[0]
    return geometry.cmap


def geometry_dofmap(geometry: Any) -> npt.NDArray[np.int32]:
    """Return the geometry points of each local cell, shape (cells, 3)."""
    geometry = getattr(geometry, "_cpp_object", geometry)
    maps = getattr(geometry, "dofmaps", None)
    if isinstance(maps, list):
        return np.asarray(maps[0])
    return np.asarray(geometry.dofmap)


def function_space(domain: mesh.Mesh, element: Any, dofmap: Any, plain: fem.FunctionSpace) -> Any:
    """Return a space on a hand-made C++ dofmap; `plain` gives element and value shape."""
    cpp_element = getattr(plain.element, "_cpp_object", plain.element)
    make = cpp.fem.FunctionSpace_float64
    try:
        space = make(domain._cpp_object, cpp_element, dofmap)
    except TypeError:  # up to 0.9 the value shape is an argument
        space = make(domain._cpp_object, cpp_element, dofmap, plain.value_shape)
    return fem.FunctionSpace(domain, element, space)


def filled_form(
    code: Any,
    module: Any,
    spaces: Sequence[fem.FunctionSpace],
    coefficients: Sequence[fem.Function],
    constants: Sequence[fem.Constant],
    domain: mesh.Mesh,
) -> fem.Form:
    """Return a form on all triangles of a mesh from the code of another one, and its module."""
    address = module.ffi.cast("uintptr_t", module.ffi.addressof(code))
    given = [[one._cpp_object for one in each] for each in (spaces, coefficients, constants)]
    make = cpp.fem.Form_float64
    try:
        form = make(address, *given, {}, {}, domain._cpp_object)
    except TypeError:  # from 0.10 codes and entity maps are lists
        form = make([address], *given, {}, [], domain._cpp_object)
    return fem.Form(form, code, None, module)


def option_used(name: str) -> bool:
    """Return whether anything has asked for an option of PETSc's database."""
    library, used = ctypes.CDLL(PETSc.__file__), ctypes.c_int()
    library.PetscOptionsUsed(None, name.encode(), ctypes.byref(used))
    return bool(used.value)
