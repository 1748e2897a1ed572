"""Films show the shapes one after the other, and back again."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from helpers.runs import change_summary
from PIL import Image, ImageSequence

from toros_fem.base.errors import OutputError
from toros_fem.results.pictures import film
from toros_fem.results.pictures.film import write_animation
from toros_fem.results.runs.stored_run import read_run

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


def test_aligned_shapes_lie_on_their_targets(run: Path) -> None:
    """Where they are moved as a whole nothing of a film changes."""
    found = read_run(run)
    frames = found.series["pressure"][-1:]
    skins = {name: replace(skin, aligned=True) for name, skin in found.skins.items()}
    aligned = replace(found, skins=skins)
    moved = [replace(one, positions=one.positions + [0.03, -0.02, 0.01]) for one in frames]
    one, other = (
        np.asarray(film._pictures(aligned, "pressure", scenes)[0]).astype(int)
        for scenes in (frames, moved)
    )
    assert (np.abs(one - other).max(axis=2) > 8).mean() < 1e-3
    apart = np.asarray(film._pictures(found, "pressure", moved)[0]).astype(int)
    assert (np.abs(one - apart).max(axis=2) > 8).mean() > 0.01


def test_colours_of_all_pictures_are_in_a_film(tmp_path: Path) -> None:
    """A palette of the last picture alone would have no red."""
    colours = [(200, 30, 30), (30, 160, 30), (30, 30, 200)]
    made = [Image.new("RGB", (40, 30), colour) for colour in colours]
    for kind, few in (("GIF", film.FEW), ("PNG", film.MANY)):
        path = tmp_path / f"film.{kind}"
        path.write_bytes(film._moving(made, [50] * 3, kind, few))
        for picture, colour in zip(pictures(path), colours, strict=True):
            assert np.abs(picture - colour).max() < 12
