"""The comparison with a pinned table tells each change."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from kit.pin import differences, quantities, written

FOUND = {
    "angle": 12.5,
    "reason": "converged",
    "shape": shapely.box(0, 0, 2, 1),
    "path": np.arange(8.0),
    "rows": [{"step": 1}, {"step": 2}],
    "pressure": None,
}


def changed(**values: object) -> list[str]:
    known = {name: written(value) for name, value in quantities(FOUND)}
    return differences(known, dict(quantities({**FOUND, **values})), 1e-6, 0.0)


def test_equal_results_have_no_differences() -> None:
    assert changed() == []
    assert changed(angle=12.5 * (1 + 1e-7)) == []


@pytest.mark.parametrize(
    ("name", "value", "lines"),
    [
        ("angle", 12.5001, 1),
        ("angle", np.nan, 1),
        ("angle", None, 1),
        ("reason", "diverged", 1),
        ("pressure", 0.0, 1),
        ("path", np.arange(8.0)[::-1], 1),  # same sum and norm
        ("path", np.where(np.arange(8) == 0, np.nan, np.arange(8.0)), 3),
        ("rows", [{"step": 1}], 2),
        ("shape", shapely.box(0, 0, 1, 2), 4),
    ],
)
def test_a_change_is_told(name: str, value: object, lines: int) -> None:
    found = changed(**{name: value})
    assert len(found) == lines
    assert all(line.startswith(name) for line in found)


def test_what_is_gone_or_new_is_told() -> None:
    assert differences({"a": "1"}, {"b": 1.0}, 1e-6, 0.0) == ["a: 1 -> None", "b: None -> 1.0"]
