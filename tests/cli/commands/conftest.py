"""A design that several commands look at."""

from pathlib import Path

import pytest
from helpers.blank_pictures import blank_pictures
from helpers.command_runs import changes, small_scene
from helpers.scenes import shared
from mpi4py import MPI

from toros_fem.cli.commands.main import run


@pytest.fixture(scope="module", autouse=True)
def _without_drawing(few_pictures: None) -> None:
    """No test here looks at a picture."""


@pytest.fixture(scope="session")
def designed(alone: MPI.Comm, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The scene file of a small design, and the folder of its finished run."""
    folder = shared(alone, tmp_path_factory.mktemp("designed"))
    scene = small_scene(alone, folder)
    words = ["design", str(scene), "--output", str(folder / "run"), *changes()]
    with blank_pictures():
        assert run(alone, words) == 0
    return scene, folder / "run"
