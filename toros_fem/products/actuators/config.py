"""Configurations that all skins under pressure have in common."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Annotated, ClassVar, Self

import numpy as np

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import (
    Angle,
    Count,
    Distance,
    Factor,
    Fraction,
    In,
    Length,
    Modulus,
    Number,
    OneOf,
    Positive,
    Pressure,
    Table,
    key,
)
from toros_fem.base.validation import require_between
from toros_fem.design.density.length_scale import LengthScale
from toros_fem.design.loop.config import DesignConfig, MaterialConfig
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.design.loop.robust import SPREAD_WEIGHT, WidthTolerance
from toros_fem.design.mma.optimizer import MMAOptions
from toros_fem.design.relaxed.start_config import StartConfig
from toros_fem.making.print.printability import PrintLimits
from toros_fem.materials.sheet import (
    CURVATURES,
    PRINT_SIDES,
    SEAMS,
    WRINKLINGS,
    Bending,
    Bladder,
    Composite,
    Knit,
    Membrane,
)


@dataclass(frozen=True)
class SkinConfig(MaterialConfig):
    """Bending and wrinkling of the sheets, side of the print, seams, bladder, knit; SI units."""

    bladder_young: Modulus = key(
        0.29e6, "Young's modulus of a rubber bladder that moves with the skin"
    )
    bladder_thickness: Length | None = key(None, "thickness of the bladder; none leaves it out")
    bending: Annotated[str, OneOf(CURVATURES)] | None = key(
        Bending.curvature, "curvature term of the sheet; none for a membrane"
    )
    seams: Annotated[str, OneOf(SEAMS)] = key(Bending.seams, "how seams carry moments")
    wrinkling: Annotated[str, OneOf(WRINKLINGS)] | None = key(
        None, "fine wrinkles, which carry no compression; none leaves wrinkles to the mesh"
    )
    print_side: Annotated[str, OneOf(PRINT_SIDES)] | None = key(
        None,
        "face of the fabric that carries the print, seen from the pressure; none takes the print "
        "in the fabric's middle",
    )
    print_offset: Length | None = key(
        None,
        "distance from the middle of the fabric to that of the print on its face; none takes the "
        "mean of both thicknesses",
    )
    knit_ratio: Annotated[float, In(at_least=1)] | None = key(
        None,
        "modulus of the fabric along its courses over that along its wales; none for an isotropic "
        "fabric",
    )
    grain_angle: Angle = key(
        0.0,
        "angle of the courses from the first axis of the flat panels; on a tube 0 is around and 90 "
        "along it",
    )

    @property
    def composite(self) -> Composite:
        """Fabric and reinforcement, with bending, wrinkling, the bladder and the knit."""
        thickness, ratio = self.bladder_thickness, self.knit_ratio
        return replace(
            super().composite,
            bending=None if self.bending is None else Bending(self.bending, self.seams),
            membrane=Membrane(self.wrinkling),
            print_side=self.print_side,
            print_offset=self.print_offset,
            bladder=None if thickness is None else Bladder(self.bladder_young, thickness),
            knit=None if ratio is None else Knit(ratio, float(np.radians(self.grain_angle))),
        )


@dataclass(frozen=True)
class TipWeights(Table):
    """Weights of the tip in the objective; SI units."""

    tip_weight: Factor = key(1.0, "weight of the tip's position over that of all the rest")
    orientation_length: Distance = key(
        0.03, "a tip turned by 0.1 rad costs as much as a skin displaced by a tenth of this length"
    )


# Lengths that follow the mesh.
MESH_LENGTHS = ("edge_length", "filter_radius", "line_width", "gap_width")
# Filter radius of the meshes of relaxed designs and prints, over the edge length.
FILTER_EDGES = 2.0
# The same of densities that start from printable lines: it must be below the width of these.
DENSITY_FILTER_EDGES = 1.5
# Largest change of a pressure in one step on the finer meshes, as `DesignOptions.pressure_move`:
# with five times as much the first step triples T, and the next ones win this back.
LEVEL_PRESSURE_MOVE = 0.02


@dataclass(frozen=True)
class ActuatorConfig(StartConfig, SkinConfig, DesignConfig):
    """Pressure, meshes, and the steps of each part of the design; SI units.

    Raises:
        ParameterError: A value has another type, or is outside its bounds; there are so many
            levels that the coarsest mesh is too coarse; or with a relaxed design, lines are thinner
            than the printer makes them, there are several starts, or a tolerance of widths without
            densities.
    """

    pressure: Pressure = key(5e3, "pressure, the first guess where it is designed")
    design_pressure: bool = key(False, "design the pressure too, within its bounds")
    pressure_min: Modulus = key(1e3, "least pressure where it is designed")
    pressure_max: Modulus = key(20e3, "largest pressure where it is designed")
    levels: Count | None = key(
        None,
        "number of meshes, from coarse to fine: edges and filter radius halve from each to the "
        "next; none takes as many as the size allows",
    )
    starts: Count = key(
        1,
        "number of random starts on the coarsest mesh, shared out over the ranks; the best goes on",
    )
    level_iterations: Count = key(
        10, "steps on each mesh but the coarsest, with the width constraints"
    )
    level_move_limit: Fraction = key(
        0.05, "largest change of a density in one step on these meshes"
    )
    iterations: Count = key(60, "steps on the coarsest mesh before the width constraints act")
    constrained_iterations: Number = key(
        40, "further steps there with the width constraints; 0 leaves them out"
    )
    min_decrease: Fraction | None = key(
        0.05,
        "a stage ends when the objective falls by a smaller fraction in ten steps; none leaves "
        "this rule out",
    )
    polish_iterations: Number = key(
        20, "steps on a mesh after all free islands are removed or connected; 0 leaves them"
    )
    width_tolerance: Length | None = key(
        None,
        "difference of printed widths from the drawn ones, either way, that the design is made "
        "robust against: each border moves by half of it; none leaves this out",
    )
    spread_weight: Positive = key(
        SPREAD_WEIGHT,
        "weight of the spread over these widths in the objective, where there is a tolerance",
    )
    estimate_error: bool = key(
        True, "estimate the discretisation error of the metrics on a refined mesh"
    )
    curve_pressure: Modulus | None = key(
        20e3,
        "largest pressure up to which the metrics of the print are followed; none leaves this "
        "curve out",
    )
    curve_steps: Count = key(10, "number of equal steps of the curve from 0 to that pressure")

    def __post_init__(self) -> None:
        super().__post_init__()
        most = self._most_levels
        if self.levels is not None and self.levels > most:
            bound = self.coarsest_edge
            reason = (
                "the mesh is given, and not made from an edge length"
                if bound is None
                else f"edges of more than {bound:.3g} m are too long for its size"
            )
            raise ParameterError(
                f"levels = {self.levels} is too many: {reason}. At most {most} are possible; "
                "levels = None takes them.",
                "levels",
            )
        if self.start == "relaxed":
            if self.starts > 1:
                raise ParameterError(
                    f"starts = {self.starts}, but a relaxed design has one start. Set starts = 1 "
                    "and try several seeds, or start = 'random'.",
                    "starts",
                )
            _ = self.line_options  # wrong widths are told before the design, not after it
            if self.width_tolerance is not None and not self.density_iterations:
                raise ParameterError(
                    f"width_tolerance = {self.width_tolerance} m would not count: lines that are "
                    "laid have their widths given. Set density_iterations, or start = 'random'.",
                    "width_tolerance",
                )

    # Field that holds the target of a metric, by the metric's key.
    TARGETS: ClassVar[Mapping[str, str]] = {}

    def asked(self, targets: Mapping[str, float]) -> Self:
        """Return the configuration of other targets.

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
        return self._most_levels if self.levels is None else self.levels

    @property
    def _most_levels(self) -> int:
        bound = self.coarsest_edge
        if bound is None:
            return 1
        edge: float = self.edge_length  # type: ignore[attr-defined]
        return 1 + max(0, int(np.floor(np.log2(bound / edge))))

    def at_level(self, level: int) -> Self:
        """Return the configuration of one mesh alone.

        All lengths of mesh and filter are those of the finest one, doubled for each level before.

        Args:
            level: Number of the mesh, from 0, the coarsest.

        Raises:
            ParameterError: There is no such level.
        """
        require_between(0, self.level_count - 1, level=level)
        factor = 2.0 ** (self.level_count - 1 - level)
        lengths = {name: getattr(self, name) for name in MESH_LENGTHS if name in self._names}
        scaled = {name: factor * h for name, h in lengths.items() if h is not None}
        return self.updated(levels=1, **scaled)

    @property
    def of_relaxed(self) -> Self:
        """The configuration of the relaxed design, on its mesh."""
        return self._on_one_mesh(self.relaxed_edge_length)

    @property
    def of_print(self) -> Self:
        """The configuration of the mesh that printed lines are simulated on."""
        return self._on_one_mesh(self.print_edge_length)

    @property
    def of_densities(self) -> Self:
        """The configuration of the densities that start from printable lines."""
        return self.of_print.updated(
            width_tolerance=self.width_tolerance,
            filter_radius=DENSITY_FILTER_EDGES * self.print_edge_length,
            constrained_iterations=self.density_iterations,
            perimeter_weight=self.perimeter_weight,
        )

    @property
    def density_options(self) -> DesignOptions:
        """Options of the design loop for densities that start from printable lines."""
        return DesignOptions(
            (Stage(self.density_iterations, constrained=True),),
            min_relative_decrease=self.min_decrease,
            pressure_move=LEVEL_PRESSURE_MOVE,
            mma=MMAOptions(move=self.level_move_limit),
        )

    def _on_one_mesh(self, edge: float) -> Self:
        """Return the configuration on a mesh of its own, without widths and perimeter.

        Where the mesh is given it stays.
        """
        lengths = {"edge_length": edge} if "edge_length" in self._names else {}
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

    @property
    def _names(self) -> set[str]:
        return {field.name for field in fields(self)}

    @property
    def pressure_bounds(self) -> tuple[float, float] | None:
        """Bounds on the pressure in Pa; None if it is prescribed."""
        return (self.pressure_min, self.pressure_max) if self.design_pressure else None

    @property
    def length_scale(self) -> LengthScale | None:
        """Widths that the constrained stage enforces; None without such a stage."""
        if not self.constrained_iterations:
            return None
        return LengthScale(line_width=self.line_width, gap_width=self.gap_width)

    @property
    def options(self) -> tuple[DesignOptions, ...]:
        """Options of the design loop on each mesh, the coarsest first.

        The coarsest is first designed freely, then with constraints on the widths, and from then on
        robust against widths that are off: before, this ends in traps. The finer ones begin with
        constraints and take smaller steps.
        """
        constrained = self.constrained_iterations > 0
        stages = [Stage(self.iterations, robust=not constrained)]
        if constrained:
            stages.append(Stage(self.constrained_iterations, constrained=True))
        first = DesignOptions(
            tuple(stages),
            min_relative_decrease=self.min_decrease,
            mma=MMAOptions(move=self.move_limit),
        )
        return (first, *[self.finer_options] * (self.level_count - 1))

    @property
    def finer_options(self) -> DesignOptions:
        """Options of the design loop on each mesh but the coarsest."""
        return DesignOptions(
            (Stage(self.level_iterations, constrained=self.constrained_iterations > 0),),
            min_relative_decrease=self.min_decrease,
            pressure_move=LEVEL_PRESSURE_MOVE,
            mma=MMAOptions(move=self.level_move_limit),
        )

    @property
    def robust_against(self) -> WidthTolerance | None:
        """Widths that the design is made robust against; None without a tolerance."""
        if self.width_tolerance is None:
            return None
        return WidthTolerance(self.width_tolerance, self.spread_weight)

    @property
    def print_limits(self) -> PrintLimits:
        """Thinnest line and gap of the printer."""
        return PrintLimits(width=self.print_width, gap=self.print_width)
