"""Panels, seams and the sewn skin; ready-made patterns; target shapes."""

from toros_fem.meshes.cylinder import cylinder
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.sheet import disc, rectangle
from toros_fem.meshes.skin import Skin, sew
from toros_fem.meshes.targets import Deformer, bend, compose, contract, twist

__all__ = [
    "Deformer",
    "Pattern",
    "Skin",
    "bend",
    "compose",
    "contract",
    "cylinder",
    "disc",
    "rectangle",
    "sew",
    "twist",
]
