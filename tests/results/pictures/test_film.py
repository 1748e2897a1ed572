"""Animations show the shapes one after the other."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from toros_fem.base.errors import OutputError, ParameterError
from toros_fem.results.report.animation import write_animation

image = pytest.importorskip("PIL.Image")


def pictures(path: Path) -> list[np.ndarray]:
    found = []
    with image.open(path) as film:
        for k in range(film.n_frames):
            film.seek(k)
            found.append(np.asarray(film.convert("RGB")).astype(int))
    return found


@pytest.mark.slow
def test_each_picture_differs_from_the_one_before(run: Path) -> None:
    path = write_animation(run, "pressure")
    assert path == run / "inflation.gif"
    found = pictures(path)
    assert len(found) == 10
    for one, other in pairwise(found):
        assert (np.abs(one - other).max(axis=2) > 8).mean() > 1e-3
    dark = np.abs(found[-1] - [33, 51, 84]).max(axis=2) < 40
    assert dark.mean() > 2e-3, "the print is seen"
    assert path.stat().st_size < 1e6


def test_nothing_to_animate_is_told(run: Path) -> None:
    with pytest.raises(OutputError, match="no frames over the gait"):
        write_animation(run, "gait")
    with pytest.raises(ParameterError, match="must be one of"):
        write_animation(run, "time")
