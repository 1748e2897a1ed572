"""Line families as design variables: fixed directions first, then two free ones.

They become the relaxed material of `mechanics.skin.designs`: ρ̄, here 0, the shares, and cos 2t and
sin 2t of all families.
"""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.keys import In, Table, key
from toros_fem.base.validation import require_between

# Exponent p of the smooth limit on the sum of shares.
LIMIT_POWER = 4.0

Directions = Annotated[int, In(at_least=2)]
Share = Annotated[float, In(above=0, at_most=0.9)]


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
