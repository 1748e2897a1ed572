"""Time and memory of a design by the number of triangles, and where they go.

    scripts/fenicsx python3 benchmarks/scale.py
    scripts/fenicsx python3 benchmarks/scale.py --quick --json rows.json
    scripts/fenicsx python3 benchmarks/scale.py --triangles 45000

The bending tube with a filter radius of 1.5 edge lengths and constraints on widths, perimeter
included, as `demos/bend.py` builds it. Each size runs in a process of its own, so that the peak
memory is that of the case. Seconds are CPU seconds of this process with one thread: other work on
the machine disturbs them little. Phases of a design step are measured one by one, the fastest of
some rounds: what a phase costs does not depend on the design. A step contains some of them several
times, a factorisation for each Newton step for instance.
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

SIZES = (3_000, 12_000, 45_000, 146_000, 250_000)
QUICK = (1_000, 3_000)
# Smallest size that counts for the growth: below, it is that of what does not depend on it.
LARGE = 10_000
# Filter radius over edge length.
REACH = 1.5
ROUNDS = 3
# The assembled tube is no equilibrium; with this shift its tangent can be factorised at any size.
SHIFT = 100.0
SET_UP = {
    "mesh_s": "mesh, sewing pattern and case",
    "setup_s": "set-up of the design problem",
    "analysis_s": "its ordering and symbolic factor",
}
STEP = {
    "filter_s": "filter and projection, forward once and backward three times",
    "widths_s": "constraints on widths, forward and backward",
    "perimeter_s": "perimeter, forward and backward",
    "objective_s": "objective, forward and backward",
    "metrics_s": "metrics",
    "mma_s": "MMA with two constraints",
    "energy_s": "energy and stretch bounds",
    "force_s": "force",
    "assembly_s": "assembly of the tangent",
    "factor_s": "factorisation",
    "solve_s": "solution with the factor",
    "sensitivity_s": "derivative of the force by densities",
}
END = {
    "print_s": "print: contours, cleaning, widths of lines and gaps",
    "files_s": "drawing for the printer, fields and pictures",
}
PHASES = {**SET_UP, **STEP, **END}


def timed(action: Callable[[], Any]) -> tuple[float, Any]:
    """Return the CPU seconds of an action, and its result."""
    begin = time.process_time()
    result = action()
    return time.process_time() - begin, result


def peak() -> float:
    """Return the largest memory so far in GiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2


def edge_for(triangles: int) -> float:
    """Return the edge length in m at which the default tube has about so many triangles."""
    from toros_fem.products.tubes.tube import TubeSizes

    tube = TubeSizes()
    area = np.pi * tube.diameter * (tube.length + tube.diameter / 2)
    return float(np.sqrt(4 / np.sqrt(3) * area / triangles))


def _config(edge: float) -> Any:
    """Return the configuration of the tube with edges of this length in m."""
    from toros_fem.products.tubes.tube import TubeConfig

    radius = REACH * edge
    return TubeConfig().updated(
        edge_length=edge, filter_radius=radius, perimeter_weight=0.1, print_width=radius
    )


def measure(triangles: int) -> dict[str, Any]:
    """Measure one size in this process."""
    from mpi4py import MPI

    from toros_fem.meshes import bend
    from toros_fem.products.actuators.problem import actuator_problem
    from toros_fem.products.tubes.tube import bend_metric, tube_case

    comm, config = MPI.COMM_SELF, _config(edge_for(triangles))
    row: dict[str, Any] = {}
    row["mesh_s"], case = timed(
        lambda: tube_case(comm, config, bend(np.pi, config.length), [bend_metric(180.0)])
    )
    row["setup_s"], problem = timed(lambda: actuator_problem(comm, case, config))
    row["setup_gib"] = peak()
    row |= _design_step(problem, config)
    row["step_gib"] = peak()
    row |= _end(problem, case, config)
    row["peak_gib"] = peak()
    factor = problem.solver._factor
    factor._factors = None  # room for those of a second analysis
    row["analysis_s"] = timed(factor._choose)[0]
    return {
        "triangles": len(case.pattern.triangles),
        "unknowns": problem.solver.model.space.dofmap.index_map.size_global,
        "radius_mm": 1e3 * config.filter_radius,
        **{name: row[name] for name in PHASES},
        "setup_gib": row["setup_gib"],
        "step_gib": row["step_gib"],
        "peak_gib": row["peak_gib"],
        "pattern_bytes": _bytes_on_each_rank(problem) / len(case.pattern.triangles),
    }


def _warm_up() -> None:
    """Import and compile everything on a tiny tube: neither grows with the mesh."""
    from mpi4py import MPI

    from toros_fem.meshes import bend
    from toros_fem.products.actuators.problem import actuator_problem
    from toros_fem.products.tubes.tube import bend_metric, tube_case

    comm, config = MPI.COMM_SELF, _config(6e-3)
    case = tube_case(comm, config, bend(np.pi, config.length), [bend_metric(180.0)])
    problem = actuator_problem(comm, case, config)
    _design_step(problem, config)
    _end(problem, case, config)


def _design_step(problem: Any, config: Any) -> dict[str, float]:
    """Return the seconds of each phase, the fastest of some rounds."""
    from petsc4py import PETSc

    from toros_fem.design.loop.options import DesignOptions
    from toros_fem.design.loop.variables import Variables
    from toros_fem.design.mma.optimizer import MMA
    from toros_fem.mechanics.skin.load_case import LoadCase

    model, filter, limits = problem.solver.model, problem.filter, problem.length_scale
    density = problem.with_passive(problem.start_density(0))
    filtered, projected = problem.fields(density)
    model.set_density(projected)
    model.set_load(LoadCase(np.array([config.pressure])))
    rng = np.random.default_rng(0)
    state = model.assembled
    positions = model.positions(state)
    factor = problem.solver._factor
    gradient = rng.standard_normal(len(density))
    right = rng.standard_normal(model.size_local) * model.free

    options = DesignOptions()
    variables = Variables(problem, options)
    mma = MMA(*variables.bounds, constraints=2, options=options.mma, move=variables.move)
    x = variables.vector(density, problem.pressures)
    slopes: list[PETSc.Vec] = [variables.vector(rng.standard_normal(len(density))) for _ in "fgh"]

    def smooth() -> None:
        found = filter.forward(density)
        problem.projection.forward(found)
        for _ in range(3):
            filter.backward(problem.projection.backward(filtered, gradient))

    def widths() -> None:
        limits.forward(density, filtered, projected)
        limits.backward(density, filtered, projected)

    def border() -> None:
        problem.perimeter.forward(projected)
        problem.perimeter.backward(projected)

    def distance() -> None:
        problem.objective.forward(positions)
        problem.objective.backward(positions)

    def measured() -> None:
        whole = problem.skin.gather_vertices(positions)
        for metric in problem.metrics:
            metric.measure(problem.skin.pattern, whole)

    def factorise() -> None:
        assert factor.factorise(SHIFT), "a large shift makes the matrix positive definite"

    actions: dict[str, Callable[[], object]] = {
        "filter_s": smooth,
        "widths_s": widths,
        "perimeter_s": border,
        "objective_s": distance,
        "metrics_s": measured,
        "mma_s": lambda: mma.step(x, 1.0, slopes[0], [-0.1, 0.1], slopes[1:]),
        "energy_s": lambda: model.energy(state),
        "force_s": lambda: model.residual(state),
        "assembly_s": lambda: factor.assemble(state),
        "factor_s": factorise,
        "solve_s": lambda: factor.solve(right),
        "sensitivity_s": lambda: model.density_sensitivity(state, right),
    }
    factor.assemble(state)
    factorise()  # M is assembled for the first one alone
    best = dict.fromkeys(actions, np.inf)
    for _ in range(ROUNDS):
        for name, action in actions.items():
            if name == "assembly_s":
                best[name] = min(best[name], timed(action)[0])
                factor.fill(SHIFT)
                continue
            best[name] = min(best[name], timed(action)[0])
    return best


def _end(problem: Any, case: Any, config: Any) -> dict[str, float]:
    """Return the seconds from a design to its files; lines twice as wide as R, crossing."""
    from drawn_lines import helices

    from toros_fem.making.as_printed.as_printed import contour_values
    from toros_fem.making.panels.svg import write_svg
    from toros_fem.making.print.cleaning import clean
    from toros_fem.making.print.contours import printed_regions
    from toros_fem.making.print.printability import printability, printed_cells
    from toros_fem.results.files import write_fields
    from toros_fem.results.pictures.pattern_plot import plot_pattern, plot_printability
    from toros_fem.results.pictures.shape_plot import plot_shape

    pattern, radius = case.pattern, config.filter_radius
    count = max(2, round(np.pi * config.diameter / (8 * radius)))
    lines = [
        helices(pattern, count, sign * np.radians(30), min(2 * radius, 3e-3)) for sign in (1, -1)
    ]
    density = problem.with_passive(np.any(lines, axis=0).astype(float)[problem.skin.owned_cells])

    def made() -> Any:
        values = contour_values(problem, density)
        regions = printed_regions(pattern, *values, 0.5)
        cleaned = clean(pattern, regions)
        found = printability(pattern, cleaned.regions, config.print_limits)
        return cleaned.regions, found, printed_cells(pattern, cleaned.regions)

    seconds, (regions, found, cells) = timed(made)
    positions = case.target

    def write() -> None:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            write_svg(folder / "pattern.svg", pattern, regions)
            write_fields(folder / "skin.vtu", pattern, positions, {"printed": cells * 1.0})
            plot_pattern(folder / "pattern.png", pattern, regions)
            plot_printability(folder / "made.png", pattern, regions, found, config.print_limits)
            plot_shape(folder / "shape.png", pattern, positions, case.target, regions, "")

    return {"print_s": seconds, "files_s": timed(write)[0]}


def _bytes_on_each_rank(problem: Any) -> int:
    """Return the bytes of arrays that every rank holds whole: pattern, search tree, target."""
    seen: set[int] = set()

    def size(thing: Any) -> int:
        if id(thing) in seen:
            return 0
        seen.add(id(thing))
        if isinstance(thing, np.ndarray):
            return size(thing.base) if isinstance(thing.base, np.ndarray) else int(thing.nbytes)
        parts = getattr(thing, "__dict__", {})
        return sum(size(part) for part in parts.values())

    near = problem.filter._near
    tree = near._tree
    nodes = 80 * tree.size  # a node of a k-d tree has this size
    model = problem.solver.model
    held = (problem.skin.pattern, problem.whole, near, problem.target, model.supports)
    return sum(map(size, held)) + tree.data.nbytes + tree.indices.nbytes + nodes


def growth(rows: list[dict[str, Any]], name: str) -> float | None:
    """Return p in t ~ n^p over the large sizes; None with fewer than two of them."""
    large = [row for row in rows if row["triangles"] >= LARGE]
    if len(large) < 2:
        return None
    size, value = np.log([(row["triangles"], max(row[name], 1e-6)) for row in large]).T
    return float(np.polyfit(size, value, 1)[0])


def table(rows: list[dict[str, Any]]) -> str:
    """Return the rows as a Markdown table, a column for each size, with the growth."""
    head = [f"{round(row['triangles'] / 1000):d} k" for row in rows]
    lines = [
        "| | " + " | ".join(head) + " | growth |",
        "|---|" + "---|" * (len(rows) + 1),
        "| unknowns | "
        + " | ".join(f"{row['unknowns']:,}" for row in rows).replace(",", " ")
        + " | |",
        "| R in mm | " + " | ".join(f"{row['radius_mm']:.2f}" for row in rows) + " | |",
    ]

    def line(text: str, name: str) -> str:
        values = [f"{row[name]:.3f}" if row[name] < 1 else f"{row[name]:.1f}" for row in rows]
        power = growth(rows, name)
        last = "" if power is None else f"{power:.2f}"
        return f"| {text} | " + " | ".join(values) + f" | {last} |"

    lines += [line(text + ", s", name) for name, text in PHASES.items()]
    lines += [
        line(text + ", GiB", name)
        for name, text in (
            ("setup_gib", "peak until set-up"),
            ("step_gib", "peak until the design steps"),
            ("peak_gib", "peak with print and pictures"),
        )
    ]
    whole = " | ".join(f"{row['pattern_bytes']:.0f}" for row in rows)
    return "\n".join([*lines, f"| bytes a triangle that every rank holds | {whole} | |"])


def run(*sizes: int) -> list[dict[str, Any]]:
    """Measure some sizes in a process of their own."""
    command = [sys.executable, __file__, "--worker", *map(str, sizes)]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, check=True, text=True)
    rows: list[dict[str, Any]] = json.loads(done.stdout.strip().splitlines()[-1])
    return rows


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="two small sizes in one process")
    parser.add_argument("--triangles", type=int, nargs="+", help="about so many only")
    parser.add_argument("--json", type=Path, help="file for the rows")
    parser.add_argument("--worker", type=int, nargs="+", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        _warm_up()
        print(json.dumps([measure(size) for size in options.worker]), flush=True)
        return
    rows = []
    single = [(size,) for size in options.triangles or SIZES]
    for sizes in [QUICK] if options.quick else single:
        rows += run(*sizes)
        print(f"{rows[-1]['triangles']} triangles: done", file=sys.stderr, flush=True)
        if options.json:
            options.json.write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")
    print(table(rows))


if __name__ == "__main__":
    main()
