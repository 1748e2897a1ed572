"""Effect of the perimeter term, eqs. (15, 16): weight, w, window, filter radius, order of stages.

    scripts/fenicsx python3 benchmarks/perimeter.py --json benchmarks/perimeter.json
    scripts/fenicsx python3 benchmarks/perimeter.py --studies weight seeds --json rows.json
    scripts/fenicsx python3 benchmarks/perimeter.py --from benchmarks/perimeter.json --docs

Designs the coarse bending tube of `demos/three_field.py`, and a coarse walker, with one setting of
the term after the other. The number of steps is the same in all. Each design is thresholded, and
its bare contours are measured and simulated again: nothing is cleaned, and no islands are removed.

The JSON file is written after each design. Designs that are in it already are not repeated; delete
the file after a change of the code. `--docs` writes the tables into docs/optimisation.md. A design
takes about a minute of one core, all of them an hour.
"""

from __future__ import annotations

import argparse
import copy
import json
import sys
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from page_tables import replaced
from scipy.optimize import minimize
from shapely.geometry.base import BaseGeometry

sys.path.insert(0, str(Path(__file__).parent.parent))

from demos import three_field
from toros_fem.base.array_types import Floats
from toros_fem.base.errors import NoEquilibriumError
from toros_fem.base.mpi import free_dropped
from toros_fem.design.density.perimeter import Perimeter, edge_factor
from toros_fem.design.density.projection import Projection
from toros_fem.design.loop import Stage, optimize
from toros_fem.design.loop.loop import DesignResult
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.making.as_printed.as_printed import as_printed
from toros_fem.making.print.cleaning import CleanedRegions
from toros_fem.making.print.printability import PrintLimits
from toros_fem.meshes import Pattern
from toros_fem.products.actuators.case import ActuatorCase
from toros_fem.products.actuators.problem import actuator_problem
from toros_fem.products.tubes import bend
from toros_fem.products.tubes.tube import coarse_tube
from toros_fem.products.walker import walker

PAGE = Path(__file__).parent.parent / "docs" / "optimisation.md"
# The tables stand between these lines of the page.
BEGIN, END = "<!-- tables of benchmarks/perimeter.py -->", "<!-- end of the tables -->"

# Parts of a design: fraction of all steps, whether the widths are enforced if they are at all, and
# the factor on the term's weight.
Part = tuple[float, bool, float]
ORDERS: dict[str, list[Part]] = {
    "from the start": [(4 / 7, False, 1), (3 / 7, True, 1)],
    "raised": [(2 / 7, False, 0.1), (2 / 7, False, 0.3), (3 / 7, True, 1)],
    "before the widths": [(2 / 7, False, 0), (2 / 7, False, 1), (3 / 7, True, 0)],
    "late": [(4 / 7, False, 0), (3 / 7, True, 1)],
    "after the widths": [(4 / 7, False, 0), (3 / 14, True, 0), (3 / 14, True, 1)],
}
SCENES: dict[str, tuple[Any, Callable[[MPI.Comm, Any], ActuatorCase]]] = {
    "bend": (coarse_tube(bend.BendConfig()), bend.case),
    "whole bend": (coarse_tube(three_field.ThreeFieldConfig()), three_field.case),
    "walker": (walker.coarse(walker.WalkerConfig()), walker.case),
}
# Filter radius over the edge length below which ω reaches the own triangle only.
NO_FILTER = 0.2

SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

Row = dict[str, Any]


@dataclass(frozen=True)
class Setting:
    """One design.

    Attributes:
        scene: Key of `SCENES`.
        widths: Whether the widths of lines and gaps are constrained.
        weight: Weight of the perimeter term; None leaves it out.
        sharpness: w of eq. (15).
        window: Radius of the term's window over R.
        radius: R over the scene's own.
        order: When the term acts, a key of `ORDERS`.
        papers_sum: Whether the term is the paper's sum over triangles, weighted so that a straight
            border costs the same.
        exponent: Exponent p of ρ̄ = ρᵖ, without filter and projection; None keeps both.
        seed: Seed of the random start.
    """

    scene: str = "bend"
    widths: bool = False
    weight: float | None = None
    sharpness: float = 20.0
    window: float = 1.0
    radius: float = 1.0
    order: str = "from the start"
    papers_sum: bool = False
    exponent: float | None = None
    seed: int = 2


@dataclass(frozen=True)
class PowerLaw(Projection):
    """Power law ρ̄ = ρ̃ᵖ of the SIMP method, in place of the projection."""

    exponent: float = 1.0

    def forward(self, filtered: Floats) -> Floats:
        """Return ρ̄ from ρ̃, both in [0, 1]."""
        return np.asarray(np.clip(filtered, 0, 1) ** self.exponent)

    def backward(self, filtered: Floats, gradient: Floats) -> Floats:
        """Return ∂T/∂ρ̃ from ∂T/∂ρ̄."""
        return np.asarray(self.exponent * np.clip(filtered, 0, 1) ** (self.exponent - 1) * gradient)


def problem_of(setting: Setting, *, quick: bool = False) -> tuple[ShapeDesign, int]:
    """Return the problem of a setting and its number of steps."""
    comm = MPI.COMM_SELF
    config, case = SCENES[setting.scene]
    if quick:
        config = config.updated(edge_length=6e-3, filter_radius=9e-3, iterations=2,
                                constrained_iterations=2)  # fmt: skip
    steps = config.iterations + config.constrained_iterations
    radius = setting.radius * config.filter_radius
    if setting.exponent is not None:
        radius = NO_FILTER * config.edge_length
    config = config.updated(
        filter_radius=radius,
        constrained_iterations=config.constrained_iterations if setting.widths else 0,
        perimeter_weight=setting.weight,
        perimeter_sharpness=setting.sharpness,
        perimeter_window=setting.window,
    )
    with warnings.catch_warnings():
        # Without a filter the radius is too small on purpose.
        warnings.filterwarnings("ignore", "filter radius", UserWarning)
        problem = actuator_problem(comm, case(comm, config), config)
    if setting.exponent is not None:
        problem = problem.with_projection(PowerLaw(exponent=setting.exponent))
    if setting.papers_sum:
        assert setting.weight is not None
        window, w = setting.window * radius, setting.sharpness
        papers = Perimeter(problem.skin, window, w, area_weighted=False, whole=problem.whole)
        problem = with_perimeter(problem, papers, setting.weight / sum_per_metre(problem, papers))
    return problem, steps


def sum_per_metre(problem: ShapeDesign, papers: Perimeter) -> float:
    """Return the paper's sum over triangles for a metre of straight border."""
    area = problem.skin.pattern.areas[problem.designed].mean()
    return float(edge_factor(papers.sharpness) * papers.window / area)


def least_length(problem: ShapeDesign, papers: Perimeter) -> float:
    """Return the least length in m that the paper's sum finds in any pattern."""
    designed = problem.designed
    parts = 1 if problem.whole is None else len(problem.whole.cell) // len(designed)
    factor = parts / sum_per_metre(problem, papers)

    def length(values: Floats) -> tuple[float, Floats]:
        density = np.zeros(len(designed))
        density[designed] = values
        return factor * papers.forward(density), factor * papers.backward(density)[designed]

    start = np.full(np.count_nonzero(designed), 0.2)
    found = minimize(length, start, jac=True, bounds=[(0, 1)] * len(start), method="L-BFGS-B")
    return float(found.fun)


def with_perimeter(
    problem: ShapeDesign, perimeter: Perimeter | None, weight: float | None
) -> ShapeDesign:
    """Return the same problem with another perimeter term."""
    other = copy.copy(problem)
    other.perimeter, other.perimeter_weight = perimeter, weight
    return other


def parts_of(setting: Setting, steps: int) -> list[tuple[Stage, float]]:
    """Return the stages of a setting, and the factor on the term's weight in each."""
    return [
        (Stage(round(fraction * steps), constrained=constrained and setting.widths), factor)
        for fraction, constrained, factor in ORDERS[setting.order]
    ]


def designed(setting: Setting, *, quick: bool = False) -> tuple[ShapeDesign, DesignResult]:
    """Design one setting, part by part; return its problem with the term, and the result."""
    problem, steps = problem_of(setting, quick=quick)
    result: DesignResult | None = None
    for stage, factor in parts_of(setting, steps):
        weight = None if problem.perimeter_weight is None else factor * problem.perimeter_weight
        part = with_perimeter(problem, problem.perimeter if weight else None, weight or None)
        result = optimize(part, [stage], seed=setting.seed, after=result)
    assert result is not None
    return problem, replace(result, problem=problem)


def uncleaned(
    pattern: Pattern,
    contours: Sequence[BaseGeometry],
    limits: PrintLimits,
    island_area: float,
    smoothing: float | None,
) -> CleanedRegions:
    """Return the bare contours as a print; arguments as of `cleaning.clean`."""
    return CleanedRegions(list(contours), list(contours), (), (), ())


def row_of(setting: Setting, *, quick: bool = False) -> Row:
    """Design one setting; return it with its figures, or with its failure."""
    row: Row = {"setting": asdict(setting)}
    try:
        problem, result = designed(setting, quick=quick)
    except NoEquilibriumError as failure:
        return {**row, "failure": str(failure)}
    made = as_printed(problem, result, cleaner=uncleaned)
    last, metric = result.history[-1], problem.metrics[0]
    response = None if made.evaluation is None else made.evaluation.equilibrium
    parts = len(made.pattern.panel) // len(problem.skin.pattern.panel)
    before = made.before.summary()
    return {
        **row,
        "target": metric.target,
        "shape_designed": last.shape,
        "shape_printed": None if made.evaluation is None else made.evaluation.shape,
        "penalty_share": None if setting.weight is None else (
            result.final.objective / last.shape - 1
        ),
        "angle_designed_deg": last.metrics[metric.key],
        "angle_printed_deg": None if response is None else problem.metrics_of(response)[metric.key],
        "pressure_pa": last.pressure,
        "islands": before["islands"],
        "pieces": before["pieces"],
        "holes": before["holes"],
        "border_mm": before["border_mm"],
        "perimeter_mm": None if result.final.perimeter is None else (
            1e3 * parts * result.final.perimeter
        ),
        "smallest_width_mm": before["smallest_width_mm"],
        "smallest_gap_mm": before["smallest_gap_mm"],
        "grey_level": last.grey_level,
        "steps": last.iteration,
    }  # fmt: skip


# With this the other factors are changed one by one.
CHOSEN = Setting(widths=True, weight=1e-4, sharpness=-20.0)
WITHOUT = Setting(widths=True)
FREE = Setting()

STUDIES: dict[str, tuple[str, list[Setting]]] = {
    "form": (
        "what is eroded, and w",
        [
            WITHOUT,
            replace(CHOSEN, sharpness=0.5, papers_sum=True),
            *[replace(CHOSEN, sharpness=w) for w in (0.5, 20.0, -5.0, -20.0, -100.0)],
        ],
    ),
    "weight": ("weight", [replace(CHOSEN, weight=a) for a in (3e-5, 1e-4, 2e-4, 5e-4)]),
    "window": ("radius of the window", [replace(CHOSEN, window=r) for r in (0.6, 1.0, 1.5)]),
    "radius": (
        "filter radius",
        [replace(setting, radius=1.5) for setting in (WITHOUT, CHOSEN)],
    ),
    "order": ("order of the stages", [replace(CHOSEN, order=order) for order in ORDERS]),
    "free": (
        "without constraints on the widths",
        [
            FREE,
            replace(FREE, weight=1e-4, sharpness=0.5, papers_sum=True),
            replace(FREE, weight=1e-4, sharpness=20.0),
            replace(FREE, weight=1e-4, sharpness=-20.0),
            replace(FREE, weight=1e-4, sharpness=-100.0),
            replace(FREE, weight=3e-5, sharpness=-20.0),
            replace(FREE, weight=1e-4, sharpness=-20.0, order="late"),
        ],
    ),
    "seeds": (
        "start",
        [
            replace(setting, seed=seed)
            for seed in (0, 1, 2)
            for setting in (WITHOUT, replace(CHOSEN, weight=3e-5), CHOSEN)
        ],
    ),
    "scenes": (
        "other designs",
        [
            replace(setting, scene=scene)
            for scene in ("whole bend", "walker")
            for setting in (WITHOUT, CHOSEN)
        ],
    ),
    "power": (
        "no filter, no projection: ρ̄ = ρᵖ",
        [replace(FREE, exponent=p) for p in (1.0, 3.0)],
    ),
}


def power_of_ten(value: float) -> str:
    """Return a number of one digit with a power of ten, as text."""
    digit, exponent = f"{value:.0e}".split("e")
    return f"{digit}·10{str(int(exponent)).translate(SUPERSCRIPT)}"


def label(setting: Setting) -> str:
    """Return what distinguishes a setting, as text."""
    s = setting
    words = [] if s.scene == "bend" else [s.scene]
    words.append("widths" if s.widths else "no widths")
    if s.exponent is not None:
        words = [f"p = {s.exponent:g}"]
    elif s.weight is None:
        words.append("no term")
    else:
        form = "the paper's sum, " if s.papers_sum else ""
        words.append(f"{form}w = {s.sharpness:g}, {power_of_ten(s.weight)}")
    if s.window != 1:
        words.append(f"window {s.window:g} R")
    if s.radius != 1:
        words.append(f"{s.radius:g} times the radius")
    if s.weight is not None and s.order != "from the start":
        words.append(s.order)
    if s.seed != Setting.seed:
        words.append(f"seed {s.seed}")
    return ", ".join(words)


TITLES = (
    "setting", "T", "term over T", "angle", "islands, pieces", "border in m",
    "thinnest line, gap in mm", "grey level",
)  # fmt: skip


def cells(row: Row) -> list[str]:
    """Return a row as the cells of a table."""
    name = label(Setting(**row["setting"]))
    if "failure" in row:
        return [name, "no equilibrium", *["–"] * (len(TITLES) - 2)]

    def number(key: str, form: str) -> str:
        return "–" if row[key] is None else f"{row[key]:{form}}"

    printed = number("angle_printed_deg", ".1f") + ("" if row["angle_printed_deg"] is None else "°")
    return [
        name,
        f"{row['shape_designed']:.1e} → {number('shape_printed', '.1e')}",
        number("penalty_share", ".2f"),
        f"{row['angle_designed_deg']:.1f}° → {printed}",
        f"{row['islands']}, {row['pieces']}",
        f"{1e-3 * row['border_mm']:.2f}",
        f"{number('smallest_width_mm', '.2f')}, {number('smallest_gap_mm', '.2f')}",
        f"{row['grey_level']:.3f}",
    ]


def tables(rows: Sequence[Row]) -> str:
    """Return a Markdown table of each study that has rows."""
    found = []
    for title, settings in STUDIES.values():
        known = [row for s in settings for row in rows if row["setting"] == asdict(s)]
        if known:
            lines = [TITLES, ["---"] * len(TITLES), *map(cells, known)]
            table = "\n".join("| " + " | ".join(line) + " |" for line in lines)
            found.append(f"**{title[0].upper()}{title[1:]}**\n\n{table}")
    return "\n\n".join(found)


def with_tables(page: str, text: str) -> str:
    """Return a page with other tables between its two marks.

    Raises:
        ValueError: The page has no such marks.
    """
    return replaced(page, BEGIN, END, text)


def complete(settings: Sequence[Setting], file: Path | None, *, quick: bool) -> list[Row]:
    """Return the rows of a file, and design what is missing; the file is written after each."""
    rows: list[Row] = []
    if file is not None and file.exists():
        rows = json.loads(file.read_text(encoding="utf-8"))
    for setting in settings:
        if any(row["setting"] == asdict(setting) for row in rows):
            continue
        rows.append(row_of(setting, quick=quick))
        print("  ".join(cells(rows[-1])), flush=True)
        free_dropped(MPI.COMM_SELF)
        if file is not None:
            file.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    return rows


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--studies", nargs="+", choices=list(STUDIES), default=list(STUDIES))
    parser.add_argument("--quick", action="store_true", help="very coarse meshes and few steps")
    parser.add_argument("--json", type=Path, help="file for the rows")
    parser.add_argument("--from", type=Path, dest="source", help="design nothing, read these rows")
    parser.add_argument("--docs", action="store_true", help="write the tables into the page")
    parser.add_argument("--page", type=Path, default=PAGE, help="the page")
    o = parser.parse_args()
    if o.source:
        rows = json.loads(o.source.read_text(encoding="utf-8"))
    else:
        wanted = [setting for name in o.studies for setting in STUDIES[name][1]]
        rows = complete(wanted, o.json, quick=o.quick)
        problem, _ = problem_of(replace(CHOSEN, sharpness=0.5, papers_sum=True), quick=o.quick)
        assert problem.perimeter is not None
        least = least_length(problem, problem.perimeter)
        print(f"\nleast length by the paper's sum, w = 0.5: {least:.2f} m")
    text = tables(rows)
    print(f"\n{text}")
    if o.docs:
        page = o.page.read_text(encoding="utf-8")
        o.page.write_text(with_tables(page, text), encoding="utf-8")


if __name__ == "__main__":
    main()
