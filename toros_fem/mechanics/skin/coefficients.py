"""Coefficients of forms: constants, and functions with a row of values on each triangle."""

from __future__ import annotations

from collections.abc import Sequence

import basix.ufl
from dolfinx import fem

from toros_fem.base.array_types import Floats
from toros_fem.materials.sheet import Composite
from toros_fem.meshes.skin import Skin


def constants(skin: Skin, *values: float) -> list[fem.Constant]:
    """Return numbers as constants, so that forms are compiled once for all values."""
    return [fem.Constant(skin.mesh, value) for value in values]


def lame_constants(
    skin: Skin, composite: Composite, factors: Sequence[float]
) -> tuple[list[fem.Constant], list[fem.Constant]]:
    """Return μ and λ, each of fabric and print, times a factor for each of the materials."""
    pairs = list(zip(factors, (composite.fabric, composite.reinforcement), strict=True))
    return (
        constants(skin, *(factor * material.mu for factor, material in pairs)),
        constants(skin, *(factor * material.lam for factor, material in pairs)),
    )


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
