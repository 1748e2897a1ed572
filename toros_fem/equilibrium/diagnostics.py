"""Sentences that say why a solve ended."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from petsc4py import PETSc

from toros_fem._types import Floats
from toros_fem.equilibrium.continuation import ContinuationResult
from toros_fem.equilibrium.newton import STAGNATED
from toros_fem.mechanics.load_case import LoadCase
from toros_fem.mechanics.model import SkinModel

# A hinge folded by more than this angle, in rad, is near the angle where its energy jumps.
FOLDED = math.radians(170)


def success(model: SkinModel, load: LoadCase, residual: float, volumes: Sequence[float]) -> str:
    """Return the sentence for an equilibrium, with a warning about rounding or a crossed wall."""
    found = f"A stable equilibrium was found at {load}."
    if residual > STAGNATED:
        found += f" Rounding leaves a residual of {residual:.0e} of the load."
    if model.chambers is not None and min(volumes) < 0:
        name = model.chambers.names[int(np.argmin(volumes))]
        found += (
            f" But chamber {name!r} has a volume of {min(volumes):.3g} m³: its wall, which has no "
            "stiffness, crosses the skin. Lower the difference of the pressures, or stiffen the "
            "skin where the wall is fixed."
        )
    return found


def failure(
    model: SkinModel,
    end: ContinuationResult,
    load: LoadCase,
    tried: Floats,
    *,
    max_steps: int,
    once: bool,
) -> str:
    """Return the sentence for a failure: why, how far the load came, the remedy (collective).

    Args:
        model: The skin's model.
        end: Last equilibrium, its load factor, and outcome of the last attempt.
        load: The requested load.
        tried: State where the last attempt ended.
        max_steps: Largest number of steps of an attempt.
        once: Whether there was one attempt at the full load and no continuation.
    """
    why = {
        int(PETSc.SNES.ConvergedReason.DIVERGED_MAX_IT): (
            f"Newton's method took {max_steps} steps without converging"
        ),
        int(PETSc.SNES.ConvergedReason.DIVERGED_INNER): "the stationary state is not stable",
    }.get(end.outcome, "no step lowered the energy any more")
    bounds = f"c1 = {model.composite.c1:g}, c2 = {model.composite.c2:g}"
    begin = f"No equilibrium inside the stretch bounds ({bounds}) was found at {load}, at "
    begin += "once" if once else "once, by raising the load, or by stiffening the plain fabric"
    begin += f": {why}."
    folds = model.count_folds(tried, FOLDED)
    if folds:  # each edge is seen from both sides
        begin += (
            f" Where the last attempt ended {folds // 2} edges are folded by more than "
            f"{math.degrees(FOLDED):.0f} degrees: the skin collapses onto itself there, and "
            "contact is not modelled. A skin sewn from flat layers needs hinged seams."
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
