"""Bending of fabric and print, eqs. (4-6), and its coupling to stretch by a print on one face."""

from __future__ import annotations

from collections.abc import Sequence
from typing import override

import numpy as np
from dolfinx import fem, la
from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.forms.bending import Edges, bending_energy, coupling_energy
from toros_fem.forms.jets import Scalar
from toros_fem.forms.kinematics import Strain, Triangle
from toros_fem.materials.sheet import Bending, Composite
from toros_fem.mechanics.skin.coefficients import (
    cell_function,
    cell_space,
    constants,
    lame_constants,
    set_cells,
)
from toros_fem.mechanics.skin.hinges import Hinges, edge_angles, find_hinges, hinge_tensors
from toros_fem.mechanics.skin.patch_space import Unknowns, pattern_edges
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.mechanics.terms.term import Term
from toros_fem.meshes.skin import Skin


class Bend(Term):
    """Bending by the angles at the edges; the mid-edge curvature has rotations of the edges.

    Attributes:
        hinges: Edges of the local triangles, and the nodes across them.
    """

    def __init__(
        self, skin: Skin, composite: Composite, bending: Bending, supports: Supports
    ) -> None:
        # Membrane strain bends an offset print up to its free edges.
        coupled = composite.print_side is not None
        poisson = composite.reinforcement.poisson
        self.hinges = find_hinges(skin, bending, supports, poisson, turn_free=coupled)
        rotations = bending.curvature == "midedge"
        if rotations:
            skin.mesh.topology.create_entities(1)
            self.unknowns = _rotations(skin, self.hinges)
        self.edges = _coefficients(skin, self.hinges, rotations=rotations)
        self._skin, self._bending, self._poisson = skin, bending, poisson
        sheets = ((composite.fabric, 0.0), (composite.reinforcement, composite.eccentricity))
        moments = [m.thickness**3 / 12 + offset**2 * m.thickness for m, offset in sheets]
        self._mu, self._lam = lame_constants(skin, composite, moments)

    @override
    def of_curvature(self, t: Triangle, Lambda: Sequence[Scalar]) -> Scalar:
        return bending_energy(Lambda, t.mix(*self._mu), t.mix(*self._lam))

    @override
    def after_move(self) -> None:
        assert self.edges is not None
        known = self.hinges.has_moment | (self.hinges.rotation != 0)
        tensors = hinge_tensors(self._skin, self._bending, known, self._poisson)
        for i, function in enumerate(self.edges.tensors):
            set_cells(function, tensors[:, i])

    def folds(self, patch: Floats, angle: float) -> int:
        """Return how many hinges of owned triangles fold by more than an angle in rad.

        Each edge inside the skin has two. The patch has positions of corners and flaps, (n, 6, 3).
        """
        cells = slice(0, len(patch))
        inside = self.hinges.has_moment[cells] & ~self.hinges.mirror[cells].any(axis=2)
        angles = edge_angles(patch[:, :3], patch[:, 3:], np.zeros_like(patch[:, 3:]))
        return int(((np.abs(angles) > angle) & inside).sum())


class OffsetPrint(Term):
    """Print on one face of the fabric, whose stretch bends the sheet."""

    def __init__(self, skin: Skin, composite: Composite) -> None:
        strip = composite.reinforcement
        factor = strip.thickness * composite.eccentricity
        self._mu, self._lam = constants(skin, factor * strip.mu, factor * strip.lam)

    @override
    def of_both(self, t: Triangle, e: Strain, Lambda: Sequence[Scalar]) -> Scalar:
        return coupling_energy(e, Lambda, t.mix(0, self._mu), t.mix(0, self._lam))


def _rotations(skin: Skin, hinges: Hinges) -> Unknowns:
    """Return the rotations of the edges; free, hinged and mirrored ones have none.

    They are lengths. Whether an edge has one is what its owner knows.
    """
    index_map = skin.mesh.topology.index_map(1)
    facets = skin.mesh.topology.connectivity(2, 1).array.reshape(-1, 3)
    owned = skin.mesh.topology.index_map(2).size_local
    turns = la.vector(index_map, 1)
    np.maximum.at(turns.array, facets[:owned], np.abs(hinges.rotation[:owned]))
    turns.scatter_reverse(la.InsertMode.add)
    turns.scatter_forward()
    fixed = np.asarray(turns.array == 0)[:, None]
    return Unknowns(index_map, fixed, facets, lambda: pattern_edges(skin))


def _coefficients(skin: Skin, hinges: Hinges, *, rotations: bool) -> Edges:
    """Return constants of the triangles' edges as coefficients, without those that are zero."""
    space = cell_space(skin, 3)

    def three(rows: Floats) -> list[fem.Function]:
        return [cell_function(space, rows[:, i]) for i in range(3)]

    # Only owned triangles see all of their neighbours.
    owned = slice(0, len(skin.owned_cells))
    free = ~hinges.has_moment[owned] & (hinges.rotation[owned] != 0)
    mirrored, shaped, freed = (
        skin.comm.allreduce(bool(values.any()), op=MPI.LOR)
        for values in (hinges.mirror, hinges.rest, free)
    )
    return Edges(
        tensors=three(hinges.tensors),
        rests=cell_function(space, hinges.rest) if shaped else None,
        turns=cell_function(space, hinges.rotation) if rotations else None,
        mirrors=three(hinges.mirror) if mirrored else None,
        folds=cell_function(space, hinges.has_moment.astype(np.float64)) if freed else None,
    )
