"""Stiffness profile of a tile, pulled along each direction and free across, and its objectives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import dot, together
from toros_fem.base.validation import Bools, Floats
from toros_fem.design.loop.physics import Pressure, Residuals, Saved
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.iteration import NewtonStep
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.mechanics.terms.periodic import Periodic
from toros_fem.meshes.skin import Skin

ALONG = np.array([[1.0, 0], [0, 0], [0, 0]])
ACROSS = np.array([[0.0, 0], [0, 1], [0, 0]])


def tile_solver(
    skin: Skin,
    composite: Composite,
    periodic: Periodic,
    log: Callable[[NewtonStep | str], None] | None = None,
    quadratic: Bools | None = None,
) -> EquilibriumSolver:
    """Return the solver of a tile, whose loads are mean deformations (collective).

    One fixed vertex and the prescribed components of F̄ exclude rigid motions. A sheet that stays
    in its plane does not bend.

    Raises:
        ParameterError: The sheet may leave its plane and does not resist bending, or its rest shape
            or seams do not fit a tile.
    """
    bending = composite.bending
    if periodic.flat:
        composite = replace(composite, bending=None, print_side=None)
    elif bending is None or bending.rest != "flat" or bending.seams != "continuous":
        raise ParameterError(
            "a tile that may leave its plane must resist bending, with rest = 'flat' and "
            "seams = 'continuous', since its borders are not seams. Or set flat = True to keep "
            "it in its plane."
        )
    fixed = np.zeros((len(skin.pattern.points), 3), dtype=bool)
    fixed[:, 2], fixed[0] = periodic.flat, True
    return EquilibriumSolver(
        skin, composite, Supports(fixed), log=log, periodic=periodic, quadratic=quadratic
    )


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
        states: States of the directions that this rank solved for; None elsewhere.
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
    states: tuple[Equilibrium | None, ...]
    gradients: tuple[Floats | None, ...]
    steps: int
    factorisations: int

    pressures = ()

    @property
    def stiffness(self) -> Floats:
        """Secant stiffness in N/m, (k,)."""
        return np.asarray(self.stress / self.strain)

    @property
    def state(self) -> Profile:
        """What the profile of a similar density starts from: this one."""
        return self


class ProfileSolver:
    """Solver of a tile's profile, and the physics of its design; nothing is inflated.

    The ranks of a communicator of their own share the directions, so that a tile too small to be
    distributed is solved in several directions at once; each rank then sews the whole tile. With a
    skin that is distributed over ranks, the batch must be a communicator of one rank. All methods
    are collective over tile and batch.

    Args:
        tile: Solver of the tile, by `tile_solver`, F̄n prescribed and F̄t free.
        angles: Directions in rad, (k,).
        strain: Strain λ − 1 along each.
        batch: Communicator whose ranks share the directions; None for one rank.

    Raises:
        ParameterError: The strain is 0, −1 or less, or not finite.
    """

    pressures = ()
    pressure_ranges = ()

    def __init__(
        self,
        tile: EquilibriumSolver,
        angles: Sequence[float] | Floats,
        strain: float,
        batch: MPI.Comm | None = None,
    ) -> None:
        self.tile, self.strain = tile, float(strain)
        self.angles = np.array(angles, dtype=np.float64)
        self.batch = MPI.COMM_SELF if batch is None else batch
        if not np.isfinite(strain) or strain == 0 or strain <= -1:
            raise ParameterError(f"strain = {strain} must be finite, above -1, and not 0.")
        assert tile.model.images is not None
        self.images = tile.model.images

    @property
    def comm(self) -> MPI.Comm:
        """Communicator that the directions are spread over, or else the tile's."""
        return self.batch if self.batch.size > 1 else self.tile.skin.comm

    def solve(
        self,
        density: Floats,
        start: Profile | None = None,
        *,
        gradients: bool = True,
        once: bool = False,
    ) -> Profile:
        """Return the profile of a density.

        Args:
            density: Projected density of the owned triangles, in [0, 1].
            start: Profile of a similar density or strain in the same directions.
            gradients: Whether to compute the gradients of stress and contraction by the density.
            once: As for `EquilibriumSolver.solve`.

        Raises:
            ParameterError: The density does not fit, or leaves [0, 1].
            NoEquilibriumError: There is no equilibrium in one of the directions.
        """

        def state(k: int) -> Equilibrium:
            begin = None if start is None else start.states[k]
            near = None if begin is None else begin.state
            return self.tile.solve(density, self._load(k), near, once=once)

        return self._measured(state, gradients=gradients)

    def _load(self, k: int) -> Load:
        return Load(gradient=(1 + self.strain) * ALONG, angle=float(self.angles[k]))

    def respond(
        self, projected: Floats, start: Profile | None, pressure: Pressure | None, *, trial: bool
    ) -> Profile:
        """Return the profile and its gradients."""
        return self.solve(projected, start, once=trial)

    def finish(self, response: Profile) -> Profile:
        """Return the profile as it is: trials are solved to the same tolerance."""
        return response

    def observed(self, response: Profile) -> Profile:
        """Return the profile."""
        return response

    def pull_back(
        self, response: Profile, by_observed: tuple[Floats, Floats]
    ) -> tuple[Floats, None]:
        """Return dT/dρ̄ at owned triangles, (cells,), by dT/d stress and dT/d contraction.

        The latter are (k,) each, or (j, k) for j functions at once, which gives (j, cells).
        """
        by_stress, by_contraction = by_observed
        out: Floats = np.zeros((*by_stress.shape[:-1], len(self.tile.skin.owned_cells)))
        for k, gradients in enumerate(response.gradients):
            if gradients is not None:
                out += np.multiply.outer(by_stress[..., k], gradients[0])
                out += np.multiply.outer(by_contraction[..., k], gradients[1])
        # One rank adds them up, so that all ranks get equal numbers, to the last digit.
        return np.asarray(self.batch.bcast(self.batch.reduce(out))), None

    def residuals(self, response: Profile, objective: ProfileObjective) -> Residuals:
        """Return the objective's residuals and their gradients."""
        _, by_stress, by_contraction = objective.residuals(response)
        rows, _ = self.pull_back(response, (by_stress, by_contraction))
        return Residuals(lambda near: objective.residuals(near)[0], rows, np.zeros((len(rows), 0)))

    def save(self, response: Profile) -> Saved:
        """Return what `restore` needs: all unknowns of each direction, and numbers."""
        mine = {
            k: self.tile.save(state) for k, state in enumerate(response.states) if state is not None
        }
        every = {k: one for part in self.batch.allgather(mine) for k, one in part.items()}
        unknowns, numbers = zip(*(every[k] for k in sorted(every)), strict=True)
        return np.stack(unknowns), {"directions": list(numbers)}

    def restore(self, projected: Floats, unknowns: Floats, numbers: Mapping[str, Any]) -> Profile:
        """Return a saved profile as if it had just been solved for."""

        def state(k: int) -> Equilibrium:
            saved = numbers["directions"][k]
            return self.tile.restore(projected, unknowns[k], saved, self._load(k))

        return self._measured(state, gradients=True)

    def shape_of(self, response: Profile) -> None:
        """Return None: a finer mesh starts from the flat tile."""

    def state_at(self, positions: Floats) -> None:
        """Return None, for the flat tile."""

    def _measured(self, find: Callable[[int], Equilibrium], *, gradients: bool) -> Profile:
        """Return the profile of the states in all directions."""
        count, batch = len(self.angles), self.batch
        states: list[Equilibrium | None] = [None] * count
        found: list[Floats | None] = [None] * count
        values = np.zeros((6, count))
        with together(batch):
            for k in range(batch.rank, count, batch.size):
                states[k] = at = find(k)
                values[:, k], found[k] = self._measure(at, gradients=gradients)
        # Each column is non-zero on one rank only, so the sum is exact and equal on all ranks.
        stress, tangent, contraction, shear, steps, factorisations = batch.allreduce(values)
        return Profile(
            self.angles,
            self.strain,
            stress,
            tangent,
            contraction,
            shear,
            states=tuple(states),
            gradients=tuple(found),
            steps=int(steps.sum()),
            factorisations=int(factorisations.sum()),
        )

    def _measure(self, at: Equilibrium, *, gradients: bool) -> tuple[list[float], Floats | None]:
        """Return the numbers of a direction and their gradients by the density."""
        model, images = self.tile.model, self.images
        area, length = float(self.tile.skin.pattern.areas.sum()), images.periodic.length
        force, motion = self.tile.stretch(at, ALONG)
        mean = images.mean_gradient(at.state)
        values = [
            images.mean_force(model.variation(at.state))[0, 0] / area,
            dot(self.tile.skin.comm, force, motion) / area,
            (1 - mean[1, 1]) / self.strain,
            mean[0, 1],
            at.steps,
            at.factorisations,
        ]
        if not gradients:
            return values, None
        # The derivative of the state by F̄n is the adjoint of the stress: no further solve.
        by_stress = model.density_sensitivity(at.state, motion) / area
        across = np.zeros_like(at.state)
        images.set_mean_gradient(across, ACROSS / length)
        adjoint = self.tile.solve_tangent(across, at)
        by_contraction = model.density_sensitivity(at.state, adjoint) / (length * self.strain)
        return values, np.stack([by_stress, by_contraction])


def profiles(
    tile: EquilibriumSolver,
    density: Floats,
    angles: Sequence[float] | Floats,
    strains: Sequence[float] | Floats,
    batch: MPI.Comm | None = None,
) -> list[Profile]:
    """Return the profiles at strains λ − 1, each solve started from the one before."""
    found: list[Profile] = []
    for strain in strains:
        solver = ProfileSolver(tile, angles, strain, batch)
        found.append(solver.solve(density, found[-1] if found else None, gradients=False))
    return found


@dataclass(frozen=True, eq=False)
class ProfileTarget:
    """Least squares T = [Σ (s/s* − 1)² + Σ (c − c*)²/c*²] / k over k directions.

    s is the secant stiffness and c the lateral contraction. What has the target NaN does not count.
    A contraction whose target is 0 counts by itself, as in the verdict.

    Attributes:
        stiffness: Targets s* in N/m, (k,); None for none.
        contraction: Targets c*, (k,); None for none.
    """

    stiffness: Floats | None = None
    contraction: Floats | None = None

    def forward(self, profile: Profile) -> float:
        """Return T."""
        return float(np.sum(self.residuals(profile)[0] ** 2))

    def backward(self, profile: Profile) -> tuple[Floats, Floats]:
        """Return dT/d stress in m/N and dT/d contraction, (k,) each."""
        found, by_stress, by_contraction = self.residuals(profile)
        return 2 * found @ by_stress, 2 * found @ by_contraction

    def residuals(self, profile: Profile) -> tuple[Floats, Floats, Floats]:
        """Return numbers r, (j,), with T = Σ r², and derivatives as of `backward`, (j, k) each.

        Those of stiffness are first.
        """
        goals, sizes, deviations = self._compared(profile)
        known, root = ~np.isnan(goals), np.sqrt(1 / len(profile.angles))
        slopes = 1 / (sizes * [[profile.strain], [1.0]])
        rows = np.diag((root * slopes).ravel())[known.ravel()]
        by_stress, by_contraction = np.split(rows, 2, axis=1)
        return (root * deviations)[known], by_stress, by_contraction

    def largest_deviation(self, profile: Profile) -> float:
        """Return the largest |s/s* − 1| or |c/c* − 1|."""
        return float(np.nanmax(np.abs(self._compared(profile)[2])))

    def _compared(self, profile: Profile) -> tuple[Floats, Floats, Floats]:
        """Return targets, what counts as 1, and deviations over that, (2, k); NaN for no target."""
        none = np.full(len(profile.angles), np.nan)
        goals = np.stack([none if a is None else a for a in (self.stiffness, self.contraction)])
        sizes = np.where(goals == 0, 1.0, np.abs(goals))
        return goals, sizes, (np.stack([profile.stiffness, profile.contraction]) - goals) / sizes


@dataclass(frozen=True, eq=False)
class Contrast:
    """Ratio T of the mean stiffness of some directions to that of others, to be minimised.

    Attributes:
        soft: Directions of the numerator, (k,).
        stiff: Directions of the denominator, (k,).
    """

    soft: Bools
    stiff: Bools

    def forward(self, profile: Profile) -> float:
        """Return T."""
        return float(profile.stress[self.soft].mean() / profile.stress[self.stiff].mean())

    def backward(self, profile: Profile) -> tuple[Floats, Floats]:
        """Return dT/d stress in m/N and dT/d contraction, (k,) each."""
        by: Floats = np.where(self.soft, 1.0 / self.soft.sum(), 0.0)
        by -= np.where(self.stiff, self.forward(profile) / self.stiff.sum(), 0.0)
        by /= profile.stress[self.stiff].mean()
        return by, np.zeros_like(by)

    def residuals(self, profile: Profile) -> tuple[Floats, Floats, Floats]:
        """Return none, as of `ProfileTarget`: T is not a sum of squares."""
        none = np.zeros((0, len(profile.angles)))
        return np.zeros(0), none, none


ProfileObjective = ProfileTarget | Contrast
