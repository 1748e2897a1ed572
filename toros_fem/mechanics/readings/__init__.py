"""What a solved skin tells on demand: error of a figure, wrinkles, holding force."""

from toros_fem.mechanics.readings.error_estimate import ErrorEstimate, estimate_error
from toros_fem.mechanics.readings.holding import HoldingObjective
from toros_fem.mechanics.readings.wrinkles import Tension, WrinkleField, wrinkle_field

__all__ = [
    "ErrorEstimate",
    "HoldingObjective",
    "Tension",
    "WrinkleField",
    "estimate_error",
    "wrinkle_field",
]
