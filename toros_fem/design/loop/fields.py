"""Design variables of a skin and the fields that they become, eqs. (11, 12), on any mesh."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol, Self

import numpy as np

from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import dot, together, total
from toros_fem.base.validation import Bools, Floats, checked_floats, require_count
from toros_fem.design.density.filters import Filter
from toros_fem.design.density.projection import Projection
from toros_fem.design.loop.options import Iteration
from toros_fem.mechanics.skin.designs import check_density
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.skin import Skin
from toros_fem.meshes.transfer import make_transfer

if TYPE_CHECKING:
    from toros_fem.design.loop.problem import DesignProblem

InitialDensity = tuple[Pattern, Floats]


def random_density(skin: Skin, seed: int, mean: float = 0.5, spread: float = 0.1) -> Floats:
    """Return owned densities drawn uniformly from mean ± spread for each pattern triangle.

    The same seed gives the same density in each triangle on any number of ranks.
    """
    require_count(0, seed=seed)
    drawn = np.random.default_rng(seed).uniform(-1, 1, len(skin.pattern.panel))
    return np.asarray(mean + spread * drawn[skin.owned_cells])


class Fields(Protocol):
    """Variables x of the triangles of a rank, and the fields ρ̃ and ρ̄ that they become.

    `forward` and `backward` are a pair.

    Attributes:
        skin: The skin whose triangles are designed.
        passive: Prescribed ρ̄ at owned triangles, NaN where it is designed; None designs all.
    """

    skin: Skin
    passive: Floats | None

    @property
    def designed(self) -> Bools:
        """Whether each owned triangle is designed."""
        if self.passive is None:
            return np.ones(len(self.skin.owned_cells), dtype=bool)
        return np.isnan(self.passive)

    def area_fractions(self) -> Floats:
        """Return the fraction of the designed area of each owned triangle (collective)."""
        areas = self.skin.pattern.areas[self.skin.owned_cells] * self.designed
        return np.asarray(areas / total(self.skin.comm, areas.sum()))

    @property
    def beta(self) -> float:
        """Steepness β of the projection."""

    def with_beta(self, beta: float) -> Self:
        """Return the same fields with another steepness; all other parts are shared."""

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Least and largest value of each variable; equal where it is prescribed."""

    def checked(self, x: Floats) -> Floats:
        """Return variables as an array (collective).

        Raises:
            ParameterError: The shape is wrong, or a value is outside [0, 1].
        """

    def with_passive(self, x: Floats) -> Floats:
        """Return variables with the prescribed values put in, so that filters see them."""

    def start(self, seed: int) -> Floats:
        """Return random variables, the same on any number of ranks (collective).

        Raises:
            ParameterError: The seed is negative.
        """

    def forward(self, x: Floats) -> tuple[Floats, Floats]:
        """Return ρ̃ and ρ̄ at owned triangles (collective)."""

    def backward(
        self, filtered: Floats, by_projected: Floats, by_filtered: Floats | None = None
    ) -> Floats:
        """Return a gradient by x from those by ρ̄ and ρ̃ (collective)."""

    def reinforcement(self, projected: Floats) -> tuple[float, float]:
        """Return volume fraction and grey level of a design, as of `Iteration` (collective)."""

    def shown(self, projected: Floats) -> Floats:
        """Return the density of owned triangles that pictures show."""


@dataclass(frozen=True, eq=False)
class DensityFields(Fields):
    """One density for each triangle: ρ, filtered ρ̃, projected ρ̄.

    Attributes:
        filter: Filter of the densities.
        projection: Smoothed step; the loop raises its β.
        centre: Density of all triangles to start from, (t,), within [0.1, 0.9]: noise of 0.1 is
            added. None starts from 0.5.

    Raises:
        ParameterError: The prescribed density does not fit, leaves [0, 1] or covers everything, or
            `centre` does not fit.
    """

    skin: Skin
    filter: Filter
    projection: Projection = field(default_factory=Projection)
    passive: Floats | None = None
    centre: Floats | None = None

    def __post_init__(self) -> None:
        self._check_centre()
        if self.passive is None:
            return
        skin, given = self.skin, self.passive[~np.isnan(self.passive)]
        with together(skin.comm):
            if len(given) and not (given.min() >= 0 and given.max() <= 1):
                raise ParameterError(
                    f"passive holds densities from {given.min()} to {given.max()}; they must lie "
                    "in [0, 1], or be NaN where the triangle is designed."
                )

    def _check_centre(self) -> None:
        if self.centre is None:
            return
        count = len(self.skin.pattern.panel)
        what = "one density for each triangle of the pattern"
        centre = checked_floats("start", self.centre, f"({count},), {what}", (count,), finite=False)
        object.__setattr__(self, "centre", centre)
        least, largest = float(np.min(centre)), float(np.max(centre))
        if not 0.1 <= least <= largest <= 0.9:
            raise ParameterError(
                f"start holds densities from {least:g} to {largest:g}; they must lie in "
                "[0.1, 0.9], since noise of 0.1 is added."
            )

    @property
    def beta(self) -> float:
        """Steepness β of the projection."""
        return self.projection.beta

    def with_beta(self, beta: float) -> Self:
        """Return the same fields with another steepness; all other parts are shared."""
        return replace(self, projection=replace(self.projection, beta=beta))

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Least and largest ρ; equal where it is prescribed."""
        low = self.with_passive(np.zeros(len(self.skin.owned_cells)))
        return low, np.where(self.designed, 1.0, low)

    def checked(self, x: Floats) -> Floats:
        """Return ρ as an array (collective)."""
        return check_density(self.skin, x)

    def with_passive(self, x: Floats) -> Floats:
        """Return ρ with the prescribed values put in."""
        return x if self.passive is None else np.where(self.designed, x, self.passive)

    def start(self, seed: int) -> Floats:
        """Return `centre`, or 0.5, with noise of 0.1 added (collective)."""
        drawn = random_density(self.skin, seed)
        if self.centre is None:
            return drawn
        return check_density(self.skin, self.centre[self.skin.owned_cells] + drawn - 0.5)

    def forward(self, x: Floats) -> tuple[Floats, Floats]:
        """Return ρ̃ and ρ̄ (collective)."""
        filtered = self.filter.forward(x)
        return filtered, self.with_passive(self.projection.forward(filtered))

    def backward(
        self, filtered: Floats, by_projected: Floats, by_filtered: Floats | None = None
    ) -> Floats:
        """Return the gradient by ρ from those by ρ̄ and ρ̃ (collective)."""
        both = self.projection.backward(filtered, by_projected * self.designed)
        if by_filtered is not None:
            both = both + by_filtered
        return np.asarray(self.filter.backward(both) * self.designed)

    def reinforcement(self, projected: Floats) -> tuple[float, float]:
        """Return the mean of ρ̄ and of 4 ρ̄ (1 − ρ̄) over the designed area (collective)."""
        fractions, comm = self.area_fractions(), self.skin.comm
        grey = 4 * projected * (1 - projected)
        return dot(comm, fractions, projected), dot(comm, fractions, grey)

    def shown(self, projected: Floats) -> Floats:
        """Return ρ̄."""
        return projected


def densities_of(fields: Fields) -> DensityFields:
    """Return fields that are densities."""
    assert isinstance(fields, DensityFields)
    return fields


@dataclass(frozen=True, eq=False)
class CarriedDesign:
    """A design on every rank, without the problem that it came from.

    Attributes:
        pattern: The pattern.
        density: ρ of all triangles, (t,); or all variables of each, (t, k).
        pressures: Pressure of each chamber in Pa; empty without any.
        positions: Positions of all vertices, (n, 3), in m; None starts from the assembled shape.
        poses: The same of further poses.
        projected: ρ̄ of all triangles, (t,), which another mesh starts from, so that its filter sees
            the lines of the print with sharp borders; None takes ρ there too.
        level: Number of the mesh that takes it over, from 0, for the rows of its history.
        history: Rows of the design so far; they come first in the history of the result.
        seconds: Wall time so far by phase.
        initial: The whole pattern and the density that the design began with, (t,), for pictures;
            None where it began with none.
    """

    pattern: Pattern
    density: Floats
    pressures: tuple[float, ...] = ()
    positions: Floats | None = None
    projected: Floats | None = None
    level: int = 0
    history: tuple[Iteration, ...] = ()
    seconds: Mapping[str, float] = field(default_factory=dict)
    initial: InitialDensity | None = None
    poses: tuple[Floats | None, ...] = ()

    def on(self, problem: DesignProblem) -> tuple[Floats, Any]:
        """Return the variables of this rank and a state to start from (collective).

        The problem is the same, on this mesh or on another one of the same panels.

        Raises:
            PanelError: Its panels are others.
        """
        here, there = self.pattern, problem.skin.pattern
        density, shapes = self.density, [self.positions, *self.poses]
        same = np.array_equal(here.flat_triangles, there.flat_triangles) and np.array_equal(
            here.flat_points, there.flat_points
        )
        if not same:
            transfer = make_transfer(here, there)
            density = transfer.at_cells(density if self.projected is None else self.projected)
            shapes = [None if shape is None else transfer.positions(shape) for shape in shapes]
        states = [
            None if shape is None else pose.physics.state_at(shape)
            for pose, shape in zip(problem.every, shapes, strict=False)
        ]
        start = tuple(states) if problem.poses else states[0]
        return density[problem.skin.owned_cells].ravel(), start


def initial_density(problem: DesignProblem, density: Floats) -> InitialDensity | None:
    """Return a density on the whole skin; None where the variables are none (collective)."""
    if not isinstance(problem.fields, DensityFields):
        return None
    cells = problem.skin.gather_cells(problem.fields.with_passive(density))
    return problem.whole.pattern, problem.whole.at_cells(cells)
