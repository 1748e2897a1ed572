"""What a solve is asked for: loads and start, checked alike on all ranks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from toros_fem._mpi import raise_together
from toros_fem._types import Floats
from toros_fem.errors import ParameterError
from toros_fem.mechanics.load_case import LoadCase
from toros_fem.mechanics.model import SkinModel
from toros_fem.mechanics.supports import require_displacement


def make_load_case(
    model: SkinModel,
    pressure: float | Sequence[float],
    force: Floats | None,
    displacement: Floats | None,
) -> LoadCase:
    """The load that a solve is asked for; the arguments are the same on every rank.

    Args:
        model: The scene.
        pressure: In Pa, of all chambers or of each.
        force: Dead forces in N on all assembled vertices, (n, 3); None for none.
        displacement: Way of held vertices, (n, 3), in m; None takes that of the supports.

    Raises:
        ParameterError: A pressure is negative or not finite, or an array does not fit.
        OpenSkinError: Pressure on a skin with free edges that no symmetry plane closes.
    """
    values, count = np.asarray(pressure, dtype=np.float64), len(model.pressures)
    if not (np.isfinite(values) & (values >= 0)).all():
        shown = ", ".join(str(float(p)) for p in np.atleast_1d(pressure))
        raise ParameterError(f"pressure = {shown} Pa must be finite and at least 0.")
    if values.shape not in ((), (count,)):
        raise ParameterError(
            f"pressure = {pressure} Pa must be one number, or one for each of the {count} chambers."
        )
    pattern = model.skin.pattern
    if values.any() and not model.closed:
        pattern.require_closed()
    points = pattern.points.shape
    if force is not None and not (force.shape == points and np.isfinite(force).all()):
        raise ParameterError(
            f"force has shape {force.shape}; it must be finite and of shape {points}, in N."
        )
    if displacement is None:
        displacement = model.supports.displacement
    else:
        require_displacement(displacement, points)
        if replace(model.supports, displacement=displacement).close(pattern) != model.closed:
            raise ParameterError(
                "the displacement moves a border out of its symmetry plane; move it in the plane "
                "only, or simulate the whole skin."
            )
    weight = 0.0 if model.weight is None else 1.0
    return LoadCase(np.full(count, values), _copy(force), _copy(displacement), weight)


def check_start(model: SkinModel, start: Floats | None) -> None:
    """Check the shape of a start, owned unknowns or positions of owned nodes (collective).

    Raises:
        ParameterError: It fits neither.
    """
    error = None
    unknowns, nodes = (model.size_local,), model.positions(model.assembled).shape
    if start is not None and start.shape not in (unknowns, nodes):
        error = ParameterError(
            f"start has shape {start.shape}; on this rank it must be {unknowns}, the unknowns "
            f"of this bending term, or {nodes}, positions."
        )
    raise_together(model.skin.comm, error)


def _copy(values: Floats | None) -> Floats | None:
    return None if values is None else np.array(values, dtype=np.float64)
