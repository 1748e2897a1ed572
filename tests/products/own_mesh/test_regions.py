"""Regions of a skin."""

import numpy as np
from mpi4py import MPI

from toros_fem.meshes import cylinder
from toros_fem.meshes.pattern import Pattern
from toros_fem.products.own_mesh.metrics import Region


def test_regions_of_a_skin(alone: MPI.Comm) -> None:
    tube = cylinder(alone, 0.06, 0.02, 5e-3)
    low = Region(where="z < 10 mm").vertices(tube)
    np.testing.assert_array_equal(low, tube.points[:, 2] < 0.01)
    caps = Region(panels="base, tip").cells(tube)
    np.testing.assert_array_equal(caps, tube.panel != tube.panel_index("wall"))
    both = Region(panels="base,tip", where="z > 30 mm").cells(tube)
    np.testing.assert_array_equal(both, tube.panel == tube.panel_index("tip"))
    # Triangles go by their centroids: those of the wall that only touch the plane are outside.
    np.testing.assert_array_equal(
        Region(where="z < 0.01 mm").cells(tube), tube.panel == tube.panel_index("base")
    )
    divided = Pattern(
        tube.flat_points, tube.flat_triangles, tube.panel, tube.sewn, tube.points,
        ("wall", "cap-1", "cap-2"),
    )  # fmt: skip
    np.testing.assert_array_equal(Region(panels="cap").cells(divided), caps)
