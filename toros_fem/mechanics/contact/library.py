"""The IPC Toolkit, imported by the first scene that has contact, and its meshes."""

from __future__ import annotations

from typing import Any

import numpy as np

from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.packages import required


def ipctk() -> Any:
    """Return the module `ipctk`, which then works on one thread: its sums keep their order.

    Raises:
        MissingPackageError: It is not installed.
    """
    module = required("ipctk", "contact")
    module.set_num_threads(1)
    module.set_logger_level(module.LoggerLevel.error)
    return module


def collision_mesh(points: Floats, triangles: Ints, may_touch: Any = None) -> Any:
    """Return the `ipctk.CollisionMesh` of surfaces; a filter, of its own kind, leaves pairs out."""
    library = ipctk()
    faces = np.asfortranarray(triangles, dtype=np.int32)
    mesh = library.CollisionMesh(np.asfortranarray(points), library.edges(faces), faces)
    if may_touch is not None:
        mesh.can_collide = may_touch
    return mesh


def patches_apart(numbers: Ints) -> Any:
    """Return a filter that lets vertices touch whose numbers differ."""
    return ipctk().make_vertex_patches_filter(np.asarray(numbers, dtype=np.int32))
