"""How far a skin as made may be off from the skin as drawn."""

from __future__ import annotations

from dataclasses import dataclass

from toros_fem.base.config import Config, quantity


@dataclass(frozen=True)
class ToleranceConfig(Config):
    """Tolerances of printer, material and pressure; SI units."""

    width: float | None = quantity(
        1e-4,
        "width by which lines are off; each border by half of it, and twice as much is simulated "
        "too; none leaves it out",
        "m",
        above=0,
        at_most=1e-2,
    )
    modulus: float | None = quantity(
        0.2, "fraction by which moduli are off; none leaves them out", above=0, at_most=0.9
    )
    thickness: float | None = quantity(
        0.2, "fraction by which thicknesses are off; none leaves them out", above=0, at_most=0.9
    )
    pressure_change: float | None = quantity(
        0.05, "fraction by which the pressure is off; none leaves it out", above=0, at_most=0.9
    )
