"""Energy, forces and tangent of a skin, eqs. (1-10), with its supports and loads."""

from toros_fem.mechanics.skin.chambers import Chambers, chambers_of_panels
from toros_fem.mechanics.skin.coefficients import check_density
from toros_fem.mechanics.skin.dead_loads import Weight, point_force, spread_force
from toros_fem.mechanics.skin.load_case import LoadCase
from toros_fem.mechanics.skin.model import SkinModel
from toros_fem.mechanics.skin.periodicity import ALL_PRESCRIBED, UNIAXIAL, Periodic
from toros_fem.mechanics.skin.relaxed_model import RelaxedModel
from toros_fem.mechanics.skin.supports import (
    Supports,
    build_in,
    clamp,
    clamp_where,
    displace,
    pin,
    symmetry_plane,
)

__all__ = [
    "ALL_PRESCRIBED",
    "UNIAXIAL",
    "Chambers",
    "LoadCase",
    "Periodic",
    "RelaxedModel",
    "SkinModel",
    "Supports",
    "Weight",
    "build_in",
    "chambers_of_panels",
    "check_density",
    "clamp",
    "clamp_where",
    "displace",
    "pin",
    "point_force",
    "spread_force",
    "symmetry_plane",
]
