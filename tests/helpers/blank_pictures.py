"""Pictures that cost nothing: all code that draws runs, but for the rendering."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest


@contextmanager
def blank_pictures() -> Iterator[None]:
    """Views are empty and PNGs no pictures; the charts of reports are drawn."""
    figures = pytest.importorskip("matplotlib.figure")
    from PIL import Image as Bitmap

    from toros_fem.results.pictures import of_run, shown
    from toros_fem.results.pictures.raster import Image, Window

    draw = figures.Figure.savefig

    def save(self: Any, place: Any, **how: Any) -> None:
        if how["format"] == "png":
            Bitmap.new("RGB", (8, 6)).save(place, "png")
        else:
            draw(self, place, **how)

    def blank(surfaces: Any, view: Any, window: Window, **how: Any) -> Image:
        width, height = window.pixels
        colours = np.full((height, width, 4), 255, dtype=np.uint8)
        return Image(colours, np.full((height, width), -np.inf, dtype=np.float32), window)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shown, "render", blank)
        patch.setattr(of_run, "render", blank)
        patch.setattr(figures.Figure, "savefig", save)
        yield
