"""Time and memory of whole designs: from their start to the printed and re-simulated pattern.

    scripts/fenicsx python3 benchmarks/design_loop.py --json benchmarks/design_loop.json
    scripts/fenicsx python3 benchmarks/design_loop.py --quick --json rows.json
    scripts/fenicsx python3 benchmarks/design_loop.py --scene twist --json rows.json
    scripts/fenicsx python3 benchmarks/design_loop.py --only bend_fine --json rows.json
    scripts/fenicsx python3 benchmarks/design_loop.py --report benchmarks/design_loop.json

A case is a scene at one size. Beside the demo's own way, coarse to fine and by symmetric parts,
stands the way before: one mesh, the whole skin. Both run one after the other, so that their ratio
holds on a machine whose speed changes. Each design runs in processes of its own, so that the peak
memory is that of the case. Seconds are wall time without imports, compilation of forms and files:
the machine should do nothing else. All cases together take half an hour or more on two cores.

The JSON file is written after each design. Rows of other cases that are in it stay. `--report`
writes docs/performance.md and its picture from it, and from the rows of `scale.py`.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent
# (ranks, threads of each).
ONE_CORE, TWO_THREADS, TWO_RANKS = (1, 1), (1, 2), (2, 1)
SCENES = ("bend", "contract", "twist", "bend_twist", "walker", "gripper")
NOW, BEFORE = "levels", "before"
# Half the tube's length, a third of the angle.
SMALL = {"length": 0.075, "angle": 60.0, "edge_length": 1.7e-3, "filter_radius": 2.6e-3}


@dataclass(frozen=True)
class Case:
    """A scene at one size.

    Attributes:
        scene: Name of the demo.
        now: Ranks, and threads of each, that the demo's own way runs on.
        before: The same of the way before.
        changes: What differs from the demo's defaults, in both ways.
    """

    scene: str
    now: tuple[tuple[int, int], ...] = (ONE_CORE,)
    before: tuple[tuple[int, int], ...] = (ONE_CORE,)
    changes: Mapping[str, Any] = field(default_factory=dict)

    @property
    def designs(self) -> list[tuple[str, tuple[int, int]]]:
        """Way and cores of each design, both ways on the same cores beside each other."""
        cores = dict.fromkeys((*self.now, *self.before))
        ways = ((NOW, self.now), (BEFORE, self.before))
        return [(way, each) for each in cores for way, own in ways if each in own]


# As when these designs were first measured: densities from noise, the pressure is designed, and
# prints are not corrected.
FREE = {"design_pressure": True, "start": "random", "corrections": 0}
CASES = {
    "bend": Case("bend", (ONE_CORE, TWO_THREADS, TWO_RANKS), (ONE_CORE, TWO_RANKS), changes=FREE),
    "bend_fine": Case(
        "bend",
        (ONE_CORE, TWO_THREADS, TWO_RANKS),
        (),
        {**FREE, "edge_length": 0.7e-3, "filter_radius": 1.07e-3},
    ),
    # The way before would take days here.
    "bend_paper": Case(
        "bend",
        (ONE_CORE, TWO_RANKS),
        (),
        {**FREE, "edge_length": 0.4e-3, "filter_radius": 0.6e-3},
    ),
    "contract": Case("contract", changes={**FREE, "levels": 2}),
    "contract_half": Case("contract", before=(), changes={**FREE, "levels": 1}),
    "twist": Case("twist", changes={**FREE, "levels": 2}),
}
# Only run where the command line names them.
FURTHER = {
    name: Case(name, changes={"start": "random", "corrections": 0})
    for name in SCENES
    if name not in CASES
}
QUICK = {
    "bend_quick": Case(
        "bend",
        changes={
            **SMALL,
            "iterations": 5,
            "constrained_iterations": 3,
            "level_iterations": 3,
            "polish_iterations": 0,
            "corrections": 0,
        },
    ),
}


def design(scene: str, way: str, changes: Mapping[str, Any]) -> dict[str, Any]:
    """Run one design on the ranks that this runs on; return its row."""
    import resource

    from demo_runs import DEMOS, without_curve
    from mpi4py import MPI

    from toros_fem.design.loop.options import Iteration
    from toros_fem.products.actuators.run import design_actuator
    from toros_fem.results.reporter import DesignReporter

    comm = MPI.COMM_WORLD
    demo = DEMOS[scene]
    config: Any = without_curve(demo.config.updated(**changes))
    if way == BEFORE:
        config = config.updated(levels=1)
        if hasattr(config, "whole"):
            config = config.updated(whole=True)
    points: list[tuple[float, float, int]] = []

    class Clock(DesignReporter):
        """Also notes when each iteration ends."""

        def __call__(self, row: Iteration, evaluation: Any) -> None:
            super().__call__(row, evaluation)
            points.append((round(self.seconds["total"], 2), row.objective, row.level))

    with tempfile.TemporaryDirectory() as name:
        folder = Path(comm.bcast(name, root=0))
        begin = time.perf_counter()
        reporter = Clock(comm, folder)
        case = sys.modules[type(demo.config).__module__].case
        made = design_actuator(comm, folder, case, config, reporter)
        wall = time.perf_counter() - begin
        comm.barrier()  # the first rank writes into its folder until here
    summary, history = made.summary, made.result.history
    seconds, parts = summary["seconds"], summary["parts_by_symmetry"]
    metrics = [metric for metric in made.problem.metrics if metric.target is not None]
    memory = comm.allreduce(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) / 1024**2
    return {
        "scene": scene,
        "way": way,
        "triangles": parts * summary["triangles"],
        "parts_by_symmetry": parts,
        "edge_mm": 1e3 * config.edge_length,
        "radius_mm": 1e3 * config.filter_radius,
        "ranks": comm.size,
        "threads": int(os.environ["OMP_NUM_THREADS"]),
        "levels": config.level_count,
        "seconds": seconds["total"],
        "cpu_seconds": comm.allreduce(time.process_time()),
        "files_seconds": wall - seconds["total"],
        "phases": {key: value for key, value in seconds.items() if key != "total"},
        "steps": summary["iterations"],
        "rejected": summary["rejected"],
        "factorisations": summary["factorisations"],
        "newton_steps": summary["newton_steps"],
        **finest(history),
        "gradient_over_forward": seconds["adjoint"] / seconds["equilibrium"],
        "peak_gib": memory,
        "printed": {metric.key: summary[metric.key] for metric in metrics},
        "designed": {metric.key: summary["design"][metric.key] for metric in metrics},
        "asked": {metric.key: metric.target for metric in metrics},
        "printed_objective": summary["printed_objective"],
        "pressure_pa": summary["pressure_pa"],
        "islands": summary["manufacture"]["islands"],
        "constraints_satisfied": summary["length_scale"]["satisfied"],
        "history": points,
        "machine": machine(summary["versions"]),
    }


def finest(history: Any) -> dict[str, float]:
    """Return the cost of a step on the finest mesh.

    Medians and mean are over its steps. What the start of each stage on this mesh costs, a solve
    that belongs to no step, is in the total numbers and seconds alone.
    """
    import numpy as np

    level = history[-1].level
    rows = [row for row in history if row.level == level]
    steps = [b for a, b in itertools.pairwise(rows) if b.iteration > a.iteration]
    factorisations, newton_steps, seconds = (
        sum(getattr(row, name) for row in rows)
        for name in ("factorisations", "newton_steps", "seconds")
    )
    costs = [row.factorisations for row in steps]
    return {
        "finest_steps": len(steps),
        "finest_rejected": sum(row.rejected for row in rows),
        "finest_factorisations": factorisations,
        "finest_newton_steps": newton_steps,
        "finest_seconds": seconds,
        "median_factorisations": float(np.median(costs)),
        "mean_factorisations": float(np.mean(costs)),
        "median_newton_steps": float(np.median([row.newton_steps for row in steps])),
        "median_step_seconds": float(np.median([row.seconds for row in steps])),
        "seconds_per_factorisation": seconds / factorisations,
        "seconds_per_newton_step": seconds / newton_steps,
    }


def machine(versions: Mapping[str, str]) -> dict[str, Any]:
    """Return processor, number of cores and versions."""
    name = "unknown"
    info = Path("/proc/cpuinfo")
    if info.exists():
        lines = info.read_text(encoding="utf-8").splitlines()
        names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
        name = names[0] if names else name
    known = {key: value for key, value in versions.items() if key != "platform"}
    return {"processor": name, "cores": os.cpu_count(), "versions": known}


def run(
    scene: str, way: str, cores: tuple[int, int], changes: Mapping[str, Any], *, verbose: bool
) -> dict[str, Any]:
    """Run one design in processes of its own; return its row."""
    ranks, threads = cores
    with tempfile.TemporaryDirectory() as name:
        file = Path(name) / "row.json"
        task = json.dumps({"scene": scene, "way": way, "changes": dict(changes)})
        command = [sys.executable, __file__, "--worker", task, "--json", str(file)]
        if ranks > 1:
            command = ["mpirun", "-n", str(ranks), *command]
        environment = {**os.environ, "OMP_NUM_THREADS": str(threads)}
        shown = None if verbose else subprocess.DEVNULL
        subprocess.run(command, env=environment, stdout=shown, check=True)
        row: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return row


def work(task: Mapping[str, Any], file: Path) -> None:
    """Run one design and write its row on the first rank."""
    from mpi4py import MPI

    row = design(**task)
    if MPI.COMM_WORLD.rank == 0:
        file.write_text(json.dumps(row), encoding="utf-8")


def write(file: Path, rows: list[dict[str, Any]]) -> None:
    """Write the rows, keeping those of other cases that the file has, but for --quick."""
    kept = []
    if file.exists():
        new = {*QUICK, *(row["case"] for row in rows)}
        old = json.loads(file.read_text(encoding="utf-8"))["rows"]
        kept = [row for row in old if row["case"] not in new]
    order = [*CASES, *FURTHER, *QUICK]
    # Rows of one case stay in the order in which they ran.
    content = sorted(kept + rows, key=lambda row: order.index(row["case"]))
    file.write_text(json.dumps({"rows": content}, indent=1) + "\n", encoding="utf-8")


def line(row: Mapping[str, Any]) -> str:
    """Return a row as a line of text."""
    found = ", ".join(
        f"{name} {'-' if value is None else format(value, '.1f')} of {row['asked'][name]:g}"
        for name, value in row["printed"].items()
    )
    return (
        f"{row['seconds']:7.1f} s, {row['steps']} steps, {row['rejected']} rejected, "
        f"{row['factorisations']} factorisations (finest mesh: median "
        f"{row['median_factorisations']:g}, mean {row['mean_factorisations']:.1f} a step), "
        f"{row['peak_gib']:.2f} GiB, printed {found}"
    )


def chosen(options: argparse.Namespace) -> dict[str, Case]:
    """Return the cases that the command line names."""
    everything = QUICK if options.quick else {**CASES, **FURTHER}
    if options.only:
        return {name: everything[name] for name in options.only if name in everything}
    if options.scene:
        return {name: case for name, case in everything.items() if case.scene == options.scene}
    return QUICK if options.quick else CASES


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    names = [*CASES, *FURTHER, *QUICK]
    parser.add_argument("--scene", choices=SCENES, help="cases of one scene only")
    parser.add_argument("--only", nargs="+", choices=names, metavar="NAME", help="cases only")
    parser.add_argument("--quick", action="store_true", help="one coarse bend with few steps")
    parser.add_argument("--json", type=Path, help="file for the rows")
    parser.add_argument("--verbose", action="store_true", help="print every step of the designs")
    parser.add_argument("--report", type=Path, help="write the documentation from this file")
    parser.add_argument("--scale", type=Path, default=FOLDER / "scale.json", help="of scale.py")
    parser.add_argument("--docs", type=Path, default=FOLDER.parent / "docs", help="its folder")
    parser.add_argument("--worker", type=json.loads, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        work(options.worker, options.json)
        return
    if options.report:
        from design_loop_report import write_docs

        write_docs(options.docs, options.report, options.scale)
        return
    sys.exit(measure(parser, options))


def measure(parser: argparse.ArgumentParser, options: argparse.Namespace) -> int:
    """Run the designs that the command line names; return the exit code."""
    cases, failed = chosen(options), 0
    if not cases:
        parser.error("no case has this name or scene; --quick has bend_quick alone.")
    # Compile the forms and load all libraries once, of parts and whole.
    for way in () if options.quick else (NOW, BEFORE):
        few = {"iterations": 1, "constrained_iterations": 1, "polish_iterations": 0}
        tiny = {"edge_length": 3.4e-3, "filter_radius": 5.2e-3}
        run("bend", way, ONE_CORE, {**SMALL, **few, **tiny}, verbose=False)
    rows: list[dict[str, Any]] = []
    for name, case in cases.items():
        for way, (ranks, threads) in case.designs:
            print(f"{name}, {way}, ranks × threads: {ranks} × {threads} …", flush=True)
            try:
                row = run(case.scene, way, (ranks, threads), case.changes, verbose=options.verbose)
            except subprocess.CalledProcessError as error:
                print(f"    FAILED: {error}", flush=True)  # its own message is above
                failed = 1
                continue
            rows.append({"case": name, **row})
            print(line(rows[-1]), flush=True)
            if options.json:
                write(options.json, rows)
    return failed


if __name__ == "__main__":
    main()
