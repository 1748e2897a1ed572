"""Scene of a skin under pressure whose pattern is designed: the tables that all of them have."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import Key, Positive, Table, Text, key, nearest
from toros_fem.base.scene import NO_TABLE, Scene
from toros_fem.base.validation import Floats
from toros_fem.design.density.length_scale import LengthScale
from toros_fem.design.lines.field import LineOptions
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.design.loop.problem import Evaluation
from toros_fem.design.loop.shape_design import Regularisation, ShapeDesign
from toros_fem.design.relaxed.find import RelaxedOptions
from toros_fem.making.cleaning import require_island_area
from toros_fem.measures.figures import Figure
from toros_fem.measures.metrics import Measurement
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.readings.bare_tube import tube_pressure
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes.pattern import Pattern
from toros_fem.products.actuators.cost import Cost, actuator_cost
from toros_fem.products.actuators.designer import Designer
from toros_fem.products.actuators.estimates import COARSER, OnOtherMesh
from toros_fem.products.actuators.result import SkinDesign, TrialResult
from toros_fem.products.actuators.simulate import FILES, SimulationResult, simulate_actuator
from toros_fem.products.common.plausibility import Group, Inflated, with_lengths
from toros_fem.products.common.tables import (
    DesignTable,
    LineTable,
    PressureTable,
    PrinterTable,
    ResultTable,
    SkinSheets,
)
from toros_fem.results.reporter import DesignReporter, print_step
from toros_fem.results.runs.open_run import journal_of

SOURCE = {
    "start_from": "output folder of a design, whose print the densities start from; none: `start`"
}
# Keys of distances about as small as the sheets are thick.
LAYERS = ("print_height", "print_offset", "contact_distance")
# Strain of the bare skin over what its target needs: at the pressure that a design starts from, and
# at the least that it may take (docs/optimisation.md).
START_STRAIN, LEAST_STRAIN = 1.3, 1.1
# Where a design starts from more: this strain at most.
MOST_START_STRAIN = 0.4
# The least pressure over the given one, where that strain is not known, and at most.
LEAST_PRESSURE, ROOM = 0.1, 0.9
# Filter radius of the meshes of relaxed designs and prints, over the edge length.
FILTER_EDGES = 2.0
# Seeds that the final variant of a scene tries at most.
SEEDS = 3
# The same of densities that start from printable lines: it must be below the width of these.
DENSITY_FILTER_EDGES = 1.5


@dataclass(frozen=True)
class Level:
    """A mesh of a scene, and the regularisation of densities on it.

    Attributes:
        edge_length: In m; None where the mesh is given.
        regularisation: Filter, projection, widths and perimeter.
        refinements: How often each triangle of a given mesh is divided into four.
    """

    edge_length: float | None
    regularisation: Regularisation
    refinements: int = 0

    def scaled(self, factor: float) -> Level:
        """Return a mesh with longer edges; those of a given mesh grow by powers of 2."""
        edge = self.edge_length
        return Level(
            None if edge is None else factor * edge,
            self.regularisation.scaled(factor),
            self.refinements if edge is not None else self.refinements - round(np.log2(factor)),
        )


class DesignScene(Scene):
    """A skin that is designed for a shape: its meshes, the options on each, its trial.

    Raises:
        ParameterError: There are so many levels that the coarsest mesh is too coarse; or with a
            relaxed design, lines are thinner than the printer makes them, there are several starts,
            or a tolerance of widths without densities.
    """

    design: DesignTable = DesignTable()
    lines: LineTable = LineTable()
    print: PrinterTable = PrinterTable()
    results: ResultTable = ResultTable()

    DESIGN_FILES: ClassVar[Mapping[str, str]] = SOURCE
    # Measured values of the metrics, which are drawn beside the curves.
    MEASURED: ClassVar[tuple[Measurement, ...]] = ()
    # Edge length of the mesh on which a trial is repeated, over that of the print's mesh.
    TRIAL_MESH: ClassVar[float] = COARSER

    def __post_init__(self) -> None:
        most = self._most_levels
        if self.design.levels is not None and self.design.levels > most:
            bound = self.coarsest_edge
            reason = (
                "the mesh is given, and not made from an edge length"
                if bound is None
                else f"edges of more than {bound:.3g} m are too long for its size"
            )
            raise ParameterError(
                f"levels = {self.design.levels} is too many: {reason}. At most {most} are "
                "possible; levels = None takes them.",
                "levels",
            )
        if self.design.start == "relaxed":
            if self.design.starts > 1:
                raise ParameterError(
                    f"starts = {self.design.starts}, but a relaxed design has one start. Set "
                    "starts = 1 and try several seeds, or start = 'random'.",
                    "starts",
                )
            _ = self.line_options  # wrong widths are told before the design, not after it

    @property
    def edge_length(self) -> float | None:
        """Edge length in m of the finest mesh of densities; None where the mesh is given."""
        edge: float | None = (
            self.value("edge_length") if "edge_length" in self.described() else None
        )
        return edge

    @property
    def edges(self) -> Mapping[str, float]:
        """Edge lengths in m of the finest meshes of the design, by key; none of a given mesh."""
        if self.edge_length is None:
            return {}
        relaxed = ("relaxed_edge_length", "print_edge_length")
        used = relaxed if self.design.start == "relaxed" else ("edge_length",)
        return {key: self.value(key) for key in used}

    @property
    def coarsest_edge(self) -> float | None:
        """Longest edge length in m of a useful mesh; None: the mesh is given, at one level only."""
        return None

    @property
    def level_count(self) -> int:
        """Number of meshes of a design of densities."""
        return self._most_levels if self.design.levels is None else self.design.levels

    @property
    def _most_levels(self) -> int:
        bound, edge = self.coarsest_edge, self.edge_length
        if bound is None or edge is None:
            return 1
        return 1 + max(0, int(np.floor(np.log2(bound / edge))))

    @property
    def finest_level(self) -> Level:
        """The finest mesh of a design of densities."""
        return Level(self.edge_length, self.design.regularisation)

    @property
    def levels(self) -> tuple[Level, ...]:
        """The meshes of a design of densities, the coarsest first: all lengths halve each time."""
        return tuple(self.finest_level.scaled(2.0**k) for k in reversed(range(self.level_count)))

    @property
    def relaxed_level(self) -> Level:
        """The mesh of the relaxed design."""
        return self._of_lines(self.lines.relaxed_edge_length)

    @property
    def print_level(self) -> Level:
        """The mesh that printed lines are simulated on."""
        return self._of_lines(self.lines.print_edge_length)

    @property
    def level_of_print(self) -> Level:
        """The mesh that prints of this scene follow their borders from."""
        lines = self.design.start == "relaxed"
        return self.print_level if lines else self.finest_level

    @property
    def density_level(self) -> Level:
        """The mesh of the densities that start from printable lines."""
        level = self.print_level
        radius = DENSITY_FILTER_EDGES / FILTER_EDGES * level.regularisation.filter_radius
        design = replace(self.design, filter_radius=radius)
        widths = LengthScale() if self.lines.density_iterations else None
        return replace(level, regularisation=replace(design.regularisation, length_scale=widths))

    def coarser(self, level: Level) -> tuple[float, Level]:
        """Return how much longer the edges of a mesh to compare with are, and that mesh.

        Raises:
            ParameterError: There is none.
        """
        return COARSER, level.scaled(COARSER)

    def finer(self, level: Level, refinement: float) -> tuple[float, Level]:
        """Return a mesh with edges so many times shorter, and their length over those of this."""
        return 1 / refinement, level.scaled(1 / refinement)

    def checked(self, level: Level) -> tuple[float, Level] | None:
        """Return the finer mesh whose figures are told, as of `finer`; None without one."""
        wanted, refinement = self.results.estimate_error, self.results.check_refinement
        return None if refinement is None or not wanted else self.finer(level, refinement)

    def from_print(self) -> Self:
        """Return the scene whose densities start from a given print, with steps for them."""
        if self.design.start == "relaxed" and not self.lines.density_iterations:
            return self.updated(density_iterations=self.design.level_iterations)
        return self

    @property
    def density_options(self) -> DesignOptions:
        """Options of the design loop for densities that start from printable lines."""
        return self.design.options_of(Stage(self.lines.density_iterations, constrained=True))

    def _of_lines(self, edge: float) -> Level:
        """Return a mesh without widths, perimeter and tolerance."""
        design = replace(self.design, filter_radius=FILTER_EDGES * edge)
        return Level(edge, design.regularisation.plain)

    @property
    def print_options(self) -> DesignOptions:
        """Options of the design loop for densities that start from a given print."""
        lines = self.design.start == "relaxed"
        return self.density_options if lines else self.design.finer_options

    @property
    def laid_widths(self) -> tuple[float, float]:
        """Width in m of the lines along either family."""
        return self.lines.widths

    @property
    def options(self) -> tuple[DesignOptions, ...]:
        """Options of the design loop on each mesh, the coarsest first."""
        finer = [self.design.finer_options] * (self.level_count - 1)
        return (self.design.first_options, *finer)

    @property
    def relaxed_options(self) -> RelaxedOptions:
        """Numbers of the relaxed design."""
        lines = self.lines
        return RelaxedOptions(
            directions=lines.directions,
            share_limit=lines.share_limit,
            radius=lines.smoothing_radius,
            share_weight=lines.share_weight,
            iterations=(lines.relaxed_iterations, lines.relaxed_iterations),
            width_ratio=self.laid_widths[1] / self.laid_widths[0],
        )

    @property
    def line_options(self) -> LineOptions:
        """Widths and limits of the lines that are laid.

        Raises:
            ParameterError: A width is under `print_width`.
        """
        least, width = self.print.print_width, min(self.laid_widths)
        if width < least:
            raise ParameterError(
                f"print_width = {least} m is over {width} m, the width of the lines that are laid "
                "(`laid_width` and its like). Ask for wider lines.",
                "print_width",
            )
        return LineOptions(
            widths=self.laid_widths,
            print_width=self.print.print_width,
            least_share=self.lines.least_share,
            spread=self.lines.spread,
        )

    def final(self) -> Self:
        """Return the variant to trust: a finer mesh tells the figures, and of seeds the best."""
        checked = self.results.check_refinement or COARSER
        most = max(SEEDS, self.design.seeds)
        return self.updated(check_refinement=checked, estimate_error=True, seeds=most)

    def targets(self) -> Mapping[str, str]:
        """Return the key that holds the target of a metric, by the metric's key."""
        return {one.metric_key: name for name, one in self.described().items() if one.metric_key}

    def asked(self, targets: Mapping[str, float]) -> Self:
        """Return the scene of other targets of some metrics, by the keys of these.

        Raises:
            ParameterError: A value is out of bounds.
        """
        keys = self.targets()
        return self.updated(**{keys[metric]: value for metric, value in targets.items()})

    def run_design(
        self,
        comm: MPI.Comm,
        output: Path | str,
        files: Mapping[str, Path] | None = None,
        *,
        reporter: DesignReporter | None = None,
        verbose: bool = False,
    ) -> SkinDesign:
        """Design the pattern and write all results (collective).

        The design goes from coarse to fine over the levels of the scene. On each, free islands of
        the printed pattern are connected to the rest or removed, and the design is continued for
        `polish_iterations` steps. With several starts the best one takes the place of the first
        level; its islands are left to the next. The design is asked again for what its print
        misses, `corrections` times at most.

        With `start` = "relaxed" line families are designed and laid as lines instead, by
        `discover`, and densities come last.

        Args:
            output: Folder for summary, history, pattern, fields and pictures.
            files: Paths, by the names in `DESIGN_FILES`. The print of "start_from" may be of
                another size, target or pressure. None for none.
            reporter: Reports the progress; None makes one for `output`. One that is made earlier
                also counts the time of the set-up.
            verbose: Whether to print every Newton step.

        Raises:
            TorosError: A number is out of its bounds, the start has no equilibrium, the folder
                cannot be written to, or a file does not fit.
        """
        given = files or {}
        scene = self.of_first_rank(comm).with_files(comm, given)
        source = given.get("start_from")
        scene.require_trial()
        designer = Designer(
            comm=comm,
            scene=scene if source is None else scene.from_print(),
            output=output,
            reporter=reporter or DesignReporter(comm, output),
            journal=journal_of(output),
            source=source,
            verbose=verbose,
        )
        return designer.design()

    def require_trial(self) -> None:
        """Check that `trial` has what it needs: this is told before the design, not after it."""

    @property
    def trial_size(self) -> tuple[int, float]:
        """Equilibria of its trial in contact, and their triangles over those of the design."""
        return 0, 1.0

    def trial(
        self,
        comm: MPI.Comm,
        output: Path,
        made: SkinDesign,
        other: OnOtherMesh | None = None,
    ) -> TrialResult | None:
        """Simulate what the print is for, beyond its curve, and write the files of this.

        `other` simulates the print on another mesh, where the trial is repeated for the intervals
        of its figures; None leaves these out.
        """
        return None

    def trial_figures(self, comm: MPI.Comm, made: Evaluation[Equilibrium]) -> tuple[Figure, ...]:
        """Return the figures of `trial` of a print that was simulated (collective)."""
        return ()

    def expected_cost(self, comm: MPI.Comm, *, from_print: bool = False) -> Cost:
        """Return the cost of a design with its files, by `actuator_cost` (collective)."""
        return actuator_cost(comm, self, from_print=from_print)

    def case(self, comm: MPI.Comm, level: Level) -> Case:
        """Return skin, loads and target of the first pose on the mesh of a level (collective).

        Raises:
            TorosError: Numbers do not fit each other.
        """
        raise NotImplementedError(f"{type(self).__name__} has no case.")

    def case_of_poses(self, comm: MPI.Comm, level: Level) -> Case:
        """Return the case of the first pose with those of all further ones (collective)."""
        return self.case(comm, level)

    @property
    def scenes_of_poses(self) -> Sequence[Self]:
        """The scene of each further pose."""
        return ()

    @property
    def holds_pressure(self) -> bool:
        """Whether no pressure is changed for a print, if there are several poses."""
        return True

    def require_possible(self, pattern: Pattern) -> None:
        """Check numbers of the design on a skin that do not need its own mesh.

        Raises:
            ParameterError: A radius, a width or an area does not fit the skin or each other.
        """
        require_island_area(pattern, self.print.island_area)
        levels = self.levels
        if self.design.start == "relaxed":
            levels = (self.density_level,) if self.lines.density_iterations else ()
        for level in levels:
            level.regularisation.require_possible(pattern.size)

    def problem(
        self, comm: MPI.Comm, case: Case, level: Level, *, verbose: bool = False
    ) -> ShapeDesign:
        """Return the design problem of a case on the mesh of a level (collective).

        Raises:
            TorosError: A number is out of its bounds, or does not fit the case.
        """
        require_island_area(case.pattern, self.print.island_area)
        log = print_step(comm) if verbose else None
        return ShapeDesign(comm, case, level.regularisation, log=log)


class Pose(Table):
    """A further pose of the same skin, with what differs from the scene's."""

    name: Text | None = key(None, "name of the pose; none takes its number: pose_2 and so on")
    importance: Positive = key(1.0, "weight of the pose in the objective; the first pose has 1")

    def __post_init__(self) -> None:
        if self.name is not None and not self.name.isidentifier():
            raise ParameterError(
                f"name = {self.name!r} must be an identifier, since names of figures begin with "
                "it. Use letters, digits and underscores.",
                "name",
            )


def _without_block(case: Case) -> Case:
    """Return the case of a first pose, whose panels are free."""
    if case.blocked is not None:
        raise ParameterError(
            "blocked_angle is given to the first pose, whose shape is designed. Write it in a "
            "table [[pose]].",
            "blocked_angle",
        )
    return case


class ActuatorScene(DesignScene):
    """A kind of scenes: a skin of sheets under a pressure, its size and its quick variant."""

    material: SkinSheets = SkinSheets()
    pressure: PressureTable = PressureTable()
    # Values of each further pose by key.
    poses: tuple[Mapping[str, Any], ...] = field(default=(), metadata=NO_TABLE)

    SIMULATION_FILES: ClassVar[Mapping[str, str]] = FILES
    START_STRAIN: ClassVar[float] = START_STRAIN
    POSE_TABLES: ClassVar[tuple[str, ...]] = ("target", "object", "pressure", "load", "contact")

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.poses:
            return
        if self.design.start == "relaxed":
            raise ParameterError(
                "start = 'relaxed' lays lines for one pose, and there are further ones. Set start "
                "= 'random'.",
                "start",
            )
        names = [self._of_pose(values)[1].name for values in self.poses]
        twice = next((name for name in names if name and names.count(name) > 1), None)
        if twice is not None:
            raise ParameterError(
                f"name = {twice!r} is that of two poses: figures of one would overwrite those of "
                "the other. Give each its own.",
                "name",
            )

    @classmethod
    def pose_keys(cls) -> dict[str, Key]:
        """Return the keys that a further pose may have, by name."""
        tables = cls.tables()
        keys = [tables[name].described() for name in cls.POSE_TABLES if name in tables]
        found = {name: one for of in (Pose.described(), *keys) for name, one in of.items()}
        found.pop("hold_pressure", None)  # pressures of poses are
        return found

    def as_dict(self) -> dict[str, Any]:
        """Return all values by the names of their keys, with those of further poses."""
        poses = {"poses": [dict(values) for values in self.poses]} if self.poses else {}
        return {**super().as_dict(), **poses}

    def _of_pose(self, values: Mapping[str, Any]) -> tuple[Self, Pose]:
        """Return the scene of one pose, whose pressure is held, and its name and weight.

        Raises:
            ParameterError: A key is unknown or does not belong to a pose, or a value is wrong.
        """
        known, own = self.pose_keys(), Pose.described()
        for name in values:
            if name not in known:
                raise ParameterError(
                    f"unknown key {name!r} of a pose; {nearest(name, known)}", name
                )
        given = {name: value for name, value in values.items() if name not in own}
        pose = Pose(**{name: value for name, value in values.items() if name in own})
        return replace(self, poses=()).updated(hold_pressure=True, **given), pose

    def case_of_poses(self, comm: MPI.Comm, level: Level) -> Case:
        """Return the case of the first pose with those of all further ones (collective)."""
        if not self.poses:
            return _without_block(self.case(comm, level))
        scenes = [self._of_pose(values) for values in ({}, *self.poses)]
        first, *others = (scene.case(comm, level) for scene, _ in scenes)
        _without_block(first)
        poses = [
            replace(other, pattern=first.pattern, name=pose.name, importance=pose.importance)
            for other, (_, pose) in zip(others, scenes[1:], strict=True)
        ]
        return replace(first, poses=poses)

    @property
    def scenes_of_poses(self) -> Sequence[Self]:
        """The scene of each further pose."""
        return [self._of_pose(values)[0] for values in self.poses]

    @property
    def holds_pressure(self) -> bool:
        """Whether no pressure is changed for a print, if there are several poses."""
        return self.pressure.hold_pressure

    def coarse(self) -> Self:
        """Return the quick variant: a mesh less, or one with longer edges that are still useful."""
        values, bound, edge = self.coarse_values(), self.coarsest_edge, self.edge_length
        if self.design.levels is not None:
            values["levels"] = max(1, self.design.levels - 1)
        if bound is not None and edge is not None:
            most = max(1.0, bound / edge)
            for key in self.COARSE.keys() & {"edge_length", "filter_radius"}:
                values[key] = round(self.value(key) * min(most, self.COARSE[key]), 9)
        return self.updated(**values)

    @property
    def radius(self) -> float | None:
        """Radius in m of the inflated skin where it is thinnest; None if it is not known."""
        return None

    @property
    def inflated(self) -> Inflated | None:
        """The skin under its largest pressure; None if its radius is not known."""
        if self.radius is None:
            return None
        return Inflated(self.material.composite, self.pressure.pressure, self.radius)

    @property
    def needed_strain(self) -> float | None:
        """Largest strain of the fabric that the target needs; None if it is not known."""
        return None

    @property
    def pressures(self) -> tuple[float, tuple[float, float] | None]:
        """Pressure in Pa that a design starts from, and its bounds; None where it is held.

        At both the bare skin has more strain than the target needs: a pattern of thin lines that
        just holds the fabric at the least pressure would be lost once lines must be printable.
        """
        most, radius, strain = self.pressure.pressure, self.radius, self.needed_strain
        if self.pressure.hold_pressure or most == 0:
            return most, None
        if radius is None or not strain:
            return most, (LEAST_PRESSURE * most, most)
        sheet = self.material.composite
        begin = max(START_STRAIN, min(self.START_STRAIN, MOST_START_STRAIN / strain))
        start, least = (
            tube_pressure(sheet, radius, factor * strain) for factor in (begin, LEAST_STRAIN)
        )
        return min(most, start), (min(ROOM * most, least), most)

    def groups(self) -> Iterator[Group]:
        """Yield the dimensionless groups of the scene that are known."""
        skin = self.inflated
        return iter(()) if skin is None else with_lengths(self, skin.girth, self.groups_of(skin))

    def groups_of(self, skin: Inflated) -> Iterator[Group]:
        """Yield the dimensionless groups of the scene, and of the target that a skin is to take."""
        design, curve = self.design, self.results.curve_pressure
        yield from skin.groups()
        if curve is not None:
            yield skin.load("curve_pressure", curve)
        for name, edge in self.edges.items():
            if name != "relaxed_edge_length":  # lines are laid on a finer mesh
                yield Group("edges", name, skin.girth / edge)
        for name in LAYERS:
            if name in self.described() and (thickness := self.value(name)) is not None:
                yield Group("thickness", name, thickness / skin.radius)
        widths: dict[str, float | None] = {"print_width": self.print.print_width}
        if design.constrained_iterations:
            widths |= {"line_width": design.line_width, "gap_width": design.gap_width}
        if design.start == "relaxed":
            widths["laid_width"] = max(self.laid_widths)
        elif self.edge_length is not None:
            widths["filter_radius"] = radius = self.finest_level.regularisation.filter_radius
            yield Group("filter", "filter_radius", radius / self.edge_length)
        yield from (skin.width(name, width) for name, width in widths.items() if width is not None)

    def run_simulation(
        self,
        comm: MPI.Comm,
        output: Path | str,
        files: Mapping[str, Path] | None = None,
        *,
        verbose: bool = False,
    ) -> SimulationResult:
        """Inflate the plain skin, or a given print, and write all results (collective).

        The pressure rises to that of the scene in `curve_steps` equal steps, on the finest of its
        meshes. Where it cannot be followed to its end, the summary's "failure" says why.

        Args:
            output: Folder for curve, fields and pictures.
            files: Paths, by the names in `SIMULATION_FILES`. The "pattern" is the output folder of
                a design, or the pattern file in it. On the mesh of that design the simulation is
                that of its print. A mesh of the scene follows the polygons of a folder; of a file
                alone, a triangle of another mesh is printed where at least half of it is. Without,
                only what is always printed is.
            verbose: Whether to print every Newton step.

        Raises:
            ParameterError: The pressure is 0, or a number is out of its bounds.
            FileError: The pattern cannot be read.
            PanelError: It is that of another skin.
            EquilibriumError: There is no equilibrium at the first pressure.
        """
        given = files or {}
        scene = self.of_first_rank(comm).with_files(comm, given)
        return simulate_actuator(comm, scene, output, given.get("pattern"), verbose=verbose)

    def loaded(
        self,
        pattern: Pattern,
        target: Floats,
        supports: Supports,
        planes: tuple[int, ...] = (),
    ) -> Case:
        """Return a case of the scene's sheets under its pressure, on a part cut at planes.

        Raises:
            ParameterError: The knit is not symmetric about the planes.
        """
        self.material.require_symmetric(planes)
        start, bounds = self.pressures
        return Case(
            pattern,
            target,
            supports,
            start,
            bounds,
            composite=self.material.composite,
            symmetry=planes,
        )
