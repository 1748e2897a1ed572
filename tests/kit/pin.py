"""Results pinned as tables: tests/golden/NAME.csv has a line `quantity,value` for each of them."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import shapely

GOLDEN = Path(__file__).parents[1] / "golden"
# Longer arrays are pinned by their size, sum, norm and a sum that tells order and sign.
LISTED = 6


def quantities(found: Any, name: str = "") -> Iterator[tuple[str, float | str]]:
    """Yield each number and word that a result holds, with a name that tells its place."""
    if isinstance(found, Mapping):
        for key, value in found.items():
            yield from quantities(value, f"{name}: {key}" if name else str(key))
    elif isinstance(found, shapely.Geometry):
        yield from quantities(_of_shape(found), name)
    elif isinstance(found, np.ndarray) and found.size > LISTED:
        yield from quantities(_of_array(found), name)
    elif isinstance(found, np.ndarray | list | tuple):
        yield f"{name}: count", float(len(found))
        for k, value in enumerate(found):
            yield from quantities(value, f"{name}: {k}")
    elif found is None or isinstance(found, str):
        yield name, "none" if found is None else found
    else:
        yield name, float(found)


def _of_array(found: np.ndarray) -> dict[str, float | str]:
    flat = found.astype(float).ravel()
    wave = np.sin(1.0 + np.arange(flat.size))
    return {
        "shape": " x ".join(map(str, found.shape)),
        "sum": flat.sum(),
        "norm": float(np.linalg.norm(flat)),
        "wave": flat @ wave,  # NaN in one entry is NaN in all three
    }


def _of_shape(found: shapely.Geometry) -> dict[str, Any]:
    """Return what a shape is; how many corners a union has is a matter of rounding."""
    parts = shapely.get_parts(found)
    return {
        "kind": found.geom_type,
        "parts": len(parts),
        "holes": sum(len(part.interiors) for part in parts if part.geom_type == "Polygon"),
        "area": found.area,
        "length": found.length,
        "bounds": found.bounds,
        "centroid": shapely.get_coordinates(found.centroid).ravel(),
    }


def table_of(path: Path) -> dict[str, str]:
    """Return a pinned table, empty where there is none yet."""
    if not path.exists():
        return {}
    with path.open(encoding="utf-8", newline="") as file:
        return dict(csv.reader(file))


def differences(
    known: Mapping[str, str], found: Mapping[str, float | str], rel: float, small: float
) -> list[str]:
    """Return a line for each quantity that is gone, new or changed.

    Args:
        known: The pinned values, as written.
        found: Today's values.
        rel, small: Relative and absolute tolerance of numbers; words must be equal.
    """
    lines = []
    for name in {**known, **found}:
        was, now = known.get(name), found.get(name)
        if was is None or now is None:
            same = False
        elif isinstance(now, str):
            same = was == now
        else:
            same = bool(np.isclose(now, _number(was), rel, small, equal_nan=True))
        if not same:
            lines.append(f"{name}: {was} -> {now}")
    return lines


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.inf


def written(value: float | str) -> str:
    """Return a value as a table has it: twelve digits, enough for pins at 1e-9."""
    return value if isinstance(value, str) else f"{value:.12g}"


def pin(name: str, found: Any, rel: float, small: float, *, write: bool) -> list[str]:
    """Return the differences of a result from its table, or write the table anew.

    Args:
        name: Name of the table; one in a folder has a slash.
        found: The result: numbers, words, arrays and shapes, in mappings and lists.
        rel, small: Tolerances, as of `differences`.
        write: Whether to write the table; its difference in git is what is reviewed.
    """
    path, today = GOLDEN / f"{name.replace(' ', '_')}.csv", dict(quantities(found))
    if not write:
        return differences(table_of(path), today, rel, small)
    path.parent.mkdir(exist_ok=True)
    with path.open("w", encoding="utf-8", newline="") as file:
        rows = ((key, written(value)) for key, value in today.items())
        csv.writer(file, lineterminator="\n").writerows(rows)
    return []
