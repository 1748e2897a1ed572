"""Tables that several kinds of scenes share: sheets, loads, what counts; steps, lines, printer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any, ClassVar

import numpy as np

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import (
    Angle,
    Count,
    Distance,
    Factor,
    Flag,
    Fraction,
    In,
    Length,
    Modulus,
    Need,
    Number,
    OneOf,
    Poisson,
    Positive,
    Pressure,
    Real,
    Stretch,
    Table,
    key,
)
from toros_fem.base.validation import Ints
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
from toros_fem.materials.sheet import (
    CURVATURES,
    PRINT_SIDES,
    SEAMS,
    WRINKLINGS,
    Bending,
    Bladder,
    Composite,
    Knit,
    Material,
    Membrane,
    Threads,
)
from toros_fem.measures.cross_sections import CrossSections
from toros_fem.measures.figures import DEFAULT, Tolerances
from toros_fem.measures.shape import ShapePart
from toros_fem.meshes.pattern import Pattern

Stiffness = Annotated[float, In("N/m", at_least=0)]
ThreadStrain = Annotated[float, In(above=0, at_most=100)]
# What the densities of a design may start from.
STARTS = ("random", "relaxed")
BendAngle = Annotated[float, In("deg", at_least=-720, at_most=720)]
TwistAngle = Annotated[float, In("deg", at_least=-2160, at_most=2160)]
Shortening = Annotated[float, In("%", below=100)]


class Sheets(Table):
    """Fabric, print and bladder."""

    fabric_young: Modulus = key(0.1e6, "Young's modulus of the fabric")
    poisson: Poisson = key(0.3, "Poisson's ratio of the fabric")
    thickness: Length = key(0.5e-3, "thickness of the fabric")
    c1: Stretch = key(1.9, "bound on a principal stretch, eq. (1)")
    c2: Stretch = key(2.6, "bound on the sum of both principal stretches less 1")
    tested_stretch: Stretch | None = key(
        None,
        "stretch up to which the fabric was tested, beyond which a warning comes; none: unknown",
    )
    reinforcement_young: Modulus = key(70e6, "Young's modulus of the reinforced fabric")
    reinforcement_poisson: Poisson | None = key(
        None, "Poisson's ratio of the reinforced fabric; none takes that of the fabric"
    )
    reinforcement_thickness: Length | None = key(
        0.4e-3, "thickness of the reinforced fabric; none takes that of the fabric"
    )
    print_height: Length | None = key(
        None,
        "height of the printed layer on the fabric, for the machine files; none takes the "
        "thickness of the reinforced fabric",
    )
    reinforcement_c1: Stretch | None = key(
        None, "bound on a principal stretch of the reinforced fabric; none takes that of the fabric"
    )
    reinforcement_c2: Stretch | None = key(
        None,
        "bound on the sum of both less 1 in the reinforced fabric; none takes that of the fabric",
    )

    @property
    def composite(self) -> Composite:
        """Fabric and reinforcement as membranes."""
        poisson, thickness = self.reinforcement_poisson, self.reinforcement_thickness
        return Composite(
            fabric=Material(self.fabric_young, self.poisson, self.thickness),
            reinforcement=Material(
                self.reinforcement_young,
                self.poisson if poisson is None else poisson,
                self.thickness if thickness is None else thickness,
                self.reinforcement_c1,
                self.reinforcement_c2,
            ),
            c1=self.c1,
            c2=self.c2,
            bending=None,
        )


class SkinSheets(Sheets):
    """Fabric, print and bladder."""

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
    bladder_young: Modulus = key(
        0.29e6, "Young's modulus of a rubber bladder that moves with the skin"
    )
    bladder_thickness: Length | None = key(None, "thickness of the bladder; none leaves it out")
    bladder_second: Annotated[float, In("Pa")] | None = key(
        None, "constant C₂₀ of Yeoh's law of the bladder; none for a neo-Hookean one"
    )
    bladder_third: Annotated[float, In("Pa", at_least=0)] | None = key(
        None, "constant C₃₀ of Yeoh's law of the bladder; none for none"
    )
    knit_ratio: Annotated[float, In(at_least=1)] | None = key(
        None,
        "modulus of the fabric along its courses over that along its wales; none for an isotropic "
        "fabric",
    )
    course_stiffness: Stiffness | None = key(
        None,
        "stiffness of threads along the courses, per width, in the place of knit_ratio; none takes "
        "that of knit_ratio",
    )
    course_strain: ThreadStrain | None = key(
        None, "strain over which the threads along the courses stiffen; none: they do not"
    )
    wale_stiffness: Stiffness | None = key(
        None, "stiffness of threads along the wales, per width; none for none"
    )
    wale_strain: ThreadStrain | None = key(
        None, "strain over which the threads along the wales stiffen; none: they do not"
    )
    shear_stiffness: Stiffness | None = key(
        None, "stiffness of the fabric against shear of its threads, per width; none for none"
    )
    grain_angle: Angle = key(
        0.0,
        "angle of the courses from the first axis of the flat panels; on a tube 0 is around and 90 "
        "along it",
    )

    NEEDS: ClassVar = {
        **dict.fromkeys(
            ("bladder_young", "bladder_second", "bladder_third"), ("bladder_thickness", ())
        ),
        "course_strain": ("course_stiffness", ()),
        "wale_strain": ("wale_stiffness", ()),
    }

    @property
    def composite(self) -> Composite:
        """Fabric and reinforcement, with bending, wrinkling, the bladder and the knit."""
        thickness = self.bladder_thickness
        return replace(
            super().composite,
            bending=None if self.bending is None else Bending(self.bending, self.seams),
            membrane=Membrane(self.wrinkling),
            print_side=self.print_side,
            print_offset=self.print_offset,
            bladder=None
            if thickness is None
            else Bladder(self.bladder_young, thickness, self.bladder_second, self.bladder_third),
            knit=self.knit,
        )

    @property
    def knit(self) -> Knit | None:
        """Threads of the fabric; None for an isotropic one."""
        grain, ratio = float(np.radians(self.grain_angle)), self.knit_ratio
        course, wale = (
            None if stiffness is None else Threads(stiffness, strain)
            for stiffness, strain in (
                (self.course_stiffness, self.course_strain),
                (self.wale_stiffness, self.wale_strain),
            )
        )
        if ratio is None and course is None and wale is None and self.shear_stiffness is None:
            return None
        return Knit(1.0 if ratio is None else ratio, grain, course, wale, self.shear_stiffness)

    def require_symmetric(self, planes: tuple[int, ...]) -> None:
        """Check that a knit has the mirrored grain where the skin is cut at symmetry planes.

        Raises:
            ParameterError: It has not.
        """
        if planes and self.knit is not None and self.grain_angle % 90:
            raise ParameterError(
                f"grain_angle = {self.grain_angle} deg is not symmetric: the other part would "
                "have the mirrored grain. Set 0 or 90, or design the whole skin.",
                "grain_angle",
            )


class PressureTable(Table):
    """Pressure."""

    pressure: Pressure = key(
        10e3, "most that the pump gives: a design takes what its target wants, a simulation all"
    )
    hold_pressure: Flag = key(
        False, "design for exactly this pressure, and not for the least that the target wants"
    )


class ContactTable(Table):
    """Contact and friction."""

    friction: Positive | None = key(
        None, "coefficient of Coulomb's friction on ground and bodies; none for none"
    )
    contact_distance: Length | None = key(
        None,
        "distance of two faces from which on contact acts; none takes half of the fabric's "
        "thickness",
    )


class Orientation(Table):
    """What counts in the objective."""

    orientation_length: Distance = key(
        0.03, "a tip turned by 0.1 rad costs as much as a skin displaced by a tenth of this length"
    )


class TipWeights(Orientation):
    """What counts in the objective."""

    tip_weight: Factor = key(1.0, "weight of the tip's position over that of all the rest")

    def shape_part(self, pattern: Pattern, tip: Ints, turned: Ints, radius: float) -> ShapePart:
        """Return the shape of a whole pattern that counts, and its tip more.

        Args:
            tip: Vertices of the tip.
            turned: Vertices whose orientation counts.
            radius: Of these in m: turned by a small angle about a diameter they move by
                angle · radius/√2 in root mean square.
        """
        area, weights = pattern.vertex_areas, np.ones(len(pattern.points))
        weights[tip] += self.tip_weight * area.sum() / area[tip].sum()
        relative = np.zeros(len(pattern.points))
        ratio = np.sqrt(2) * self.orientation_length / radius
        relative[turned] = ratio**2 * (area @ weights) / area[turned].sum()
        return ShapePart(weights, relative)


class SectionWeights(TipWeights):
    """What counts in the objective."""

    cross_sections: Count = key(12, "number of cross-sections along the wall; the tip is one more")
    axial_weight: Factor = key(
        1.0, "weight of the cross-sections' positions along the axis over that across"
    )

    def sections_part(
        self, pattern: Pattern, labels: Ints, axis: int, *, border: bool = True
    ) -> CrossSections:
        """Return cross-sections of a whole pattern that count.

        If each of n sections is off by δ/n from the one before, the tip is off by δ.

        Args:
            labels: Cross-section of each vertex, as of `label_cross_sections`.
            axis: Axis of the body, 0 for x, …
            border: Whether the tip is one section more than `cross_sections`.
        """
        share = 1 / self.cross_sections
        last = self.tip_weight if border else max(share, self.tip_weight)
        fraction = np.append(np.full(self.cross_sections - (not border), share), last)
        components = np.where(np.arange(3) == axis, self.axial_weight, 1.0)
        ratio = self.orientation_length / pattern.size
        orientation = np.full(len(fraction), len(fraction) * last * ratio**2)
        return CrossSections(labels, np.outer(fraction, components), orientation)


class ResultTable(Table):
    """What is simulated of the print, and what counts as reached."""

    estimate_error: Flag = key(
        True,
        "estimate the discretisation error of the metrics, from other meshes",
        free=True,
    )
    check_refinement: Annotated[float, In(at_least=1.2, at_most=8)] | None = key(
        None,
        "edge length over that of a finer mesh, on which the print is simulated once more: its "
        "values are told, and lines are corrected by them (of an own mesh the nearest power of 2); "
        "none leaves it out",
        free=True,
    )
    curve_pressure: Modulus | None = key(
        20e3,
        "largest pressure up to which the metrics of the print are followed; none leaves this "
        "curve out",
        free=True,
    )
    curve_steps: Count = key(
        10, "number of equal steps of the curve from 0 to that pressure", free=True
    )
    tolerance: Fraction = key(
        DEFAULT.figure,
        "part of its target that a figure may be off by and count as reached",
        free=True,
    )
    shape_tolerance: Fraction = key(
        DEFAULT.shape,
        "part of the skin's length that a shape may be off by, as root mean square, and count as "
        "reached",
        free=True,
    )
    direction_tolerance: Annotated[float, In("deg", above=0, at_most=180)] = key(
        DEFAULT.direction,
        "angle that the direction of a tip may be off by and count as reached",
        free=True,
    )

    @property
    def tolerances(self) -> Tolerances:
        """What counts as reached."""
        return Tolerances(self.tolerance, self.shape_tolerance, self.direction_tolerance)


# ----------------------------------------------- targets, start, steps and filter, lines, printer


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
