"""Why a solve ended, as a sentence."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from petsc4py import PETSc

from toros_fem._types import Floats
from toros_fem.equilibrium.newton import STAGNATED
from toros_fem.equilibrium.options import NewtonOptions
from toros_fem.mechanics.load_case import LoadCase
from toros_fem.mechanics.model import SkinModel

# A hinge folded by so much, in rad, is near the angle where its energy jumps.
FOLDED = math.radians(170)


def success(model: SkinModel, load: LoadCase, residual: float, volumes: Sequence[float]) -> str:
    """What was found, and whether rounding or a wall that crosses the skin spoils it."""
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
    options: NewtonOptions,
    outcome: int,
    load: LoadCase,
    load_factor: float | None,
    state: Floats,
    tried: Floats,
) -> str:
    """Why nothing was found, how far it came, and what to do (collective).

    Args:
        model: The scene.
        options: How hard was tried.
        outcome: How the last attempt ended, a converged reason of SNES.
        load: The load asked for.
        reached: Which share of it the last equilibrium bears; None if there is none.
        state: That equilibrium.
        tried: Where the last attempt ended.
    """
    why = {
        int(PETSc.SNES.ConvergedReason.DIVERGED_MAX_IT): (
            f"Newton's method took {options.max_steps} steps without converging"
        ),
        int(PETSc.SNES.ConvergedReason.DIVERGED_INNER): "what was found is not stable",
    }.get(outcome, "no step lowered the energy any more")
    bounds = f"c1 = {model.composite.c1:g}, c2 = {model.composite.c2:g}"
    begin = f"No equilibrium inside the stretch bounds ({bounds}) was found at {load}, at "
    begin += f"once, by raising the load, or by stiffening the plain fabric: {why}."
    folds = model.folds(tried, FOLDED)
    if folds:  # each edge is seen from both sides
        begin += (
            f" Where the last attempt ended {folds // 2} edges are folded by more than "
            f"{math.degrees(FOLDED):.0f} degrees: the skin collapses onto itself there, and "
            "contact is not modelled. A skin sewn from flat layers wants hinged seams."
        )
    if load_factor is None:
        return (
            f"{begin} Nor was there any under a lower load; the state is the one started from. "
            "Check materials and supports, start from a neighbouring equilibrium, allow more "
            "steps, or refine the mesh."
        )
    use = model.bounds.worst(model.corners(state))
    return (
        f"{begin} The last equilibrium is at {load.scaled(load_factor)}, "
        f"{100 * load_factor:.3g} % of the load, where the most stretched triangle "
        f"uses {100 * use:.1f} % of the bounds. "
        "Lower the load to about that, stiffen the skin, or refine the mesh where it is most "
        "stretched."
    )
