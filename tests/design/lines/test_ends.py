import numpy as np
import pytest
from helpers.lines import distance_to_others, largest_jump
from mpi4py import MPI

from toros_fem.design.lines.centre_lines import CentreLine, LinesOfFamily
from toros_fem.design.lines.ends import Net
from toros_fem.design.lines.field import LineField, LineOptions, in_plane, make_line_mesh
from toros_fem.design.lines.laid_lines import LaidLines
from toros_fem.design.lines.lay_lines import lay_lines
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.sheets import disc, one_panel, rectangle

DISC = disc(MPI.COMM_SELF, 0.025, 2.5e-3)
SHEET = rectangle(MPI.COMM_SELF, 0.06, 0.04, 2.5e-3, "unstructured")


def rays(pattern: Pattern) -> np.ndarray:
    return np.arctan2(pattern.centroids[:, 1], pattern.centroids[:, 0])


def check_ends(laid: LaidLines) -> None:
    """Every end lies on the border or on another line."""
    pattern = laid.pattern
    border = pattern.flat_points[np.unique(pattern.free_edges)]  # one panel: not sewn
    low, high = border.min(axis=0), border.max(axis=0)
    for line in (line for family in laid.families for line in family.lines):
        for side, kind in enumerate(line.ends):
            end = line.points[0 if side == 0 else -1, side]
            if kind == "line":
                assert distance_to_others(laid, line, side) < 1e-9
            else:
                assert kind == "border"
                round_off = abs(np.linalg.norm(end) - np.linalg.norm(border, axis=1).max())
                straight_off = min(np.abs(end - low).min(), np.abs(end - high).min())
                assert min(round_off, straight_off) < 2e-4
    assert largest_jump(laid) < 1e-9


@pytest.mark.parametrize("turn", [0.7, np.pi / 2, None])
def test_lines_around_a_point_have_no_open_ends(turn: float | None) -> None:
    """Rays, spirals, rings, and the field of half a turn around the centre."""
    angle = rays(DISC) / 2 if turn is None else rays(DISC) + turn
    field = LineField(DISC, np.full((len(angle), 1), 0.2), angle[:, None])
    laid = lay_lines(field)
    check_ends(laid)
    assert laid.families[0].laid == pytest.approx(0.2, abs=0.02)
    if turn == np.pi / 2:
        assert all(line.closed for line in laid.families[0].lines)
    elif turn is not None:
        assert laid.families[0].ends["border"] > len(laid.families[0].lines) / 2


def test_noise_does_not_break_lines() -> None:
    """What changes from triangle to triangle is averaged; without that, still no end is open."""
    noise = np.random.default_rng(0).standard_normal((4, len(SHEET.panel)))
    angles = np.array([0.6, -0.6])[:, None] + 0.5 * noise[:2]
    field = LineField(SHEET, (0.2 * np.exp(0.3 * noise[2:])).T, angles.T)
    laid = lay_lines(field)
    check_ends(laid)
    assert [family.ends for family in laid.families] == [
        {"border": 2 * len(family.lines)} for family in laid.families
    ]
    for family, angle in zip(laid.families, (0.6, -0.6), strict=True):
        points = np.concatenate([line.points for line in family.lines])
        segments = points[:, 1] - points[:, 0]
        double = np.exp(2j * np.arctan2(segments[:, 1], segments[:, 0]))
        length = np.linalg.norm(segments, axis=1)
        off = np.angle(double * np.exp(-2j * angle)) / 2
        assert np.sqrt(np.average(off**2, weights=length)) < np.radians(8)
    check_ends(lay_lines(field, LineOptions(even=None)))


@pytest.mark.parametrize(("spacing", "end"), [(13.0e-3, "line"), (15.4e-3, "border")])
def test_a_line_meets_itself_after_three_spacings(spacing: float, end: str) -> None:
    """A loop of 40 mm in one large triangle: closed where it is longer than three spacings."""
    corners = np.array([[0.0, 0.0], [0.2, 0.0], [0.0, 0.2]])
    mesh = make_line_mesh(one_panel(corners, np.array([[0, 1, 2]])), np.ones(1, dtype=bool))
    nodes = np.array([[30, 0], [30, 19.9], [30, 30], [40, 30], [40, 20], [25, 20]]) * 1e-3
    line = CentreLine(np.zeros(5, dtype=int), in_plane(np.stack([nodes[:-1], nodes[1:]], axis=1)))
    even = np.full(mesh.size, spacing)
    family = LinesOfFamily(1e-3, [line], np.zeros((1, 3)), even, 0.1 * even, (1e-4, even))
    net = Net(mesh, [family], ())
    net.close()
    ((found,),) = (family.lines for family in net.result())
    assert found.ends == ("border", end)
    assert found.points[-1, 1] == pytest.approx([0.03 if end == "line" else 0.0, 0.02], abs=1e-12)
