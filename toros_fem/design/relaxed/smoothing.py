"""Smoothing of the design fields of a relaxed problem, across seams with directions turned."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import coo_array, csc_array, diags_array, eye_array, kron
from scipy.sparse.linalg import splu

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.base.validation import require_positive
from toros_fem.meshes.skin import Skin

# Charts that are turned by less than this, in rad, count as parallel.
PARALLEL = 1e-9

Transport = Callable[[float], Floats]
"""Matrix, (k, k), that takes the k fields of a triangle to a chart that is turned by an angle."""


class Smoothing:
    """Filter of several fields a triangle by diffusion from triangle to triangle.

    (M + ℓ² L) x̃ = M x with M the flat areas and L the two-point fluxes between neighbours, ℓ =
    R/(2√3), as of the Helmholtz filter (Lazarov & Sigmund 2011). Line families cross seams: the
    neighbour's fields are first turned by the angle between the two charts. Constant fields stay
    as they are where no chart is turned. Values stay within their bounds there, and everywhere if
    a turn shares each field out: no share gets below 0.

    The mesh of a relaxed problem is coarse: every rank solves the whole system.

    Attributes:
        radius: R in m.

    Args:
        skin: The sewn skin.
        radius: R in m.
        fields: Number k of fields.
        transport: How fields less their centre turn from chart to chart; None: they do not.
        centre: Centre of the fields, (k,); None for zero.
        designed: Whether each triangle of the pattern has fields, (t,); others are left at zero.

    Raises:
        ParameterError: The radius is not positive.
    """

    def __init__(
        self,
        skin: Skin,
        radius: float,
        fields: int,
        transport: Transport | None = None,
        centre: Floats | None = None,
        designed: Bools | None = None,
    ) -> None:
        require_positive(radius=radius)
        self.radius = float(radius)
        pattern, self._skin, self._fields = skin.pattern, skin, fields
        self._centre: Floats = np.zeros(fields) if centre is None else centre
        count = len(pattern.panel)
        self._cells = np.arange(count) if designed is None else np.flatnonzero(designed)
        number = np.full(count, -1)
        number[self._cells] = np.arange(len(self._cells))
        sides = number[pattern.edges.sides[pattern.edges.inner]]
        kept = np.all(sides >= 0, axis=1)
        (one, two), turns = sides[kept].T, pattern.chart_turns[kept]
        start, end = np.swapaxes(pattern.flat_points[pattern.flat_sides[kept, 0]], 0, 1)
        areas = self._mass = pattern.areas[self._cells]
        # The centroids are 2 (A + A')/(3 l) apart, measured across the edge of length l.
        squared_length = ((end - start) ** 2).sum(axis=1)
        flux = self.radius**2 / 12 * 1.5 * squared_length / (areas[one] + areas[two])
        turned = np.abs(turns) > PARALLEL
        self._coupled = transport is not None and bool(turned.any())
        if not self._coupled:
            turned[:] = False
        same = ~turned
        matrix = diags_array(areas) + _laplacian(one[same], two[same], flux[same], len(areas))
        if transport is not None and self._coupled:
            turns = np.array([transport(float(turn)) for turn in turns[turned]])
            sides = np.stack([one[turned], two[turned]], axis=1)
            matrix = kron(matrix, eye_array(fields)) + _turned(
                sides, turns, flux[turned], fields * len(areas)
            )
        self._factor = splu(csc_array(matrix))

    def forward(self, values: Floats) -> Floats:
        """Return x̃ at owned triangles from x there, both flat, (own · k,) (collective)."""
        return self._apply(values, self._smoothed)

    def backward(self, gradient: Floats) -> Floats:
        """Return the gradient by x from that by x̃, both flat, (own · k,) (collective)."""
        return self._apply(gradient, lambda g: self._mass[:, None] * self._solve(g))

    def _apply(self, owned: Floats, action: Callable[[Floats], Floats]) -> Floats:
        skin = self._skin
        whole = skin.gather_cells(owned.reshape(-1, self._fields))
        out = np.zeros_like(whole)
        out[self._cells] = action(whole[self._cells])
        return out[skin.owned_cells].ravel()

    def _smoothed(self, values: Floats) -> Floats:
        return self._centre + self._solve(self._mass[:, None] * (values - self._centre))

    def _solve(self, right: Floats) -> Floats:
        if not self._coupled:
            return np.asarray(self._factor.solve(np.ascontiguousarray(right)))
        return np.asarray(self._factor.solve(right.ravel())).reshape(right.shape)


def _laplacian(one: Ints, two: Ints, weight: Floats, size: int) -> csc_array:
    rows, columns = np.concatenate([one, two, one, two]), np.concatenate([one, two, two, one])
    data = np.concatenate([weight, weight, -weight, -weight])
    return csc_array(coo_array((data, (rows, columns)), shape=(size, size)))


def _turned(sides: Ints, turns: Floats, weight: Floats, size: int) -> csc_array:
    """Return the matrix of the fluxes w (u − Tᵀ u') and w (u' − T u) between pairs of triangles.

    Tᵀ is the turn back. Off the diagonal no entry is positive where T shares out, as that of fixed
    directions does, which the Hessian of Σ w |T u − u'|²/2 with its Tᵀ T does not keep to.

    Args:
        sides: The two triangles of each pair, (p, 2).
        turns: T of each pair, (p, k, k).
        weight: w, (p,).
        size: Number of unknowns, k for each triangle.
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
