"""Minimum width of lines and gaps by two geometric constraints, eqs. (13, 14)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from toros_fem._mpi import sum_over_ranks
from toros_fem._types import Floats
from toros_fem._validate import require_between, require_positive
from toros_fem.density.bar_width import threshold_for_width, violation, width_of_threshold
from toros_fem.density.filters import Filter
from toros_fem.density.neighbours import mean_edge
from toros_fem.density.projection import Projection
from toros_fem.errors import ParameterError
from toros_fem.meshes.skin import Skin

# Least c over R²: what borders of wide lines add to g_r and g_t is then nothing beside a thin line.
LEAST_DECAY = 25.0
# The default ε is used up by lines of this share of the width asked for …
THIN = 0.85
# … that are so many R long in all. With 10, necks much thinner than asked pass here and there.
ALLOWED = 1.0


@dataclass(frozen=True)
class LengthScale:
    """What the two constraints ask for; what is None follows from filter and mesh.

    Attributes:
        line: Smallest width of a printed line in m; None: the filter's R.
        gap: Smallest width of a gap between lines in m; None: the filter's R.
        solid, void: Thresholds η_r and η_t, 0.7 and 0.3 in the paper; None: those at which a
            straight line or gap of the width asked for is just allowed (`threshold_for_width`).
        decay: c in m²: where ‖∇ρ̃‖ exceeds 1/√c a place counts as a border and not as a ridge.
            None: R⁴/h² for edge length h, but at least 25 R². With less, borders of wide lines
            count too; with much more, whether a thin line is seen depends on how the mesh lies
            under its ridge (docs/optimisation.md has the measured table).
        epsilon: ε, largest value allowed for either; 1e-3 in the paper, by which any number of
            thin lines pass. None: for each of the two, what lines or gaps of 0.85 times the
            width asked for add up to that are 1 R long in all.
    """

    line: float | None = None
    gap: float | None = None
    solid: float | None = None
    void: float | None = None
    decay: float | None = None
    epsilon: float | None = None

    def __post_init__(self) -> None:
        for name in ("line", "gap", "decay", "epsilon"):
            value = getattr(self, name)
            if value is not None:
                require_positive(**{name: value})
        if self.solid is not None:
            require_between(0.5, 1.0, solid=self.solid)
        if self.void is not None:
            require_between(0.0, 0.5, void=self.void)

    @classmethod
    def paper(cls, skin: Skin) -> LengthScale:
        """The paper's constants: η 0.7 and 0.3, ε = 10⁻³, c = 100 in units of the edge length²."""
        return cls(solid=0.7, void=0.3, decay=100 * mean_edge(skin) ** 2, epsilon=1e-3)


class LengthScaleConstraints:
    """g_r and g_t of eqs. (13, 14) as Zhou et al. 2015 (eqs. 10, 11) mean them.

    g_r = Σ Ā ρ̄ e^{−c‖∇ρ̃‖²} min(ρ̃ − η_r, 0)² / Σ Ā flags ridges of printed lines that are too thin,
    g_t = Σ Ā (1−ρ̄) e^{−c‖∇ρ̃‖²} min(η_t − ρ̃, 0)² / Σ Ā valleys of gaps; sums over the designed
    triangles. The paper prints the two indicators the other way round, by which plain fabric
    would violate g_r. ∇ρ̃ is the filter's own gradient at the centroid.

    Args:
        skin: The sewn skin.
        filter: The filter that makes ρ̃.
        parameters: What is asked for.
        designed: Which owned triangles are designed.
        projection: The one that holds in the end; None: β = 20, η = 0.5.

    Attributes:
        solid, void, decay: η_r, η_t and c as used.
        epsilon: ε of g_r and of g_t, (2,).

    Raises:
        ParameterError: A width is beyond what a threshold in (0.5, 1) controls.
    """

    def __init__(
        self,
        skin: Skin,
        filter: Filter,
        parameters: LengthScale,
        designed: npt.NDArray[np.bool_],
        projection: Projection | None = None,
    ) -> None:
        projection = projection or Projection()
        p, radius = parameters, filter.radius
        self._comm, self._filter = skin.comm, filter
        name, levels = filter.name, (projection.eta, 1 - projection.eta)
        solid, empty = p.solid, None if p.void is None else 1 - p.void
        if solid is None:
            solid = threshold_for_width(name, (p.line or radius) / radius, levels[0])
        if empty is None:
            empty = threshold_for_width(name, (p.gap or radius) / radius, levels[1])
        self.solid, self.void = solid, 1 - empty
        steepest = max(LEAST_DECAY, (radius / mean_edge(skin)) ** 2) * radius**2
        self.decay = steepest if p.decay is None else p.decay
        areas = skin.pattern.areas[skin.owned_cells] * designed
        whole = sum_over_ranks(skin.comm, np.array([areas.sum()]))[0]
        if not whole > 0:
            raise ParameterError("no triangle is designed: there is no width to constrain.")
        self._weight = areas / whole
        self.epsilon = np.full(2, p.epsilon or 0.0)
        if p.epsilon is None:
            # A gap is the line of the opposite design.
            for k, (level, threshold) in enumerate(zip(levels, (solid, empty), strict=True)):
                width = THIN * width_of_threshold(name, threshold, level)
                step = Projection(projection.beta, level)
                share = violation(name, width, threshold, self.decay / radius**2, step)
                self.epsilon[k] = share * ALLOWED * radius**2 / whole

    def forward(self, density: Floats, filtered: Floats, projected: Floats) -> Floats:
        """(g_r, g_t) of owned ρ, ρ̃, ρ̄, the same on all ranks (collective)."""
        flat = np.exp(-self.decay * (self._filter.slope(density) ** 2).sum(axis=0))
        thin, tight = self._shortfalls(filtered)
        local = [
            self._weight @ (projected * flat * thin**2),
            self._weight @ ((1 - projected) * flat * tight**2),
        ]
        return sum_over_ranks(self._comm, np.array(local))

    def backward(
        self, density: Floats, filtered: Floats, projected: Floats
    ) -> list[tuple[Floats, Floats, Floats]]:
        """Derivatives of g_r and of g_t by ρ (through ∇ρ̃ alone), by ρ̃ and by ρ̄ (collective)."""
        slope = self._filter.slope(density)
        flat = self._weight * np.exp(-self.decay * (slope**2).sum(axis=0))
        results = []
        for share, short, sign in zip(
            (projected, 1 - projected), self._shortfalls(filtered), (1.0, -1.0), strict=True
        ):
            by_slope = -2 * self.decay * share * flat * short**2 * slope
            by_density = self._filter.slope_backward(by_slope)
            by_filtered = sign * 2 * share * flat * short
            results.append((by_density, by_filtered, sign * flat * short**2))
        return results

    def summary(self, values: Floats) -> dict[str, float | bool]:
        """(g_r, g_t) beside what they are held to, for files."""
        return {
            "g_r": float(values[0]),
            "g_t": float(values[1]),
            "epsilon_r": float(self.epsilon[0]),
            "epsilon_t": float(self.epsilon[1]),
            "eta_r": self.solid,
            "eta_t": self.void,
            "c_m2": self.decay,
            "satisfied": bool(np.all(values <= self.epsilon)),
        }

    def _shortfalls(self, filtered: Floats) -> tuple[Floats, Floats]:
        return np.minimum(filtered - self.solid, 0), np.minimum(self.void - filtered, 0)
