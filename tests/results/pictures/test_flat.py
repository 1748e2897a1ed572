"""Flat panels: the print, its faults by numbers, densities, lines and wrinkles."""

from collections.abc import Callable
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import shapely
from helpers.prints import flawed_tube
from helpers.runs import regions_of
from helpers.scenes import square
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Page
from mpi4py import MPI

from toros_fem.design.lines.field import LineField
from toros_fem.making.printability import PrintLimits, printability
from toros_fem.mechanics.readings.wrinkles import Tension, WrinkleField
from toros_fem.meshes import Pattern, Surface, cylinder, unwrap
from toros_fem.results.pictures import flat
from toros_fem.results.pictures.flat import (
    draw_density,
    draw_lines,
    draw_panels,
    draw_pattern,
    draw_unwrapped,
    draw_wrinkles,
)
from toros_fem.results.pictures.style import ACCENT, TALL, page

LIMITS = PrintLimits()


def written(figure: Page) -> list[str]:
    """All words on a page."""
    parts = [text.get_text() for text in figure.texts]
    return parts + [text.get_text() for axes in figure.axes for text in axes.texts]


@pytest.fixture(scope="module")
def flawed(alone: MPI.Comm) -> tuple[Pattern, list]:
    pattern = cylinder(alone, 0.04, 0.02, 2.85e-3)
    return pattern, flawed_tube(pattern, 40)


def test_faults_have_numbers_and_words(flawed: tuple[Pattern, list], tmp_path: Path) -> None:
    pattern, regions = flawed
    found = printability(pattern, regions, LIMITS)
    count = (
        len(found.free_islands) + len(found.lines.narrow) + len(found.gaps.narrow)
        + sum(hole.area < LIMITS.hole_area for hole in found.holes)
    )  # fmt: skip
    assert count >= 3
    with page(tmp_path / "pattern.png") as figure:
        draw_pattern(figure, pattern, regions, found, LIMITS)
        words = written(figure)
    assert any(f"{count} places cannot be printed" in word for word in words)
    kinds = [word for word in words if word.startswith(("line ", "gap ", "hole ", "free island "))]
    assert len({word.split()[0] for word in kinds}) >= 3
    assert {"1", "2", "3"} <= set(words)
    width = 1e3 * min(place.width for place in found.lines.narrow)
    assert f"line {width:.2f} of 0.6 mm" in kinds
    assert found.gaps.smallest is not None
    assert f"thinnest gap {1e3 * found.gaps.smallest.width:.2g} mm" in words


def test_a_sound_print_is_told_as_printable(
    pattern: Pattern, tmp_path: Path, share: Callable[[Path, str], float]
) -> None:
    regions = regions_of(pattern)
    path = tmp_path / "pattern.png"
    with page(path) as figure:
        draw_pattern(figure, pattern, regions, printability(pattern, regions, LIMITS), LIMITS)
        words = written(figure)
    assert any("Printable" in word for word in words)
    assert share(path, ACCENT) == 0
    # Both sides of each of the three seams have its number, and the panels their names.
    assert sorted(word for word in words if word in {"1", "2", "3"}) == [
        "1",
        "1",
        "2",
        "2",
        "3",
        "3",
    ]
    assert set(pattern.panel_names) <= set(words)


def test_many_faults_find_room(
    flawed: tuple[Pattern, list], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The list ends with how many are left out."""
    monkeypatch.setattr(flat, "MOST_ROWS", 3)
    pattern, regions = flawed
    limits = PrintLimits(width=5e-3, gap=5e-3, hole_area=1e-4)
    with page(tmp_path / "pattern.png") as figure:
        draw_pattern(figure, pattern, regions, printability(pattern, regions, limits), limits)
        words = written(figure)
        (told,) = [
            axes for axes in figure.axes if any("thinnest" in t.get_text() for t in axes.texts)
        ]
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        bottoms = [t.get_window_extent(canvas.get_renderer()).y0 for t in told.texts]
    assert min(bottoms) > 0
    assert any(word.startswith("and ") and word.endswith(" more") for word in words)


def test_panels_keep_their_areas(
    pattern: Pattern, tmp_path: Path, share: Callable[[Path, str], float]
) -> None:
    """Print and fabric on the page have the ratio that they have in m²."""
    regions, path = regions_of(pattern), tmp_path / "panels.png"
    with page(path) as figure:
        draw_panels(figure, (0.1, 0.1, 0.8, 0.8), pattern, regions, names=False)
    printed = sum(region.area for region in regions)
    ratio = share(path, "#1F3A5F") / share(path, "#EBDFC8")
    assert ratio == pytest.approx(printed / (pattern.areas.sum() - printed), rel=0.04)


def test_names_of_small_panels_stay_apart() -> None:
    """Where they would meet, the second one is below its panel."""
    figure = Page(figsize=(2.0, 2.0), dpi=72)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, 144), ylim=(0, 144))  # a point of the page is a mm
    bounds = np.array([[10, 50, 30, 80], [35, 50, 55, 80], [90, 50, 120, 80]], dtype=float)
    flat._write_names(axes, ["panel-1", "panel-2", "panel-3"], bounds, 1.0)
    renderer = FigureCanvasAgg(figure).get_renderer()
    boxes = [text.get_window_extent(renderer) for text in axes.texts]
    assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
    assert [box.y0 > 80 for box in boxes] == [True, False, True]
    assert boxes[1].y1 < 50


def test_densities_go_from_fabric_to_print(
    pattern: Pattern, tmp_path: Path, share: Callable[[Path, str], float]
) -> None:
    half = (pattern.centroids[:, 1] > np.median(pattern.centroids[:, 1])).astype(float)
    half[np.flatnonzero(half)[0]] = np.nan  # what is not known is fabric
    with page(tmp_path / "density.png") as figure:
        draw_density(figure, (0.1, 0.1, 0.8, 0.8), pattern, half)
    assert share(tmp_path / "density.png", "#1F3A5F") > 0.02
    assert share(tmp_path / "density.png", "#EBDFC8") > 0.02


def test_families_have_colours_by_their_share(
    tmp_path: Path, share: Callable[[Path, str], float]
) -> None:
    """The largest family is drawn first and has the accent; a blank field has no marks."""
    pattern = square(n=6)
    count = len(pattern.panel)
    angles = np.tile([0.0, 1.2], (count, 1))
    shares = np.full((count, 2), [0.05, 0.2])
    region, path = [shapely.box(0, 0, 0.01, 0.02)], tmp_path / "lines.png"
    with page(path) as figure:
        draw_lines(figure, LineField(pattern, shares, angles), pattern, region)
        words = written(figure)
    assert "— 20.0 % of the area" in words
    assert "— 5.0 % of the area" in words
    assert share(path, ACCENT) > 1e-4
    with page(path) as figure:
        draw_lines(figure, LineField(pattern, 0 * shares, angles), pattern, region)
        (marks,) = {len(c.get_paths()) for c in figure.axes[0].collections[-2:]}
    assert marks == 0


def test_wrinkles(tmp_path: Path, share: Callable[[Path, str], float]) -> None:
    pattern = square(n=6)
    count = len(pattern.panel)
    state = np.full(count, list(Tension).index(Tension.TAUT))
    state[: count // 2] = list(Tension).index(Tension.WRINKLED)
    along = np.tile([1.0, 0.0], (count, 1))
    field = WrinkleField(state, along, np.zeros((count, 3)))
    with page(tmp_path / "wrinkles.png") as figure:
        draw_wrinkles(figure, pattern, field)
        words = written(figure)
    assert share(tmp_path / "wrinkles.png", "#F2C078") > 0.02
    assert share(tmp_path / "wrinkles.png", "#9DC3E6") > 0.02
    assert "wrinkled 50%" in words


def test_an_unwrapped_surface(alone: MPI.Comm, tmp_path: Path) -> None:
    """Seams that are seen are drawn in both views; panels have their outlines, in mm."""
    tube = cylinder(alone, 0.04, 0.02, 4e-3)
    unwrapped = unwrap(alone, Surface(tube.points, tube.triangles))
    pattern = unwrapped.pattern
    with page(tmp_path / "unwrap.png", size=TALL) as figure:
        draw_unwrapped(figure, unwrapped)
        words = written(figure)
        *spaces, flat, _ = figure.axes
        for axes in spaces:
            assert len(axes.images) == 1
            seam = np.asarray(axes.lines[0].get_xydata())
            assert 0 < np.isfinite(seam[:, 0]).sum() // 2 <= len(unwrapped.seams)
        closed = [line for line in flat.lines if len(np.asarray(line.get_xydata())) > 3]
        outlines = [shapely.Polygon(line.get_xydata()) for line in closed]
        assert sum(o.area for o in outlines) == pytest.approx(1e6 * pattern.areas.sum())
    assert f"{len(pattern.panel_names)} flat panels" in words[0]
