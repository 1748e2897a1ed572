"""Functions with a row of values on each triangle of a skin."""

from __future__ import annotations

import basix.ufl
from dolfinx import fem

from toros_fem.base.array_types import Floats
from toros_fem.meshes.skin import Skin


def cell_space(skin: Skin, size: int) -> fem.FunctionSpace:
    """Return the space of functions with rows of so many values."""
    return fem.functionspace(skin.mesh, basix.ufl.element("DG", "triangle", 0, shape=(size,)))


def cell_function(space: fem.FunctionSpace, rows: Floats, name: str | None = None) -> fem.Function:
    """Return a function with the rows of all local triangles, (cells, size)."""
    function = fem.Function(space, name=name)
    set_cells(function, rows)
    return function


def set_cells(function: fem.Function, rows: Floats) -> None:
    """Set the rows of all local triangles, (cells, size), in the order of the mesh."""
    place = function.function_space.dofmap.list[:, 0]
    function.x.array.reshape(-1, rows.shape[1])[place] = rows
