"""Stiffness profile of a tile: pulled along each direction at one strain, free across."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import itemgetter
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import together
from toros_fem.mechanics.skin.periodicity import UNIAXIAL
from toros_fem.products.tiles.solver import TileSolver, TileState

ALONG = np.array([[1.0, 0], [0, 0], [0, 0]])
ACROSS = np.array([[0.0, 0], [0, 1], [0, 0]])
# Of one profile, one value for each direction.
VALUES = ("stress", "tangent", "contraction", "shear")


@dataclass(frozen=True, eq=False)
class Profile:
    """Stress, stiffness and contraction of a tile pulled in several directions, at one strain.

    Attributes:
        angles: Directions, (k,), as angles in rad from the first axis of the flat sheet.
        strain: Strain λ − 1 along the direction; negative for compression.
        stress: Nominal stress along the direction in N/m, (k,): force over undeformed width.
        tangent: Tangent stiffness in N/m, (k,).
        contraction: Lateral contraction (1 − λ_across)/strain, (k,): Poisson's ratio at this
            strain.
        shear: Component along n of F̄t, (k,): inclination of lines across.
        state: States of the directions that this rank solved for; None elsewhere.
        gradients: d stress/dρ̄ and d contraction/dρ̄ of these, (2, cells) each; None elsewhere, or
            if they were not requested.
        steps, factorisations: Numbers of Newton steps and factorisations of all directions.
    """

    angles: Floats
    strain: float
    stress: Floats
    tangent: Floats
    contraction: Floats
    shear: Floats
    state: tuple[TileState | None, ...]
    gradients: tuple[Floats | None, ...]
    steps: int
    factorisations: int

    @property
    def stiffness(self) -> Floats:
        """Secant stiffness in N/m, (k,)."""
        return np.asarray(self.stress / self.strain)

    @property
    def pressure(self) -> float:
        """Pressure in Pa: 0, a tile has none."""
        return 0.0

    @property
    def pressures(self) -> tuple[float, ...]:
        """Pressures of chambers in Pa: empty, a tile has none."""
        return ()


class ProfileSolver:
    """Solver of a tile's profile; all methods are collective over tile and batch.

    The ranks of a communicator of their own share the directions, so that a tile too small to be
    distributed is solved in several directions at once; each rank then sews the whole tile. With a
    skin that is distributed over ranks, the batch must be a communicator of one rank.

    Args:
        tile: Solver of the tile, F̄n prescribed and F̄t free.
        angles: Directions in rad, (k,).
        strain: Strain λ − 1 along each.
        batch: Communicator whose ranks share the directions; None for one rank.

    Raises:
        ParameterError: There is no direction; the strain is 0, −1 or less, or not finite; other
            components of F̄ are prescribed; or both tile and directions are spread over ranks.
    """

    def __init__(
        self,
        tile: TileSolver,
        angles: Sequence[float] | Floats,
        strain: float,
        batch: MPI.Comm | None = None,
    ) -> None:
        self.tile, self.strain = tile, float(strain)
        self.angles = np.array(angles, dtype=np.float64)
        self.batch = MPI.COMM_SELF if batch is None else batch
        if self.angles.ndim != 1 or not len(self.angles) or not np.isfinite(self.angles).all():
            raise ParameterError(f"angles = {angles} must be at least one finite direction in rad.")
        if not np.isfinite(strain) or strain == 0 or strain <= -1:
            raise ParameterError(f"strain = {strain} must be finite, above -1, and not 0.")
        if not np.array_equal(tile.periodic.prescribed, UNIAXIAL):
            raise ParameterError(
                "a profile needs a sheet that is pulled along n and free across: make the tile's "
                "solver of Periodic(tile), with prescribed = UNIAXIAL."
            )
        if self.batch.size > 1 and tile.skin.comm.size > 1:
            raise ParameterError(
                f"the tile is spread over {tile.skin.comm.size} ranks and its directions over "
                f"{self.batch.size}: spread only one of them. For small tiles, sew the whole tile "
                "on each rank."
            )

    def solve(
        self,
        density: Floats,
        start: tuple[TileState | None, ...] | None = None,
        *,
        gradients: bool = True,
        allow_continuation: bool = True,
    ) -> Profile:
        """Return the profile of a density.

        Args:
            density: Projected density of the owned triangles, in [0, 1].
            start: `Profile.state` of a similar density.
            gradients: Whether to compute the gradients of stress and contraction by the density.
            allow_continuation: As for `TileSolver.solve`.

        Raises:
            DensityError: The density does not fit, or leaves [0, 1].
            NoEquilibriumError: There is no equilibrium in one of the directions.
        """

        def state(k: int) -> TileState:
            return self.tile.solve(
                density,
                float(self.angles[k]),
                (1 + self.strain) * ALONG,
                start=None if start is None else start[k],
                allow_continuation=allow_continuation,
            )

        return self._measured(state, gradients=gradients)

    def save(self, profile: Profile) -> tuple[Floats, dict[str, Any]]:
        """Return what `restore` needs: all unknowns of each direction, and counts."""
        mine = [
            (k, self.tile.model.patch.gather(state.state), [state.steps, state.factorisations])
            for k, state in enumerate(profile.state)
            if state is not None
        ]
        every = (one for part in self.batch.allgather(mine) for one in part)
        parts = sorted(every, key=itemgetter(0))
        return np.stack([one[1] for one in parts]), {"counts": [one[2] for one in parts]}

    def restore(self, density: Floats, unknowns: Floats, numbers: Mapping[str, Any]) -> Profile:
        """Return a saved profile as if it had just been solved for."""

        def state(k: int) -> TileState:
            steps, factorisations = numbers["counts"][k]
            return self.tile.restore(
                density, float(self.angles[k]), unknowns[k], counts=(steps, factorisations)
            )

        return self._measured(state, gradients=True)

    def _measured(self, find: Callable[[int], TileState], *, gradients: bool) -> Profile:
        """Return the profile of the states in all directions."""
        count, batch = len(self.angles), self.batch
        states: list[TileState | None] = [None] * count
        found: list[Floats | None] = [None] * count
        values = np.zeros((6, count))
        with together(batch):
            for k in range(batch.rank, count, batch.size):
                states[k] = state = find(k)
                values[:, k] = [
                    state.stress[0, 0],
                    self.tile.stiffness(state, ALONG[None])[0, 0],
                    (1 - state.gradient[1, 1]) / self.strain,
                    state.gradient[0, 1],
                    state.steps,
                    state.factorisations,
                ]
                if gradients:
                    by_stress = self.tile.stress_gradient(state, ALONG)
                    by_contraction = self.tile.strain_gradient(state, ACROSS)
                    found[k] = np.stack([by_stress, -by_contraction / self.strain])
        # Each column is non-zero on one rank only, so the sum is exact and equal on all ranks.
        values = np.asarray(batch.allreduce(values))
        return Profile(
            self.angles,
            self.strain,
            **dict(zip(VALUES, values, strict=False)),
            state=tuple(states),
            gradients=tuple(found),
            steps=int(values[4].sum()),
            factorisations=int(values[5].sum()),
        )

    def backward(self, profile: Profile, by_stress: Floats, by_contraction: Floats) -> Floats:
        """Return dT/dρ̄ at owned triangles, (cells,), by dT/d stress in m/N and dT/d contraction.

        The latter are (k,) each, or (j, k) for j functions at once, which gives (j, cells).
        """
        out: Floats = np.zeros((*by_stress.shape[:-1], len(self.tile.skin.owned_cells)))
        for k, gradients in enumerate(profile.gradients):
            if gradients is not None:
                out += np.multiply.outer(by_stress[..., k], gradients[0])
                out += np.multiply.outer(by_contraction[..., k], gradients[1])
        # One rank adds them up, so that all ranks get equal numbers, to the last digit.
        whole = self.batch.reduce(out)
        return np.asarray(self.batch.bcast(whole))


def profiles(
    tile: TileSolver,
    density: Floats,
    angles: Sequence[float] | Floats,
    strains: Sequence[float] | Floats,
    batch: MPI.Comm | None = None,
) -> list[Profile]:
    """Return the profiles at strains λ − 1, each solve started from the one before."""
    found: list[Profile] = []
    for strain in strains:
        near = found[-1].state if found else None
        solver = ProfileSolver(tile, angles, strain, batch)
        found.append(solver.solve(density, near, gradients=False))
    return found


def merge_profiles(one: Profile, other: Profile) -> Profile:
    """Return the union of two profiles of one tile and strain, sorted by direction."""
    order = np.argsort(np.concatenate([one.angles, other.angles]))
    both = {
        name: np.concatenate([getattr(one, name), getattr(other, name)])[order]
        for name in ("angles", *VALUES)
    }
    return replace(
        one,
        **both,
        state=tuple((*one.state, *other.state)[k] for k in order),
        gradients=tuple((*one.gradients, *other.gradients)[k] for k in order),
        steps=one.steps + other.steps,
        factorisations=one.factorisations + other.factorisations,
    )
