"""Coefficients of the forms (materials, weight, edges), and vectors to assemble into."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import basix.ufl
import numpy as np
from dolfinx import fem, la
from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import DensityError, ParameterError
from toros_fem.base.mpi import together
from toros_fem.base.validation import real_numbers
from toros_fem.forms.bending import Edges
from toros_fem.forms.eccentric import Offset
from toros_fem.forms.energy import Masses, SheetStiffness
from toros_fem.forms.lines import Family
from toros_fem.materials.sheet import Composite, Knit, Material
from toros_fem.mechanics.skin.dead_loads import Weight
from toros_fem.mechanics.skin.hinges import Hinges
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.skin import Skin


def work_vector(space: fem.FunctionSpace) -> Any:
    """Return a vector to assemble into; made once, since planning its exchange is expensive."""
    return la.vector(space.dofmap.index_map, space.dofmap.index_map_bs)


def assembled(form: Any, vector: Any) -> Floats:
    """Return the owned entries of an assembled linear form."""
    vector.array[:] = 0
    fem.assemble_vector(vector.array, form)
    vector.scatter_reverse(la.InsertMode.add)
    return np.array(vector.array[: vector.index_map.size_local * vector.block_size])


def sheet_stiffness(domain: Any, material: Material, offset: float = 0.0) -> SheetStiffness:
    """Return a material's membrane and bending stiffness as constants.

    Args:
        domain: Mesh of the skin.
        material: The material.
        offset: Distance in m of its middle from the surface that the curvature is measured at.
    """
    h = material.thickness
    bend = h**3 / 12 + offset**2 * h
    values = (h * material.mu, h * material.lam, bend * material.mu, bend * material.lam)
    return SheetStiffness(*(fem.Constant(domain, value) for value in values))


def print_offset(domain: Any, composite: Composite) -> Offset | None:
    """Return the reinforcement's stiffness times offset as constants; None for no side."""
    if composite.print_side is None:
        return None
    strip = composite.reinforcement
    factor = strip.thickness * composite.eccentricity
    return Offset(*(fem.Constant(domain, factor * value) for value in (strip.mu, strip.lam)))


def masses(domain: Any, weight: Weight, gravity: Any) -> Masses:
    """Return the masses of the materials as constants; gravity is a constant already."""
    fabric, reinforcement = weight.fabric, weight.reinforcement
    return Masses(fem.Constant(domain, fabric), fem.Constant(domain, reinforcement), gravity)


def courses(skin: Skin, composite: Composite) -> Family | None:
    """Return the courses of a knitted fabric, by their angle in each panel; None without a knit.

    The energy ½ k (|F d| − 1)² acts in every layer of the sheet: k h²/12 against bending.

    Raises:
        ParameterError: A panel has no grain.
        PanelError: There is no panel of a name.
        PatternError: The skin is moulded.
    """
    if composite.knit is None:
        return None
    skin.pattern.require_flat_panels("the grain of a knit")
    angle = _grain(composite.knit, skin.pattern)
    element = basix.ufl.element("DG", "triangle", 0, shape=(2,))
    space = fem.functionspace(skin.mesh, element)
    direction = fem.Function(space, name="courses")
    cell = skin.cell[skin.density_space.dofmap.list[:, 0]]
    twice = 2 * angle[skin.pattern.panel[cell]]
    values = np.column_stack([np.cos(twice), np.sin(twice)])
    direction.x.array.reshape(-1, 2)[space.dofmap.list[:, 0]] = values
    k, h = composite.course_stiffness, composite.fabric.thickness
    stretching, bending = (fem.Constant(skin.mesh, value) for value in (k, k * h**2 / 12))
    return Family(direction[0], direction[1], stretching, bending, 0.0)


def _grain(knit: Knit, pattern: Pattern) -> Floats:
    """Return the angle of the courses in each panel, in rad."""
    if not isinstance(knit.grain, Mapping):
        return np.full(len(pattern.panel_names), knit.grain)
    angles: Floats = np.full(len(pattern.panel_names), np.nan)
    for name, angle in knit.grain.items():
        angles[pattern.panel_index(name)] = angle
    if np.isnan(angles).any():
        bare = [pattern.panel_names[k] for k in np.flatnonzero(np.isnan(angles))]
        raise ParameterError(
            f"grain has no angle for the panels {', '.join(map(repr, bare))}: give one for each "
            "panel, or one number for all."
        )
    return angles


def edge_coefficients(skin: Skin, hinges: Hinges, rotations: bool) -> Edges:
    """Return constants of the triangles' edges as coefficients, without those that are zero."""
    element = basix.ufl.element("DG", "triangle", 0, shape=(3,))
    space = fem.functionspace(skin.mesh, element)

    def coefficient(values: Floats) -> Any:
        function = fem.Function(space)
        function.x.array.reshape(-1, 3)[space.dofmap.list[:, 0]] = values
        return function

    # Only owned triangles see all of their neighbours.
    owned = slice(0, skin.mesh.topology.index_map(2).size_local)
    free = ~hinges.has_moment[owned] & (hinges.rotation[owned] != 0)
    mirrored, shaped, freed = (
        skin.comm.allreduce(bool(values.any()), op=MPI.LOR)
        for values in (hinges.mirror, hinges.rest, free)
    )
    return Edges(
        tensors=[coefficient(hinges.tensors[:, i]) for i in range(3)],
        rests=coefficient(hinges.rest) if shaped else None,
        turns=coefficient(hinges.rotation) if rotations else None,
        mirrors=[coefficient(hinges.mirror[:, i]) for i in range(3)] if mirrored else None,
        folds=coefficient(hinges.has_moment.astype(np.float64)) if freed else None,
    )


def check_density(skin: Skin, density: Any) -> Floats:
    """Return owned densities as an array, with one result on all ranks (collective).

    Raises:
        DensityError: They are no real numbers, the shape is wrong, or one is outside [0, 1].
    """
    owned = len(skin.owned_cells)
    with together(skin.comm):
        found = real_numbers("density", density, "one for each owned triangle", DensityError)
        if found.shape != (owned,):
            raise DensityError(
                f"density has shape {found.shape}; this rank owns {owned} triangles."
            )
        outside = ~((found >= 0) & (found <= 1))
        if outside.any():
            k = int(np.flatnonzero(outside)[0])
            raise DensityError(
                f"density of triangle {skin.owned_cells[k]} is {found[k]}; it must lie in "
                "[0, 1]. Clip the density, or look for an earlier error."
            )
    return found
