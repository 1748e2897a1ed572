"""Pixels are where the geometry says, and what is before hides what is behind."""

import numpy as np
import pytest
import shapely
from helpers.runs import bent, regions_of

from toros_fem.making.printability import printed_fractions
from toros_fem.mechanics.contact.solids import rigid_sphere
from toros_fem.meshes import Pattern
from toros_fem.results.pictures.raster import (
    DrawnSurface,
    Image,
    View,
    ink_of,
    oblique_view,
    render,
    side_view,
    silhouettes,
    window_of,
)
from toros_fem.results.pictures.style import BODY, FABRIC

BALL = rigid_sphere("ball", 0.01)
RED, GREEN = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


def test_directions_are_those_of_a_viewer() -> None:
    right, up, toward = View().directions
    assert right.tolist() == [1, 0, 0]
    assert up == pytest.approx([0, 0, 1])
    assert toward == pytest.approx([0, -1, 0])
    for view in (View(20, 35), View(-40, 200)):
        assert view.directions @ view.directions.T == pytest.approx(np.eye(3))
        assert np.linalg.det(view.directions) == pytest.approx(1)


@pytest.mark.parametrize("turn", [0, 45, 90])
def test_a_bend_is_seen_across_its_plane(pattern: Pattern, turn: float) -> None:
    x = bent(pattern, np.pi / 2)
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    turned = x @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    assert side_view(turned) == View(0.0, turn)


def test_a_straight_tube_is_seen_along_y(pattern: Pattern) -> None:
    assert side_view(pattern.points) == View()


def test_equal_legs_are_seen_in_pairs() -> None:
    """Those at the back are behind those in front, not beside them."""
    leg = np.array([[x, y, 0.0] for x in np.linspace(0.02, 0.06, 9) for y in (-0.01, 0.01)])
    legs = [leg @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
            for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1))]  # fmt: skip
    assert side_view(np.concatenate(legs)) == View()


def test_the_oblique_view_shows_the_print(pattern: Pattern) -> None:
    """Print on one side of a straight tube is towards the viewer, who is above."""
    for side in (1, -1):
        share = (side * pattern.points[pattern.triangles][:, :, 0].mean(axis=1) > 0.005) * 1.0
        view = oblique_view(pattern.triangles, pattern.points, share, View())
        assert side * view.directions[2, 0] > 0.5
        assert view.elevation > 0
        assert 30 <= abs(view.turn) <= 60, "from the same side as the side view"


def area(image: Image, scale: float) -> float:
    """The covered area in m²."""
    return float(image.colours[..., 3].sum() / 255 / scale**2)


@pytest.mark.parametrize("view", [View(), View(25, 35), View(-40, 200)])
def test_a_ball_is_a_disc(view: View) -> None:
    window = window_of(view.project(BALL.points), 1.5, 600)
    image = render([DrawnSurface(BALL.triangles, BALL.points, closed=True)], view, window)
    hull = shapely.MultiPoint(view.project(BALL.points)).convex_hull
    assert area(image, window.scale) == pytest.approx(hull.area, rel=0.015)
    assert image.depth.max() == pytest.approx(view.depth(BALL.points).max(), rel=1e-2)


def test_the_nearer_one_hides_the_other() -> None:
    """Also where two surfaces cross: the border is where they do."""
    for ahead, seen in ((-0.03, RED), (0.03, GREEN)):
        other = BALL.points + [0, ahead, 0]
        surfaces = [
            DrawnSurface(BALL.triangles, other, RED, closed=True),
            DrawnSurface(BALL.triangles, BALL.points, GREEN, closed=True),
        ]
        window = window_of(View().project(BALL.points), 1.0, 200)
        middle = render(surfaces, View(), window).colours[90:110, 90:110, :3] / 255
        assert np.abs(middle - middle.max() * seen).max() < 0.1
    beside = [
        DrawnSurface(BALL.triangles, BALL.points - [0.005, 0, 0], RED, closed=True),
        DrawnSurface(BALL.triangles, BALL.points + [0.005, 0, 0], GREEN, closed=True),
    ]
    window = window_of(View().project(np.concatenate([s.points for s in beside])), 1.5, 300)
    picture = render(beside, View(), window).colours
    row = picture[len(picture) // 2]
    red = (row[:, 0] > row[:, 1]) & (row[:, 3] > 200)
    assert red[: len(row) // 2 - 3].sum() > 0.9 * (len(row) // 2 - 5)
    assert not red[len(row) // 2 + 3 : -4].any()  # its silhouette ends the row


@pytest.mark.parametrize("angle", [0.0, np.pi / 2])
def test_the_printed_area_is_that_of_the_print(pattern: Pattern, angle: float) -> None:
    """Of the triangles that face the viewer, with no part before another."""
    regions = regions_of(pattern)
    x = pattern.points if angle == 0 else bent(pattern, angle)
    view = View(0, 90.0)
    window = window_of(view.project(x), 0.8, 1200)
    surface = DrawnSurface(pattern.triangles, x, FABRIC, ink_of(pattern, regions), closed=True)
    colours = render([surface], view, window).colours
    dark = (colours[..., 3] > 127) & (colours[..., 2].astype(int) > colours[..., 0] * 1.3)
    share = printed_fractions(pattern, regions)
    a, b, c = np.moveaxis(x[pattern.triangles], 1, 0)
    facing = np.maximum(np.cross(b - a, c - a) @ view.directions[2] / 2, 0)
    if angle == 0:
        assert dark.sum() / window.scale**2 == pytest.approx(facing @ share, rel=0.02)
    else:
        assert 0 < dark.sum() / window.scale**2 < 1.02 * (facing @ share)


def test_data_keep_their_colour(pattern: Pattern) -> None:
    """With no contrast the light changes nothing; print is darker by its factor."""
    colours = np.tile(RED, (len(pattern.triangles), 3, 1))
    ink = ink_of(pattern, regions_of(pattern))
    surface = DrawnSurface(
        pattern.triangles, pattern.points, colours, ink, contrast=0.0, ink_shade=0.5, closed=True
    )
    window = window_of(View(0, 90).project(pattern.points), 0.5, 300)
    found = render([surface], View(0, 90), window).colours
    inner = found[10:-10, 10:-10]
    reds = np.unique(inner[inner[..., 3] == 255][:, 0])
    assert {128, 255} <= set(reds.tolist())


def test_an_open_skin_shows_its_inside_darker() -> None:
    """Both sides of a sheet are seen, and a closed one is drawn from outside only."""
    square = np.array([[0, 0, 0], [0.01, 0, 0], [0.01, 0, 0.01], [0, 0, 0.01]])
    cells = np.array([[0, 1, 2], [0, 2, 3]])
    window = window_of(View().project(square), 1.0, 100)
    front = render([DrawnSurface(cells, square)], View(), window).colours[50, 50, :3]
    back = render([DrawnSurface(cells[:, ::-1], square)], View(), window).colours[50, 50, :3]
    assert back.max() < front.max()
    hidden = render([DrawnSurface(cells[:, ::-1], square, closed=True)], View(), window)
    assert hidden.colours[..., 3].max() == 0


def test_silhouettes_follow_steps_of_the_depth() -> None:
    depth = np.zeros((20, 20), dtype=np.float32)
    depth[5:15, 5:15] = 1.0
    found = silhouettes(depth, 0.5)
    assert found[4, 10]
    assert found[5, 10]
    assert found[14, 10]
    assert found[15, 10]
    assert not found[10, 10]
    assert not silhouettes(depth, 2.0).any()


def test_what_lies_outside_of_the_window_is_left_out() -> None:
    window = window_of(np.array([[1.0, 1.0], [1.01, 1.01]]), 1.0, 50)
    image = render([DrawnSurface(BALL.triangles, BALL.points, BODY)], View(), window)
    assert image.colours[..., 3].max() == 0


def test_layers_of_one_surface_hide_each_other() -> None:
    """Two sheets of one skin, the further one last and first."""
    sheet = np.array([[0, 0, 0], [0.01, 0, 0], [0.01, 0, 0.01], [0, 0, 0.01]])
    points = np.concatenate([sheet, sheet + [0, 0.01, 0]])  # the viewer is at −y
    cells = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    colours = np.array([RED, RED, GREEN, GREEN])
    window = window_of(View().project(sheet), 1.0, 60)
    for order in ([0, 1, 2, 3], [2, 3, 0, 1]):
        surface = DrawnSurface(cells[order], points, colours[order])
        pixel = render([surface], View(), window).colours[30, 30, :3]
        assert pixel[0] > 100
        assert pixel[1] == 0
