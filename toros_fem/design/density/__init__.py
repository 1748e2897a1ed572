"""From design density to projected density: filters, projection, length scale, perimeter."""

from toros_fem.design.density.cone import ConeFilter
from toros_fem.design.density.field import random_density
from toros_fem.design.density.filters import Filter, make_filter
from toros_fem.design.density.helmholtz import HelmholtzFilter
from toros_fem.design.density.length_scale import LengthScale, LengthScaleConstraints
from toros_fem.design.density.perimeter import Perimeter
from toros_fem.design.density.projection import Projection
from toros_fem.design.density.symmetric import SymmetricFilter

__all__ = [
    "ConeFilter",
    "Filter",
    "HelmholtzFilter",
    "LengthScale",
    "LengthScaleConstraints",
    "Perimeter",
    "Projection",
    "SymmetricFilter",
    "make_filter",
    "random_density",
]
