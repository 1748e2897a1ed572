"""Energy of the sheet: membrane and bending, eqs. (1-6), print on one face, lines, bladder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, override

import numpy as np
from dolfinx import fem, la
from mpi4py import MPI

from toros_fem.base.array_types import Bools, Floats
from toros_fem.base.errors import ParameterError
from toros_fem.forms.bending import Edges, bending_energy, coupling_energy, coupling_of_lines
from toros_fem.forms.bubbles import Bubbles
from toros_fem.forms.jets import Scalar
from toros_fem.forms.kinematics import Strain, Triangle
from toros_fem.forms.lines import Family, bending_of_lines, stretching_energy
from toros_fem.forms.membrane import Logarithm, barrier, neo_hooke, relaxed
from toros_fem.materials.sheet import Bending, Bladder, Composite, Knit
from toros_fem.mechanics.skin.coefficients import (
    cell_function,
    cell_space,
    constants,
    lame_constants,
    set_cells,
)
from toros_fem.mechanics.skin.designs import Densities, LineDesign
from toros_fem.mechanics.skin.hinges import (
    Hinges,
    edge_angles,
    find_hinges,
    hinge_tensors,
)
from toros_fem.mechanics.skin.patch_space import Unknowns, pattern_edges
from toros_fem.mechanics.skin.stretch_bounds import MixedBounds, StretchBounds
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.mechanics.terms.term import Compiled, Term
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.skin import Skin
from toros_fem.meshes.triangles import normals, opposite_edges

# A direction whose component along an axis is below this fraction of it lies in the plane across.
IN_PLANE = 1e-6


class Sheet(Term):
    """Membrane of fabric and print with the energy of eq. (1), and its stretch bounds."""

    bounds: StretchBounds

    def __init__(self, skin: Skin, composite: Composite, design: Densities) -> None:
        thicknesses = composite.fabric.thickness, composite.reinforcement.thickness
        self._mu, self._lam = lame_constants(skin, composite, thicknesses)
        # Owned triangles come first in the mesh, each with flat corners of its own.
        owned = len(skin.owned_cells)
        flat = skin.mesh.geometry.x[: 3 * owned].reshape(owned, 3, 3)[:, :, :2]
        self._limits: tuple[Any, Any]
        if composite.shares_bounds:
            shared, wrinkles = composite.fabric_bounds, composite.membrane.relaxed
            self.bounds = StretchBounds(skin.comm, flat, *shared, wrinkles=wrinkles)
            c1, c2 = constants(skin, *shared)
            self._limits = read = c1, c2
        else:
            self.bounds = MixedBounds(design.density, flat, composite)
            self._limits, read = self.bounds.coefficients, self.bounds.symbols
        # Where the sheet wrinkles instead of taking compression.
        self._residual: fem.Constant | None = None
        if composite.membrane.relaxed:
            self._residual = fem.Constant(skin.mesh, composite.membrane.residual_stiffness)
        self.symbols = self._mu, self._lam, read, self._residual

    @override
    def of_strain(self, t: Triangle, e: Strain, log: Logarithm) -> Scalar:
        law = t.mix(*self._mu), t.mix(*self._lam), *self._limits
        if self._residual is None:
            return barrier(e, *law, log)
        return relaxed(e, *law, self._residual, log)

    @override
    def take_forms(self, number: int, compiled: Compiled, work: la.Vector) -> None:
        bounds = self.bounds
        if isinstance(bounds, MixedBounds):
            form = compiled("narrowed", lambda forms: bounds.narrowed(forms.residual))
            bounds.take_narrowed(form, work)

    @override
    def after_design(self) -> None:
        if isinstance(self.bounds, MixedBounds):
            self.bounds.update()

    @override
    def moduli(self, design: Densities) -> Floats | float:
        both = zip(self._mu, self._lam, strict=True)
        return design.mix(*(2 * float(mu.value) + float(lam.value) for mu, lam in both))


class QuadraticEdges(Term):
    """Bubbles on the edges of some triangles, whose displacement is quadratic in their plane.

    Along a clamped edge, and across one in a symmetry plane, there are none.
    """

    def __init__(
        self, skin: Skin, supports: Supports, bounds: StretchBounds, cells: Bools, first: int
    ) -> None:
        skin.mesh.topology.create_entities(1)
        index_map = skin.mesh.topology.index_map(1)
        facets = skin.mesh.topology.connectivity(2, 1).array.reshape(-1, 3)
        owned = len(skin.owned_cells)
        used = la.vector(index_map, 1)
        used.array[facets[:owned][cells[skin.owned_cells]].ravel()] = 1.0
        used.scatter_reverse(la.InsertMode.add)
        used.scatter_forward()

        numbers, _ = pattern_edges(skin)
        fixed = (used.array[:, None] == 0) | _held(skin.pattern, supports)[numbers]
        self.unknowns = Unknowns(index_map, fixed, facets, lambda: pattern_edges(skin))

        vertex = skin.vertex[skin.position_space.dofmap.list]
        ends = opposite_edges(vertex)
        corners = skin.mesh.geometry.x[: 3 * len(vertex)].reshape(-1, 3, 3)[:, :, :2]
        sides = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
        sign = np.where(ends[..., 0] < ends[..., 1], 1.0, -1.0)
        scales = sign / np.linalg.norm(sides, axis=2)
        self._scales = cell_function(cell_space(skin, 3), scales)
        self.symbols = self._scales
        self.bubbles = Bubbles(first, self._scales)
        bounds.take_bubbles(first, scales[:owned])


def _held(pattern: Pattern, supports: Supports) -> Bools:
    """Return whether each edge, (e, 2), is held along itself, and across it in the sheet."""
    edges, triangles = pattern.edges, pattern.triangles
    along = pattern.points[edges.ends[:, 1]] - pattern.points[edges.ends[:, 0]]
    half = np.cross(normals(pattern.points, triangles)[:, None], along[edges.of_triangle])
    across = np.zeros(along.shape)
    np.maximum.at(across, edges.of_triangle, np.abs(half))
    held = supports.fixed[edges.ends].all(axis=1)
    return np.stack(
        [(held & (abs(way) > IN_PLANE * abs(way).max(axis=1, keepdims=True))).any(axis=1)
         for way in (along, across)], axis=1,
    )  # fmt: skip


class RubberLayer(Term):
    """Neo-Hookean energy of a bladder that stretches with the fabric."""

    def __init__(self, skin: Skin, bladder: Bladder) -> None:
        self._stiffness = bladder.membrane_stiffness
        self.symbols = self._mu = fem.Constant(skin.mesh, self._stiffness / 3)

    @override
    def of_strain(self, t: Triangle, e: Strain, log: Logarithm) -> Scalar:
        return neo_hooke(e, self._mu)

    @override
    def moduli(self, design: Densities) -> Floats | float:
        return 4 / 3 * self._stiffness  # μ = E/3, λ = 2 μ


class Bend(Term):
    """Bending by the angles at the edges; the mid-edge curvature has rotations of the edges.

    Attributes:
        hinges: Edges of the local triangles, and the nodes across them.
    """

    def __init__(
        self,
        skin: Skin,
        composite: Composite,
        bending: Bending,
        supports: Supports,
        *,
        repeats: bool = False,
    ) -> None:
        # Membrane strain bends an offset print up to its free edges.
        coupled = composite.print_side is not None
        poisson = composite.reinforcement.poisson
        self.hinges = find_hinges(
            skin, bending, supports, poisson, turn_free=coupled, repeats=repeats
        )
        rotations = bending.curvature == "midedge"
        if rotations:
            skin.mesh.topology.create_entities(1)
            self.unknowns = _rotations(skin, self.hinges)
        self.edges = _coefficients(skin, self.hinges, rotations=rotations)
        self._skin, self._poisson = skin, poisson
        sheets = ((composite.fabric, 0.0), (composite.reinforcement, composite.eccentricity))
        moments = [m.thickness**3 / 12 + offset**2 * m.thickness for m, offset in sheets]
        self.symbols = self._mu, self._lam = lame_constants(skin, composite, moments)

    @override
    def of_curvature(self, t: Triangle, Lambda: Sequence[Scalar]) -> Scalar:
        return bending_energy(Lambda, t.mix(*self._mu), t.mix(*self._lam))

    @override
    def after_move(self) -> None:
        assert self.edges is not None
        known = self.hinges.has_moment | (self.hinges.rotation != 0)
        tensors = hinge_tensors(self._skin, known, self._poisson)
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
        self.symbols = constants(skin, factor * strip.mu, factor * strip.lam)
        self._mu, self._lam = self.symbols

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
    mirrored, shaped, freed, steep = (
        skin.comm.allreduce(bool(values.any()), op=MPI.LOR)
        for values in (hinges.mirror, hinges.rest, free, hinges.side[owned])
    )
    return Edges(
        tensors=three(hinges.tensors),
        rests=cell_function(space, hinges.rest) if shaped else None,
        turns=cell_function(space, hinges.rotation) if rotations else None,
        mirrors=three(hinges.mirror) if mirrored else None,
        folds=cell_function(space, hinges.has_moment.astype(np.float64)) if freed else None,
        sides=cell_function(space, hinges.side) if steep else None,
    )


class Courses(Term):
    """Courses of a knitted fabric, by their angle in each panel.

    The energy ½ k (|F d| − 1)² acts in every layer of the sheet: k h²/12 against bending.
    """

    def __init__(self, skin: Skin, composite: Composite, knit: Knit) -> None:
        skin.pattern.require_flat_panels("the grain of a knit")
        cell = skin.cell[skin.density_space.dofmap.list[:, 0]]
        twice = 2 * _grain(knit, skin.pattern)[skin.pattern.panel[cell]]
        directions = np.column_stack([np.cos(twice), np.sin(twice)])
        direction = cell_function(cell_space(skin, 2), directions, "courses")
        self._stiffness, h = composite.course_stiffness, composite.fabric.thickness
        k, bending = constants(skin, self._stiffness, self._stiffness * h**2 / 12)
        self.symbols = direction, k, bending
        self._family = Family(direction[0], direction[1], k, bending, 0.0)

    @override
    def of_strain(self, t: Triangle, e: Strain, log: Logarithm) -> Scalar:
        return stretching_energy([self._family.weighted(t.plain)], e.C)

    @override
    def of_curvature(self, t: Triangle, Lambda: Sequence[Scalar]) -> Scalar:
        return bending_of_lines([self._family.weighted(t.plain)], Lambda)

    @override
    def moduli(self, design: Densities) -> Floats | float:
        return design.plain(self._stiffness)


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


class LineFamilies(Term):
    """Lines made of the reinforcement, as a design has them.

    Along them they have the print's stiffness E h, and E h³/12 against bending, about the fabric's
    middle if the print lies on one face; against twist they have G h³/3.
    """

    def __init__(self, skin: Skin, composite: Composite, design: LineDesign) -> None:
        strip, offset = composite.reinforcement, composite.eccentricity
        h = strip.thickness
        bending = strip.young * h**3 / 12 + offset**2 * h * strip.young
        self._modulus = strip.membrane_stiffness
        self._stiffness = constants(skin, strip.young * h, bending, strip.mu * h**3 / 3)
        self._offset = None if composite.print_side is None else fem.Constant(skin.mesh, offset)
        self.symbols = self._stiffness, self._offset

    def _families(self, t: Triangle) -> list[Family]:
        assert t.lines is not None
        return t.lines.families(*self._stiffness)

    @override
    def of_strain(self, t: Triangle, e: Strain, log: Logarithm) -> Scalar:
        return stretching_energy(self._families(t), e.C)

    @override
    def of_curvature(self, t: Triangle, Lambda: Sequence[Scalar]) -> Scalar:
        return bending_of_lines(self._families(t), Lambda)

    @override
    def of_both(self, t: Triangle, e: Strain, Lambda: Sequence[Scalar]) -> Scalar:
        if self._offset is None:
            return 0
        families = [family.weighted(self._offset) for family in self._families(t)]
        return coupling_of_lines(families, e, Lambda)

    @override
    def moduli(self, design: Densities) -> Floats | float:
        assert isinstance(design, LineDesign)
        return design.cover * self._modulus
