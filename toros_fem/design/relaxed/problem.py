"""A design problem whose variables are line families instead of densities."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Any, cast

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import DensityError
from toros_fem.base.mpi import dot, together, total
from toros_fem.base.validation import require_count
from toros_fem.design.density.linear import Filter
from toros_fem.design.lines.field import LineField
from toros_fem.design.loop.problem import Evaluation
from toros_fem.design.loop.shape_problem import ShapeProblem
from toros_fem.design.relaxed.families import Families, FixedDirections
from toros_fem.design.relaxed.smoothing import smoothing
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.skin.designs import CROSSING, LineDesign

# Mean of the random start's variables, and the standard deviation of their logarithm.
START, SPREAD = 0.04, 0.7


@dataclass(eq=False)
class RelaxedProblem(ShapeProblem):
    """A skin whose designed triangles carry line families: shares and directions are designed.

    The variables of a triangle are those of `families`, one after the other; ρ̃ are their smoothed
    values and ρ̄ the relaxed material, (own, 1 + 3 K). `relaxed_problem` makes it of a density
    design. For the attributes that are not listed here see `ShapeProblem`.

    Attributes:
        families: How variables become shares and directions.
        share_weight: Factor on the mean sum of shares in T, so that there are no lines where none
            are needed.
    """

    families: Families = field(kw_only=True, default_factory=FixedDirections)
    share_weight: float = field(kw_only=True, default=0.0)

    @property
    def variable_bounds(self) -> tuple[Floats, Floats]:
        """Least and largest value of each variable of this rank; equal where it is prescribed."""
        designed = np.repeat(self.designed, self.families.fields)
        return np.zeros(len(designed)), designed.astype(np.float64)

    def check_variables(self, density: Floats) -> Floats:
        """Return the variables of this rank as an array, checked (collective)."""
        count = len(self.designed) * self.families.fields
        with together(self.comm):
            if np.shape(density) != (count,):
                raise DensityError(
                    f"the variables have shape {np.shape(density)}; this rank has {count}, "
                    f"{self.families.fields} of each owned triangle."
                )
            if not np.all((np.asarray(density) >= 0) & (np.asarray(density) <= 1)):
                raise DensityError("a variable of the line families leaves [0, 1], or is NaN.")
        return np.asarray(density)

    def with_passive(self, density: Floats) -> Floats:
        """Return the variables, zero where there are no line families."""
        return density * np.repeat(self.designed, self.families.fields)

    def fields(self, density: Floats) -> tuple[Floats, Floats]:
        """Return smoothed variables and the relaxed material (collective)."""
        filtered = self.filter.forward(density)
        material = self.families.forward(filtered.reshape(-1, self.families.fields))
        if self.passive is not None:
            given = ~self.designed
            material[given] = 0.0
            material[given, 0] = self.passive[given]
        return filtered, material

    def _pull_back(
        self, evaluation: Evaluation[Any], by_filtered: Floats | None, by_projected: Floats
    ) -> Floats:
        """Return the gradient by the variables from that by the material (collective)."""
        x = evaluation.filtered.reshape(-1, self.families.fields)
        by_smoothed = self.families.backward(x, by_projected * self.designed[:, None])
        return self.with_passive(self.filter.backward(by_smoothed.ravel()))

    def cost(self, projected: Floats) -> float:
        """Return the cost of the lines (collective)."""
        return self.share_weight * self._mean_sum(projected)

    def cost_backward(self, projected: Floats) -> Floats:
        """Return the gradient of the cost by the material (collective)."""
        gradient = np.zeros_like(projected)
        fractions = self._area_fractions()[:, None]
        gradient[:, 1 : 1 + self.families.count] = self.share_weight * fractions
        return gradient

    def _mean_sum(self, projected: Floats) -> float:
        """Return the mean sum of the shares of all families (collective)."""
        shares = projected[:, 1 : 1 + self.families.count].sum(axis=1)
        return dot(self.comm, self._area_fractions(), shares)

    def _area_fractions(self) -> Floats:
        """Return the fraction of the designed area of each owned triangle (collective)."""
        areas = self.skin.pattern.areas[self.skin.owned_cells] * self.designed
        return np.asarray(areas / total(self.comm, areas.sum()))

    def start_density(self, seed: int) -> Floats:
        """Return random variables: smoothed noise, the same on any number of ranks (collective).

        Only the first stage has a random start.
        """
        require_count(0, seed=seed)
        shape = len(self.skin.pattern.panel), self.families.fields
        noise = np.random.default_rng(seed).standard_normal(shape)[self.skin.owned_cells]
        smooth = self.filter.forward(self.with_passive(noise.ravel()))
        count = total(self.comm, float(self.variable_bounds[1].sum()))
        deviation = np.sqrt(dot(self.comm, smooth, smooth) / count)
        drawn = np.clip(START * np.exp(SPREAD * smooth / deviation), 0, 1)
        return self.with_passive(drawn)

    def initial_density(self, density: Floats) -> None:
        """Return None: `start_field` shows what a relaxed design begins with."""

    def start_field(self, variables: Floats) -> LineField:
        """Return the line families of owned variables before smoothing (collective)."""
        return self._line_field(self.fields(self.with_passive(variables))[1])

    def reinforcement(self, evaluation: Evaluation[Equilibrium]) -> tuple[float, float]:
        """Return the mean sum of shares, and 0: lines are not grey (collective)."""
        return self._mean_sum(evaluation.projected), 0.0

    def shown_density(self, evaluation: Evaluation[Equilibrium]) -> Floats:
        """Return the part of each owned triangle that is covered: ρ̄ and all shares, at most 1."""
        covered = evaluation.projected[:, : 1 + self.families.count].sum(axis=1)
        return np.minimum(covered, 1.0)

    def line_field(self, evaluation: Evaluation[Equilibrium]) -> LineField:
        """Return the line families of a design, on every rank (collective)."""
        return self._line_field(evaluation.projected)

    def _line_field(self, projected: Floats) -> LineField:
        material = self.skin.gather_cells(projected)
        shares, cosine, sine = np.split(material[:, 1:], 3, axis=1)
        return LineField(self.skin.pattern, shares, np.arctan2(sine, cosine) / 2)


def relaxed_problem(
    design: ShapeProblem,
    families: Families,
    radius: float,
    share_weight: float = 0.0,
    crossing: float = CROSSING,
) -> RelaxedProblem:
    """Return the relaxed problem of a density design on the same mesh (collective).

    Target, supports, loads, pressures and prescribed densities are those of the design; filter,
    projection, perimeter and widths are left out. `radius` is that of the smoothing in m, and
    `crossing` the factor of bonded crossings.
    """
    skin = design.skin
    designed = skin.gather_cells(design.designed.astype(np.float64)) > 0.5
    given = design.solver
    lines = partial(LineDesign, families=families.count, crossing=crossing)
    solver = given.like(design=lines, log=given.log)
    return RelaxedProblem(
        solver=solver,
        objective=design.objective,
        # Widths, which need more of a filter, are left out.
        filter=cast(Filter, smoothing(skin, radius, families, designed)),
        pressure=design.pressure,
        passive=design.passive,
        pressure_bounds=design.pressure_bounds,
        force=design.force,
        whole=design.whole,
        target=design.target,
        metrics=design.metrics,
        families=families,
        share_weight=share_weight,
    )
