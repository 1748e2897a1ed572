"""Limits of twist and shortening: the homogeneous tube with fibres, and a simulated one."""

import numpy as np
import pytest
import tube_limits_model as model
from drawn_lines import helices
from mpi4py import MPI
from tube_limits_simulated import Case, simulate

from toros_fem import errors
from toros_fem.meshes import Pattern, cylinder
from toros_fem.products.tubes.tube import TubeConfig

PRESSURES = [2e3, 5e3, 15e3]


@pytest.fixture(scope="module")
def prism(comm: MPI.Comm) -> Pattern:
    return cylinder(comm, 0.06, 0.02, 1.5e-3, mesh="structured")


@pytest.mark.parametrize("degrees", [-50, 30, 65])
def test_thin_helices_keep_their_length(degrees: float) -> None:
    angle = np.radians(degrees)
    for state in model.thin_helices(angle, PRESSURES):
        assert state.gradient < 1e-10
        assert state.fibre == pytest.approx(1, abs=1e-10)
        assert state.twist * degrees < 0  # right-handed lines unwind
        assert state.radius > 1
        if degrees > 0:
            twist = model.unstretched_twist(state.radius, state.length, angle)
            assert state.twist == pytest.approx(twist, abs=1e-9)


def test_thin_net_follows_mckibben() -> None:
    """L/L₀ = cos θ/cos θ₀, R/R₀ = sin θ/sin θ₀."""
    angle = np.radians(25)
    for state in model.thin_net(angle, PRESSURES):
        after = np.arccos(state.length * np.cos(angle))
        assert state.radius == pytest.approx(np.sin(after) / np.sin(angle), abs=1e-10)
        assert state.length == pytest.approx(model.unstretched_length(state.radius, angle))
        assert state.gradient < 1e-10
        assert state.fibre == pytest.approx(1, abs=1e-10)
        assert state.shear == 0
        assert after < np.arctan(np.sqrt(2))  # where the volume is largest, 54.7°


def test_membrane_is_the_law() -> None:
    """(1), written in the stretches, at a state that is sheared."""
    s, gradient = TubeConfig(), model.tube(1.3, 1.1, -0.4)
    mu = s.fabric_young / 2 / (1 + s.poisson)
    lam = s.fabric_young * s.poisson / (1 - s.poisson**2)
    a, b = (s.c1 - 1) ** 2, (s.c2 - 1) ** 2
    stretches = np.linalg.svd(gradient, compute_uv=False)
    single = np.log(1 - (stretches - 1) ** 2 / a).sum()
    both = np.log(1 - (stretches.sum() - 2) ** 2 / b)
    expected = -s.thickness * (mu * a * single + lam / 2 * b * both)
    assert model.membrane(gradient, s.fabric_young) == pytest.approx(expected, rel=1e-12)


def test_stripes_become_fibres_or_fabric() -> None:
    """Thinner and stiffer stripes approach fibres; stripes of fabric have no effect."""
    angle = np.radians(50)
    (thin,) = model.thin_helices(angle, [5e3])
    off = []
    for fraction in (1e-2, 1e-3):
        (found,) = model.striped_helices(angle, fraction, [5e3], young=1e3 / fraction * 26e6)
        assert found.gradient < 1e-6  # over the fabric's stiffness
        off.append(abs(found.twist / thin.twist - 1))
    assert off[1] < 0.15 * off[0] < 0.01
    (plain,) = model.striped_helices(angle, 0.3, [5e3], young=TubeConfig().fabric_young)
    assert plain.shear == pytest.approx(0, abs=1e-9)


@pytest.mark.slow
def test_simulated_tube_is_near_the_model() -> None:
    """Coarse, with ends that do not widen: within a quarter of the model, and under it."""
    case, pressures = Case(4, 45, edge=3e-3), [2e3, 5e3]
    rows = simulate(case, pressures)
    angle = np.radians(case.degrees)
    states = model.striped_helices(angle, rows[0]["fraction"], pressures)
    ideal = model.thin_helices(angle, pressures)
    for row, state, bound in zip(rows, states, ideal, strict=True):
        assert 0.75 < row["twist_deg"] / state.twist < 1
        assert abs(state.twist) < abs(bound.twist)


def test_helices_cover_their_fraction_of_the_wall(prism: Pattern) -> None:
    """Lines of width w, n around, at an angle α cover n w / (2πr cos α) of it."""
    wall = prism.cells_of("wall")
    for count, degrees, width in ((2, 20.0, 4e-3), (3, 35.0, 4e-3), (1, -60.0, 5e-3)):
        lines = helices(prism, count, np.radians(degrees), width)
        assert not lines[prism.cells_of("tip")].any()
        covered = prism.areas[wall] @ lines[wall] / prism.areas[wall].sum()
        fraction = count * width / (2 * np.pi * 0.01 * np.cos(np.radians(degrees)))
        assert covered == pytest.approx(fraction, rel=0.1)
    with pytest.raises(errors.ParameterError, match="count = 0"):
        helices(prism, 0, 0.5, 1e-3)


def test_right_handed_helices_rise_as_a_screw_does(prism: Pattern) -> None:
    """Along a line the height grows with the angle around z, counter-clockwise."""
    lines = helices(prism, 1, np.radians(60), 3e-3)
    centre = prism.points[prism.triangles[lines]].mean(axis=1)
    order = np.argsort(centre[:, 2])
    turn = np.unwrap(np.arctan2(centre[order, 1], centre[order, 0]))
    slope = np.polyfit(centre[order, 2], turn, 1)[0]
    assert slope == pytest.approx(np.tan(np.radians(60)) / 0.01, rel=0.1)
