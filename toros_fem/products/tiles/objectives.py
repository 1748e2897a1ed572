"""Objectives of a profile: a target of stiffness and contraction, or a ratio of stiffnesses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from toros_fem.base.array_types import Bools, Floats
from toros_fem.base.errors import TargetError
from toros_fem.products.tiles.stiffness_profile import Profile


class ProfileObjective(Protocol):
    """An objective T of a profile, with its derivatives."""

    def forward(self, profile: Profile) -> float:
        """Return T, a pure number."""
        ...

    def backward(self, profile: Profile) -> tuple[Floats, Floats]:
        """Return dT/d stress in m/N and dT/d contraction, (k,) each."""
        ...

    def residuals(self, profile: Profile) -> Floats:
        """Return numbers r, (j,), with T = Σ r²; empty if T is not such a sum."""
        ...

    def residuals_backward(self, profile: Profile) -> tuple[Floats, Floats]:
        """Return dr/d stress in m/N and dr/d contraction, (j, k) each."""
        ...


@dataclass(frozen=True, eq=False)
class ProfileTarget:
    """Least squares T = [Σ w (s/s* − 1)² + v Σ w (c − c*)²] / Σ w over the directions.

    s is the secant stiffness and c the lateral contraction. A direction whose target is NaN does
    not count.

    Attributes:
        stiffness: Targets s* in N/m, (k,), NaN where there is none; None for no target at all.
        contraction: Targets c*, (k,), NaN where there is none; None for no target at all.
        weights: Weights w of the directions, (k,); None takes 1.
        contraction_weight: Weight v of contraction relative to stiffness.

    Raises:
        TargetError: The arrays do not fit together, a stiffness is not positive, a weight is
            negative, or there is no target.
    """

    stiffness: Floats | None = None
    contraction: Floats | None = None
    weights: Floats | None = None
    contraction_weight: float = 1.0

    def __post_init__(self) -> None:
        given = [a for a in (self.stiffness, self.contraction, self.weights) if a is not None]
        shapes = {np.shape(a) for a in given}
        if len(shapes) != 1:
            raise TargetError(
                f"stiffness, contraction and weights have shapes {sorted(shapes)}; give at least "
                "one of them, each with one value for each direction."
            )
        weights = self.weights
        if weights is not None and not (np.all(weights >= 0) and 0 < np.sum(weights) < np.inf):
            raise TargetError(
                f"weights = {weights} must be finite, none of them negative and not all zero."
            )
        if not 0 <= self.contraction_weight < np.inf:
            raise TargetError(
                f"contraction_weight = {self.contraction_weight} must be finite and at least 0."
            )
        if all(np.isnan(a).all() for a in (self.stiffness, self.contraction) if a is not None):
            raise TargetError(
                "all stiffnesses and contractions are NaN: there is no target. Give one for at "
                "least one direction."
            )
        if self.stiffness is not None and np.any(self.stiffness <= 0):
            smallest = float(np.nanmin(self.stiffness))
            raise TargetError(f"a target stiffness is {smallest:g} N/m; it must be positive.")

    def forward(self, profile: Profile) -> float:
        """Return T."""
        return float(np.sum(self.residuals(profile) ** 2))

    def backward(self, profile: Profile) -> tuple[Floats, Floats]:
        """Return dT/d stress in m/N and dT/d contraction, (k,) each."""
        twice = 2 * self.residuals(profile)
        by_stress, by_contraction = self.residuals_backward(profile)
        return twice @ by_stress, twice @ by_contraction

    def residuals(self, profile: Profile) -> Floats:
        """Return the signed roots of the terms of T: those of stiffness, then of contraction."""
        fraction, stiffness, contraction, _ = self._deviations(profile)
        roots = np.sqrt([fraction, self.contraction_weight * fraction])
        return np.asarray((roots * np.stack([stiffness, contraction]))[self._counts(fraction)])

    def residuals_backward(self, profile: Profile) -> tuple[Floats, Floats]:
        """Return the residuals' derivatives by stress in m/N and by contraction, (j, k) each."""
        fraction, _, _, inverse = self._deviations(profile)
        unit = np.eye(len(fraction))
        by_stress = np.sqrt(fraction) * inverse / profile.strain * unit
        by_contraction = np.sqrt(self.contraction_weight * fraction) * unit
        zero, counts = np.zeros_like(unit), self._counts(fraction)
        return (
            np.concatenate([by_stress[counts[0]], zero[counts[1]]]),
            np.concatenate([zero[counts[0]], by_contraction[counts[1]]]),
        )

    def largest_deviation(self, profile: Profile) -> float:
        """Return the largest |s/s* − 1| or |c − c*| of the directions with a positive weight."""
        fraction, stiffness, contraction, _ = self._deviations(profile)
        return float(np.max(np.abs(np.stack([stiffness, contraction])) * (fraction > 0)))

    def _deviations(self, profile: Profile) -> tuple[Floats, Floats, Floats, Floats]:
        """Return w/Σw, s/s* − 1, c − c* and 1/s*, each (k,), 0 where there is no target."""
        count = len(profile.angles)
        for given in (self.stiffness, self.contraction, self.weights):
            if given is not None and len(given) != count:
                raise TargetError(
                    f"the target has {len(given)} directions, the profile {count}. Give both the "
                    "same directions."
                )
        none = np.full(count, np.nan)
        stiffness = none if self.stiffness is None else self.stiffness
        contraction = none if self.contraction is None else self.contraction
        weights = np.ones(count) if self.weights is None else self.weights
        return (
            weights / weights.sum(),
            np.nan_to_num(profile.stiffness / stiffness - 1),
            np.nan_to_num(profile.contraction - contraction),
            np.nan_to_num(1 / stiffness),
        )

    def _counts(self, fraction: Floats) -> Bools:
        """Return whether stiffness and contraction count in each direction, (2, k)."""
        none = np.full(len(fraction), np.nan)
        both = [none if a is None else a for a in (self.stiffness, self.contraction)]
        weights = np.stack([fraction, self.contraction_weight * fraction])
        return np.asarray(~np.isnan(both) & (weights > 0))


@dataclass(frozen=True, eq=False)
class Contrast:
    """Ratio T of the mean stiffness of some directions to that of others, to be minimised.

    Attributes:
        soft: Directions of the numerator, (k,).
        stiff: Directions of the denominator, (k,).

    Raises:
        TargetError: One of them is empty, or their lengths differ.
    """

    soft: Bools
    stiff: Bools

    def __post_init__(self) -> None:
        if not (self.soft.any() and self.stiff.any()) or self.soft.shape != self.stiff.shape:
            raise TargetError(
                f"soft = {self.soft} and stiff = {self.stiff} must have the same length, and each "
                "must select a direction."
            )

    def forward(self, profile: Profile) -> float:
        """Return T."""
        stress = profile.stress
        return float(stress[self.soft].mean() / stress[self.stiff].mean())

    def backward(self, profile: Profile) -> tuple[Floats, Floats]:
        """Return dT/d stress in m/N and dT/d contraction, (k,) each."""
        value, stress = self.forward(profile), profile.stress
        by: Floats = np.where(self.soft, 1.0 / self.soft.sum(), 0.0)
        by -= np.where(self.stiff, value / self.stiff.sum(), 0.0)
        by /= stress[self.stiff].mean()
        return by, np.zeros_like(stress)

    def residuals(self, profile: Profile) -> Floats:
        """Return no residuals: T is not a sum of squares."""
        return np.zeros(0)

    def residuals_backward(self, profile: Profile) -> tuple[Floats, Floats]:
        """Return no derivatives, (0, k) each."""
        none = np.zeros((0, len(profile.angles)))
        return none, none
