"""Tests, sheets and strips that are none end in typed errors that say why."""

# The types are wrong on purpose.
# mypy: disable-error-code="arg-type,list-item"

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from helpers.tensile_tests import JERSEY, synthetic
from helpers.tiles import printed_tile
from mpi4py import MPI

from toros_fem import fit_material
from toros_fem.base.errors import MeasurementError, ParameterError
from toros_fem.materials.sheet import Material
from toros_fem.products.fitting.reading import Given
from toros_fem.products.fitting.sheet_fit import fit_printed_sheet
from toros_fem.products.fitting.strip import ClampedStrip
from toros_fem.products.fitting.tensile_test import TensileTest
from toros_fem.products.fitting.uniaxial import uniaxial_curve
from toros_fem.products.options import FitOptions

ALONE = MPI.COMM_SELF
FEW = FitOptions(up_to=1.05)
STRETCH = np.linspace(1, 1.5, 6)
PULL = np.linspace(0, 1, 6)


def curve(stretch: object = 1.1, sheet: Material = JERSEY, **changes: Any) -> object:
    return uniaxial_curve(sheet, [stretch], **changes)


def pulled(direction: str = "", **changes: Any) -> TensileTest:
    given = {"stretch": STRETCH, "stress": PULL, "thickness": 1e-3, "direction": direction}
    return TensileTest(**{**given, **changes})


def on_a_sheet(test: TensileTest) -> object:
    return fit_printed_sheet(ALONE, [test], printed_tile(ALONE), 2, 1)


ROWS: list[tuple[Callable[[], object], type[Exception], str]] = [
    (lambda: pulled(stretch=np.ones(3)), ParameterError, "n at least 5"),
    (lambda: pulled(stress=np.ones(4)), ParameterError, "as the stretch"),
    (lambda: pulled(stretch=np.linspace(-1, 1, 6)), ParameterError, "positive, 1 at rest"),
    (lambda: pulled(stress=np.full(6, np.nan)), ParameterError, "not finite"),
    (lambda: pulled().branch("second"), ParameterError, "must be one of"),
    (lambda: Given(units={"force": "lb"}), ParameterError, "is in 'lb'; known are N"),
    (lambda: Given(units={"time": "s"}), ParameterError, "no such column"),
    (lambda: curve(0.9), ParameterError, r"0.9 to 0.9 must lie in"),
    (lambda: curve(1.9), ParameterError, r"1.9 to 1.9 must lie in"),
    (lambda: curve([1.1]), ParameterError, "finite and of shape"),
    (lambda: curve(sheet=Material(1e5, 0.3, 5e-4, 1.9)), ParameterError, "c2 = None must be given"),
    (lambda: curve(knit_ratio=0.5), ParameterError, "at least 1"),
    (lambda: curve(direction="up"), ParameterError, "direction = 'up'"),
    (lambda: fit_material([]), ParameterError, "at least one TensileTest"),
    (lambda: fit_material([synthetic()], FEW), MeasurementError, "2 points"),
    (lambda: fit_material([pulled("0"), pulled("45")]), MeasurementError, "perpendicular"),
    (lambda: fit_material([pulled(stress=-PULL)]), MeasurementError, "sign of the force"),
    (lambda: ClampedStrip(ALONE, 0.1, 0.02, edges=1), ParameterError, "edges"),
    (lambda: ClampedStrip(ALONE, 0.1, 0.02, gauge=0.2), ParameterError, "gauge"),
    (lambda: ClampedStrip(ALONE, 100.0, 0.02), ParameterError, "is no strip"),
    (lambda: on_a_sheet(pulled("wale")), MeasurementError, "pulled along 'wale'"),
]


@pytest.mark.parametrize(("call", "error", "message"), ROWS, ids=[row[2] for row in ROWS])
def test_refusals(call: Callable[[], object], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        call()
