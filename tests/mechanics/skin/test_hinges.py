"""What bends, what does not, and in which shape nothing does."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.scenes import square
from mpi4py import MPI

from toros_fem.materials.sheet import CURVATURES, Bending, Composite, Material
from toros_fem.mechanics.equilibrium.equilibrium import EquilibriumError
from toros_fem.mechanics.equilibrium.newton import NewtonOptions
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Supports, build_in, clamp
from toros_fem.mechanics.terms.model import make_model
from toros_fem.mechanics.terms.sheet import find_hinges
from toros_fem.meshes import Pattern, rectangle, sew
from toros_fem.meshes.pattern import Panel

LENGTH = 0.02
ELASTIC = Material(1e6, 0.0, 0.5e-3)


def sheet(bending: Bending | None) -> Composite:
    """A sheet whose bounds are far from anything here."""
    return Composite(ELASTIC, ELASTIC, c1=1.5, c2=1.5, bending=bending)


def folded() -> Pattern:
    """Two square panels sewn along one side and folded there by 90 degrees."""
    one = square(size=LENGTH)
    upright = one.points[:, [2, 1, 0]] * [1, 1, -1]
    right = Panel("right", one.flat_points, one.flat_triangles, one.points)
    left = Panel("left", one.flat_points - [LENGTH, 0], one.flat_triangles,
                 upright + [0, 0, LENGTH])  # fmt: skip
    return Pattern.from_panels([left, right], tolerance=1e-6)


@pytest.mark.parametrize("curvature", CURVATURES)
def test_a_hinged_seam_folds_freely(alone: MPI.Comm, curvature: str) -> None:
    pattern = folded()
    assert pattern.seam_edges.sum() == 2 * 4, "both sides of four edges"
    fixed = clamp(pattern, ["left", "right"])
    energy = {}
    for seams in ("continuous", "hinged"):
        skin = sew(alone, pattern)
        model = make_model(skin, sheet(Bending(curvature, seams)), fixed)
        model.set_density(np.zeros(len(skin.owned_cells)))
        energy[seams] = model.energy(model.assembled)
    D = ELASTIC.young * ELASTIC.thickness**3 / 12
    edge = LENGTH / 4
    # A fold of a right angle, spread over an edge length: D θ²/2 over that length.
    assert energy["continuous"] == pytest.approx(
        D * (np.pi / 2) ** 2 / 2 * LENGTH / edge, rel=1e-12
    )
    assert energy["hinged"] < 1e-12 * energy["continuous"]


@pytest.mark.parametrize(
    ("degrees", "side"), [(149, 0), (151, -1), (-149, 0), (-151, 1), (175, -1), (180, 1), (-180, 1)]
)
def test_edges_that_are_assembled_steep(alone: MPI.Comm, degrees: float, side: int) -> None:
    """A panel is folded along its middle, of four edges: each is seen from both sides."""
    pattern = square(n=4, size=LENGTH)
    angle, middle = np.radians(180 - abs(degrees)), LENGTH / 2
    points = pattern.points.copy()
    over = np.maximum(points[:, 0] - middle, 0)
    points[:, 0] -= over * (1 + np.cos(angle))
    points[:, 2] += np.sign(degrees) * over * np.sin(angle)
    pattern = replace(pattern, points=points)
    fixed = Supports(np.ones(points.shape, dtype=bool))
    hinges = find_hinges(sew(alone, pattern), Bending(), fixed, 0.3)
    assert set(hinges.side[hinges.side != 0]) == {side} - {0}
    assert np.count_nonzero(hinges.side) == 8 * abs(side)


@pytest.mark.parametrize("curvature", CURVATURES)
def test_poisson_bends_a_free_strip_the_other_way(alone: MPI.Comm, curvature: str) -> None:
    """A free border takes the angle that costs least: rolled up, a sheet is softer along it."""
    bend = 20.0

    def rolled(flat: np.ndarray) -> np.ndarray:
        x, y = flat.T
        return np.column_stack([np.sin(bend * x) / bend, y, (1 - np.cos(bend * x)) / bend])

    # All positions are held, at the rolled ones: only the rotations are free.
    pattern = rectangle(alone, 0.02, 0.02, 2e-3, place=rolled)
    fixed = Supports(np.ones(pattern.points.shape, dtype=bool))
    cloth = Material(1e6, 0.3, 0.5e-3)
    composite = replace(sheet(Bending(curvature)), fabric=cloth, reinforcement=cloth)
    skin = sew(alone, pattern)
    solver = EquilibriumSolver(skin, composite, fixed)
    energy = solver.solve(np.zeros(len(skin.owned_cells)), 0.0).energy
    stretching = replace(composite, bending=None)
    plain = EquilibriumSolver(skin, stretching, fixed).solve(np.zeros(len(skin.owned_cells)), 0.0)
    D = cloth.young * cloth.thickness**3 / 12 / (1 - 0.3**2)
    share = (energy - plain.energy) / (0.5 * D * bend**2 * 0.02**2)
    # The triangles at the rolled ends give up the moment itself, of the others those at the free
    # straight borders ν² of their energy; edges of a mesh with rotations of its own give up more.
    expected = 0.855651 if curvature == "midedge" else 0.9 * (1 - 0.3**2 * 0.1)
    assert share == pytest.approx(expected, rel=1e-5)


def test_forces_that_nothing_can_bear(alone: MPI.Comm) -> None:
    """A strip pulled far beyond what its bounds allow within the steps that are given."""
    pattern = square()
    supports = build_in(pattern, pattern.points[:, 0] < 1e-9)
    skin = sew(alone, pattern)
    solver = EquilibriumSolver(skin, Composite(), supports, NewtonOptions(max_steps=2))
    force = np.zeros(pattern.points.shape)
    force[np.argmax(pattern.points.sum(axis=1))] = [0, 0, 1e9]
    with pytest.raises(EquilibriumError, match="was found at forces of 1e") as caught:
        solver.solve(np.zeros(len(skin.owned_cells)), Load(0.0, force=force))
    assert 0 <= caught.value.result.load_factor < 1
    assert "Pa" not in caught.value.result.reason
