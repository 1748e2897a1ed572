"""Robustness of the equilibrium solver: scenes x designs x loads x starts.

    scripts/fenicsx python3 benchmarks/stability.py --quick

Every case must end in a stable equilibrium, or in a typed error where there is none. Residual,
stretches and the sign of the tangent are computed again from the state, by other means than the
solver's. Where the solver gives up, a longer search looks for the equilibrium. The exit code is 1
if a result is wrong, or a case that has a solution failed. It runs on one rank; without --quick for
hours.
"""

from __future__ import annotations

import argparse
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType

import numpy as np
from mpi4py import MPI
from stability_judge import Finding, Judge
from stability_oracle import search_equilibrium
from stability_report import CaseResult, Report, Row
from stability_scenes import BUILDERS, DESIGNS, Floats, Scene, build, loads_of, neighbour

from toros_fem.equilibrium.options import NewtonOptions
from toros_fem.equilibrium.solver import EquilibriumError, EquilibriumResult, EquilibriumSolver
from toros_fem.errors import TorosError

CONTRASTS = (15.0, 300.0, 1e4)
STARTS = ("cold", "continuation", "warm", "up_down")
# Wall time in s after which a case counts as hanging.
LONGEST = 300.0
# Up and down again: shapes that differ by more than this fraction of the size are two equilibria.
SAME_SHAPE = 1e-5


@dataclass(frozen=True)
class Case:
    """One cell of the matrix."""

    scene: str
    design: str
    contrast: float
    load: float
    start: str


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

    solver: EquilibriumSolver
    density: Floats
    pressure: float
    steps: int = 0
    stage: str = ""
    requested: tuple[Floats, Floats] = field(init=False)

    def solve(
        self, factor: float = 1.0, start: Floats | None = None, density: Floats | None = None
    ) -> EquilibriumResult:
        """Solve at a fraction of the load; without load, of the design's variation."""
        full = self.density if density is None else density
        if self.pressure == 0:
            full = full.mean() + factor * (full - full.mean())
        model = self.solver.model
        begin = model.assembled if start is None else np.where(model.free, start, model.assembled)
        self.requested = (full, begin)
        self.stage = "" if factor == 1 else f"At {factor:.3g} of the load: "
        result = self.solver.solve(full, factor * self.pressure, start=start)
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
            near = run.solve(density=neighbour(run.density))
        finally:
            run.stage = "In the neighbouring design: "
        run.steps = 0
        return run.solve(start=near.state), None
    up = run.solve()
    half = run.solve(0.5, up.state)
    again = run.solve(start=half.state)
    moved = np.linalg.norm(again.positions - up.positions, axis=1).max()
    return again, float(moved / scene.skin.pattern.size)


@contextmanager
def deadline(seconds: float) -> Iterator[None]:
    """Raise TimeoutError in the block after a wall time: a hang must not stop the matrix."""

    def ring(number: int, frame: FrameType | None) -> None:
        raise TimeoutError(f"gave up after {seconds:g} s")

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


class Stage:
    """One scene with its solvers, one for each contrast: all share the compiled forms."""

    def __init__(self, name: str) -> None:
        self.scene = build(name)
        self._solvers: dict[tuple[float, bool], EquilibriumSolver] = {}
        self._verdicts: dict[Case, tuple[bool, str]] = {}

    def solver(self, contrast: float, *, many_steps: bool = False) -> EquilibriumSolver:
        """Return the solver at a contrast; with `many_steps` it has few levels of load."""
        key = (contrast, many_steps)
        if key not in self._solvers:
            options = NewtonOptions(max_steps=400, min_increment=1.0) if many_steps else None
            self._solvers[key] = EquilibriumSolver(
                self.scene.skin, self.scene.composite(contrast), self.scene.supports, options
            )
        return self._solvers[key]

    def owned(self, design: str) -> Floats:
        """Return a design's densities in the order of the solver's."""
        return DESIGNS[design](self.scene)[self.scene.skin.owned_cells]

    def judge(self, contrast: float) -> Judge:
        """Return an independent check of states at a contrast."""
        return Judge(self.scene, self.scene.composite(contrast))

    def solvable(self, case: Case) -> tuple[bool, str]:
        """Return whether the oracle solves a case, whatever its start."""
        key = Case(case.scene, case.design, case.contrast, case.load, "")
        if key not in self._verdicts:
            self._verdicts[key] = search_equilibrium(
                self.judge(case.contrast),
                self.solver(case.contrast, many_steps=True),
                self.owned(case.design),
                case.load,
            )
        return self._verdicts[key]

    def forget(self) -> None:
        """Drop the solvers: after an exception their state is unknown."""
        self._solvers.clear()


def attempt(stage: Stage, case: Case) -> CaseResult:
    """Run one case and check its result."""
    begin = time.perf_counter()
    moved, finding, kind = None, Finding(None, None, []), "error"
    steps, reason = 0, ""
    run: Run | None = None
    try:
        with deadline(LONGEST):
            solver = stage.solver(case.contrast)
            run = Run(solver, stage.owned(case.design), case.load)
            result, moved = play(run, stage.scene, case)
        kind, reason, steps = "converged", result.reason, run.steps
    except EquilibriumError as error:
        result = error.result
        if run is not None:
            reason, steps = run.stage + result.reason, run.steps + result.steps
    except TorosError as error:
        result, reason = None, f"{type(error).__name__}: {error}"
    except Exception as error:  # the matrix is to show it, not to stop at it
        result, kind, reason = None, "exception", f"{type(error).__name__}: {error}"
        stage.forget()
    seconds = time.perf_counter() - begin
    # A failed solve that got nowhere returns its start and says so: no equilibrium is claimed.
    if run is not None and result is not None:
        density, start = run.requested
        pressure = case.load if kind == "converged" else result.pressure
        finding = stage.judge(case.contrast).check(
            run.solver.model, density, pressure, result.state
        )
        if kind == "error" and np.array_equal(result.state, start):
            finding = Finding(finding.residual, finding.sign, [])
    if moved is not None:
        away = "Back in the same shape" if moved <= SAME_SHAPE else "Back in ANOTHER shape"
        reason += f" {away}: it differs by {moved:.1e} of the size."
    row = Row(
        case.scene, case.design, case.contrast, case.load, case.start, kind, reason, steps,
        finding.residual, finding.sign, seconds,
    )  # fmt: skip
    faults = [*finding.faults, *([reason] if kind == "exception" else [])]
    return CaseResult(row, "wrong" if faults else kind, "; ".join(faults), moved)


def settle(stage: Stage, cases: list[Case], outcomes: list[CaseResult]) -> None:
    """Tell errors that are right from those of cases that another way solves."""
    same = lambda c: (c.design, c.contrast, c.load)  # noqa: E731
    by_start = {
        same(case): case.start
        for case, outcome in zip(cases, outcomes, strict=True)
        if outcome.verdict == "converged"
    }
    for case, outcome in zip(cases, outcomes, strict=True):
        if outcome.verdict != "error":
            continue
        if same(case) in by_start:
            solvable, judgement = True, f"the start {by_start[same(case)]!r} converged"
        else:
            try:
                with deadline(LONGEST):
                    solvable, judgement = stage.solvable(case)
            except TimeoutError as error:
                solvable, judgement = False, f"the oracle {error}"
                stage.forget()
        outcome.verdict = "failed" if solvable else "error right"
        outcome.why = judgement
        outcome.row.reason += f" Judged: {judgement}."


def absent(case: Case, error: Exception) -> CaseResult:
    """The outcome of a case whose scene could not even be built."""
    reason = f"the scene could not be built: {type(error).__name__}: {error}"
    row = Row(
        case.scene, case.design, case.contrast, case.load, case.start, "exception", reason, 0,
        None, None, 0.0,
    )  # fmt: skip
    return CaseResult(row, "wrong", reason, None)


def play_scene(name: str, *, quick: bool) -> list[CaseResult]:
    """All cases of one scene."""
    cases = quick_matrix(name) if quick else full_matrix(name)
    try:
        stage = Stage(name)
    except Exception as error:  # a scene that is not supported is a finding, not the end
        return [absent(case, error) for case in cases]
    outcomes = [attempt(stage, case) for case in cases]
    settle(stage, cases, outcomes)
    return outcomes


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="60 cases, about two minutes")
    parser.add_argument("--only", default="", help="scenes with this in their name")
    parser.add_argument("--json", type=Path, help="file for the rows")
    parser.add_argument("--output", type=Path, default=Path("output/stability"), help="folder")
    options = parser.parse_args()
    if MPI.COMM_WORLD.size > 1:
        parser.error("one rank only: the checks are dense and serial.")
    scenes = [name for name in BUILDERS if options.only in name]
    if not scenes:
        parser.error(f"no scene has {options.only!r} in its name; there are {list(BUILDERS)}.")
    report = Report()
    for name in scenes:
        begin = time.perf_counter()
        outcomes = play_scene(name, quick=options.quick)
        report.add(outcomes)
        counts = report.count(outcomes)
        listed = ", ".join(f"{counts[verdict]} {verdict}" for verdict in counts if counts[verdict])
        print(f"{name:15} {listed}; {time.perf_counter() - begin:.1f} s", flush=True)
    report.print_tables()
    options.output.mkdir(parents=True, exist_ok=True)
    report.draw(options.output / "stability.png")
    if options.json:
        report.write(options.json)
    return 1 if report.wrong or report.failed else 0


if __name__ == "__main__":
    sys.exit(main())
