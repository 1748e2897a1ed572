"""The rotation that best maps one set of points onto another, and how it changes with them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from toros_fem._types import Floats
from toros_fem.errors import TargetError

# Smallest eigenvalue of B over the largest: below, the rotation is not determined.
DETERMINED = 1e-6


def polar_rotation(moments: Floats) -> tuple[Floats, Floats]:
    """Rotation R that maximises tr(Rᵀ M), for each M = Σ w b aᵀ (Kabsch 1976).

    R maps a onto b as well as a rotation can. δR = R [ω]× with ω = B⁻¹ axial(Rᵀ δM), where
    axial(N) = (N₃₂ − N₂₃, N₁₃ − N₃₁, N₂₁ − N₁₂) and B = tr(P) 1 − P, P = Rᵀ M: from
    δM = δR P + R δP with P and δP symmetric.

    Args:
        moments: M, shape (…, 3, 3).

    Returns:
        R and B, shape (…, 3, 3). B is singular where points on a line, or on a mirror image, leave
        the rotation open.
    """
    u, _, vt = np.linalg.svd(moments)
    sign = np.ones(moments.shape[:-1])
    sign[..., 2] = np.sign(np.linalg.det(u @ vt))
    rotation = (u * sign[..., None, :]) @ vt
    stretch = np.swapaxes(rotation, -1, -2) @ moments
    trace = np.trace(stretch, axis1=-2, axis2=-1)[..., None, None]
    return rotation, trace * np.eye(3) - (stretch + np.swapaxes(stretch, -1, -2)) / 2


def require_determined(matrices: Floats, names: Sequence[str], remedy: str) -> None:
    """Check that the best rotations are the only ones.

    Args:
        matrices: B of `polar_rotation`, in m², shape (k, 3, 3), the same on all ranks.
        names: What each rotation is to map onto its target.
        remedy: What to do where it is open.

    Raises:
        TargetError: A matrix has no inverse, or nearly so.
    """
    for name, values in zip(names, np.linalg.eigvalsh(matrices), strict=True):
        if not values[0] > DETERMINED * values[-1]:
            raise TargetError(
                f"no rotation maps {name} best onto the target: one of them lies on a line, or is "
                f"the other's mirror image (eigenvalues {values} m²). {remedy}"
            )


def axial(matrices: Floats) -> Floats:
    """(N₃₂ − N₂₃, N₁₃ − N₃₁, N₂₁ − N₁₂) of matrices (…, 3, 3)."""
    skew = matrices - np.swapaxes(matrices, -1, -2)
    return np.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], axis=-1)


def best_rotation(reference: Floats, deformed: Floats) -> Floats:
    """Rotation R (3, 3) that best maps centred points (k, 3) onto others: R a ≈ b."""
    a, b = reference - reference.mean(axis=0), deformed - deformed.mean(axis=0)
    return polar_rotation(b.T @ a)[0]
