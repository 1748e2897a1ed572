"""Cost of a Newton step, over the cost of its factorisation alone.

    scripts/fenicsx python3 benchmarks/newton_cost.py
    scripts/fenicsx python3 benchmarks/newton_cost.py --triangles 45000 --json cost.json
    scripts/fenicsx python3 benchmarks/newton_cost.py --quick

The capped tube at about 3, 11, 45 and 180 thousand triangles, with and without bending, on one
rank with one thread, on one rank with two, and on two ranks. Each phase of a step is timed in turn
with a bare numeric factorisation and solve of the same matrix by every direct solver for symmetric
matrices that PETSc has here. The ratios are those to the fastest of them and of ours. Whole steps
are timed as the solver takes them. Each case runs in processes of its own, so that the peak memory
is that of the case. The last table shows the time of compilation: only the terms that a skin has
are compiled.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

SIZES = (3000, 11000, 45000, 180000)
LENGTH, DIAMETER, PRESSURE = 0.15, 0.02, 5e3
PHASES = ("assembly_s", "force_s", "factor_s", "solve_s")
ROW = (
    "triangles", "dofs", "ranks", "threads", "bending", *PHASES, "step_s", "bare_factor_solve_s",
    "step_ratio", "assembly_ratio",
)  # fmt: skip
# Ranks, and threads of each.
CASES = ((1, 1), (1, 2), (2, 1))
SCENES = ("bending and pressure", "no bending", "no pressure", "neither")
# Triangles; bending, ranks and threads of each case; scenes. Those without bending compile fast.
QUICK_SIZE = 1000
QUICK = ((True, 2, 1), (False, 1, 1), (False, 1, 2))
QUICK_SCENES = ("no bending", "neither")


def _composite(bending: bool) -> Any:
    from toros_fem.materials.sheet import Bending, Composite

    return Composite(bending=Bending() if bending else None)


def measure(triangles: int, bending: bool, rounds: int) -> dict[str, Any]:
    """Time one case, on the ranks this runs on."""
    from mpi4py import MPI
    from petsc4py import PETSc

    from toros_fem.mechanics.equilibrium.linear_solver import TangentFactor
    from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
    from toros_fem.mechanics.skin.supports import clamp
    from toros_fem.mechanics.skin.tangent import UpperTangent
    from toros_fem.meshes import cylinder, sew

    comm = MPI.COMM_WORLD

    def timed(action: Callable[[], object]) -> float:
        comm.barrier()
        begin = time.perf_counter()
        action()
        return float(comm.allreduce(time.perf_counter() - begin, op=MPI.MAX))

    area = np.pi * DIAMETER * (LENGTH + DIAMETER / 2)
    edge = np.sqrt(2 * area / triangles)
    pattern = cylinder(comm, LENGTH, DIAMETER, edge, mesh="structured")
    skin = sew(comm, pattern)
    begin = time.perf_counter()
    solver = EquilibriumSolver(skin, _composite(bending), clamp(pattern, ["base"]))
    setup = time.perf_counter() - begin
    grey = np.full(len(skin.owned_cells), 0.3)
    result = solver.solve(grey, PRESSURE)
    # A neighbouring design, its start a copy so that no factors of it are at hand; and none of
    # an earlier step serve.
    solver._snes.newton._max_iterations = 0
    again = solver.solve(grey + 0.05, PRESSURE, start=result.state.copy())
    whole = [row.seconds for row in again.history if row.step and not (row.modified or row.shift)]
    step = float(comm.allreduce(np.median(whole), op=MPI.MAX))
    memory = comm.allreduce(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) / 1024**2

    factor, state = TangentFactor(solver.model), again.state
    rhs = solver.model.volume_gradient(state)
    factor.assemble(state)
    factor.fill(0.0)
    pattern_of = UpperTangent(solver.model)
    names = ("cholmod", "mumps", "mumps, no pivoting")[comm.size > 1 :]
    bare = {name: _bare(pattern_of, factor.values, name) for name in names}
    best = {name: np.inf for name in (*PHASES, *bare)}
    for _ in range(rounds):
        actions: dict[str, Callable[[], object]] = {
            "assembly_s": lambda: factor.assemble(state),
            "force_s": lambda: solver.model.residual(state),
            "factor_s": factor.factorise,
            "solve_s": lambda: factor.solve(rhs),
        }
        for name, (matrix, ksp, x, y) in bare.items():

            def plain(
                matrix: PETSc.Mat = matrix, ksp: PETSc.KSP = ksp, x: Any = x, y: Any = y
            ) -> None:
                matrix.stateIncrease()
                ksp.setOperators(matrix)
                ksp.setUp()
                ksp.solve(x, y)

            actions[name] = plain
        for name, action in actions.items():
            best[name] = min(best[name], timed(action))
    own = f"own {factor.package}"
    best[own] = best["factor_s"] + best["solve_s"]
    fastest = min((own, *bare), key=lambda name: best[name])
    row = {
        "triangles": len(pattern.triangles),
        "dofs": solver.model.space.dofmap.index_map.size_global,
        "ranks": comm.size,
        "threads": int(os.environ["OMP_NUM_THREADS"]),
        "bending": bending,
        **{name: best[name] for name in PHASES},
        "step_s": step,
        "bare_factor_solve_s": best[fastest],
        "step_ratio": step / best[fastest],
        "assembly_ratio": best["assembly_s"] / best[fastest],
        "bare_solver": fastest,
        "solver": factor.describe(),
        "other_s": max(0.0, step - sum(best[name] for name in PHASES)),
        "setup_s": setup,
        "peak_memory_gib": memory,
    }
    return row


def _bare(tangent: Any, values: Any, name: str) -> tuple[Any, Any, Any, Any]:
    """Return a PETSc solver of the same matrix with its defaults, its analysis done."""
    from petsc4py import PETSc

    size = len(tangent.indptr) - 1
    arrays = (tangent.indptr, tangent.columns, values.copy())
    sizes = ((size, None), (size, None))
    matrix = PETSc.Mat().createAIJWithArrays(sizes, arrays, comm=PETSc.COMM_WORLD)
    matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    if name == "cholmod":
        matrix = matrix.convert("sbaij", PETSc.Mat())  # which it reads in place
    if name == "mumps, no pivoting":
        matrix.setOption(PETSc.Mat.Option.SPD, True)
    ksp = PETSc.KSP().create(matrix.getComm())
    ksp.setType(PETSc.KSP.Type.PREONLY)
    ksp.setOperators(matrix)
    pc = ksp.getPC()
    pc.setType(PETSc.PC.Type.CHOLESKY)
    pc.setFactorSolverType(name.split(",")[0])
    ksp.setUp()
    x, y = matrix.createVecs()
    x.set(1.0)
    return matrix, ksp, x, y


def compiled(scene: str) -> dict[str, Any]:
    """Build and solve a small scene with an empty cache of compiled forms."""
    from mpi4py import MPI

    from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
    from toros_fem.mechanics.skin.supports import clamp
    from toros_fem.meshes import cylinder, sew

    begin = time.perf_counter()
    bending = scene in ("bending and pressure", "no pressure")
    capped = scene in ("bending and pressure", "no bending")
    caps = "both" if capped else None
    pattern = cylinder(MPI.COMM_SELF, 0.06, DIAMETER, 4e-3, mesh="structured", caps=caps)
    fixed = clamp(pattern, ["base"] if capped else ["wall"])
    skin = sew(MPI.COMM_SELF, pattern)
    solver = EquilibriumSolver(skin, _composite(bending), fixed)
    solver.solve(np.zeros(len(skin.owned_cells)), PRESSURE if capped else 0.0)
    seconds = time.perf_counter() - begin
    begin = time.perf_counter()
    EquilibriumSolver(skin, _composite(bending), fixed)
    kernels = Path(os.environ["XDG_CACHE_HOME"]).rglob("libffcx_forms_*.c")
    return {
        "scene": scene,
        "forms": sum(1 for _ in kernels),
        "first_s": seconds,
        "set_up_again_s": time.perf_counter() - begin,
    }


def run(arguments: list[str], ranks: int = 1, **environment: str) -> dict[str, Any]:
    """Run this script as a worker and read the row it prints last."""
    command = [sys.executable, __file__, *arguments]
    if ranks > 1:
        command = ["mpirun", "-n", str(ranks), *command]
    done = subprocess.run(
        command, env={**os.environ, **environment}, stdout=subprocess.PIPE, check=True, text=True
    )
    row: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    return row


HEAD = (
    "triangles    dofs ranks threads bending  assembly  force factor  solve  other |  step   bare  "
    "step/bare assembly/bare  GiB  bare by"
)


def line(row: dict[str, Any]) -> str:
    """One row of the table."""
    return (
        f"{row['triangles']:9d} {row['dofs']:7d} {row['ranks']:5d} {row['threads']:7d} "
        f"{row['bending']!s:7s} "
        f"{row['assembly_s']:9.3f} {row['force_s']:6.3f} {row['factor_s']:6.3f} "
        f"{row['solve_s']:6.3f} {row['other_s']:6.3f} | {row['step_s']:6.3f} "
        f"{row['bare_factor_solve_s']:6.3f} {row['step_ratio']:8.2f} "
        f"{row['assembly_ratio']:11.2f} {row['peak_memory_gib']:7.2f}  {row['bare_solver']}"
    )


def compare(rows: list[dict[str, Any]]) -> None:
    """Print how times grow with the size, and what a second core gains."""
    for case in CASES:
        for bending in (True, False):
            part = [
                row
                for row in rows
                if (row["ranks"], row["threads"]) == case and row["bending"] == bending
            ]
            if len(part) < 2:
                continue
            size = np.log([row["triangles"] for row in part])
            exponents = [
                f"{name} {np.polyfit(size, np.log([row[name] for row in part]), 1)[0]:.2f}"
                for name in ("assembly_s", "factor_s", "step_s", "peak_memory_gib")
            ]
            ranks, threads = case
            print(
                f"growth, {ranks} ranks, {threads} threads, bending {bending}: "
                f"{', '.join(exponents)}"
            )
    for row in rows:
        for twin in rows:
            same = all(row[key] == twin[key] for key in ("triangles", "bending"))
            if same and (row["ranks"], row["threads"]) == (1, 1) and twin is not row:
                print(
                    f"{row['triangles']} triangles, bending {row['bending']}, {twin['solver']}: "
                    f"a step is {row['step_s'] / twin['step_s']:.2f} times as fast as with one "
                    f"thread on one rank, its assembly "
                    f"{row['assembly_s'] / twin['assembly_s']:.2f} times"
                )


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--triangles", type=int, help="about so many only")
    parser.add_argument("--json", type=Path, help="file for the rows")
    parser.add_argument("--rounds", type=int, default=5, help="of which the fastest counts")
    parser.add_argument("--quick", action="store_true", help="a few cases of a small size")
    parser.add_argument("--worker", nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--compile", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        row = measure(int(options.worker[0]), options.worker[1] == "True", options.rounds)
        if int(os.environ.get("OMPI_COMM_WORLD_RANK", "0")) == 0:
            print(json.dumps(row), flush=True)
        return
    if options.compile:
        print(json.dumps(compiled(options.compile)), flush=True)
        return
    sizes, cases, scenes = SIZES, [(b, *case) for b in (True, False) for case in CASES], SCENES
    if options.quick:
        sizes, cases, scenes = (QUICK_SIZE,), list(QUICK), QUICK_SCENES
    rows = []
    print(HEAD)
    for triangles in [options.triangles] if options.triangles else sizes:
        for bending, ranks, threads in cases:
            worker = ["--worker", str(triangles), str(bending), "--rounds", str(options.rounds)]
            rows.append(run(worker, ranks, OMP_NUM_THREADS=str(threads)))
            print(line(rows[-1]), flush=True)
    compare(rows)
    for scene in scenes:
        with tempfile.TemporaryDirectory() as folder:
            found = run(["--compile", scene], XDG_CACHE_HOME=folder)
            print("{scene:22s} {forms} forms, first solve {first_s:.1f} s".format(**found))
    if options.json:
        kept = [{key: row[key] for key in ROW} for row in rows]
        options.json.write_text(json.dumps(kept, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
