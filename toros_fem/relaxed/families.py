"""Line families as design variables: fixed directions first, then two free ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from toros_fem._types import Floats
from toros_fem._validate import require_between, require_count, require_positive

# Exponent p of the smooth limit on the sum of shares.
LIMIT_POWER = 4.0


@dataclass(frozen=True)
class FixedDirections:
    """Variables of the first stage: the shares of several directions, evenly over half a turn.

    Variables x ≥ 0, (n, N), become shares s = S x/(1 + (Σx)ᵖ)^(1/p) whose sum stays below S. The
    energy is linear in them but for the stiffening of the fabric; no angle is a variable, so that
    no angle can be caught.

    Attributes:
        directions: Number N of directions.
        limit: S, the limit on the sum of the shares.

    Raises:
        ParameterError: A value is out of its bounds.
    """

    directions: int = 12
    limit: float = 0.35

    def __post_init__(self) -> None:
        require_count(2, directions=self.directions)
        require_positive(limit=self.limit)
        require_between(0.0, 0.9, limit=self.limit)

    @property
    def fields(self) -> int:
        """Number of variables of each triangle."""
        return self.directions

    @property
    def count(self) -> int:
        """Number of families."""
        return self.directions

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

    def forward(self, x: Floats) -> tuple[Floats, Floats]:
        """Return shares and angles, both (n, N), of variables, (n, N)."""
        total = x.sum(axis=1, keepdims=True)
        shares = self.limit * x * (1 + total**LIMIT_POWER) ** (-1 / LIMIT_POWER)
        return shares, np.broadcast_to(self.angles, x.shape)

    def backward(self, x: Floats, by_shares: Floats, by_angles: Floats) -> Floats:
        """Return the gradient by the variables, (n, N), from those by shares and angles."""
        p, total = LIMIT_POWER, x.sum(axis=1, keepdims=True)
        slope = (1 + total**p) ** (-1 / p)
        bend = -(total ** (p - 1)) * (1 + total**p) ** (-1 / p - 1)
        common = bend * (x * by_shares).sum(axis=1, keepdims=True)
        return np.asarray(self.limit * (slope * by_shares + common))


@dataclass(frozen=True)
class FreeDirections:
    """Variables of the second stage: share and direction of two families.

    Variables are in [0, 1]: the two shares over their limits, then for each family the components
    (1 + cos 2t)/2 and (1 + sin 2t)/2 of the double-angle vector. Only its direction counts.

    Attributes:
        limits: Limit on the share of either family.

    Raises:
        ParameterError: A limit is out of its bounds.
    """

    limits: tuple[float, float] = (0.3, 0.3)

    def __post_init__(self) -> None:
        for limit in self.limits:
            require_positive(limit=limit)
        require_between(0.0, 0.9, sum_of_limits=sum(self.limits))

    @property
    def fields(self) -> int:
        """Number of variables of each triangle."""
        return 6

    @property
    def count(self) -> int:
        """Number of families."""
        return 2

    def transport(self, turn: float) -> Floats:
        """Return the matrix that takes z − z₀ to a chart turned by an angle in rad, (6, 6).

        Variables of directions count from z₀ = 1/2, where the double-angle vector is 0; see
        `centre`.
        """
        c, s = np.cos(2 * turn), np.sin(2 * turn)
        matrix = np.eye(6)
        for k in (2, 4):
            matrix[k : k + 2, k : k + 2] = [[c, -s], [s, c]]
        return matrix

    def variables(self, shares: Floats, angles: Floats) -> Floats:
        """Return the variables, (n, 6), of shares and angles, both (n, 2)."""
        double = np.stack([np.cos(2 * angles), np.sin(2 * angles)], axis=2).reshape(-1, 4)
        return np.hstack([np.clip(shares / np.array(self.limits), 0, 1), (1 + double) / 2])

    def forward(self, x: Floats) -> tuple[Floats, Floats]:
        """Return shares and angles, both (n, 2), of variables, (n, 6)."""
        double = 2 * x[:, 2:] - 1
        return x[:, :2] * np.array(self.limits), np.arctan2(double[:, 1::2], double[:, ::2]) / 2

    def backward(self, x: Floats, by_shares: Floats, by_angles: Floats) -> Floats:
        """Return the gradient by the variables, (n, 6), from those by shares and angles."""
        double = 2 * x[:, 2:] - 1
        c, s = double[:, ::2], double[:, 1::2]
        square = np.maximum(c * c + s * s, 1e-12)
        by_double = np.stack([-s * by_angles, c * by_angles], axis=2) / square[:, :, None]
        # t = atan2(s, c)/2 and c = 2 x − 1: the halves cancel.
        return np.hstack([by_shares * np.array(self.limits), by_double.reshape(len(x), 4)])
