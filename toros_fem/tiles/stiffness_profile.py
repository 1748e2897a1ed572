"""How stiff a tile is in each direction: pulled along it at a given strain, free across."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from toros_fem._mpi import raise_together
from toros_fem._types import Floats
from toros_fem.errors import ParameterError
from toros_fem.mechanics.periodicity import UNIAXIAL
from toros_fem.tiles.solver import TileSolver, TileState

ALONG = np.array([[1.0, 0], [0, 0], [0, 0]])
ACROSS = np.array([[0.0, 0], [0, 1], [0, 0]])


@dataclass(frozen=True, eq=False)
class Profile:
    """The response of a tile pulled in several directions, at one strain.

    Attributes:
        angles: Directions, (k,), in rad to the first axis of the flat sheet.
        strain: Along the direction, λ − 1; negative for compression.
        stress: Nominal stress along it in N/m, (k,): force over undeformed width.
        stiffness: Secant stiffness stress/strain in N/m, (k,).
        tangent: Tangent stiffness in N/m, (k,).
        contraction: Lateral contraction (1 − λ_across)/strain, (k,): Poisson's ratio at this
            strain.
        shear: How far lines across lean over, the component along n of F̄t, (k,).
        state: States of those directions that this rank solved for; None elsewhere.
        gradients: d stress/dρ̄ and d contraction/dρ̄ of these, (2, cells) each; None elsewhere, or
            if they were not asked for.
        steps, factorisations: Of all directions together.
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
        """Nothing presses on a tile."""
        return 0.0

    @property
    def pressures(self) -> tuple[float, ...]:
        """None."""
        return ()


class ProfileSolver:
    """Pulls a tile in several directions.

    Directions are spread over the ranks of a communicator of their own, so that a tile too small
    to be worth parting is solved for in several directions at once: then its skin belongs to each
    rank alone. With a skin parted over ranks, the batch is a communicator of one.

    Attributes:
        tile: The tile's solver, F̄n held and F̄t free.
        angles: Directions in rad, (k,).
        strain: Along them.

    Args:
        tile: The solver.
        angles: Directions in rad, (k,).
        strain: λ − 1 along each.
        batch: Communicator whose ranks share the directions; None for one rank.

    Raises:
        ParameterError: There is no direction, or the strain is 0 or not finite; or other parts of
            F̄ are held; or both tile and directions are spread over ranks.
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
            raise ParameterError(f"strain = {strain} must be finite, over -1, and not 0.")
        if not np.array_equal(tile.periodic.prescribed, UNIAXIAL):
            raise ParameterError(
                "profiles are of sheets pulled along n and free across: make the tile's solver of "
                "Periodic(tile), with held = UNIAXIAL."
            )
        if self.batch.size > 1 and tile.skin.comm.size > 1:
            raise ParameterError(
                f"the tile is spread over {tile.skin.comm.size} ranks and its directions over "
                f"{self.batch.size}: spread one of them. Small tiles are best sewn on each rank."
            )

    def solve(
        self,
        density: Floats,
        start: tuple[TileState | None, ...] | None = None,
        *,
        gradients: bool = True,
        allow_continuation: bool = True,
    ) -> Profile:
        """The profile of a density (collective over tile and batch).

        Args:
            density: Projected density of the owned triangles, in [0, 1].
            start: `Profile.state` of a density near by.
            gradients: Whether to compute how stress and contraction change with the density.
            patient: As for `TileSolver.solve`.

        Raises:
            DensityError: The density does not fit, or leaves [0, 1].
            NoEquilibriumError: There is no equilibrium in one of the directions.
        """
        count, batch = len(self.angles), self.batch
        states: list[TileState | None] = [None] * count
        found: list[Floats | None] = [None] * count
        values = np.zeros((count, 6))
        error: Exception | None = None
        wanted = (1 + self.strain) * ALONG
        for k in range(batch.rank, count, batch.size):
            try:
                near = None if start is None else start[k]
                state = self.tile.solve(
                    density,
                    float(self.angles[k]),
                    wanted,
                    start=near,
                    allow_continuation=allow_continuation,
                )
                states[k] = state
                values[k] = [
                    state.stress[0, 0],
                    self.tile.stiffness(state, ALONG[None])[0, 0],
                    (1 - state.gradient[1, 1]) / self.strain,
                    state.gradient[0, 1],
                    state.steps,
                    state.factorisations,
                ]
                if gradients:
                    by_stress = self.tile.stress_gradient(state, ALONG)
                    by_width = self.tile.strain_gradient(state, ACROSS)
                    found[k] = np.stack([by_stress, -by_width / self.strain])
            except Exception as caught:  # whatever it is, the others wait at the end
                error = caught
                break
        raise_together(batch, error)
        # Each row is one rank's, so that the sum is exact and the same everywhere.
        values = np.asarray(batch.allreduce(values))
        return Profile(
            angles=self.angles,
            strain=self.strain,
            stress=values[:, 0],
            tangent=values[:, 1],
            contraction=values[:, 2],
            shear=values[:, 3],
            state=tuple(states),
            gradients=tuple(found),
            steps=int(values[:, 4].sum()),
            factorisations=int(values[:, 5].sum()),
        )

    def backward(self, profile: Profile, by_stress: Floats, by_contraction: Floats) -> Floats:
        """dT/dρ̄ at owned triangles from dT/d stress and dT/d contraction (collective).

        Args:
            profile: With its gradients.
            by_stress: dT/d stress in m/N, (k,), or (j, k) for j functions at once.
            by_contraction: dT/d contraction, of the same shape.

        Returns:
            (cells,) or (j, cells).
        """
        out: Floats = np.zeros((*by_stress.shape[:-1], len(self.tile.skin.owned_cells)))
        for k, gradients in enumerate(profile.gradients):
            if gradients is not None:
                out += np.multiply.outer(by_stress[..., k], gradients[0])
                out += np.multiply.outer(by_contraction[..., k], gradients[1])
        # Summed in one place: all ranks are to step alike, to the last digit.
        whole = self.batch.reduce(out)
        return np.asarray(self.batch.bcast(whole))


def profiles(
    tile: TileSolver,
    density: Floats,
    angles: Sequence[float] | Floats,
    strains: Sequence[float] | Floats,
    batch: MPI.Comm | None = None,
) -> list[Profile]:
    """The profiles at strains one after the other: stress over strain in each direction.

    Args:
        tile: The solver.
        density: Projected density of the owned triangles, in [0, 1].
        angles: Directions in rad, (k,).
        strains: λ − 1, each reached from the one before.
        batch: As for `ProfileSolver`.

    Raises:
        ParameterError: A direction or a strain is not admissible.
        DensityError: The density does not fit, or leaves [0, 1].
        NoEquilibriumError: There is no equilibrium at one of the strains.
    """
    found: list[Profile] = []
    for strain in strains:
        near = found[-1].state if found else None
        solver = ProfileSolver(tile, angles, strain, batch)
        found.append(solver.solve(density, near, gradients=False))
    return found


def merge_profiles(one: Profile, other: Profile) -> Profile:
    """Profiles of one tile at one strain in different directions, sorted by these."""
    order = np.argsort(np.concatenate([one.angles, other.angles]))

    def both(name: str) -> Floats:
        return np.asarray(np.concatenate([getattr(one, name), getattr(other, name)])[order])

    return Profile(
        angles=both("angles"),
        strain=one.strain,
        stress=both("stress"),
        tangent=both("tangent"),
        contraction=both("contraction"),
        shear=both("shear"),
        state=tuple((*one.state, *other.state)[k] for k in order),
        gradients=tuple((*one.gradients, *other.gradients)[k] for k in order),
        steps=one.steps + other.steps,
        factorisations=one.factorisations + other.factorisations,
    )


def effective_tensor(solver: TileSolver, density: Floats) -> Floats:
    """Stiffness of the undeformed tile, by one factorisation (collective).

    Args:
        solver: A tile's solver with all of F̄ held, `lattice.ALL_PRESCRIBED`.
        density: Projected density of the owned triangles.

    Returns:
        Membrane stiffness in N/m, (3, 3), of strains (xx, yy, 2xy).

    Raises:
        ParameterError: Some of F̄ is free.
    """
    if not np.array(solver.periodic.prescribed).all():
        raise ParameterError("the effective tensor needs a tile whose F̄ is held: Periodic(GIVEN).")
    state = solver.solve(density, 0.0, np.eye(3)[:, :2])
    changes = np.zeros((3, 3, 2))
    changes[0, 0, 0] = changes[1, 1, 1] = 1.0
    changes[2, 0, 1] = changes[2, 1, 0] = 0.5
    return solver.stiffness(state, changes)
