"""Coulomb's law at vertices: its derivatives, the library's law, and what a step leaves behind."""

import numpy as np
import pytest
from kit.slopes import slope

from toros_fem.base.validation import Floats
from toros_fem.mechanics.contact.sliding import Coulomb

LAW = Coulomb(0.6, 1e-4)
PADS = Coulomb(0.8, 1e-4, 0.25, (1.0, 0.4, 0.2))
NUMBERS = np.random.default_rng(0)
NORMAL = NUMBERS.standard_normal((40, 3))
# Half of them stick, half slide.
MOTION = NUMBERS.standard_normal((40, 3)) * 1e-4 * np.repeat([0.3, 3.0], 20)[:, None]


@pytest.mark.parametrize("law", [LAW, PADS], ids=["Coulomb", "pads"])
@pytest.mark.parametrize(("of", "by"), [("energy", "force"), ("force", "stiffness")])
def test_derivatives_by_the_motion(law: Coulomb, of: str, by: str) -> None:
    rng = np.random.default_rng(1)
    along = rng.standard_normal(MOTION.shape) * 1e-8
    slopes = np.einsum("i...j,ij->i...", getattr(law.at(NORMAL, MOTION), by)(), along)
    weights = rng.standard_normal(slopes.shape)

    def value(step: float) -> float:
        moved = law.at(NORMAL, MOTION + step * along)
        return float((weights * getattr(moved, of)()).sum())

    wide = np.abs(weights * slopes).sum()
    assert (weights * slopes).sum() == pytest.approx(slope(value), abs=1e-7 * wide)


def test_derivative_by_the_normal_force() -> None:
    rng = np.random.default_rng(1)
    along = rng.standard_normal(NORMAL.shape) * 1e-4
    slopes = np.einsum("ijk,ik->ij", LAW.at(NORMAL, MOTION).force_by_normal(), along)
    weights = rng.standard_normal(slopes.shape)

    def value(step: float) -> float:
        return float((weights * LAW.at(NORMAL + step * along, MOTION).force()).sum())

    wide = np.abs(weights * slopes).sum()
    assert (weights * slopes).sum() == pytest.approx(slope(value), abs=1e-7 * wide)


@pytest.mark.parametrize("law", [LAW, PADS], ids=["Coulomb", "pads"])
def test_the_stiffness_has_no_negative_part(law: Coulomb) -> None:
    for matrix in law.at(NORMAL, MOTION).stiffness():
        assert np.allclose(matrix, matrix.T)
        assert np.linalg.eigvalsh(matrix).min() > -1e-9 * np.abs(matrix).max()


@pytest.mark.parametrize("law", [LAW, PADS], ids=["Coulomb", "pads"])
def test_no_motion_and_no_normal_force_are_regular(law: Coulomb) -> None:
    nothing = np.zeros((1, 3))
    for normal, motion in ((NORMAL[:1], nothing), (nothing, MOTION[:1]), (nothing, nothing)):
        for name in ("energy", "force", "elastic"):
            assert not getattr(law.at(normal, motion), name)().any()
        for name in ("stiffness", "force_by_normal"):
            assert np.isfinite(getattr(law.at(normal, motion), name)()).all()
    assert np.linalg.norm(law.at(NORMAL[:1], nothing).stiffness()) > 0


def test_as_the_library_of_contact_has_it() -> None:
    """Vertices over a plane: force and its derivative, with the normal force as it changes."""
    ipctk = pytest.importorskip("ipctk")
    size, thickness, distance = 12, 5e-4, 1e-4
    normal = np.array([0.1, 0.2, 1.0]) / np.linalg.norm([0.1, 0.2, 1.0])
    across = np.linalg.qr(normal[:, None], "complete")[0][:, 1:]
    rng = np.random.default_rng(3)
    points = rng.uniform(0, 1e-2, (size, 2)) @ across.T
    points += normal * (thickness + distance * rng.uniform(0.3, 0.9, (size, 1)))
    mesh = ipctk.CollisionMesh(points)
    mesh.planes = [ipctk.Hyperplane(normal, np.zeros(3))]
    barrier = ipctk.BarrierPotential(distance, 1e6, True)
    near = ipctk.Candidates()
    near.build(mesh, points, thickness + distance)
    touching = ipctk.NormalCollisions()
    touching.use_area_weighting = True
    touching.build(near, mesh, points, distance, thickness)
    pairs = ipctk.TangentialCollisions()
    pairs.build(mesh, points, touching, barrier, LAW.friction)
    assert len(pairs) == size
    potential = ipctk.FrictionPotential(LAW.slip)
    motion = MOTION[14 : 14 + size]
    pushed = -barrier.gradient(touching, mesh, points).reshape(-1, 3)
    assert np.linalg.norm(pushed, axis=1).min() > 0
    force = potential.gradient(pairs, mesh, motion).reshape(-1, 3)
    assert LAW.at(pushed, motion).force() == pytest.approx(force, rel=1e-9)
    assert LAW.at(pushed, motion).energy().sum() - potential(pairs, mesh, motion) == pytest.approx(
        -LAW.slip / 3 * LAW.friction * np.linalg.norm(pushed, axis=1).sum(), rel=1e-9
    ), "the library's energy of no motion is a third of the slip"
    stiffness = potential.hessian(pairs, mesh, motion).toarray()
    own = LAW.at(pushed, motion).stiffness()
    for k in range(size):
        block = slice(3 * k, 3 * k + 3)
        assert own[k] == pytest.approx(stiffness[block, block], rel=1e-6, abs=1e-6 * own[k].max())
    by_position = potential.force_jacobian(
        pairs, mesh, points, np.zeros_like(points), motion, barrier,
        ipctk.FrictionPotential.DiffWRT.LAGGED_DISPLACEMENTS, thickness,
    ).toarray()  # fmt: skip
    curvature = barrier.hessian(touching, mesh, points).toarray()
    by_normal = LAW.at(pushed, motion).force_by_normal()
    for k in range(size):
        block = slice(3 * k, 3 * k + 3)
        mine = by_normal[k] @ curvature[block, block]  # dN = − Hessian dx, and force = − gradient
        assert mine == pytest.approx(by_position[block, block], abs=1e-6 * np.abs(mine).max())


@pytest.mark.parametrize("steps", [1, 3, 40])
def test_forces_do_not_depend_on_the_number_of_steps(steps: int) -> None:
    """There, beyond the slip, and a part of the way back."""
    normal = np.array([[0.0, 0.0, 2.0]])
    anchor: Floats = np.zeros((1, 3))
    place: Floats = anchor
    for begin, end in ((0.0, 5e-4), (5e-4, 4.6e-4)):
        for x in np.linspace(begin, end, steps + 1)[1:]:
            place = np.array([[x, 0.0, 0.0]])
            force = LAW.at(normal, place - anchor).force()[0, 0]
            anchor = place - LAW.at(normal, place - anchor).elastic()
    left = 0.6  # of the slip: a part 0.4 of it has gone back
    assert force == pytest.approx(LAW.friction * 2.0 * (2 - left) * left, rel=1e-9)
