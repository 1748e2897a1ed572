"""A ruler on each sheet, by which its scale is checked."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from toros_fem._types import Floats
from toros_fem.manufacture.free_place import rectangles
from toros_fem.manufacture.panel_drawing import PanelDrawing
from toros_fem.manufacture.panel_labels import Label

LENGTH, STEP = 0.1, 0.01
# Heights in m of its ticks, of its text, and of the whole.
TICK, TEXT, HEIGHT = 2e-3, 2.5e-3, 7e-3
# Gap in m to panels and to the border of the sheet.
GAP = 1e-3
# Distance in m of the places that are tried.
TRIED = 4e-3


def ruler(
    drawings: Sequence[PanelDrawing], sheet: tuple[float, float]
) -> tuple[list[Floats], Label, bool]:
    """Return a ruler of 100 mm: its lines, its text, and whether it lies on the sheet.

    It takes the lowest free place on the sheet, upright where no level one is free. Without any it
    lies below the sheet. Its first line is 100 mm long; the others are ticks every 10 mm.

    Args:
        drawings: Panels at their places on the sheet.
        sheet: Width and height of the sheet in m.
    """
    free = shapely.box(GAP, GAP, sheet[0] - GAP, sheet[1] - GAP)
    taken = shapely.union_all([drawing.footprint for drawing in drawings]).buffer(GAP)
    free = free.difference(taken)
    shapely.prepare(free)
    size = LENGTH + 2 * GAP, HEIGHT
    for angle in (0.0, np.pi / 2):
        wide, high = size if angle == 0 else size[::-1]
        x, y = np.meshgrid(
            np.arange(GAP + wide / 2, sheet[0], TRIED), np.arange(GAP + high / 2, sheet[1], TRIED)
        )
        centres = np.column_stack([x.ravel(), y.ravel()])
        fits = shapely.contains_properly(free.buffer(1e-6), rectangles(centres, size, angle))
        if fits.any():
            return (*_drawn(centres[int(np.argmax(fits))], angle), True)
    return (*_drawn(np.array([GAP + size[0] / 2, -GAP - HEIGHT / 2]), 0.0), False)


def _drawn(centre: Floats, angle: float) -> tuple[list[Floats], Label]:
    """Return lines and text of a ruler around a point."""
    base = -HEIGHT / 2 + GAP / 2
    ticks = np.arange(0, LENGTH + STEP / 2, STEP) - LENGTH / 2
    lines = [np.array([[-LENGTH / 2, base], [LENGTH / 2, base]])]
    lines += [np.array([[x, base], [x, base + TICK]]) for x in ticks]
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    text = np.array([0.0, base + TICK + GAP / 2 + TEXT / 2])
    label = Label(f"{1e3 * LENGTH:.0f} mm", centre + turn @ text, angle, TEXT)
    return [centre + line @ turn.T for line in lines], label
