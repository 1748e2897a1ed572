"""Line families as design variables instead of densities."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Self

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import dot, together, total
from toros_fem.base.validation import require_count
from toros_fem.design.density.linear import Linear
from toros_fem.design.lines.field import LineField
from toros_fem.design.loop.fields import Fields
from toros_fem.design.loop.problem import ObjectiveTerm
from toros_fem.design.loop.shape_problem import ShapeProblem
from toros_fem.design.relaxed.families import Families
from toros_fem.design.relaxed.smoothing import smoothing
from toros_fem.mechanics.skin.designs import CROSSING, LineDesign
from toros_fem.meshes.skin import Skin

# Mean of the random start's variables, and the standard deviation of their logarithm.
START, SPREAD = 0.04, 0.7


@dataclass(frozen=True, eq=False)
class LineShares(Fields):
    """Line families on the designed triangles: shares and directions.

    The variables of a triangle are those of `families`, one after the other; ρ̃ are their smoothed
    values and ρ̄ the relaxed material, (own, 1 + 3 K).

    Attributes:
        families: How variables become shares and directions.
        smoothing: Filter of the variables.
    """

    skin: Skin
    families: Families
    smoothing: Linear
    passive: Floats | None = None

    @property
    def beta(self) -> float:
        """0: nothing is projected."""
        return 0.0

    def with_beta(self, beta: float) -> Self:
        """Return these fields: nothing is projected."""
        return self

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Least and largest value of each variable; equal where it is prescribed."""
        designed = np.repeat(self.designed, self.families.fields)
        return np.zeros(len(designed)), designed.astype(np.float64)

    def checked(self, x: Floats) -> Floats:
        """Return the variables as an array (collective)."""
        count = len(self.skin.owned_cells) * self.families.fields
        with together(self.skin.comm):
            if np.shape(x) != (count,):
                raise ParameterError(
                    f"the variables have shape {np.shape(x)}; this rank has {count}, "
                    f"{self.families.fields} of each owned triangle."
                )
            if not np.all((np.asarray(x) >= 0) & (np.asarray(x) <= 1)):
                raise ParameterError("a variable of the line families leaves [0, 1], or is NaN.")
        return np.asarray(x)

    def with_passive(self, x: Floats) -> Floats:
        """Return the variables, zero where there are no line families."""
        return x * np.repeat(self.designed, self.families.fields)

    def forward(self, x: Floats) -> tuple[Floats, Floats]:
        """Return smoothed variables and the relaxed material (collective)."""
        smooth = self.smoothing.forward(x)
        material = self.families.forward(smooth.reshape(-1, self.families.fields))
        if self.passive is not None:
            given = ~np.isnan(self.passive)
            material[given] = 0.0
            material[given, 0] = self.passive[given]
        return smooth, material

    def backward(
        self, filtered: Floats, by_projected: Floats, by_filtered: Floats | None = None
    ) -> Floats:
        """Return the gradient by the variables (collective)."""
        smooth = filtered.reshape(-1, self.families.fields)
        by_smooth = self.families.backward(smooth, by_projected * self.designed[:, None])
        both = by_smooth.ravel() if by_filtered is None else by_smooth.ravel() + by_filtered
        return self.with_passive(self.smoothing.backward(both))

    def start(self, seed: int) -> Floats:
        """Return random variables: smoothed noise (collective).

        Only the first stage has a random start.
        """
        require_count(0, seed=seed)
        shape = len(self.skin.pattern.panel), self.families.fields
        noise = np.random.default_rng(seed).standard_normal(shape)[self.skin.owned_cells]
        smooth, comm = self.smoothing.forward(self.with_passive(noise.ravel())), self.skin.comm
        count = total(comm, float(self.bounds[1].sum()))
        deviation = np.sqrt(dot(comm, smooth, smooth) / count)
        return self.with_passive(np.clip(START * np.exp(SPREAD * smooth / deviation), 0, 1))

    def reinforcement(self, projected: Floats) -> tuple[float, float]:
        """Return the mean sum of shares, and 0: lines are not grey (collective)."""
        return MeanShares(self).forward(projected), 0.0

    def shown(self, projected: Floats) -> Floats:
        """Return the part of each owned triangle that is covered: ρ̄ and all shares, at most 1."""
        return np.minimum(projected[:, : 1 + self.families.count].sum(axis=1), 1.0)

    def line_field(self, projected: Floats) -> LineField:
        """Return the line families of a relaxed material, on every rank (collective)."""
        material = self.skin.gather_cells(projected)
        shares, cosine, sine = np.split(material[:, 1:], 3, axis=1)
        return LineField(self.skin.pattern, shares, np.arctan2(sine, cosine) / 2)


@dataclass(frozen=True, eq=False)
class MeanShares:
    """Mean sum of all shares over the designed area, so that no lines are where none help."""

    fields: LineShares

    def forward(self, projected: Floats) -> float:
        """Return the mean (collective)."""
        shares = projected[:, 1 : 1 + self.fields.families.count].sum(axis=1)
        return dot(self.fields.skin.comm, self.fields.area_fractions(), shares)

    def backward(self, projected: Floats) -> Floats:
        """Return its derivative by the relaxed material (collective)."""
        gradient = np.zeros_like(projected)
        gradient[:, 1 : 1 + self.fields.families.count] = self.fields.area_fractions()[:, None]
        return gradient


def relaxed_problem(
    design: ShapeProblem,
    families: Families,
    radius: float,
    share_weight: float | None = None,
    crossing: float = CROSSING,
) -> ShapeProblem:
    """Return the relaxed problem of a density design on the same mesh (collective).

    Target, supports, loads, pressures and prescribed densities are those of the design; filter,
    projection, perimeter and widths are left out.

    Args:
        radius: That of the smoothing in m.
        share_weight: Factor on the mean sum of shares in T; None leaves this cost out.
        crossing: Factor of bonded crossings.
    """
    skin, given = design.skin, design.physics
    designed = skin.gather_cells(design.designed.astype(np.float64)) > 0.5
    fields = LineShares(
        skin, families, smoothing(skin, radius, families, designed), design.fields.passive
    )
    lines = partial(LineDesign, families=families.count, crossing=crossing)
    return ShapeProblem(
        fields,
        replace(given, solver=given.solver.like(design=lines, log=given.solver.log)),
        design.objective,
        [] if share_weight is None else [ObjectiveTerm("shares", MeanShares(fields), share_weight)],
        metrics=design.metrics,
        whole=design.whole,
        target=design.target,
    )
