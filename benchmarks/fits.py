"""How often 95 % intervals of constants from inflated skins hold.

Readings are simulated on a mesh that is finer than that of the fit, and each has noise of 1 % of
the largest one of its column. The true constants scatter by 10 % about those of a skin, and the fit
starts from the defaults. A constant that a fit holds is not counted in this trial.
"""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Iterator, Mapping
from functools import cache, lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from mpi4py import MPI
from shapely.geometry import LineString

from benchmarks.bench import Case, Command, Row, Rows, Table, markdown
from benchmarks.intervals import held_between
from toros_fem.base.scene import Scene
from toros_fem.making.drawing import write_template
from toros_fem.products.fitting.inflation import CONSTANTS, MeasuredSkin, Readings, fit_inflation
from toros_fem.products.inflate import InflateScene
from toros_fem.products.tubes import TwistScene

TRIALS, BLOCK, NOISE, SCATTER, QUICK_TRIALS = 100, 10, 0.01, 0.1, 2
ERROR, WIDTH = "error over half-width", "half-width"
# Helices of the print: their number, turns, and width in mm.
HELICES, TURNS, LINE = 3, 0.6, 2.0


class Skin(NamedTuple):
    """A skin that is inflated.

    Attributes:
        scene: On the mesh of the fit.
        pressures: First and last in Pa, and their number.
        constants: About which the true ones scatter.
        columns: Metrics that are measured.
        shared: Number of trials that have the same true constants.
    """

    scene: Scene
    pressures: tuple[float, float, int]
    constants: Mapping[str, float]
    columns: tuple[str, ...]
    shared: int = 1


# Edge length of the mesh that gives the readings, over that of the fit.
FINER, QUICK_FINER = 0.5, 0.8
SKINS = {
    "plain tube": Skin(
        InflateScene.of(edge_length=2.8e-3), (2e3, 20e3, 12),
        {"fabric_young": 0.12e6, "along_over_around": 1.25, "c1": 1.8, "c2": 2.4, "poisson": 0.3},
        ("radius_percent", "length_percent"),
    ),
    "printed tube": Skin(
        TwistScene().coarse().updated(
            length=0.05, edge_length=3.4e-3, print_edge_length=2.8e-3, pressure=10e3
        ),
        (2e3, 10e3, 5), {"reinforcement_young": 60e6, "fabric_young": 0.11e6},
        ("twist_deg", "length_ratio"), BLOCK,
    ),
}  # fmt: skip


@cache
def inflated(name: str, finer: float = 1.0) -> MeasuredSkin:
    """Return a skin on the mesh of the fit, or on a finer one."""
    scene: Any = SKINS[name].scene
    edges = ["edge_length", "print_edge_length"][: 1 + (not isinstance(scene, InflateScene))]
    scene = scene.updated(**{edge: finer * scene.value(edge) for edge in edges})
    if isinstance(scene, InflateScene):
        return MeasuredSkin(MPI.COMM_SELF, scene)
    with tempfile.TemporaryDirectory() as folder:
        return MeasuredSkin(MPI.COMM_SELF, scene, helices(scene, Path(folder) / "helices.geojson"))


def helices(scene: Any, file: Path) -> Path:
    """Write a drawing of helices on the wall of a tube, which twist it."""
    pattern = scene.case(MPI.COMM_SELF, scene.finest_level).whole.pattern
    write_template(MPI.COMM_SELF, file, pattern)
    wall = shapely.transform(pattern.outline(pattern.panel_index("wall")), lambda x: 1e3 * x)
    left, low, right, high = wall.bounds
    around, along = right - left, high - low
    ends = np.array([-0.1, 1.1])
    lines = [
        LineString(
            np.column_stack([left + around * (k / HELICES + TURNS * ends), low + along * ends])
        ).buffer(LINE / 2)
        for k in range(-2 * HELICES, 2 * HELICES)
    ]
    printed = json.loads(shapely.to_geojson(shapely.union_all(lines) & wall))
    content = json.loads(file.read_text(encoding="utf-8"))
    about = {"panel": "wall", "role": "print"}
    content["features"] += [{"type": "Feature", "properties": about, "geometry": printed}]
    file.write_text(json.dumps(content), encoding="utf-8")
    return file


@lru_cache(maxsize=1)
def measured(name: str, draw: int, finer: float) -> tuple[dict[str, float], Readings]:
    """Return constants and the readings of a skin without noise."""
    skin, rng = SKINS[name], np.random.default_rng([91, list(SKINS).index(name), draw])
    constants = {
        key: CONSTANTS[key].begin
        + (value - CONSTANTS[key].begin) * float(np.exp(SCATTER * rng.standard_normal()))
        for key, value in skin.constants.items()
    }
    pressures = np.linspace(*skin.pressures, dtype=np.float64)
    exact = inflated(name, finer).measured(pressures, constants)
    return constants, Readings(pressures, {key: exact[key] for key in skin.columns})


def rows_of(name: str, trials: range, finer: float) -> Iterator[Row]:
    """Fit the readings of some trials: per constant the error over the half-width, and this."""
    for trial in trials:
        constants, exact = measured(name, trial // SKINS[name].shared, finer)
        rng = np.random.default_rng([92, list(SKINS).index(name), trial])
        noisy = {
            key: values + NOISE * np.abs(values).max() * rng.standard_normal(len(values))
            for key, values in exact.values.items()
        }
        begin = time.perf_counter()
        result = fit_inflation(inflated(name), Readings(exact.pressures, noisy))
        seconds = round(time.perf_counter() - begin, 1)
        place = name, f"trials from {trials.start}", f"trial {trial}"
        yield Row(*place, "simulations", float(result.simulations), seconds=seconds)
        for constant, true in constants.items():
            if constant in result.estimates:
                estimate = result.estimates[constant]
                end = estimate.high if true > estimate.value else estimate.low
                error = abs((true - estimate.value) / (end - estimate.value))
                width = (estimate.high - estimate.low) / 2 / (true - CONSTANTS[constant].begin)
                yield Row(*place, f"{constant}, {ERROR}", error)
                yield Row(*place, f"{constant}, {WIDTH}", width)


def cases(quick: bool) -> list[Case]:
    """Return the trials in blocks; a quick selection has few, and readings of a coarser mesh."""
    trials, finer = (QUICK_TRIALS, QUICK_FINER) if quick else (TRIALS, FINER)
    blocks = [range(k, min(k + BLOCK, trials)) for k in range(0, trials, BLOCK)]
    return [
        Case(name, partial(rows_of, name, block, finer), f"trials from {block.start}")
        for name in SKINS
        for block in blocks
    ]


def table(rows: Rows) -> str:
    """Return for each constant how often it is told, and how often its interval holds."""
    lines = []
    for name, skin in SKINS.items():
        trials = len({row.size for row in rows if row.case == name})
        for constant in skin.constants if trials else ():
            errors, widths = (
                [
                    row.value or 0.0
                    for row in rows
                    if row.case == name and row.figure == f"{constant}, {what}"
                ]
                for what in (ERROR, WIDTH)
            )
            held = sum(error <= 1 for error in errors)
            cells = ["–"] * 3
            if errors:
                low, high = held_between(held, len(errors))
                cells = [f"{held / len(errors):.0%}", f"{low:.0%} to {high:.0%}",
                         f"{100 * np.median(widths):.1f} %"]  # fmt: skip
            title = CONSTANTS[constant].title
            lines.append((name, title, f"{len(errors)} of {trials}", *cells))
    head = ("skin", "constant", "told", "held", "95 %", "half-width: median")
    return markdown(head, lines)


COMMAND = Command(
    about=__doc__,
    cases=cases,
    serial=True,
    tables=(Table("characterisation.md", "fits from inflation", table),),
)
