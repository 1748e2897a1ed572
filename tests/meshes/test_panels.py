"""Regions are divided until they can be laid flat."""

import numpy as np
from helpers import surfaces
from mpi4py import MPI

from toros_fem.meshes import Surface, unwrap


def test_a_strip_that_would_overlap_is_parted(comm: MPI.Comm) -> None:
    """A helicoidal ramp of two turns is developable here, but lies over itself when flat."""
    turn = np.linspace(0, 4 * np.pi, 49)
    ring = np.column_stack([np.cos(turn), np.sin(turn), 0.02 * turn])
    points = np.concatenate([ring, ring * [2, 2, 1]]) * 0.01
    k = np.arange(48)
    triangles = np.concatenate(
        [np.stack([k, k + 49, k + 1], 1), np.stack([k + 1, k + 49, k + 50], 1)]
    )
    made = unwrap(comm, Surface(points, triangles), seams=[])
    assert made.methods in (("exact",) * 2, ("exact",) * 3)
    assert made.distortion.worst_stretch < 1e-12


def test_a_tighter_bound_gives_more_panels(comm: MPI.Comm) -> None:
    counts = [
        len(unwrap(comm, surfaces.sphere(), max_stretch=bound).methods)
        for bound in (0.3, 0.15, 0.08)
    ]
    assert counts == sorted(counts)
    assert counts[0] < counts[2]
