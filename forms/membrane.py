"""Membrane energy: a log barrier in the stretches, eq. (1), a rubber layer, and their tangent."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import ufl

from toros_fem.forms.blocks import EdgePairs, Vector, cross, dot, minus, skew, times
from toros_fem.forms.kinematics import deformation_gradient, right_cauchy_green, stretch_invariants

# Below this argument `log1p` is a series.
SMALL = 1e-2


def barrier_membrane(
    s: Any, p: Any, mu: Any, lam: Any, c1: Any, c2: Any, difference: Any | None = None
) -> Any:
    """Return the energy per flat area, eq. (1) of Montes Maestre et al. 2023.

    ψ = −μ a ln(1 − (λ₁−1)²/a) − μ a ln(1 − (λ₂−1)²/a) − (λ/2) b ln(1 − (λ₁+λ₂−2)²/b) with
    a = (c₁−1)², b = (c₂−1)². The two first logarithms are joined, so that only s = λ₁ + λ₂ and
    p = λ₁ λ₂ occur and equal stretches are no special case. For c₁, c₂ → ∞ it is the
    St. Venant–Kirchhoff energy in the Biot strain, μ Σ(λᵢ−1)² + (λ/2)(λ₁+λ₂−2)².

    The variations are derived from this form. Its value loses digits where the strains are small
    against the bounds, since the logarithms round at 1: `barrier_value` does not.

    The logarithms' arguments turn positive again far outside the admissible stretches. So
    admissibility is tested by the stretches (`toros_fem.mechanics.skin.stretch_bounds`).

    Args:
        s, p: λ₁ + λ₂ and λ₁ λ₂, by `stretch_invariants`.
        mu, lam: Plane-stress Lamé parameters times thickness, in N/m.
        c1: Bound on a principal stretch: |λᵢ − 1| < c₁ − 1.
        c2: Bound on their sum: |λ₁ + λ₂ − 2| < c₂ − 1.
        difference: (λ₁ − λ₂)², by `squared_difference`: with it the forces keep their digits where
            the bounds are narrow. None forms the strains from s and p, which round at 1.

    Returns:
        Energy per flat area in J/m².
    """
    a, b = (c1 - 1) ** 2, (c2 - 1) ** 2
    if difference is None:
        squares = s * s - 2 * p - 2 * s + 2  # (λ₁−1)² + (λ₂−1)²
        product = p - s + 1  # (λ₁−1)(λ₂−1)
    else:
        squares = ((s - 2) ** 2 + difference) / 2
        product = ((s - 2) ** 2 - difference) / 4
    shear = -mu * a * ufl.ln(1 - squares / a + product**2 / a**2)
    return shear - lam / 2 * b * ufl.ln(1 - (s - 2) ** 2 / b)


def squared_difference(C: Any, s: Any) -> Any:
    """Return (λ₁ − λ₂)² from C and λ₁ + λ₂, without the cancellation of s² − 4p."""
    return ((C[0, 0] - C[1, 1]) ** 2 + 4 * C[0, 1] ** 2) / (s * s)


def barrier_value(C: Any, mu: Any, lam: Any, c1: Any, c2: Any) -> Any:
    """Return the energy per flat area of `barrier_membrane`, without loss of digits.

    The strains come from λ₁ + λ₂ − 2 and (λ₁ − λ₂)² = ((C₁₁ − C₂₂)² + 4 C₁₂²)/(λ₁ + λ₂)², whose
    sums do not cancel, and the logarithms from `log1p`.

    Args:
        C: Right Cauchy-Green tensor.
        mu, lam, c1, c2: As for `barrier_membrane`.

    Returns:
        Energy per flat area in J/m².
    """
    a, b = (c1 - 1) ** 2, (c2 - 1) ** 2
    s, _ = stretch_invariants(C)
    total = s - 2  # (λ₁−1) + (λ₂−1)
    difference = squared_difference(C, s)
    squares = (total**2 + difference) / 2  # (λ₁−1)² + (λ₂−1)²
    product = (total**2 - difference) / 4  # (λ₁−1)(λ₂−1)
    shear = -mu * a * log1p((product / a) ** 2 - squares / a)
    return shear - lam / 2 * b * log1p(-(total**2) / b)


def log1p(y: Any) -> Any:
    """Return ln(1 + y) to rounding, also for small y, where 1 + y has lost y's digits.

    Below `SMALL` it is the series of 2 artanh z with z = y/(2 + y); four terms leave 1e-20.
    """
    z = y / (2 + y)
    series = 2 * z * (1 + z**2 * (1 / 3 + z**2 * (1 / 5 + z**2 / 7)))
    return ufl.conditional(ufl.lt(abs(y), SMALL), series, ufl.ln(1 + y))


def neo_hooke(s: Any, p: Any, mu: Any) -> Any:
    """Return the energy per flat area of a thin incompressible neo-Hookean layer in plane stress.

    ψ = μ/2 (λ₁² + λ₂² + λ₃² − 3) with λ₃ = 1/(λ₁λ₂) (Treloar 1943), in s = λ₁ + λ₂ and p = λ₁ λ₂.

    Args:
        s, p: λ₁ + λ₂ and λ₁ λ₂.
        mu: Shear modulus times thickness, in N/m; μ = E/3.

    Returns:
        Energy per flat area in J/m².
    """
    return mu / 2 * (s * s - 2 * p + 1 / (p * p) - 3)


def membrane_pairs(
    corners: Sequence[Vector],
    jacobian: Any,
    stiffness: tuple[Any, Any],
    bounds: tuple[Any, Any],
    bladder: Any | None,
    geometric: Any,
    density: Callable[[Any, Any], Any] | None = None,
    *,
    narrow: bool = False,
) -> EdgePairs:
    """Return the second variation of ψ(s, p), eq. (1), per flat area, by the edges e₁ and e₂.

    With e₁, e₂ the deformed edges from the first corner and Gᵃᵇ the inverse metric of the flat
    triangle, s² = Gᵃᵇ eₐ·e_b + 2p and p = |e₁ × e₂| / |det J|. The second derivative of p lies
    along the normal but for the rotation of e₁ against e₂.

    Args:
        corners: Deformed corners.
        jacobian: Jacobian of the flat chart.
        stiffness: Plane-stress Lamé parameters times thickness.
        bounds: c₁ and c₂.
        bladder: Shear modulus times thickness of `neo_hooke`; None for none.
        geometric: 1 for the whole, 0 for its part made positive, without rotations of stress.
        density: ψ(s, p) in the place of eq. (1); None for eq. (1).
        narrow: Whether eq. (1) takes `squared_difference`, for narrow bounds.
    """
    gradient = deformation_gradient([ufl.as_vector(corner) for corner in corners], jacobian)
    C = right_cauchy_green(gradient)
    plain = stretch_invariants(C)
    s, p = (ufl.variable(value) for value in plain)
    difference = None
    if narrow:
        # A constant that restores the digits of s² − 4p, and leaves its derivatives.
        lost = squared_difference(C, plain[0]) - (plain[0] * plain[0] - 4 * plain[1])
        difference = s * s - 4 * p + lost
    psi = density(s, p) if density else barrier_membrane(s, p, *stiffness, *bounds, difference)
    if bladder is not None:
        psi += neo_hooke(s, p, bladder)
    d_s, d_p = ufl.diff(psi, s), ufl.diff(psi, p)
    d_ss, d_sp, d_pp = ufl.diff(d_s, s), ufl.diff(d_s, p), ufl.diff(d_p, p)
    e = (minus(corners[1], corners[0]), minus(corners[2], corners[0]))
    inverse = ufl.inv(jacobian)
    metric = ufl.dot(inverse, ufl.transpose(inverse))
    G = {(0, 0): metric[0, 0], (0, 1): metric[0, 1], (1, 1): metric[1, 1]}
    scale = abs(ufl.det(jacobian))

    n = cross(e[0], e[1])
    inverse_length = 1 / ufl.sqrt(dot(n, n))
    normal = times(inverse_length, n)
    inverse_scale, inverse_s = 1 / scale, 1 / s
    p_e = (times(inverse_scale, cross(e[1], normal)), times(inverse_scale, cross(normal, e[0])))
    u = (
        [G[0, 0] * e[0][k] + G[0, 1] * e[1][k] for k in range(3)],
        [G[0, 1] * e[0][k] + G[1, 1] * e[1][k] for k in range(3)],
    )
    s_e = tuple(tuple((u[a][k] + p_e[a][k]) * inverse_s for k in range(3)) for a in range(2))

    isotropic = d_s * inverse_s
    curved = (isotropic + d_p) * inverse_scale
    along = {
        (0, 0): curved * inverse_length * dot(e[1], e[1]),
        (0, 1): -(curved * inverse_length * dot(e[0], e[1])),
        (1, 1): curved * inverse_length * dot(e[0], e[0]),
    }
    # ψ₁/λ₁ + ψ₂/λ₂ and ψ₁ψ₂/(λ₁λ₂), the stiffness across the sheet, and that against a twist
    trace = (d_s * s + d_p * (s * s - 2 * p)) / p
    product = (d_s * d_s + d_s * d_p * s + d_p * d_p * p) / p
    across = (1 - geometric) * ufl.sqrt(abs(trace * trace - 2 * product))
    twist = 2 * isotropic + d_p
    untwist = (1 - geometric) * (abs(twist) - twist) / 2
    turned = (cross(normal, s_e[0]), cross(normal, s_e[1]))
    for a, b in along:
        bare = isotropic * G[a, b]
        along[a, b] = geometric * along[a, b] + across * G[a, b] - (1 - geometric) * bare
    rotation = skew(times(-curved, normal))
    ss, sp, pp = d_ss - isotropic, d_sp, d_pp
    H: EdgePairs = {}
    for a, b in ((0, 0), (0, 1), (1, 1)):
        by_s = [ss * s_e[b][k] + sp * p_e[b][k] for k in range(3)]
        by_p = [sp * s_e[b][k] + pp * p_e[b][k] for k in range(3)]
        by_n = times(along[a, b], normal)
        by_turn = times(untwist, turned[b])
        H[a, b] = [
            [
                s_e[a][k] * by_s[m]
                + p_e[a][k] * by_p[m]
                + normal[k] * by_n[m]
                + turned[a][k] * by_turn[m]
                + (isotropic * G[a, b] if k == m else 0)
                + (rotation[k][m] if a != b else 0)
                for m in range(3)
            ]
            for k in range(3)
        ]
    return H
