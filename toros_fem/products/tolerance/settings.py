"""How far a skin as made may be off from the skin as drawn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from toros_fem.base.keys import In, Table, key


@dataclass(frozen=True)
class ToleranceConfig(Table):
    """Tolerances of printer, material and pressure; SI units."""

    width: Annotated[float, In("m", above=0, at_most=0.01)] | None = key(
        1e-4,
        "width by which lines are off; each border by half of it, and twice as much is simulated "
        "too; none leaves it out",
    )
    modulus: Annotated[float, In(above=0, at_most=0.9)] | None = key(
        0.2, "fraction by which moduli are off; none leaves them out"
    )
    thickness: Annotated[float, In(above=0, at_most=0.9)] | None = key(
        0.2, "fraction by which thicknesses are off; none leaves them out"
    )
    pressure_change: Annotated[float, In(above=0, at_most=0.9)] | None = key(
        0.05, "fraction by which the pressure is off; none leaves it out"
    )
