"""A miss looks like a miss, and what is reached is told as reached."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.runs import bent, regions_of
from matplotlib.figure import Figure as Page

from toros_fem.measures.figures import Figure
from toros_fem.measures.miss import Miss, miss_of
from toros_fem.mechanics.contact.solids import rigid_sphere
from toros_fem.meshes import Pattern, bend, twist
from toros_fem.results.frames.shown_skin import ShownSkin
from toros_fem.results.pictures.inflation import draw_inflation
from toros_fem.results.pictures.shapes import draw_miss, draw_shape, plot_states, verdict
from toros_fem.results.pictures.shown import DrawnSkin, material_lines, visible
from toros_fem.results.pictures.stage import Stage
from toros_fem.results.pictures.style import ACCENT, page
from toros_fem.results.pictures.view import View

ALL = (True, True, True)
NEAR, FAR = Miss(np.zeros(1), 1e-3, 0.1, True), Miss(np.zeros(1), 4e-3, 0.1, True)


def angle(value: float | None, interval: float | None = 1.0) -> Figure:
    return Figure("angle", "deg", value, interval, 90.0, 2.7)


@pytest.mark.parametrize(
    ("figure", "miss", "word"),
    [
        (angle(90.5), NEAR, "Reached"),
        (angle(90.5), FAR, "Missed"),
        (angle(90.5), None, "Reached"),
        (angle(80.0), NEAR, "Missed"),
        (angle(92.5), NEAR, "Not certain"),
        (angle(93.5), NEAR, "Not certain"),
        (angle(90.5, None), NEAR, "Reached"),
        (angle(95.0, None), NEAR, "Missed"),
        (angle(None), None, "No equilibrium"),
    ],
)
def test_verdicts(figure: Figure, miss: Miss | None, word: str) -> None:
    found = verdict([figure], miss)
    assert found is not None
    assert found.word == word
    assert ("not estimated" in found.reason) == (figure.interval is None and bool(figure.value))


def test_without_a_target_there_is_no_verdict() -> None:
    assert verdict([], None) is None


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


def test_reached_and_missed_are_written_large(drawn: DrawnSkin, pattern: Pattern) -> None:
    """The same figure in another shape is a miss, which the shape's row tells."""
    reached, missed = Page(figsize=(8, 4.5)), Page(figsize=(8, 4.5))
    draw_shape(reached, drawn, bent(pattern, np.pi / 2), [angle(90.0)])
    leaning = bent(pattern, np.pi / 2) @ np.array([[0.94, 0.34, 0], [-0.34, 0.94, 0], [0, 0, 1.0]])
    draw_shape(missed, drawn, leaning, [angle(90.0)])
    assert "Reached" in written(reached)
    assert "0 mm, 0.0 %" in written(reached)
    assert "Missed" in written(missed)
    assert "90.0 ± 1.0°" in written(missed)


def test_the_target_lies_over_the_skin(
    tmp_path: Path, drawn: DrawnSkin, pattern: Pattern, share: Callable[[Path, str], float]
) -> None:
    path = tmp_path / "shape.png"
    with page(path, "A title") as figure:
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


def test_a_miss_is_measured_by_sections(pattern: Pattern) -> None:
    """A tube may swell; a whole shift counts; what is not compared does not."""
    target = pattern.points
    swollen = target * [1.5, 1.5, 1.0]
    assert miss_of(pattern, swollen, target).rms < 2e-4
    shifted = target + [0.003, 0.0, 0.004]
    assert miss_of(pattern, shifted, target).rms == pytest.approx(5e-3)
    assert miss_of(pattern, shifted, target, (True, True, False)).rms == pytest.approx(3e-3)
    assert miss_of(pattern, shifted, target).each == pytest.approx(5e-3)
    flat = replace_points(pattern)
    found = miss_of(flat, flat.points * [1.1, 1.1, 1.0], flat.points)
    assert not found.by_sections
    assert found.rms > 1e-3


def replace_points(pattern: Pattern) -> Pattern:
    """The tube as a body that is as wide as long."""
    return replace(pattern, points=pattern.points * [7.0, 7.0, 1.0])


def test_colours_of_a_miss_end_at_its_largest(drawn: DrawnSkin, pattern: Pattern) -> None:
    figure = Page(figsize=(8, 4.5))
    draw_miss(figure, drawn, bent(pattern, np.pi / 2) + [0.0, 0.003, 0.004])
    assert "5 mm from the target on average, 3.3 % of the length" in written(figure)
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
    stage = Stage(Page(figsize=(4, 4)), (0, 0, 1, 1), View(20, 0), pattern.points)
    stage.ground(0.0, pattern.points)
    assert len(stage.axes.patches) == 1


def test_lines_follow_the_skin(pattern: Pattern) -> None:
    """They are straight in a tube at rest, and wind once around it where it twists by 360°."""
    lines = material_lines(pattern)
    assert len(lines) == 3
    for line in lines:
        rest = line.at(pattern.triangles, pattern.points)
        assert np.ptp(rest[:, 2]) == pytest.approx(0.15)
        angles = np.unwrap(np.arctan2(rest[:, 1], rest[:, 0]))
        assert np.ptp(angles) < 0.1
        wound = line.at(pattern.triangles, twist(2 * np.pi, 0.15)(pattern.points))
        turn = np.ptp(np.unwrap(np.arctan2(wound[:, 1], wound[:, 0])))
        assert turn == pytest.approx(2 * np.pi, rel=0.05)


def test_hidden_points_are_told(drawn: DrawnSkin, pattern: Pattern) -> None:
    stage = Stage(Page(figsize=(4, 4)), (0, 0, 1, 1), View(), pattern.points)
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


def test_states_in_rows(
    tmp_path: Path, pattern: Pattern, share: Callable[[Path, str], float]
) -> None:
    skin = DrawnSkin(ShownSkin(pattern, regions=regions_of(pattern)))
    row = [(f"state {k}", skin.surfaces(bent(pattern, 0.3 * k + 0.1))) for k in range(3)]
    path = tmp_path / "states.png"
    plot_states(path, [row, row], View(15, 15), "A gait", ground=0.0)
    assert share(path, "#F1F2F4") > 0.01
    with pytest.raises(OSError, match="No such file"):
        plot_states(tmp_path / "none" / "states.png", [row], View())
