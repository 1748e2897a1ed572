"""Barriers of a skin, half-spaces and bodies: what each pushes, and the toolkit's half-space."""

import numpy as np
import pytest
from helpers.scenes import square
from kit.slopes import slope

from toros_fem.mechanics.contact.barrier import Barrier, HalfSpacePairs
from toros_fem.mechanics.contact.bodies import FreeBodies, Ground
from toros_fem.mechanics.contact.layers import ContactSizes
from toros_fem.mechanics.contact.solids import rigid_box

SIZES = ContactSizes(5e-4, 1e-4, 1e6, 1e-4)
# Faces of the sheet at z = 0 are half a thickness away from its middle surface.
FACE = SIZES.thickness / 2
GROUNDS = [
    Ground((0.0, 0.0, -6e-5 - FACE)),
    Ground((-5e-5 - FACE, 0.0, 0.0), (1.0, 0.0, 0.0)),
]


@pytest.fixture(scope="module")
def corner() -> tuple[Barrier, Barrier, np.ndarray]:
    """A sheet in the corner of two half-spaces, below one box and above another.

    Its barrier by sides, that of all pairs together, and the vertices.
    """
    pytest.importorskip("ipctk")
    sheet = square(n=4)
    below = rigid_box("below", (6e-3, 6e-3, 2e-3), (0.011, 0.009, -1e-3 - FACE - 6e-5))
    above = rigid_box("above", (6e-3, 6e-3, 2e-3), (0.006, 0.012, 1e-3 + FACE + 7e-5))
    turn = np.array([0.0, 0.0, 0.0, 1e-3, 2e-3, 0.3])  # no edges in parallel
    bodies = FreeBodies([below.moved(turn), above.moved(turn)], SIZES.thickness)
    fixed = np.zeros(len(sheet.points), dtype=bool)
    parted, whole = (
        Barrier(sheet, GROUNDS, bodies, SIZES, fixed, self_contact=True, by_side=by_side)
        for by_side in (True, False)
    )
    places = np.concatenate([sheet.points, bodies.vertices(np.zeros((2, 6)))])
    return parted, whole, np.asfortranarray(places)


def test_sides_make_up_the_whole_push(corner: tuple[Barrier, Barrier, np.ndarray]) -> None:
    parted, whole, places = corner
    pushes, count = parted.normals(places), 25
    assert (np.linalg.norm(pushes.sum(axis=1), axis=1) > 1e-3).all()
    gradient = whole.gradient(places)
    near = pytest.approx(gradient, abs=1e-9 * np.abs(gradient).max())
    assert parted.gradient(places) == near
    assert -pushes.sum(axis=0) == pytest.approx(gradient[:count], abs=1e-9 * np.abs(pushes).max())
    assert (pushes[0, :, 2] >= 0).all()
    assert not pushes[0, :, :2].any()
    assert not pushes[1, :, 1:].any()
    owners = np.repeat([0, 1, 2], [count, *2 * [(len(places) - count) // 2]])
    for body in (1, 2):  # action and reaction
        every = -parted.sides[1 + body].gradient(places)
        assert every.sum(axis=0) == pytest.approx(0, abs=1e-12 * np.abs(pushes).max())
        assert not every[(owners > 0) & (owners != body)].any()


def test_sides_and_all_pairs_together_have_one_energy(
    corner: tuple[Barrier, Barrier, np.ndarray],
) -> None:
    parted, whole, places = corner
    assert parted.energy(places) == pytest.approx(whole.energy(places), rel=1e-12)
    assert parted.count(places) == whole.count(places)
    assert parted.gap(places) == pytest.approx(whole.gap(places), rel=1e-12)
    for name in ("hessian", "near"):
        one, other = (getattr(barrier, name)(places) for barrier in (parted, whole))
        assert abs(one - other).max() < 1e-9 * abs(other).max()
    down = np.zeros_like(places)
    down[:25, 2] = -1e-3
    assert parted.largest_step(places, down) == pytest.approx(whole.largest_step(places, down))


def test_pushes_forward_and_backward(corner: tuple[Barrier, Barrier, np.ndarray]) -> None:
    parted, _, places = corner
    rng = np.random.default_rng(0)
    motion, weights = rng.standard_normal(places.shape), rng.standard_normal((4, 25, 3))
    expected = slope(lambda h: (parted.normals(places + h * motion) * weights).sum(), 1e-8)
    parted.normals_change(places + 1e-6 * motion, motion)  # what was known elsewhere is not used
    change = parted.normals_change(places, motion)
    assert (change * weights).sum() == pytest.approx(expected, rel=1e-6)
    back = parted.normals_backward(places, weights)
    assert (back * motion).sum() == pytest.approx((change * weights).sum(), rel=1e-12)


def test_a_half_space_has_the_barrier_of_the_toolkit() -> None:
    ipctk = pytest.importorskip("ipctk")
    heights = SIZES.distance * np.linspace(0.05, 1.1, 22)
    normal = np.array([0.2, -0.3, 1.0]) / np.linalg.norm([0.2, -0.3, 1.0])
    points = np.asfortranarray(np.outer(heights, normal))
    areas = 1e-6 * np.linspace(1, 2, len(points))
    ground = Ground(tuple(-FACE * normal), tuple(normal))
    found = HalfSpacePairs(ground, np.arange(len(points)), areas, SIZES)

    mesh = ipctk.CollisionMesh(points)
    mesh.vertex_areas = areas
    mesh.planes = [ipctk.Hyperplane(normal, np.zeros(3))]
    candidates, pairs = ipctk.Candidates(), ipctk.NormalCollisions()
    pairs.use_area_weighting = True
    every = range(len(points))
    candidates.pv_candidates = [ipctk.PlaneVertexCandidate(mesh.planes[0], k) for k in every]
    pairs.build(candidates, mesh, points, SIZES.distance, 0.0)
    potential = ipctk.BarrierPotential(SIZES.distance, SIZES.stiffness, True)

    assert found.count(points) == len(pairs)
    assert found.energy(points) == pytest.approx(potential(pairs, mesh, points), rel=1e-9)
    gradient = potential.gradient(pairs, mesh, points).reshape(-1, 3)
    assert found.gradient(points) == pytest.approx(gradient, rel=1e-9, abs=1e-12)
    method = ipctk.PSDProjectionMethod
    for definite, projection in ((False, method.NONE), (True, method.CLAMP)):
        expected = potential.hessian(pairs, mesh, points, projection).toarray()
        second = found.hessian(points, definite=definite).toarray()
        assert second == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.abs(expected).max())
    points[3] -= 2 * SIZES.distance * normal
    assert found.energy(points) == np.inf
    assert found.crossed(points)
