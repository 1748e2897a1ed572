"""Whether a pattern can be printed: pieces, islands, holes, thinnest line and gap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem._types import Bools
from toros_fem._validate import require_positive
from toros_fem.fabrication.contours import panel_outline
from toros_fem.fabrication.islands import Hole, Piece, find_holes, find_pieces
from toros_fem.fabrication.widths import Place, measure_widths
from toros_fem.meshes.pattern import Pattern

SAMPLES_PER_LIMIT = 20


@dataclass(frozen=True)
class PrintLimits:
    """What a printer and a cloth can take.

    Args:
        width: Thinnest printable line, in m.
        gap: Thinnest gap between printed borders that stays open, in m.
        hole_area: Smallest hole worth keeping, in m².

    Raises:
        ParameterError: A limit is not positive.
    """

    width: float = 0.6e-3
    gap: float = 0.6e-3
    hole_area: float = 0.5e-6

    def __post_init__(self) -> None:
        require_positive(width=self.width, gap=self.gap, hole_area=self.hole_area)

    @property
    def resolution(self) -> float:
        """How precisely widths and gaps are measured, in m."""
        return min(self.width, self.gap) / SAMPLES_PER_LIMIT


@dataclass(frozen=True, eq=False)
class Printability:
    """What stands between a pattern and the printer.

    Attributes:
        bodies: The main body, that is the largest piece, of every panel on which is printed.
        islands: All other pieces, the largest first.
        holes: The smallest first.
        smallest_width, smallest_gap: None where no line or gap has two sides.
        border: Length of the print's border in m, without where the panel itself is cut.
        narrow, tight: Places where lines, or gaps, are thinner than the limit.
    """

    bodies: tuple[Piece, ...]
    islands: tuple[Piece, ...]
    holes: tuple[Hole, ...]
    smallest_width: Place | None
    smallest_gap: Place | None
    border: float
    narrow: tuple[Place, ...]
    tight: tuple[Place, ...]

    @property
    def free_islands(self) -> tuple[Piece, ...]:
        """Islands that hang on no main body, not even across seams."""
        return tuple(island for island in self.islands if not island.attached)

    @property
    def pieces(self) -> int:
        """Number of separately printed pieces."""
        return len(self.bodies) + len(self.islands)

    def summary(self) -> dict[str, Any]:
        """The figures as plain numbers, in the unit that a key ends in."""

        def ends(place: Place | None) -> list[list[float]] | None:
            return [[1e3 * x, 1e3 * y] for x, y in place.ends] if place else None

        return {
            "pieces": self.pieces,
            "islands": len(self.free_islands),
            "island_areas_mm2": [1e6 * island.area for island in self.free_islands],
            "islands_attached_by_seam": len(self.islands) - len(self.free_islands),
            "holes": len(self.holes),
            "smallest_hole_mm2": 1e6 * self.holes[0].area if self.holes else None,
            "border_mm": 1e3 * self.border,
            "smallest_width_mm": self.smallest_width and 1e3 * self.smallest_width.width,
            "smallest_width_panel": self.smallest_width and self.smallest_width.panel,
            "smallest_width_ends_mm": ends(self.smallest_width),
            "smallest_gap_mm": self.smallest_gap and 1e3 * self.smallest_gap.width,
            "smallest_gap_panel": self.smallest_gap and self.smallest_gap.panel,
            "smallest_gap_ends_mm": ends(self.smallest_gap),
            "narrow_places": len(self.narrow),
            "tight_places": len(self.tight),
        }


def printability(
    pattern: Pattern, regions: Sequence[BaseGeometry], limits: PrintLimits | None = None
) -> Printability:
    """Measure whether a pattern can be printed.

    Args:
        pattern: The pattern.
        regions: What is printed on each panel, in m.
        limits: Below which widths and gaps are listed.
    """
    limits = limits or PrintLimits()
    outlines = [panel_outline(pattern, panel) for panel in range(len(pattern.panel_names))]
    pieces = find_pieces(pattern, regions)
    thin = [
        measure_widths(region, outline, panel, limits.width, limits.gap, limits.resolution)
        for panel, (region, outline) in enumerate(zip(regions, outlines, strict=True))
    ]

    def least(kind: int) -> Place | None:
        found = [panel[kind].smallest for panel in thin]
        return min((p for p in found if p), key=lambda place: place.width, default=None)

    def under(kind: int) -> tuple[Place, ...]:
        found = [place for panel in thin for place in panel[kind].under]
        return tuple(sorted(found, key=lambda place: place.width))

    return Printability(
        bodies=tuple(piece for piece in pieces if piece.main),
        islands=tuple(piece for piece in pieces if not piece.main),
        holes=find_holes(pattern, regions),
        smallest_width=least(0),
        smallest_gap=least(1),
        border=sum(map(_inner_border, regions, outlines)),
        narrow=under(0),
        tight=under(1),
    )


def _inner_border(region: BaseGeometry, outline: BaseGeometry) -> float:
    """Length in m of a region's border that is not the panel's."""
    if region.is_empty:
        return 0.0
    size = np.hypot(*np.ptp(np.reshape(outline.bounds, (2, 2)), axis=0))
    return float(region.boundary.difference(outline.boundary.buffer(1e-7 * size)).length)


def printed_cells(pattern: Pattern, regions: Sequence[BaseGeometry]) -> Bools:
    """Whether each triangle is printed, that is whether its centroid is, (t,)."""
    printed = np.zeros(len(pattern.panel), dtype=bool)
    for panel, region in enumerate(regions):
        shapely.prepare(region)
        cells = pattern.panel == panel
        printed[cells] = shapely.contains_xy(region, pattern.centroids[cells])
    return printed
