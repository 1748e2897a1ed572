"""Time and memory of a design by the number of triangles, and where they go.

The bending tube with a filter radius of 1.5 edge lengths and constraints on widths, perimeter
included, as `demos/bend.py` builds it. Each size runs in a process of its own, so that the peak
memory is that of the case. Seconds are CPU seconds of this process with one thread: other work on
the machine disturbs them little. Phases of a design step are measured one by one, the fastest of
some rounds: what a phase costs does not depend on the design. A step contains some of them several
times, a factorisation for each Newton step for instance.
"""

from __future__ import annotations

import resource
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from benchmarks.bench import Case, Command, Row, Rows, Table, markdown, timed, values_of
from toros_fem.design.loop.options import DesignOptions
from toros_fem.design.loop.steps import Variables
from toros_fem.design.mma.optimizer import MMA, Functions
from toros_fem.making.as_printed import contour_values
from toros_fem.making.cleaning import Panels, clean
from toros_fem.making.contours import printed_regions
from toros_fem.making.panel_drawing import write_svg
from toros_fem.making.printability import printability, printed_cells
from toros_fem.mechanics.skin.load import Load
from toros_fem.meshes import bend
from toros_fem.products.tubes import Tube, TubeScene, bend_metric
from toros_fem.results.pictures.flat import draw_pattern
from toros_fem.results.pictures.shapes import draw_shape
from toros_fem.results.pictures.shown import DrawnSkin
from toros_fem.results.pictures.style import page
from toros_fem.results.runs.frames import ShownSkin
from toros_fem.results.writer import write_fields

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
# Phases that take less on the largest mesh are not in the table, in s.
SHOWN = 0.1
MEMORY = {
    "setup_gib": "peak until set-up",
    "step_gib": "peak until the design steps",
    "peak_gib": "peak with print and pictures",
}
cpu = partial(timed, clock=time.process_time)


def peak() -> float:
    """Return the largest memory so far in GiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2


def edge_for(triangles: int) -> float:
    """Return the edge length in m at which the default tube has about so many triangles."""
    tube = Tube()
    area = np.pi * tube.diameter * (tube.length + tube.diameter / 2)
    return float(np.sqrt(4 / np.sqrt(3) * area / triangles))


def _config(edge: float) -> Any:
    """Return the configuration of the tube with edges of this length in m."""
    radius = REACH * edge
    return TubeScene().updated(
        edge_length=edge, filter_radius=radius, perimeter_weight=0.1, print_width=radius
    )


def _made(edge: float) -> tuple[Any, Any, float, Any, float]:
    """Return configuration, case and problem with edges of this length, each with its seconds."""
    comm, config = MPI.COMM_SELF, _config(edge)
    target = bend(np.pi, config.skin.length)
    level = config.finest_level
    case, mesh = cpu(lambda: config.tube_case(comm, level, target, [bend_metric(180.0)]))
    problem, setup = cpu(lambda: config.problem(comm, case, level))
    return config, case, mesh, problem, setup


def measure(triangles: int) -> Iterator[Row]:
    """Measure one size in this process."""
    # Import and compile everything on a tiny tube: neither grows with the mesh.
    config, case, _, problem, _ = _made(6e-3)
    _design_step(problem, config)
    _end(problem, case, config)
    row: dict[str, Any] = {}
    config, case, row["mesh_s"], problem, row["setup_s"] = _made(edge_for(triangles))
    row["setup_gib"] = peak()
    row |= _design_step(problem, config)
    row["step_gib"] = peak()
    row |= _end(problem, case, config)
    row["peak_gib"] = peak()
    factor = problem.solver._factor
    factor._factors = None  # room for those of a second analysis
    row["analysis_s"] = cpu(factor._choose)[1]
    row["unknowns"] = problem.solver.model.space.dofmap.index_map.size_global
    row["radius_mm"] = 1e3 * config.design.filter_radius
    size = f"{len(case.pattern.triangles)}"
    for name, value in row.items():
        unit = name.rpartition("_")[2]
        yield Row("scale", f"{triangles}", size, name, float(value), unit if "_" in name else "")


def _design_step(problem: Any, config: Any) -> dict[str, float]:
    """Return the seconds of each phase, the fastest of some rounds."""
    model, filter, limits = problem.solver.model, problem.fields.filter, problem.length_scale
    density = problem.fields.with_passive(problem.fields.start(0))
    filtered, projected = problem.fields.forward(density)
    model.set_density(projected)
    model.set_load(Load(np.array([config.pressure.pressure])))
    rng = np.random.default_rng(0)
    state = model.assembled
    positions = model.positions(state)
    factor = problem.solver._factor
    gradient = rng.standard_normal(len(density))
    right = rng.standard_normal(model.size_local) * model.free

    options = DesignOptions()
    variables = Variables(problem, options)
    mma = MMA(
        problem.comm, *variables.bounds, constraints=2, options=options.mma, move=variables.move
    )
    x = variables.vector(density, problem.physics.pressures)
    slopes = [variables.vector(rng.standard_normal(len(density))) for _ in "fgh"]

    here = Functions(1.0, slopes[0], [-0.1, 0.1], slopes[1:])

    def smooth() -> None:
        found = filter.forward(density)
        problem.fields.projection.forward(found)
        for _ in range(3):
            filter.backward(problem.fields.projection.backward(filtered, gradient))

    def widths() -> None:
        limits.forward(density, filtered, projected)
        limits.backward(density, filtered, projected)

    def both(stage: Any, at: Any) -> Callable[[], object]:
        return lambda: (stage.forward(at), stage.backward(at))

    def measured() -> None:
        whole = problem.skin.gather_vertices(positions)
        for metric in problem.metrics:
            metric.measure(problem.skin.pattern, whole)

    def factorise() -> None:
        assert factor.factorise(SHIFT), "a large shift makes the matrix positive definite"

    actions: dict[str, Callable[[], object]] = {
        "filter_s": smooth,
        "widths_s": widths,
        "perimeter_s": both(problem.terms[0].measure, projected),
        "objective_s": both(problem.objective, positions),
        "metrics_s": measured,
        "mma_s": lambda: mma.step(x, here),
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
            best[name] = min(best[name], cpu(action)[1])
            if name == "assembly_s":
                factor.fill(SHIFT)
    return best


def helices(pattern: Any, count: int, angle: float, width: float) -> Any:
    """Return which triangles lie on helical lines around the tube, (t,).

    Args:
        pattern: The tube.
        count: Number of lines around.
        angle: Their angle to the axis in rad, positive if right-handed.
        width: Width of each line in m.
    """
    u, v = pattern.centroids.T
    pitch = np.ptp(pattern.corners[pattern.cells_of("wall"), :, 0]) / count
    phase = (u - np.tan(angle) * v) % pitch
    off = np.minimum(phase, pitch - phase) * np.cos(angle)
    return (pattern.panel == pattern.panel_index("wall")) & (off < width / 2)


def _end(problem: Any, case: Any, config: Any) -> dict[str, float]:
    """Return the seconds from a design to its files; lines twice as wide as R, crossing."""
    pattern, radius = case.pattern, config.design.filter_radius
    count = max(2, round(np.pi * config.skin.diameter / (8 * radius)))
    lines = [
        helices(pattern, count, sign * np.radians(30), min(2 * radius, 3e-3)) for sign in (1, -1)
    ]
    density = problem.fields.with_passive(
        np.any(lines, axis=0).astype(float)[problem.skin.owned_cells]
    )

    def made() -> Any:
        values = contour_values(problem, density)
        regions = printed_regions(pattern, *values, 0.5)
        cleaned = clean(Panels(pattern), regions)
        found = printability(pattern, cleaned.regions, config.print.limits)
        return cleaned.regions, found, printed_cells(pattern, cleaned.regions)

    (regions, found, cells), seconds = cpu(made)
    positions = case.target

    def write() -> None:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            write_svg(folder / "pattern.svg", pattern, regions)
            write_fields(folder / "skin.vtu", pattern, positions, {"printed": cells * 1.0})
            with page(folder / "pattern.png") as figure:
                draw_pattern(figure, pattern, regions, found, config.print.limits)
            with page(folder / "shape.png") as figure:
                shown = ShownSkin(pattern, case.target, regions=regions)
                draw_shape(figure, DrawnSkin(shown), positions, ())

    return {"print_s": seconds, "files_s": cpu(write)[1]}


def growth(sizes: list[int], values: list[float]) -> str:
    """Return p in t ~ n^p over the large sizes; nothing with fewer than two of them."""
    large = [(n, max(v, 1e-6)) for n, v in zip(sizes, values, strict=True) if n >= LARGE]
    if len(large) < 2:
        return ""
    return f"{np.polyfit(*np.log(large).T, 1)[0]:.2f}"


def table(rows: Rows) -> str:
    """Return a column for each size, with the growth; small phases are left out."""
    found = {int(key[2]): figures for key, figures in values_of(rows, "scale").items()}
    sizes = sorted(found)

    def line(text: str, name: str, form: str = "", *, grows: bool = True) -> tuple[str, ...]:
        values = [found[size][name] or 0.0 for size in sizes]
        cells = [format(v, form or (".3f" if v < 1 else ".1f")).replace(",", " ") for v in values]
        return (text, *cells, growth(sizes, values) if grows else "")

    lines = [
        line("unknowns", "unknowns", ",.0f", grows=False),
        line("R in mm", "radius_mm", ".2f", grows=False),
        *(
            line(f"{text}, s", name)
            for name, text in PHASES.items()
            if (found[sizes[-1]][name] or 0.0) > SHOWN
        ),
        *(line(f"{text}, GiB", name) for name, text in MEMORY.items()),
    ]
    return markdown(("", *(f"{round(size / 1000)} k" for size in sizes), "growth"), lines)


def cases(quick: bool) -> list[Case]:
    """Return a case for each size."""
    return [
        Case("scale", partial(measure, size), f"{size}", alone=True)
        for size in (QUICK if quick else SIZES)
    ]


COMMAND = Command(
    about=__doc__,
    cases=cases,
    serial=True,
    tables=(Table("performance.md", "time and memory by size", table),),
)
