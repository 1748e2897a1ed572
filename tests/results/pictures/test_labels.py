"""Labels cover neither each other nor marks, and those without room are counted."""

from itertools import combinations

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.text import Text

from toros_fem.results.pictures.labels import Label, groups, write_labels


@pytest.mark.parametrize(("count", "room"), [(12, True), (150, False)])
def test_labels_do_not_overlap(count: int, room: bool) -> None:
    figure, axes = plt.subplots(figsize=(8, 5))
    axes.set(xlim=(0, 10), ylim=(0, 10))
    points = np.random.default_rng(0).uniform(1, 9, (count, 2))
    if not room:  # all in one corner
        points = 0.5 + points / 5
    figure.draw_without_rendering()
    labels = [Label(f"{k} mm", at, "red") for k, at in enumerate(points)]
    left_out = write_labels(axes, labels, points)
    assert len(axes.texts) == count - left_out > 4
    assert (left_out == 0) == room
    figure.canvas.draw()
    boxes = [Text.get_window_extent(text) for text in axes.texts]
    assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
    marks = axes.transData.transform(points)
    assert not any(box.contains(*mark) for box in boxes for mark in marks)
    window = axes.get_window_extent()
    assert all(window.x0 <= box.x0 and box.x1 <= window.x1 for box in boxes)
    plt.close(figure)


def test_close_places_share_a_label() -> None:
    figure, axes = plt.subplots(figsize=(5, 5), dpi=72)
    axes.set(xlim=(0, 360), ylim=(0, 360), position=(0, 0, 1, 1))  # in points
    points = np.array([[100.0, 100], [300, 300], [115, 100], [110, 110], [315, 300]])
    assert groups(axes, points) == [[0, 2, 3], [1, 4]]
    assert write_labels(axes, [Label("3 from 1 mm", points[0], "red", 3)], points) == 0
    crowd = np.stack(np.meshgrid(np.arange(0, 361, 10), np.arange(0, 361, 10)), -1).reshape(-1, 2)
    assert write_labels(axes, [Label("2 from 1 mm", points[1], "red", 2)], crowd * 1.0) == 2
    plt.close(figure)
