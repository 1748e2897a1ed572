"""What a simulated shape has reached: angles in rad, shares as pure numbers, lengths in m."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from toros_fem._types import Floats, Ints
from toros_fem.errors import ParameterError
from toros_fem.meshes.pattern import Pattern
from toros_fem.objectives.cross_sections import cross_sections, section_vertices
from toros_fem.objectives.rotation import best_rotation, polar_rotation

MetricFunction = Callable[[Pattern, Floats], float]
"""A number from a pattern and the deformed positions (n, 3) of all its vertices in m."""


@dataclass(frozen=True)
class Metric:
    """A number that a run is judged by, named in history, summary and pictures.

    Attributes:
        name: What it is, "angle" say.
        unit: Its unit, as it ends names: "deg", "percent", "mm".
        target: The target value.
        measure: Computes the value reached, in that unit.
    """

    name: str
    unit: str
    target: float
    measure: MetricFunction

    def __post_init__(self) -> None:
        if not (self.name.isidentifier() and self.unit.isidentifier()):
            raise ParameterError(f"{self.name!r} in {self.unit!r} makes no name for a column.")

    @property
    def key(self) -> str:
        """Its name in files, "angle_deg"."""
        return f"{self.name}_{self.unit}"

    @property
    def label(self) -> str:
        """How a picture writes it: "angle in degrees"."""
        return f"{self.name} in {UNITS.get(self.unit, (self.unit, ''))[0]}"

    def written(self, value: float) -> str:
        """A value with its unit, "180°"."""
        sign = UNITS.get(self.unit, ("", f" {self.unit}"))[1]
        return f"{value:.3g}{sign}"


# How a unit is written in words and behind a number.
UNITS = {"deg": ("degrees", "°"), "percent": ("per cent", " %"), "mm": ("mm", " mm")}


def turn_angle(
    pattern: Pattern,
    positions: Floats,
    sections: Sequence[Ints],
    along: npt.ArrayLike,
    toward: npt.ArrayLike,
) -> float:
    """Angle in rad by which the last of a body's sections has turned in a plane.

    Each section's best rigid rotation turns the direction `along` into n; its angle is
    atan2(n·toward, n·along), followed continuously from section to section so that it may pass
    180°.

    Args:
        pattern: The pattern.
        positions: Deformed positions of all assembled vertices, (n, 3), in m.
        sections: Vertices of each section, from the body's root on.
        along, toward: Perpendicular unit vectors, (3,): of the assembled body, and to where it
            bends.
    """
    plane = np.array([toward, along], dtype=np.float64)
    angles = []
    for ring in sections:
        n = best_rotation(pattern.points[ring], positions[ring]) @ plane[1]
        angles.append(np.arctan2(*(plane @ n)))
    return float(np.unwrap(np.array(angles))[-1])


def bend_angle(
    pattern: Pattern, positions: Floats, panel: str = "wall", sections: int = 12
) -> float:
    """Angle in rad by which a tube along z bends in the x-z plane towards +x.

    `turn_angle` of the ring at the tip, after slabs of the wall of equal length along the assembled
    z: the counterpart of `meshes.bend`'s angle.

    Args:
        pattern: The pattern, assembled along z from z = 0.
        positions: Deformed positions of all assembled vertices, (n, 3), in m.
        panel: Name of the wall's panel.
        sections: How many slabs; each should span at least one ring of vertices.
    """
    rings = _rings(pattern, panel, sections)
    return turn_angle(pattern, positions, rings, (0, 0, 1), (1, 0, 0))


def twist_angle(
    pattern: Pattern, positions: Floats, panel: str = "wall", sections: int = 24
) -> float:
    """Angle in rad by which a tube along z is twisted about its own axis, counter-clockwise.

    From section to section the relative rotation RₖᵀRₖ₊₁ is parted into a swing, which bends the
    axis, and a twist about it, 2 atan2(q_z, q_w) of its quaternion q; the twists add up. The first
    section counts against how it is assembled, so the base must be held: a turn of the whole tube
    is not told from a twist. For a straight tube that is the angle by which the tip has turned, the
    counterpart of `meshes.twist`'s; a bent one is not taken for a twisted one.

    Args:
        pattern: The pattern, assembled along z.
        positions: Deformed positions of all assembled vertices, (n, 3), in m.
        panel: Name of the wall's panel.
        sections: How many sections; from one to the next the twist must stay under 180°.
    """
    rings = _rings(pattern, panel, sections)
    rotations = [best_rotation(pattern.points[ring], positions[ring]) for ring in rings]
    first = 2 * np.arctan2(*_swing_free(rotations[0]))
    steps = [2 * np.arctan2(*_swing_free(a.T @ b)) for a, b in pairwise(rotations)]
    turns = np.array([first, *steps])
    return float(((turns + np.pi) % (2 * np.pi) - np.pi).sum())


def shortening(pattern: Pattern, positions: Floats, panel: str = "wall") -> float:
    """By how much the straight distance of a tube's two ends has shrunk, over what it was.

    The ends are the means of the panel's two borders across z; negative if they move apart.

    Args:
        pattern: The pattern, assembled along z.
        positions: Deformed positions of all assembled vertices, (n, 3), in m.
        panel: Name of the wall's panel.
    """
    wall = pattern.vertices_of(panel)
    height = pattern.points[wall, 2]
    low, high = height.min(), height.max()
    room = 1e-9 * (high - low)
    base, tip = wall[height < low + room], wall[height > high - room]
    ends = positions[tip].mean(axis=0) - positions[base].mean(axis=0)
    return float(1 - np.linalg.norm(ends) / (high - low))


def swelling(pattern: Pattern, positions: Floats, panel: str = "wall") -> float:
    """Radius of the middle third of a tube along z, over what it was.

    The mean distance of the vertices from the line through the means of the third's two ends.

    Args:
        pattern: The pattern, assembled along z.
        positions: Deformed positions of all assembled vertices, (n, 3), in m.
        panel: Name of the wall's panel.
    """
    rings = _rings(pattern, panel, 12)[4:8]
    ring = np.unique(np.concatenate(rings))

    def radius(points: Floats) -> float:
        base, tip = (points[of].mean(axis=0) for of in (rings[0], rings[-1]))
        along = (tip - base) / np.linalg.norm(tip - base)
        arm = points[ring] - base
        return float(np.linalg.norm(arm - np.outer(arm @ along, along), axis=1).mean())

    return radius(positions) / radius(pattern.points)


def distance(
    pattern: Pattern, positions: Floats, target: Floats, *, aligned: bool = False
) -> float:
    """Root mean square distance of all vertices from a target in m, each by its flat area.

    Args:
        pattern: The pattern.
        positions: Deformed positions of all assembled vertices, (n, 3), in m.
        target: Where they are wanted, (n, 3), in m.
        aligned: Whether the rigid motion that fits best is taken out (Kabsch 1976).
    """
    weight = pattern.vertex_areas / pattern.vertex_areas.sum()
    found = positions
    if aligned:
        arm, goal = positions - weight @ positions, target - weight @ target
        rotation, _ = polar_rotation((weight[:, None] * goal).T @ arm)
        found = arm @ rotation.T + weight @ target
    return float(np.sqrt(weight @ ((found - target) ** 2).sum(axis=1)))


def _rings(pattern: Pattern, panel: str, count: int) -> list[Ints]:
    """Vertices of a panel in slabs along z, and those of its far end."""
    return section_vertices(
        cross_sections(pattern, pattern.vertices_of(panel), (0, 0, 1), count), least=6
    )


def _swing_free(rotation: Floats) -> tuple[float, float]:
    """Of a rotation's quaternion q_z and q_w, up to a common factor."""
    # q_z/q_w of the twist is (R₂₁ − R₁₂)/(1 + tr R), without dividing where tr R = −1.
    z, w = rotation[1, 0] - rotation[0, 1], 1 + np.trace(rotation)
    if w > 1e-6:
        return float(z), float(w)
    half = np.sqrt(max(0.0, 1 + rotation[2, 2] - rotation[0, 0] - rotation[1, 1]))
    return float(half), 0.0
