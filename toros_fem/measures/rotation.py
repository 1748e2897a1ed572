"""Rotation that best maps one set of points onto another, and its derivative."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import Floats

# Smallest over largest eigenvalue of B: below this the rotation is not determined.
DETERMINED = 1e-6


def polar_rotation(moments: Floats) -> tuple[Floats, Floats]:
    """Return the rotation R that maximises tr(Rᵀ M), for each M = Σ w b aᵀ (Kabsch 1976).

    R is the best rotation of a onto b. δR = R [ω]× with ω = B⁻¹ axial(Rᵀ δM), where
    axial(N) = (N₃₂ − N₂₃, N₁₃ − N₃₁, N₂₁ − N₁₂) and B = tr(P) 1 − P, P = Rᵀ M: from
    δM = δR P + R δP with P and δP symmetric. All are (…, 3, 3). B is singular where R is not
    unique: the points lie on a line, or one set is the mirror image of the other.
    """
    u, _, vt = np.linalg.svd(moments)
    sign = np.ones(moments.shape[:-1])
    sign[..., 2] = np.sign(np.linalg.det(u @ vt))
    rotation = (u * sign[..., None, :]) @ vt
    stretch = np.swapaxes(rotation, -1, -2) @ moments
    trace = np.trace(stretch, axis1=-2, axis2=-1)[..., None, None]
    return rotation, trace * np.eye(3) - (stretch + np.swapaxes(stretch, -1, -2)) / 2


def require_determined(matrices: Floats, names: Sequence[str], remedy: str) -> None:
    """Check that the best rotations of named points onto the target are unique.

    B of `polar_rotation`, (k, 3, 3), in m², is the same on all ranks; `remedy` ends the message.
    """
    for name, values in zip(names, np.linalg.eigvalsh(matrices), strict=True):
        if not values[0] > DETERMINED * values[-1]:
            raise ParameterError(
                f"the best rotation of {name} onto the target is not unique: one of them lies on a "
                f"line, or is the other's mirror image (eigenvalues {values} m²). {remedy}"
            )


def axial(matrices: Floats) -> Floats:
    """Return (N₃₂ − N₂₃, N₁₃ − N₃₁, N₂₁ − N₁₂) of matrices, (…, 3, 3)."""
    skew = matrices - np.swapaxes(matrices, -1, -2)
    return np.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], axis=-1)


def best_rotation(reference: Floats, deformed: Floats) -> Floats:
    """Return the rotation, (3, 3), that best maps centred points, (k, 3), onto others: R a ≈ b."""
    a, b = reference - reference.mean(axis=0), deformed - deformed.mean(axis=0)
    return polar_rotation(b.T @ a)[0]
