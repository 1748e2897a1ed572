"""Frames come back as they were written, and are thinned evenly."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from helpers.runs import bent, regions_of, tube

from toros_fem.results.runs.frames import (
    MOST,
    Frame,
    ShownSkin,
    forget_from,
    numbers,
    thin,
    write_frame,
    write_skin,
)


def frame(number: int) -> Frame:
    positions = np.full((2, 3), 0.1 * number)
    return Frame("iteration", number, "skin-1.npz", positions, np.array([0.5]), {"a_mm": 1.5}, "ä.")


def full_skin() -> ShownSkin:
    """A skin that has all that can be shown."""
    pattern = tube()
    passive = np.where(pattern.panel == 0, 1.0, np.nan)
    body = np.eye(3), np.array([[0, 1, 2]])
    return ShownSkin(pattern, bent(pattern, 1.0), True, passive, regions_of(pattern), body)


def test_the_name_of_a_skin_is_that_of_its_content(tmp_path: Path) -> None:
    """Equal skins have one file; of two that differ in one number, each has its own."""
    skin = full_skin()
    assert skin.target is not None
    changes: list[dict[str, Any]] = [
        {}, {"target": 1.001 * skin.target}, {"aligned": False}, {"passive": None},
        {"passive": np.zeros(len(skin.pattern.triangles))}, {"regions": None},
        {"body": (2 * np.eye(3), skin.body[1])},
    ]  # fmt: skip
    names = [write_skin(tmp_path, replace(skin, **change)) for change in changes]
    assert len(set(names)) == len(changes)
    assert write_skin(tmp_path, full_skin()) == names[0]


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


def test_files_of_somebody_else_are_no_frames_and_stay(tmp_path: Path) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    mine = folder / "iteration-7.npz"
    mine.write_text("mine")
    write_frame(folder, frame(3))
    forget_from(folder, "iteration", 0)
    assert list(folder.iterdir()) == [mine]
