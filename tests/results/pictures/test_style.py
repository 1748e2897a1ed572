"""Words beside points."""

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Annotation, Text
from matplotlib.transforms import Bbox

from toros_fem.results.pictures.style import DPI, Word, write_words


def boxes_of(axes: Axes) -> list[Bbox]:
    canvas = FigureCanvasAgg(axes.figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    return [Text.get_window_extent(text, renderer) for text in axes.texts]


def test_words_cover_neither_lines_nor_each_other() -> None:
    """The words of two near points on a rising curve through a target, and the target's name."""
    figure = Figure((8.0, 4.5))
    axes = figure.subplots()
    at = np.linspace(0, 20, 30)
    curve = np.stack([at, 220 * (1 - np.exp(-at / 3))], axis=1)
    target = np.array([(0.0, 180.0), (20.0, 180.0)])
    axes.plot(*curve.T)
    axes.plot(*target.T)
    words = [
        Word("target 180°", (0.0, 180.0), "red", 8.0),
        Word("174.1 ± 1.1°", (5.0, 178.5), "blue"),
        Word("180° (paper, measured),\n178° ours", (5.3, 180.0), "black", 8.0),
    ]
    write_words(axes, words, [curve, target])
    assert [text.get_text() for text in axes.texts] == [word.text for word in words]
    boxes = boxes_of(axes)
    fine = np.linspace(0, 20, 4000)
    for line in (curve, target):
        points = axes.transData.transform(np.stack([fine, np.interp(fine, *line.T)], axis=1))
        assert not any(box.count_contains(points) for box in boxes)
    for k, box in enumerate(boxes):
        assert not any(Bbox.intersection(box, other) for other in boxes[:k])
        assert box.x0 > axes.bbox.x0
        assert box.x1 < axes.bbox.x1


def test_words_stay_near_where_nothing_is_in_the_way() -> None:
    axes = Figure((8.0, 4.5)).subplots()
    axes.plot([0, 1], [0, 1])
    write_words(axes, [Word("here", (0.5, 0.5), "black")], [])
    (text,) = axes.texts
    assert isinstance(text, Annotation)
    assert np.hypot(*text.get_position()) < 40


def test_words_leave_areas_and_what_is_written_free() -> None:
    """Beside a wide area, past a bar's name there; they have a line to their point if it is far."""
    axes = Figure((8.0, 4.5)).subplots()
    axes.set(xlim=(0, 100), ylim=(0, 60))
    across, up = np.meshgrid(np.arange(20, 81, 0.5), np.arange(20, 41, 0.5))
    area = np.column_stack([across.ravel(), up.ravel()])
    axes.text(45, 42, "before", fontsize=9)
    write_words(axes, [Word("held", (50.0, 33.0), "black")], [], (7.0, 20.0, 40.0, 60.0), area)
    before, held = boxes_of(axes)
    assert not held.count_contains(axes.transData.transform(area))
    assert not held.overlaps(before)
    _, text = axes.texts
    assert isinstance(text, Annotation)
    assert text.arrow_patch is not None


def test_the_size_of_words_is_that_of_their_letters() -> None:
    for word in (Word("iiii", (0, 0), "black"), Word("WWW", (0, 0), "black", 14.0, bold=True)):
        axes = Figure(dpi=DPI).subplots()
        write_words(axes, [word], [])
        (box,) = boxes_of(axes)
        width, height = DPI / 72 * word.extent
        assert width == pytest.approx(box.width, abs=1.0)
        assert height >= box.height


def test_sides_are_tried_in_their_order() -> None:
    for side in ((1.0, 0.0), (0.0, -1.0), (-0.6, 0.8)):
        axes = Figure().subplots()
        axes.set(xlim=(0, 1), ylim=(0, 1))
        write_words(axes, [Word("tip", (0.5, 0.5), "black", sides=(side, (0.0, 1.0)))], [])
        (box,) = boxes_of(axes)
        middle = (box.p0 + box.p1) / 2 - axes.transData.transform((0.5, 0.5))
        assert middle @ np.array(side) > 0.7 * np.hypot(*middle)
