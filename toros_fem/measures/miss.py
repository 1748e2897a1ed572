"""How far a shape is from its target, as a person sees it: by points, and by cross-sections."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from toros_fem.base.array_types import Floats, Ints
from toros_fem.measures.cross_sections import label_cross_sections, section_vertices
from toros_fem.measures.figures import TOLERANCE
from toros_fem.meshes.pattern import Pattern

# A body is slender if it is this many times longer than wide; so many cross-sections are compared.
SLENDER, SECTIONS = 1.8, 12


@dataclass(frozen=True, eq=False)
class Miss:
    """How far a shape is from its target.

    Attributes:
        each: Distance of each vertex from its target, (n,), in m.
        rms: Root mean square distance in m: of the centres of 12 cross-sections along a slender
            body, which may swell freely, else of all points by their area.
        length: Largest extent of the assembled skin in m.
        by_sections: Whether cross-sections are compared.
    """

    each: Floats
    rms: float
    length: float
    by_sections: bool

    @property
    def reached(self) -> bool:
        """Whether the distance is at most `TOLERANCE` of the length."""
        return self.rms <= TOLERANCE * self.length


def miss_of(
    pattern: Pattern,
    positions: Floats,
    target: Floats,
    compared: tuple[bool, bool, bool] = (True, True, True),
) -> Miss:
    """Return how far a shape is from its target.

    Args:
        pattern: The whole pattern.
        positions, target: Positions of all vertices, (n, 3), in m, in the same place.
        compared: Whether distances along x, y and z count: a skin that is to twist may lengthen.
    """
    away = (positions - target) * compared
    each = np.linalg.norm(away, axis=1)
    extents = np.ptp(pattern.points, axis=0)
    along = int(np.argmax(extents))
    slender = extents[along] > SLENDER * np.sort(extents)[1]
    everywhere = np.arange(len(pattern.points))
    groups: list[Ints] = [everywhere]
    areas = pattern.vertex_areas
    if slender:
        labels = label_cross_sections(pattern, everywhere, np.eye(3)[along], SECTIONS, border=False)
        groups = section_vertices(labels)
    centres = np.array([areas[group] @ away[group] / areas[group].sum() for group in groups])
    rms = (
        np.sqrt((centres**2).sum(axis=1).mean())
        if slender
        else np.sqrt(areas @ each**2 / areas.sum())
    )
    return Miss(each, float(rms), float(extents[along]), bool(slender))
