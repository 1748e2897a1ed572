import numpy as np
import pytest
from mpi4py import MPI

from toros_fem.design.lines.field import LineField, LineOptions
from toros_fem.meshes.makers.sheets import rectangle

SHEET = rectangle(MPI.COMM_SELF, 0.02, 0.01, 5e-3)
COUNT = len(SHEET.panel)


def test_holds_copies_that_do_not_change() -> None:
    shares = np.full((COUNT, 2), 0.1)
    field = LineField(SHEET, shares, np.zeros((COUNT, 2)))
    shares[:] = 0.5
    assert field.families == 2
    assert field.shares.max() == 0.1
    with pytest.raises(ValueError, match="read-only"):
        field.angles[0, 0] = 1.0


def test_one_width_counts_for_all_families() -> None:
    assert LineOptions(widths=(1e-3,)).width_of(1, 2) == 1e-3
    assert LineOptions(widths=(4e-3, 1e-3)).width_of(1, 2) == 1e-3
