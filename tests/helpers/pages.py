"""Where the words of a page are, and what they cover."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from toros_fem.results.pictures.style import DPI

Words = list[tuple[str, Bbox]]


def words_of(figure: Figure) -> Words:
    """All words on a page, with numbers of axes, and their boxes in pixels."""
    figure.set_dpi(DPI)  # as in files: letters have other widths where there are fewer pixels
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    hidden = {id(text) for axes in figure.axes for text in _unseen(axes)}
    texts = [t for t in figure.findobj(Text) if t.get_visible() and t.get_text()]
    # Without the arrows of annotations.
    return [
        (text.get_text(), Text.get_window_extent(text, canvas.get_renderer()))
        for text in texts
        if id(text) not in hidden
    ]


def _unseen(axes: Axes) -> Iterator[Text]:
    """Yield numbers of axes that are not drawn: outside of their limits, or of axes without any."""
    for axis in axes.xaxis, axes.yaxis:
        low, high = np.sort(axis.get_view_interval())
        for tick in axis.get_major_ticks():
            if not (axes.axison and low <= tick.get_loc() <= high):
                yield tick.label1
                yield tick.label2


def assert_apart(figure: Figure) -> None:
    """No words of a page meet others, and none leave the page."""
    found = words_of(figure)
    for words, box in found:
        inside = box.x0 >= 0 and box.y0 >= 0
        inside &= box.x1 <= figure.bbox.x1 and box.y1 <= figure.bbox.y1
        assert inside, f"{words!r} leaves the page"
    for (one, first), (other, second) in combinations(found, 2):
        assert not first.overlaps(second), f"{one!r} meets {other!r}"


def covered(axes: Axes, words: str) -> float:
    """Part of the box of words that pictures of surfaces on the same axes cover."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    (box,) = [box for text, box in words_of(figure) if text == words]
    across, up = np.meshgrid(np.linspace(box.x0, box.x1, 60), np.linspace(box.y0, box.y1, 30))
    places = axes.transData.inverted().transform(np.column_stack([across.ravel(), up.ravel()]))
    hit = np.zeros(len(places), dtype=bool)
    for image in axes.images:
        left, right, low, high = image.get_extent()
        alpha = np.asarray(image.get_array())[..., 3]
        share = (places - [left, low]) / [right - left, high - low]
        inside = np.all((share >= 0) & (share < 1), axis=1)
        rows = ((1 - share[inside, 1]) * len(alpha)).astype(int).clip(0, len(alpha) - 1)
        hit[inside] |= alpha[rows, (share[inside, 0] * alpha.shape[1]).astype(int)] > 0
    return float(hit.mean())
