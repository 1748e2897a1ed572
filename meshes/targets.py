"""Target shapes: composable deformers of the assembled skin."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from toros_fem.meshes.pattern import Floats

from toros_fem.errors import ParameterError
from toros_fem.parameters import require_positive

Deformer = Callable[[Floats], Floats]
"""Maps positions (n, 3) in m to positions (n, 3) in m."""


def bend(angle: float, length: float, *, neutral: float = 0.0) -> Deformer:
    """Bend a body along z to constant curvature, in the x-z plane towards +x.

    The end z = 0 stays fixed; every cross-section z = const is turned rigidly by
    angle · z/length about +y, so that the tip's normal turns from +z towards +x by `angle`. The
    neutral line x = neutral keeps its length: material at smaller x
    is stretched, at larger x shortened, by (neutral − x) · angle/length.

    Args:
        angle: Angle between the two end sections in rad; negative bends towards −x.
        length: Length in m over which the curvature is spread.
        neutral: Position x of the neutral line in m. On a tube of radius R, 0 is the centre
            line, R the inner side of the bend.
    """
    require_positive(length=length)
    _require_finite(angle=angle, neutral=neutral)

    def deform(points: Floats) -> Floats:
        x, y, z = np.asarray(points, dtype=np.float64).T
        turn = angle * z / length
        # Written without the centre of curvature, so that angle = 0 is no special case:
        # sin(t)/κ = z sinc, (1 − cos t)/κ = z tan(t/2) sinc.
        sinc = np.sinc(turn / np.pi)
        half = np.sinc(turn / (2 * np.pi))
        across = neutral + (x - neutral) * np.cos(turn) + z * turn / 2 * half**2
        along = z * sinc - (x - neutral) * np.sin(turn)
        return np.stack([across, y, along], axis=1)

    return deform


def twist(angle: float, length: float) -> Deformer:
    """Turn the section z = const about the z axis by angle · z/length, counter-clockwise."""
    require_positive(length=length)
    _require_finite(angle=angle)

    def deform(points: Floats) -> Floats:
        x, y, z = np.asarray(points, dtype=np.float64).T
        turn = angle * z / length
        c, s = np.cos(turn), np.sin(turn)
        return np.stack([c * x - s * y, s * x + c * y, z], axis=1)

    return deform


def contract(axial: float, radial: float = 1.0) -> Deformer:
    """Scale lengths along z and across it; the section z = 0 stays in its plane.

    Args:
        axial: New over old length along z: 0.92 shortens by 8 %.
        radial: New over old radius.
    """
    require_positive(axial=axial, radial=radial)
    return lambda points: np.asarray(points, dtype=np.float64) * [radial, radial, axial]


def compose(*deformers: Deformer) -> Deformer:
    """Apply deformers one after the other, the first one first.

    `bend` takes the body as lying along z, so it comes last: compose(contract(0.9), twist(1.0,
    0.15), bend(3.1, 0.135)).
    """

    def deform(points: Floats) -> Floats:
        for deformer in deformers:
            points = deformer(points)
        return points

    return deform


def _require_finite(**values: float) -> None:
    for name, value in values.items():
        if not np.isfinite(value):
            raise ParameterError(f"{name} = {value} must be a finite number.")
