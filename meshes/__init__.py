"""Panels, seams and the sewn skin; ready-made patterns; target shapes."""

from toros_fem.meshes.cylinder import cylinder
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.sheet import disc, rectangle
from toros_fem.meshes.skin import Skin, sew
from toros_fem.meshes.surface import Surface
from toros_fem.meshes.surface_file import read_surface
from toros_fem.meshes.targets import Deformer, bend, compose, contract, twist
from toros_fem.meshes.unwrap import Unwrapped, unwrap

__all__ = [
    "Deformer",
    "Pattern",
    "Skin",
    "Surface",
    "Unwrapped",
    "bend",
    "compose",
    "contract",
    "cylinder",
    "disc",
    "read_surface",
    "rectangle",
    "sew",
    "twist",
    "unwrap",
]
