"""Views show a shape from where it can be understood."""

import numpy as np
import pytest
from helpers.runs import bent

from toros_fem.meshes import Pattern
from toros_fem.results.pictures.raster import View, oblique_view, side_view


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
