"""Condition of an equilibrium, and sentences that say why a solve ended."""

from __future__ import annotations

import math
from dataclasses import dataclass

from petsc4py import PETSc

from toros_fem.base.array_types import Floats
from toros_fem.base.mpi import largest
from toros_fem.mechanics.assembly.model import SkinModel
from toros_fem.mechanics.equilibrium.continuation import ContinuationResult
from toros_fem.mechanics.equilibrium.iteration import NO_NUMBER, STAGNATED
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.stretch_bounds import singular_values

# A hinge folded by more than this angle, in rad, is near the angle where its energy jumps.
FOLDED = math.radians(170)
# Under pressure a skin is blown up where it is stretched by more than this factor and uses more
# than this fraction of the bounds.
BLOWN_UP, USED = 3.0, 0.5

_REASON = PETSc.SNES.ConvergedReason
# Why a solve found nothing, by PETSc's reason; the last six where an option chose its method.
WHY = {
    int(_REASON.DIVERGED_MAX_IT): "Newton's method took {max_steps} steps without converging",
    int(_REASON.DIVERGED_LINE_SEARCH): "no step lowered the energy any more",
    int(_REASON.DIVERGED_INNER): "the stationary state is not stable",
    int(_REASON.DIVERGED_FUNCTION_DOMAIN): (
        "surfaces overlap at the start, or triangles leave the stretch bounds there"
    ),
    NO_NUMBER: "forces are no numbers any more",
    int(_REASON.DIVERGED_LINEAR_SOLVE): "the linear solver that an option chose failed",
    int(_REASON.DIVERGED_FUNCTION_COUNT): "the limit of an option on evaluations was reached",
    int(_REASON.DIVERGED_LOCAL_MIN): "the norm of the forces has a minimum that is not 0",
    int(_REASON.DIVERGED_TR_DELTA): "the trust region shrank to nothing",
    -13: "the step of an option's method leaves the stretch bounds",  # of the objective, PETSc 3.25
    -14: "the step of an option's method leaves the stretch bounds",
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
        found = []
        if self.snapped:
            found.append(
                "The skin may have snapped: its tangent here does not lead back to the start."
            )
        if self.critical_load is not None:
            found.append(
                "It is near a limit point or a bifurcation, expected at about "
                f"{self.critical_load:.3f} times the load: small changes may move it far."
            )
        if self.blown_up:
            found.append(
                "The skin is blown up: only the stretch bounds hold it. Lower the pressure, or set "
                "the bounds c1 and c2 that the cloth has."
            )
        if self.folded_edges:
            found.append(
                f"{self.folded_edges} edges are folded by more than {math.degrees(FOLDED):.0f} "
                "degrees: the skin lies on itself there, as this solve has no self-contact."
            )
        if self.inside_out:
            found.append(self.inside_out)
        return " ".join(found)


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
        folded_edges=_folds(model, state),
        inside_out=_inside_out(model, model.volumes(state)),
    )


def _folds(model: SkinModel, state: Floats) -> int:
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


def success(load: Load, residual: float, condition: Condition) -> str:
    """Return the sentence for an equilibrium, with warnings: rounding, a crossed wall, a snap."""
    found = f"A stable equilibrium was found at {load}."
    if condition.sentences:
        found += f" {condition.sentences}"
    if residual > STAGNATED:
        found += f" Rounding leaves a residual of {residual:.0e} of the load."
    return found


def failure(
    model: SkinModel,
    end: ContinuationResult,
    load: Load,
    tried: Floats,
    *,
    max_steps: int,
    once: bool,
) -> str:
    """Return the sentence for a failure: why, how far the load came, the remedy (collective).

    `end` is the last equilibrium, and `tried` the state where the last attempt ended; `once` tells
    that there was one attempt at the full load, without continuation.
    """
    why = WHY.get(end.outcome, f"PETSc's SNES ended by reason {end.outcome}")
    why = why.format(max_steps=max_steps)
    bounds = model.composite.stated_bounds
    begin = f"No equilibrium inside the stretch bounds ({bounds}) was found at {load}, at "
    begin += f"once{'' if once else ' or by raising the load'}"
    begin += f": {why}."
    folds = _folds(model, tried)
    if folds:
        begin += (
            f" Where the last attempt ended {folds} edges are folded by more than "
            f"{math.degrees(FOLDED):.0f} degrees: the skin collapses onto itself there. Give the "
            "solver a Contact. A skin sewn from flat layers needs hinged seams."
        )
    steps_failed = end.outcome != int(PETSc.SNES.ConvergedReason.DIVERGED_FUNCTION_DOMAIN)
    flat = model.images is not None  # a tile that is kept in its plane
    if steps_failed and model.composite.bending is None and not flat and not load.pressures.any():
        begin += (
            " A sheet without bending gives way to any compression. Give it bending, or, if it is "
            "closed, a pressure that tightens it."
        )
    if once:
        return f"{begin} Solve without trial = True, which also tries continuation."
    if end.load_factor is None:
        return (
            f"{begin} There was none under a lower load either; the state is the start. "
            "Check materials and supports, start from a neighbouring equilibrium, allow more "
            "steps, or refine the mesh."
        )
    use = model.bounds.worst(model.corners(end.state))
    return (
        f"{begin} The last equilibrium is at {load.scaled(end.load_factor)}, "
        f"{100 * end.load_factor:.3g} % of the load, where the most stretched triangle "
        f"uses {100 * use:.1f} % of the bounds. "
        "Lower the load to about that, stiffen the skin, or refine the mesh where it is most "
        "stretched."
    )
