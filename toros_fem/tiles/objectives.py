"""What is wanted of a tile: a profile of stiffness over directions, a contraction, a contrast."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from toros_fem._types import Floats
from toros_fem.errors import TargetError
from toros_fem.tiles.stiffness_profile import Profile


class ProfileObjective(Protocol):
    """A measure T of a profile, and its derivatives."""

    def forward(self, profile: Profile) -> float:
        """T, a pure number."""
        ...

    def backward(self, profile: Profile) -> tuple[Floats, Floats]:
        """dT/d stress in m/N and dT/d contraction, (k,) each."""
        ...

    def residuals(self, profile: Profile) -> Floats:
        """Numbers r, (j,), of whose squares T is the sum; none if it is no such sum."""
        ...

    def residuals_backward(self, profile: Profile) -> tuple[Floats, Floats]:
        """dr/d stress in m/N and dr/d contraction, (j, k) each."""
        ...


@dataclass(frozen=True, eq=False)
class ProfileTarget:
    """T = Σ w (s/s* − 1)² + weight Σ w (c − c*)², over Σ w: least squares.

    s is the secant stiffness, c the lateral contraction; directions without a target, NaN, do not
    count.

    Attributes:
        stiffness: s* in N/m, (k,), NaN where any will do; None for all.
        contraction: c*, (k,), NaN where any will do; None for all.
        weights: w, (k,); None for 1.
        weight: Of contractions over stiffnesses.

    Raises:
        TargetError: Arrays do not fit together, a stiffness is not positive, a weight is negative,
            or nothing is asked.
    """

    stiffness: Floats | None = None
    contraction: Floats | None = None
    weights: Floats | None = None
    weight: float = 1.0

    def __post_init__(self) -> None:
        given = [a for a in (self.stiffness, self.contraction, self.weights) if a is not None]
        shapes = {np.shape(a) for a in given}
        if len(shapes) != 1:
            raise TargetError(
                f"stiffness, contraction and weights have shapes {sorted(shapes)}; give at least "
                "one, each with one value a direction."
            )
        weights = self.weights
        if weights is not None and not (np.all(weights >= 0) and 0 < np.sum(weights) < np.inf):
            raise TargetError(f"weights = {weights} must not be negative, nor all of them zero.")
        if not 0 <= self.weight < np.inf:
            raise TargetError(f"weight = {self.weight} must not be negative, and finite.")
        if all(np.isnan(a).all() for a in (self.stiffness, self.contraction) if a is not None):
            raise TargetError("all stiffnesses and contractions are NaN: nothing is asked for.")
        if self.stiffness is not None and np.any(self.stiffness <= 0):
            worst = float(np.nanmin(self.stiffness))
            raise TargetError(f"a stiffness of {worst:g} N/m is asked for; it must be positive.")

    def _parts(self, profile: Profile) -> tuple[Floats, Floats, Floats, Floats]:
        """Shares of the weights, differences of both kinds, and 1/s*, 0 where nothing is asked."""
        count = len(profile.angles)
        for given in (self.stiffness, self.contraction, self.weights):
            if given is not None and len(given) != count:
                raise TargetError(
                    f"the target is of {len(given)} directions, the profile of {count}."
                )
        none = np.full(count, np.nan)
        stiffness = none if self.stiffness is None else self.stiffness
        contraction = none if self.contraction is None else self.contraction
        weights = np.ones(count) if self.weights is None else self.weights
        off = np.nan_to_num(profile.stiffness / stiffness - 1)
        wide = np.nan_to_num(profile.contraction - contraction)
        return weights / weights.sum(), off, wide, np.nan_to_num(1 / stiffness)

    def forward(self, profile: Profile) -> float:
        """T."""
        return float(np.sum(self.residuals(profile) ** 2))

    def backward(self, profile: Profile) -> tuple[Floats, Floats]:
        """Its derivatives."""
        twice = 2 * self.residuals(profile)
        by_stress, by_contraction = self.residuals_backward(profile)
        return twice @ by_stress, twice @ by_contraction

    def residuals(self, profile: Profile) -> Floats:
        """Roots of the terms of T, signed: of what is asked of stiffness, then of contraction."""
        share, off, wide, _ = self._parts(profile)
        roots = np.sqrt([share, self.weight * share])
        return np.asarray((roots * np.stack([off, wide]))[self._asked(share)])

    def residuals_backward(self, profile: Profile) -> tuple[Floats, Floats]:
        """Their derivatives, (j, k) each."""
        share, _, _, inverse = self._parts(profile)
        every = np.eye(len(share))
        by_stress = np.sqrt(share) * inverse / profile.strain * every
        by_contraction = np.sqrt(self.weight * share) * every
        none, asked = np.zeros_like(every), self._asked(share)
        return (
            np.concatenate([by_stress[asked[0]], none[asked[1]]]),
            np.concatenate([none[asked[0]], by_contraction[asked[1]]]),
        )

    def _asked(self, share: Floats) -> npt.NDArray[np.bool_]:
        """Whether anything that counts is asked of stiffness and of contraction, (2, k)."""
        none = np.full(len(share), np.nan)
        both = [none if a is None else a for a in (self.stiffness, self.contraction)]
        return ~np.isnan(both) & (np.stack([share, self.weight * share]) > 0)

    def worst(self, profile: Profile) -> float:
        """Largest |s/s* − 1| or |c − c*| of what is asked for with a weight over 0."""
        share, off, wide, _ = self._parts(profile)
        return float(np.max(np.abs(np.stack([off, wide])) * (share > 0)))


@dataclass(frozen=True, eq=False)
class Contrast:
    """T = mean stiffness of some directions over that of others: the least possible is wanted.

    Attributes:
        soft, stiff: Which directions, (k,).

    Raises:
        TargetError: There are none of one kind.
    """

    soft: npt.NDArray[np.bool_]
    stiff: npt.NDArray[np.bool_]

    def __post_init__(self) -> None:
        if not (self.soft.any() and self.stiff.any()) or self.soft.shape != self.stiff.shape:
            raise TargetError(
                f"soft = {self.soft} and stiff = {self.stiff} must each name a direction, of as "
                "many."
            )

    def forward(self, profile: Profile) -> float:
        """T."""
        stress = profile.stress
        return float(stress[self.soft].mean() / stress[self.stiff].mean())

    def backward(self, profile: Profile) -> tuple[Floats, Floats]:
        """Its derivatives."""
        value, stress = self.forward(profile), profile.stress
        by: Floats = np.where(self.soft, 1.0 / self.soft.sum(), 0.0)
        by -= np.where(self.stiff, value / self.stiff.sum(), 0.0)
        by /= stress[self.stiff].mean()
        return by, np.zeros_like(stress)

    def residuals(self, profile: Profile) -> Floats:
        """None: T is no sum of squares."""
        return np.zeros(0)

    def residuals_backward(self, profile: Profile) -> tuple[Floats, Floats]:
        """None."""
        none = np.zeros((0, len(profile.angles)))
        return none, none
