"""Equilibrium of a tile that repeats, at a given mean deformation; its mean stress."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from toros_fem._mpi import dot
from toros_fem._types import Floats
from toros_fem.density.field import check_density
from toros_fem.equilibrium.continuation import Attempt, ContinuationResult, run_continuation
from toros_fem.equilibrium.newton import NewtonStep
from toros_fem.equilibrium.options import NewtonOptions
from toros_fem.equilibrium.snes import Attempts, SnesSolver
from toros_fem.errors import NoEquilibriumError, ParameterError
from toros_fem.materials import Composite
from toros_fem.mechanics.periodicity import Periodic, PeriodicModel
from toros_fem.mechanics.supports import Supports
from toros_fem.meshes.skin import Skin

# First step of a continuation and its smallest one, as shares of the way.
FIRST_SHARE = 1 / 4
LEAST_SHARE = 1e-3


@dataclass(frozen=True, eq=False)
class TileState:
    """A tile in equilibrium at a mean deformation.

    Attributes:
        angle: Of direction n to the first axis of the flat sheet, in rad.
        gradient: Mean deformation gradient F̄, (3, 2): rows along n, t, z, columns of n, t.
        stress: Mean first Piola-Kirchhoff stress in N/m, (3, 2), the derivative of `energy` by F̄;
            zero where F̄ was free.
        energy: Mean energy per flat area in J/m².
        state: Owned unknowns, as `SkinModel` has them, in the axes n, t, z.
        positions: Positions of the owned nodes in m, (k, 3), a view of `state`.
        stretch_use: Largest share of the stretch bounds that a triangle uses, < 1.
        steps: Newton steps, each with a factorisation of its own.
        factorisations: Factorisations, retries with a shift included.
    """

    angle: float
    gradient: Floats
    stress: Floats
    energy: float
    state: Floats
    positions: Floats
    stretch_use: float
    steps: int
    factorisations: int


class TileSolver:
    """Finds equilibria of a tile, and how they change with the mean deformation and the density.

    x = F̄ x̄ + w with w periodic; rigid motion is removed by holding one vertex and by what is held
    of F̄. Positions and F̄ are in axes n, t, z, that is turned by the direction's angle.

    Attributes:
        model: Energy and derivatives.
        area: Flat area of the tile in m².

    Args:
        skin: The tile's sewn skin.
        composite: Materials and stretch bounds. A sheet that stays in its plane does not bend.
        periodic: The tile and what is held of it.
        options: How hard to try.
        log: Called with every row of a solve's history.

    Raises:
        ParameterError: The sheet bends, and its rest shape or its seams are not those of a tile.
    """

    def __init__(
        self,
        skin: Skin,
        composite: Composite,
        periodic: Periodic,
        options: NewtonOptions | None = None,
        log: Callable[[NewtonStep], None] | None = None,
    ) -> None:
        bending = composite.bending
        if periodic.flat:
            composite = replace(composite, bending=None)
        elif bending is None or bending.rest != "flat" or bending.seams != "continuous":
            raise ParameterError(
                "a tile that may leave its plane must resist bending, with rest = 'flat' and "
                "seams = 'continuous': its borders are no seams. Or keep it in its plane by "
                "flat = True."
            )
        fixed = np.zeros((len(skin.pattern.points), 3), dtype=bool)
        fixed[:, 2] = periodic.flat
        fixed[0] = True
        self.skin, self.periodic = skin, periodic
        self.options = options or NewtonOptions()
        self.model = PeriodicModel(skin, composite, Supports(fixed), periodic)
        self._snes = SnesSolver(self.model, self.options, log)
        periodic_tangent = self._snes.factor.periodic
        assert periodic_tangent is not None
        self._periodic_tangent, self._turn = periodic_tangent, self.model.images.turn
        self._prescribed = np.array(periodic.prescribed)
        self.area = float(skin.pattern.areas.sum())
        self._place = skin.pattern.points[skin.owned_vertices, :2]
        pairs = self.model.tangent_layout[1].shape[1]
        self._entries: Floats = np.zeros(len(skin.cell) * pairs * (pairs + 1) // 2)
        self._last: TileState | None = None
        self._answers: dict[bytes, tuple[Floats, Floats]] = {}

    def solve(
        self,
        density: Floats,
        angle: float,
        gradient: Floats,
        *,
        start: TileState | None = None,
        allow_continuation: bool = True,
    ) -> TileState:
        """The stable equilibrium at a mean deformation (collective).

        Args:
            density: Projected density of the owned triangles, in [0, 1].
            angle: Of direction n to the first axis of the flat sheet, in rad.
            gradient: F̄, (3, 2), read where it is held.
            start: A state near by, of another density or mean deformation, at the same angle;
                None starts from the sheet stretched as a whole.
            patient: Whether to go there in steps from the flat sheet where it fails at once.

        Raises:
            ParameterError: The gradient does not fit, or `start` has another angle.
            DensityError: The density does not fit, or leaves [0, 1].
            NoEquilibriumError: There is no equilibrium.
        """
        check_density(self.skin, density)
        given = np.asarray(gradient, dtype=np.float64)
        fits = given.shape == (3, 2) and np.isfinite(given[self._prescribed]).all()
        if not (fits and np.isfinite(angle)):
            raise ParameterError(
                f"gradient = {gradient} at angle = {angle} must be (3, 2) and finite where held."
            )
        wanted = np.where(self._prescribed, given, 0.0)
        if start is not None and start.angle != angle:
            raise ParameterError(
                f"the start is that of direction {start.angle:g} rad, not of {angle:g}: start from "
                "a state of the same direction, or from none."
            )
        self._forget()
        self._turn(angle)
        self.model.set_density(density)
        attempts = Attempts(self._snes)
        begin, state = np.eye(3)[:, :2], self._assembled(angle)
        if start is not None:
            begin, state = start.gradient, start.state
        change = np.where(self._prescribed, wanted - begin, 0.0)

        def attempt(x: Floats, fraction: float) -> Attempt:
            there = self.model.mean_gradient(x)
            rest = np.where(self._prescribed, begin + fraction * change - there, 0.0)
            return attempts(self._stretched(x, angle, rest))

        first = attempt(state, 1.0)
        found, outcome = first.state, first.outcome
        if outcome <= 0 and allow_continuation:
            begin, state = np.eye(3)[:, :2], self._assembled(angle)
            change = np.where(self._prescribed, wanted - begin, 0.0)
            done = run_continuation(
                attempt, ContinuationResult(state, 0.0, 1), 1.0, FIRST_SHARE, LEAST_SHARE
            )
            found, outcome = done.state, done.outcome if done.load_factor == 1.0 else -1
        if outcome <= 0:
            raise NoEquilibriumError(
                f"the tile has no equilibrium at the mean deformation {wanted[:2].tolist()} along "
                f"{np.degrees(angle):.4g} degrees inside the stretch bounds c1 = "
                f"{self.model.composite.c1:g}, c2 = {self.model.composite.c2:g}. Stretch it less, "
                "soften the print, or refine the mesh."
            )
        self._last = self._result(found, angle, attempts)
        return self._last

    def response(self, at: TileState, change: Floats) -> Floats:
        """How the state changes with F̄, per unit: dq/dF̄ : change (collective).

        Args:
            at: The last equilibrium that was found: its tangent is factorised.
            change: Of the held components of F̄, (3, 2).

        Raises:
            ParameterError: The solver has been used since.
        """
        return self._answer(at, change)[1]

    def stiffness(self, at: TileState, changes: Floats) -> Floats:
        """Second derivative of the mean energy by held F̄, (k, k), in N/m (collective).

        Args:
            at: As for `response`.
            changes: Directions in F̄, (k, 3, 2).
        """
        comm, answers = self.skin.comm, [self._answer(at, change) for change in changes]
        return np.array([[dot(comm, f, m) / self.area for _, m in answers] for f, _ in answers])

    def stress_gradient(self, at: TileState, change: Floats) -> Floats:
        """d(P̄ : change)/dρ̄ at owned triangles, in N/m, F̄ kept where held (collective)."""
        sensitivity = self.model.density_sensitivity(at.state, self.response(at, change))
        return np.asarray(sensitivity / self.area)

    def strain_gradient(self, at: TileState, part: Floats) -> Floats:
        """d(F̄ : part)/dρ̄ at owned triangles, `part` among the free components (collective)."""
        self._require_last(at)
        rhs: Floats = np.zeros_like(at.state)
        self.model.set_mean_gradient(rhs, np.asarray(part / self.periodic.length))
        adjoint = self._snes.factor.solve(rhs * self.model.free)
        sensitivity = self.model.density_sensitivity(at.state, adjoint)
        return np.asarray(-sensitivity / self.periodic.length)

    def stable(self, state: Floats, density: Floats, angle: float) -> bool:
        """Whether a state is a stable equilibrium, if it is one (collective)."""
        self._forget()
        self._turn(angle)
        self.model.set_density(density)
        return self._snes.newton.stable(state)

    def buckles(self, flat: TileState, density: Floats) -> bool:
        """Whether an equilibrium of the sheet kept flat is unstable once it may leave its plane.

        Args:
            flat: Found by the solver of the same skin with `flat` = True.
            density: Projected density of the owned triangles, as it was there.

        Raises:
            ParameterError: This solver keeps the sheet in its plane itself.
        """
        if self.periodic.flat:
            raise ParameterError(
                "whether a tile buckles is told by a solver that lets it: Periodic(flat=False), "
                "and materials that bend."
            )
        state: Floats = np.zeros(self.model.size_local)
        self.model.positions(state)[:] = flat.positions
        self.model.set_mean_gradient(state, flat.gradient)
        return not self.stable(state, density, flat.angle)

    def flat_places(self, angle: float) -> Floats:
        """Places of the owned nodes in the flat sheet in axes n, t, in m, (k, 2)."""
        c, s = np.cos(angle), np.sin(angle)
        return self._place @ np.array([[c, -s], [s, c]])

    def _assembled(self, angle: float) -> Floats:
        state = self.model.assembled
        self.model.positions(state)[:, :2] = self.flat_places(angle)
        return state

    def _stretched(self, state: Floats, angle: float, change: Floats) -> Floats:
        """A state with a homogeneous deformation added."""
        out, added = state.copy(), np.zeros_like(state)
        self.model.positions(added)[:] = self.flat_places(angle) @ change.T
        self.model.set_mean_gradient(added, change)
        # The held vertex keeps its place, and so does the sheet.
        fixed = self.model.skin.owned_vertices == 0
        shift = self.model.positions(added)[fixed].sum(axis=0)
        self.model.positions(added)[:] -= self.skin.comm.allreduce(shift)
        return out + added

    def _answer(self, at: TileState, change: Floats) -> tuple[Floats, Floats]:
        """Change of the force by held F̄, all else kept, and that of the state; kept for reuse."""
        self._require_last(at)
        wanted = np.where(self._prescribed, change, 0.0)
        key = wanted.tobytes()
        if key not in self._answers:
            if not self._answers:
                self.model.tangent_entries(at.state, self._entries)
            force = self._periodic_tangent.force(self._entries, wanted)
            move = -self._snes.factor.solve(force * self.model.free)
            moved: Floats = np.zeros_like(move)
            self.model.set_mean_gradient(moved, wanted)
            for array in (force, moved := move + moved):
                array.setflags(write=False)
            self._answers[key] = force, moved
        return self._answers[key]

    def _result(self, state: Floats, angle: float, attempts: Attempts) -> TileState:
        model = self.model
        state.setflags(write=False)
        stress = model.mean_force(state) / self.area
        return TileState(
            angle=angle,
            gradient=model.mean_gradient(state),
            stress=np.where(self._prescribed, stress, 0.0),
            energy=model.energy(state) / self.area,
            state=state,
            positions=model.positions(state),
            stretch_use=model.bounds.worst(model.corners(state)),
            steps=attempts.steps,
            factorisations=attempts.factorisations,
        )

    def _forget(self) -> None:
        self._last = None
        self._answers.clear()

    def _require_last(self, at: TileState) -> None:
        if at is not self._last:
            raise ParameterError(
                "the tangent is that of another state: the solver has been used since. Solve for "
                "this state again, then ask for what it changes by."
            )
