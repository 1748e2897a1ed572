"""Configurations that all designs have in common: materials, filter and penalties."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from toros_fem.base.keys import (
    Fraction,
    In,
    Length,
    Modulus,
    Number,
    OneOf,
    Poisson,
    Positive,
    Stretch,
    Table,
    key,
)
from toros_fem.design.density.filters import FILTERS
from toros_fem.design.density.perimeter import SHARPNESS
from toros_fem.materials.sheet import Composite, Material


@dataclass(frozen=True)
class MaterialConfig(Table):
    """Materials of the sheets; SI units."""

    fabric_young: Modulus = key(0.1e6, "Young's modulus of the fabric")
    reinforcement_young: Modulus = key(26e6, "Young's modulus of the reinforced fabric")
    poisson: Poisson = key(0.3, "Poisson's ratio of the fabric")
    reinforcement_poisson: Poisson | None = key(
        None, "Poisson's ratio of the reinforced fabric; none takes that of the fabric"
    )
    thickness: Length = key(0.5e-3, "thickness of the fabric")
    reinforcement_thickness: Length | None = key(
        None, "thickness of the reinforced fabric; none takes that of the fabric"
    )
    c1: Stretch = key(1.9, "bound on a principal stretch, eq. (1)")
    reinforcement_c1: Stretch | None = key(
        None, "bound on a principal stretch of the reinforced fabric; none takes that of the fabric"
    )
    c2: Stretch = key(2.6, "bound on the sum of both principal stretches less 1")
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


@dataclass(frozen=True)
class DesignConfig(MaterialConfig):
    """Filter, penalties, print limits and seed; SI units."""

    filter: Annotated[str, OneOf(FILTERS)] = key("cone", "density filter")
    filter_radius: Length = key(2.15e-3, "radius R of the filter")
    beta: Positive = key(20.0, "steepness of the projection")
    eta: Annotated[float, In(above=0, below=1)] = key(0.5, "threshold of the projection")
    line_width: Length | None = key(None, "smallest width of a printed line; none takes R")
    gap_width: Length | None = key(None, "smallest width of a gap between lines; none takes R")
    perimeter_weight: Positive | None = key(
        None, "weight of the perimeter term; none leaves it out"
    )
    perimeter_window: Positive = key(1.0, "radius of the perimeter's window over R")
    perimeter_sharpness: float = key(
        SHARPNESS, "w of eq. (15): above 0 it erodes the print, as in the paper, below 0 the fabric"
    )
    move_limit: Fraction = key(0.2, "largest change of a density in one step")
    island_area: Annotated[float, In("m²", at_least=0)] = key(
        20e-6, "free islands smaller than this are removed, larger ones are joined to the rest"
    )
    print_width: Length = key(0.6e-3, "thinnest line and gap that the printer makes")
    seed: Number = key(2, "seed of the random start")
