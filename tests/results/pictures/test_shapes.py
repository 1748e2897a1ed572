"""A miss looks like a miss, and what is reached is told as reached."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.pages import assert_apart, covered, words_of
from helpers.runs import bent, regions_of, tube
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Page
from matplotlib.text import Annotation
from PIL import Image

from toros_fem.measures.figures import Figure
from toros_fem.measures.miss import shape_figures
from toros_fem.mechanics.contact.solids import rigid_sphere
from toros_fem.meshes import Pattern, bend, twist
from toros_fem.results.pictures.of_run import draw_inflation
from toros_fem.results.pictures.raster import View
from toros_fem.results.pictures.shapes import draw_miss, draw_shape, plot_states, scenery, verdict
from toros_fem.results.pictures.shown import Axonometry, DrawnSkin, visible
from toros_fem.results.pictures.style import ACCENT, DARK, SOFT, page
from toros_fem.results.runs.frames import ShownSkin

pytestmark = pytest.mark.usefixtures("rough")

ALL = (True, True, True)


def angle(value: float | None, interval: float | None = 1.0) -> Figure:
    return Figure("angle", "deg", value, interval, 90.0, 2.7)


def shape(percent: float) -> Figure:
    return Figure("shape_distance", "percent", percent, 0.2, 0.0, 3.0)


@pytest.mark.parametrize(
    ("figures", "word", "reason", "bound"),
    [
        ([angle(90.5), shape(1.0)], "Reached",
         "angle 90.5 ± 1.0°, shape 1.00 ± 0.20 % of the length", ""),
        ([angle(90.5), shape(9.7)], "Missed", "shape off by 9.70 ± 0.20 % of the length",
         "within 3 % would be reached"),
        ([angle(80.0), shape(9.7)], "Missed", "angle 10.0 ± 1.0° short of 90°",
         "within 2.7° would be reached"),
        ([angle(93.5)], "Not certain", "angle 3.5 ± 1.0° beyond 90°",
         "within 2.7° would be reached"),
        ([angle(90.5, None)], "Not certain", "angle 0.5° beyond 90°",
         "its error is not estimated; within 2.7° would be reached"),
        ([angle(None)], "No equilibrium", "", ""),
    ],
)  # fmt: skip
def test_verdicts(figures: list[Figure], word: str, reason: str, bound: str) -> None:
    colours = {"Reached": DARK, "Not certain": SOFT}
    assert verdict(figures) == (word, colours.get(word, ACCENT), reason, bound)


def test_without_a_target_there_is_no_verdict() -> None:
    assert verdict([]) is verdict([Figure("angle", "deg", 90.0)]) is None


def written(figure: Page) -> str:
    """All words on a page."""
    parts = [text.get_text() for text in figure.texts]
    for axes in figure.axes:
        parts += [text.get_text() for text in axes.texts]
    return "\n".join(parts)


@pytest.fixture
def drawn(pattern: Pattern) -> DrawnSkin:
    target = bent(pattern, np.pi / 2)
    return DrawnSkin(ShownSkin(pattern, target, regions=regions_of(pattern), compared=ALL))


def picture(drawn: DrawnSkin, positions: np.ndarray, figures: list[Figure]) -> Page:
    figure = Page(figsize=(8, 4.5))
    draw_shape(figure, drawn, positions, figures, "A title", "The print at 5 kPa")
    return figure


def told(drawn: DrawnSkin, positions: np.ndarray) -> list[Figure]:
    """The figures of a shape, which a finer mesh confirms."""
    values = scenery(drawn, positions).miss
    assert values is not None
    found = values.values()
    return list(shape_figures(found, dict.fromkeys(found, 0.01)))


def test_reached_and_missed_are_the_title(drawn: DrawnSkin, pattern: Pattern) -> None:
    """The same figure in another shape is a miss, with an arrow at its tip."""
    good = bent(pattern, np.pi / 2)
    reached = written(picture(drawn, good, [angle(90.0), *told(drawn, good)]))
    assert "Reached\nangle 90.0 ± 1.0°, shape 0.000 ± 0.010 % of the length\n" in reached
    assert "✓ reached" in reached
    assert "wanted: 90 ± 2.7°" in reached
    assert "mm off" not in reached
    assert "A title" not in reached
    leaning = good @ np.array([[0.94, 0.34, 0], [-0.34, 0.94, 0], [0, 0, 1.0]]).T
    figure = picture(drawn, leaning, [angle(90.0), *told(drawn, leaning)])
    missed = written(figure)
    assert "Missed\ndirection of the tip off by 19.885 ± 0.010°" in missed
    assert "Within 5° would be reached. The print at 5 kPa" in missed
    assert "90.0 ± 1.0°" in missed
    assert "✗ missed" in missed
    assert missed.count("mm off") == 1
    assert "Bulging does not count." in missed.replace("\n", " ")
    for words in ("seen obliquely", "outline of the target", "wanted: ≤ 3 %"):
        assert words in missed


def test_a_shape_without_intervals_is_not_certain(drawn: DrawnSkin, pattern: Pattern) -> None:
    """As runs of earlier versions tell it, which have no figures of their shape."""
    found = written(picture(drawn, bent(pattern, np.pi / 2), [angle(90.0)]))
    assert "Not certain" in found
    assert "Its error is not estimated; within " in found


def test_words_stay_apart(drawn: DrawnSkin, pattern: Pattern) -> None:
    """Long values do not run into what was wanted."""
    less = bent(pattern, 1.4)
    long = Figure("shortening", "percent", 7.78, 0.72, 8.0, 0.24)
    figure = picture(drawn, less, [angle(80.0), long, *told(drawn, less)])
    renderer = FigureCanvasAgg(figure).get_renderer()
    figure.draw(renderer)
    texts = [text for axes in figure.axes for text in axes.texts if text.get_text()]
    words = [text for text in (*texts, *figure.texts) if text.get_color() != ACCENT]
    boxes = [text.get_window_extent(renderer) for text in words]
    page = figure.bbox
    for k, one in enumerate(boxes):
        assert page.x0 <= one.x0 < one.x1 <= page.x1, words[k].get_text()
        for other, text in zip(boxes[:k], words, strict=False):
            assert not one.overlaps(other), (words[k].get_text(), text.get_text())


@pytest.mark.parametrize("edge", [6e-3, 11e-3])
def test_words_on_a_miss_are_not_on_the_skin(edge: float) -> None:
    """Nor on triangles whose corners are far from each other."""
    pattern = tube(edge)
    skin = ShownSkin(pattern, bent(pattern, 2.6), regions=regions_of(pattern), compared=ALL)
    figure = picture(DrawnSkin(skin), bend(1.9, 0.15)(pattern.points), [angle(109.0)])
    main = figure.axes[1]
    (off,) = [words for words, _ in words_of(figure) if "mm off" in words]
    assert max(covered(main, off), covered(main, "held")) < 0.02


def test_an_end_that_is_held_inside_of_a_skin_is_named_beside_it(pattern: Pattern) -> None:
    """As the middle of a walker is: its name has a line to it."""
    wide = (pattern.points - [0, 0, 0.075]) * [3.0, 3.0, 1.1] + [0, 0, 0.075]
    heights = pattern.points[:, 2]
    middle = np.isclose(heights, heights[np.abs(heights - 0.075).argmin()])
    wide[middle] = pattern.points[middle]
    assert middle.sum() > 2
    figure = picture(DrawnSkin(ShownSkin(pattern, regions=regions_of(pattern))), wide, [])
    main = figure.axes[1]
    assert covered(main, "held") < 0.02
    (held,) = [text for text in main.texts if text.get_text() == "held"]
    assert isinstance(held, Annotation)
    assert held.arrow_patch is not None


def test_the_end_of_a_slender_body_is_enlarged(pattern: Pattern) -> None:
    """It may be longer than its target, where no length is asked for; the picture says so."""
    target = twist(1.0, 0.15)(pattern.points)
    skin = ShownSkin(pattern, target, regions=regions_of(pattern), compared=(True, True, False))
    longer = DrawnSkin(skin), target * [1, 1, 1.1]
    found = written(picture(*longer, [Figure("twist", "deg", 60.0, 0.1, 60.0, 1.8)]))
    assert "the free end, enlarged" in found
    assert "seen obliquely" not in found
    assert "The target leaves z free" in found
    assert "held" in found
    assert scenery(*longer).target == pytest.approx(longer[1])


def test_an_outline_that_is_not_compared_is_a_guide(pattern: Pattern) -> None:
    target = bent(pattern, 1.0)
    skin = DrawnSkin(ShownSkin(pattern, target, regions=regions_of(pattern)))
    found = written(picture(skin, target, [angle(90.0)]))
    assert "The outline is a guide" in found
    assert "Reached" in found


def test_the_target_lies_over_the_skin(
    tmp_path: Path, drawn: DrawnSkin, pattern: Pattern, share: Callable[[Path, str], float]
) -> None:
    path = tmp_path / "shape.png"
    with page(path) as figure:
        draw_shape(figure, drawn, bent(pattern, np.pi / 3), [angle(60.0)])
    assert share(path, ACCENT) > 2e-3
    bare = DrawnSkin(ShownSkin(pattern, regions=regions_of(pattern)))
    with page(path, "A title") as figure:
        draw_shape(figure, bare, bent(pattern, np.pi / 3), [])
    assert share(path, ACCENT) == 0


def test_an_aligned_shape_is_moved_onto_its_target(pattern: Pattern) -> None:
    target, moved = bent(pattern, 1.0), bent(pattern, 1.0) + [0.02, 0.01, 0.0]
    skin = ShownSkin(pattern, target, compared=ALL)
    free = replace(skin, aligned=True)
    assert free.placed(moved) == pytest.approx(target, abs=1e-9)
    assert skin.placed(moved) is moved
    assert scenery(DrawnSkin(free), moved).positions == pytest.approx(target, abs=1e-9)
    assert scenery(DrawnSkin(free), moved).miss.rms == pytest.approx(0.0, abs=1e-9)


def test_colours_of_a_miss_end_at_its_largest(drawn: DrawnSkin, pattern: Pattern) -> None:
    figure = Page(figsize=(8, 4.5))
    draw_miss(figure, drawn, bent(pattern, np.pi / 2) + [0.0, 0.003, 0.004])
    assert "sections are 5 mm off (root mean square), 3.3 % of the length" in written(figure)
    bar = figure.axes[-1]
    assert bar.get_xlim()[1] == pytest.approx(5.0)


def test_bodies_and_ground_are_drawn(
    tmp_path: Path, pattern: Pattern, share: Callable[[Path, str], float]
) -> None:
    ball = rigid_sphere("ball", 0.03, (0.05, 0.0, 0.05))
    path = tmp_path / "shape.png"
    skin = ShownSkin(pattern, regions=regions_of(pattern), body=(ball.points, ball.triangles))
    with page(path, "A title") as figure:
        draw_shape(figure, DrawnSkin(skin), pattern.points, [])
    greys = share(path, "#9AA5B1")
    assert greys > 1e-3
    stage = Axonometry(Page(figsize=(4, 4)), (0, 0, 1, 1), View(20, 0), pattern.points)
    stage.ground(0.0, pattern.points)
    assert len(stage.axes.patches) == 1


def test_lines_follow_the_skin(pattern: Pattern) -> None:
    """They are straight in a tube at rest, and wind once around it where it twists by 360°."""
    lines = DrawnSkin(ShownSkin(pattern)).lines
    assert len(lines) == 3
    for triangle, weights in lines:
        corners = pattern.triangles[triangle]
        rest = np.einsum("mi,mic->mc", weights, pattern.points[corners])
        assert np.ptp(rest[:, 2]) == pytest.approx(0.15)
        angles = np.unwrap(np.arctan2(rest[:, 1], rest[:, 0]))
        assert np.ptp(angles) < 0.1
        twisted = twist(2 * np.pi, 0.15)(pattern.points)
        wound = np.einsum("mi,mic->mc", weights, twisted[corners])
        turn = np.ptp(np.unwrap(np.arctan2(wound[:, 1], wound[:, 0])))
        assert turn == pytest.approx(2 * np.pi, rel=0.05)


def test_hidden_points_are_told(drawn: DrawnSkin, pattern: Pattern) -> None:
    stage = Axonometry(Page(figsize=(4, 4)), (0, 0, 1, 1), View(), pattern.points)
    image = stage.draw(drawn.surfaces(pattern.points))
    front, back = np.array([[0.0, -0.01, 0.07]]), np.array([[0.0, 0.01, 0.07]])
    assert visible(front, View(), image, stage.size).all()
    assert not visible(back, View(), image, stage.size).any()
    assert not visible(np.array([[1.0, 0.0, 0.0]]), View(), image, stage.size).any()


def test_states_that_would_hide_each_other_stand_apart(pattern: Pattern) -> None:
    skin = DrawnSkin(ShownSkin(pattern, regions=regions_of(pattern)))
    bending = [("rest", pattern.points), ("on", bend(1.0, 0.15)(pattern.points))]
    turning = [("rest", pattern.points), ("on", twist(1.0, 0.15)(pattern.points))]
    widths = []
    for states in (bending, turning):
        figure = Page(figsize=(8, 4.5))
        draw_inflation(figure, (0, 0, 1, 1), skin, states)
        (axes,) = figure.axes
        centres = [np.mean(image.get_extent()[:2]) for image in axes.images]
        left = [image.get_extent()[0] for image in axes.images]
        widths.append(centres[1] - centres[0])
        assert len(left) == 2
        assert "rest" in written(figure)
    assert widths[1] > 40  # mm: 2.4 widths
    assert widths[0] < 40


def test_names_of_states_are_beside_their_tips(pattern: Pattern) -> None:
    """Over each other they follow the tips; in a row they stand in one line."""
    skin = DrawnSkin(ShownSkin(pattern, bent(pattern, 2.0), regions=regions_of(pattern)))
    turns = (0.01, 0.4, 0.8, 1.3, 2.0)
    names = [f"{k}.{k} kPa" for k in range(5)]
    fan = [bent(pattern, turn) for turn in turns]
    tall = [twist(turn, 0.15)(pattern.points) * [1, 1, 1 + 0.2 * turn] for turn in turns]
    for shapes in (fan, tall):
        figure = Page(figsize=(8, 4.5))
        draw_inflation(figure, (0, 0, 1, 1), skin, list(zip(names, shapes, strict=True)))
        assert_apart(figure)
        (axes,) = figure.axes
        assert max(covered(axes, name) for name in names) < 0.02
        found = dict(words_of(figure))
        middles = np.array([(found[name].p0 + found[name].p1) / 2 for name in names])
        if shapes is tall:
            assert np.ptp([found[name].y0 for name in names]) < 1
        else:
            # They lie around the skin in the order of its states.
            assert np.all(np.diff(middles[:, 0]) > 0)
            assert np.all(np.diff(middles[:4, 1]) < 5)


def test_states_in_rows_take_no_more_than_they_need(
    pattern: Pattern, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A long title has its lines; names are near their rows, and the bar is below all."""
    pages, real = list[Page](), Page.savefig

    def save(self: Page, *place: Any, **how: Any) -> None:
        pages.append(self)
        real(self, *place, **how)

    monkeypatch.setattr(Page, "savefig", save)
    skin = DrawnSkin(ShownSkin(pattern, regions=regions_of(pattern)))
    lying = [x[:, [2, 1, 0]] * [1, 1, -1] for x in (bent(pattern, 0.01), bent(pattern, 0.6))]
    rows = [[(f"state {k}", skin.surfaces(x))] for k, x in enumerate(lying)]
    plot_states(tmp_path / "states.png", rows, View(), "A sentence that tells all of it " * 5)
    (figure,) = pages
    assert_apart(figure)
    for k, axes in enumerate(figure.axes):
        (image,) = axes.images
        top = axes.transData.transform((0, image.get_extent()[3]))[1]
        name = dict(words_of(figure))[f"state {k}"]
        assert 0 < name.y0 - top < 0.2 * figure.dpi
    bar = figure.axes[-1].lines[-1]
    bottom = figure.axes[-1].images[0].get_extent()[2]
    assert np.all(np.asarray(bar.get_ydata()) < bottom)


def test_states_in_rows(
    tmp_path: Path, pattern: Pattern, share: Callable[[Path, str], float]
) -> None:
    skin = DrawnSkin(ShownSkin(pattern, regions=regions_of(pattern)))
    row = [(f"state {k}", skin.surfaces(bent(pattern, 0.3 * k + 0.1))) for k in range(3)]
    path = tmp_path / "states.png"
    plot_states(path, [row, row], View(15, 15), "A gait", ground=0.0)
    assert share(path, "#F1F2F4") > 0.01
    assert share(path, ACCENT) == 0
    edge = np.asarray(Image.open(path).convert("RGB"))[:, [0, -1]]
    assert np.all(edge == 255), "the ground ends inside"
    way = np.zeros(3), np.array([0.02, 0.0, 0.0])
    plot_states(path, [row], View(15, 15), ground=0.0, way=way)
    assert share(path, ACCENT) > 1e-4
    with pytest.raises(OSError, match="No such file"):
        plot_states(tmp_path / "none" / "states.png", [row], View())
