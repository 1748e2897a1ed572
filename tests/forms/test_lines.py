"""Line families: energy by hand, closed forms against `ufl.derivative` and differences."""

import itertools

import numpy as np
import pytest
from helpers.expressions import number
from helpers.models import SIZE, affine, line_design, relaxed_model
from helpers.scenes import square
from mpi4py import MPI

from toros_fem.forms.lines import (
    Family,
    bending_of_lines,
    fabric_factor,
    stretching_energy,
)
from toros_fem.materials.sheet import Bending, Composite, Material
from toros_fem.mechanics.skin.designs import CROSSING
from toros_fem.mechanics.skin.supports import Supports, clamp
from toros_fem.meshes import cylinder, sew

SHARES, ANGLES = np.array([0.1, 0.3, 0.2]), np.array([0.3, -1.1, 2.0])


def family(angle: float, stretching: float, bending: float = 0, twisting: float = 0) -> Family:
    return Family(np.cos(2 * angle), np.sin(2 * angle), stretching, bending, twisting)


def length(F: np.ndarray, angle: float) -> float:
    return float(np.linalg.norm(F @ [np.cos(angle), np.sin(angle)]))


def test_factor_of_the_fabric_by_the_double_sum() -> None:
    cover, crossings = SHARES.sum(), 0.0
    for j, k in itertools.combinations(range(3), 2):
        crossings += cover * SHARES[j] * SHARES[k] * np.sin(ANGLES[j] - ANGLES[k]) ** 4
    found = fabric_factor(list(SHARES), list(np.cos(2 * ANGLES)), list(np.sin(2 * ANGLES)), 260.0)
    assert found == pytest.approx(1 / (1 - cover) + 260 * crossings, rel=1e-14)
    parallel = np.full(3, 0.7)
    found = fabric_factor(
        list(SHARES), list(np.cos(2 * parallel)), list(np.sin(2 * parallel)), 260.0
    )
    assert found == pytest.approx(1 / (1 - cover), rel=1e-13), "parallel lines do not cross"


def test_factor_of_a_family_in_two_parts() -> None:
    """Where two families have one direction, only the sum of their shares counts."""
    whole, parts = np.array([0.25, 0.3]), np.array([0.1, 0.15, 0.3])
    angles = np.array([0.2, 0.2, 1.3])
    values = [
        fabric_factor(list(shares), list(np.cos(2 * t)), list(np.sin(2 * t)), 260.0)
        for shares, t in ((whole, angles[1:]), (parts, angles))
    ]
    assert values[0] == pytest.approx(values[1], rel=1e-13)
    crossings = (0.25**2 * 0.3 + 0.3**2 * 0.25) * np.sin(1.1) ** 4
    assert values[0] == pytest.approx(1 / 0.45 + 260 * crossings, rel=1e-13)


def test_energy_in_tension_and_compression() -> None:
    F = np.array([[1.3, 0.2], [-0.1, 0.7], [0.2, 0.1]])
    families = [family(t, k) for t, k in zip(ANGLES, (2.0, 3.0, 5.0), strict=True)]
    expected = sum(
        k / 2 * (length(F, t) - 1) ** 2 for t, k in zip(ANGLES, (2.0, 3.0, 5.0), strict=True)
    )
    assert min(length(F, t) for t in ANGLES) < 1 < max(length(F, t) for t in ANGLES)
    C = F.T @ F
    found = stretching_energy(families, [C[0, 0], C[1, 1], C[0, 1]])
    assert number(found) == pytest.approx(expected, rel=1e-13)


def test_stiffness_of_lines_that_bend_and_twist() -> None:
    Lambda = np.array([[3.0, 0.5], [0.5, -2.0]])
    families = [family(t, 0.0, 7.0, 2.0 + t) for t in ANGLES]
    expected = 0.0
    for t in ANGLES:
        d, n = np.array([np.cos(t), np.sin(t)]), np.array([-np.sin(t), np.cos(t)])
        expected += 7.0 * (d @ Lambda @ d) ** 2 + (2.0 + t) * (d @ Lambda @ n) ** 2
    found = bending_of_lines(families, [3.0, -2.0, 0.5])
    assert number(found) == pytest.approx(expected / 2, rel=1e-13)


def test_energy_of_a_sheet_by_hand(alone: MPI.Comm) -> None:
    """Any design and any affine deformation: eq. (1) with its factor, and the lines."""
    pattern = square(size=SIZE)
    fixed = np.zeros(pattern.points.shape, dtype=bool)
    fixed[[0, 1, 10]] = True
    skin = sew(alone, pattern)
    composite = Composite(bending=None)
    model = relaxed_model(skin, composite, Supports(fixed), 3)
    F = np.array([[1.2, 0.15], [-0.1, 0.8], [0.2, 0.1]])
    design = line_design(skin, 3, 2)
    model.set_density(design)
    strains = np.linalg.svd(F, compute_uv=False) - 1
    a, b = (composite.c1 - 1) ** 2, (composite.c2 - 1) ** 2
    fabric, printed = composite.fabric, composite.reinforcement
    ratio = printed.membrane_stiffness / fabric.membrane_stiffness
    expected = 0.0
    for row, area in zip(design, pattern.areas[skin.owned_cells], strict=True):
        shares, t = row[1:4], np.arctan2(row[7:], row[4:7]) / 2
        crossings = shares.sum() * sum(
            shares[j] * shares[k] * np.sin(t[j] - t[k]) ** 4
            for j, k in itertools.combinations(range(3), 2)
        )
        factor = 1 / (1 - shares.sum()) + CROSSING * ratio * crossings
        thicker = printed.thickness / fabric.thickness
        mu, lam = (fabric.mu * (1 - row[0]) + row[0] * thicker * printed.mu,
                   fabric.lam * (1 - row[0]) + row[0] * thicker * printed.lam)  # fmt: skip
        psi = -mu * a * np.log(1 - strains**2 / a).sum()
        psi -= lam / 2 * b * np.log(1 - strains.sum() ** 2 / b)
        lines = sum(s / 2 * (length(F, angle) - 1) ** 2 for s, angle in zip(shares, t, strict=True))
        expected += area * (fabric.thickness * factor * psi + printed.membrane_stiffness * lines)
    expected = alone.allreduce(expected)
    assert model.energy(affine(model, F)) == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize("angle", [0.0, 0.6, np.pi / 2])
def test_bending_of_lines_on_a_rolled_sheet(alone: MPI.Comm, angle: float) -> None:
    """One hinge of 2π/n a triangle: lines bend with cos² of their angle to the hoop, and twist."""
    pattern = cylinder(alone, 0.06, 0.02, 4e-3, mesh="structured", caps=None)
    # Without Poisson's ratio the free ends of the prism want no other angle than they have.
    cloth, strip = Material(0.1e6, 0.0, 0.5e-3), Material(26e6, 0.0, 0.4e-3)
    skin = sew(alone, pattern)
    composite = Composite(fabric=cloth, reinforcement=strip, bending=Bending("average"))
    supports = clamp(pattern, ["wall"])
    sides = round(np.pi * 0.02 / 4e-3)
    bend = 2 * np.pi / (sides * 0.02 * np.sin(np.pi / sides))
    values = []
    for share in (0.0, 0.4):
        model = relaxed_model(skin, composite, supports, 1)
        row = [0.0, share, np.cos(2 * angle), np.sin(2 * angle)]
        model.set_density(np.tile(row, (len(skin.owned_cells), 1)))
        values.append(model.energy(model.assembled))
    h, half = strip.thickness, pattern.areas.sum() / 2
    fabric = cloth.thickness**3 / 12 * cloth.young * bend**2
    along, across = bend * np.cos(angle) ** 2, bend * np.cos(angle) * np.sin(angle)
    lines = strip.young * h**3 / 12 * along**2 + strip.mu * h**3 / 3 * across**2
    assert values[0] == pytest.approx(half * fabric, rel=1e-9)
    assert values[1] == pytest.approx(half * (fabric / 0.6 + 0.4 * lines), rel=1e-9)
