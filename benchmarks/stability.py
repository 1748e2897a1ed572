"""Robustness of the equilibrium solver: scenes x designs x loads x starts.

    scripts/fenicsx python3 benchmarks/stability.py --quick
    scripts/fenicsx python3 benchmarks/stability.py --workers 2 --rows output/stability/rows.jsonl

Every case must end in a stable equilibrium, or in a typed error where there is none. Residual,
stretches and the sign of the tangent are computed again from the state, by other means than the
solver's. Where the solver gives up, a longer search looks for the equilibrium. The exit code is 1
if a result is wrong, or a case that has a solution failed. It runs on one rank. All cases take an
hour of one core or more; `--cases 500 --seed 1` draws some.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import asdict, astuple, dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from case_options import parsed, parser_of
from page_tables import replaced
from shared_rows import complete, deadline
from stability_judge import Finding, Judge
from stability_oracle import search_equilibrium
from stability_report import Case, CaseResult, Report, Request, Row
from stability_scenes import BUILDERS, DESIGNS, Floats, Scene, build, loads_of, neighbour

from toros_fem.base.errors import TorosError
from toros_fem.base.validation import require_count
from toros_fem.mechanics.contact import Contact
from toros_fem.mechanics.equilibrium.options import NewtonOptions
from toros_fem.mechanics.equilibrium.solver import (
    EquilibriumError,
    EquilibriumResult,
    EquilibriumSolver,
)
from toros_fem.mechanics.skin.load_case import LoadCase

CONTRASTS = (15.0, 300.0, 1e4)
STARTS = ("cold", "continuation", "warm", "up_down")
# Wall time in s after which a case counts as hanging.
LONGEST = 300.0
PAGE = Path(__file__).parent.parent / "docs" / "stability.md"
MARKS = ("<!-- the matrix -->", "<!-- end of the matrix -->")
# Up and down again: shapes that differ by more than this fraction of the size are two equilibria.
SAME_SHAPE = 1e-5


def full_matrix(scene: str) -> list[Case]:
    """Return all cases of a scene; the plain fabric does not depend on the contrast."""
    return [
        Case(scene, design, contrast, load, start)
        for contrast in CONTRASTS
        for design in DESIGNS
        if design != "fabric" or contrast == CONTRASTS[1]
        for load in loads_of(scene)
        for start in STARTS
    ]


def quick_matrix(scene: str) -> list[Case]:
    """Return one case for each start of a scene; designs and loads are mixed over the scenes.

    15 scenes go more than once through 8 designs and 5 loads, so that every start meets every
    design and every load. The contrast goes with the scene: four solves share one solver.
    """
    index = list(BUILDERS).index(scene)
    designs, loads = list(DESIGNS), loads_of(scene)
    cases = []
    for turn, start in enumerate(STARTS):
        design = designs[(index + 3 * turn) % len(designs)]
        contrast = CONTRASTS[1 if design == "fabric" else index % 3]
        cases.append(Case(scene, design, contrast, loads[(index + 2 * turn) % len(loads)], start))
    return cases


@dataclass
class Run:
    """Solves of one case: the last request, and the number of steps of all."""

    stage: Stage
    case: Case
    steps: int = 0
    on_the_way: str = ""
    request: Request = field(init=False)
    requested: tuple[Floats, Floats] = field(init=False)

    def __post_init__(self) -> None:
        self.solver = self.stage.solver(self.case.contrast)

    def solve(
        self, factor: float = 1.0, start: Floats | None = None, *, neighbour: bool = False
    ) -> EquilibriumResult:
        """Solve at a fraction of the load; without load, of the design's variation."""
        case = self.case
        variation = factor if case.load == 0 else 1.0
        self.request = Request(
            case.scene, case.design, case.contrast, factor * case.load, neighbour, variation
        )
        full = self.stage.density(self.request)
        model = self.solver.model
        begin = model.assembled if start is None else np.where(model.free, start, model.assembled)
        self.requested = (full, begin)
        self.on_the_way = "" if factor == 1 else f"At {factor:.3g} of the load: "
        result = self.solver.solve(full, self.request.load, start=start)
        self.steps += result.steps
        return result


def ladder(scene: Scene, load: float) -> list[float]:
    """Return load factors that double from one that strains the fabric by a few per cent."""
    factor = min(1.0, scene.small_pressure() / load if load else 1 / 8)
    factors = []
    while factor < 1:
        factors.append(factor)
        factor *= 2
    return [*factors, 1.0]


def play(run: Run, scene: Scene, case: Case) -> tuple[EquilibriumResult, float | None]:
    """Run one case; return the last result and, after up and down, the distance that it moved."""
    if case.start == "cold":
        return run.solve(), None
    if case.start == "continuation":
        state = None
        for factor in ladder(scene, case.load):
            result = run.solve(factor, state)
            state = result.state
        return result, None
    if case.start == "warm":
        try:
            near = run.solve(neighbour=True)
        finally:
            run.on_the_way = "In the neighbouring design: "
        run.steps = 0
        return run.solve(start=near.state), None
    up = run.solve()
    half = run.solve(0.5, up.state)
    again = run.solve(start=half.state)
    moved = np.linalg.norm(again.positions - up.positions, axis=1).max()
    return again, float(moved / scene.skin.pattern.size)


class Stage:
    """One scene; every case has a solver of its own, so that it does not depend on others.

    Args:
        name: Of the scene.
        contact: What its skin touches; None for nothing.
    """

    def __init__(self, name: str, contact: Contact | None = None) -> None:
        self.scene, self.contact = build(name), contact

    def solver(self, contrast: float, *, many_steps: bool = False) -> EquilibriumSolver:
        """Return a solver at a contrast; with `many_steps` it has few levels of load."""
        options = NewtonOptions(max_steps=400, min_increment=1.0) if many_steps else None
        return EquilibriumSolver(
            self.scene.skin,
            self.scene.composite(contrast),
            self.scene.supports,
            options,
            contact=self.contact,
        )

    def density(self, request: Request) -> Floats:
        """Return the densities of a request in the order of the solver's."""
        density = DESIGNS[request.design](self.scene)[self.scene.skin.owned_cells]
        if request.neighbour:
            density = neighbour(density)
        mean = density.mean()
        return density if request.variation == 1 else mean + request.variation * (density - mean)

    def judge(self, contrast: float) -> Judge:
        """Return an independent check of states at a contrast."""
        scene = self.scene
        return Judge(scene.skin, scene.composite(contrast))


@cache
def stage_of(name: str) -> Stage:
    """Return a scene, made once in a process."""
    return Stage(name)


def attempt(stage: Stage, case: Case) -> CaseResult:
    """Run one case and check its result."""
    begin = time.perf_counter()
    moved, finding, kind = None, Finding(None, None, []), "error"
    steps, reason = 0, ""
    run: Run | None = None
    try:
        with deadline(LONGEST):
            run = Run(stage, case)
            result, moved = play(run, stage.scene, case)
        kind, reason, steps = "converged", result.reason, run.steps
    except EquilibriumError as error:
        result = error.result
        if run is not None:
            reason, steps = run.on_the_way + result.reason, run.steps + result.steps
    except TorosError as error:
        result, reason = None, f"{type(error).__name__}: {error}"
    except Exception as error:  # the matrix is to show it, not to stop at it
        result, kind, reason = None, "exception", f"{type(error).__name__}: {error}"
    seconds = time.perf_counter() - begin
    # A failed solve that got nowhere returns its start and says so: no equilibrium is claimed.
    if run is not None and result is not None:
        density, start = run.requested
        pressure = case.load if kind == "converged" else result.pressure
        finding = stage.judge(case.contrast).check(
            run.solver.model, density, pressure, result.state
        )
        if kind == "converged" and run.solver.model.crossed(result.state):
            finding.faults.append("surfaces cross")
        if kind == "error" and np.array_equal(result.state, start):
            finding = Finding(finding.residual, finding.sign, [])
    if moved is not None:
        away = "Back in the same shape" if moved <= SAME_SHAPE else "Back in ANOTHER shape"
        reason += f" {away}: it differs by {moved:.1e} of the size."
    row = Row(*astuple(case), kind, reason, steps, finding.residual, finding.sign, seconds)
    faults = [*finding.faults, *([reason] if kind == "exception" else [])]
    failed = run.request if run is not None and kind == "error" else None
    return CaseResult(row, "wrong" if faults else kind, "; ".join(faults), moved, failed)


def play_case(case: Case) -> dict[str, Any]:
    """Return the outcome of a case as it goes into the file of rows."""
    try:
        stage = stage_of(case.scene)
    except Exception as error:  # a scene that is not supported is a finding, not the end
        reason = f"the scene could not be built: {type(error).__name__}: {error}"
        row = Row(*astuple(case), "exception", reason, 0, None, None, 0.0)
        return asdict(CaseResult(row, "wrong", reason, None))
    return asdict(attempt(stage, case))


def ask_oracle(request: Request) -> dict[str, Any]:
    """Return whether the oracle finds an equilibrium for a request, and how."""
    stage = stage_of(request.scene)
    try:
        with deadline(LONGEST):
            solvable, finding = search_equilibrium(
                stage.judge(request.contrast),
                stage.solver(request.contrast, many_steps=True),
                stage.density(request),
                LoadCase(np.array([request.load])),
            )
    except TimeoutError as error:
        solvable, finding = False, f"the oracle {error}"
    return {"solvable": solvable, "finding": finding}


def settle(outcomes: list[CaseResult], file: Path | None, workers: int) -> None:
    """Tell errors that are right from those of requests that another way solves."""
    by_start = {
        outcome.row.request: outcome.row.start
        for outcome in outcomes
        if outcome.verdict == "converged"
    }
    errors = [outcome for outcome in outcomes if outcome.verdict == "error"]
    unknown = {
        f"oracle: {request.label()}": request
        for outcome in errors
        if (request := outcome.failed) is not None and request not in by_start
    }
    verdicts = complete(unknown, ask_oracle, file, workers)
    for outcome in errors:
        if outcome.failed is None:  # refused by a typed error
            outcome.verdict, outcome.why = "error right", "refused"
            continue
        if outcome.failed in by_start:
            solvable, judgement = True, f"the start {by_start[outcome.failed]!r} converged"
        else:
            found = verdicts[f"oracle: {outcome.failed.label()}"]
            solvable, judgement = found["solvable"], found["finding"]
        outcome.verdict = "failed" if solvable else "error right"
        outcome.why = judgement
        outcome.row.reason += f" Judged: {judgement}."


class Progress:
    """Prints what needs a look at once, and a line for every hundred cases."""

    def __init__(self, cases: int) -> None:
        self._cases, self._new, self._begin = cases, 0, time.perf_counter()

    def __call__(self, key: str, row: dict[str, Any]) -> None:
        """Count a new row."""
        self._new += 1
        if row["verdict"] != "converged":
            print(f"{row['verdict'].upper()}: {key}: {row['why'] or row['row']['reason']}")
        if self._new % 100 == 0:
            seconds = time.perf_counter() - self._begin
            print(f"{self._new} new of {self._cases} cases, {seconds:.0f} s", flush=True)


def chosen_cases(options: argparse.Namespace, scenes: list[str]) -> list[Case]:
    """Return the cases that the command line asks for."""
    matrix = quick_matrix if options.quick else full_matrix
    cases = [case for name in scenes for case in matrix(name)]
    if options.cases is None:
        return cases
    # The first of one permutation: more cases with the same seed are the same and others.
    order = np.random.default_rng(options.seed).permutation(len(cases))
    return [cases[k] for k in order[: options.cases]]


def main() -> int:
    """Command line."""
    parser = parser_of(__doc__, PAGE)
    parser.add_argument("--quick", action="store_true", help="60 cases, about a minute")
    parser.add_argument("--only", default="", help="scenes with this in their name")
    parser.add_argument("--cases", type=int, help="number of cases drawn; default: all")
    parser.add_argument("--seed", type=int, default=0, help="of the draw")
    parser.add_argument("--output", type=Path, default=Path("output/stability"), help="folder")
    options = parsed(parser)
    if options.cases is not None:
        require_count(1, cases=options.cases)
    scenes = [name for name in BUILDERS if options.only in name]
    if not scenes:
        parser.error(f"no scene has {options.only!r} in its name; there are {list(BUILDERS)}.")
    if options.source:
        report = Report.read(options.source)
    else:
        cases = chosen_cases(options, scenes)
        tasks = {case.label(): case for case in cases}
        rows = complete(tasks, play_case, options.rows, options.workers, Progress(len(tasks)))
        outcomes = [CaseResult.of(row) for row in rows.values()]
        settle(outcomes, options.rows, options.workers)
        report = Report(outcomes)
    report.print_tables()
    options.output.mkdir(parents=True, exist_ok=True)
    report.draw(options.output / "stability.png")
    if options.json:
        report.write(options.json)
    if options.docs:
        page = options.page.read_text(encoding="utf-8")
        page = replaced(page, *MARKS, report.markdown())
        options.page.write_text(page, encoding="utf-8")
    return 1 if report.wrong or report.failed else 0


if __name__ == "__main__":
    sys.exit(main())
