"""The ruler of a sheet keeps its distance from panels and from the border."""

import tracemalloc

import pytest
import shapely

from toros_fem.making.panels.marks import ruler


@pytest.mark.parametrize(("room", "fits"), [(9.1e-3, True), (8.9e-3, False)])
def test_the_ruler_takes_a_band_that_is_just_high_enough(room: float, fits: bool) -> None:
    """7 mm for itself, 1 mm to the border and 1 mm to what is cut."""
    (base, *_), _ = ruler(shapely.box(0.0, room, 0.2, 0.1), (0.2, 0.1))
    assert (base.min() > 0) == fits  # else below the sheet


def test_ruler_of_a_long_roll_takes_little_memory() -> None:
    """Places are tried row by row: a grid of all of a roll would fill the memory."""
    tracemalloc.start()
    lines, _ = ruler(shapely.Polygon(), (5.0, 100.0))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert lines[0][0, 1] < 0.02
    assert peak < 5e6
