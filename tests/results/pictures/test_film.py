"""Films show the shapes one after the other, and back again."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from helpers.runs import change_summary
from PIL import Image, ImageSequence

from toros_fem.base.errors import OutputError, ParameterError
from toros_fem.results.pictures import film
from toros_fem.results.pictures.film import write_animation

pytestmark = pytest.mark.usefixtures("rough")


def pictures(path: Path) -> list[np.ndarray]:
    found = []
    with Image.open(path) as moving:
        for picture in ImageSequence.Iterator(moving):
            found.append(np.asarray(picture.convert("RGB")).astype(int))
    return found


@pytest.mark.slow
def test_the_skin_inflates_and_empties(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(film, "MOST", 6)
    monkeypatch.setattr(film, "JOINED", 0.5)
    assert write_animation(run, "pressure") == run / "inflation.gif"
    for ending in ("gif", "apng"):
        found = pictures(run / f"inflation.{ending}")
        assert len(found) == 10
        for one, other in pairwise(found):
            assert (np.abs(one - other).max(axis=2) > 8).mean() > 1e-3
        for k in range(1, 5):  # the way back
            assert np.abs(found[k] - found[-k]).max() <= 8
        dark = np.abs(found[5] - [31, 58, 95]).max(axis=2) < 40
        assert dark.mean() > 2e-3, "the print is seen"
        accent = np.abs(found[5] - [213, 94, 0]).max(axis=2) < 40
        assert accent.mean() > 1e-3, "the target is seen"
        assert (run / f"inflation.{ending}").stat().st_size < 1.5e6


def test_scenes_are_at_equal_steps(run: Path) -> None:
    """Up to the design's pressure; frames that are far apart are not joined by made-up shapes."""
    from toros_fem.results.runs.run_folder import read_run

    found = read_run(run)
    frames = found.series["pressure"]
    scenes = film._inflated(found, frames)
    angles = [scene.values["angle_deg"] for scene in scenes]
    assert max(scene.values["pressure_pa"] for scene in scenes) == pytest.approx(5e3)
    known = {round(frame.values["angle_deg"], 6) for frame in frames}
    assert {round(angle, 6) for angle in angles} <= known, "steps of 12° of 48° are too wide"
    close = [frames[0], frames[1]]
    change_summary(run, figures=[])
    joined = film._inflated(read_run(run), close)
    assert len(joined) == film.MOST


def test_nothing_to_animate_is_told(run: Path) -> None:
    with pytest.raises(OutputError, match="no frames over the gait"):
        write_animation(run, "gait")
    with pytest.raises(ParameterError, match="must be one of"):
        write_animation(run, "time")
