"""Configuration of what a design starts from: the relaxed design and its printable lines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import Count, In, Length, Number, OneOf, Positive, key
from toros_fem.design.lines.options import LineOptions
from toros_fem.design.loop.config import DesignConfig
from toros_fem.design.relaxed.find import RelaxedOptions

STARTS = ("random", "relaxed")


@dataclass(frozen=True)
class StartConfig(DesignConfig):
    """Start of the densities: relaxed design of line families, printable lines; SI units."""

    start: Annotated[str, OneOf(STARTS)] = key(
        "random",
        "what the densities start from: noise, or the printable lines of a relaxed design; this "
        "and its print have meshes of their own, so that edge length, levels, filter radius and "
        "the steps of random densities play no part",
    )
    relaxed_edge_length: Length = key(4e-3, "edge length of the relaxed design's mesh")
    relaxed_iterations: Count = key(
        40, "largest number of steps of either stage of the relaxed design"
    )
    directions: Annotated[int, In(at_least=2)] = key(
        12, "number of fixed directions in the first stage of the relaxed design"
    )
    share_limit: Annotated[float, In(above=0, at_most=0.9)] = key(
        0.35,
        "limit on the part of the area that the lines of all directions cover in the first "
        "stage of the relaxed design",
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

    print_edge_length: Length = key(
        0.75e-3, "edge length of the mesh that printed lines are simulated on"
    )
    corrections: Number = key(0, "how often the design is asked again for what its print misses")
    density_iterations: Number = key(
        0, "steps of the densities that start from these lines; kept only if the print gets better"
    )
    share_weight: Positive | None = key(
        0.01, "weight of the lines' share in the relaxed objective; none leaves it out"
    )

    @property
    def relaxed_options(self) -> RelaxedOptions:
        """Numbers of the relaxed design."""
        return RelaxedOptions(
            directions=self.directions,
            share_limit=self.share_limit,
            radius=self.smoothing_radius,
            share_weight=self.share_weight,
            iterations=(self.relaxed_iterations, self.relaxed_iterations),
            width_ratio=self.laid_widths[1] / self.laid_widths[0],
        )

    @property
    def line_options(self) -> LineOptions:
        """Widths and limits of the lines that are laid.

        Raises:
            ParameterError: A width is under `print_width`, or under the edge length of the print.
        """
        if self.print_edge_length > min(self.laid_widths):
            raise ParameterError(
                f"print_edge_length = {self.print_edge_length} m is over {min(self.laid_widths)} "
                "m, the width of the lines: their print cannot be simulated. Give shorter edges.",
                "print_edge_length",
            )
        return LineOptions(widths=self.laid_widths, print_width=self.print_width)

    @property
    def laid_widths(self) -> tuple[float, float]:
        """Width in m of the lines along either family."""
        second = self.laid_width if self.second_laid_width is None else self.second_laid_width
        return self.laid_width, second
