"""Line families as design variables: fixed directions first, then two free ones.

They become the relaxed material of `mechanics.skin.designs`: ρ̄, here 0, the shares, and cos 2t and
sin 2t of all families.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, ClassVar, Self

import numpy as np
from scipy.sparse import coo_array, csc_array, diags_array, eye_array, kron, sparray
from scipy.sparse.linalg import splu

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import In, Table, key
from toros_fem.base.mpi import dot, together, total
from toros_fem.base.validation import Bools, Floats, Ints, require_between, require_count
from toros_fem.design.density.filters import Linear, Map
from toros_fem.design.lines.field import LineField
from toros_fem.design.loop.fields import Fields
from toros_fem.design.loop.problem import ObjectiveTerm
from toros_fem.design.loop.shape_design import ShapeProblem
from toros_fem.mechanics.skin.designs import CROSSING, LineDesign
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.skin import Skin

# Exponent p of the smooth limit on the sum of shares.
LIMIT_POWER = 4.0
Directions = Annotated[int, In(at_least=2)]
Share = Annotated[float, In(above=0, at_most=0.9)]
# Mean of the random start's variables, and the standard deviation of their logarithm.
START, SPREAD = 0.04, 0.7
# Charts that are turned by less than this, in rad, count as parallel.
PARALLEL = 1e-9


class FixedDirections(Table):
    """Variables of the first stage: the shares of several directions, evenly over half a turn.

    Variables x ≥ 0, (n, N), become shares s = S x/(1 + (Σx)ᵖ)^(1/p) whose sum stays below S. The
    energy is linear in them but for the stiffening of the fabric; no angle is a variable, so that
    no angle can be caught.
    """

    directions: Directions = key(12, "number N of directions")
    limit: Share = key(0.35, "limit S on the sum of the shares")

    @property
    def count(self) -> int:
        """Number of families, and of variables of each triangle."""
        return self.directions

    fields = count

    @property
    def centre(self) -> Floats:
        """Variables of no lines, which no turn of a chart changes, (N,)."""
        return np.zeros(self.directions)

    @property
    def angles(self) -> Floats:
        """Angles of the directions in rad, (N,)."""
        return np.pi * np.arange(self.directions) / self.directions

    def transport(self, turn: float) -> Floats:
        """Return the matrix that takes shares to a chart turned by an angle in rad, (N, N).

        A direction between two of the chart's own is shared out between them.
        """
        n = self.directions
        place = np.arange(n) + turn * n / np.pi
        low = np.floor(place).astype(int)
        high = place - low
        matrix = np.zeros((n, n))
        np.add.at(matrix, (low % n, np.arange(n)), 1 - high)
        np.add.at(matrix, ((low + 1) % n, np.arange(n)), high)
        return matrix

    def forward(self, x: Floats) -> Floats:
        """Return the relaxed material, (n, 1 + 3 N), of variables, (n, N)."""
        total = x.sum(axis=1, keepdims=True)
        shares = self.limit * x * (1 + total**LIMIT_POWER) ** (-1 / LIMIT_POWER)
        double = np.broadcast_to(2 * self.angles, x.shape)
        return np.hstack([np.zeros((len(x), 1)), shares, np.cos(double), np.sin(double)])

    def backward(self, x: Floats, by_material: Floats) -> Floats:
        """Return the gradient by the variables, (n, N), from that by the material."""
        by_shares = by_material[:, 1 : 1 + self.count]
        p, total = LIMIT_POWER, x.sum(axis=1, keepdims=True)
        slope = (1 + total**p) ** (-1 / p)
        bend = -(total ** (p - 1)) * (1 + total**p) ** (-1 / p - 1)
        common = bend * (x * by_shares).sum(axis=1, keepdims=True)
        return np.asarray(self.limit * (slope * by_shares + common))


class FreeDirections(Table):
    """Variables of the second stage: share and direction of two families.

    Variables are in [0, 1]: the two shares over their limits, then for each family the components
    (1 + cos 2t)/2 and (1 + sin 2t)/2 of the double-angle vector. Only its direction counts.

    Attributes:
        fields, count: Number of variables of each triangle, and of families.
    """

    limits: tuple[Share, Share] = key((0.3, 0.3), "limit on the share of either family")
    fields: ClassVar = 6
    count: ClassVar = 2

    def __post_init__(self) -> None:
        require_between(0.0, 0.9, sum_of_limits=sum(self.limits))

    @property
    def centre(self) -> Floats:
        """Variables of no lines, which no turn of a chart changes, (6,)."""
        return np.array([0.0, 0.0, 0.5, 0.5, 0.5, 0.5])

    def transport(self, turn: float) -> Floats:
        """Return the matrix that takes x − `centre` to a chart turned by an angle, (6, 6)."""
        c, s = np.cos(2 * turn), np.sin(2 * turn)
        matrix = np.eye(6)
        for k in (2, 4):
            matrix[k : k + 2, k : k + 2] = [[c, -s], [s, c]]
        return matrix

    def variables(self, shares: Floats, angles: Floats) -> Floats:
        """Return the variables, (n, 6), of shares and angles, both (n, 2)."""
        double = np.stack([np.cos(2 * angles), np.sin(2 * angles)], axis=2).reshape(-1, 4)
        return np.hstack([np.clip(shares / np.array(self.limits), 0, 1), (1 + double) / 2])

    def forward(self, x: Floats) -> Floats:
        """Return the relaxed material, (n, 7), of variables, (n, 6)."""
        shares, double = x[:, :2] * np.array(self.limits), 2 * x[:, 2:] - 1
        return np.hstack([np.zeros((len(x), 1)), shares, double[:, ::2], double[:, 1::2]])

    def backward(self, x: Floats, by_material: Floats) -> Floats:
        """Return the gradient by the variables, (n, 6), from that by the material."""
        by_shares, by_double = by_material[:, 1:3], 2 * by_material[:, 3:]
        return np.hstack([by_shares * np.array(self.limits), by_double[:, [0, 2, 1, 3]]])


Families = FixedDirections | FreeDirections


@dataclass(frozen=True, eq=False)
class LineShares(Fields):
    """Line families on the designed triangles: shares and directions.

    The variables of a triangle are those of `families`, one after the other; ρ̃ are their smoothed
    values and ρ̄ the relaxed material, (own, 1 + 3 K).

    Attributes:
        families: How variables become shares and directions.
        smoothing: Filter of the variables.
    """

    skin: Skin
    families: Families
    smoothing: Linear
    passive: Floats | None = None

    @property
    def beta(self) -> float:
        """0: nothing is projected."""
        return 0.0

    def with_beta(self, beta: float) -> Self:
        """Return these fields: nothing is projected."""
        return self

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Least and largest value of each variable; equal where it is prescribed."""
        designed = np.repeat(self.designed, self.families.fields)
        return np.zeros(len(designed)), designed.astype(np.float64)

    def checked(self, x: Floats) -> Floats:
        """Return the variables as an array (collective)."""
        count = len(self.skin.owned_cells) * self.families.fields
        with together(self.skin.comm):
            if np.shape(x) != (count,):
                raise ParameterError(
                    f"the variables have shape {np.shape(x)}; this rank has {count}, "
                    f"{self.families.fields} of each owned triangle."
                )
            if not np.all((np.asarray(x) >= 0) & (np.asarray(x) <= 1)):
                raise ParameterError("a variable of the line families leaves [0, 1], or is NaN.")
        return np.asarray(x)

    def with_passive(self, x: Floats) -> Floats:
        """Return the variables, zero where there are no line families."""
        return x * np.repeat(self.designed, self.families.fields)

    def forward(self, x: Floats) -> tuple[Floats, Floats]:
        """Return smoothed variables and the relaxed material (collective)."""
        smooth = self.smoothing.forward(x)
        material = self.families.forward(smooth.reshape(-1, self.families.fields))
        if self.passive is not None:
            given = ~np.isnan(self.passive)
            material[given] = 0.0
            material[given, 0] = self.passive[given]
        return smooth, material

    def backward(
        self, filtered: Floats, by_projected: Floats, by_filtered: Floats | None = None
    ) -> Floats:
        """Return the gradient by the variables (collective)."""
        smooth = filtered.reshape(-1, self.families.fields)
        by_smooth = self.families.backward(smooth, by_projected * self.designed[:, None])
        both = by_smooth.ravel() if by_filtered is None else by_smooth.ravel() + by_filtered
        return self.with_passive(self.smoothing.backward(both))

    def start(self, seed: int) -> Floats:
        """Return random variables: smoothed noise (collective).

        Only the first stage has a random start.
        """
        require_count(0, seed=seed)
        shape = len(self.skin.pattern.panel), self.families.fields
        noise = np.random.default_rng(seed).standard_normal(shape)[self.skin.owned_cells]
        smooth, comm = self.smoothing.forward(self.with_passive(noise.ravel())), self.skin.comm
        count = total(comm, float(self.bounds[1].sum()))
        deviation = np.sqrt(dot(comm, smooth, smooth) / count)
        return self.with_passive(np.clip(START * np.exp(SPREAD * smooth / deviation), 0, 1))

    def reinforcement(self, projected: Floats) -> tuple[float, float]:
        """Return the mean sum of shares, and 0: lines are not grey (collective)."""
        return MeanShares(self).forward(projected), 0.0

    def shown(self, projected: Floats) -> Floats:
        """Return the part of each owned triangle that is covered: ρ̄ and all shares, at most 1."""
        return np.minimum(projected[:, : 1 + self.families.count].sum(axis=1), 1.0)

    def line_field(self, projected: Floats) -> LineField:
        """Return the line families of a relaxed material, on every rank (collective)."""
        material = self.skin.gather_cells(projected)
        shares, cosine, sine = np.split(material[:, 1:], 3, axis=1)
        return LineField(self.skin.pattern, shares, np.arctan2(sine, cosine) / 2)


@dataclass(frozen=True, eq=False)
class MeanShares:
    """Mean sum of all shares over the designed area, so that no lines are where none help."""

    fields: LineShares

    def forward(self, projected: Floats) -> float:
        """Return the mean (collective)."""
        shares = projected[:, 1 : 1 + self.fields.families.count].sum(axis=1)
        return dot(self.fields.skin.comm, self.fields.area_fractions(), shares)

    def backward(self, projected: Floats) -> Floats:
        """Return its derivative by the relaxed material (collective)."""
        gradient = np.zeros_like(projected)
        gradient[:, 1 : 1 + self.fields.families.count] = self.fields.area_fractions()[:, None]
        return gradient


def relaxed_problem(
    design: ShapeProblem,
    families: Families,
    radius: float,
    share_weight: float | None = None,
    crossing: float = CROSSING,
) -> ShapeProblem:
    """Return the relaxed problem of a density design on the same mesh (collective).

    Target, supports, loads, pressures and prescribed densities are those of the design; filter,
    projection, perimeter and widths are left out.

    Args:
        radius: That of the smoothing in m.
        share_weight: Factor on the mean sum of shares in T; None leaves this cost out.
        crossing: Factor of bonded crossings.
    """
    skin, given = design.skin, design.physics
    designed = skin.gather_cells(design.designed.astype(np.float64)) > 0.5
    fields = LineShares(
        skin, families, smoothing(skin, radius, families, designed), design.fields.passive
    )
    lines = partial(LineDesign, families=families.count, crossing=crossing)
    return ShapeProblem(
        fields,
        replace(given, solver=given.solver.like(design=lines, log=given.solver.log)),
        design.objective,
        [] if share_weight is None else [ObjectiveTerm("shares", MeanShares(fields), share_weight)],
        metrics=design.metrics,
        whole=design.whole,
        target=design.target,
    )


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
