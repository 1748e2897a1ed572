"""What acts on a skin: pressures, dead forces, weight, moved supports and bodies, mean stretch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from toros_fem.base.errors import ParameterError, PatternError
from toros_fem.base.validation import Floats, checked_floats, require_finite
from toros_fem.mechanics.skin.supports import Planes
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.triangles import surface_areas

if TYPE_CHECKING:
    from toros_fem.mechanics.terms.model import SkinModel

# Volume over the area to the power of 1.5 below which, with a minus, a skin faces inwards; others
# are flat, but for rounding. A ball has 0.09.
INWARDS = 1e-4

# Mean deformation gradient of a tile that is as flat as it was made.
UNSTRETCHED = np.eye(3)[:, :2]

# A number, or one for each chamber, in Pa.
Pressure = float | Sequence[float] | Floats


@dataclass(frozen=True, eq=False)
class Load:
    """Everything that acts on a skin; the same on every rank.

    Attributes:
        pressure: In Pa, ≥ 0, one for all chambers or one for each.
        force: Dead forces in N on all assembled vertices, (n, 3); None for none.
        displacement: Displacement in m of the fixed components from their assembled positions,
            for all assembled vertices, (n, 3); None takes that of the supports.
        weight_fraction: Fraction of the skin's own weight that acts, whose `Weight` says how heavy
            it is; None for all of it.
        poses: Poses of the contact's bodies, (k, 6): translation in m and rotation vector in rad
            from where they were made, not read for free bodies. None leaves them there.
        gradient: Mean deformation gradient F̄ of a tile, (3, 2), as of `Periodic`, of which the
            prescribed components are read; None is that of the flat sheet.
        angle: Angle in rad from the first axis of a tile's flat sheet to the direction n of F̄.
    """

    pressure: Pressure = 0.0
    force: Floats | None = None
    displacement: Floats | None = None
    weight_fraction: float | None = None
    poses: Floats | None = None
    gradient: Floats | None = None
    angle: float = 0.0

    def on(self, model: SkinModel) -> Load:
        """Return the load with all arrays of a skin, checked; weights that it lacks are 0.

        Raises:
            PatternError: Pressure on a skin with free edges that no symmetry plane closes. Pressure
                on a skin that faces inwards.
        """
        pattern, supports, chambers = model.skin.pattern, model.supports, model.chamber_count
        what = "in Pa, one for all chambers or one for each"
        shapes = ((), (chambers,))
        values = checked_floats(
            "pressure", self.pressure, what, lambda shape: shape in shapes, finite=False
        )
        weight = 1.0 if self.weight_fraction is None else self.weight_fraction
        require_finite(weight_fraction=weight)
        admissible = np.isfinite(values) & (values >= 0)
        if not admissible.all():
            wrong = float(values[~admissible].ravel()[0])
            raise ParameterError(f"pressure = {wrong} Pa must be finite and at least 0.")
        planes, points = Planes(pattern, supports), pattern.points.shape
        if values.any():
            if not planes.close:
                pattern.require_closed()
            if chambers == 1:
                _require_outwards(pattern, planes)
        force = self.force
        if force is not None:
            what = f"finite and of shape {points}, in N"
            force = checked_floats("force", force, what, points).copy()
        if self.displacement is not None:
            supports = replace(supports, displacement=self.displacement)
            if planes.close and planes.moved_out(Planes(pattern, supports)):
                raise ParameterError(
                    "the displacement moves a border out of the plane that closes it; move it in "
                    "the plane only, assemble it elsewhere, or simulate the whole skin."
                )
        moved, gradient = supports.displacement, self.gradient
        require_finite(angle=self.angle)
        if gradient is not None:
            if model.images is None:
                raise ParameterError("gradient is given, but the skin is no tile that repeats.")
            what = "finite and of shape (3, 2), the mean deformation gradient"
            gradient = checked_floats("gradient", gradient, what, (3, 2)).copy()
        return Load(
            np.full(chambers, values),
            force,
            None if moved is None else moved.copy(),
            0.0 if model.weight is None else float(weight),
            _poses(0 if model.contact is None else len(model.contact.poses), self.poses),
            gradient,
            float(self.angle),
        )

    def __bool__(self) -> bool:
        moved = self.displacement is not None or self.gradient is not None or self.moves_bodies
        return bool(self.largest > 0 or self.force is not None or self.weight > 0 or moved)

    def __str__(self) -> str:
        parts = []
        if self.largest > 0 or not self:
            parts.append(" and ".join(f"{p:g}" for p in self.pressures) + " Pa")
        if self.force is not None:
            total = np.linalg.norm(self.force, axis=1).sum()
            parts.append(f"forces of {total:.4g} N in total")
        if self.weight > 0:
            share = "" if self.weight == 1 else f"{100 * self.weight:.3g} % of "
            parts.append(f"{share}its own weight")
        if self.displacement is not None:
            farthest = np.linalg.norm(self.displacement, axis=1).max()
            parts.append(f"supports moved by up to {farthest:.4g} m")
        poses = _zero(self.poses)
        if poses.any():
            farthest = np.linalg.norm(poses[:, :3], axis=1).max()
            parts.append(f"bodies moved by up to {farthest:.4g} m")
        if self.gradient is not None:
            at = f"{np.degrees(self.angle):.4g} degrees"
            parts.append(f"the mean deformation {self.gradient[:2].tolist()} along {at}")
        return " and ".join(parts) or "no load"

    @property
    def pressures(self) -> Floats:
        """Pressure of each chamber in Pa, (k,)."""
        return np.atleast_1d(np.asarray(self.pressure, dtype=np.float64))

    @property
    def weight(self) -> float:
        """Fraction of the skin's own weight, 0 where none is set yet."""
        return self.weight_fraction or 0.0

    @property
    def largest(self) -> float:
        """Largest pressure in Pa."""
        return float(self.pressures.max())

    @property
    def pressure_alone(self) -> bool:
        """Whether pressures act, without forces, weight, or supports that move."""
        dead = self.force is not None or self.weight > 0 or self.displacement is not None
        return self.largest > 0 and not dead

    @property
    def moves_bodies(self) -> bool:
        """Whether bodies are elsewhere than where they were made."""
        return bool(_zero(self.poses).any())

    def moves_from(self, other: Load) -> bool:
        """Return whether supports or bodies are elsewhere under another load."""
        pairs = ((self.poses, other.poses), (self.displacement, other.displacement))
        return not all(np.array_equal(_zero(a), _zero(b)) for a, b in pairs)

    def scaled(self, load_factor: float) -> Load:
        """Return the load times a load factor."""
        return Load(np.zeros_like(self.pressures)).towards(self, load_factor)

    def towards(self, other: Load, fraction: float) -> Load:
        """Return the load that lies a fraction of the way towards another one; None is zero."""

        def between(one: Any, two: Any) -> Any:
            return one + fraction * (two - one)

        def arrays(one: Floats | None, two: Floats | None, rest: Any = 0.0) -> Floats | None:
            if one is None and two is None:
                return None
            return np.asarray(between(*(np.asarray(rest if a is None else a) for a in (one, two))))

        return Load(
            between(self.pressures, other.pressures),
            arrays(self.force, other.force),
            arrays(self.displacement, other.displacement),
            between(self.weight, other.weight),
            arrays(self.poses, other.poses),
            arrays(self.gradient, other.gradient, UNSTRETCHED),
            other.angle,
        )


def load_of(given: Load | Pressure) -> Load:
    """Return a load as it is, or that of a pressure in Pa."""
    return given if isinstance(given, Load) else Load(given)


def _require_outwards(pattern: Pattern, planes: Planes) -> None:
    """Check that a skin which planes close does not face inwards, as far as its volume tells.

    Flat skins enclose nothing yet. Where a lid is to be counted its side is not known.
    """
    if planes.lids() or len(planes.rims()):
        return
    a, b, c = np.moveaxis(pattern.points[pattern.triangles] - planes.origin, 1, 0)
    volume = float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)
    if volume < -INWARDS * float(surface_areas(pattern.points, pattern.triangles).sum()) ** 1.5:
        raise PatternError(
            f"the skin faces inwards: as assembled, its volume is {volume:.3g} m³, so that a "
            "pressure would turn it inside out. Reverse its triangles: swap two corners of each."
        )


def _poses(bodies: int, poses: Floats | None) -> Floats | None:
    """Return the poses of so many bodies, zero where none are given; None without bodies."""
    if poses is None:
        return np.zeros((bodies, 6)) if bodies else None
    if not bodies:
        raise ParameterError("poses are given, but there are no bodies to move.")
    what = f"finite and of shape ({bodies}, 6): translation in m, rotation vector in rad"
    return checked_floats("poses", poses, what, (bodies, 6)).copy()


def _zero(values: Floats | None) -> Floats:
    return np.zeros(1) if values is None else np.asarray(values, dtype=np.float64)
