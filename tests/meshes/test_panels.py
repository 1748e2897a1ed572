"""Regions are divided until they can be laid flat."""

from helpers import surfaces
from mpi4py import MPI

from toros_fem.meshes import unwrap


def test_a_strip_that_would_overlap_is_divided(alone: MPI.Comm) -> None:
    """A helicoidal ramp of two turns is developable here, but lies over itself when flat."""
    made = unwrap(alone, surfaces.ramp(), seams=[])
    assert made.methods in (("exact",) * 2, ("exact",) * 3)
    assert made.distortion.worst_stretch < 1e-12


def test_a_tighter_bound_gives_more_panels(alone: MPI.Comm) -> None:
    counts = [
        len(unwrap(alone, surfaces.sphere(), max_stretch=bound).methods)
        for bound in (0.3, 0.15, 0.08)
    ]
    assert counts == sorted(counts)
    assert counts[0] < counts[2]
