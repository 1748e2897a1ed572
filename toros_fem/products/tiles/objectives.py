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
        goals, roots = self._goals_and_roots(profile)
        return np.asarray((roots * _deviations(profile, goals))[roots > 0])

    def residuals_backward(self, profile: Profile) -> tuple[Floats, Floats]:
        """Return the residuals' derivatives by stress in m/N and by contraction, (j, k) each."""
        goals, roots = self._goals_and_roots(profile)
        slopes = roots * [1 / goals[0] / profile.strain, np.ones_like(goals[0])]
        by_stress, by_contraction = np.split(np.diag(slopes.ravel())[roots.ravel() > 0], 2, axis=1)
        return by_stress, by_contraction

    def largest_deviation(self, profile: Profile) -> float:
        """Return the largest |s/s* − 1| or |c − c*| of the directions with a positive weight."""
        goals, _ = self._goals_and_roots(profile)
        counts = np.ones(len(goals[0])) if self.weights is None else self.weights
        return float(np.nan_to_num(np.abs(_deviations(profile, goals)))[:, counts > 0].max())

    def _goals_and_roots(self, profile: Profile) -> tuple[Floats, Floats]:
        """Return the targets, (2, k), NaN where there is none, and the factors of deviations.

        The factors are the roots of those of the terms of T, 0 where there is no target.
        """
        count = len(profile.angles)
        for given in (self.stiffness, self.contraction, self.weights):
            if given is not None and len(given) != count:
                raise TargetError(
                    f"the target has {len(given)} directions, the profile {count}. Give both the "
                    "same directions."
                )
        none = np.full(count, np.nan)
        goals = np.stack([none if a is None else a for a in (self.stiffness, self.contraction)])
        weights = np.ones(count) if self.weights is None else self.weights
        shares = np.outer([1.0, self.contraction_weight], weights / weights.sum())
        return goals, np.where(np.isnan(goals), 0.0, np.sqrt(shares))


def _deviations(profile: Profile, goals: Floats) -> Floats:
    """Return s/s* − 1 and c − c*, (2, k), NaN where there is no target."""
    return np.stack([profile.stiffness / goals[0] - 1, profile.contraction - goals[1]])


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
