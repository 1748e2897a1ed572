"""Target shapes, made by deformers of the assembled skin that can be composed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import (
    Floats,
    checked_floats,
    require_callable,
    require_finite,
    require_positive,
    unit_vector,
    vector,
)

# Map from positions, (n, 3) in m, to positions.
Deformer = Callable[[Floats], Floats]

# Largest cosine between two directions that must be perpendicular.
SQUARE = 1e-6
# Largest number of turns of a bend, and of a twist: an angle of more is one in degrees.
BEND_TURNS, TWIST_TURNS = 2, 6


def bend(angle: float, length: float, *, neutral: float = 0.0) -> Deformer:
    """Return a deformer that bends a body along z to constant curvature, towards +x.

    The end z = 0 stays fixed. Every cross-section z = const is rotated rigidly by
    angle · z/length about +y, so that the tip's normal rotates from +z towards +x by `angle`. The
    neutral line x = neutral keeps its length. Material at smaller x is stretched, at larger x
    shortened, by (neutral − x) · angle/length. Beyond the ends z = 0 and z = length the body
    continues straight.

    Args:
        angle: Angle between the two end cross-sections in rad; negative bends towards −x.
        length: Length in m over which the curvature is spread.
        neutral: Position x of the neutral line in m. In a tube of radius R, 0 is the centre line
            and R the inner side of the bend.
    """
    require_finite(neutral=neutral)
    return curl(angle, length, origin=(neutral, 0, 0), along=(0, 0, 1), toward=(1, 0, 0))


def curl(
    angle: float,
    length: float,
    *,
    origin: npt.ArrayLike,
    along: npt.ArrayLike,
    toward: npt.ArrayLike,
) -> Deformer:
    """Return a deformer that bends a body to constant curvature at any place, in any direction.

    Material before the origin stays. Behind it every cross-section perpendicular to `along` is
    rotated rigidly, by up to `angle` at the distance `length`. Beyond this the body continues
    straight. The plane through the origin perpendicular to `toward` keeps its lengths.

    Args:
        angle: Angle between the directions before and after the bend, in rad; negative bends the
            other way.
        length: Length in m over which the curvature is spread.
        origin: Point in m on the neutral line where the bend begins, (3,).
        along, toward: Directions of the body and of the bend, (3,), of any length, perpendicular.
    """
    require_positive(length=length)
    _require_angle(angle, BEND_TURNS)
    start = vector("origin", origin)
    out, side = (unit_vector(name, of) for name, of in (("along", along), ("toward", toward)))
    if abs(out @ side) > SQUARE:
        raise ParameterError(
            f"toward = {toward!r} must be perpendicular to along = {along!r}: the cosine of their "
            f"angle is {out @ side:.3g}, its bound {SQUARE:g}."
        )

    def deform(points: Floats) -> Floats:
        away = _points(points) - start
        far, high = away @ out, away @ side
        bent = np.clip(far, 0, length)
        turn = angle * bent / length
        # This form has no centre of curvature, so that angle = 0 is no special case:
        # sin(t)/κ = s sinc, (1 − cos t)/κ = s tan(t/2) sinc.
        sinc = np.sinc(turn / np.pi)
        half = np.sinc(turn / (2 * np.pi))
        c, s = np.cos(turn), np.sin(turn)
        new_high = bent * turn / 2 * half**2 + high * c + (far - bent) * s
        new_far = bent * sinc - high * s + (far - bent) * c
        return (
            start
            + away
            + np.multiply.outer(new_far - far, out)
            + np.multiply.outer(new_high - high, side)
        )

    return deform


def stand(angle: float, length: float, *, directions: npt.ArrayLike, root: float) -> Deformer:
    """Return a deformer that bends all arms of a flat star down (paper Figs. 9, 10).

    The body stays. Beyond the distance `root` from the centre, each arm bends towards −z about the
    horizontal axis across it, by an angle in rad, to constant curvature over `length`; the rest of
    it continues straight. The plane z = 0 keeps its lengths.

    Args:
        angle: Negative bends up.
        length: In m.
        directions: Directions of the arms, (k, 2), of any length, as in `Star.directions`.
        root: In m. The arms must be apart there, as they are at `Star.root`: a point belongs to the
            arm with the nearest direction.
    """
    require_positive(root=root)
    arms = checked_floats(
        "directions", directions, "(k, 2), k ≥ 1", lambda s: len(s) == 2 and s[0] > 0 and s[1] == 2
    )
    arms = np.stack([unit_vector("directions", (x, y, 0)) for x, y in arms])
    bends = [curl(angle, length, origin=root * arm, along=arm, toward=(0, 0, -1)) for arm in arms]

    def deform(points: Floats) -> Floats:
        found = _points(points).copy()
        nearest = np.argmax(found @ arms.T, axis=1)
        for k, bent in enumerate(bends):
            found[nearest == k] = bent(found[nearest == k])
        return found

    return deform


def twist(angle: float, length: float) -> Deformer:
    """Return a deformer that rotates cross-sections about z by angle · z/length."""
    require_positive(length=length)
    _require_angle(angle, TWIST_TURNS)

    def deform(points: Floats) -> Floats:
        x, y, z = _points(points).T
        turn = angle * z / length
        c, s = np.cos(turn), np.sin(turn)
        return np.stack([c * x - s * y, s * x + c * y, z], axis=1)

    return deform


def contract(axial: float, radial: float = 1.0) -> Deformer:
    """Return a deformer that scales lengths along z and across it, about the origin.

    Ratios are new over old: an axial one of 0.92 shortens by 8 %.
    """
    require_positive(axial=axial, radial=radial)
    return lambda points: _points(points) * [radial, radial, axial]


def compose(*deformers: Deformer) -> Deformer:
    """Return a deformer that applies the given ones one after the other, the first one first.

    Deformers expect a straight body along z, so that a bend comes last: compose(contract(0.9),
    twist(1.0, 0.15), bend(3.1, 0.135)).
    """
    for number, deformer in enumerate(deformers):
        require_callable(f"deformers[{number}]", deformer, "a map from positions to positions")

    def deform(points: Floats) -> Floats:
        for deformer in deformers:
            points = deformer(points)
        return points

    return deform


def _require_angle(angle: float, turns: int) -> None:
    """Check that an angle is a number of rad, not of degrees, of so many turns at most."""
    require_finite(angle=angle)
    if abs(angle) > 2 * np.pi * turns:
        raise ParameterError(
            f"angle = {angle:g} rad is {abs(angle) / (2 * np.pi):.3g} turns, more than {turns}; "
            f"degrees? Give {angle:g}° as np.radians({angle:g}) = {np.radians(angle):.4g}."
        )


def _points(points: npt.ArrayLike) -> Floats:
    what = "(n, 3), in m"
    return checked_floats("points", points, what, lambda s: s[-1:] == (3,), finite=False)
