"""Objectives of sections and of shapes up to rigid motion; what measures read off a shape."""

import numpy as np
import pytest
from helpers.scenes import taylor_rates
from mpi4py import MPI
from scipy.spatial.transform import Rotation

from toros_fem import errors
from toros_fem._mpi import dot
from toros_fem.meshes import Skin, bend, compose, contract, cylinder, rectangle, sew, twist
from toros_fem.objectives.alignment import AlignedObjective
from toros_fem.objectives.cross_sections import (
    CrossSectionObjective,
    CrossSections,
    label_cross_sections,
)
from toros_fem.objectives.metrics import Metric, bend_angle, shortening, swelling, twist_angle
from toros_fem.objectives.rotation import axial, best_rotation, polar_rotation
from toros_fem.objectives.shape import Objective, ShapeObjective, SumObjective

LENGTH = 0.06
TARGET = compose(twist(4.0, LENGTH), bend(1.0, LENGTH))


def sections(skin: Skin, turn: float = 1.0) -> CrossSections:
    label = label_cross_sections(skin.pattern, skin.pattern.vertices_of("wall"), (0, 0, 1), 5)
    return CrossSections(label, np.tile([1.0, 2.0, 3.0], (6, 1)), turn * np.arange(1.0, 7.0))


def objectives(skin: Skin) -> dict[str, Objective]:
    rng = np.random.default_rng(0)
    count = len(skin.pattern.points)
    target = TARGET(skin.pattern.points)
    by_section = CrossSectionObjective(skin, target, sections(skin))
    by_component = ShapeObjective(
        skin, target, rng.uniform(0, 1, (count, 3)), rng.uniform(0, 1, count)
    )
    both = SumObjective(by_section, by_component)
    weights = rng.uniform(0, 1, count)
    return {
        "sections": by_section,
        "components": by_component,
        "aligned": AlignedObjective(skin, target, both, weights),
    }


@pytest.mark.parametrize("name", ["sections", "components", "aligned"])
def test_taylor(tube: Skin, comm: MPI.Comm, name: str) -> None:
    objective = objectives(tube)[name]
    rng = np.random.default_rng(1)
    points, owned = tube.pattern.points, tube.owned_vertices
    x = (points + 2e-3 * rng.standard_normal(points.shape))[owned]
    direction = (points[:, [1, 2, 0]] + 1e-3 * rng.standard_normal(points.shape))[owned]
    slope = dot(comm, objective.backward(x).ravel(), direction.ravel())
    first = 0.01 if name == "components" else 0.05
    rates = taylor_rates(lambda h: objective.forward(x + h * direction), slope, first)
    assert rates == pytest.approx(2.0, abs=0.05)


def test_sections_do_not_see_swelling(tube: Skin) -> None:
    """A section scaled about its centre line is where it was, and turned as it was."""
    pattern = tube.pattern
    objective = CrossSectionObjective(tube, TARGET(pattern.points), sections(tube))
    swollen = TARGET(pattern.points * [1.3, 1.3, 1.0])
    none = objective.forward(TARGET(pattern.points)[tube.owned_vertices])
    assert none == pytest.approx(0.0, abs=1e-15)
    small = objective.forward(swollen[tube.owned_vertices])
    plain = objective.forward(pattern.points[tube.owned_vertices])
    assert small < 1e-3 * plain


def test_a_whole_turn_is_not_taken_for_none(tube: Skin) -> None:
    """The tip of a tube twisted by 360° stands as it stood, yet the sections tell them apart."""
    points = tube.pattern.points
    goal = sections(tube)
    only = CrossSections(goal.labels, np.zeros((6, 3)), np.ones(6))
    objective = CrossSectionObjective(tube, twist(2 * np.pi, LENGTH)(points), only)
    values = [
        objective.forward(twist(share * 2 * np.pi, LENGTH)(points)[tube.owned_vertices])
        for share in (-0.2, 0.0, 0.2, 0.6, 1.0)
    ]
    assert all(np.diff(values) < 0)
    assert values[-1] < 1e-6 * values[0]


def test_small_turn_costs_as_documented(tube: Skin) -> None:
    points, angle = tube.pattern.points, 1e-3
    goal = sections(tube)
    turn = np.zeros(6)
    turn[0] = 3.0  # the first section against how it is assembled: the whole tube is turned
    objective = CrossSectionObjective(
        tube, points, CrossSections(goal.labels, np.zeros((6, 3)), turn)
    )
    turned = points @ Rotation.from_rotvec([0, angle, 0]).as_matrix().T
    found = objective.forward(turned[tube.owned_vertices])
    assert found == pytest.approx(0.5 * 3.0 * angle**2, rel=1e-5)


def test_alignment_takes_rigid_motions_out(tube: Skin) -> None:
    points = tube.pattern.points
    target = TARGET(points)
    aligned = AlignedObjective(tube, target, ShapeObjective(tube, target))
    turn = Rotation.from_rotvec([1.0, -2.0, 0.5]).as_matrix()
    moved = (target @ turn.T + [0.1, 0.2, -0.3])[tube.owned_vertices]
    assert aligned.forward(moved) == pytest.approx(0.0, abs=1e-15)
    assert aligned.aligned(moved) == pytest.approx(target[tube.owned_vertices], abs=1e-12)
    plain = points[tube.owned_vertices]
    value = aligned.forward(plain)
    assert aligned.forward(plain @ turn.T + [1.0, 0, 0]) == pytest.approx(value, rel=1e-9)
    assert value <= ShapeObjective(tube, target).forward(plain) * (1 + 1e-12)
    gradient = tube.gather_vertices(aligned.backward(plain))
    assert np.abs(gradient.sum(axis=0)).max() < 1e-12 * np.abs(gradient).sum()
    torque = np.cross(points, gradient).sum(axis=0)
    assert np.abs(torque).max() < 1e-10 * np.abs(np.cross(points, gradient)).sum()


def test_alignment_needs_a_body(tube: Skin) -> None:
    line = tube.pattern.points * [0.0, 0.0, 1.0]
    objective = AlignedObjective(tube, line, ShapeObjective(tube, line))
    with pytest.raises(errors.TargetError, match="lies on a line"):
        objective.forward(line[tube.owned_vertices])


def test_sections_on_a_line_have_no_orientation(comm: MPI.Comm) -> None:
    """Slabs of a flat sheet that hold one row of vertices each; their places may count."""
    pattern = rectangle(comm, 0.06, 0.02, 5e-3)
    skin = sew(comm, pattern)
    label = label_cross_sections(
        pattern, np.arange(len(pattern.points)), (1, 0, 0), 12, border=False
    )
    places, turns = np.ones((12, 3)), np.ones(12)
    with pytest.raises(errors.TargetError, match=r"section 0 .* lies on a line.* Use fewer"):
        CrossSectionObjective(skin, pattern.points, CrossSections(label, places, turns))
    objective = CrossSectionObjective(skin, pattern.points, CrossSections(label, places, 0 * turns))
    moved = (pattern.points + [1e-3, 2e-3, 0])[skin.owned_vertices]
    assert objective.forward(moved) == pytest.approx(0.5 * 12 * 5e-6 / pattern.size**2)
    total = skin.gather_vertices(objective.backward(moved)).sum(axis=0)
    assert total == pytest.approx(12 * np.array([1e-3, 2e-3, 0]) / pattern.size**2)
    body = label_cross_sections(pattern, np.arange(len(pattern.points)), (1, 0, 0), 3, border=False)
    whole = CrossSectionObjective(skin, pattern.points, CrossSections(body, places[:3], turns[:3]))
    crushed = (pattern.points * [1, 0, 0])[skin.owned_vertices]
    for act in (whole.forward, whole.backward):
        with pytest.raises(errors.TargetError, match="section 0 .* lies on a line"):
            act(crushed)


def test_polar_rotation_and_its_derivative() -> None:
    rng = np.random.default_rng(3)
    moments = rng.standard_normal((4, 3, 3))
    rotation, matrix = polar_rotation(moments)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    assert np.einsum("kij,kil->kjl", rotation, rotation) == pytest.approx(
        np.broadcast_to(np.eye(3), (4, 3, 3)), abs=1e-12
    )
    change, h = rng.standard_normal((4, 3, 3)), 1e-6
    plus, minus = (polar_rotation(moments + s * h * change)[0] for s in (1, -1))
    spin = np.asarray(np.swapaxes(rotation, 1, 2) @ (plus - minus) / (2 * h), dtype=np.float64)
    omega = np.linalg.solve(
        matrix, axial(np.swapaxes(rotation, 1, 2) @ change)[:, :, None]
    )[:, :, 0]  # fmt: skip
    assert axial(spin) / 2 == pytest.approx(omega, rel=1e-5)
    turn = Rotation.from_rotvec([0.3, 0.2, -1.0]).as_matrix()
    points = rng.standard_normal((9, 3))
    assert best_rotation(points, points @ turn.T + 1.0) == pytest.approx(turn, abs=1e-12)


@pytest.mark.parametrize("degrees", [-400.0, -90.0, 0.0, 200.0, 540.0])
def test_measured_twist(comm: MPI.Comm, degrees: float) -> None:
    pattern = cylinder(comm, 0.15, 0.02, 4e-3)
    straight = twist(np.radians(degrees), 0.15)(pattern.points)
    assert np.degrees(twist_angle(pattern, straight)) == pytest.approx(degrees, abs=0.1)
    bent = bend(np.radians(120.0), 0.15)(straight)
    assert np.degrees(twist_angle(pattern, bent)) == pytest.approx(degrees, abs=1.0)
    assert np.degrees(bend_angle(pattern, bent)) == pytest.approx(120.0, abs=0.5)


def test_measured_shortening_and_swelling(comm: MPI.Comm) -> None:
    pattern = cylinder(comm, 0.15, 0.02, 4e-3)
    short = contract(0.92, 1.4)(pattern.points)
    assert shortening(pattern, short) == pytest.approx(0.08)
    assert swelling(pattern, short) == pytest.approx(1.4)
    turn = Rotation.from_rotvec([1.0, -2.0, 0.5]).as_matrix()
    assert shortening(pattern, short @ turn.T + 1.0) == pytest.approx(0.08)
    assert swelling(pattern, short @ turn.T + 1.0) == pytest.approx(1.4)


def test_figures_are_written_with_their_units() -> None:
    figure = Metric("twist", "deg", 300.0, twist_angle)
    assert (figure.key, figure.label) == ("twist_deg", "twist in degrees")
    assert figure.formatted(298.7) == "299°"
    with pytest.raises(errors.ParameterError, match="must be identifiers"):
        Metric("two words", "deg", 1.0, twist_angle)


def test_bad_input(comm: MPI.Comm) -> None:
    pattern = cylinder(comm, LENGTH, 0.02, 4.5e-3)
    skin = sew(comm, pattern)
    goal = sections(skin)
    with pytest.raises(errors.ParameterError, match="each needs at least 3"):
        CrossSections(np.array([0, 0, 1]), goal.position_weights[:2], goal.orientation_weights[:2])
    with pytest.raises(errors.ParameterError, match=r"must be \(6, 3\)"):
        CrossSections(goal.labels, goal.position_weights[:2], goal.orientation_weights)
    with pytest.raises(errors.ParameterError, match="not negative"):
        CrossSections(goal.labels, -goal.position_weights, goal.orientation_weights)
    with pytest.raises(errors.ParameterError, match="labels have shape"):
        CrossSectionObjective(
            skin,
            pattern.points,
            CrossSections(goal.labels[:-1], goal.position_weights, goal.orientation_weights),
        )
    with pytest.raises(errors.TargetError, match="the target has shape"):
        CrossSectionObjective(skin, pattern.points[1:], goal)
    with pytest.raises(errors.ParameterError, match="weights have shape"):
        ShapeObjective(skin, pattern.points, np.ones((len(pattern.points), 2)))
