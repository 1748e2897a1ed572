"""Each picture is made, and shows what it is given at the right place."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib.image
import matplotlib.pyplot as plt
import numpy as np
import pytest
import shapely
from helpers.prints import flawed_tube
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from mpi4py import MPI

from toros_fem.design.loop.options import Iteration
from toros_fem.making.print.printability import PrintLimits, printability
from toros_fem.measures.metrics import Measurement, Metric
from toros_fem.meshes import Pattern, Surface, cylinder, unwrap
from toros_fem.meshes.panels import cut_triangles
from toros_fem.results.pictures.curve_plot import (
    MEASURED,
    plot_convergence,
    plot_metrics_over_pressure,
    plot_pressure_path,
    plot_tracks,
)
from toros_fem.results.pictures.drawing import FABRIC, PRINTED, TARGET, View, draw_skin, frame
from toros_fem.results.pictures.field_plot import plot_fields
from toros_fem.results.pictures.pattern_plot import (
    HOLE,
    ISLAND,
    NARROW_GAP,
    NARROW_LINE,
    plot_pattern,
    plot_printability,
    plot_variants,
)
from toros_fem.results.pictures.shape_plot import plot_shape, plot_shapes
from toros_fem.results.pictures.surface_plot import VIEWS, plot_unwrapped


@pytest.fixture(scope="module")
def pattern(alone: MPI.Comm) -> Pattern:
    return cylinder(alone, 0.04, 0.02, 2.85e-3)


def pixels(path: Path) -> np.ndarray:
    """Colours in [0, 1], (height, width, 3)."""
    return np.asarray(matplotlib.image.imread(path))[:, :, :3]


def fraction(image: np.ndarray, colour: Any, within: float = 0.02) -> float:
    """How much of a picture has a colour."""
    wanted = matplotlib.colors.to_rgb(colour)
    return float(np.all(np.abs(image - wanted) < within, axis=2).mean())


def hue(image: np.ndarray, colour: np.ndarray) -> float:
    """How much of a picture is a colour in any shade."""
    length = np.linalg.norm(image, axis=2)
    along = image @ colour / np.linalg.norm(colour)
    shaded = (along > 0.999 * length) & (length < 0.999 * np.linalg.norm(colour)) & (length > 0.1)
    return float(shaded.mean())


def test_fields(pattern: Pattern, tmp_path: Path) -> None:
    """Two rows of designs, each with its fields side by side; dark is dense."""
    half = (pattern.centroids[:, 1] > 0.02).astype(float)
    fields = {"ρ": np.zeros_like(half), "ρ̄": half}
    designs = [(str(k), fields) for k in range(4)]
    plot_fields(tmp_path / "fields.png", pattern, "wall", designs)
    image = pixels(tmp_path / "fields.png")
    upper, lower = np.array_split(image, 2)
    for row, number in ((upper, 3), (lower, 1)):
        columns = np.all(row < 0.02, axis=2).mean(axis=0)
        dark = (columns > 0.2) & (columns < 0.6)
        assert np.count_nonzero(np.diff(dark.astype(int)) == 1) == number


@pytest.mark.parametrize("view", [View(), View(25, 35), View(-40, 200)])
def test_skin_is_where_the_axes_say(pattern: Pattern, view: View) -> None:
    """The picture's outline has the limits of the projected points; the outside alone is seen."""
    points = pattern.points * [1.3, 1.0, 0.7] + [0.01, 0.02, 0.0]
    figure, axes = plt.subplots(figsize=(6, 5), layout="constrained")
    frame(axes, points, view)
    axes.set_axis_off()
    figure.draw_without_rendering()
    colours = np.broadcast_to(PRINTED, (len(pattern.triangles), 3))
    draw_skin(axes, pattern.triangles, points, colours, view)
    image = shown(figure)
    rows, columns = np.nonzero(np.any(image < 0.9, axis=2))
    found = axes.transData.inverted().transform(
        [(columns.min(), len(image) - 1 - rows.max()), (columns.max(), len(image) - 1 - rows.min())]
    )
    projected = 1e3 * view.project(points)
    pixel = 1 / (axes.transData.transform((1, 0)) - axes.transData.transform((0, 0)))[0]
    assert found[0] == pytest.approx(projected.min(axis=0), abs=2.5 * pixel)
    assert found[1] == pytest.approx(projected.max(axis=0), abs=2.5 * pixel)
    plt.close(figure)


def shown(figure: Figure) -> np.ndarray:
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[:, :, :3] / 255


def test_the_side_towards_the_viewer_is_seen(pattern: Pattern) -> None:
    """Of two halves in two colours each side shows its own."""
    back = pattern.points[pattern.triangles][:, :, 1].mean(axis=1) > 0
    colours = np.where(back[:, None], TARGET, PRINTED)
    for turn, colour, other in ((0, PRINTED, TARGET), (180, TARGET, PRINTED)):
        figure, axes = plt.subplots(layout="constrained")
        frame(axes, pattern.points, View(0, turn))
        figure.draw_without_rendering()
        draw_skin(axes, pattern.triangles, pattern.points, colours, View(0, turn))
        image = shown(figure)
        assert hue(image, colour) > 0.1
        assert hue(image, other) < 0.01
        plt.close(figure)


@pytest.mark.parametrize(
    ("stretch", "with_target", "rows"), [(1, True, [2, 2]), (0.4, True, [4]), (1, False, [3])]
)
def test_shape(
    pattern: Pattern, figures: list[Figure], stretch: float, with_target: bool, rows: list[int]
) -> None:
    """In a row if slender, else in two; without a target the skin stands alone, in a row."""
    points = pattern.points * [stretch, stretch, 1]
    target, regions = (1 * points if with_target else None), flawed_tube(pattern, 40)
    plot_shape(Path("no.png"), pattern, points, target, regions, "a title")
    specs = [axes.get_subplotspec() for axes in figures[-1].axes]
    lines = [spec.rowspan.start for spec in specs if spec is not None]
    assert [lines.count(k) for k in range(max(lines) + 1)] == rows
    image = shown(figures[-1])
    assert (hue(image, TARGET) > 0.02) == with_target
    assert hue(image, PRINTED) > 0.02
    assert hue(image, FABRIC) > 0.02


def test_shapes(pattern: Pattern, tmp_path: Path) -> None:
    """States keep their common frame: one that has moved aside stands aside."""
    density = np.where(np.arange(len(pattern.triangles)) % 2, 1.0, np.nan)
    shapes = [(str(k), pattern.points + [0.02 * k, 0, 0]) for k in range(3)]
    plot_shapes(tmp_path / "s.png", pattern.triangles, shapes, density, view=(15, 15), columns=2)
    image = pixels(tmp_path / "s.png")
    assert hue(image, TARGET) > 0.02
    upper = np.array_split(image, 2)[0]
    places = []
    for half in np.array_split(upper, 2, axis=1):
        dark = np.all(half < 0.5, axis=2) & (half[:, :, 2] > half[:, :, 0] + 0.1)
        places.append(np.nonzero(dark)[1].mean() / half.shape[1])
    assert places[1] - places[0] > 0.1


def test_print_has_the_border_of_its_contours(pattern: Pattern) -> None:
    """Stripes on the flat end are dark where they are, whatever triangles they cross."""
    tip = pattern.panel_index("tip")
    stripes = shapely.union_all([shapely.box(-1, y, 1, y + 1e-3) for y in (-6e-3, -1e-3, 4e-3)])
    regions = [shapely.Polygon()] * tip + [pattern.outline(tip) & stripes]
    figure, axes = plt.subplots(figsize=(6, 6))
    axes.set_axis_off()
    frame(axes, pattern.points, View(90, 0))
    colours = np.tile(FABRIC, (len(pattern.triangles), 1))
    cut = cut_triangles(pattern, regions)
    draw_skin(axes, pattern.triangles, pattern.points, colours, View(90, 0), cut)
    image = shown(figure)
    rows, columns = np.nonzero(np.any(image < 0.99, axis=2))
    dark = image[rows, columns, 2] > image[rows, columns, 0]  # fabric is yellow, in shade too
    pixels = np.stack([columns + 0.5, len(image) - rows - 0.5], axis=1)
    places = 1e-3 * axes.transData.inverted().transform(pixels)
    plt.close(figure)
    near = 1.5e-3 * np.abs(np.diff(axes.transData.inverted().transform(pixels[:2]), axis=0)).max()
    borders = shapely.union_all([stripes.boundary, pattern.outline(tip).boundary])
    far = shapely.distance(borders, shapely.points(places)) > near
    assert np.array_equal(dark[far], shapely.contains_xy(regions[tip], places[far]))
    assert 0.5 < far.mean() < 1


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """What would be written, to look at its lines."""
    drawn: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: drawn.append(figure))
    return drawn


def lines_of(figure: Figure) -> list[list[Any]]:
    """Points of the lines of each axes that has any."""
    return [[line.get_xydata() for line in axes.lines] for axes in figure.axes if axes.lines]


def coloured(figure: Figure, colour: Any) -> list[np.ndarray]:
    """Points of all lines of a colour."""
    lines = [line for axes in figure.axes for line in axes.lines]
    kept = [line for line in lines if colour in (line.get_color(), line.get_markeredgecolor())]
    return [np.asarray(line.get_xydata()) for line in kept]


def test_curves(figures: list[Figure]) -> None:
    """Objective, metrics that have a target, and grey level; a line where a finer mesh begins."""
    metric = Metric("angle", "deg", 90.0, lambda _, __: 0.0)
    watched = replace(metric, name="other", target=None)
    numbers = {name: 0.01 * k for k, name in enumerate(Iteration.__dataclass_fields__, 1)}
    history = [
        Iteration(**{**numbers, "iteration": k, "level": k // 3, "metrics": {"angle_deg": 9.0 * k}})  # type: ignore[arg-type]
        for k in range(5)
    ]
    plot_convergence(Path("no.png"), history, [metric, watched])
    steps = np.arange(5.0)
    levels = [np.full(5, value) for value in (history[0].volume_fraction, history[0].grey_level)]
    curves = [[np.full(5, history[0].objective)], [9 * steps], levels]
    top, middle, bottom = lines_of(figures[-1])
    for lines, wanted in zip((top, [middle[0], *middle[2:]], bottom), curves, strict=True):
        for line, values in zip(lines[:-1], wanted, strict=True):
            assert line == pytest.approx(np.column_stack([steps, values]))
        assert lines[-1][:, 0] == pytest.approx(3.0)
    assert middle[1][:, 1] == pytest.approx(90.0)
    plot_convergence(Path("no.png"), history[:3], [metric])
    assert [len(lines) for lines in lines_of(figures[-1])] == [1, 2, 2]
    rows = [{"pressure_pa": 1e3 * k, "angle_deg": 8.0 * k} for k in range(5)]
    plot_pressure_path(Path("no.png"), rows, [metric])
    assert lines_of(figures[-1])[0][0] == pytest.approx(np.column_stack([steps, 8 * steps]))
    feet = np.random.default_rng(0).random((7, 4, 3))
    plot_tracks(Path("no.png"), feet, 3)
    tracks = lines_of(figures[-1])[0]
    for k in range(4):
        for line, part in zip(tracks[3 * k : 3 * k + 3], (feet, feet[::3], feet[:1]), strict=True):
            assert line == pytest.approx(1e3 * part[:, k][:, [0, 2]])
    (legend,) = figures[-1].legends
    names = [text.get_text() for text in legend.get_texts()]
    assert names == ["foot 0", "foot 1", "foot 2", "foot 3", "start"]


def test_metrics_over_pressure(tmp_path: Path) -> None:
    """A row for each target; measured points and ends without equilibrium have their colour."""
    angle = Metric("angle", "deg", 90.0, lambda _, __: 0.0)
    twist, length = replace(angle, name="twist"), replace(angle, name="length", target=None)
    keys = [metric.key for metric in (angle, twist, length)]
    rows = [{"pressure_pa": 1e3 * k, **dict.fromkeys(keys, 8.0 * k)} for k in range(1, 9)]
    measured = [Measurement("angle_deg", 90.0, 6e3, 60.0, "a bench")]

    def drawn(name: str, metrics: list[Metric], *more: Any) -> np.ndarray:
        plot_metrics_over_pressure(tmp_path / f"{name}.png", rows, metrics, 5e3, *more)
        return pixels(tmp_path / f"{name}.png")

    plain = drawn("plain", [angle, twist, length])
    assert fraction(plain, PRINTED) > 1e-3
    assert fraction(plain, MEASURED) == 0
    assert np.array_equal(drawn("targets", [angle, twist]), plain), "the length is watched only"
    assert len(drawn("one", [angle])) < 0.7 * len(plain)
    assert len(drawn("watched", [length])) < 0.7 * len(plain)
    upper, lower = np.array_split(drawn("measured", [angle, twist], measured), 2)
    assert fraction(upper, MEASURED) > 1e-4 > fraction(lower, MEASURED) == 0
    for half in np.array_split(drawn("broken", [angle, twist], [], (False, True)), 2):
        assert fraction(half, MEASURED) > 1e-5


def test_strides_below_the_tracks(tmp_path: Path) -> None:
    """True to scale: a measured stride of twice the length is a bar twice as long."""
    feet = np.random.default_rng(0).random((7, 4, 3)) * [0.1, 0.1, 0.01]
    lengths = []
    for stride in (0.02, 0.04):
        plot_tracks(tmp_path / "tracks.png", feet, 3, 0.01, ("a bench", stride))
        image = pixels(tmp_path / "tracks.png")
        there = np.all(np.abs(image - MEASURED) < 0.02, axis=2)
        lengths.append(there.sum(axis=1).max())
    assert lengths[1] == pytest.approx(2 * lengths[0], rel=0.05)


def test_pattern(pattern: Pattern, tmp_path: Path) -> None:
    """Fabric and print have their areas, in the same scale."""
    regions = flawed_tube(pattern, 40)
    plot_pattern(tmp_path / "pattern.png", pattern, regions)
    image = pixels(tmp_path / "pattern.png")
    printed, bare = fraction(image, PRINTED), fraction(image, FABRIC)
    area = sum(region.area for region in regions)
    assert printed / (printed + bare) == pytest.approx(area / pattern.areas.sum(), rel=0.03)
    assert printed > 0.05


def test_printability(pattern: Pattern, figures: list[Figure]) -> None:
    """Each flaw has its colour and its size; without flaws nothing is marked."""
    limits, sizes = PrintLimits(), []
    for regions in (flawed_tube(pattern, 40), [pattern.outline(k) for k in range(3)]):
        found = printability(pattern, regions, limits)
        plot_printability(Path("no.png"), pattern, regions, found, limits)
        axes = figures[-1].axes[0]
        islands = [patch for patch in axes.patches if patch.get_edgecolor()[:3] == to_rgb(ISLAND)]
        lines = [coloured(figures[-1], colour) for colour in (NARROW_LINE, NARROW_GAP, HOLE)]
        marks: list[Any] = [islands, *lines]
        sizes.append([len(kind) for kind in marks])
        if found.holes:  # in mm
            assert np.ptp(islands[0].get_path().vertices, axis=0) == pytest.approx(2.4, rel=1e-3)
            for kind, width in ((marks[1], 0.4), (marks[2], 0.45)):
                assert np.linalg.norm(np.diff(kind[0], axis=0)) == pytest.approx(width, abs=2e-3)
            assert np.ptp(marks[3][0], axis=0) == pytest.approx(0.7, rel=1e-3)
    assert sizes == [[1, 2, 2, 2], [0, 0, 0, 0]]


def test_variants(pattern: Pattern, tmp_path: Path) -> None:
    wall = flawed_tube(pattern, 40)[pattern.panel_index("wall")]
    variants = [("all", wall, "a caption"), ("nothing", wall - wall, "another")]
    plot_variants(tmp_path / "variants.png", pattern, "wall", variants)
    left, right = np.array_split(pixels(tmp_path / "variants.png"), 2, axis=1)
    assert fraction(left, PRINTED) > 0.1 > 0.02 > fraction(right, PRINTED)
    assert fraction(right, FABRIC) > 0.3


def test_unwrapped_surface(alone: MPI.Comm, figures: list[Figure]) -> None:
    """Each seam that is seen is a ribbon, in both views; panels have their outlines, in mm."""
    tube = cylinder(alone, 0.04, 0.02, 4e-3)
    unwrapped = unwrap(alone, Surface(tube.points, tube.triangles))
    plot_unwrapped(Path("no.png"), unwrapped)
    *spaces, flat, _ = figures[-1].axes
    pattern, size = unwrapped.pattern, unwrapped.pattern.size
    for axes, view in zip(spaces, VIEWS, strict=True):
        paths = [np.asarray(p.vertices) for group in axes.collections for p in group.get_paths()]
        ends = 1e3 * view.project(pattern.points[unwrapped.seams].reshape(-1, 3))
        lengths = np.linalg.norm(ends[::2] - ends[1::2], axis=1)
        sides = [np.linalg.norm(np.diff(p[:4], axis=0), axis=1) for p in paths if len(p) == 4]
        assert {round(float(side[0]), 6) for side in sides} == {round(1e3 * 5e-3 * size, 6)}
        assert all(np.abs(lengths - side[1]).min() < 1e-9 for side in sides)
        middles = [p[:4].mean(axis=0) for p in paths if len(p) == 4]
        apart = np.subtract((ends[::2] + ends[1::2])[:, None] / 2, middles)
        assert np.linalg.norm(apart, axis=2).min(axis=0).max() < 1e-9
        a, b, c = np.moveaxis(pattern.points[pattern.triangles], 1, 0)
        seen = pattern.triangles[np.cross(b - a, c - a) @ view.directions[2] > 0]
        assert len(sides) == np.isin(unwrapped.seams, seen).all(axis=1).sum() > 0
    outlines = [shapely.Polygon(line.get_xydata()) for line in flat.lines]
    assert sum(o.area for o in outlines) == pytest.approx(1e6 * pattern.areas.sum())
