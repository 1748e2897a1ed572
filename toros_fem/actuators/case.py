"""A scene and the numbers to design it with: from panels and target to files on disk."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem._types import Floats
from toros_fem._validate import require_choice, require_count
from toros_fem.analysis.error_estimate import estimate_error
from toros_fem.density.field import check_density, random_density
from toros_fem.density.filters import make_filter
from toros_fem.density.projection import Projection
from toros_fem.design.config import DesignConfig, known_inputs
from toros_fem.design.loop import DesignResult, optimize
from toros_fem.design.options import DesignOptions, Stage
from toros_fem.design.problem import Evaluation
from toros_fem.design.shape_problem import ShapeProblem
from toros_fem.equilibrium.solver import EquilibriumError, EquilibriumSolver
from toros_fem.fabrication.as_printed import (
    PrintedDesign,
    as_printed,
    connect_islands,
    remove_islands,
)
from toros_fem.fabrication.printability import PrintLimits
from toros_fem.materials import CURVATURES, SEAMS, Bending, Bladder, Composite
from toros_fem.mechanics.chambers import Chambers
from toros_fem.mechanics.supports import Supports
from toros_fem.meshes.mirror import mirrored
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.skin import Skin, sew
from toros_fem.mma.optimizer import MMAOptions
from toros_fem.objectives.alignment import AlignedObjective
from toros_fem.objectives.cross_sections import CrossSectionObjective, CrossSections
from toros_fem.objectives.gap import Body, GapObjective
from toros_fem.objectives.metrics import Metric
from toros_fem.objectives.shape import Objective, ShapeObjective, SumObjective
from toros_fem.output.reporter import Reporter, print_step


@dataclass(frozen=True, eq=False)
class ActuatorCase:
    """What is to be designed.

    Attributes:
        pattern: Panels and seams.
        target: Target positions of all assembled vertices, (n, 3), in m.
        supports: What is held.
        figures: What the run is judged by, the most important first.
        passive: Density that is given, of all triangles, (t,); NaN where it is designed.
        weights, relative: Factors on each vertex in the objective, as `ShapeObjective` has; None
            for both leaves that objective out if there is another one.
        sections: Cross-sections whose place and orientation count besides.
        start: Density of all triangles to start from, (t,), within [0.1, 0.9]: noise of 0.1 is
            added. None: 0.5.
        symmetry: Axes of the planes that the pattern is cut at, as for `meshes.mirrored`: what is
            shown and printed is the whole.
        chambers: Pressure chambers; None for one.
        grasp: A body, the weight of each vertex's distance from its surface, (n,), and the factor
            on that term.
        aligned: Whether shape counts wherever the skin is and however it is turned.
    """

    pattern: Pattern
    target: Floats
    supports: Supports
    metrics: tuple[Metric, ...]
    passive: Floats | None = None
    weights: Floats | None = None
    relative: Floats | None = None
    sections: CrossSections | None = None
    start: Floats | None = None
    symmetry: tuple[int, ...] = ()
    chambers: Chambers | None = None
    grasp: tuple[Body, Floats, float] | None = None
    aligned: bool = False

    def objective(self, skin: Skin) -> Objective:
        """What is minimised on the sewn skin."""
        parts: list[Objective] = []
        if self.sections is not None:
            parts.append(CrossSectionObjective(skin, self.target, self.sections))
        if self.grasp is not None:
            parts.append(GapObjective(skin, *self.grasp))
        if not parts or self.weights is not None or self.relative is not None:
            parts.append(ShapeObjective(skin, self.target, self.weights, self.relative))
        found = parts[0] if len(parts) == 1 else SumObjective(*parts)
        return AlignedObjective(skin, self.target, found) if self.aligned else found


@dataclass(frozen=True)
class ActuatorConfig(DesignConfig):
    """The numbers that every design under pressure needs; SI units.

    Attributes:
        pressure: First guess in Pa.
        pressure_min, pressure_max: Bounds on the pressure in Pa; 0 for both keeps it as it is.
        bladder_young, bladder_thickness: Of a rubber bladder that moves with the skin, in Pa and
            m; a thickness of 0 leaves it out.
        bending: "average", "quadratic" or "midedge" curvature; "none" for a membrane.
        seams: "continuous" or "hinged".
        polish: Steps after all free islands have been taken out, or joined to the rest if that
            does less harm, so that the design makes up for it; 0 leaves them in.
        refine: 1 simulates what is printed once more on a mesh refined, to estimate by how much
            the mesh falsifies the angle; 0 does not.
    """

    pressure: float = 5e3
    pressure_min: float = 1e3
    pressure_max: float = 20e3
    bladder_young: float = 0.29e6
    bladder_thickness: float = 0.0
    bending: str = Bending.curvature
    seams: str = Bending.seams
    polish: int = 20
    refine: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_count(0, polish=self.polish)
        require_choice("refine", str(self.refine), ("0", "1"))
        require_choice("bending", self.bending, ("none", *CURVATURES))
        require_choice("seams", self.seams, SEAMS)

    @property
    def composite(self) -> Composite:
        """Fabric and reinforcement."""
        return replace(
            super().composite,
            bending=None if self.bending == "none" else Bending(self.bending, self.seams),
            bladder=Bladder(self.bladder_young, self.bladder_thickness)
            if self.bladder_thickness
            else None,
        )

    @property
    def pressure_bounds(self) -> tuple[float, float] | None:
        """Bounds on the pressure in Pa; None if it is given."""
        if self.pressure_min == self.pressure_max == 0:
            return None
        return self.pressure_min, self.pressure_max

    @property
    def stages(self) -> tuple[Stage, ...]:
        """Free first, then with constraints on the widths."""
        free = (Stage(self.iterations),)
        return free + (Stage(self.constrained, constrained=True),) if self.constrained else free


@dataclass(frozen=True, eq=False)
class ActuatorResult:
    """What designing a scene came to.

    Attributes:
        summary: The figures, as written to summary.json.
        result: What the design loop arrived at.
        printed: What is printed of it.
        problem: The design problem.
    """

    summary: dict[str, Any]
    result: DesignResult
    printed: PrintedDesign
    problem: ShapeProblem


def merged(defaults: dict[str, Any], inputs: dict[str, Any]) -> dict[str, Any]:
    """Defaults with what differs from them put in, and all settings.

    Raises:
        ParameterError: An input is none of them.
    """
    return known_inputs(ActuatorConfig(), defaults, inputs)


def settings_of(inputs: dict[str, Any]) -> ActuatorConfig:
    """Those of some inputs that are settings."""
    return ActuatorConfig(
        **{k: v for k, v in inputs.items() if k in ActuatorConfig.__dataclass_fields__}
    )


def make_problem(
    comm: MPI.Comm, scene: ActuatorCase, settings: ActuatorConfig, *, verbose: bool = False
) -> ShapeProblem:
    """The design problem of a scene (collective).

    Raises:
        TorosError: A number or the scene itself is out of bounds.
    """
    s = settings
    skin = sew(comm, scene.pattern)
    passive = None if scene.passive is None else scene.passive[skin.owned_cells]
    whole = mirrored(scene.pattern, scene.symmetry) if scene.symmetry else None
    problem = ShapeProblem(
        solver=EquilibriumSolver(
            skin,
            s.composite,
            scene.supports,
            log=print_step(comm) if verbose else None,
            chambers=scene.chambers,
        ),
        objective=scene.objective(skin),
        filter=make_filter(s.filter, skin, s.radius, whole=whole),
        pressure=s.pressure,
        projection=Projection(s.beta, s.eta),
        passive=passive,
        pressure_bounds=s.pressure_bounds,
        weight=s.perimeter,
        whole=whole,
    )
    s.penalise(problem)
    return problem


def first_density(skin: Skin, scene: ActuatorCase, seed: int) -> Floats:
    """Densities to start from, at owned triangles.

    Raises:
        DensityError: The scene's start leaves [0.1, 0.9].
    """
    if scene.start is None:
        return random_density(skin, seed)
    drawn = scene.start[skin.owned_cells] + random_density(skin, seed) - 0.5
    check_density(skin, drawn)
    return drawn


def design(
    comm: MPI.Comm,
    output: Path,
    scene: ActuatorCase,
    inputs: dict[str, Any],
    *,
    begin: float,
    verbose: bool = False,
) -> ActuatorResult:
    """Design a scene and write what comes of it (collective).

    Args:
        comm: Communicator.
        output: Folder for summary, history, pattern, fields and pictures.
        scene: What is to be designed.
        inputs: All numbers that went in, those of `ActuatorConfig` among them.
        begin: `time.perf_counter()` at the start of the whole run.
        verbose: Whether to print every step of the equilibrium solver.
    """
    settings = settings_of(inputs)
    problem = make_problem(comm, scene, settings, verbose=verbose)
    skin = problem.solver.skin
    options = DesignOptions(settings.stages, mma=MMAOptions(move=settings.move))
    reporter = Reporter(skin, output, options.iterations, scene.metrics, begin)
    result = optimize(
        problem, options, start=first_density(skin, scene, settings.seed), callback=reporter
    )
    limits = PrintLimits(width=settings.print_width, gap=settings.print_width)
    printed = as_printed(problem, result, limits, settings.island_area)
    if settings.polish and printed.before.free_islands:
        stage = replace(options.stages[-1], iterations=settings.polish)
        start = _without_islands(problem, result, printed)
        polishing = replace(options, stages=(stage,))
        result = optimize(problem, polishing, start=start, callback=reporter, after=result)
        printed = as_printed(problem, result, limits, settings.island_area)
    metrics: dict[str, Any] = {"seed": settings.seed}
    made = printed.evaluation
    if settings.refine and made is not None:
        metrics.update(_refined_figures(problem, made, scene))
    summary = reporter.finish(problem, result, printed, scene.target, inputs, metrics)
    return ActuatorResult(summary, result, printed, problem)


def _without_islands(problem: ShapeProblem, result: DesignResult, printed: PrintedDesign) -> Floats:
    """Free islands taken out or joined to the rest, whichever does less harm (collective)."""
    starts = [make(problem, result, printed) for make in (remove_islands, connect_islands)]
    harm = []
    for density in starts:
        try:
            near = result.final.equilibrium
            found = problem.simulate(density, near.state, near.pressures, allow_continuation=False)
            harm.append(found.objective)
        except EquilibriumError:  # raised by all ranks or by none
            harm.append(np.inf)
    return starts[int(np.argmin(harm))]


def _refined_figures(
    problem: ShapeProblem, made: Evaluation, scene: ActuatorCase
) -> dict[str, Any]:
    """The figures on a refined mesh and the errors that this tells of; None if there are none."""
    try:
        found = estimate_error(
            problem.solver, made.projected, made.equilibrium, [f.measure for f in scene.metrics]
        )
    except EquilibriumError as caught:  # raised by all ranks or by none
        none = {f"{f.name}_{kind}_{f.unit}": None for f in scene.metrics
                for kind in ("refined", "error")}  # fmt: skip
        return {**none, "refined": str(caught)}
    metrics = {}
    for figure, estimate in zip(scene.metrics, found, strict=True):
        metrics[f"{figure.name}_refined_{figure.unit}"] = estimate.refined
        metrics[f"{figure.name}_error_{figure.unit}"] = estimate.error
    return metrics
