"""Relaxed energy of a sheet that wrinkles instead of carrying compression, and its tangent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import ufl

from toros_fem.forms.blocks import EdgePairs, Vector, cross, dot, minus, times
from toros_fem.forms.kinematics import deformation_gradient, right_cauchy_green, stretch_invariants
from toros_fem.forms.membrane import barrier_membrane, barrier_value, log1p


@dataclass(frozen=True)
class TensionField:
    """State of a sheet in tension-field theory (Pipkin 1986, Steigmann 1990), on one triangle.

    λ₁ ≥ λ₂ are the principal stretches. Where λ₁ ≤ 1 the sheet is slack. Elsewhere w(λ₁) is the
    natural width, at which the stress across λ₁ vanishes; where λ₂ < w the sheet is wrinkled.

    Attributes:
        taut, wrinkled: Conditions; where neither holds the sheet is slack.
        x: λ₁ − 1, but 0 where the sheet is slack.
        y: 1 − w(λ₁).
        cosine, sine: (C₁₁ − C₂₂)/(λ₁² − λ₂²) and 2 C₁₂/(λ₁² − λ₂²): of twice the angle of the
            tension from the first flat axis.
        gap: λ₁² − λ₂², but 1 where it is 0.
    """

    taut: Any
    wrinkled: Any
    x: Any
    y: Any
    cosine: Any
    sine: Any
    gap: Any


def tension_field(C: Any, mu: Any, lam: Any, c1: Any, c2: Any) -> TensionField:
    """Return the state of a sheet with the energy of eq. (1).

    Args:
        C: Right Cauchy-Green tensor.
        mu, lam, c1, c2: As for `barrier_membrane`.
    """
    s, _ = stretch_invariants(C)
    gap = ufl.sqrt((C[0, 0] - C[1, 1]) ** 2 + 4 * C[0, 1] ** 2)
    total, difference = s - 2, gap / s
    x = (total + difference) / 2
    taut_or_wrinkled = ufl.gt(x, 0)
    x = ufl.conditional(taut_or_wrinkled, x, 0.0)
    y = natural_narrowing(x, mu, lam, c1, c2)
    width = ufl.gt((total - difference) / 2, -y)
    gap = ufl.conditional(ufl.gt(gap, 0), gap, 1.0)
    return TensionField(
        taut=ufl.And(taut_or_wrinkled, width),
        wrinkled=ufl.And(taut_or_wrinkled, ufl.Not(width)),
        x=x,
        y=y,
        cosine=(C[0, 0] - C[1, 1]) / gap,
        sine=2 * C[0, 1] / gap,
        gap=gap,
    )


def natural_narrowing(x: Any, mu: Any, lam: Any, c1: Any, c2: Any) -> Any:
    """Return y = 1 − w at which a sheet stretched by λ₁ = 1 + x has no stress across it.

    With z = x − y it solves 2μ y (1 − z²/b) = λ z (1 − y²/a), a cubic with three real roots, one
    below 0, one above x. The root between them is that of the sine. All terms go with x, so that
    y keeps its digits where x is small.

    Args:
        x: λ₁ − 1, at least 0 and below c₁ − 1.
        mu, lam, c1, c2: As for `barrier_membrane`.
    """
    poisson = lam / (2 * mu + lam)
    one, two = (1 - poisson) / (c2 - 1) ** 2, poisson / (c1 - 1) ** 2
    cubic = one + two
    middle = x * (2 * one + two) / (3 * cubic)
    linear = (1 - one * x**2) / cubic
    third = linear / 3 + middle**2
    half = (poisson * x / cubic - 2 * middle**3 - middle * linear) / 2
    sine = -half / (third * ufl.sqrt(third))
    # Rounding, and stretches out of bounds, must not leave the sine's range.
    sine = ufl.conditional(ufl.gt(abs(sine), 1), ufl.sign(sine), sine)
    return middle - 2 * ufl.sqrt(third) * ufl.sin(ufl.asin(sine) / 3)


def _uniaxial(state: TensionField, mu: Any, lam: Any, c1: Any, c2: Any) -> tuple[Any, Any]:
    """Return the first and second derivative of ψ(λ₁, w(λ₁)), in N/m.

    With ψ₂ = 0 they are ψ₁ and ψ₁₁ − ψ₁₂²/ψ₂₂.
    """
    a, b = (c1 - 1) ** 2, (c2 - 1) ** 2
    x, y, z = state.x, state.y, state.x - state.y
    along, across, joint = 1 - x**2 / a, 1 - y**2 / a, 1 - z**2 / b
    first = 2 * mu * x / along + lam * z / joint
    own = 2 * mu * (1 + x**2 / a) / along**2
    other = 2 * mu * (1 + y**2 / a) / across**2
    shared = lam * (1 + z**2 / b) / joint**2
    return first, own + shared * other / (shared + other)


def quadratic_membrane(s: Any, p: Any, mu: Any, lam: Any) -> Any:
    """Return μ Σ(λᵢ−1)² + (λ/2)(λ₁+λ₂−2)² per flat area: eq. (1) without its bounds.

    Args:
        s, p: λ₁ + λ₂ and λ₁ λ₂, by `stretch_invariants`.
        mu, lam: As for `barrier_membrane`.
    """
    return mu * (s * s - 2 * p - 2 * s + 2) + lam / 2 * (s - 2) ** 2


def relaxed_membrane(
    s: Any, p: Any, state: TensionField, stiffness: tuple[Any, Any], bounds: tuple[Any, Any],
    residual: Any,
) -> Any:  # fmt: skip
    """Return the part of the relaxed energy whose variations follow from s and p, in J/m².

    It is (1 − r) ψ where the sheet is taut, and r times `quadratic_membrane` everywhere. What
    wrinkled triangles add has the stress `tension_stress`.

    Args:
        s, p: λ₁ + λ₂ and λ₁ λ₂.
        state: By `tension_field`.
        stiffness: Plane-stress Lamé parameters times thickness.
        bounds: c₁ and c₂.
        residual: Fraction r of the stiffness that remains against compression.
    """
    psi = barrier_membrane(s, p, *stiffness, *bounds)
    taut = ufl.conditional(state.taut, (1 - residual) * psi, 0.0)
    return taut + residual * quadratic_membrane(s, p, *stiffness)


def relaxed_value(
    C: Any, stiffness: tuple[Any, Any], bounds: tuple[Any, Any], residual: Any
) -> Any:
    """Return the whole relaxed energy per flat area, without loss of digits, in J/m².

    Args:
        C: Right Cauchy-Green tensor.
        stiffness, bounds, residual: As for `relaxed_membrane`.
    """
    (mu, lam), (c1, c2) = stiffness, bounds
    a, b = (c1 - 1) ** 2, (c2 - 1) ** 2
    state = tension_field(C, mu, lam, c1, c2)
    x, y, z = state.x, state.y, state.x - state.y
    wrinkled = -mu * a * (log1p(-(x**2) / a) + log1p(-(y**2) / a))
    wrinkled -= lam / 2 * b * log1p(-(z**2) / b)
    slack = ufl.conditional(state.wrinkled, wrinkled, 0.0)
    psi = ufl.conditional(state.taut, barrier_value(C, mu, lam, c1, c2), slack)
    s, _ = stretch_invariants(C)
    total = s - 2
    difference = ((C[0, 0] - C[1, 1]) ** 2 + 4 * C[0, 1] ** 2) / (s * s)
    quadratic = mu * (total**2 + difference) / 2 + lam / 2 * total**2
    return (1 - residual) * psi + residual * quadratic


def tension_stress(
    state: TensionField, stiffness: tuple[Any, Any], bounds: tuple[Any, Any], residual: Any
) -> Any:
    """Return the derivative of the wrinkled energy by C, shape (2, 2), in N/m.

    It is ψ₁/(2 λ₁) n ⊗ n with n the direction of the tension, and 0 where nothing is wrinkled.

    Args:
        state: By `tension_field`.
        stiffness, bounds, residual: As for `relaxed_membrane`.
    """
    first, _ = _uniaxial(state, *stiffness, *bounds)
    pull = ufl.conditional(state.wrinkled, (1 - residual) * first / (1 + state.x) / 4, 0.0)
    return pull * ufl.as_matrix([[1 + state.cosine, state.sine], [state.sine, 1 - state.cosine]])


def tension_pairs(
    corners: Sequence[Vector],
    jacobian: Any,
    stiffness: tuple[Any, Any],
    bounds: tuple[Any, Any],
    residual: Any,
) -> EdgePairs:
    """Return the second variation of the wrinkled energy per flat area, by the edges e₁ and e₂.

    With n the flat direction of the tension, m the one across, t and u the same in the deformed
    sheet and N its normal, it is ψ'' (t·δF n)² + ψ'/λ₁ ((N·δF n)² + (u·δF n)²) +
    ψ' (λ₁ t·δF m + λ₂ u·δF n)² / (λ₁ (λ₁² − λ₂²)): no term is negative.

    Args:
        corners: Deformed corners.
        jacobian: Jacobian of the flat chart.
        stiffness, bounds, residual: As for `relaxed_membrane`.
    """
    C = right_cauchy_green(
        deformation_gradient([ufl.as_vector(corner) for corner in corners], jacobian)
    )
    state = tension_field(C, *stiffness, *bounds)
    first, second = _uniaxial(state, *stiffness, *bounds)
    stretch = 1 + state.x
    weight = ufl.conditional(state.wrinkled, 1 - residual, 0.0)
    # Half the angle of (cosine, sine), without cancellation.
    forward = ufl.gt(state.cosine, 0)
    large = ufl.sqrt((1 + abs(state.cosine)) / 2)
    small = state.sine / (2 * large)
    n = ufl.conditional(forward, large, small), ufl.conditional(forward, small, large)
    inverse = ufl.inv(jacobian)
    along = [inverse[k, 0] * n[0] + inverse[k, 1] * n[1] for k in range(2)]
    over = [inverse[k, 1] * n[0] - inverse[k, 0] * n[1] for k in range(2)]

    e = (minus(corners[1], corners[0]), minus(corners[2], corners[0]))
    area = cross(e[0], e[1])
    length = ufl.sqrt(dot(area, area))
    determinant = ufl.det(jacobian)
    normal = times(determinant / abs(determinant) / length, area)
    t = times(1 / stretch, tuple(along[0] * e[0][k] + along[1] * e[1][k] for k in range(3)))
    u = cross(normal, t)
    narrow = length / abs(determinant) / stretch  # λ₂ = p/λ₁
    turned = [
        tuple(stretch * over[k] * t[j] + narrow * along[k] * u[j] for j in range(3))
        for k in range(2)
    ]
    pull = weight * first / stretch
    stiff, turning = weight * second, pull / state.gap
    H: EdgePairs = {}
    for k, j in ((0, 0), (0, 1), (1, 1)):
        by_t = times(along[k] * along[j] * stiff, t)
        across = along[k] * along[j] * pull
        by_normal, by_u = times(across, normal), times(across, u)
        by_turn = times(turning, turned[j])
        H[k, j] = [
            [
                t[i] * by_t[m] + normal[i] * by_normal[m] + u[i] * by_u[m]
                + turned[k][i] * by_turn[m]
                for m in range(3)
            ]
            for i in range(3)
        ]  # fmt: skip
    return H
