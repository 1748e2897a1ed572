"""The result of a fit: constants with intervals, how well they fit, and how far to trust them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.materials.sheet import Knit, Material
from toros_fem.products.fitting.intervals import CONFIDENCE
from toros_fem.products.fitting.robust_fit import NORMAL_MAD
from toros_fem.products.fitting.samples import Samples
from toros_fem.products.options import FitOptions

# Title and SI unit of each constant.
CONSTANTS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "young": ("Young's modulus E", "Pa"),
        "poisson": ("Poisson's ratio ν", ""),
        "mu": ("Lamé parameter μ", "Pa"),
        "lam": ("Lamé parameter λ", "Pa"),
        "c1": ("bound c₁ on a stretch", ""),
        "c2": ("bound c₂ on their sum", ""),
        "knit_ratio": ("ratio of the directions", ""),
    }
)
# A mean residual beyond this part of the stress there is a misfit; stresses count as this part of
# the largest at least.
MISFIT, FLOOR = 0.1, 0.3
# Parts of the range of stretch that the misfit is looked at in.
PARTS = 12
# A fit is in doubt below this R² of the stress, or where stresses of specimens differ by this part
LEAST_R2, SCATTER = 0.95, 0.25
# An interval of Poisson's ratio that is this wide tells nothing.
WIDE_POISSON = 0.35


@dataclass(frozen=True)
class Estimate:
    """One constant, in SI units.

    Attributes:
        low, high: Ends of the 95 % interval; `high` is infinite for a bound c₁ or c₂ that the data
            do not reach.
        identified: Whether the data tell it: its interval ends within the bounds of the fit.
        unit: Its unit; empty for a pure number.
    """

    value: float
    low: float
    high: float
    identified: bool
    unit: str = ""

    def __contains__(self, value: float) -> bool:
        return self.low <= value <= self.high


@dataclass(frozen=True, eq=False, kw_only=True)
class FitResult:
    """Eq. (1) fitted to tensile tests, beside the data.

    Attributes:
        estimates: Constants by name: young, poisson, mu, lam, c1, c2; knit_ratio of a knit.
        samples: The points that were fitted.
        stress, lateral: The model's values at these points, (n,) each.
        thickness: In m; stresses are per width, so that only E h is measured.
        stiff: Direction of the courses of `knit`, the stiffer of two; None of one direction.
        taken: What was taken for granted of files and tests, as sentences.
        doubts: What of it moves the values.
    """

    estimates: Mapping[str, Estimate]
    samples: Samples
    stress: Floats
    lateral: Floats
    options: FitOptions
    thickness: float
    stiff: str | None = None
    taken: Sequence[str] = ()
    doubts: Sequence[str] = ()

    @property
    def specimens(self) -> tuple[str, ...]:
        """Names of the specimens."""
        return self.samples.specimen

    @property
    def r2_stress(self) -> float:
        """Coefficient of determination of the stress."""
        return _r_squared(self.samples.stress, self.stress)

    @property
    def r2_lateral(self) -> float | None:
        """Coefficient of determination of the lateral stretch; None if it was not measured."""
        seen = np.isfinite(self.samples.lateral)
        return _r_squared(self.samples.lateral[seen], self.lateral[seen]) if seen.any() else None

    @property
    def measured_to(self) -> float:
        """Largest stretch that was fitted."""
        return 1 + float(self.samples.strain.max())

    @cached_property
    def trusted_to(self) -> float:
        """Largest stretch up to which the mean residuals are within 10 %.

        The mean is taken over twelfths of the range and each direction; what three of its standard
        errors explain is no misfit. The noise is that between neighbouring points.
        """
        samples, residual = self.samples, self.samples.stress - self.stress
        largest, worst = float(samples.strain.max()), PARTS
        part = np.minimum((samples.strain / largest * PARTS).astype(np.int64), PARTS - 1)
        for name in set(samples.direction):
            own = samples.curve_along(name)
            least = FLOOR * np.abs(samples.stress[own]).max()
            noise = NORMAL_MAD / np.sqrt(2) * np.median(np.abs(np.diff(residual[own])))
            for k in np.unique(part[own]):
                rows = own[part[own] == k]
                mean = abs(residual[rows].mean()) - 3 * noise / np.sqrt(len(rows))
                if mean > MISFIT * max(samples.stress[rows].mean(), least):
                    worst = min(worst, int(k))
        return 1 + (largest if worst == PARTS else largest * worst / PARTS)

    @property
    def doubted(self) -> list[str]:
        """Why the values are in doubt, as sentences; none if they are as good as measured."""
        found = list(self.doubts)
        if self.r2_stress < LEAST_R2:
            found.append(f"R² of the stress is {self.r2_stress:.3g}, below {LEAST_R2}.")
        samples = self.samples
        for name in dict.fromkeys(samples.direction):
            rows = samples.along(name)
            tests = np.unique(samples.test[rows])
            common = min(samples.strain[samples.test == k].max() for k in tests)
            found_of = []
            for k in tests:
                own = (samples.test == k) & (samples.strain <= common)
                fitted = self.stress[own]
                found_of.append(float(samples.stress[own] @ fitted) / float(fitted @ fitted))
            if np.ptp(found_of) > SCATTER * np.mean(found_of):
                found.append(
                    f"the specimens {f'along {name!r} ' if name else ''}differ by "
                    f"{np.ptp(found_of) / np.mean(found_of):.0%} in stress."
                )
        return found

    @property
    def material(self) -> Material:
        """The sheet with its bounds; of a knit the plain fabric under its courses."""
        young, poisson = (self.estimates[name].value for name in ("young", "poisson"))
        return Material(young, poisson, self.thickness, self.c1, self.c2)

    @property
    def c1(self) -> float:
        """Bound on a principal stretch."""
        return self.estimates["c1"].value

    @property
    def c2(self) -> float:
        """Bound on the sum of both less 1."""
        return self.estimates["c2"].value

    @property
    def knit(self) -> Knit | None:
        """Courses of the fabric, if both directions were fitted."""
        found = self.estimates.get("knit_ratio")
        return None if found is None else Knit(max(found.value, 1.0))

    @property
    def remarks(self) -> list[str]:
        """What a reader must know, as sentences."""
        found = [*self.taken, *(f"In doubt: {text}" for text in self.doubted)]
        if self.stiff is not None:
            found.append(
                f"{self.stiff!r} is the stiffer direction: the courses of `Knit` run along it."
            )
        if self.r2_lateral is None:
            found.append(
                "No lateral stretch was measured: poisson and c2 follow from the stress alone."
            )
        far = "infinity: the data do not come near this bound."
        found += [
            f"{name} is not identified: its interval, {one.low:.4g} to {one.high:.4g}, reaches "
            + ("an end of what the fit allows." if np.isfinite(one.high) else far)
            for name, one in self.estimates.items()
            if not one.identified
        ]
        if self.trusted_to < self.measured_to:
            found.append(
                f"Beyond a stretch of {self.trusted_to:.3g} the mean residual exceeds 10 %: fit "
                "fewer data by --up-to, or mistrust the model there."
            )
        found.append(
            f"The tests are uniaxial, with stretches from 1 to {self.measured_to:.3g}: larger "
            "ones, compression, shear and biaxial stretching are extrapolated."
        )
        return found

    def summary(self) -> dict[str, Any]:
        """Return the result as JSON holds it."""
        return {
            "estimates": {
                name: asdict(one) | {"high": one.high if np.isfinite(one.high) else None}
                for name, one in self.estimates.items()
            },
            "r2_stress": self.r2_stress,
            "r2_lateral": self.r2_lateral,
            "stretch_measured_to": self.measured_to,
            "stretch_trusted_to": self.trusted_to,
            "specimens": list(self.specimens),
            "directions": list(self.samples.direction),
            "points": len(self.samples.strain),
            "remarks": self.remarks,
            "inputs": self.options.as_dict(),
            "thickness_m": self.thickness,
            "membrane_stiffness_n_per_m": self.material.membrane_stiffness,
            "stiff_direction": self.stiff,
            "doubts": self.doubted,
        }


def _r_squared(measured: Floats, model: Floats) -> float:
    """Return 1 − Σ residual²/Σ (measured − mean)²; −∞ of constant data that are missed."""
    missed = float(np.sum((measured - model) ** 2))
    spread = float(np.sum((measured - measured.mean()) ** 2))
    if spread == 0:
        return 1.0 if missed == 0 else -np.inf
    return 1 - missed / spread


def estimates_of(
    values: Mapping[str, float],
    draws: Mapping[str, Floats],
    ranges: Mapping[str, tuple[float, float]],
) -> dict[str, Estimate]:
    """Return constants with their intervals.

    Args:
        draws: The same constants of each draw, (draws,).
        ranges: Smallest and largest value that the fit allows for c₁ and c₂.
    """
    found = {}
    for name, value in values.items():
        ends = [50 * (1 - CONFIDENCE), 50 * (1 + CONFIDENCE)]
        # Of n draws n + 1 gaps are alike: other percentiles of few draws are too near.
        low, high = np.percentile(draws[name], ends, method="weibull")
        low, high = min(low, value), max(high, value)
        identified = name != "poisson" or high - low < WIDE_POISSON
        if name in ranges:
            least, most = ranges[name]
            margin = 1e-3 * (most - least)
            identified = least + margin < low and high < most - margin
            high = np.inf if high >= most - margin else high
        unit = CONSTANTS[name][1]
        found[name] = Estimate(float(value), float(low), float(high), bool(identified), unit)
    return found
