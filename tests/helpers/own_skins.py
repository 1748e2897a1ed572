"""A finger of a mesh file of one's own."""

from helpers.scenes import ROOT
from toros_fem.products.own_mesh import Held, OwnMeshScene, Plain, Printed

FINGER = ROOT / "demos" / "surfaces" / "finger.stl"
OWN = OwnMeshScene.of(
    held=(Held(where="z < 4 mm"),),
    printed=(Printed(where="z < 0.01 mm or z > 89.99 mm"),),
    plain=(Plain(where="x < -7 mm and 30 mm < z < 40 mm"),),
    bend=60.0,
    filter_radius=4e-3,
)
