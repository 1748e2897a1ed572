"""Stable equilibrium of a skin under a load, by continuation where one solve fails."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import MaterialWarning, NoEquilibriumError, ParameterError, UnitWarning
from toros_fem.base.mpi import (
    largest,
    norm,
    on_first_rank,
    raise_together,
    require_alike,
    warn_together,
)
from toros_fem.base.validation import (
    real_numbers,
    require_between,
    require_callable,
    require_finite,
    require_flag,
    require_kind,
)
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.contact.settings import Contact, poses_of
from toros_fem.mechanics.contact.sliding import Sliding
from toros_fem.mechanics.equilibrium.continuation import (
    Attempt,
    ContinuationResult,
    run_continuation,
)
from toros_fem.mechanics.equilibrium.diagnostics import Condition, condition_of, failure, success
from toros_fem.mechanics.equilibrium.krylov import gmres
from toros_fem.mechanics.equilibrium.newton import NewtonStep
from toros_fem.mechanics.equilibrium.options import NewtonOptions
from toros_fem.mechanics.equilibrium.path import PathPoint, critical_load, find_jump, leads_back
from toros_fem.mechanics.equilibrium.prescribed import PrescribedDisplacement
from toros_fem.mechanics.equilibrium.snes import Attempts, SnesSolver
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.dead_loads import Weight
from toros_fem.mechanics.skin.feasible_start import relaxed_into_bounds
from toros_fem.mechanics.skin.load_case import LoadCase, make_load_case
from toros_fem.mechanics.skin.model import SkinModel
from toros_fem.mechanics.skin.relaxed_model import CROSSING, RelaxedModel
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes.skin import Skin

# First increment of a continuation from one design to another, as a fraction of the whole.
FIRST_INCREMENT = 1 / 16
# Largest number of steps of a trial.
FEW_STEPS = 40
# The same in contact, where layers that close limit one step after the other.
FEW_IN_CONTACT = 120
# Factor on `max_steps` for the last attempt, which starts where the first cold one stopped.
MORE_STEPS = 6
# A skin is flat where it encloses less than this fraction of a sphere of its area. It is opened by
# a pressure that, times its size over its stiffness, is OPENING, and lowered by LOWERED each time.
FLAT, OPENING, LOWERED = 0.2, 0.4, 1.7
# Multiple of the pressure from which a skin that folds at the requested one is lowered.
LARGER = 10.0
# Largest number of steps by which bodies and supports are carried, and the shortest of them, over
# what is left of the way.
CARRIES, SHORTEST_CARRY = 200, 1e-4
# Fraction of the skin's size by which two states may differ and be the same.
SAME = 1e-6
# GMRES with friction: residual over the right-hand side at which it ends, that is enough, and
# largest number of iterations.
LINEAR_TOLERANCE, LINEAR_ALLOWED, LINEAR_ITERATIONS = 1e-11, 1e-8, 200
# Thickness over the skin's size from which a unit is in doubt.
THICK = 0.1


@dataclass(frozen=True, eq=False)
class EquilibriumResult:
    """Result of a solve.

    Attributes:
        converged: Whether `state` is a stable equilibrium under the requested load; of a trial,
            whether it is near to one.
        load_factor: Fraction of the requested load that acts on `state`.
        reason: Why the solve ended, as a sentence.
        pressure: Pressure of `state` in Pa, the largest of all chambers.
        pressures: Pressure of each chamber in Pa.
        state: Owned unknowns in m, a flat array, as `SkinModel` has them.
        positions: Positions of the owned nodes in m, (n, 3), a view of `state`.
        energy: Energy of eq. (8) in J, less the work of dead forces from the assembled positions.
        volume: Enclosed volume in m³.
        volumes: Volume of each chamber in m³.
        stretch_use: Largest fraction of the stretch bounds that a triangle uses, < 1.
        residual: Norm of the first variation over the applied load.
        condition: Whether it snapped, is near a limit point, blown up or folded.
        smallest_distance: Smallest distance in m between faces of skin, bodies and ground,
            positive; at most the distance from which on contact acts. None without contact.
        poses: Poses of all bodies, a row of six for each: translation in m, rotation vector in
            rad. None without bodies.
        steps: Number of Newton steps, each with the tangent at its state.
        modified_steps: Number of modified Newton steps, with an older tangent.
        factorisations: Number of factorisations of the tangent, retries with a shift included.
        history: One row for each step of either kind, and one that ends each solve.
        sliding: Where the skin sticks to ground and bodies, for the next step of a path; None
            without friction.
    """

    converged: bool
    load_factor: float
    reason: str
    pressure: float
    pressures: tuple[float, ...]
    state: Floats
    positions: Floats
    energy: float
    volume: float
    volumes: tuple[float, ...]
    stretch_use: float
    residual: float
    condition: Condition
    smallest_distance: float | None
    poses: tuple[tuple[float, ...], ...] | None
    steps: int
    modified_steps: int
    factorisations: int
    history: tuple[NewtonStep, ...]
    sliding: Sliding | None = None


# What is saved of a result beside its state.
SAVED = tuple(
    f.name for f in fields(EquilibriumResult) if f.name not in ("state", "positions", "sliding")
)


class EquilibriumError(NoEquilibriumError):
    """No equilibrium was found; `result` holds the last good state and the history."""

    def __init__(self, message: str, result: EquilibriumResult) -> None:
        super().__init__(message)
        self.result = result

    def __reduce__(self) -> tuple[Any, ...]:
        # Exceptions are pickled by their message alone, and ranks exchange them so.
        return type(self), (str(self), self.result)

    @property
    def steps(self) -> int:
        """Number of Newton steps."""
        return self.result.steps

    @property
    def factorisations(self) -> int:
        """Number of factorisations."""
        return self.result.factorisations


@dataclass(frozen=True, eq=False)
class _Request:
    """Density and load of a solve, and anchors of friction at its begin."""

    density: Floats
    load: LoadCase
    begin: Sliding | None


@dataclass(frozen=True, eq=False)
class _Known:
    """An equilibrium that later solves may start from.

    Its origin is the point of its path to judge a later one by: the state itself, or where a trial
    came from, with whether no negative curvature was met on the way.
    """

    request: _Request
    result: EquilibriumResult
    origin: PathPoint | None
    definite: bool = True


class EquilibriumSolver:
    """Solver for stable equilibria of a skin, and for linear systems with the tangent there.

    Args:
        skin: The sewn skin.
        composite: Materials and stretch bounds.
        supports: Fixed components and directions.
        options: Tolerance and limits.
        log: Called with every row of a solve's history as it comes, and with a sentence where the
            equilibrium snapped, is near a limit point, blown up or folded; on every rank.
        chambers: Pressure chambers; None for one.
        weight: The skin's own weight; None for none.
        families: Number of line families of relaxed designs, which then take the place of
            densities (`RelaxedModel`); None for none.
        crossing: Factor of their bonded crossings, as for `RelaxedModel`.
        contact: What the skin touches: itself, the ground, bodies; None for nothing.
    """

    def __init__(
        self,
        skin: Skin,
        composite: Composite,
        supports: Supports,
        options: NewtonOptions | None = None,
        log: Callable[[NewtonStep | str], None] | None = None,
        *,
        chambers: Chambers | None = None,
        weight: Weight | None = None,
        families: int | None = None,
        crossing: float = CROSSING,
        contact: Contact | None = None,
    ) -> None:
        require_kind("skin", skin, Skin, "a Skin, by sew(comm, pattern)")
        given = {"composite": composite, "supports": supports, "options": options}
        more = {"chambers": chambers, "weight": weight, "families": families, "crossing": crossing}
        require_kind("contact", contact, (Contact, type(None)), "a Contact, or None for none")
        require_alike(skin.comm, **given, **more, contact=contact)
        require_between(0.0, np.inf, crossing=crossing)
        _require_kinds(composite, supports, options, log, chambers, weight)
        _warn_of_odd_sheets(skin, composite)
        self.skin, self.log, self.contact = skin, log, contact
        self.model: SkinModel
        if families is None:
            self.model = SkinModel(skin, composite, supports, chambers, weight, contact)
        else:
            if contact is not None:
                raise ParameterError(
                    "relaxed designs know no contact; leave contact out, or families."
                )
            self.model = RelaxedModel(
                skin, composite, supports, families, chambers, weight, crossing
            )
        self.options = options or NewtonOptions()
        self._snes = SnesSolver(self.model, self.options, log)
        self._factor = self._snes.factor
        self._prescribed = PrescribedDisplacement(self.model)
        self._factorised_at: EquilibriumResult | None = None
        self._known: list[_Known] = []  # the last solves

    def solve(
        self,
        density: Floats,
        pressure: float | Sequence[float],
        *,
        force: Floats | None = None,
        displacement: Floats | None = None,
        weight_fraction: float = 1.0,
        poses: npt.ArrayLike | None = None,
        start: Floats | EquilibriumResult | None = None,
        sliding: Sliding | None = None,
        raise_on_failure: bool = True,
        trial: bool = False,
    ) -> EquilibriumResult:
        """Solve for the stable equilibrium at a density and a load (collective).

        Where the full load at once fails, it is raised in increments that shrink where they fail.
        Where that fails too, the plain fabric is solved for and then stiffened.

        Args:
            density: Projected density of the owned triangles, in [0, 1]; with line families the
                rows of a relaxed design.
            pressure: Pressure in Pa, ≥ 0, one for all chambers or one for each.
            force: Dead forces in N on all assembled vertices, (n, 3).
            displacement: Displacement of the fixed components in m, (n, 3); None takes that of the
                supports.
            weight_fraction: Fraction of the skin's own weight that acts, if it has one.
            poses: Poses of the contact's bodies, (k, 6): translation in m and rotation vector in
                rad from where they were made, not read for free bodies. None leaves them there.
            start: Owned unknowns to start from, for example those of a neighbouring equilibrium;
                or positions of the owned nodes, (n, 3), for example of a solver with another
                bending term. Where triangles leave the stretch bounds it is relaxed until they are
                inside. Fixed components are moved to their prescribed positions. None starts from
                the assembled positions; with contact, layers that touch there are moved apart
                first, and displacements count from where they then are. An earlier result of this
                solver is the step before this one on a path: friction goes on from it.
            sliding: Where the skin sticks at the begin of the step, of an earlier result; None
                takes that of a result given as `start`, else the skin begins at rest at the
                assembled positions, wherever the iteration starts.
            raise_on_failure: Whether to raise if no equilibrium is found, or to return the last
                good state with `converged` False.
            trial: Whether the result may be rejected: the full load is tried once, with few steps
                and a large tolerance, and without proof that the state is stable. `finish`
                completes it.

        Raises:
            ParameterError: The pressure is negative or not finite, an array does not fit, the
                start leaves the stretch bounds (of two materials the wider ones) and cannot be
                relaxed into them, or surfaces overlap or cross there that may touch.
            DensityError: The density does not fit, or leaves [0, 1].
            OpenSkinError: Pressure on a skin with free edges that no symmetry plane closes.
            EquilibriumError: No equilibrium was found; the error holds the last good state.
        """
        model = self.model
        require_alike(self.skin.comm, pressure=pressure, weight_fraction=weight_fraction)
        require_finite(weight_fraction=weight_fraction)
        require_flag(raise_on_failure=raise_on_failure, trial=trial)
        load = make_load_case(
            self.skin.pattern,
            model.supports,
            len(model.load.pressures),
            pressure,
            force=force,
            displacement=displacement,
            weight_fraction=0.0 if model.weight is None else weight_fraction,
            poses=poses_of(self.contact, poses),
            bodies_fraction=float(model.free_bodies > 0),
        )
        density = model.check(density)
        if isinstance(start, EquilibriumResult):
            sliding, start = start.sliding if sliding is None else sliding, start.state
        state = self._start(start)
        known = next((k for k in self._known if start is k.result.state), None)
        if known is None and not trial:  # a trial may fail
            self._require_apart(state, load, cold=start is None)
        result = self._solve(
            _Request(density.copy(), load, sliding),
            state,
            known,
            cold=start is None,
            trial=trial,
            direct=trial,
        )
        if raise_on_failure and not result.converged:
            raise EquilibriumError(result.reason, result)
        return result

    def start_at(self, positions: Floats) -> Floats | None:
        """Return positions of the owned nodes that a solve can start from (collective).

        Args:
            positions: Positions of all assembled vertices, (n, 3), in m, for example of a coarser
                mesh.

        Returns:
            These positions, relaxed where they leave the stretch bounds or nearly so; None if that
            does not help, or if surfaces overlap or cross that may touch.
        """
        found, model = self._relaxed(positions), self.model
        if found is None:
            return None
        owned = found[self.skin.owned_vertices]
        return owned if model.refusal(model.state_of(owned)) is None else None

    def finish(self, trial: EquilibriumResult) -> EquilibriumResult:
        """Complete a trial: the tolerance of the options, and a stable state (collective).

        Args:
            trial: A recent result of this solver; one that is complete is returned as it is.

        Returns:
            The equilibrium; steps and factorisations are those of the completion alone.

        Raises:
            ParameterError: The solver has been used for other designs since.
            EquilibriumError: There is no stable equilibrium near.
        """
        require_kind("trial", trial, EquilibriumResult, "an EquilibriumResult of this solver")
        if trial is self._factorised_at:
            return trial
        known = next((k for k in self._known if k.result is trial), None)
        if known is None:
            raise ParameterError(
                "the trial's design is not known any more: the solver has been used since. Solve "
                "for it again."
            )
        recent = self._known
        found = self._solve(
            known.request, trial.state.copy(), known, cold=False, trial=False, direct=True
        )
        if not found.converged:
            raise EquilibriumError(found.reason, found)
        # It may be rejected yet: the design before stays known.
        self._known = [*recent, self._known[-1]]
        return found

    def save(self, at: EquilibriumResult) -> tuple[Floats, dict[str, Any]]:
        """Return what `restore` needs: all unknowns by original index, and numbers (collective).

        Args:
            at: The last equilibrium of this solver.

        Raises:
            ParameterError: The solver has been used for another solve since.
        """
        self._require_last(at)
        numbers = {name: getattr(at, name) for name in SAVED}
        numbers["condition"] = asdict(at.condition)
        numbers["history"] = [asdict(row) for row in at.history]
        numbers["first_shift"] = self._snes.newton.first_shift
        begin = next(k.request.begin for k in self._known if k.result is at)
        numbers["begin"] = None if begin is None else begin.anchors.tolist()
        return self.model.gather(at.state), numbers

    def restore(
        self,
        density: Floats,
        unknowns: Floats,
        numbers: Mapping[str, Any],
        force: Floats | None = None,
    ) -> EquilibriumResult:
        """Return an equilibrium as if it had just been solved for (collective).

        On as many ranks as before, all that follows is the same to the last bit: what one solve
        leaves to the next is the tangent at its end, factorised again here, and its first shift.

        Args:
            density: As of `solve`.
            unknowns, numbers: As of `save`; the numbers may have been written as JSON.
            force: As of `solve`.

        Raises:
            ParameterError: The unknowns are those of another skin.
            EquilibriumError: It is no equilibrium any more, and there is none near.
        """
        model, newton = self.model, self._snes.newton
        load = make_load_case(
            self.skin.pattern,
            model.supports,
            len(model.load.pressures),
            numbers["pressures"],
            force=force,
            weight_fraction=0.0 if model.weight is None else 1.0,
            poses=poses_of(self.contact, numbers["poses"]),
            bodies_fraction=float(model.free_bodies > 0),
        )
        model.check(density)
        state = model.scatter(unknowns)
        anchors = numbers["begin"]
        begin = None if anchors is None else Sliding(np.array(anchors))
        self._factorised_at = None
        model.set_density(density)
        model.set_load(load)
        model.begin_step(begin, load)
        model.lag_friction(state)
        if not newton.stable(state):  # another machine may round otherwise
            return self.solve(
                density,
                numbers["pressures"],
                force=force,
                poses=numbers["poses"],
                start=state,
                sliding=begin,
            )
        newton.first_shift = numbers["first_shift"]
        state.setflags(write=False)
        given: dict[str, Any] = {key: value for key, value in numbers.items() if key in SAVED}
        given |= {key: tuple(numbers[key]) for key in ("pressures", "volumes")}
        if numbers["poses"] is not None:
            given["poses"] = tuple(tuple(pose) for pose in numbers["poses"])
        given["condition"] = Condition(**numbers["condition"])
        given["history"] = tuple(NewtonStep(**row) for row in numbers["history"])
        result = EquilibriumResult(
            **given,
            state=state,
            positions=model.positions(state),
            sliding=model.end_step(state),
        )
        point = PathPoint(density.copy(), load, state)
        known = _Known(_Request(point.density, load, begin), result, point)
        self._known = [*self._known[-1:], known]
        self._factorised_at = result
        return result

    def revisit(
        self,
        at: EquilibriumResult,
        density: Floats,
        load: LoadCase,
        begin: Sliding | None = None,
    ) -> None:
        """Factorise the tangent at an earlier equilibrium again (collective).

        Args:
            at: An equilibrium of this solver.
            density, load: Those it was solved for.
            begin: `sliding` of its solve.

        Raises:
            ParameterError: Its tangent is not positive definite: it belongs to another density or
                load.
        """
        self._factorised_at = None
        self.model.set_density(self.model.check(density))
        self.model.set_load(load)
        self.model.begin_step(begin, load)
        self.model.lag_friction(at.state)
        if not self._snes.newton.stable(at.state):
            raise ParameterError(
                "the state is no stable equilibrium of this density and load; give those that it "
                "was solved for."
            )
        self._factorised_at = at

    def forget_last(self) -> None:
        """Forget the last equilibrium: its model has been used for something else since."""
        self._factorised_at = None

    @property
    def linear_solver(self) -> str:
        """What factorises the tangent, on which ranks or threads."""
        return self._factor.describe()

    def solve_tangent(self, rhs: Floats, at: EquilibriumResult, *, adjoint: bool = False) -> Floats:
        """Solve K y = rhs with the tangent at an equilibrium, zero at fixed components.

        This is the adjoint solve of eq. (19). K is written by hand and tested against
        `ufl.derivative` of the residual; without friction it is symmetric. With friction GMRES
        solves, with the factors of the symmetric part.

        Args:
            rhs: Owned unknowns.
            at: The last equilibrium of this solver: its tangent is still factorised.
            adjoint: Whether to solve with the transpose, which differs with friction: normal forces
                change it, and it does not change them.

        Raises:
            ParameterError: The solver has been used for another solve since; or an adjoint through
                friction on free bodies is asked for.
            NoEquilibriumError: With friction: the iteration does not converge.
        """
        self._require_last(at)
        rhs, model, factor = rhs * self.model.free, self.model, self._factor
        if not model.slides:
            return factor.solve(rhs)
        if adjoint and self.contact is not None and self.contact.free_bodies:
            raise ParameterError(
                "there is no adjoint through friction on free bodies; hold or move the bodies, or "
                "leave the friction out."
            )
        solution, left = gmres(
            self.skin.comm,
            lambda x: factor.multiply(x) + model.friction_coupling(at.state, x, transposed=adjoint),
            factor.solve,
            rhs,
            LINEAR_TOLERANCE,
            LINEAR_ITERATIONS,
        )
        if left > LINEAR_ALLOWED:
            raise NoEquilibriumError(
                f"the linear solve with friction leaves {left:.1g} of its right-hand side after "
                f"{LINEAR_ITERATIONS} iterations: the equilibrium is near to slipping as a whole. "
                "Shorten the step of the path, or lower the friction."
            )
        return solution

    def reactions(self, at: EquilibriumResult) -> Floats:
        """Return the forces in N by which the supports pull at all vertices (collective).

        Args:
            at: The last equilibrium of this solver.

        Returns:
            Shape (n, 3), zero at free components, on every rank.

        Raises:
            ParameterError: The solver has been used for another solve since.
        """
        self._require_last(at)
        return self.skin.gather_vertices(self.model.positions(self.model.reaction(at.state)))

    def _solve(
        self,
        request: _Request,
        state: Floats,
        near: _Known | None,
        *,
        cold: bool,
        trial: bool,
        direct: bool,
    ) -> EquilibriumResult:
        """Solve for a request from a state, if `direct` without continuation (collective)."""
        self._factorised_at = None
        self.model.begin_step(request.begin, request.load)
        attempts = Attempts(self._snes, near=near is not None)
        end = self._continue(attempts, state, request, near, cold=cold, trial=trial, direct=direct)
        origin = None if near is None else near.origin
        # Between two designs there is no path that a skin takes. Where bodies or supports push it
        # along, the path has been taken step by step.
        if origin is not None and (
            not self._same_design(origin.density, request.density)
            or self._moves(origin.load, request.load)
        ):
            origin = None
        if self.model.slides:  # a path with friction is made of its steps
            origin = None
        snapped = critical = None
        if end.load_factor == 1.0 and not trial:
            point = PathPoint(request.density, request.load, end.state)
            if origin is not None:
                assert near is not None
                definite = attempts.definite and near.definite
                snapped, point = self._connect(attempts, origin, point, definite=definite)
                end = ContinuationResult(point.state, 1.0, end.outcome)
            if origin is not None or not direct:
                critical = critical_load(self.model, self._factor, point)
        result = self._result(
            attempts, end, request.load, snapped, critical, trial=trial, direct=direct
        )
        if result.converged:
            self._factorised_at = None if trial else result
            kept = [near] if near is not None else self._known[-1:]
            here = PathPoint(request.density, request.load, result.state)
            found = _Known(request, result, here)
            if trial:
                found = _Known(request, result, origin, attempts.definite)
            self._known = [*kept, found]
        return result

    def _poses(self, state: Floats) -> tuple[tuple[float, ...], ...] | None:
        contact = self.model.contact
        if contact is None or not contact.contact.bodies:
            return None
        motions = self.skin.comm.bcast(self.model.motions(state), root=0)
        return tuple(tuple(map(float, pose)) for pose in contact.poses_at(motions))

    def _same_design(self, one: Floats, two: Floats) -> bool:
        return largest(self.skin.comm, float(np.abs(one - two).max(initial=0.0))) == 0

    def _connect(
        self, attempts: Attempts, begin: PathPoint, end: PathPoint, *, definite: bool
    ) -> tuple[bool | None, PathPoint]:
        """Return whether the path between two equilibria jumps, and its end (collective).

        Without a negative curvature on the way (`definite`) the tangent may settle it.

        The tangent at the end is factorised, before and after.
        """
        comm, size = self.skin.comm, self.skin.pattern.size

        def same(a: Floats, b: Floats) -> bool:
            return largest(comm, float(np.abs(a - b).max(initial=0.0))) <= SAME * size

        def distance(a: Floats, b: Floats) -> float:
            return norm(comm, (a - b) * self.model.free)

        if same(begin.state, end.state):
            return False, end
        if definite and leads_back(self.model, self._factor, begin, end):
            return False, end

        def attempt(start: Floats, fraction: float) -> Attempt:
            density, load = begin.towards(end, fraction)
            self.model.set_density(density)
            self.model.set_load(load)
            return attempts(self._prescribed(start, load.displacement))

        jumps, reached = find_jump(distance, attempt, begin, end)
        if not same(reached, end.state):
            end = PathPoint(end.density, end.load, reached)
        self.model.set_density(end.density)
        self.model.set_load(end.load)
        self._snes.newton.stable(end.state)
        return jumps, end

    def _max_steps(self, *, trial: bool) -> int:
        """Return the largest number of steps of one attempt."""
        most = self._snes.max_steps
        few = FEW_STEPS if self.contact is None else FEW_IN_CONTACT
        return min(few, most) if trial else most

    def _require_last(self, at: EquilibriumResult) -> None:
        require_kind("at", at, EquilibriumResult, "an EquilibriumResult of this solver")
        if at is not self._factorised_at:
            raise ParameterError(
                "the tangent is that of another state: the solver has been used since. Solve for "
                "this state again, then for its tangent, gradient or reactions."
            )

    def _start(self, start: Floats | None) -> Floats:
        """Start as owned unknowns, checked (collective)."""
        model, error = self.model, None
        state = model.assembled
        unknowns, nodes = state.shape, model.positions(state).shape
        if start is not None:
            try:
                start = real_numbers("start", start, "unknowns, or positions (n, 3), in m")
            except ParameterError as caught:
                error, start = caught, np.zeros(unknowns)
        if start is not None and start.shape not in (unknowns, nodes):
            error = ParameterError(
                f"start has shape {start.shape}; on this rank it must be {unknowns}, the unknowns "
                f"of this bending term, or {nodes}, positions."
            )
        raise_together(self.skin.comm, error)
        if start is not None and start.ndim == 2:
            state = model.state_of(start)
        elif start is not None:
            state = model.with_short_turns(start)
        use = model.bounds.worst_of_start(model.corners(state))
        if start is not None and 1 <= use < np.inf:
            inside = self._relaxed(self.skin.gather_vertices(model.positions(state)))
            if inside is not None:
                model.positions(state)[:] = inside[self.skin.owned_vertices]
                return state
        if not use < 1:
            bounds = model.composite.stated_bounds
            what, remedy = "start", f"Start from the assembled positions, or raise {bounds}."
            if start is None:
                what = "assembled shape, from which a solve starts,"
                remedy = f"Raise {bounds}, or fit the panels to the shape."
            raise ParameterError(
                f"the {what} leaves the stretch bounds: a triangle uses {use:.3g} of them, the "
                f"bound is 1. {remedy}"
            )
        return state

    def _relaxed(self, positions: Floats) -> Floats | None:
        """Return positions of all vertices inside the stretch bounds, or None (collective)."""
        pattern, model = self.skin.pattern, self.model
        return on_first_rank(
            self.skin.comm,
            lambda: relaxed_into_bounds(pattern, model.composite, model.supports.fixed, positions),
        )

    def _require_apart(self, state: Floats, load: LoadCase, *, cold: bool) -> None:
        """Check that contact can act on a start, with bodies at their poses or where made.

        Raises:
            ParameterError: Surfaces overlap or cross there.
        """
        model = self.model
        model.set_load(load)
        refusal = model.refusal(state)
        if refusal is None:
            return
        if load.poses is not None:  # bodies that are moved in with the load
            model.set_load(load.scaled(0.0))
            if model.refusal(state) is None:
                return
        what, remedy = "start", "Start from the assembled positions, or from another equilibrium."
        if cold:
            what = "assembled shape, from which a solve starts,"
            remedy = "Make ground and bodies further away."
        raise ParameterError(f"contact cannot act on the {what}: {refusal}. {remedy}")

    def _continue(
        self,
        attempts: Attempts,
        state: Floats,
        request: _Request,
        near: _Known | None,
        *,
        cold: bool,
        trial: bool,
        direct: bool,
    ) -> ContinuationResult:
        """Solve at once, else by continuation from the near equilibrium, in load, in stiffness.

        Returns:
            The last equilibrium at the requested density, and its fraction of the load.
        """
        density, load = request.density, request.load

        def attempt(
            start: Floats, at: Floats, under: LoadCase, max_steps: int | None = None
        ) -> Attempt:
            self.model.set_density(at)
            self.model.set_load(under)
            return attempts(self._prescribed(start, under.displacement), max_steps, trial=trial)

        def lower_load(factor: float) -> ContinuationResult | None:
            """From a multiple of the load down to it; None if a solve fails."""
            found = attempt(self.model.assembled, density, load.scaled(factor))
            while found.converged and factor > 1:
                factor = max(1.0, factor / LOWERED)
                found = attempt(found.state, density, load.scaled(factor))
            return ContinuationResult(found.state, 1.0, found.outcome) if found.converged else None

        most = self._snes.max_steps
        if near is not None and self._moves(near.request.load, load):
            return self._carry(attempts, state, density, near.request.load, load, trial=trial)
        if cold and not direct:
            factor = self._opening(density, load)
            opened = None if factor is None else lower_load(factor)
            if opened is not None:
                return opened
        first = attempt(state, density, load, self._max_steps(trial=trial))
        if first.converged:
            return ContinuationResult(first.state, 1.0, first.outcome)
        if direct or first.outcome == int(PETSc.SNES.ConvergedReason.DIVERGED_DTOL):
            return ContinuationResult(state, None, first.outcome)
        least = self.options.min_increment
        if near is not None:
            there, load_there = near.request.density, near.request.load
            walked = run_continuation(
                lambda x, f: attempt(
                    x, there + f * (density - there), load_there.towards(load, f)
                ),
                ContinuationResult(state, 0.0, first.outcome), 1.0, FIRST_INCREMENT, least,
            )  # fmt: skip
            if walked.load_factor == 1.0:
                return walked
        if not cold:
            first = attempt(self.model.assembled, density, load)
            if first.converged:
                return ContinuationResult(first.state, 1.0, first.outcome)
        if first.outcome == int(PETSc.SNES.ConvergedReason.DIVERGED_MAX_IT):
            # It may only be slow: as many steps again cost less than a continuation.
            first = attempt(first.state, density, load)
            if first.converged:
                return ContinuationResult(first.state, 1.0, first.outcome)
        # A pressure that strains by a few per cent.
        small = 0.1 * self.model.composite.least_stiffness / self.skin.pattern.size
        increment = min(small / load.largest, 1 / 4) if load.largest else FIRST_INCREMENT

        def raise_load(at: Floats, outcome: int) -> ContinuationResult:
            begin = ContinuationResult(self.model.assembled, None, outcome)
            return run_continuation(
                lambda x, f: attempt(x, at, load.scaled(f)), begin, 1.0, increment, least
            )

        by_load = ContinuationResult(state, None, first.outcome)
        if load:
            by_load = raise_load(density, first.outcome)
            if by_load.load_factor == 1.0:
                return by_load
            if by_load.load_factor is None:
                by_load = ContinuationResult(state, None, by_load.outcome)
        plain = np.zeros_like(density)
        found = attempt(self.model.assembled, plain, load)
        soft = ContinuationResult(found.state, 1.0, found.outcome)
        if not found.converged and load:
            soft = raise_load(plain, found.outcome)
        if soft.outcome > 0:
            stiffened = run_continuation(
                lambda x, f: attempt(x, f * density, load),
                ContinuationResult(soft.state, 0.0, soft.outcome), 1.0, FIRST_INCREMENT, least,
            )  # fmt: skip
            if stiffened.load_factor == 1.0:
                return stiffened
        if _by_pressure_alone(load):
            lowered = lower_load(LARGER)
            if lowered is not None:
                return lowered
        found = attempt(first.state, density, load, MORE_STEPS * most)
        if found.converged:
            return ContinuationResult(found.state, 1.0, found.outcome)
        return by_load

    def _carry(
        self,
        attempts: Attempts,
        state: Floats,
        density: Floats,
        begin: LoadCase,
        end: LoadCase,
        *,
        trial: bool,
    ) -> ContinuationResult:
        """Move bodies and supports, step by step, and let the skin come to rest after each.

        Nothing passes through anything: where the skin is in the way it is pushed.
        """
        model, gone, longest = self.model, 0.0, 1.0
        outcome = int(PETSc.SNES.ConvergedReason.DIVERGED_LINE_SEARCH)
        model.set_density(density)
        for _ in range(CARRIES):
            model.set_load(begin.towards(end, gone))
            moved, part = self._prescribed.follow(self._snes.newton, state, end, longest)
            there = 1.0 if part == 1 else gone + part * (1 - gone)
            model.set_load(begin.towards(end, there) if there < 1 else end)
            found = attempts(moved, trial=trial or there < 1)
            outcome = found.outcome
            if found.converged and there == 1:
                return ContinuationResult(found.state, 1.0, outcome)
            if found.converged:
                state, gone, longest = found.state, there, min(1.0, 4 * longest)
            else:
                longest = part / 4
            if longest < SHORTEST_CARRY:
                break
        model.set_load(end)
        return ContinuationResult(state, None, outcome)

    def _moves(self, one: LoadCase, other: LoadCase) -> bool:
        """Return whether bodies or supports move between two loads of a skin with contact."""
        if self.contact is None:
            return False
        pairs = ((one.poses, other.poses), (one.displacement, other.displacement))
        return not all(
            np.array_equal(np.zeros(1) if a is None else a, np.zeros(1) if b is None else b)
            for a, b in pairs
        )

    def _opening(self, density: Floats, load: LoadCase) -> float | None:
        """Return the factor on the pressure that opens a flat skin (collective).

        A pressure that hardly strains a flat skin crumples it: it stops in the first of many
        stable states. From the open skin crumples spread evenly, and the energy ends lower.

        Returns:
            None if the skin is not flat, or the requested pressure opens it.
        """
        model, pattern = self.model, self.skin.pattern
        if not _by_pressure_alone(load):
            return None
        sphere = pattern.areas.sum() ** 1.5 / (6 * np.sqrt(np.pi))
        model.set_density(density)
        factor = OPENING * model.soft_modulus() / (load.largest * pattern.size)
        if model.volume(model.assembled) > FLAT * sphere or factor <= LOWERED:
            return None
        return factor

    def _result(
        self,
        attempts: Attempts,
        end: ContinuationResult,
        load: LoadCase,
        snapped: bool | None,
        critical: float | None,
        *,
        trial: bool,
        direct: bool,
    ) -> EquilibriumResult:
        """Return the result at the last state, under its fraction of the load (collective)."""
        model, state = self.model, end.state
        load_factor = end.load_factor or 0.0
        model.set_load(load.scaled(load_factor))
        state.setflags(write=False)
        volumes = tuple(float(v) for v in model.volumes(state))
        residual = norm(self.skin.comm, model.residual(state)) / self._snes.newton.reference(state)
        condition = condition_of(model, state, snapped, critical)
        if load_factor == 1.0 and condition.sentences and self.log is not None:
            self.log(condition.sentences)
        if load_factor == 1.0 and trial:
            reason = f"A state near an equilibrium was found at {load}; `finish` completes it."
        elif load_factor == 1.0:
            reason = success(model, load, residual, volumes, condition)
        else:
            assert attempts.last is not None
            steps = self._max_steps(trial=trial)
            reason = failure(model, end, load, attempts.last, max_steps=steps, once=direct)
        return EquilibriumResult(
            converged=load_factor == 1.0,
            load_factor=load_factor,
            reason=reason,
            pressure=model.load.largest,
            pressures=tuple(float(p) for p in model.load.pressures),
            state=state,
            positions=model.positions(state),
            energy=model.energy(state),
            volume=sum(volumes),
            volumes=volumes,
            stretch_use=model.bounds.worst(model.corners(state)),
            residual=residual,
            condition=condition,
            smallest_distance=model.gap(state),
            poses=self._poses(state),
            steps=attempts.steps,
            modified_steps=attempts.modified_steps,
            factorisations=attempts.factorisations,
            history=tuple(attempts.history),
            sliding=model.end_step(state),
        )


def _by_pressure_alone(load: LoadCase) -> bool:
    dead = load.force is not None or load.weight_fraction > 0 or load.displacement is not None
    return load.largest > 0 and not dead


def _require_kinds(
    composite: Any, supports: Any, options: Any, log: Any, chambers: Any, weight: Any
) -> None:
    """Check the types of what a solver is made of.

    Raises:
        ParameterError: Naming the one that is of another type.
    """
    nothing = type(None)
    require_kind("composite", composite, Composite, "a Composite, by Composite(fabric, …)")
    require_kind("supports", supports, Supports, "Supports, by clamp(pattern, panels) for instance")
    require_kind("options", options, (NewtonOptions, nothing), "NewtonOptions, or None")
    require_kind("chambers", chambers, (Chambers, nothing), "Chambers, or None for one")
    require_kind("weight", weight, (Weight, nothing), "a Weight, or None for none")
    if log is not None:
        require_callable("log", log, "a function of a Newton step, or None")


def _warn_of_odd_sheets(skin: Skin, composite: Composite) -> None:
    thickness = max(composite.fabric.thickness, composite.reinforcement.thickness)
    if thickness > THICK * skin.pattern.size:
        warn_together(
            skin.comm,
            f"the sheet is {thickness:.3g} m thick and the skin {skin.pattern.size:.3g} m across. "
            "Is the thickness in millimetres? Give it in m: 0.5 mm are 0.5e-3.",
            UnitWarning,
        )
    printed, fabric = (
        sheet.membrane_stiffness for sheet in (composite.reinforcement, composite.fabric)
    )
    if printed < fabric:
        warn_together(
            skin.comm,
            f"the reinforcement, E h = {printed:.3g} N/m, is softer than the fabric, {fabric:.3g} "
            "N/m: a print would weaken it. Are the two exchanged?",
            MaterialWarning,
        )
    if composite.widest_bounds != composite.fabric_bounds:
        warn_together(
            skin.comm,
            f"the stretch bounds are {composite.stated_bounds}: fabric with a print on it "
            "stretches no further than without. Give the reinforcement narrower bounds, or none "
            "of its own.",
            MaterialWarning,
        )
