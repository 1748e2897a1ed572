"""Tests, sheets and strips that are none end in typed errors that say why."""

# The types are wrong on purpose.
# mypy: disable-error-code="arg-type,list-item"

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from helpers.tensile_tests import synthetic
from helpers.tiles import printed_tile
from mpi4py import MPI

from toros_fem import FitOptions, TensileTest, fit_material
from toros_fem.base.errors import MeasurementError, ParameterError
from toros_fem.products.fitting import ClampedStrip, fit_printed_sheet

ALONE = MPI.COMM_SELF
FEW = FitOptions(up_to=1.05)
STRETCH = np.linspace(1, 1.5, 6)
PULL = np.linspace(0, 1, 6)


def pulled(direction: str = "", **changes: Any) -> TensileTest:
    given = {"stretch": STRETCH, "stress": PULL, "thickness": 1e-3, "direction": direction}
    return TensileTest(**{**given, **changes})


ROWS: list[tuple[Callable[[], object], type[Exception], str]] = [
    (lambda: pulled(stretch=np.ones(3)), ParameterError, "n at least 5"),
    (lambda: pulled(stress=np.ones(4)), ParameterError, "as the stretch"),
    (lambda: pulled(stretch=np.linspace(-1, 1, 6)), ParameterError, "positive, 1 at rest"),
    (lambda: pulled(stress=np.full(6, np.nan)), ParameterError, "not finite"),
    (lambda: fit_material([]), ParameterError, "at least one TensileTest"),
    (lambda: fit_material([synthetic()], FEW), MeasurementError, "2 points"),
    (lambda: fit_material([pulled("0"), pulled("45")]), MeasurementError, "perpendicular"),
    (lambda: fit_material([pulled(stress=-PULL)]), MeasurementError, "sign of the force"),
    (lambda: ClampedStrip(ALONE, 0.1, 0.02, edges=1), ParameterError, "edges"),
    (lambda: ClampedStrip(ALONE, 0.1, 0.02, gauge=0.2), ParameterError, "gauge"),
    (lambda: ClampedStrip(ALONE, 100.0, 0.02), ParameterError, "is no strip"),
    (
        lambda: fit_printed_sheet(ALONE, [pulled("wale")], printed_tile(ALONE), 2, 1),
        MeasurementError,
        "pulled along 'wale'",
    ),
]


@pytest.mark.parametrize(("call", "error", "message"), ROWS, ids=[row[2] for row in ROWS])
def test_refusals(call: Callable[[], object], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        call()
