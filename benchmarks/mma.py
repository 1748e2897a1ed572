"""Time of an MMA step, compared with other codes.

    scripts/fenicsx python3 benchmarks/mma.py
    scripts/fenicsx python3 benchmarks/mma.py --quick --json rows.json

Svanberg's MMA in toros_fem, mmapy and pyMOTO takes the same step of the same problem: asymptotes,
approximations and subproblem; function values and gradients are given. Each code first takes two
steps of its own from the same start, so that its asymptotes and the start of its subproblem are
those of a running optimisation. The third step is timed from one point for all codes, repeatedly
and in turn; the fastest repetition counts. All parameters are equal (Svanberg's, move limit 0.2).
The problem is typical of topology optimisation: a smooth objective of O(100), and constraints of
O(1) on weighted means, some of them satisfied and some not. One rank, one core.

On the smallest problem the codes must arrive at the same point. The difference (root mean square)
grows with the number of variables, because the interior points of the other codes stop at a
barrier of 1e-7, which weighs more where the entries of the gradients are smaller.
"""

from __future__ import annotations

import argparse
import copy
import json
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from toros_fem.design.mma.optimizer import MMA

SMALL, SIZES, CONSTRAINTS = 2_000, (10_000, 100_000, 500_000), (1, 2, 5)
OURS, WARM = "toros_fem", 2
Data = tuple[float, np.ndarray, np.ndarray, np.ndarray]
# A step of a code; called with the same point again it repeats that step.
Step = Callable[[np.ndarray, Data], np.ndarray]


class Problem:
    """min Σ wⱼ (xⱼ − cⱼ)² subject to weighted means of x below a fraction of their maximum."""

    def __init__(self, variables: int, constraints: int) -> None:
        rng = np.random.default_rng(variables + constraints)
        self.centre = 1.4 * rng.random(variables) - 0.2
        self.weight = 1000 * (1 + rng.random(variables)) / variables
        self.rows = 20 * rng.random((constraints, variables)) / variables
        self.bound = self.rows.sum(axis=1) * np.linspace(0.4, 0.6, constraints)

    def data(self, x: np.ndarray) -> Data:
        """Return the objective, its gradient, the constraints, and their gradients."""
        gap = x - self.centre
        slope = 2 * self.weight * gap
        return float(0.5 * slope @ gap), slope, self.rows @ x - self.bound, self.rows


def ours(variables: int, constraints: int) -> Step:
    """Return the step of toros_fem; with the same data it starts from the same state."""
    lower, upper = (
        PETSc.Vec().createWithArray(np.full(variables, v), comm=MPI.COMM_SELF) for v in (0.0, 1.0)
    )
    mma = MMA(lower, upper, constraints)
    saved: list[Any] = [None, None]

    def step(x: np.ndarray, data: Data) -> np.ndarray:
        if x is saved[0]:
            mma.state = copy.copy(saved[1])
        else:
            saved[:] = x, copy.copy(mma.state)
        vectors = [PETSc.Vec().createWithArray(a, comm=MPI.COMM_SELF)
                   for a in (x.copy(), data[1], *data[3])]  # fmt: skip
        mma.step(vectors[0], data[0], vectors[1], list(data[2]), vectors[2:])
        return np.asarray(vectors[0].array)

    return step


def mmapy(variables: int, constraints: int) -> Step:
    """Return the step of mmapy's `mmasub`."""
    from mmapy import mmasub

    n, m = variables, constraints
    zero, one = np.zeros((n, 1)), np.ones((n, 1))
    state: dict[str, Any] = {"count": 0, "old": zero, "older": zero, "low": zero, "upp": one}
    saved: list[Any] = [None, None]

    def step(x: np.ndarray, data: Data) -> np.ndarray:
        nonlocal state
        if x is saved[0]:
            state = dict(saved[1])
        else:
            saved[:] = x, dict(state)
        here = x[:, None]
        state["count"] += 1
        found = mmasub(
            m, n, state["count"], here, zero, one, state["old"], state["older"], data[0],
            data[1][:, None], data[2][:, None], data[3], state["low"], state["upp"],
            1.0, np.zeros((m, 1)), np.full((m, 1), 1000.0), np.ones((m, 1)), move=0.2,
        )  # fmt: skip
        state.update(older=state["old"], old=here, low=found[9], upp=found[10])
        return np.asarray(found[0]).ravel()

    return step


def pymoto(variables: int, constraints: int) -> Step:
    """Return the step of pyMOTO's MMA (its 2007 version)."""
    import pymoto as pym

    x0 = pym.Signal("x", np.zeros(variables))
    responses = [pym.Signal(f"f{i}", 0.0) for i in range(constraints + 1)]
    mma = pym.MMA([x0], responses, pym.Network(), move=0.2, verbosity=0)
    names = ("xold1", "xold2", "offset")
    saved: list[Any] = [None, None]

    def step(x: np.ndarray, data: Data) -> np.ndarray:
        if x is saved[0]:
            for name in names:
                setattr(mma, name, copy.copy(saved[1][name]))
        else:
            saved[:] = x, {name: copy.copy(getattr(mma, name)) for name in names}
        values = np.concatenate([[data[0]], data[2]])
        return np.asarray(mma.step(x, values, np.vstack([data[1], data[3]]))[0])

    return step


CODES: dict[str, Callable[[int, int], Step]] = {OURS: ours, "mmapy": mmapy, "pymoto": pymoto}


def measure(
    names: list[str], variables: int, constraints: int, rounds: int
) -> list[dict[str, Any]]:
    """Return the rows of one problem: each code's fastest step, and its difference from ours."""
    problem = Problem(variables, constraints)
    steps = {name: CODES[name](variables, constraints) for name in names}
    x = np.full(variables, 0.4)
    results: dict[str, np.ndarray] = {}
    for _ in range(WARM):
        data = problem.data(x)
        results = {name: step(x, data) for name, step in steps.items()}
        x = results[OURS].copy()
    data = problem.data(x)
    best = dict.fromkeys(names, np.inf)
    for attempt in range(rounds + 1):  # the first one saves the state of the others
        for name, step in steps.items():
            begin = time.perf_counter()
            results[name] = step(x, data)
            seconds = time.perf_counter() - begin
            best[name] = min(best[name], seconds) if attempt else np.inf
    peers = [best[name] for name in names if name != OURS]
    return [
        {
            "variables": variables,
            "constraints": constraints,
            "code": name,
            "seconds": best[name],
            "ratio_to_fastest_peer": best[name] / min(peers) if peers else None,
            "difference": float(np.sqrt(np.mean((results[name] - results[OURS]) ** 2))),
        }
        for name in names
    ]


def main() -> None:
    """Run the benchmark and print its table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="a small problem only")
    parser.add_argument(
        "--rounds", type=int, default=3, help="number of repetitions, of which the fastest counts"
    )
    parser.add_argument("--json", type=Path, help="file for the rows")
    options = parser.parse_args()
    names = [name for name in CODES if name == OURS or find_spec(name) is not None]
    for name in CODES:
        if name not in names:
            print(f"{name} is not installed and left out: pip install '.[bench]'")
    rows: list[dict[str, Any]] = []
    print("variables  constraints  code         seconds  to fastest peer  difference to ours")
    for variables in (SMALL,) if options.quick else (SMALL, *SIZES):
        for constraints in CONSTRAINTS:
            for row in measure(names, variables, constraints, options.rounds):
                ratio = row["ratio_to_fastest_peer"]
                print(
                    f"{variables:9d}  {constraints:11d}  {row['code']:10s} {row['seconds']:9.4f}  "
                    f"{'-' if ratio is None else f'{ratio:.2f}':>15s}  {row['difference']:18.1e}",
                    flush=True,
                )
                rows.append(row)
    if options.json:
        kept = [{key: row[key] for key in row if key != "difference"} for row in rows]
        options.json.write_text(json.dumps(kept, indent=2) + "\n", encoding="utf-8")
    worst = max(row["difference"] for row in rows if row["variables"] == SMALL)
    if worst > 3e-5:
        raise SystemExit(f"the results of the codes differ by {worst:.1e}, more than 3e-5.")


if __name__ == "__main__":
    main()
