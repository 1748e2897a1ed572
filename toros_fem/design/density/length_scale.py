"""Geometric constraints on the smallest width of lines and gaps, eqs. (13, 14).

The widths that thresholds guarantee follow from straight bars under a filter, "cone" or
"helmholtz", the latter with r = R/(2√3). Lengths of bars are over R, and `level` is η of the
projection.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import Area, In, Length, Positive, Table, key
from toros_fem.base.mpi import sum_over_ranks, total
from toros_fem.base.validation import Bools, Floats, require_between, require_choice
from toros_fem.design.density.filters import Filter
from toros_fem.design.density.projection import Projection
from toros_fem.meshes.skin import Skin
from toros_fem.meshes.triangles import equilateral_edge

# Above this a small change of the threshold is a large one of the width.
HIGHEST = 0.98
# Smallest c over R²: the borders of wide lines then add nothing to g_r beside a thin line.
LEAST_DECAY = 25.0
# The default ε is the violation of lines of this fraction of the requested width …
THIN = 0.85
# … whose length is this number of R. With 10, necks much thinner than requested pass at times.
ALLOWED = 1.0


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


class LengthScale(Table):
    """Parameters of the two constraints; `None` derives a value from filter and mesh.

    The thresholds are by default those at which a straight line or gap of the requested width is
    just allowed (`threshold_for_width`). A decay c is R⁴/h² for edge length h, but at least 25 R²:
    with less, borders of wide lines count too; with much more, the result depends on how the mesh
    lies under the ridge of a thin line. The bound ε is by default, for each of the two, the value
    for straight lines or gaps of 0.85 times the requested width and of length R; with 1e-3, as in
    the paper, any number of thin lines passes.
    """

    line_width: Length | None = key(None, "smallest width of a printed line; none takes R")
    gap_width: Length | None = key(None, "smallest width of a gap between lines; none takes R")
    solid_threshold: Annotated[float, In(at_least=0.5, at_most=1)] | None = key(
        None, "η_r, 0.7 in the paper; none takes that of the width"
    )
    void_threshold: Annotated[float, In(at_least=0, at_most=0.5)] | None = key(
        None, "η_t, 0.3 in the paper; none takes that of the width"
    )
    decay: Area | None = key(
        None, "c: where ‖∇ρ̃‖ exceeds 1/√c is a border, not a ridge; none takes that of the mesh"
    )
    epsilon: Positive | None = key(
        None, "ε, the upper bound of both constraints; none takes that of the widths"
    )

    def scaled(self, factor: float) -> LengthScale:
        """Return the same constraints on lengths that are larger by a factor."""
        factors = {"line_width": factor, "gap_width": factor, "decay": factor**2}
        given = {name: getattr(self, name) for name in factors}
        return replace(self, **{k: v and factors[k] * v for k, v in given.items()})

    def thresholds(self, filter: str, radius: float, eta: float = 0.5) -> tuple[float, float]:
        """Return η_r and η_t of both widths, by a filter's name and radius in m.

        Raises:
            ParameterError: The filter cannot enforce a width.
        """
        solid, void = self.solid_threshold, self.void_threshold
        if solid is None:
            line = (self.line_width or radius) / radius
            solid = threshold_for_width(filter, line, eta)
        if void is None:  # a gap is a line of the opposite design
            gap = (self.gap_width or radius) / radius
            void = 1 - threshold_for_width(filter, gap, 1 - eta, "gap_width")
        return solid, void

    @classmethod
    def paper(cls, skin: Skin) -> LengthScale:
        """Return the paper's constants: η_r = 0.7, η_t = 0.3, ε = 10⁻³, c = 100 edge lengths²."""
        decay = 100 * equilateral_edge(skin.pattern.areas.mean()) ** 2
        return cls(solid_threshold=0.7, void_threshold=0.3, decay=decay, epsilon=1e-3)


class LengthScaleConstraints:
    """Constraints g_r and g_t of eqs. (13, 14) as defined by Zhou et al. 2015 (eqs. 10, 11).

    g_r = Σ Ā ρ̄ e^{−c‖∇ρ̃‖²} min(ρ̃ − η_r, 0)² / Σ Ā detects ridges of printed lines that are too
    thin, g_t = Σ Ā (1−ρ̄) e^{−c‖∇ρ̃‖²} min(η_t − ρ̃, 0)² / Σ Ā valleys of gaps that are too narrow;
    the sums are over the designed triangles. The paper prints the two indicators in exchanged
    places, so that fabric without print would violate g_r. ∇ρ̃ is the filter's own gradient at the
    centroid. A gap is the line of the opposite design: g_t is g_r of 1 − ρ̃, 1 − ρ̄ and 1 − η_t.

    Args:
        designed: Whether each owned triangle is designed.
        projection: The projection of the final design; None: β = 20, η = 0.5.
        parts: Number of mirror images that the skin is one of. The default ε allows as small a
            violation in all of them together as in a whole skin.

    Attributes:
        solid_threshold, void_threshold, decay: η_r, η_t and c as used.
        epsilon: ε of g_r and of g_t, (2,).
    """

    def __init__(
        self,
        skin: Skin,
        filter: Filter,
        parameters: LengthScale,
        designed: Bools,
        projection: Projection | None = None,
        *,
        parts: int = 1,
    ) -> None:
        projection = projection or Projection()
        p, name, radius = parameters, filter.name, filter.radius
        self._comm, self._filter = skin.comm, filter
        levels = projection.eta, 1 - projection.eta
        self.solid_threshold, self.void_threshold = p.thresholds(name, radius, projection.eta)
        edge = equilateral_edge(skin.pattern.areas.mean())
        steepest = max(LEAST_DECAY, (radius / edge) ** 2) * radius**2
        self.decay = steepest if p.decay is None else p.decay
        areas = skin.pattern.areas[skin.owned_cells] * designed
        whole = total(skin.comm, areas.sum())
        self._weight = areas / whole
        self.epsilon = np.full(2, p.epsilon or 0.0)
        if p.epsilon is None:
            thresholds = self.solid_threshold, 1 - self.void_threshold
            for k, (level, threshold) in enumerate(zip(levels, thresholds, strict=True)):
                width = THIN * width_for_threshold(name, threshold, level)
                step = replace(projection, eta=level)
                violation = bar_violation(name, width, threshold, self.decay / radius**2, step)
                self.epsilon[k] = violation * ALLOWED * radius**2 / (parts * whole)

    def forward(self, density: Floats, filtered: Floats, projected: Floats) -> Floats:
        """Return (g_r, g_t) of owned ρ, ρ̃, ρ̄, the same on all ranks (collective)."""
        flat = np.exp(-self.decay * (self._filter.slope.forward(density) ** 2).sum(axis=0))
        local = [
            self._weight @ (material * flat * short**2)
            for _, material, short in self._sides(filtered, projected)
        ]
        return sum_over_ranks(self._comm, np.array(local))

    def backward(
        self, density: Floats, filtered: Floats, projected: Floats
    ) -> list[tuple[Floats, Floats, Floats]]:
        """Return the derivatives of g_r and g_t by ρ (through ∇ρ̃ alone), ρ̃ and ρ̄ (collective)."""
        slope = self._filter.slope.forward(density)
        flat = self._weight * np.exp(-self.decay * (slope**2).sum(axis=0))
        results = []
        for sign, material, short in self._sides(filtered, projected):
            by_slope = -2 * self.decay * material * flat * short**2 * slope
            by_density = self._filter.slope.backward(by_slope)
            by_filtered = sign * 2 * material * flat * short
            results.append((by_density, by_filtered, sign * flat * short**2))
        return results

    def summary(self, values: Floats) -> dict[str, float | bool]:
        """Return (g_r, g_t) with their bounds and constants, for files."""
        return {
            "g_r": float(values[0]),
            "g_t": float(values[1]),
            "epsilon_r": float(self.epsilon[0]),
            "epsilon_t": float(self.epsilon[1]),
            "eta_r": self.solid_threshold,
            "eta_t": self.void_threshold,
            "c_m2": self.decay,
            "satisfied": bool(np.all(values <= self.epsilon)),
        }

    def _sides(self, filtered: Floats, projected: Floats) -> Iterator[tuple[float, Floats, Floats]]:
        """Yield sign, density and min(ρ̃ − η_r, 0) of the print, and the same of the fabric."""
        for sign, material, threshold in (
            (1.0, projected, self.solid_threshold),
            (-1.0, 1 - projected, self.void_threshold),
        ):
            yield sign, material, np.minimum(sign * (filtered - threshold), 0)
