"""Equilibria of a periodic tile at a prescribed mean deformation, and their derivatives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from toros_fem.base.array_types import Bools, Floats
from toros_fem.base.errors import NoEquilibriumError, ParameterError
from toros_fem.base.mpi import dot
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.assembly.model import make_model
from toros_fem.mechanics.equilibrium.continuation import (
    Attempt,
    ContinuationResult,
    NewtonStep,
    run_continuation,
)
from toros_fem.mechanics.equilibrium.newton import Attempts, Newton
from toros_fem.mechanics.equilibrium.options import NewtonOptions
from toros_fem.mechanics.skin.designs import check_density
from toros_fem.mechanics.skin.periodicity import Periodic
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes.skin import Skin

# First and smallest step of a continuation, as fractions of the mean deformation.
FIRST_STEP, SMALLEST_STEP = 1 / 4, 1e-3
# F̄ of the flat sheet.
FLAT = np.eye(3)[:, :2]


@dataclass(frozen=True, eq=False)
class TileState:
    """A tile in equilibrium at a mean deformation.

    Attributes:
        angle: Angle from the first axis of the flat sheet to direction n, in rad.
        gradient: Mean deformation gradient F̄, (3, 2), rows n, t, z, columns n, t.
        stress: Mean first Piola-Kirchhoff stress in N/m, (3, 2), the derivative of `energy` by F̄;
            zero where F̄ is free.
        energy: Mean energy per flat area in J/m².
        state: Owned unknowns of `SkinModel`, in axes n, t, z.
        positions: Positions of the owned nodes in m, (k, 3), a view of `state`.
        steps: Number of Newton steps, each with a new factorisation.
        factorisations: Number of factorisations, those with a diagonal shift included.
    """

    angle: float
    gradient: Floats
    stress: Floats
    energy: float
    state: Floats
    positions: Floats
    steps: int
    factorisations: int


class TileSolver:
    """Solver of equilibria x = F̄ x̄ + w of a tile, w periodic, and of their derivatives.

    One fixed vertex and the prescribed components of F̄ exclude rigid motions. Positions and F̄ are
    in axes n, t, z: those of the flat sheet, rotated by the direction's angle. `solve` leaves the
    tangent's factorisation for the derivatives of the last equilibrium, which refuse any other
    state. All methods are collective.

    Attributes:
        model: Energy and derivatives.
        area: Flat area of the tile in m².

    Args:
        skin: The tile's sewn skin.
        composite: Materials and stretch bounds; a sheet that stays in its plane does not bend.
        periodic: The tile and its prescribed mean deformation.
        log: Called with every row of a solve's history.
        quadratic: As of `EquilibriumSolver`.

    Raises:
        ParameterError: The sheet may leave its plane and does not resist bending, or its rest shape
            or seams do not fit a tile.
    """

    def __init__(
        self,
        skin: Skin,
        composite: Composite,
        periodic: Periodic,
        log: Callable[[NewtonStep | str], None] | None = None,
        quadratic: Bools | None = None,
    ) -> None:
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
        self.skin, self.periodic = skin, periodic
        self.model = make_model(
            skin, composite, Supports(fixed), periodic=periodic, quadratic=quadratic
        )
        self._newton = Newton(self.model, NewtonOptions(), log)
        images, tangent = self.model.images, self._newton.factor.periodic
        assert images is not None
        assert tangent is not None
        self._periodic_tangent, self._images = tangent, images
        self._prescribed = np.array(periodic.prescribed)
        self.area = float(skin.pattern.areas.sum())
        self._entries: Floats = np.zeros(self._newton.factor.triangles.count)
        self._last: TileState | None = None
        self._responses: dict[bytes, tuple[Floats, Floats]] = {}

    def solve(
        self,
        density: Floats,
        angle: float,
        gradient: Floats,
        *,
        start: TileState | None = None,
        allow_continuation: bool = True,
    ) -> TileState:
        """Return the stable equilibrium at a mean deformation.

        Args:
            density: Projected density of the owned triangles, in [0, 1].
            angle: As of `TileState`.
            gradient: F̄, (3, 2), of which only the prescribed components are read.
            start: State to start from, of another density or mean deformation, at the same angle;
                None starts from the homogeneously stretched sheet.
            allow_continuation: Whether to fall back on continuation from the flat sheet where the
                first solve fails.

        Raises:
            ParameterError: The gradient does not fit, or `start` has another angle. The density
                does not fit, or leaves [0, 1].
            NoEquilibriumError: There is no equilibrium.
        """
        check_density(self.skin, density)
        given, fixed = np.asarray(gradient, dtype=np.float64), self._prescribed
        fits = given.shape == (3, 2) and np.isfinite(given[fixed]).all()
        if not (fits and np.isfinite(angle)):
            raise ParameterError(
                f"gradient = {gradient} at angle = {angle} must be (3, 2), "
                "with finite prescribed components."
            )
        if start is not None and start.angle != angle:
            raise ParameterError(
                f"the start has angle = {start.angle:g} rad, the solve {angle:g} rad. Start from a "
                "state of the same direction, or from None."
            )
        self._set(density, angle)
        target, attempts = np.where(fixed, given, 0.0), Attempts(self._newton)

        def attempt(begin: Floats, x: Floats, fraction: float) -> Attempt:
            wanted = begin + fraction * np.where(fixed, target - begin, 0.0)
            rest = np.where(fixed, wanted - self._images.mean_gradient(x), 0.0)
            return attempts(self._stretched(x, angle, rest))

        flat = self.model.assembled
        self.model.positions(flat)[:, :2] = self.flat_positions(angle)
        begin, state = (FLAT, flat) if start is None else (start.gradient, start.state)
        first = attempt(begin, state, 1.0)
        found, reached = first.state, first.outcome > 0
        if not reached and allow_continuation:
            nothing, from_flat = ContinuationResult(flat, 0.0, 1), partial(attempt, FLAT)
            done = run_continuation(from_flat, nothing, FIRST_STEP, SMALLEST_STEP)
            found, reached = done.state, done.load_factor == 1.0 and done.outcome > 0
        if not reached:
            raise NoEquilibriumError(
                f"the tile has no equilibrium at the mean deformation {target[:2].tolist()} along "
                f"{np.degrees(angle):.4g} degrees inside the stretch bounds "
                f"{self.model.composite.stated_bounds}. Stretch it less, "
                "soften the print, or refine the mesh."
            )
        return self._result(found, angle, attempts.steps, attempts.factorisations)

    def restore(
        self, density: Floats, angle: float, unknowns: Floats, *, counts: tuple[int, int]
    ) -> TileState:
        """Return a saved equilibrium as if it had just been solved for.

        Args:
            density, angle: As of `solve`.
            unknowns: `Patch.gather` of its state. Those of another tile are refused.
            counts: Its numbers of Newton steps and factorisations.

        Raises:
            NoEquilibriumError: It is not stable.
        """
        state = self.model.patch.scatter(unknowns)
        if not self.stable(state, density, angle):
            raise NoEquilibriumError(
                f"the saved state of the tile along {np.degrees(angle):.4g} degrees is not stable."
            )
        return self._result(state, angle, *counts)

    def stiffness(self, at: TileState, changes: Floats) -> Floats:
        """Return the second derivative of the mean energy in N/m, (k, k).

        Directions are in the prescribed components of F̄, (k, 3, 2). In the flat state, symmetric
        ones give the membrane stiffness of the undeformed tile.
        """
        comm, pairs = self.skin.comm, [self._linear_response(at, change) for change in changes]
        return np.array([[dot(comm, f, q) / self.area for _, q in pairs] for f, _ in pairs])

    def stress_gradient(self, at: TileState, change: Floats) -> Floats:
        """Return d(P̄ : change)/dρ̄ at owned triangles, in N/m, prescribed F̄ constant.

        The derivative of the state is its own adjoint here: no further solve is needed.
        """
        _, adjoint = self._linear_response(at, change)
        return np.asarray(self.model.density_sensitivity(at.state, adjoint) / self.area)

    def strain_gradient(self, at: TileState, part: Floats) -> Floats:
        """Return d(F̄ : part)/dρ̄ at owned triangles, for free components of F̄, by one solve."""
        self._require_last(at)
        rhs: Floats = np.zeros_like(at.state)
        self._images.set_mean_gradient(rhs, np.asarray(part / self.periodic.length))
        adjoint = self._newton.factor.solve(rhs * self.model.free)
        sensitivity = self.model.density_sensitivity(at.state, adjoint)
        return np.asarray(-sensitivity / self.periodic.length)

    def stable(self, state: Floats, density: Floats, angle: float) -> bool:
        """Return whether an equilibrium, given by its owned unknowns, is stable."""
        self._set(density, angle)
        return self._newton.stable(state)

    def buckles(self, flat: TileState, density: Floats) -> bool:
        """Return whether an equilibrium is unstable out of its plane.

        Its solver is flat and has the same quadratic triangles.
        """
        if self.periodic.flat:
            raise ParameterError(
                "this solver keeps the tile in its plane, so it cannot buckle. Make the solver "
                "with Periodic(tile, flat=False) and materials that bend."
            )
        return not self.stable(self.lifted(flat), density, flat.angle)

    def lifted(self, flat: TileState) -> Floats:
        """Return the state of a flat solver with the same quadratic triangles as one of this."""
        state: Floats = np.zeros(self.model.size_local)
        count = flat.positions.size
        state[:count] = flat.state[:count]
        # Rotations of edges, which are 0, come between the positions and all else.
        others = flat.state[count:]
        state[len(state) - len(others) :] = others
        return state

    def flat_positions(self, angle: float) -> Floats:
        """Return the positions of the owned nodes in the flat sheet, axes n, t, in m, (k, 2)."""
        c, s = np.cos(angle), np.sin(angle)
        places = self.skin.pattern.points[self.skin.owned_vertices, :2]
        return np.asarray(places @ np.array([[c, -s], [s, c]]))

    def _set(self, density: Floats, angle: float) -> None:
        """Set density and direction of the next solve; older states have no derivatives now."""
        self._last = None
        self._responses.clear()
        self._images.turn(angle)
        self.model.set_density(density)

    def _stretched(self, state: Floats, angle: float, change: Floats) -> Floats:
        """Return a state with a homogeneous deformation added."""
        added = np.zeros_like(state)
        positions = self.model.positions(added)
        positions[:] = self.flat_positions(angle) @ change.T
        self._images.set_mean_gradient(added, change)
        # The fixed vertex keeps its position.
        shift = positions[self.skin.owned_vertices == 0].sum(axis=0)
        positions -= self.skin.comm.allreduce(shift)
        return state + added

    def _linear_response(self, at: TileState, change: Floats) -> tuple[Floats, Floats]:
        """Return the derivatives of force and state by F̄; they are kept for further calls.

        The force is that of all unknowns with the state constant.
        """
        self._require_last(at)
        prescribed = np.where(self._prescribed, change, 0.0)
        key = prescribed.tobytes()
        if key not in self._responses:
            if not self._responses:
                self._newton.factor.triangles.compute(at.state, self._entries)
            force = self._periodic_tangent.force(self._entries, prescribed)
            state: Floats = np.zeros_like(force)
            self._images.set_mean_gradient(state, prescribed)
            state -= self._newton.factor.solve(force * self.model.free)
            self._responses[key] = force, state
        return self._responses[key]

    def _result(self, state: Floats, angle: float, steps: int, factorisations: int) -> TileState:
        model = self.model
        state.setflags(write=False)
        stress = self._images.mean_force(model.variation(state)) / self.area
        self._last = TileState(
            angle=angle,
            gradient=self._images.mean_gradient(state),
            stress=np.where(self._prescribed, stress, 0.0),
            energy=model.energy(state) / self.area,
            state=state,
            positions=model.positions(state),
            steps=steps,
            factorisations=factorisations,
        )
        return self._last

    def _require_last(self, at: TileState) -> None:
        if at is not self._last:
            raise ParameterError(
                "the solver has been used since this state, so its tangent is another one. Solve "
                "for this state again before its derivatives."
            )
