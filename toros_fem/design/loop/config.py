"""Configurations that all designs have in common: materials, filter and penalties."""

from __future__ import annotations

from dataclasses import dataclass

from toros_fem.base.config import Config, quantity
from toros_fem.design.density.filters import FILTERS
from toros_fem.design.density.perimeter import SHARPNESS
from toros_fem.materials.sheet import Composite, Material


@dataclass(frozen=True)
class MaterialConfig(Config):
    """Materials of the sheets; SI units."""

    fabric_young: float = quantity(0.1e6, "Young's modulus of the fabric", "Pa", above=0)
    reinforcement_young: float = quantity(
        26e6, "Young's modulus of the reinforced fabric", "Pa", above=0
    )
    poisson: float = quantity(0.3, "Poisson's ratio of the fabric", at_least=0, at_most=0.5)
    reinforcement_poisson: float | None = quantity(
        None,
        "Poisson's ratio of the reinforced fabric; none takes that of the fabric",
        at_least=0,
        at_most=0.5,
    )
    thickness: float = quantity(0.5e-3, "thickness of the fabric", "m", above=0)
    reinforcement_thickness: float | None = quantity(
        None, "thickness of the reinforced fabric; none takes that of the fabric", "m", above=0
    )
    c1: float = quantity(1.9, "bound on a principal stretch, eq. (1)", above=1)
    reinforcement_c1: float | None = quantity(
        None,
        "bound on a principal stretch of the reinforced fabric; none takes that of the fabric",
        above=1,
    )
    c2: float = quantity(2.6, "bound on the sum of both principal stretches less 1", above=1)
    reinforcement_c2: float | None = quantity(
        None,
        "bound on the sum of both less 1 in the reinforced fabric; none takes that of the fabric",
        above=1,
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

    filter: str = quantity("cone", "density filter", choices=FILTERS)
    filter_radius: float = quantity(2.15e-3, "radius R of the filter", "m", above=0)
    beta: float = quantity(20.0, "steepness of the projection", above=0)
    eta: float = quantity(0.5, "threshold of the projection", above=0, below=1)
    line_width: float | None = quantity(
        None, "smallest width of a printed line; none takes R", "m", above=0
    )
    gap_width: float | None = quantity(
        None, "smallest width of a gap between lines; none takes R", "m", above=0
    )
    perimeter_weight: float | None = quantity(
        None, "weight of the perimeter term; none leaves it out", above=0
    )
    perimeter_window: float = quantity(1.0, "radius of the perimeter's window over R", above=0)
    perimeter_sharpness: float = quantity(
        SHARPNESS, "w of eq. (15): above 0 it erodes the print, as in the paper, below 0 the fabric"
    )
    move_limit: float = quantity(0.2, "largest change of a density in one step", above=0, at_most=1)
    island_area: float = quantity(
        20e-6,
        "free islands smaller than this are removed, larger ones are joined to the rest",
        "m²",
        at_least=0,
    )
    print_width: float = quantity(
        0.6e-3, "thinnest line and gap that the printer makes", "m", above=0
    )
    seed: int = quantity(2, "seed of the random start", at_least=0)
