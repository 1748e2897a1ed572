"""Load case of a skin: pressures, dead forces, weight and moved supports, and its checks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import checked_floats, real_numbers, require_finite
from toros_fem.mechanics.skin.supports import Supports, require_displacement
from toros_fem.meshes.pattern import Pattern


@dataclass(frozen=True, eq=False)
class LoadCase:
    """Everything that acts on a skin.

    Attributes:
        pressures: Pressure of each chamber in Pa, (k,).
        force: Dead forces in N on all assembled vertices, (n, 3); None for none.
        displacement: Displacement in m of the fixed components from their assembled positions,
            for all assembled vertices, (n, 3); None leaves them there.
        weight_fraction: Fraction of the skin's own weight that acts; the skin's `Weight` says
            how heavy it is.
        poses: Poses of rigid bodies, (k, 6): translation in m and rotation vector in rad from
            where they were made; None leaves them there.
        bodies_fraction: Fraction of the weight of free bodies that acts.
    """

    pressures: Floats
    force: Floats | None = None
    displacement: Floats | None = None
    weight_fraction: float = 0.0
    poses: Floats | None = None
    bodies_fraction: float = 0.0

    def __bool__(self) -> bool:
        dead = self.force is not None or self.weight_fraction > 0 or self.bodies_fraction > 0
        return self.largest > 0 or dead or self.displacement is not None

    def __str__(self) -> str:
        parts = []
        if self.largest > 0 or not self:
            parts.append(" and ".join(f"{p:g}" for p in self.pressures) + " Pa")
        if self.force is not None:
            total = np.linalg.norm(self.force, axis=1).sum()
            parts.append(f"forces of {total:.4g} N in total")
        if self.weight_fraction > 0:
            parts.append(f"{_percent(self.weight_fraction)}its own weight")
        if self.bodies_fraction > 0:
            parts.append(f"{_percent(self.bodies_fraction)}the weight of bodies")
        if self.displacement is not None:
            farthest = np.linalg.norm(self.displacement, axis=1).max()
            parts.append(f"supports moved by up to {farthest:.4g} m")
        if self.poses is not None and self.poses.any():
            farthest = np.linalg.norm(self.poses[:, :3], axis=1).max()
            parts.append(f"bodies moved by up to {farthest:.4g} m")
        return " and ".join(parts) or "no load"

    @property
    def largest(self) -> float:
        """Largest pressure in Pa."""
        return float(np.max(self.pressures))

    def scaled(self, load_factor: float) -> LoadCase:
        """Return the load case times a load factor."""
        return LoadCase(np.zeros_like(self.pressures)).towards(self, load_factor)

    def towards(self, other: LoadCase, fraction: float) -> LoadCase:
        """Return the load case that lies a fraction of the way towards another one."""
        mine, theirs = self.weight_fraction, other.weight_fraction
        heavy, heavier = self.bodies_fraction, other.bodies_fraction
        return LoadCase(
            self.pressures + fraction * (other.pressures - self.pressures),
            _between(self.force, other.force, fraction),
            _between(self.displacement, other.displacement, fraction),
            mine + fraction * (theirs - mine),
            _between(self.poses, other.poses, fraction),
            heavy + fraction * (heavier - heavy),
        )


def _between(one: Floats | None, other: Floats | None, fraction: float) -> Floats | None:
    """Interpolate linearly; None is zero."""
    if one is None and other is None:
        return None
    begin, end = (np.zeros(1) if values is None else values for values in (one, other))
    return np.asarray(begin + fraction * (end - begin))


def _percent(fraction: float) -> str:
    return "" if fraction == 1 else f"{100 * fraction:.3g} % of "


def make_load_case(
    pattern: Pattern,
    supports: Supports,
    chambers: int,
    pressure: float | Sequence[float] | Floats,
    *,
    force: Floats | None = None,
    displacement: Floats | None = None,
    weight_fraction: float = 0.0,
    poses: Floats | None = None,
    bodies_fraction: float = 0.0,
) -> LoadCase:
    """Return a load case that fits a skin; all arguments are the same on every rank.

    Args:
        pattern: The skin's pattern.
        supports: The skin's supports.
        chambers: Number of pressure chambers.
        pressure: In Pa, ≥ 0, one for all chambers or one for each.
        force: Dead forces in N on all assembled vertices, (n, 3); None for none.
        displacement: Displacement of the fixed components in m, (n, 3); None takes that of the
            supports.
        weight_fraction: Fraction of the skin's own weight that acts.
        poses: Poses of rigid bodies, as `mechanics.contact.settings.poses_of` returns them.
        bodies_fraction: Fraction of the weight of free bodies that acts.

    Raises:
        ParameterError: A pressure is negative or not finite, or an array does not fit.
        OpenSkinError: Pressure on a skin with free edges that no symmetry plane closes.
    """
    what = "in Pa, one for all chambers or one for each"
    values = real_numbers("pressure", pressure, what)
    require_finite(weight_fraction=weight_fraction)
    if not (np.isfinite(values) & (values >= 0)).all():
        wrong = values[~(np.isfinite(values) & (values >= 0))].ravel()[0]
        raise ParameterError(f"pressure = {float(wrong)} Pa must be finite and at least 0.")
    if values.shape not in ((), (chambers,)):
        raise ParameterError(
            f"pressure has shape {values.shape}; it must be one number in Pa, or one for each of "
            f"the {chambers} chambers."
        )
    if values.any() and not supports.close(pattern):
        pattern.require_closed()
    points = pattern.points.shape
    if force is not None:
        force = checked_floats("force", force, f"finite and of shape {points}, in N", points)
    if displacement is None:
        displacement = supports.displacement
    else:
        displacement = require_displacement(displacement, points)
        moved = replace(supports, displacement=displacement)
        if moved.close(pattern) != supports.close(pattern):
            raise ParameterError(
                "the displacement moves a border out of its symmetry plane; move it in the plane "
                "only, or simulate the whole skin."
            )
    return LoadCase(
        np.full(chambers, values),
        _copy(force),
        _copy(displacement),
        float(weight_fraction),
        _copy(poses),
        float(bodies_fraction),
    )


def _copy(values: Floats | None) -> Floats | None:
    return None if values is None else np.array(values, dtype=np.float64)
