"""A stable equilibrium of a skin: its numbers, its condition, and the path of equilibria there."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import numpy as np

from toros_fem.base.errors import NoEquilibriumError
from toros_fem.base.mpi import dot, largest, norm
from toros_fem.base.validation import Floats
from toros_fem.mechanics.equilibrium.iteration import NewtonStep
from toros_fem.mechanics.equilibrium.linear_solver import TangentFactor
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.stretch_bounds import singular_values
from toros_fem.mechanics.terms.model import SkinModel

# A hinge folded by more than this angle, in rad, is near the angle where its energy jumps.
FOLDED = math.radians(170)
# Under pressure a skin is blown up where it is stretched by more than this factor and uses more
# than this fraction of the bounds.
BLOWN_UP, USED = 3.0, 0.5
# Fraction of the skin's size by which two states may differ and be the same.
SAME = 1e-6
# A singular tangent within this fraction of the load is near.
NEAR = 0.05
# Change of the load by which the change of the softest curvature is measured, and largest motion
# by it over the skin's size.
LOAD_STEP, MOTION = 1e-3, 1e-4
# Inverse iterations for the softest mode.
ITERATIONS = 12
# Part of the motion that the tangent at the end of a path predicts, where the skin does not jump.
# Behind the jumps of a roof, a lid and an arch it predicts 0.16 at most (docs/solver.md).
EXPLAINED = 0.5


@dataclass(frozen=True, eq=False, repr=False)
class Equilibrium:
    """Result of a solve; later solves, tangents and reactions need nothing else.

    Attributes:
        density: Projected density of the owned triangles, or rows of a relaxed design.
        load: The requested load, on this skin.
        state: Owned unknowns in m, a flat array, as `SkinModel` has them.
        positions: Positions of the owned nodes in m, (n, 3), a view of `state`.
        converged: Whether `state` is a stable equilibrium under the requested load; of a trial,
            whether it is near to one.
        complete: Whether the state was proven stable; `EquilibriumSolver.finish` completes a trial.
        load_factor: Fraction of the requested load that acts on `state`.
        reason: Why the solve ended, as a sentence.
        pressures: Pressure of each chamber in Pa.
        energy: Energy of eq. (8) in J, less the work of dead forces from the assembled positions.
        volumes: Volume of each chamber in m³.
        stretch_use: Largest fraction of the stretch bounds that a triangle uses, < 1.
        residual: Norm of the first variation over the applied load.
        condition: Whether it may have snapped, is near a limit point, blown up or folded.
        smallest_distance: Smallest distance in m between faces of skin, bodies and ground,
            positive; at most the distance from which on contact acts. None without contact.
        poses: Poses of all bodies, a row of six for each: translation in m, rotation vector in
            rad. None without bodies.
        steps: Number of Newton steps, each with the tangent at its state.
        modified_steps: Number of modified Newton steps, with an older tangent.
        factorisations: Number of factorisations of the tangent, retries with a shift included.
        history: One row for each step of either kind, and one that ends each solve.
        begin: Where the skin stuck at the begin of the step; None for a skin at rest, and without
            friction.
        sliding: Where it sticks to ground and bodies now, for the next step of a path; None without
            friction.
        before: Of a trial the equilibrium that it came from, by which its path is judged.
    """

    density: Floats
    load: Load
    state: Floats
    positions: Floats
    converged: bool
    complete: bool
    load_factor: float
    reason: str
    pressures: tuple[float, ...]
    energy: float
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
    begin: Floats | None = None
    sliding: Floats | None = None
    before: PathPoint | None = None

    @property
    def pressure(self) -> float:
        """Pressure of `state` in Pa, the largest of all chambers."""
        return max(self.pressures)

    @property
    def volume(self) -> float:
        """Enclosed volume in m³."""
        return sum(self.volumes)

    @property
    def point(self) -> PathPoint:
        """Its design, load and state."""
        return PathPoint(self.density, self.load, self.state)

    def __repr__(self) -> str:
        pressures = ", ".join(f"{pressure:.4g} Pa" for pressure in self.pressures)
        return f"Equilibrium({pressures}, {self.volume:.4g} m³, {self.steps} steps: {self.reason})"

    def numbers(self) -> dict[str, Any]:
        """Return all numbers that JSON can hold; `numbers_read` makes them fields again."""
        numbers = {name: getattr(self, name) for name in SAVED}
        numbers["condition"] = asdict(self.condition)
        numbers["history"] = [asdict(row) for row in self.history]
        numbers["begin"] = None if self.begin is None else self.begin.tolist()
        numbers["weight_fraction"] = self.load.weight_fraction
        return numbers


# Fields that are saved as they are.
SAVED = tuple(
    each.name
    for each in fields(Equilibrium)
    if each.type in ("bool", "int", "float", "str", "float | None")
    or each.name in ("pressures", "volumes", "poses")
)


def numbers_read(numbers: Mapping[str, Any]) -> dict[str, Any]:
    """Return fields of an equilibrium from `Equilibrium.numbers`, which may have been JSON."""
    values: dict[str, Any] = {key: numbers[key] for key in SAVED}
    values |= {key: tuple(numbers[key]) for key in ("pressures", "volumes")}
    if numbers["poses"] is not None:
        values["poses"] = tuple(tuple(pose) for pose in numbers["poses"])
    values["condition"] = Condition(**numbers["condition"])
    values["history"] = tuple(NewtonStep(**row) for row in numbers["history"])
    anchors = numbers["begin"]
    values["begin"] = None if anchors is None else np.array(anchors)
    return values


class EquilibriumError(NoEquilibriumError):
    """No equilibrium was found; `result` holds the last good state and the history."""

    def __init__(self, message: str, result: Equilibrium) -> None:
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


def readings(model: SkinModel, state: Floats) -> dict[str, Any]:
    """Return the fields that the model tells of a state under its load (collective)."""
    volumes, contact, poses = tuple(float(v) for v in model.volumes(state)), model.contact, None
    if contact is not None and len(contact.poses):
        poses = tuple(tuple(map(float, pose)) for pose in contact.poses_of(state))
    return {
        "state": state,
        "positions": model.positions(state),
        "pressures": tuple(float(p) for p in model.load.pressures),
        "energy": model.energy(state),
        "volumes": volumes,
        "stretch_use": model.bounds.worst(model.corners(state)),
        "smallest_distance": None if contact is None else contact.gap(state),
        "poses": poses,
    }


@dataclass(frozen=True)
class Condition:
    """What a user should know of an equilibrium before trusting it.

    Attributes:
        snapped: Whether the skin may have jumped on the way from its start: the tangent does not
            lead back there. None where the start is no equilibrium of this design that the solver
            knows, and of trials.
        critical_load: Factor on the load at which the tangent is expected to be singular, a limit
            point or a bifurcation, if that is within 5 % of the load; otherwise None. Trials do
            not look for it.
        blown_up: Whether a pressure stretches the skin to more than three times its length and
            nothing but the stretch bounds holds it.
        folded_edges: Number of edges that are folded by more than 170 degrees; 0 with
            self-contact, where layers may lie on each other.
        inside_out: What encloses a negative volume, in words; empty if nothing does.
    """

    snapped: bool | None = None
    critical_load: float | None = None
    blown_up: bool = False
    folded_edges: int = 0
    inside_out: str = ""

    @property
    def sentences(self) -> str:
        """What is not as usual, as sentences; empty where all is."""
        sentences = []
        if self.snapped:
            sentences.append(
                "The skin may have snapped: its tangent here does not lead back to the start."
            )
        if self.critical_load is not None:
            sentences.append(
                "It is near a limit point or a bifurcation, expected at about "
                f"{self.critical_load:.3f} times the load: small changes may move it far."
            )
        if self.blown_up:
            sentences.append(
                "The skin is blown up: only the stretch bounds hold it. Lower the pressure, or set "
                "the bounds c1 and c2 that the cloth has."
            )
        if self.folded_edges:
            sentences.append(
                f"{self.folded_edges} edges are folded by more than {math.degrees(FOLDED):.0f} "
                "degrees: the skin lies on itself there, as this solve has no self-contact."
            )
        if self.inside_out:
            sentences.append(self.inside_out)
        return " ".join(sentences)


def condition_of(
    model: SkinModel, state: Floats, snapped: bool | None, critical: float | None
) -> Condition:
    """Return the condition of an equilibrium under the load that acts (collective)."""
    corners = model.corners(state)
    big, _ = singular_values(model.bounds.gradient(corners))
    comm = model.skin.comm
    stretch = largest(comm, float(big.max(initial=0.0)))
    held = stretch > BLOWN_UP and model.bounds.worst(corners) > USED
    return Condition(
        snapped=snapped,
        critical_load=critical,
        blown_up=model.load.largest > 0 and held,
        folded_edges=folds(model, state),
        inside_out=_inside_out(model, model.volumes(state)),
    )


def folds(model: SkinModel, state: Floats) -> int:
    """Return the number of edges at which the skin lies on itself, and nothing hinders it."""
    if model.contact is not None and model.contact.self_contact:
        return 0
    return model.count_folds(state, FOLDED) // 2  # each edge is seen from both sides


def _inside_out(model: SkinModel, volumes: Floats) -> str:
    if model.pressure is None or not len(volumes) or volumes.min() >= 0:
        return ""
    chambers, least = model.pressure.chambers, f"{volumes.min():.3g} m³"
    if chambers is None:
        return (
            f"But the skin has a volume of {least}: it is turned inside out, or its triangles "
            "face inwards. Reverse them, or look at the shape."
        )
    return (
        f"But chamber {chambers.names[int(volumes.argmin())]!r} has a volume of {least}: its wall, "
        "which has no stiffness, crosses the skin. Lower the difference of the pressures, or "
        "stiffen the skin where the wall is fixed."
    )


@dataclass(frozen=True, eq=False)
class PathPoint:
    """A stable equilibrium of one density and one load, by its owned unknowns."""

    density: Floats
    load: Load
    state: Floats


def may_snap(model: SkinModel, factor: TangentFactor, begin: PathPoint, end: PathPoint) -> bool:
    """Return whether the skin may jump between two equilibria (collective).

    Behind a jump the path leads elsewhere: its tangent predicts little of the motion. Near a limit
    point it predicts too much. Model and factors are those of the end, before and after.
    """
    comm, back = model.skin.comm, begin.state - end.state
    farthest = largest(comm, float(np.abs(back).max(initial=0.0)))
    if farthest <= SAME * model.skin.pattern.size:
        return False
    # Prescribed positions move the fixed components without any force on the free ones.
    with_supports = np.where(model.free, end.state, begin.state)
    predicted = motion_to(model, factor, end, replace(begin, state=with_supports))
    back = back * model.free
    return not dot(comm, predicted, back) >= EXPLAINED * dot(comm, back, back)


def critical_load(model: SkinModel, factor: TangentFactor, at: PathPoint) -> float | None:
    """Return the factor on the load at which the tangent K is expected to be singular (collective).

    The softest mode φ of K and the change of φ·Kφ along the path of equilibria under load give a
    linear estimate. It is exact to first order at a bifurcation. At a limit point the curvature
    falls as a root, so that the true distance is about half of the estimated one. K, its factors
    and the model are those of the point. The result is within NEAR of 1; None if it is not, or if
    supports or bodies move.
    """
    held = at.load.displacement is not None or at.load.gradient is not None
    if not at.load or held or at.load.moves_bodies:
        return None
    comm, size = model.skin.comm, model.skin.pattern.size
    along = factor.solve(model.applied_load(at.state))  # dx/d(load factor)
    farthest = largest(comm, float(np.abs(along).max(initial=0.0)))
    step = min(LOAD_STEP, MOTION * size / max(farthest, 1e-300))
    weights = factor.scale.copy()
    mode: Floats = along
    for _ in range(ITERATIONS):
        length = norm(comm, mode)
        if not (np.isfinite(length) and length > 0):
            return None
        mode = factor.solve(np.asarray(weights * mode / length))
    now = dot(comm, mode, factor.multiply(mode))
    curvature = [0.0, 0.0]
    for k, sign in enumerate((-1, 1)):
        model.set_load(at.load.scaled(1 + sign * step))
        factor.assemble(at.state + sign * step * along)
        curvature[k] = dot(comm, mode, factor.multiply(mode))
    model.set_load(at.load)
    factor.assemble(at.state)
    change = (curvature[1] - curvature[0]) / (2 * step)
    if not (np.isfinite(change) and abs(now) <= NEAR * abs(change)):
        return None
    return 1 - now / change


def motion_to(model: SkinModel, factor: TangentFactor, here: PathPoint, there: PathPoint) -> Floats:
    """Return the motion to another design and load that the tangent at a point predicts.

    The state of `there` is that of `here` with the supports where they are there; 0 is returned
    where it is not admissible. Model and factors are those of `here`, before and after
    (collective).
    """
    model.set_density(there.density)
    model.set_load(there.load)
    feasible = model.admits(there.state)
    motion = -factor.solve(model.residual(there.state)) if feasible else np.zeros_like(here.state)
    model.set_density(here.density)
    model.set_load(here.load)
    return motion
