"""A border that is held anywhere in space is closed by itself."""

import numpy as np
import pytest
from helpers.scenes import TABLE_A
from mpi4py import MPI

from toros_fem.base.errors import ParameterError, PatternError
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Supports, symmetry_plane
from toros_fem.meshes import rectangle, sew
from toros_fem.meshes.pattern import Pattern

SIZE, PRESSURE = 0.02, 2e3
MEMBRANE = Composite(fabric=TABLE_A, bending=None)


def film(comm: MPI.Comm, height: float, *, curved: bool = False, half: bool = False) -> Pattern:
    """A square film, or its half with x ≥ 0, on a frame at a height in m."""

    def place(flat: np.ndarray) -> np.ndarray:
        x = flat - [0.0 if half else SIZE / 2, SIZE / 2]
        rise = 30 * x[:, 0] ** 2 if curved else 0 * x[:, 0]
        return np.column_stack([x, rise + height])

    return rectangle(comm, SIZE / 2 if half else SIZE, SIZE, SIZE / 8, "right", place)


def on_its_frame(comm: MPI.Comm, pattern: Pattern, *, half: bool = False) -> EquilibriumSolver:
    frame = np.unique(pattern.free_edges)
    if half:
        inside = (pattern.points[:, 0] < 1e-9) & (np.abs(pattern.points[:, 1]) < SIZE / 2 - 1e-9)
        frame = frame[~inside[frame]]
    fixed = np.zeros(pattern.points.shape, dtype=bool)
    fixed[frame] = True
    supports = Supports(fixed)
    if half:
        supports |= symmetry_plane(pattern, 0)
    return EquilibriumSolver(sew(comm, pattern), MEMBRANE, supports)


def inflated(solver: EquilibriumSolver) -> Equilibrium:
    return solver.solve(np.zeros(len(solver.skin.owned_cells)), PRESSURE)


@pytest.mark.parametrize("curved", [False, True])
def test_a_film_is_the_same_at_any_height(comm: MPI.Comm, curved: bool) -> None:
    """Shape and volume; and the frame holds what the pressure does to the film alone."""
    low, high = (on_its_frame(comm, film(comm, z, curved=curved)) for z in (0.0, 5e-3))
    at_low, at_high = inflated(low), inflated(high)
    raised = high.skin.gather_vertices(at_high.positions) - [0, 0, 5e-3]
    assert raised == pytest.approx(low.skin.gather_vertices(at_low.positions), abs=1e-9)
    assert at_high.volume == pytest.approx(at_low.volume, rel=1e-7)
    for solver, found in ((low, at_low), (high, at_high)):
        pull = solver.reactions(found).sum(axis=0)
        assert pull == pytest.approx([0, 0, -PRESSURE * SIZE**2], abs=1e-8)


def test_half_a_film(comm: MPI.Comm) -> None:
    """Its rim runs from plane to plane; half of the whole film's volume lies above it."""
    whole = inflated(on_its_frame(comm, film(comm, 5e-3, curved=True)))
    solver = on_its_frame(comm, film(comm, 5e-3, curved=True, half=True), half=True)
    half = inflated(solver)
    assert half.volume == pytest.approx(whole.volume / 2, rel=0.03)
    pull = solver.reactions(half).sum(axis=0)
    assert pull[2] == pytest.approx(-PRESSURE * SIZE**2 / 2, rel=1e-9)


def test_the_volume_follows_a_frame_that_moves(comm: MPI.Comm) -> None:
    """Moved as a whole, out of any plane, the film stays as it is."""
    solver = on_its_frame(comm, film(comm, 5e-3))
    first = inflated(solver)
    way = np.tile([1e-3, -2e-3, 4e-3], (len(solver.skin.pattern.points), 1))
    moved = solver.solve(first.density, Load(PRESSURE, displacement=way), first)
    assert moved.volume == pytest.approx(first.volume, rel=1e-7)
    assert moved.energy == pytest.approx(first.energy, rel=1e-7)
    # A frame in a plane through the origin is closed by the plane, and stays in it.
    flat = on_its_frame(comm, film(comm, 0.0))
    with pytest.raises(ParameterError, match="assemble it elsewhere"):
        flat.solve(first.density, Load(PRESSURE, displacement=way))


def test_a_frame_that_is_partly_free_closes_nothing(comm: MPI.Comm) -> None:
    pattern = film(comm, 5e-3)
    frame = np.unique(pattern.free_edges)
    fixed = np.zeros(pattern.points.shape, dtype=bool)
    fixed[frame[1:]] = True
    solver = EquilibriumSolver(sew(comm, pattern), MEMBRANE, Supports(fixed))
    with pytest.raises(PatternError, match="hold the whole border"):
        inflated(solver)


def test_a_rim_belongs_to_one_chamber(comm: MPI.Comm) -> None:
    pattern = film(comm, 5e-3)
    fixed = np.zeros(pattern.points.shape, dtype=bool)
    fixed[np.unique(pattern.free_edges)] = True
    side = (pattern.points[pattern.triangles].mean(axis=1)[:, 0] > 0).astype(np.int64)
    chambers = Chambers(("left", "right"), side)
    with pytest.raises(ParameterError, match="borders the chambers left and right"):
        EquilibriumSolver(sew(comm, pattern), MEMBRANE, Supports(fixed), chambers=chambers)
