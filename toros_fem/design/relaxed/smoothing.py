"""Smoothing of the design fields of a relaxed problem, across seams with directions turned."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csc_array, diags_array, eye_array, kron, sparray
from scipy.sparse.linalg import splu

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.design.density.linear import Linear, Map
from toros_fem.design.relaxed.families import Families
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.skin import Skin

# Charts that are turned by less than this, in rad, count as parallel.
PARALLEL = 1e-9


def smoothing(
    skin: Skin, radius: float, families: Families, designed: Bools | None = None
) -> Linear:
    """Return the filter of the variables of line families by diffusion between triangles.

    (M + ℓ² L) x̃ = M x with M the flat areas and L the two-point fluxes between neighbours, ℓ =
    R/(2√3), as of the Helmholtz filter (Lazarov & Sigmund 2011). Line families cross seams: the
    neighbour's fields, less their centre, are first turned by the angle between the two charts.
    Constant fields stay as they are where no chart is turned. Values stay within their bounds
    there, and everywhere if a turn shares each field out: no share gets below 0.

    Both maps take the k variables of each owned triangle one after the other. Triangles of the
    pattern that are not designed, (t,), have no lines, and are left at zero. The mesh of a relaxed
    problem is coarse: every rank solves the whole system.
    """
    pattern, fields, centre = skin.pattern, families.fields, families.centre
    count = len(pattern.panel)
    cells = np.arange(count) if designed is None else np.flatnonzero(designed)
    mass = pattern.areas[cells, None]
    matrix, turned = _diffusion(pattern, radius, cells, families)
    factor = splu(csc_array(matrix))

    def solve(right: Floats) -> Floats:
        given = right.ravel() if turned else np.ascontiguousarray(right)
        return np.asarray(factor.solve(given)).reshape(right.shape)

    def of_designed(action: Map) -> Map:
        def apply(owned: Floats) -> Floats:
            whole = skin.gather_cells(owned.reshape(-1, fields))
            out = np.zeros_like(whole)
            out[cells] = action(whole[cells])
            return out[skin.owned_cells].ravel()

        return apply

    return Linear(
        of_designed(lambda x: centre + solve(mass * (x - centre))),
        of_designed(lambda gradient: mass * solve(gradient)),
    )


def _diffusion(
    pattern: Pattern, radius: float, cells: Ints, families: Families
) -> tuple[sparray, bool]:
    """Return M + ℓ² L, and whether it couples the fields of a triangle, since a chart is turned."""
    number = np.full(len(pattern.panel), -1)
    number[cells] = np.arange(len(cells))
    sides = number[pattern.edges.sides[pattern.edges.inner]]
    kept = np.all(sides >= 0, axis=1)
    sides, turns = sides[kept], pattern.chart_turns[kept]
    start, end = np.swapaxes(pattern.flat_points[pattern.flat_sides[kept, 0]], 0, 1)
    areas = pattern.areas[cells]
    # The centroids are 2 (A + A')/(3 l) apart, measured across the edge of length l.
    squared_length = ((end - start) ** 2).sum(axis=1)
    flux = radius**2 / 12 * 1.5 * squared_length / areas[sides].sum(axis=1)
    turned, fields = np.abs(turns) > PARALLEL, families.fields
    matrix = diags_array(areas) + _laplacian(sides[~turned], flux[~turned], len(areas))
    if not turned.any():
        return matrix, False
    across = np.array([families.transport(float(turn)) for turn in turns[turned]])
    coupled = _turned(sides[turned], across, flux[turned], fields * len(areas))
    return kron(matrix, eye_array(fields)) + coupled, True


def _laplacian(sides: Ints, weight: Floats, size: int) -> csc_array:
    one, two = sides.T
    rows, columns = np.concatenate([one, two, one, two]), np.concatenate([one, two, two, one])
    data = np.concatenate([weight, weight, -weight, -weight])
    return csc_array(coo_array((data, (rows, columns)), shape=(size, size)))


def _turned(sides: Ints, turns: Floats, weight: Floats, size: int) -> csc_array:
    """Return the matrix of the fluxes w (u − Tᵀ u') and w (u' − T u) between pairs of triangles.

    T, (p, k, k), is the turn of each pair, and Tᵀ the turn back. Off the diagonal no entry is
    positive where T shares out, as that of fixed directions does, which the Hessian of
    Σ w |T u − u'|²/2 with its Tᵀ T does not keep to.
    """
    count, fields = turns.shape[:2]
    unit = np.broadcast_to(np.eye(fields), turns.shape)
    local = np.block([[unit, -turns.transpose(0, 2, 1)], [-turns, unit]]) * weight[:, None, None]
    place = (fields * sides[:, :, None] + np.arange(fields)).reshape(count, 2 * fields)
    rows = np.repeat(place, 2 * fields, axis=1)
    columns = np.tile(place, (1, 2 * fields))
    return csc_array(
        coo_array((local.ravel(), (rows.ravel(), columns.ravel())), shape=(size, size))
    )
