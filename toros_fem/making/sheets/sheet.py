"""A sheet of fabric or film, or the printer's bed, with the panels that lie on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import shapely

from toros_fem.making.panels.marks import CLEAR, HEIGHT, Ruler, ruler
from toros_fem.making.panels.panel_drawing import PanelDrawing
from toros_fem.making.panels.svg import Box, Layer

# Layers from the lowest to the highest: the order in which most machines work, the cut at last.
LAYERS = ("print", "seam", "marks", "labels", "cut")


@dataclass(frozen=True, eq=False)
class Sheet:
    """Panels at their places on a sheet.

    Attributes:
        size: Width and depth of the sheet in m.
        drawings: The panels.
    """

    size: tuple[float, float]
    drawings: Sequence[PanelDrawing]

    @cached_property
    def ruler(self) -> Ruler:
        """The ruler that shows the scale."""
        return ruler(shapely.union_all([one.footprint for one in self.drawings]), self.size)

    @property
    def box(self) -> Box:
        """What a drawing shows: the sheet, and below it the ruler if that has no room on it."""
        below = 0.0 if self.ruler.inside else HEIGHT + 4 * CLEAR
        return 0.0, -below, *self.size

    @cached_property
    def layers(self) -> dict[str, list[Layer]]:
        """What each layer shows, by its name; notches are cut, and belong to the cut."""
        layers: dict[str, list[Layer]] = {name: [] for name in LAYERS}
        for one in self.drawings:
            layers["print"].append(Layer(one.name, one.printed))
            layers["seam"].append(Layer(one.name, lines=[seam.line for seam in one.seams]))
            layers["marks"].append(Layer(one.name, lines=one.marks))
            layers["labels"].append(Layer(one.name, labels=one.labels))
            layers["cut"].append(Layer(one.name, one.cut, lines=list(one.notches)))
        layers["marks"].append(Layer("sheet", lines=self.ruler.lines))
        layers["labels"].append(Layer("sheet", labels=[self.ruler.label]))
        return layers
