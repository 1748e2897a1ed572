"""The ruler of a sheet keeps its distance from panels and from the border."""

import pytest
import shapely

from toros_fem.making.panels.marks import ruler


@pytest.mark.parametrize(("room", "fits"), [(9.1e-3, True), (8.9e-3, False)])
def test_the_ruler_takes_a_band_that_is_just_high_enough(room: float, fits: bool) -> None:
    """7 mm for itself, 1 mm to the border and 1 mm to what is cut."""
    (base, *_), _ = ruler(shapely.box(0.0, room, 0.2, 0.1), (0.2, 0.1))
    assert (base.min() > 0) == fits  # else below the sheet
