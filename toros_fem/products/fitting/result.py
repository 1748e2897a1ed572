"""The result of a fit: constants with intervals, how well they fit, and how far to trust them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.materials.sheet import Knit, Material
from toros_fem.products.fitting.fitting import NORMAL_MAD, FitOptions, Samples

UNITS = {"young": "Pa", "mu": "Pa", "lam": "Pa"}
# A mean residual beyond this part of the stress there is a misfit; stresses count as this part of
# the largest at least.
MISFIT, FLOOR = 0.1, 0.3
# Parts of the range of stretch that the misfit is looked at in.
PARTS = 12
# An interval of Poisson's ratio that is this wide tells nothing.
WIDE_POISSON = 0.35


@dataclass(frozen=True)
class Estimate:
    """One constant.

    Attributes:
        value: In SI units.
        low, high: Ends of the 95 % interval; `high` is infinite for a bound c₁ or c₂ that the data
            do not reach.
        identified: Whether the data tell it: its interval ends within the bounds of the fit.
        unit: SI unit; empty for a pure number.
    """

    value: float
    low: float
    high: float
    identified: bool
    unit: str = ""

    def __contains__(self, value: float) -> bool:
        return self.low <= value <= self.high


@dataclass(frozen=True, eq=False, kw_only=True)
class Fit:
    """What was fitted to tensile tests, beside the data.

    Attributes:
        estimates: Constants by name.
        samples: The points that were fitted.
        stress, lateral: The model's values at these points, (n,) each.
        specimens: Names of the specimens.
        options: Options of the fit.
    """

    estimates: Mapping[str, Estimate]
    samples: Samples
    stress: Floats
    lateral: Floats
    specimens: tuple[str, ...]
    options: FitOptions

    @property
    def r2_stress(self) -> float:
        """Coefficient of determination of the stress."""
        return r_squared(self.samples.stress, self.stress)

    @property
    def r2_lateral(self) -> float | None:
        """Coefficient of determination of the lateral stretch; None if it was not measured."""
        seen = self.samples.has_lateral
        return r_squared(self.samples.lateral[seen], self.lateral[seen]) if len(seen) else None

    @property
    def measured_to(self) -> float:
        """Largest stretch that was fitted."""
        return 1 + float(self.samples.strain.max())

    @cached_property
    def trusted_to(self) -> float:
        """Largest stretch up to which the mean residuals are within 10 %."""
        return trusted_stretch(self.samples, self.stress)

    @property
    def remarks(self) -> list[str]:
        """What a reader must know, as sentences."""
        found = [
            f"{name} is not identified: its interval, {one.low:.4g} to {one.high:.4g}, reaches "
            + (
                "an end of what the fit allows."
                if np.isfinite(one.high)
                else "infinity: the data do not come near this bound."
            )
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

    @property
    def sizes(self) -> list[str]:
        """Further lines of the table."""
        return []

    def summary(self) -> dict[str, Any]:
        """Return the result as JSON holds it."""
        return {
            "estimates": {
                name: {
                    "value": one.value, "low": one.low,
                    "high": one.high if np.isfinite(one.high) else None,
                    "identified": one.identified, "unit": one.unit,
                }
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
        }  # fmt: skip


@dataclass(frozen=True, eq=False, kw_only=True)
class FitResult(Fit):
    """Eq. (1) fitted to tensile tests.

    The estimates are young, poisson, mu, lam, c1, c2, and knit_ratio of two directions.

    Attributes:
        thickness: In m; stresses are per width, so that only E h is measured.
        stiff: Direction of the courses of `knit`, the stiffer of two; None of one direction.
        rounds: Rounds of simulations of the clamped strip; 0 without.
    """

    thickness: float
    stiff: str | None = None
    rounds: int = 0

    @property
    def material(self) -> Material:
        """The sheet with its bounds; of a knit the plain fabric under its courses."""
        found = self.estimates
        return Material(
            found["young"].value, found["poisson"].value, self.thickness, self.c1, self.c2
        )

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
        found = []
        if self.stiff is not None:
            found.append(
                f"{self.stiff!r} is the stiffer direction: the courses of `Knit` run along it."
            )
        if self.r2_lateral is None:
            found.append(
                "No lateral stretch was measured: poisson and c2 follow from the stress alone."
            )
        return found + super().remarks

    @property
    def sizes(self) -> list[str]:
        """Further lines of the table."""
        stiffness = self.material.membrane_stiffness
        return [f"{'E h':24}{stiffness:12.4g} N/m at h = {1e3 * self.thickness:.3g} mm"]

    def summary(self) -> dict[str, Any]:
        """Return the result as JSON holds it."""
        return {
            **super().summary(),
            "thickness_m": self.thickness,
            "membrane_stiffness_n_per_m": self.material.membrane_stiffness,
            "stiff_direction": self.stiff,
            "clamp_rounds": self.rounds,
        }


def r_squared(measured: Floats, model: Floats) -> float:
    """Return 1 − Σ residual²/Σ (measured − mean)²; −∞ of constant data that are missed."""
    missed = float(np.sum((measured - model) ** 2))
    spread = float(np.sum((measured - measured.mean()) ** 2))
    if spread == 0:
        return 1.0 if missed == 0 else -np.inf
    return 1 - missed / spread


def trusted_stretch(samples: Samples, stress: Floats) -> float:
    """Return the stretch up to which mean residuals of the stress stay within `MISFIT`.

    The mean is taken over twelfths of the range and each direction; what three of its standard
    errors explain is no misfit. The noise is that between neighbouring points.
    """
    top = float(samples.strain.max())
    part = np.minimum((samples.strain / top * PARTS).astype(np.int64), PARTS - 1)
    names = np.array(samples.direction)[samples.test]
    worst = PARTS
    for name in sorted(set(samples.direction)):
        own = names == name
        largest = float(np.abs(samples.stress[own]).max())
        order = np.flatnonzero(own)[np.argsort(samples.strain[own], kind="stable")]
        steps = np.diff((samples.stress - stress)[order])
        noise = NORMAL_MAD / np.sqrt(2) * float(np.median(np.abs(steps)))
        for k in range(worst):
            rows = own & (part == k)
            if rows.any():
                residual = (samples.stress - stress)[rows]
                error = 3 * noise / np.sqrt(len(residual))
                mean = max(abs(float(residual.mean())) - error, 0.0)
                level = max(float(samples.stress[rows].mean()), FLOOR * largest)
                if mean > MISFIT * level:
                    worst = k
                    break
    return 1 + (top if worst == PARTS else top * worst / PARTS)


def estimates_of(
    values: Mapping[str, float],
    draws: Sequence[Mapping[str, float]],
    ranges: Mapping[str, tuple[float, float]],
    confidence: float,
) -> dict[str, Estimate]:
    """Return constants with their intervals.

    Args:
        values: The constants.
        draws: The constants of each draw.
        ranges: Smallest and largest value that the fit allows for c₁ and c₂.
        confidence: Probability of the intervals.
    """
    found = {}
    for name, value in values.items():
        drawn = np.array([draw[name] for draw in draws])
        tails = [50 * (1 - confidence), 50 * (1 + confidence)]
        low, high = (float(end) for end in np.percentile(drawn, tails))
        low, high = min(low, value), max(high, value)
        identified = True
        if name in ranges:
            least, most = ranges[name]
            margin = 1e-3 * (most - least)
            identified = low > least + margin and high < most - margin
            high = np.inf if high >= most - margin else high
        elif name == "poisson":
            identified = high - low < WIDE_POISSON
        found[name] = Estimate(value, low, high, bool(identified), UNITS.get(name, ""))
    return found
