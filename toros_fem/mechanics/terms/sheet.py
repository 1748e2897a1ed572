"""Energy of the sheet: membrane and bending, eqs. (1-6), print on one face, lines, bladder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, override

import numpy as np
from dolfinx import fem, la
from mpi4py import MPI

from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import largest
from toros_fem.base.validation import Bools, Floats, LocalInts
from toros_fem.forms.bending import (
    EITHER,
    STEEP,
    Edges,
    bending_energy,
    coupling_energy,
    coupling_of_lines,
)
from toros_fem.forms.bubbles import Bubbles
from toros_fem.forms.jets import Scalar
from toros_fem.forms.kinematics import Strain, Triangle
from toros_fem.forms.lines import Family, bending_of_lines, shearing_energy, stretching_energy
from toros_fem.forms.membrane import Logarithm, barrier, neo_hooke, relaxed, yeoh
from toros_fem.materials.sheet import Bending, Bladder, Composite, Knit
from toros_fem.mechanics.skin.designs import Densities, LineDesign
from toros_fem.mechanics.skin.patch_space import (
    Unknowns,
    cell_function,
    cell_space,
    constants,
    lame_constants,
    pattern_edges,
    set_cells,
)
from toros_fem.mechanics.skin.stretch_bounds import MixedBounds, StretchBounds
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.mechanics.terms.term import Compiled, Term
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.skin import Skin
from toros_fem.meshes.triangles import edge_keys, flat_areas, normals, opposite_edges

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
    """Energy of a bladder that stretches with the fabric: neo-Hookean, or of Yeoh's law."""

    def __init__(self, skin: Skin, bladder: Bladder) -> None:
        self._stiffness, h = bladder.membrane_stiffness, bladder.thickness
        self._mu = fem.Constant(skin.mesh, self._stiffness / 3)
        further = bladder.second, bladder.third
        self._further: list[fem.Constant] = []
        if further != (None, None):
            self._further = constants(skin, *(h * (value or 0.0) for value in further))
        self.symbols = self._mu, self._further

    @override
    def of_strain(self, t: Triangle, e: Strain, log: Logarithm) -> Scalar:
        return yeoh(e, self._mu, *self._further) if self._further else neo_hooke(e, self._mu)

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


class FabricThreads(Term):
    """Courses and wales of a fabric, by the angle of the courses in each panel, and its shear.

    Threads act in every layer of the sheet: k h²/12 against bending. Shear does not bend.
    """

    def __init__(self, skin: Skin, composite: Composite, knit: Knit) -> None:
        skin.pattern.require_flat_panels("the grain of a knit")
        cell = skin.cell[skin.density_space.dofmap.list[:, 0]]
        twice = 2 * _grain(knit, skin.pattern)[skin.pattern.panel[cell]]
        directions = np.column_stack([np.cos(twice), np.sin(twice)])
        direction = cell_function(cell_space(skin, 2), directions, "courses")
        self._families, h = list[Family](), composite.fabric.thickness
        # Across the courses the cosine and the sine of twice the angle change their signs.
        for sign, threads in zip((1.0, -1.0), composite.threads, strict=True):
            if threads is not None:
                k, bending = constants(skin, threads.stiffness, threads.stiffness * h**2 / 12)
                strain = None if threads.strain is None else constants(skin, threads.strain)[0]
                cosine, sine = sign * direction[0], sign * direction[1]
                self._families.append(Family(cosine, sine, k, bending, 0.0, strain))
        self._shear = None if knit.shear is None else constants(skin, knit.shear)[0]
        self._courses = Family(direction[0], direction[1], 0.0, 0.0, 0.0)
        values = [(f.stretching, f.bending, f.strain) for f in self._families]
        self.symbols = direction, values, self._shear
        self._largest = max((float(f.stretching.value) for f in self._families), default=0.0)

    def _plain(self, t: Triangle) -> list[Family]:
        return [family.weighted(t.plain) for family in self._families]

    @override
    def of_strain(self, t: Triangle, e: Strain, log: Logarithm) -> Scalar:
        stretching = stretching_energy(self._plain(t), e.C)
        if self._shear is None:
            return stretching
        return stretching + shearing_energy(self._courses, t.plain * self._shear, e.C)

    @override
    def of_curvature(self, t: Triangle, Lambda: Sequence[Scalar]) -> Scalar:
        return bending_of_lines(self._plain(t), Lambda)

    @override
    def moduli(self, design: Densities) -> Floats | float:
        return design.plain(self._largest)


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


# Two layers lie on each other where an angle is so near to 180°, in rad.
TOUCHING = 1e-6
# A rest angle beyond this, in rad, may have either sign.
FOLDED = np.radians(170)


@dataclass(frozen=True, eq=False)
class Hinges:
    """Edges of the local triangles: their neighbours, mirrors and constants.

    Edge i of a triangle lies opposite its corner i and runs from corner i + 1 to i + 2, modulo 3.

    Attributes:
        flap: Node of the position space across each edge, shape (cells, 3): the far vertex of
            the neighbour, or the triangle's own corner i where there is none.
        has_moment: Whether the edge carries a moment; free edges do not, nor do hinged seams.
        mirror: Unit normal of the plane that mirrors the flap, (cells, 3, 3); zero elsewhere.
        tensors: Tᵢ in Λ = Σᵢ θᵢ Tᵢ as (xx, yy, xy), shape (cells, 3, 3), in 1/m.
        rest: Angle of each edge at which it carries no moment, in rad, (cells, 3).
        rotation: Factor of the edge's rotation unknown, a length, in the angle, (cells, 3), in
            1/m: opposite in the two triangles of an edge; zero where there is no such unknown.
        side: As of `forms.bending.Edges.sides`, (cells, 3).
    """

    flap: LocalInts
    has_moment: Bools
    mirror: Floats
    tensors: Floats
    rest: Floats
    rotation: Floats
    side: Floats


def find_hinges(
    skin: Skin,
    bending: Bending,
    supports: Supports,
    poisson: float,
    *,
    turn_free: bool = False,
    repeats: bool = False,
) -> Hinges:
    """Return the hinges of all local triangles; complete for those that this rank owns.

    An edge without moment takes the angle of least energy: the natural condition inside a triangle.
    It depends on Poisson's ratio alone, so that the tensors are constants. Where that of fabric and
    reinforcement differs, an error of second order in the difference remains there. With
    `turn_free` free edges have rotations too, if any edge has: then equilibrium finds their angles,
    whatever bends the sheet. A skin that `repeats` is assembled flat.
    """
    corner = skin.position_space.dofmap.list
    neighbour, opposite = skin.neighbours
    alone = neighbour == np.arange(len(corner))[:, None]
    flap = np.where(alone, corner, corner[neighbour, opposite])
    normals, mirrored = guided_edges(skin, corner, supports)
    mirrored &= alone
    mirror = normals * mirrored[:, :, None]
    has_moment = ~alone | mirrored
    if bending.seams == "hinged":
        has_moment &= ~_on_seam(skin, corner)
    rotation: Floats = np.zeros(alone.shape)
    if bending.curvature == "midedge":
        first, second = np.moveaxis(opposite_edges(skin.vertex[corner]), -1, 0)
        turning = (has_moment | alone if turn_free else has_moment) & ~mirrored
        # Rotations become lengths by about that of an edge.
        length = float(np.sqrt(2 * skin.pattern.areas.mean()))
        factor = np.where(first < second, 2.0, -2.0) / length
        rotation = np.where(turning, factor, 0.0)
    place = skin.pattern.points[skin.vertex]
    assembled = edge_angles(place[corner], place[flap], mirror) * has_moment
    shaped = bending.rest == "assembled"
    if shaped:
        _require_unfolded(skin, assembled)
    return Hinges(
        flap=flap.astype(np.int32),
        has_moment=has_moment,
        mirror=mirror,
        tensors=hinge_tensors(skin, has_moment | (rotation != 0), poisson),
        rest=assembled if shaped else np.zeros_like(assembled),
        rotation=rotation,
        side=_sides(assembled, mirrored) * (not repeats),
    )


def hinge_tensors(skin: Skin, known: Bools, poisson: float) -> Floats:
    """Return `Hinges.tensors` for the flat corners where they are; known edges have an angle."""
    return _tensors(_average(flat_corners(skin)), known, poisson)


def _sides(assembled: Floats, mirrored: Bools) -> Floats:
    """Return the sides of steep folds; two layers on each other, ±180°, open as a convex skin."""
    convex = (assembled > 0) | (np.abs(assembled) > np.pi - TOUCHING)
    side = np.where(mirrored, EITHER, np.where(convex, 1.0, -1.0))
    return np.where(np.abs(assembled) > STEEP, side, 0.0)


def _require_unfolded(skin: Skin, rest: Floats) -> None:
    """Check that the side of each fold at rest is known (collective)."""
    sharpest = largest(skin.comm, float(np.abs(rest[: len(skin.owned_cells)]).max(initial=0)))
    if sharpest > FOLDED:
        raise ParameterError(
            f"rest = 'assembled': an edge is folded by {np.degrees(sharpest):.0f} degrees; its "
            f"side is ambiguous beyond {np.degrees(FOLDED):.0f}. Assemble it less folded, or "
            "take the flat rest shape."
        )


def _on_seam(skin: Skin, corner: LocalInts) -> Bools:
    pattern = skin.pattern
    original = skin.cell[skin.density_space.dofmap.list[:, 0]]
    vertex = skin.vertex[corner]
    place = np.argmax(pattern.triangles[original][:, None, :] == vertex[:, :, None], axis=2)
    return np.take_along_axis(pattern.seam_edges[original], place, axis=1)


def guided_edges(skin: Skin, corner: LocalInts, supports: Supports) -> tuple[Floats, Bools]:
    """Unit normals of the mirrors at the edges of local triangles, and whether there is one."""
    normals = np.zeros((*corner.shape, 3))
    if not len(supports.guided):
        return normals, np.zeros(corner.shape, dtype=bool)
    count = len(skin.pattern.points)
    # Of several rows for one edge the last counts.
    known, last = np.unique(edge_keys(supports.guided, count)[::-1], return_index=True)
    unit = supports.normals / np.linalg.norm(supports.normals, axis=1)[:, None]
    unit = unit[::-1][last]
    keys = edge_keys(opposite_edges(skin.vertex[corner]), count)
    place = np.minimum(np.searchsorted(known, keys), len(known) - 1)
    found = known[place] == keys
    normals[found] = unit[place[found]]
    return normals, found


def edge_angles(corners: Floats, flaps: Floats, mirror: Floats) -> Floats:
    """Return the angles at edges of triangles in space, (cells, 3) in rad, as of `forms.bending`.

    They lie between corners and the flaps across the edges, which planes with the unit normals
    `mirror` reflect, all (cells, 3, 3); zero is no mirror.
    """
    a, b, c = np.roll(corners, -1, axis=1), np.roll(corners, -2, axis=1), corners
    away = np.einsum("cij,cij->ci", mirror, flaps - a)
    d = flaps - 2 * away[:, :, None] * mirror
    one, two = np.cross(b - a, c - a), np.cross(a - b, d - b)
    unit = (b - a) / np.linalg.norm(b - a, axis=2)[:, :, None]
    sine = np.einsum("cij,cij->ci", np.cross(one, two), unit)
    return np.asarray(np.arctan2(sine, np.einsum("cij,cij->ci", one, two)))


def flat_corners(skin: Skin) -> Floats:
    """Flat corners of the local triangles, shape (cells, 3, 2)."""
    count = len(skin.position_space.dofmap.list)
    return skin.mesh.geometry.x[: 3 * count].reshape(count, 3, 3)[:, :, :2]


def _average(flat: Floats) -> Floats:
    """Columns Tᵢ = n̄ᵢ n̄ᵢᵀ l̄ᵢ/(2 Ā) of the triangle average, eq. (4), as (xx, yy, 2xy)."""
    edge = np.roll(flat, -2, axis=1) - np.roll(flat, -1, axis=1)
    length = np.linalg.norm(edge, axis=2)
    along = edge / length[:, :, None]
    n = np.stack([along[:, :, 1], -along[:, :, 0]], axis=2)
    area = np.abs(flat_areas(flat))
    parts = np.stack([n[:, :, 0] ** 2, n[:, :, 1] ** 2, 2 * n[:, :, 0] * n[:, :, 1]], axis=1)
    return np.asarray(parts * (length / (2 * area[:, None]))[:, None, :])


def _tensors(columns: Floats, known: Bools, poisson: float) -> Floats:
    """Tensors Tᵢ of the curvature of least energy with given angles at the edges that have one.

    With all three edges they are the columns. With rows g of the inverse at known edges they are
    D⁻¹gᵀ(g D⁻¹gᵀ)⁻¹.
    """
    tensors = columns.transpose(0, 2, 1).copy()
    compliance = np.linalg.inv(
        np.array([[1, poisson, 0], [poisson, 1, 0], [0, 0, (1 - poisson) / 2]])
    )
    for edges in list(product((False, True), repeat=3))[:-1]:
        cells = np.flatnonzero((known == edges).all(axis=1))
        chosen = np.flatnonzero(edges)
        tensors[cells] = 0.0
        g = np.linalg.inv(columns[cells])[:, chosen]
        soft = compliance @ g.transpose(0, 2, 1)
        tensors[np.ix_(cells, chosen)] = (soft @ np.linalg.inv(g @ soft)).transpose(0, 2, 1)
    return tensors * [1, 1, 0.5]
