"""Frames come back as they were written, and are thinned evenly."""

from pathlib import Path

import numpy as np
from helpers.runs import bent, regions_of, tube

from toros_fem.results.frames import Frame, ShownSkin, write_frame, write_skin
from toros_fem.results.frames.files import MOST, forget_from, numbers, thin


def frame(number: int) -> Frame:
    positions = np.full((2, 3), 0.1 * number)
    return Frame("iteration", number, "skin-1.npz", positions, np.array([0.5]), {"a_mm": 1.5}, "ä.")


def test_a_skin_has_one_file(tmp_path: Path) -> None:
    pattern = tube()
    passive = np.where(pattern.panel == 0, 1.0, np.nan)
    body = np.eye(3), np.array([[0, 1, 2]])
    regions = regions_of(pattern)
    skin = ShownSkin(pattern, bent(pattern, 1.0), True, passive, regions, body)
    name = write_skin(tmp_path, skin)
    assert write_skin(tmp_path, skin) == name
    assert write_skin(tmp_path, ShownSkin(pattern)) != name


def test_long_runs_keep_few_frames_at_even_distances(tmp_path: Path) -> None:
    for number in range(301):
        write_frame(tmp_path, frame(number))
        thin(tmp_path, "iteration")
        kept = numbers(tmp_path, "iteration")
        assert kept[0] == 0
        assert kept[-1] == number
        assert len(kept) <= MOST + 1
    assert kept == [*range(0, 301, 8), 300]


def test_steps_that_are_done_again_are_forgotten(tmp_path: Path) -> None:
    for number in range(5):
        write_frame(tmp_path, frame(number))
    forget_from(tmp_path, "iteration", 3)
    assert numbers(tmp_path, "iteration") == [0, 1, 2]
