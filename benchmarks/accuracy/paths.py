"""Paths through limit points: a hinged roof, a bulging tube and a printed lid that pops.

The roof of Sze, Liu & Lo (2004, section 3.8) snaps through, the thin one also back. The tube
without stretch bounds passes its limit pressure and bulges; the closed form of a bulge in a long
tube is its reference. The lid is a skin of the package: a printed sheet, moulded so that it sags.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from benchmarks.accuracy.scenes import entry, rows_where, table_a
from benchmarks.accuracy.snapping import (
    ROOF_LOAD,
    ROOF_THICKNESSES,
    Scene,
    bulge,
    lid,
    middle_radius,
    roof,
    unbounded_tube,
)
from benchmarks.accuracy.tubes import RADIUS
from benchmarks.bench import Case, Row, Rows, markdown, timed, values_of
from toros_fem.base.validation import Floats
from toros_fem.mechanics.paths.arc_length import ArcLengthOptions
from toros_fem.mechanics.paths.trace import trace
from toros_fem.mechanics.paths.trace_point import TracePoint, limit_points
from toros_fem.mechanics.skin.load import Load

ROOF_OPTIONS = ArcLengthOptions(first=0.01, lowest=None, highest=1.0, largest_increment=0.05)
TUBE_OPTIONS = ArcLengthOptions(first=0.3, lowest=1.2, highest=None)
LID_OPTIONS = ArcLengthOptions(
    first=0.0, first_increment=0.01, lowest=None, highest=0.4, largest_movement=0.01
)


def follow(scene: Scene, options: ArcLengthOptions) -> tuple[list[TracePoint], list[float], float]:
    """Return the points of a path, the load factors of its limit points, and seconds."""
    points, seconds = timed(
        lambda: list(
            trace(
                scene.solver, scene.density, Load(scene.pressure, force=scene.force),
                by="arc-length", options=options,
            )
        )
    )  # fmt: skip
    return points, [turn.load_factor for turn in limit_points(points)], seconds


def limits(case: str, variant: str, size: int, unit: str, found: list[float]) -> Iterator[Row]:
    """Return a row for each limit point."""
    for number, value in enumerate(found, 1):
        yield Row(case, variant, f"{size}", f"limit {number}", value, unit)


def published_roof() -> Floats:
    """Return published load factors and deflections in mm of the thick roof, (n, 2)."""
    rows = rows_where("sze38_hinged_roof")
    return np.array([[float(word) for word in row.values()] for row in rows])


def roof_path(thickness: float, count: int) -> Iterator[Row]:
    """Follow the roof; the published deflections are met at loads that differ by the error."""
    place = ("path-roof", f"{1e3 * thickness:g} mm", f"{count}")
    scene, top = roof(count, thickness)
    points, turns, seconds = follow(scene, ROOF_OPTIONS)
    yield from limits(*place[:2], count, "N", [ROOF_LOAD * turn for turn in turns])
    if thickness == ROOF_THICKNESSES[0]:
        down = [-1e3 * point.positions[top, 2] for point in points]
        factor = [point.load_factor for point in points]
        known = published_roof()
        # On the rising branch the deflection is a function of the load; the other way is as good.
        rising = int(np.argmax(factor)) + 2
        load = np.interp(known[:, 1], down[:rising], factor[:rising])
        error = float(np.abs(load - known[:, 0]).max() / known[-1, 0])
        yield Row(*place, "error of the load", error, "", 0.0, seconds)


def tube_path(sides: int) -> Iterator[Row]:
    """Follow the tube: its limit pressure, and the hoop stretches of its bulge."""
    place = ("path-tube", "", f"{sides}")
    scene = unbounded_tube(sides)
    points, turns, seconds = follow(scene, TUBE_OPTIONS)
    polygon = np.cos(np.pi / sides)
    homogeneous = entry("stvk_limit_pressures", "Pmax_Pa", mat="A") / polygon
    yield Row(*place, "limit 1", 1e3 * turns[0], "Pa", float(homogeneous), seconds)
    errors = []
    for point in points:
        found = middle_radius(scene.pattern, point.positions)
        if found > 4:
            exact = bulge(table_a().fabric, 1e3 * point.load_factor, RADIUS * polygon)[1]
            errors.append(abs(found / exact - 1))
    yield Row(*place, "error of the bulge", float(max(errors)), "", 0.0, seconds)


def lid_path(count: int) -> Iterator[Row]:
    """Follow the lid, which pops out and stays so without pressure."""
    scene, _ = lid(count)
    _, turns, _ = follow(scene, LID_OPTIONS)
    yield from limits("path-lid", "", count, "Pa", [1e3 * turn for turn in turns])


def path_cases(quick: bool) -> list[Case]:
    """Return the paths; all sizes of one are a case."""

    def over(sizes: tuple[int, ...], path: Callable[[int], Iterator[Row]]) -> Iterator[Row]:
        for size in sizes[:1] if quick else sizes:
            yield from path(size)

    roofs = [
        Case("path-roof", partial(over, (8, 16, 32), partial(roof_path, h)), f"{1e3 * h:g} mm")
        for h in ROOF_THICKNESSES
    ]
    return [
        *roofs,
        Case("path-tube", partial(over, (12, 24), tube_path)),
        Case("path-lid", partial(over, (8, 16), lid_path)),
    ]


def roof_table(rows: Rows) -> str:
    """Return the limit points of the roof by its thickness and mesh."""
    found = values_of(rows, "path-roof")
    lines: dict[str, list[str]] = {}
    for (_, variant, _), figures in found.items():
        one, two = (f"{figures[f'limit {k}']:.0f}".replace("-", "−") for k in (1, 2))
        lines.setdefault(variant, []).append(f"{one} and {two} N")
    sizes = [f"{2 * int(size) ** 2}" for _, variant, size in found if variant == next(iter(lines))]
    head = ("thickness", f"limits, {sizes[0]} triangles", *sizes[1:])
    return markdown(head, [(name, *cells) for name, cells in lines.items()])
