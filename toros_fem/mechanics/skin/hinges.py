"""Hinges: the edges of the triangles, and the tensors that make a curvature of angles, eq. (4)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from toros_fem.base.array_types import Bools, Floats, LocalInts
from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import largest
from toros_fem.forms.bending import EITHER, STEEP
from toros_fem.materials.sheet import Bending
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes.skin import Skin
from toros_fem.meshes.triangles import edge_keys, flat_areas, opposite_edges

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
