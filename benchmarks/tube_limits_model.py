"""Closed forms of a homogeneous tube with helical fibres, for `tube_limits.py`.

A long tube of radius R is widened by λ_r, lengthened by λ_z and twisted by γ/R per length. In the
frame (around, along) its deformation gradient is F = [[λ_r, λ_r γ], [0, λ_z]]. A fibre at the angle
α to the axis keeps its length if

    (λ_z cos α)² + (λ_r (sin α + γ cos α))² = 1,

that is, with its deformed angle α', λ_z cos α = cos α' and λ_r (sin α + γ cos α) = sin α'.
Equilibrium is the minimum of membrane energy (1) minus P V per area of the wall, where V includes
the end caps. The shape of the ends, bending, and all that varies along or around the tube are left
out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize, root

from toros_fem.products.tubes.tube import TubeConfig

Array = npt.NDArray[Any]
Energy = Callable[[Array, float], Any]

TUBE = TubeConfig()
RADIUS, LENGTH = TUBE.diameter / 2, TUBE.length


@dataclass(frozen=True)
class State:
    """A homogeneous equilibrium.

    Attributes:
        radius, length: λ_r and λ_z.
        shear: γ; negative if a right-handed family unwinds.
        gradient: Largest entry of the energy's gradient over E h, the residual of equilibrium.
        stretches: Least and largest principal stretch of the fabric.
        fibre: Length ratio of the fibres.
    """

    radius: float
    length: float
    shear: float
    gradient: float
    stretches: tuple[float, float]
    fibre: float

    @property
    def twist(self) -> float:
        """Twist of the whole tube in degrees, counter-clockwise, as `measures.twist_angle`."""
        return float(np.degrees(self.shear * LENGTH / RADIUS))

    @property
    def shortening(self) -> float:
        """Shortening in per cent."""
        return 100 * (1 - self.length)


def tube(radius: Any, length: Any, shear: Any) -> Array:
    """Return F in the frame (around, along)."""
    return np.array([[radius, radius * shear], [0 * radius, length]])


def fibre_length(radius: float, length: float, shear: float, angle: float) -> float:
    """Return the stretch of a fibre at an angle in rad to the axis."""
    return float(np.linalg.norm(tube(radius, length, shear) @ _along(angle)))


def unstretched_twist(radius: float, length: float, angle: float) -> float:
    """Return the twist in degrees of a tube of known shape whose fibres keep their length.

    It is NaN if no twist allows that, since the tube is longer than the fibres.
    """
    room = 1 - (length * np.cos(angle)) ** 2
    if room < 0:
        return float("nan")
    shear = (np.sqrt(room) / radius - np.sin(angle)) / np.cos(angle)
    return float(np.degrees(shear * LENGTH / RADIUS))


def unstretched_length(radius: float, angle: float) -> float:
    """Return λ_z of a tube of known radius whose crossed fibres keep their length, or NaN."""
    room = 1 - (radius * np.sin(angle)) ** 2
    return float(np.sqrt(room) / np.cos(angle)) if room > 0 else float("nan")


def bound_twist(radius: float, c1: float) -> float:
    """Return the largest twist in degrees that the bound λ₁ < c₁ allows a tube of known radius.

    The largest stretch is at least λ_r √(1 + γ²), its limit for λ_z → 0.
    """
    return float(np.degrees(np.sqrt((c1 / radius) ** 2 - 1) * LENGTH / RADIUS))


def thin_helices(angle: float, pressures: Sequence[float]) -> list[State]:
    """Return states of one family of fibres without width or stretch, at rising pressures in Pa."""

    def unfold(v: Array) -> tuple[Any, Any, Any]:
        radius, after = v
        shear = (np.sin(after) / radius - np.sin(angle)) / np.cos(angle)
        return radius, np.cos(after) / np.cos(angle), shear

    def energy(v: Array, pressure: float) -> Any:
        radius, length, shear = unfold(v)
        return _fabric(tube(radius, length, shear)) - _work(pressure, radius, length)

    return _follow(energy, np.array([1.0, angle]), pressures, unfold, angle)


def striped_helices(
    angle: float, fraction: float, pressures: Sequence[float], young: float | None = None
) -> list[State]:
    """Return states of one family of stripes that cover a fraction of the wall and may stretch.

    `young` is their modulus in Pa, by default that of the reinforcement.

    A laminate: F is the mean over stripes F - (1 - f) d⊗n and fabric F + f d⊗n, n across the
    stripes; d minimises the energy, so that forces are the same on both sides of a border.
    """
    across = np.array([np.cos(angle), -np.sin(angle)])
    modulus = TUBE.reinforcement_young if young is None else young

    def parts(v: Array) -> tuple[Array, Array]:
        mean, jump = tube(*v[:3]), np.outer(v[3:], across)
        return mean + fraction * jump, mean - (1 - fraction) * jump

    def energy(v: Array, pressure: float) -> Any:
        fabric, stripe = parts(v)
        return (
            (1 - fraction) * _fabric(fabric)
            + fraction * membrane(stripe, modulus)
            - _work(pressure, v[0], v[1])
        )

    start = np.array([1.0, 1.0, 0.0, 0.0, 0.0])
    return _follow(energy, start, pressures, lambda v: tuple(v[:3]), angle, lambda v: parts(v)[0])


def thin_net(angle: float, pressures: Sequence[float]) -> list[State]:
    """Return states of two crossed families without width or stretch, McKibben's kinematics."""

    def unfold(v: Array) -> tuple[Any, Any, Any]:
        return np.sin(v[0]) / np.sin(angle), np.cos(v[0]) / np.cos(angle), 0 * v[0]

    def energy(v: Array, pressure: float) -> Any:
        radius, length, shear = unfold(v)
        return _fabric(tube(radius, length, shear)) - _work(pressure, radius, length)

    return _follow(energy, np.array([angle]), pressures, unfold, angle)


def stretching_net(
    angle: float, fraction: float, pressures: Sequence[float], young: float | None = None
) -> list[State]:
    """Return states of two crossed families whose lines cover a fraction of the wall and stretch.

    Fabric is counted all over; crossings turn freely.
    """
    s = TUBE
    modulus = s.reinforcement_young if young is None else young

    def energy(v: Array, pressure: float) -> Any:
        radius, length = v
        fibre = np.sqrt((length * np.cos(angle)) ** 2 + (radius * np.sin(angle)) ** 2)
        pulled = fraction * modulus * s.thickness * (fibre - 1) ** 2 / 2
        return _fabric(tube(radius, length, 0.0)) + pulled - _work(pressure, radius, length)

    start = np.array([1.0, 1.0])
    return _follow(energy, start, pressures, lambda v: (v[0], v[1], 0.0), angle)


def covered_fraction(count: int, width: float, angle: float, families: int = 1) -> float:
    """Return the fraction of the wall under lines, crossings counted once for each family."""
    return families * count * width / (2 * np.pi * RADIUS * np.cos(angle))


def membrane(gradient: Array, young: float) -> Any:
    """Return h ψ of eq. (1) in J/m²; infinite outside the stretch bounds."""
    s = TUBE
    if np.real(_invariants(gradient)[1]) <= 0:
        return np.inf
    low, high = _stretches(gradient)
    if not (2 - s.c1 < low and high < s.c1 and abs(low + high - 2) < s.c2 - 1):
        return np.inf
    mu = young / 2 / (1 + s.poisson)
    lam = young * s.poisson / (1 - s.poisson**2)
    a, b = (s.c1 - 1) ** 2, (s.c2 - 1) ** 2
    total, product = _invariants(gradient)
    squares, mixed = total**2 - 2 * product - 2 * total + 2, product - total + 1
    single = np.log(1 - squares / a + (mixed / a) ** 2)
    both = np.log(1 - (total - 2) ** 2 / b)
    return -s.thickness * (mu * a * single + lam / 2 * b * both)


def _along(angle: float) -> Array:
    return np.array([np.sin(angle), np.cos(angle)])


def _work(pressure: float, radius: Any, length: Any) -> Any:
    """Return P V per area of the undeformed wall."""
    return pressure * RADIUS / 2 * radius**2 * length


def _fabric(gradient: Array) -> Any:
    return membrane(gradient, TUBE.fabric_young)


def _invariants(gradient: Array) -> tuple[Any, Any]:
    """Return sum and product of the principal stretches."""
    product = gradient[0, 0] * gradient[1, 1] - gradient[0, 1] * gradient[1, 0]
    return np.sqrt((gradient**2).sum() + 2 * product), product


def _stretches(gradient: Array) -> tuple[float, float]:
    total, product = (float(np.real(value)) for value in _invariants(gradient))
    half = np.sqrt(max(0.0, total**2 / 4 - product))
    return total / 2 - half, total / 2 + half


def _follow(
    energy: Energy,
    start: Array,
    pressures: Sequence[float],
    unfold: Callable[[Array], tuple[Any, Any, Any]],
    angle: float,
    fabric: Callable[[Array], Array] | None = None,
) -> list[State]:
    """Return the minima at rising pressures, each from the one before."""
    scale = TUBE.fabric_young * TUBE.thickness
    states, v = [], start
    for pressure in pressures:

        def value(v: Array, pressure: float = pressure) -> float:
            return float(np.real(energy(v, pressure)) / scale)

        def slope(v: Array, pressure: float = pressure) -> Array:
            # A complex step: exact to rounding.
            steps = 1e-30j * np.eye(len(v))
            return np.array([np.imag(energy(v + d, pressure)) for d in steps]) / 1e-30 / scale

        def curvature(v: Array, slope: Callable[[Array], Array] = slope) -> Array:
            steps = 1e-6 * np.eye(len(v))
            found = np.array([slope(v + d) - slope(v - d) for d in steps]) / 2e-6
            return (found + found.T) / 2

        near = minimize(
            value, v, jac=slope, hess=curvature, method="trust-exact",
            options={"gtol": 1e-7, "initial_trust_radius": 0.05, "max_trust_radius": 0.2},
        ).x  # fmt: skip
        v = root(slope, near, jac=curvature, tol=1e-13).x  # the energy alone rounds at 1e-8
        radius, length, shear = (float(entry) for entry in unfold(v))
        states.append(
            State(
                radius,
                length,
                shear,
                gradient=float(abs(slope(v)).max()),
                stretches=_stretches(fabric(v) if fabric else tube(radius, length, shear)),
                fibre=fibre_length(radius, length, shear, angle),
            )
        )
    return states
