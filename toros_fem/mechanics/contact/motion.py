"""Motion of a rigid body by its pose, with exact first and second derivatives.

A pose is a translation t in m and a rotation vector θ in rad. It takes a point p of a body with
centre c to c + t + R(θ) (p − c), with Rodrigues' formula for an angle φ = |θ|:

    R(θ) y = cos φ y + A θ × y + B (θ · y) θ,    A = sin φ / φ,    B = (1 − cos φ) / φ²

All three coefficients are smooth functions of φ², so that no angle is special at zero. At φ = 2π
the rotation is that of θ = 0 about every axis: there the Jacobian loses two of its six ranks, and
near there a pose is a poor unknown. A pose with φ > π should be replaced by the equal one with
angle φ − 2π (`shortest`) where it is kept as the start of a next solve.
"""

from __future__ import annotations

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.measures.rotation import axial, skew

# Squared angle in rad² below which the coefficients are summed as series, and terms of these.
SERIES, TERMS = 1.0, 10


def placed(points: Floats, centre: Floats, pose: Floats) -> Floats:
    """Return where a pose, (6,), takes points of a body, (n, 3) in m where it is made."""
    return np.asarray((points - centre) @ rotation(pose[3:]).T + (centre + pose[:3]))


def rotation(vector: Floats) -> Floats:
    """Return the rotation matrix, (3, 3), of a rotation vector in rad, (3,)."""
    cosine, a, b = _coefficients(float(vector @ vector))[0]
    return np.asarray(cosine * np.eye(3) + a * skew(vector) + b * np.outer(vector, vector))


def pose_jacobian(points: Floats, centre: Floats, pose: Floats) -> Floats:
    """Return the derivative of `placed` by the pose, (3 n, 6), in m/m and m/rad.

    Rows are x, y, z of each point in turn.
    """
    arms, turn = points - centre, pose[3:]
    (_, a, b), (dcosine, da, db), _ = _coefficients(float(turn @ turn))
    along, across = arms @ turn, np.cross(turn, arms)
    by_square = dcosine * arms + da * across + db * along[:, None] * turn
    jacobian: Floats = np.zeros((len(points), 3, 6))
    jacobian[:, :, :3] = np.eye(3)
    jacobian[:, :, 3:] = 2 * by_square[:, :, None] * turn
    jacobian[:, :, 3:] -= a * skew(arms)
    jacobian[:, :, 3:] += b * (along[:, None, None] * np.eye(3) + turn[:, None] * arms[:, None, :])
    return jacobian.reshape(-1, 6)


def pose_curvature(points: Floats, centre: Floats, pose: Floats, force: Floats) -> Floats:
    """Return the second derivative by the pose of Σ force · `placed`, (6, 6), forces held."""
    turn = pose[3:]
    (_, _, b), (dcosine, da, db), (ddcosine, dda, ddb) = _coefficients(float(turn @ turn))
    # All that the points enter by: the sum is cos φ tr G + A θ · moment + B θ · G θ.
    products = force.T @ (points - centre)
    trace, both = float(np.trace(products)), products + products.T
    moment = axial(products)
    spin, square, stretched = float(turn @ moment), float(turn @ products @ turn), both @ turn
    first = dcosine * trace + da * spin + db * square
    second = ddcosine * trace + dda * spin + ddb * square
    mixed = np.outer(turn, da * moment + db * stretched)
    curvature: Floats = np.zeros((6, 6))
    curvature[3:, 3:] = (
        2 * first * np.eye(3) + 4 * second * np.outer(turn, turn) + 2 * (mixed + mixed.T) + b * both
    )
    return curvature


def shortest(vectors: Floats) -> Floats:
    """Return rotation vectors in rad, (…, 3), of at most π that give the same rotations."""
    angle = np.linalg.norm(vectors, axis=-1, keepdims=True)
    turns = np.round(angle / (2 * np.pi))
    return np.asarray(vectors * (1 - 2 * np.pi * turns / np.maximum(angle, np.pi)))


def _coefficients(square: float) -> Floats:
    """Return cos φ, A and B, and their first and second derivatives by φ², (3, 3)."""
    if square < SERIES:
        return _series(square)
    angle = np.sqrt(square)
    cosine, a = np.cos(angle), np.sin(angle) / angle
    b = (1 - cosine) / square
    dcosine, da, db = -a / 2, (cosine - a) / (2 * square), (a / 2 - b) / square
    second = -da / 2, (dcosine - 3 * da) / (2 * square), (da / 2 - 2 * db) / square
    return np.array([[cosine, a, b], [dcosine, da, db], second])


def _series(square: float) -> Floats:
    """Return the same as `_coefficients` by the power series of the three functions."""
    orders = np.arange(TERMS)
    factorials = np.cumprod(np.append(1.0, np.arange(1, 2 * TERMS + 1)))
    series = (-1.0) ** orders / [factorials[2 * orders + k] for k in range(3)]
    out: Floats = np.empty((3, 3))
    for row in out:
        row[:] = np.polynomial.polynomial.polyval(square, series.T)
        series = series[:, 1:] * np.arange(1, series.shape[1])
    return out
