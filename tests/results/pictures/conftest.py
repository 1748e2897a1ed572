"""A tube, and how much of a picture has a colour."""

from collections.abc import Callable, Generator
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from helpers.runs import tube, write_run
from matplotlib.colors import to_rgb

from toros_fem.meshes import Pattern
from toros_fem.results.pictures import raster


@pytest.fixture(scope="session")
def pattern() -> Pattern:
    return tube()


@pytest.fixture(scope="module")
def rough() -> Generator[None]:
    """Pictures have rough borders: one sample a pixel, for a quarter of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(raster, "SAMPLES", 1)
        yield


@pytest.fixture
def run(tmp_path: Path, pattern: Pattern) -> Path:
    """A finished run."""
    return write_run(tmp_path / "run", pattern)


def pixels(path: Path) -> np.ndarray:
    """Colours in [0, 1], (height, width, 3)."""
    return np.asarray(matplotlib.image.imread(path))[:, :, :3]


@pytest.fixture(scope="session")
def share() -> Callable[[Path, str], float]:
    """How much of a picture has a colour."""

    def of(path: Path, colour: str) -> float:
        return float(np.all(np.abs(pixels(path) - to_rgb(colour)) < 0.02, axis=2).mean())

    return of
