"""As made, not as drawn: tolerances of print, materials and pressure (docs/tolerance.md)."""

from toros_fem.products.options import ToleranceConfig
from toros_fem.products.tolerance.result import Tolerances, Variant
from toros_fem.products.tolerance.simulated import tolerances
from toros_fem.products.tolerance.writing import write_tolerances

__all__ = [
    "ToleranceConfig",
    "Tolerances",
    "Variant",
    "tolerances",
    "write_tolerances",
]
