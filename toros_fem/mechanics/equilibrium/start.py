"""Start of a solve: inside the stretch bounds, and where contact can act."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Bools, Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import on_first_rank, together
from toros_fem.base.validation import real_numbers
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.assembly.model import SkinModel
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.stretch_bounds import StretchBounds
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.triangles import harmonic_extension

# Fraction of the bounds above which a triangle is relaxed.
RELAXED = 0.95
# Number of relaxations, each over one more ring of triangles around.
ROUNDS = 8


def start_state(model: SkinModel, start: Floats | None) -> Floats:
    """Return a start as owned unknowns, from these or from positions (n, 3) (collective).

    None is the state at rest. Where triangles leave the stretch bounds it is relaxed until they are
    inside; a ParameterError is raised if it cannot be.
    """
    skin, state = model.skin, model.assembled
    unknowns, nodes = state.shape, model.positions(state).shape
    with together(skin.comm):
        if start is not None:
            start = real_numbers("start", start, "unknowns, or positions (n, 3), in m")
            if start.shape not in (unknowns, nodes):
                raise ParameterError(
                    f"start has shape {start.shape}; on this rank it must be {unknowns}, the "
                    f"unknowns of this bending term, or {nodes}, positions."
                )
    if start is not None and start.ndim == 2:
        state = model.state_of(start)
    elif start is not None:
        state = start.copy()
        if model.contact is not None:
            state = model.contact.with_short_turns(start)
    use = model.bounds.worst_of_start(model.corners(state))
    if start is not None and 1 <= use < np.inf:
        inside = relaxed_start(model, skin.gather_vertices(model.positions(state)))
        if inside is not None:
            model.positions(state)[:] = inside[skin.owned_vertices]
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


def relaxed_start(model: SkinModel, positions: Floats) -> Floats | None:
    """Return positions of all vertices inside the stretch bounds, or None (collective)."""
    pattern, fixed = model.skin.pattern, model.supports.fixed
    return on_first_rank(
        model.skin.comm, lambda: relaxed_into_bounds(pattern, model.composite, fixed, positions)
    )


def require_apart(model: SkinModel, state: Floats, load: Load, *, cold: bool) -> None:
    """Check that contact can act on a start, with bodies at their poses or where made."""
    model.set_load(load)
    refusal = model.refusal(state)
    if refusal is None:
        return
    if load.moves_bodies:  # they are moved in with the load
        model.set_load(load.scaled(0.0))
        if model.refusal(state) is None:
            return
    what, remedy = "start", "Start from the assembled positions, or from another equilibrium."
    if cold:
        what = "assembled shape, from which a solve starts,"
        remedy = "Make ground and bodies further away."
    raise ParameterError(f"contact cannot act on the {what}: {refusal}. {remedy}")


def relaxed_into_bounds(
    pattern: Pattern, composite: Composite, fixed: Bools, positions: Floats
) -> Floats | None:
    """Return a shape inside the stretch bounds, near a shape that leaves them in some triangles.

    A shape that is interpolated from a coarser mesh stretches the few triangles most that lie
    across a kink of it. Around these the map from the flat panels is made harmonic. Of two
    materials the wider bounds count: into the narrower ones a solve takes the shape by itself.
    Fixed components, (n, 3), keep their positions. None where the bounds cannot be met in this way.
    """
    triangles = pattern.triangles
    widest, wrinkles = composite.widest_bounds, composite.membrane.relaxed
    bounds = StretchBounds(MPI.COMM_SELF, pattern.corners, *widest, wrinkles=wrinkles)
    found, laplacian = np.array(positions), None
    for rings in range(1, ROUNDS + 1):
        use = bounds.use(found[triangles])
        if use.max(initial=0.0) <= RELAXED:
            break
        if laplacian is None:
            laplacian = pattern.flat_laplacian()
        near = np.zeros(len(found), dtype=bool)
        near[triangles[~(use <= RELAXED)]] = True
        for _ in range(rings):
            near[triangles[near[triangles].any(axis=1)]] = True
        for k in range(3):
            extend = harmonic_extension(laplacian, ~near | fixed[:, k])
            found[:, k] = extend(found[:, k])
    return found if bounds.worst(found[triangles]) < 1 else None
