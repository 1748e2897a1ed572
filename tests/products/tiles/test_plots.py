"""Pictures of tiles: full circles of a profile by its symmetry, and what their pages show."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from helpers.pages import words_of
from helpers.scenes import square
from matplotlib.figure import Figure
from mpi4py import MPI
from PIL import Image

from toros_fem.meshes import tile
from toros_fem.products.tiles.plots import full_circle, plot_profile, plot_sheet, plot_tiles
from toros_fem.products.tiles.stiffness_profile import Profile


@pytest.mark.parametrize(
    ("symmetry", "step", "expected"),
    [
        ("tetragonal", 22.5, [3, 2, 1, 2] * 4 + [3]),
        ("orthotropic", 45.0, [3, 2, 1, 2] * 2 + [3]),
        # Quarter turns repeat directions; there are no mirrors.
        ("chiral", 30.0, [3, 2, 1] * 4 + [3]),
        # Only n and −n have equal values.
        ("none", 60.0, [3, 2, 1] * 2 + [3]),
    ],
)
def test_full_circle(symmetry: str, step: float, expected: list[int]) -> None:
    given = np.radians([0.0, step, 2 * step])
    turn, values = full_circle(given, np.array([3.0, 2.0, 1.0]), symmetry)
    assert np.degrees(turn) == pytest.approx(step * np.arange(len(expected)))
    assert values == pytest.approx(expected)


@pytest.mark.parametrize(
    "values",
    [[3500.0, 520.0, 330.0], [900.0, 380.0, 880.0], [1490.0, 1500.0, 1510.0], [300.0, 2.0, 900.0]],
)
def test_numbers_of_circles_are_off_the_curves(
    values: list[float], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pages = list[Figure]()
    monkeypatch.setattr(Figure, "savefig", lambda self, place, **how: pages.append(self))
    angles = np.radians([0.0, 45.0, 90.0])
    stress, none = 0.1 * np.array(values), np.zeros(3)
    profile = Profile(angles, 0.1, stress, none, stress / stress.max(), none, (), (), 0, 0)
    plot_profile(tmp_path / "profile.png", profile, 50.0, "orthotropic", angles, None)
    (figure,) = pages
    words = words_of(figure)
    for axes in figure.axes:
        numbers = {text.get_text() for text in axes.get_yticklabels()}
        boxes = [box for word, box in words if word in numbers and axes.bbox.overlaps(box)]
        assert len(boxes) >= 2
        fine = np.linspace(0, 2 * np.pi, 3000)
        for line in axes.lines:
            turn, value = np.array(line.get_data(), dtype=float)
            points = np.column_stack([fine, np.interp(fine, turn, value)])
            assert not any(box.count_contains(axes.transData.transform(points)) for box in boxes)


@pytest.mark.parametrize("size", [(0.01, 0.01), (0.04, 0.01), (0.01, 0.03)])
def test_pages_of_tiles_have_narrow_margins(
    size: tuple[float, float], alone: MPI.Comm, tmp_path: Path
) -> None:
    """Fabric and print nearly reach both sides, or the page is as narrow as its title needs."""
    path = tmp_path / "tile.png"
    flat = square(n=6).points / 0.02 * [*size, 0.0]
    sheet = square(flat, n=6)
    pulled, printed = flat * [1.1, 0.95, 1.0], np.zeros(len(sheet.panel), dtype=bool)
    plot_sheet(path, sheet, pulled, printed, "pulled by 10 %")
    assert used(path) > 0.7
    one = tile(alone, 0.01, 1e-3)
    plot_tiles(path, one, shapely.box(0, 0, 0.005, 0.03), 3)
    assert used(path) > 0.7


def used(path: Path) -> float:
    """Part of a picture's width, or of its height if that is more, that is not white."""
    with Image.open(path) as image:
        dark = np.asarray(image.convert("L")) < 250
    rows, columns = np.flatnonzero(dark.any(axis=1)), np.flatnonzero(dark[150:].any(axis=0))
    return float(max(np.ptp(columns) / dark.shape[1], np.ptp(rows) / dark.shape[0]))
