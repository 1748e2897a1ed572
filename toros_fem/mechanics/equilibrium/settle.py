"""From a search to an equilibrium that tells what it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.mpi import largest, norm
from toros_fem.mechanics.assembly.model import SkinModel
from toros_fem.mechanics.contact.sliding import Sliding
from toros_fem.mechanics.equilibrium.continuation import ContinuationResult, NewtonStep
from toros_fem.mechanics.equilibrium.diagnostics import condition_of, failure, success
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium, readings
from toros_fem.mechanics.equilibrium.newton import Newton
from toros_fem.mechanics.equilibrium.path import connect, critical_load
from toros_fem.mechanics.equilibrium.ways import Search, search_equilibrium


def settle(
    search: Search, begin: Sliding | None, log: Callable[[NewtonStep | str], None] | None
) -> Equilibrium:
    """Search for an equilibrium, and read off what it is (collective).

    Friction begins from `begin`; `log` is called with a sentence where something is not as usual.
    """
    model, near, attempts = search.model, search.near, search.attempts
    if model.contact is not None:
        model.contact.begin_step(begin, search.load)
    end = search_equilibrium(search)
    origin = None if near is None else near.origin
    # Between two designs there is no path that a skin takes. Where bodies or supports push it
    # along, the path has been taken step by step. A path with friction is made of its steps.
    if origin is not None and (
        not _same_design(model, origin.density, search.density)
        or (model.contact is not None and search.load.moves_from(origin.load))
        or model.slides
    ):
        origin = None
    snapped = critical = None
    if end.load_factor == 1.0 and not search.trial:
        point = replace(search.target, state=end.state)
        if origin is not None:
            snapped, point = connect(
                model,
                search.newton,
                lambda start, at: attempts(search.prescribed(start, at.displacement)),
                origin,
                point,
                definite=attempts.definite and (near is None or near.definite),
            )
            end = ContinuationResult(point.state, 1.0, end.outcome)
        if origin is not None or not search.direct:
            critical = critical_load(model, search.newton.factor, point)
    found = _read(search, end, snapped, critical, log)
    before = origin if search.trial else None
    return replace(found, begin=begin, before=before, definite=attempts.definite)


def residual_at(model: SkinModel, newton: Newton, state: Floats) -> float:
    """Return the norm of the first variation over the applied load (collective)."""
    return norm(model.skin.comm, model.residual(state)) / newton.reference(state)


def sliding_at(model: SkinModel, state: Floats) -> Sliding | None:
    """Return where the skin sticks at the end of a step; None without friction."""
    return None if model.contact is None else model.contact.end_step(state)


def _same_design(model: SkinModel, one: Floats, two: Floats) -> bool:
    return largest(model.skin.comm, float(np.abs(one - two).max(initial=0.0))) == 0


def _read(
    search: Search,
    end: ContinuationResult,
    snapped: bool | None,
    critical: float | None,
    log: Callable[[NewtonStep | str], None] | None,
) -> Equilibrium:
    """Return the result at the last state, under its fraction of the load (collective)."""
    model, state, load, attempts = search.model, end.state, search.load, search.attempts
    load_factor = end.load_factor or 0.0
    reached = load_factor == 1.0
    model.set_load(load.scaled(load_factor))
    state.setflags(write=False)
    seen, residual = readings(model, state), residual_at(model, search.newton, state)
    condition = condition_of(model, state, snapped, critical)
    if reached and condition.sentences and log is not None:
        log(condition.sentences)
    if reached and search.trial:
        reason = f"A state near an equilibrium was found at {load}; `finish` completes it."
    elif reached:
        reason = success(load, residual, condition)
    else:
        assert attempts.last is not None
        steps, once = search.max_steps, search.direct
        reason = failure(model, end, load, attempts.last, max_steps=steps, once=once)
    return Equilibrium(
        **seen,
        density=search.density,
        load=load,
        converged=reached,
        complete=reached and not search.trial,
        load_factor=load_factor,
        reason=reason,
        residual=residual,
        condition=condition,
        steps=attempts.steps,
        modified_steps=attempts.modified_steps,
        factorisations=attempts.factorisations,
        history=tuple(attempts.history),
        sliding=sliding_at(model, state),
    )
