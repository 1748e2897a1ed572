"""Scene of a skin under pressure whose pattern is designed: the tables that all of them have."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from toros_fem.base.errors import ParameterError
from toros_fem.base.scene import Scene
from toros_fem.base.validation import require_between
from toros_fem.design.lines.options import LineOptions
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.design.relaxed.find import RelaxedOptions
from toros_fem.products.tables.loads import Pressing, Results
from toros_fem.products.tables.sheets import SkinSheets
from toros_fem.products.tables.steps import Designing, Lines, Printer

# Lengths that follow the mesh.
MESH_LENGTHS = ("edge_length", "filter_radius", "line_width", "gap_width")
# Filter radius of the meshes of relaxed designs and prints, over the edge length.
FILTER_EDGES = 2.0
# The same of densities that start from printable lines: it must be below the width of these.
DENSITY_FILTER_EDGES = 1.5


@dataclass(frozen=True)
class ActuatorScene(Scene):
    """Materials, pressure, the steps of each part of the design, and its printer.

    Raises:
        ParameterError: There are so many levels that the coarsest mesh is too coarse; or with a
            relaxed design, lines are thinner than the printer makes them, there are several starts,
            or a tolerance of widths without densities.
    """

    material: SkinSheets = SkinSheets()
    pressure: Pressing = Pressing()
    design: Designing = Designing()
    lines: Lines = Lines()
    print: Printer = Printer()
    results: Results = Results()

    def __post_init__(self) -> None:
        super().__post_init__()
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
            if self.design.width_tolerance is not None and not self.lines.density_iterations:
                raise ParameterError(
                    f"width_tolerance = {self.design.width_tolerance} m would not count: lines "
                    "that are laid have their widths given. Set density_iterations, or "
                    "start = 'random'.",
                    "width_tolerance",
                )

    # Field that holds the target of a metric, by the metric's key.
    TARGETS: ClassVar[Mapping[str, str]] = {}

    def asked(self, targets: Mapping[str, float]) -> Self:
        """Return the scene of other targets.

        Args:
            targets: Target of some metrics, by their keys.

        Raises:
            ParameterError: No field holds the target of a metric, or its value is out of bounds.
        """
        for metric in targets:
            if metric not in self.TARGETS:
                known = ", ".join(self.TARGETS) or "none"
                raise ParameterError(f"no field holds the target of {metric!r}; known are {known}.")
        return self.updated(**{self.TARGETS[metric]: value for metric, value in targets.items()})

    @property
    def coarsest_edge(self) -> float | None:
        """Longest edge length in m of a useful mesh; None: the mesh is given, at one level only."""
        return None

    @property
    def level_count(self) -> int:
        """Number of meshes."""
        return self._most_levels if self.design.levels is None else self.design.levels

    @property
    def _most_levels(self) -> int:
        bound = self.coarsest_edge
        if bound is None:
            return 1
        edge: float = self.value("edge_length")
        return 1 + max(0, int(np.floor(np.log2(bound / edge))))

    def at_level(self, level: int) -> Self:
        """Return the scene of one mesh alone.

        All lengths of mesh and filter are those of the finest one, doubled for each level before.

        Args:
            level: Number of the mesh, from 0, the coarsest.

        Raises:
            ParameterError: There is no such level.
        """
        require_between(0, self.level_count - 1, level=level)
        factor = 2.0 ** (self.level_count - 1 - level)
        lengths = {name: self.value(name) for name in MESH_LENGTHS if name in self.described()}
        scaled = {name: factor * h for name, h in lengths.items() if h is not None}
        return self.updated(levels=1, **scaled)

    @property
    def of_relaxed(self) -> Self:
        """The scene of the relaxed design, on its mesh."""
        return self._on_one_mesh(self.lines.relaxed_edge_length)

    @property
    def of_print(self) -> Self:
        """The scene of the mesh that printed lines are simulated on."""
        return self._on_one_mesh(self.lines.print_edge_length)

    @property
    def of_densities(self) -> Self:
        """The scene of the densities that start from printable lines."""
        return self.of_print.updated(
            width_tolerance=self.design.width_tolerance,
            filter_radius=DENSITY_FILTER_EDGES * self.lines.print_edge_length,
            constrained_iterations=self.lines.density_iterations,
            perimeter_weight=self.design.perimeter_weight,
        )

    @property
    def density_options(self) -> DesignOptions:
        """Options of the design loop for densities that start from printable lines."""
        return self.design.options_of(Stage(self.lines.density_iterations, constrained=True))

    def _on_one_mesh(self, edge: float) -> Self:
        """Return the scene on a mesh of its own, without widths and perimeter.

        Where the mesh is given it stays.
        """
        lengths = {"edge_length": edge} if "edge_length" in self.described() else {}
        return self.updated(
            levels=1,
            filter_radius=FILTER_EDGES * edge,
            line_width=None,
            gap_width=None,
            constrained_iterations=0,
            perimeter_weight=None,
            width_tolerance=None,
            **lengths,
        )

    def require_symmetric_knit(self, planes: tuple[int, ...]) -> None:
        """Check that a knit has the mirrored grain where the skin is cut at symmetry planes.

        Raises:
            ParameterError: It has not.
        """
        sheets = self.material
        if planes and sheets.knit_ratio is not None and sheets.grain_angle % 90:
            raise ParameterError(
                f"grain_angle = {sheets.grain_angle} deg is not symmetric: the other part would "
                "have the mirrored grain. Set 0 or 90, or design the whole skin.",
                "grain_angle",
            )

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
            ParameterError: A width is under `print_width`, or under the edge length of the print.
        """
        if self.lines.print_edge_length > min(self.laid_widths):
            raise ParameterError(
                f"print_edge_length = {self.lines.print_edge_length} m is over "
                f"{min(self.laid_widths)} m, the width of the lines: their print cannot be "
                "simulated. Give shorter edges.",
                "print_edge_length",
            )
        return LineOptions(widths=self.laid_widths, print_width=self.print.print_width)
