import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.errors import ParameterError
from toros_fem.meshes import cylinder
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.sheet import rectangle
from toros_fem.relaxed import LineField, LineOptions, lay_lines


def even_field(pattern: Pattern, shares: list[float], degrees: list[float]) -> LineField:
    """The same shares and directions everywhere."""
    ones = np.ones((len(pattern.panel), 1))
    return LineField(pattern, ones * shares, ones * np.radians(degrees))


def test_parallel_lines_on_a_square_are_straight_and_evenly_spaced() -> None:
    sheet = rectangle(MPI.COMM_SELF, 0.04, 0.04, 2e-3, "unstructured")
    laid = lay_lines(even_field(sheet, [0.2], [90.0]), LineOptions(widths=(1e-3,)))
    places = [line.points[..., 0] for line in laid.centre_lines[0]]
    assert max(np.ptp(x) for x in places) < 1e-9
    steps = np.diff(sorted(x.mean() for x in places))
    assert len(places) == 8
    assert np.allclose(steps, 5e-3, rtol=0, atol=1e-9)
    assert laid.families[0].length == pytest.approx(8 * 0.04, abs=1e-9)


def test_cover_is_the_area_of_the_polygons() -> None:
    tube = cylinder(MPI.COMM_SELF, 0.06, 0.02, 2e-3)
    caps = tube.panel != tube.panel_index("wall")
    field = even_field(tube, [0.2, 0.15], [30.0, 80.0])
    laid = lay_lines(field, printed=caps)
    cover = laid.cover(tube)
    assert np.all((cover >= 0) & (cover <= 1))
    assert np.allclose(cover[caps], 1.0, atol=1e-12)
    assert cover @ tube.areas == pytest.approx(laid.area, rel=1e-9)


def test_what_does_not_fit_is_refused() -> None:
    sheet = rectangle(MPI.COMM_SELF, 0.02, 0.02, 5e-3)
    field = even_field(sheet, [0.2, 0.2], [0.0, 90.0])
    with pytest.raises(ParameterError, match="printed has shape"):
        lay_lines(field, printed=np.zeros(3, dtype=bool))
    with pytest.raises(ParameterError, match="3 widths for 2 families"):
        lay_lines(field, LineOptions(widths=(1e-3, 1e-3, 2e-3)))
