"""A straight line under a filter: what is left of it, and which threshold allows which width."""

from __future__ import annotations

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq

from toros_fem._validate import require_between, require_choice
from toros_fem.density.projection import Projection
from toros_fem.errors import ParameterError

# Beyond, thresholds crowd at 1 and control no width any more.
HIGHEST = 0.98


def bar_response(name: str, width: float, at: float) -> float:
    """ρ̃ at a distance from the middle of a straight line of ρ = 1 on ρ = 0; lengths over R.

    Args:
        name: "cone" or "helmholtz", the latter with r = R/(2√3).
        width: Width of the line.
        at: Distance from its middle.
    """
    low, high = at - width / 2, at + width / 2
    if name == "cone":
        return _cone_share(high) - _cone_share(low)
    return _helmholtz_share(high) - _helmholtz_share(low)


def threshold_for_width(name: str, width: float, level: float = 0.5) -> float:
    """η_r at which a straight line of a projected width is just allowed.

    The line is as thin as eq. (13) allows when ρ̃ on its ridge is η_r. By the symmetry of (14),
    1 − η_r is the η_t of a gap of that width if `level` is 1 − η.

    Args:
        name: "cone" or "helmholtz".
        width: Width of the projected line over the filter's R.
        level: η of the projection.

    Raises:
        ParameterError: No threshold up to 0.98 controls this width.
    """
    require_choice("filter", name, ("cone", "helmholtz"))
    widest = width_of_threshold(name, HIGHEST, level)
    require_between(0.0, np.inf, width=width)
    if not 0 < width <= widest:
        raise ParameterError(
            f"a width of {width:.3g} filter radii is out of control: with this filter the "
            f"constraints guarantee up to {widest:.3g} radii. Enlarge the filter's radius."
        )
    missing = lambda eta: width_of_threshold(name, eta, level) - width  # noqa: E731
    return float(brentq(missing, level, HIGHEST, xtol=1e-10))


def raw_width(name: str, projected: float, level: float = 0.5) -> float:
    """Width of the line of ρ = 1 of which a given width is left at ρ̃ > level, both over R."""
    left = lambda b: bar_response(name, b, projected / 2) - level  # noqa: E731
    return float(brentq(left, 1e-6, 20.0 + projected, xtol=1e-12))


def violation(
    name: str, width: float, threshold: float, decay: float, projection: Projection
) -> float:
    """∫ ρ̄ e^{−c ρ̃′²} min(ρ̃ − η_r, 0)² across a straight line: what g_r A is per length and R.

    Args:
        name: "cone" or "helmholtz".
        width: Width of the projected line over R.
        threshold: η_r.
        decay: c over R².
        projection: What makes ρ̄ of ρ̃.
    """
    raw, step = raw_width(name, width, projection.eta), 1e-4

    def part(x: float) -> float:
        filtered = bar_response(name, raw, x)
        slope = (bar_response(name, raw, x + step) - bar_response(name, raw, x - step)) / step
        share = projection.forward(np.array([filtered]))[0]
        return float(share * np.exp(-decay * slope**2 / 4) * min(filtered - threshold, 0) ** 2)

    return float(2 * quad(part, 0.0, width / 2 + 0.5, limit=200, epsabs=1e-9)[0])


def width_of_threshold(name: str, threshold: float, level: float = 0.5) -> float:
    """Width over R of the region ρ̃ > level of the line whose ridge just reaches a threshold."""
    if threshold <= level:
        return 0.0
    raw = brentq(lambda b: bar_response(name, b, 0.0) - threshold, 0.0, 20.0, xtol=1e-12)
    edge = brentq(lambda x: bar_response(name, raw, x) - level, 0.0, 20.0, xtol=1e-12)
    return float(2 * edge)


def _cone_share(x: float) -> float:
    """Share of the cone's weight on the side t < x of a line."""
    if abs(x) >= 1:
        return float(x > 0)

    def density(t: float) -> float:
        """The cone summed up along a line at distance t, over its whole weight π/3."""
        q = np.sqrt(1 - t**2)
        return float((q - (t**2 * np.arcsinh(q / t) if t > 0 else 0.0)) * 3 / np.pi)

    half = quad(density, 0.0, abs(x), epsabs=1e-12)[0]
    return float(0.5 + np.copysign(half, x))


def _helmholtz_share(x: float) -> float:
    """Share of the kernel e^{−|t|/r}/(2r) on the side t < x, r = 1/(2√3)."""
    tail = 0.5 * np.exp(-abs(x) * 2 * np.sqrt(3))
    return float(1 - tail if x > 0 else tail)
