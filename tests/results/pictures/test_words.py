"""Words beside points."""

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Annotation
from matplotlib.transforms import Bbox

from toros_fem.results.pictures.words import Word, write_words


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
    renderer = FigureCanvasAgg(figure).get_renderer()
    written = [text for text in axes.texts if isinstance(text, Annotation)]
    assert [text.get_text() for text in written] == [word.text for word in words]
    boxes = [text.get_window_extent(renderer) for text in written]
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
