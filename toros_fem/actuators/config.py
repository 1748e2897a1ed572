"""Configurations that all skins under pressure have in common."""

from __future__ import annotations

from dataclasses import dataclass, replace

from toros_fem.config import quantity
from toros_fem.density.length_scale import LengthScale
from toros_fem.design.config import DesignConfig, MaterialConfig
from toros_fem.design.options import DesignOptions, Stage
from toros_fem.errors import ParameterError
from toros_fem.fabrication.printability import PrintLimits
from toros_fem.materials import CURVATURES, SEAMS, Bending, Bladder, Composite
from toros_fem.mma.optimizer import MMAOptions


@dataclass(frozen=True)
class SkinConfig(MaterialConfig):
    """Bending of the sheets, seams and bladder; SI units."""

    bladder_young: float = quantity(
        0.29e6, "Young's modulus of a rubber bladder that moves with the skin", "Pa", above=0
    )
    bladder_thickness: float | None = quantity(
        None, "thickness of the bladder; none leaves it out", "m", above=0
    )
    bending: str | None = quantity(
        Bending.curvature, "curvature term of the sheet; none for a membrane", choices=CURVATURES
    )
    seams: str = quantity(Bending.seams, "how seams carry moments", choices=SEAMS)

    @property
    def composite(self) -> Composite:
        """Fabric and reinforcement, with their bending and the bladder."""
        thickness = self.bladder_thickness
        return replace(
            super().composite,
            bending=None if self.bending is None else Bending(self.bending, self.seams),
            bladder=None if thickness is None else Bladder(self.bladder_young, thickness),
        )


@dataclass(frozen=True)
class ActuatorConfig(SkinConfig, DesignConfig):
    """Pressure, and the steps of each part of the design; SI units.

    Raises:
        ParameterError: A value has another type, or is outside its bounds; or only one of the two
            bounds on the pressure is given.
    """

    pressure: float = quantity(
        5e3, "pressure, the first guess where it is designed", "Pa", at_least=0
    )
    pressure_min: float | None = quantity(
        1e3, "least pressure; none for both bounds prescribes the pressure", "Pa", above=0
    )
    pressure_max: float | None = quantity(
        20e3, "largest pressure; none for both bounds prescribes the pressure", "Pa", above=0
    )
    iterations: int = quantity(60, "steps before the width constraints act", at_least=1)
    constrained_iterations: int = quantity(
        40, "steps with the width constraints; 0 leaves them out", at_least=0
    )
    polish_iterations: int = quantity(
        20, "steps after all free islands are removed or connected; 0 leaves them", at_least=0
    )
    estimate_error: bool = quantity(
        False, "also estimate the discretisation error of the metrics on a refined mesh"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.pressure_min is None) != (self.pressure_max is None):
            raise ParameterError(
                f"pressure_min = {self.pressure_min} and pressure_max = {self.pressure_max} (Pa) "
                "must both be numbers, or both None to prescribe the pressure."
            )

    @property
    def pressure_bounds(self) -> tuple[float, float] | None:
        """Bounds on the pressure in Pa; None if it is prescribed."""
        if self.pressure_min is None or self.pressure_max is None:
            return None
        return self.pressure_min, self.pressure_max

    @property
    def length_scale(self) -> LengthScale | None:
        """Widths that the constrained stage enforces; None without such a stage."""
        if not self.constrained_iterations:
            return None
        return LengthScale(line_width=self.line_width, gap_width=self.gap_width)

    @property
    def options(self) -> DesignOptions:
        """Options of the design loop: first free, then with constraints on the widths."""
        stages = [Stage(self.iterations)]
        if self.constrained_iterations:
            stages.append(Stage(self.constrained_iterations, constrained=True))
        return DesignOptions(tuple(stages), mma=MMAOptions(move=self.move_limit))

    @property
    def print_limits(self) -> PrintLimits:
        """Thinnest line and gap of the printer."""
        return PrintLimits(width=self.print_width, gap=self.print_width)
