"""The matrix of scenes x designs x contrasts x loads x starts.

Every cell must end in a stable equilibrium, or in a typed error where there is none. Residual,
stretches and the sign of the tangent are computed again from the state, by other means than the
solver's. Where the solver gives up, the oracle looks for the equilibrium.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np

from benchmarks.bench import Row, deadline
from benchmarks.stability.judge import Judge
from benchmarks.stability.oracle import search_equilibrium
from benchmarks.stability.scenes import (
    BUILDERS,
    DESIGNS,
    Floats,
    Scene,
    build,
    loads_of,
    neighbour,
)
from toros_fem.base.errors import TorosError
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium, EquilibriumError
from toros_fem.mechanics.equilibrium.newton import NewtonOptions
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load

CONTRASTS = (15.0, 300.0, 1e4)
STARTS = ("cold", "continuation", "warm", "up_down")
# Wall time in s after which a cell counts as hanging.
LONGEST = 300.0
# Up and down again: shapes that differ by more than this fraction of the size are two equilibria.
SAME_SHAPE = 1e-5


@dataclass(frozen=True)
class Cell:
    """One cell of the matrix; loads in Pa."""

    scene: str
    design: str
    contrast: float
    load: float
    start: str

    @property
    def label(self) -> str:
        """The cell in one line."""
        return f"{self.scene} {self.design} x{self.contrast:g} {self.load:g} Pa {self.start}"


@dataclass(frozen=True)
class Request:
    """Design and load of one solve of a cell.

    Attributes:
        scene, design, contrast: As of the cell.
        load: Pressure in Pa.
        neighbour: Whether the neighbouring design was asked for.
        variation: Fraction of the design's variation about its mean.
    """

    scene: str
    design: str
    contrast: float
    load: float
    neighbour: bool = False
    variation: float = 1.0


def full_matrix(scene: str) -> list[Cell]:
    """Return all cells of a scene; the plain fabric does not depend on the contrast."""
    return [
        Cell(scene, design, contrast, load, start)
        for contrast in CONTRASTS
        for design in DESIGNS
        if design != "fabric" or contrast == CONTRASTS[1]
        for load in loads_of(scene)
        for start in STARTS
    ]


def quick_matrix(scene: str) -> list[Cell]:
    """Return one cell for each start of a scene; designs and loads are mixed over the scenes.

    15 scenes go more than once through 8 designs and 5 loads, so that every start meets every
    design and every load.
    """
    index = list(BUILDERS).index(scene)
    designs, loads = list(DESIGNS), loads_of(scene)
    cells = []
    for turn, start in enumerate(STARTS):
        design = designs[(index + 3 * turn) % len(designs)]
        contrast = CONTRASTS[1 if design == "fabric" else index % 3]
        cells.append(Cell(scene, design, contrast, loads[(index + 2 * turn) % len(loads)], start))
    return cells


class Stage:
    """One scene, by its name; every cell has a solver of its own, independent of others."""

    def __init__(self, name: str) -> None:
        self.scene = build(name)

    def solver(self, contrast: float, *, many_steps: bool = False) -> EquilibriumSolver:
        """Return a solver at a contrast; with `many_steps` it has few levels of load."""
        options = NewtonOptions(max_steps=400, min_increment=1.0) if many_steps else None
        scene = self.scene
        return EquilibriumSolver(scene.skin, scene.composite(contrast), scene.supports, options)

    def density(self, request: Request) -> Floats:
        """Return the densities of a request in the order of the solver's."""
        density = DESIGNS[request.design](self.scene)[self.scene.skin.owned_cells]
        if request.neighbour:
            density = neighbour(density)
        mean = density.mean()
        return density if request.variation == 1 else mean + request.variation * (density - mean)

    def judge(self, contrast: float) -> Judge:
        """Return an independent check of states at a contrast."""
        return Judge(self.scene.skin, self.scene.composite(contrast))


@cache
def stage_of(name: str) -> Stage:
    """Return a scene, made once in a process."""
    return Stage(name)


@dataclass
class Run:
    """Solves of one cell: the last request and start, and the number of steps of all."""

    stage: Stage
    cell: Cell
    steps: int = 0
    request: Request = field(init=False)
    start: Floats = field(init=False)

    def __post_init__(self) -> None:
        self.solver = self.stage.solver(self.cell.contrast)

    def solve(
        self, factor: float = 1.0, start: Floats | None = None, *, neighbour: bool = False
    ) -> Equilibrium:
        """Solve at a fraction of the load; without load, of the design's variation."""
        cell, model = self.cell, self.solver.model
        variation = factor if cell.load == 0 else 1.0
        self.request = Request(
            cell.scene, cell.design, cell.contrast, factor * cell.load, neighbour, variation
        )
        self.start = model.assembled
        if start is not None:
            self.start = np.where(model.free, start, model.assembled)
        density = self.stage.density(self.request)
        result = self.solver.solve(density, self.request.load, start=start)
        self.steps += result.steps
        return result


def ladder(scene: Scene, load: float) -> list[float]:
    """Return load factors that double from one that strains the fabric by a few per cent."""
    factors = [min(1.0, scene.small_pressure() / load if load else 1 / 8)]
    while factors[-1] < 1:
        factors.append(min(1.0, 2 * factors[-1]))
    return factors


def play(run: Run, scene: Scene) -> tuple[Equilibrium, float]:
    """Run one cell; return the last result and, after up and down, the distance that it moved."""
    start = run.cell.start
    if start == "cold":
        return run.solve(), 0.0
    if start == "continuation":
        state = None
        for factor in ladder(scene, run.cell.load):
            result = run.solve(factor, state)
            state = result.state
        return result, 0.0
    if start == "warm":
        near = run.solve(neighbour=True)
        return run.solve(start=near.state), 0.0
    up = run.solve()
    half = run.solve(0.5, up.state)
    again = run.solve(start=half.state)
    moved = np.linalg.norm(again.positions - up.positions, axis=1).max()
    return again, float(moved / scene.skin.pattern.size)


def rows_of(cell: Cell) -> list[Row]:
    """Run one cell and check its result; the figure of its row is the verdict."""
    begin = time.perf_counter()
    run: Run | None = None
    result: Equilibrium | None = None
    verdict, why, moved = "converged", "", 0.0
    try:
        stage = stage_of(cell.scene)
        with deadline(LONGEST):
            run = Run(stage, cell)
            result, moved = play(run, stage.scene)
    except EquilibriumError as error:
        result, verdict, why = error.result, "error", error.result.reason
        assert run is not None
        run.steps += result.steps
    except TorosError as error:
        verdict, why = "error right", f"refused: {error}"
    except Exception as error:  # the matrix is to show it, not to stop at it
        verdict, why = "wrong", f"{type(error).__name__}: {error}"
        # PETSc passes the interruption on as its own error.
        if time.perf_counter() - begin >= LONGEST:
            verdict, why = "wrong", f"stopped after {LONGEST:g} s"
    residual = None
    # A failed solve that got nowhere returns its start and says so: no equilibrium is claimed.
    if run is not None and result is not None:
        load = run.request.load if verdict == "converged" else result.pressure
        judge, density = stage.judge(cell.contrast), stage.density(run.request)
        found = judge.check(run.solver.model, density, load, result.state)
        residual, faults = found.residual, found.faults
        if faults and not (verdict == "error" and np.array_equal(result.state, run.start)):
            verdict, why = "wrong", "; ".join(faults)
    if verdict == "error" and run is not None:
        solvable, why = ask_oracle(stage, run.request)
        verdict = "failed" if solvable else "error right"
    if moved > SAME_SHAPE:
        why = f"back in another shape, off by {moved:.1e} of the size"
    row = Row("matrix", cell.label, "", verdict, float(run.steps if run else 0), "steps", note=why)
    return [
        replace(row, seconds=time.perf_counter() - begin),
        Row("matrix", cell.label, "", "residual", residual, "", 0.0),
    ]


def ask_oracle(stage: Stage, request: Request) -> tuple[bool, str]:
    """Return whether the oracle finds an equilibrium for a request, and how."""
    try:
        with deadline(LONGEST):
            return search_equilibrium(
                stage.judge(request.contrast),
                stage.solver(request.contrast, many_steps=True),
                stage.density(request),
                Load(np.array([request.load])),
            )
    except TimeoutError as error:
        return False, f"the oracle {error}"
