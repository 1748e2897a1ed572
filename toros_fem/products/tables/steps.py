"""Tables of a design: targets, start, steps and filter, lines, and printer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

from toros_fem.base.keys import (
    Count,
    Fraction,
    In,
    Length,
    Need,
    Number,
    OneOf,
    Positive,
    Real,
    Table,
    key,
)
from toros_fem.design.density.filters import FILTERS
from toros_fem.design.density.length_scale import LengthScale
from toros_fem.design.density.perimeter import SHARPNESS
from toros_fem.design.density.projection import Power, Projection, Steepness, Threshold
from toros_fem.design.lines.field import Spread
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.design.loop.shape_design import POWER, Regularisation
from toros_fem.design.mma.optimizer import MMAOptions
from toros_fem.design.relaxed.problem import Directions, Share
from toros_fem.making.printability import PrintLimits

# What the densities of a design may start from.
STARTS = ("random", "relaxed")
BendAngle = Annotated[float, In("deg", at_least=-720, at_most=720)]
TwistAngle = Annotated[float, In("deg", at_least=-2160, at_most=2160)]
Shortening = Annotated[float, In("%", below=100)]


class FilterTable(Table):
    """Steps, filter and start of the design."""

    seed: Number = key(2, "seed of the random start")
    move_limit: Fraction = key(0.2, "largest change of a density in one step")
    filter: Annotated[str, OneOf(FILTERS)] = key("cone", "density filter")
    filter_radius: Length = key(2.15e-3, "radius R of the filter")
    beta: Steepness = key(20.0, "steepness of the projection")
    eta: Threshold = key(0.5, "threshold of the projection")
    power: Power = key(
        POWER, "power q of the projection: 1 as in the paper; more takes stiffness from grey print"
    )
    line_width: Length | None = key(None, "smallest width of a printed line; none takes R")
    gap_width: Length | None = key(None, "smallest width of a gap between lines; none takes R")
    perimeter_weight: Positive | None = key(
        None, "weight of the perimeter term; none leaves it out"
    )
    perimeter_window: Positive = key(1.0, "radius of the perimeter's window over R")
    perimeter_sharpness: Real = key(
        SHARPNESS, "w of eq. (15): above 0 it erodes the print, as in the paper, below 0 the fabric"
    )

    NEEDS: ClassVar[Mapping[str, Need]] = dict.fromkeys(
        ("perimeter_window", "perimeter_sharpness"), ("perimeter_weight", ())
    )

    @property
    def projection(self) -> Projection:
        """Smoothed step from ρ̃ to ρ̄."""
        return Projection(self.beta, self.eta, self.power)


class StepTable(Table):
    """Steps, filter and start of the design."""

    start: Annotated[str, OneOf(STARTS)] = key(
        "random",
        "what the densities start from: noise, or the printable lines of a relaxed design. With "
        "relaxed, edge_length, levels, filter_radius and the steps of random densities do not "
        "count: the relaxed design and its print have meshes of their own",
    )
    starts: Count = key(
        1,
        "number of random starts on the coarsest mesh, shared out over the ranks; the best goes on",
    )
    levels: Count | None = key(
        None,
        "number of meshes, from coarse to fine: edges and filter radius halve from each to the "
        "next; none takes as many as the size allows",
    )
    iterations: Count = key(
        60, "steps on the coarsest mesh before the width constraints act", free=True
    )
    constrained_iterations: Number = key(
        40,
        "further steps there with the width constraints; 0 leaves them out",
        free=True,
    )
    min_decrease: Fraction | None = key(
        0.05,
        "a stage ends when the objective falls by a smaller fraction in ten steps; none leaves "
        "this rule out",
    )
    level_iterations: Count = key(
        10,
        "steps on each mesh but the coarsest, with the width constraints",
        free=True,
    )
    level_move_limit: Fraction = key(
        0.05, "largest change of a density in one step on these meshes"
    )
    polish_iterations: Number = key(
        20,
        "steps on a mesh after all free islands are removed or connected; 0 leaves them",
        free=True,
    )
    corrections: Number = key(
        4, "how often a design is asked again for what its print misses, at most", free=True
    )
    seeds: Count = key(
        1,
        "largest number of seeds, from that given on, that are tried until a print certainly "
        "reaches its targets; the best design is kept",
        free=True,
    )


class DesignTable(FilterTable, StepTable):
    """Steps, filter and start of the design."""

    NEEDS: ClassVar[Mapping[str, Need]] = {
        **FilterTable.NEEDS,
        **dict.fromkeys(("levels", "iterations"), ("start", ("random",))),
    }

    @property
    def regularisation(self) -> Regularisation:
        """Filter, projection, widths and perimeter on the finest mesh."""
        return Regularisation(
            self.filter_radius,
            self.filter,
            self.projection,
            self.length_scale,
            self.perimeter_weight,
            self.perimeter_window * self.filter_radius,
            self.perimeter_sharpness,
        )

    @property
    def length_scale(self) -> LengthScale | None:
        """Widths that the constrained stage enforces; None without such a stage."""
        if not self.constrained_iterations:
            return None
        return LengthScale(line_width=self.line_width, gap_width=self.gap_width)

    @property
    def first_options(self) -> DesignOptions:
        """Options of the design loop on the coarsest mesh.

        It is first designed freely, then with constraints on the widths.
        """
        stages = [Stage(self.iterations)]
        if self.constrained_iterations:
            stages.append(Stage(self.constrained_iterations, constrained=True))
        return DesignOptions(
            tuple(stages),
            min_relative_decrease=self.min_decrease,
            mma=MMAOptions(move=self.move_limit),
        )

    @property
    def finer_options(self) -> DesignOptions:
        """Options of the design loop on each mesh but the coarsest: constraints, smaller steps."""
        stage = Stage(self.level_iterations, constrained=self.constrained_iterations > 0)
        return self.options_of(stage)

    def options_of(self, stage: Stage) -> DesignOptions:
        """Return options of a stage that goes on from a design."""
        return DesignOptions(
            (stage,),
            min_relative_decrease=self.min_decrease,
            mma=MMAOptions(move=self.level_move_limit),
        )


class LineTable(Table):
    """Relaxed designs and their printable lines."""

    relaxed_edge_length: Length = key(4e-3, "edge length of the relaxed design's mesh")
    relaxed_iterations: Count = key(
        40,
        "largest number of steps of either stage of the relaxed design",
        free=True,
    )
    directions: Directions = key(
        12, "number of fixed directions in the first stage of the relaxed design"
    )
    share_limit: Share = key(
        0.35,
        "limit on the part of the area that the lines of all directions cover in the first "
        "stage of the relaxed design",
    )
    share_weight: Positive | None = key(
        0.01, "weight of the lines' share in the relaxed objective; none leaves it out"
    )
    smoothing_radius: Length | None = key(
        None,
        "radius of the smoothing of shares and directions; none takes a tenth of the skin's size",
    )
    laid_width: Length = key(
        0.9e-3,
        "width of the lines along the first family, the one nearer to the second axis of the panel",
    )
    second_laid_width: Length | None = key(
        None, "width of those along the second family; none takes the same"
    )
    least_share: Fraction = key(
        0.03, "where a family has less than this share of the area it has no lines"
    )
    spread: Spread = key(
        1.5, "largest local width of a line over the width asked, and that over the smallest one"
    )
    print_edge_length: Length = key(
        1.4e-3, "edge length in the fabric of the mesh that printed lines are simulated on"
    )
    density_iterations: Number = key(
        0,
        "steps of the densities that start from these lines; kept only if the print gets better",
        free=True,
    )

    NEEDS: ClassVar = dict.fromkeys(
        (
            "relaxed_edge_length", "relaxed_iterations", "directions", "share_limit",
            "share_weight", "smoothing_radius", "laid_width", "second_laid_width", "least_share",
            "spread", "print_edge_length", "density_iterations",
        ),
        ("start", ("relaxed",)),
    )  # fmt: skip

    @property
    def widths(self) -> tuple[float, float]:
        """Width in m of the lines along either family."""
        second = self.laid_width if self.second_laid_width is None else self.second_laid_width
        return self.laid_width, second


class PrinterTable(Table):
    """Printer."""

    print_width: Length = key(0.6e-3, "thinnest line and gap that the printer makes")
    island_area: Annotated[float, In("m²", at_least=0)] = key(
        20e-6, "free islands smaller than this are removed, larger ones are joined to the rest"
    )

    @property
    def limits(self) -> PrintLimits:
        """Thinnest line and gap of the printer."""
        return PrintLimits(width=self.print_width, gap=self.print_width)


def bend_key(default: float | None) -> Any:
    """Return the key of a bend angle."""
    return key(default, "bend angle of the target", metric="angle")


def twist_key(default: float | None) -> Any:
    """Return the key of a twist."""
    meaning = "twist of the target, positive if counter-clockwise seen from the tip"
    return key(default, meaning, metric="twist")


def shortening_key(default: float | None) -> Any:
    """Return the key of a shortening."""
    return key(default, "shortening of the target", metric="shortening")
