"""What two shapes are in the limit: an inflated channel, and a sheet with fine ribs on one face."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize

from benchmarks.measured.compared import Floats


def channel_curvature(ratio: float, parts: int = 40) -> float:
    """Return by what the curvature of an endless channel grows, from its width over radius.

    The channel is an arc of two flat sheets that do not stretch, sealed at both borders. No line
    along it gets longer, and the volume is the largest. Lengths are over the flat radius, and the
    cross-section is a polygon of equal edges.
    """
    edge = ratio / parts
    flat = 1 - ratio / 2 + edge * np.arange(parts + 1)

    def shape(of: Floats) -> tuple[Floats, Floats]:
        steps = edge * np.stack([np.cos(of[2:]), np.sin(of[2:])])
        radius, height = np.concatenate([np.zeros((2, 1)), np.cumsum(steps, axis=1)], axis=1)
        return of[1] + radius, height

    def less_volume(of: Floats) -> float:
        radius, height = shape(of)
        middle = (radius[1:] + radius[:-1]) * (height[1:] + height[:-1])
        return float(-of[0] * (middle * np.diff(radius)).sum() / 2 / ratio**2)

    slopes = np.pi / 2 * (1 - (2 * np.arange(parts) + 1) / parts)
    found = minimize(
        less_volume, [1.05, 1 - ratio / np.pi, *slopes], method="SLSQP",
        options={"maxiter": 400, "ftol": 1e-10},
        constraints=[
            {"type": "ineq", "fun": lambda of: (flat - of[0] * shape(of)[0]) / ratio},
            {"type": "eq", "fun": lambda of: shape(of)[1][-1] / ratio},
        ],
    )  # fmt: skip
    return float(found.x[0])


def plate(young: float, poisson: float, low: float, high: float) -> Floats:
    """Return stretching and bending stiffness, (6, 6), of a plate between two heights."""
    sheet = np.array([[1, poisson, 0], [poisson, 1, 0], [0, 0, (1 - poisson) / 2]])
    moments = [(high**k - low**k) / k for k in (1, 2, 3)]
    block = np.array([moments[:2], moments[1:]])
    return np.kron(block, young / (1 - poisson**2) * sheet)


def rib_curvature(base: Floats, ribbed: Floats, share: float, angle: float) -> float:
    """Return the curvature across a pulled strip over its strain, for fine ribs.

    Two phases, (6, 6) each, in stripes: only the strain normal to them, the shear, and the
    curvature normal to them differ between the phases (a laminate of rank one, which is exact).

    Args:
        base, ribbed: As `plate` gives them.
        share: Of the ribs in the area.
        angle: Of the ribs from the width, in rad.
    """
    differ = np.eye(6)[:, [0, 2, 3]]
    jump = base - ribbed
    between = differ.T @ (share * base + (1 - share) * ribbed) @ differ
    mean = (1 - share) * base + share * ribbed
    eased = share * (1 - share) * jump @ differ @ np.linalg.solve(between, differ.T @ jump)
    c, s = np.cos(angle), -np.sin(angle)
    turn = np.array([[c * c, s * s, c * s], [s * s, c * c, -c * s], [-2 * c * s, 2 * c * s,
                     c * c - s * s]])  # fmt: skip
    turned = np.kron(np.eye(2), turn)
    whole = turned.T @ (mean - eased) @ turned
    # Held are strain and curvature along the strip, which may twist.
    free = [1, 2, 4, 5]
    return float(np.linalg.solve(whole[np.ix_(free, free)], -whole[free, 0])[2])
