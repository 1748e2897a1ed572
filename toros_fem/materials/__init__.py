"""Laws of the sheets: membrane, bending, bladder, knit, and what a skin is made of."""

from toros_fem.materials.sheet import Bending, Bladder, Composite, Knit, Material, Membrane

__all__ = [
    "Bending",
    "Bladder",
    "Composite",
    "Knit",
    "Material",
    "Membrane",
]
