"""Designing a tile towards a directional response."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from toros_fem.chain import DesignChain, Evaluation, Pressure
from toros_fem.errors import ParameterError
from toros_fem.filters import Filter
from toros_fem.length_scale import LengthScaleConstraints
from toros_fem.meshes.mirror import Mirrored
from toros_fem.meshes.skin import Skin
from toros_fem.perimeter import Perimeter
from toros_fem.profile import Profile, ProfileSolver
from toros_fem.profile_objective import ProfileObjective
from toros_fem.projection import Projection

Floats = npt.NDArray[np.float64]


class SymmetricFilter:
    """A filter of the mean over a design's images: whatever the density, ρ̃ is symmetric.

    Args:
        skin: The tile's sewn skin.
        inner: The filter itself; it commutes with the symmetry.
        images: Triangle that each triangle goes to by each operation of the group, (g, t), of
            `Tile.images`.
    """

    def __init__(self, skin: Skin, inner: Filter, images: npt.NDArray[np.int64]) -> None:
        self.name, self.radius = inner.name, inner.radius
        self._skin, self._inner, self._images = skin, inner, images

    def mean(self, density: Floats) -> Floats:
        """Mean over the images of values at owned triangles (collective)."""
        whole = self._skin.gather_cells(density)
        return np.asarray(whole[self._images].mean(axis=0)[self._skin.owned_cells])

    # The group holds each operation's inverse, so that the mean is its own transpose.

    def forward(self, density: Floats) -> Floats:
        """ρ̃ at owned triangles from ρ there (collective)."""
        return self._inner.forward(self.mean(density))

    def backward(self, gradient: Floats) -> Floats:
        """∂T/∂ρ from ∂T/∂ρ̃, owned values (collective)."""
        return self.mean(self._inner.backward(gradient))

    def slope(self, density: Floats) -> Floats:
        """∇ρ̃ at the centroids of owned triangles, (2, k), in 1/m (collective)."""
        return self._inner.slope(self.mean(density))

    def slope_backward(self, gradient: Floats) -> Floats:
        """∂T/∂ρ from ∂T/∂∇ρ̃, (2, k), owned values (collective)."""
        return self.mean(self._inner.slope_backward(gradient))

    def at_points(self, density: Floats) -> Floats:
        """ρ̃ at all flat points of the pattern, (m,), on every rank (collective)."""
        return self._inner.at_points(self.mean(density))


@dataclass(eq=False)
class TileProblem(DesignChain[Profile]):
    """A tile and the profile that is wanted of it; see `DesignChain` for what is not said here.

    Attributes:
        solver: Pulls the tile in the directions that count.
        objective: What is wanted of the profile.
        filter: Filter of the densities on the torus; a `SymmetricFilter` for symmetric designs.
    """

    solver: ProfileSolver
    objective: ProfileObjective
    filter: Filter
    projection: Projection = field(default_factory=Projection)
    passive: Floats | None = None
    perimeter: Perimeter | None = None
    weight: float = 0.0
    length_scale: LengthScaleConstraints | None = None
    whole: Mirrored | None = None

    def __post_init__(self) -> None:
        if self.whole is not None:
            raise ParameterError("a tile is whole: its symmetry belongs to the filter.")
        self.check()

    @property
    def skin(self) -> Skin:
        """The tile's."""
        return self.solver.tile.skin

    @property
    def comm(self) -> MPI.Comm:
        """The batch's ranks, if directions are spread, or else the tile's."""
        batch = self.solver.batch
        return batch if batch.size > 1 else self.skin.comm

    def with_projection(self, projection: Projection) -> TileProblem:
        """The same with another projection."""
        return replace(self, projection=projection)

    def respond(
        self, projected: Floats, start: Any, pressure: Pressure | None, *, patient: bool
    ) -> tuple[Profile, float]:
        """The profile, with its gradients, and what it is worth (collective)."""
        profile = self.solver.solve(projected, start, patient=patient)
        return profile, self.objective.forward(profile)

    def respond_backward(self, evaluation: Evaluation[Profile]) -> tuple[Floats, None]:
        """From what `respond` has kept of each direction (collective)."""
        profile = evaluation.equilibrium
        by_stress, by_contraction = self.objective.backward(profile)
        return self.solver.backward(profile, by_stress, by_contraction), None

    def residuals(self, response: Profile) -> Floats:
        """Those of the objective."""
        return self.objective.residuals(response)

    def residuals_backward(self, evaluation: Evaluation[Profile]) -> Floats:
        """From what `respond` has kept of each direction (collective)."""
        profile = evaluation.equilibrium
        return self.solver.backward(profile, *self.objective.residuals_backward(profile))
