"""Straight bars under a filter: filtered density, and the width that each threshold guarantees.

Filters are "cone" or "helmholtz", the latter with r = R/(2√3). All lengths are over R. `level` is η
of the projection.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq

from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import require_between, require_choice
from toros_fem.design.density.projection import Projection

# Above this a small change of the threshold is a large one of the width.
HIGHEST = 0.98


def filtered_bar(name: str, width: float, distance: float) -> float:
    """Return ρ̃ at a distance from the centre line of a straight bar of ρ = 1 on ρ = 0."""
    fraction = _FRACTIONS[name]
    return fraction(distance + width / 2) - fraction(distance - width / 2)


def threshold_for_width(
    name: str, width: float, level: float = 0.5, key: str = "line_width"
) -> float:
    """Return the η_r at which a straight bar of a projected width is just allowed.

    The bar is as thin as eq. (13) allows when ρ̃ on its centre line is η_r. By the symmetry of
    (14), 1 − η_r is the η_t of a gap of that width if `level` is 1 − η. The key is for errors.
    """
    require_choice("filter", name, tuple(_FRACTIONS))
    widest = width_for_threshold(name, HIGHEST, level)
    require_between(0.0, np.inf, width=width)
    if not 0 < width <= widest:
        raise ParameterError(
            f"{key} = {width:.3g} filter radii cannot be enforced: with this filter the "
            f"constraints guarantee at most {widest:.3g} radii. Enlarge the filter's radius.",
            key,
        )
    gap = lambda eta: width_for_threshold(name, eta, level) - width  # noqa: E731
    return float(brentq(gap, level, HIGHEST, xtol=1e-10))


def unfiltered_width(name: str, projected: float, level: float = 0.5) -> float:
    """Return the width of the bar of ρ = 1 that has a given width at ρ̃ > level."""
    gap = lambda b: filtered_bar(name, b, projected / 2) - level  # noqa: E731
    return float(brentq(gap, 1e-6, 20.0 + projected, xtol=1e-12))


def bar_violation(
    name: str, width: float, threshold: float, decay: float, projection: Projection
) -> float:
    """Return ∫ ρ̄ e^{−c ρ̃′²} min(ρ̃ − η_r, 0)² dx/R across a straight bar.

    It is the contribution to g_r A of a bar of a projected width, over its length and R. `decay` is
    c over R², and `threshold` η_r.
    """
    raw, step = unfiltered_width(name, width, projection.eta), 1e-4

    def integrand(x: float) -> float:
        filtered = filtered_bar(name, raw, x)
        slope = (filtered_bar(name, raw, x + step) - filtered_bar(name, raw, x - step)) / step
        projected = projection.forward(np.array([filtered]))[0]
        return float(projected * np.exp(-decay * slope**2 / 4) * min(filtered - threshold, 0) ** 2)

    return float(2 * quad(integrand, 0.0, width / 2 + 0.5, limit=200, epsabs=1e-9)[0])


def width_for_threshold(name: str, threshold: float, level: float = 0.5) -> float:
    """Return the width, at ρ̃ > level, of the bar whose largest ρ̃ is the threshold."""
    if threshold <= level:
        return 0.0
    raw = brentq(lambda b: filtered_bar(name, b, 0.0) - threshold, 0.0, 20.0, xtol=1e-12)
    edge = brentq(lambda x: filtered_bar(name, raw, x) - level, 0.0, 20.0, xtol=1e-12)
    return float(2 * edge)


def _cone_fraction(x: float) -> float:
    """Return the fraction of the cone's weight on the side t < x of a line.

    On a line at the distance t the cone has the integral √(1 − t²) − t² arcosh(1/t), of π/3.
    """
    t = abs(x)
    if t >= 1 or t == 0:
        return float(np.sign(x) + 1) / 2
    half = 2 * t * np.sqrt(1 - t**2) + np.arcsin(t) - t**3 * np.arccosh(1 / t)
    return float(0.5 + np.copysign(half / np.pi, x))


def _helmholtz_fraction(x: float) -> float:
    """Return the fraction of the kernel e^{−|t|/r}/(2r) on the side t < x, r = 1/(2√3)."""
    tail = 0.5 * np.exp(-abs(x) * 2 * np.sqrt(3))
    return float(1 - tail if x > 0 else tail)


_FRACTIONS = {"cone": _cone_fraction, "helmholtz": _helmholtz_fraction}
