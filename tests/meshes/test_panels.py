"""Regions are divided until they can be laid flat."""

import numpy as np
from helpers import surfaces
from mpi4py import MPI

from toros_fem.meshes import unwrap
from toros_fem.meshes.panels import flat_panels
from toros_fem.meshes.topology import edges_of


def test_a_strip_that_would_overlap_is_divided(comm: MPI.Comm) -> None:
    """A helicoidal ramp of two turns is developable here, but lies over itself when flat."""
    made = unwrap(comm, surfaces.ramp(), seams=[])
    assert made.methods in (("exact",) * 2, ("exact",) * 3)
    assert made.distortion.worst_stretch < 1e-12


def test_a_tighter_bound_gives_more_panels(comm: MPI.Comm) -> None:
    counts = [
        len(unwrap(comm, surfaces.sphere(), max_stretch=bound).methods)
        for bound in (0.3, 0.15, 0.08)
    ]
    assert counts == sorted(counts)
    assert counts[0] < counts[2]


def test_panels_cover_the_surface_and_respect_cuts() -> None:
    """Each triangle is in one panel, in the order of parts; panels are not merged across a cut."""
    ball = surfaces.sphere(2)
    edges = edges_of(ball.triangles)
    upper = ball.points[ball.triangles].mean(axis=1)[:, 2] > 0
    cuts = upper[edges.sides[:, 0]] != upper[edges.sides[:, 1]]
    panels = flat_panels(ball, edges, cuts, "auto", 0.1, tips=True)
    cells = np.concatenate([cells for cells, _ in panels])
    assert np.array_equal(np.sort(cells), np.arange(len(ball.triangles)))
    assert all(len(np.unique(upper[cells])) == 1 for cells, _ in panels)
    assert len(panels) > 2
    first = [int(cells[0]) for cells, _ in panels]
    assert first == sorted(first)
