"""Knitted fabric: exact off-axis tension, what is printed, panels, halves, refinement."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.models import SIZE, affine, bent_tube, line_design, pressurize, relaxed_model
from helpers.scenes import square
from helpers.standing import model_on_base
from mpi4py import MPI
from scipy.optimize import minimize, root

from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import norm, total
from toros_fem.materials.sheet import Bending, Composite, Knit, Material, Threads
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Supports, clamp
from toros_fem.mechanics.terms.model import SkinModel, make_model
from toros_fem.mechanics.terms.periodic import Periodic
from toros_fem.meshes import Skin, cylinder, sew
from toros_fem.meshes.tiles import tile
from toros_fem.products.tiles.stiffness_profile import tile_solver

RATIO = 3.0


MEMBRANE = Composite(bending=None)


def density_and_stress(F: np.ndarray, angle: float, k: float) -> tuple[float, np.ndarray]:
    """Energy per flat area of the default fabric with fibres, and its derivative by F (2 × 2)."""
    material, d = MEMBRANE.fabric, np.array([np.cos(angle), np.sin(angle)])
    mu, lam = (material.thickness * value for value in (material.mu, material.lam))
    a, b = (MEMBRANE.c1 - 1) ** 2, (MEMBRANE.c2 - 1) ** 2
    left, stretches, right = np.linalg.svd(F)
    e, total_strain = stretches - 1, stretches.sum() - 2
    length = np.linalg.norm(F @ d)
    energy = -mu * a * np.log(1 - e**2 / a).sum() - lam / 2 * b * np.log(1 - total_strain**2 / b)
    by_stretch = 2 * mu * e / (1 - e**2 / a) + lam * total_strain / (1 - total_strain**2 / b)
    fibres = k * (1 - 1 / length) * np.outer(F @ d, d)
    return energy + k / 2 * (length - 1) ** 2, left @ np.diag(by_stretch) @ right + fibres


def course_stiffness(composite: Composite) -> float:
    course = composite.threads[0]
    assert course is not None
    return course.stiffness


def knitted(angle: float) -> Composite:
    return replace(MEMBRANE, knit=Knit(RATIO, angle))


def free_across(stretch: float, angle: float) -> tuple[np.ndarray, float]:
    """F and nominal stress in N/m of a sheet pulled along x that may narrow and shear freely."""
    k = course_stiffness(knitted(angle))

    def value(free: np.ndarray) -> tuple[float, np.ndarray]:
        F = np.array([[stretch, free[0]], [0.0, free[1]]])
        if np.linalg.det(F) <= 0 or np.abs(np.linalg.svd(F)[1] - 1).max() > 0.9:
            return np.inf, np.zeros(2)
        energy, stress = density_and_stress(F, angle, k)
        return energy, stress[:, 1]

    near = minimize(value, [0.0, 0.95], jac=True, method="BFGS").x
    # The energy is flat to half the digits; its slope is not.
    found = root(lambda free: value(free)[1], near, tol=1e-13).x
    assert found == pytest.approx(near, abs=1e-4)
    F = np.array([[stretch, found[0]], [0.0, found[1]]])
    stress = density_and_stress(F, angle, k)[1]
    assert np.abs(stress[:, 1]).max() < 1e-11  # N/m
    return F, float(stress[0, 0])


@pytest.mark.parametrize("degrees", [0, 15, 30, 45, 60, 90])
def test_off_axis_tension_of_a_tile(alone: MPI.Comm, degrees: float) -> None:
    """Free lateral stretch and free shear against the minimum of the energy density."""
    angle = np.radians(degrees)
    made = tile(alone, (0.01, 0.01), 2.5e-3, "crossed")
    skin = sew(alone, made.pattern)
    solver = tile_solver(skin, knitted(angle), Periodic(made))
    for stretch in (0.9, 1.3):
        gradient = np.array([[stretch, 0], [0, 1], [0, 0]])
        state = solver.solve(np.zeros(len(skin.owned_cells)), Load(gradient=gradient))
        expected, stress = free_across(stretch, angle)
        images = solver.model.images
        assert images.mean_gradient(state.state)[:2] == pytest.approx(expected, abs=1e-6)
        force = images.mean_force(solver.model.variation(state.state))[0, 0] / 1e-4  # m²
        assert force == pytest.approx(stress, rel=1e-6)


def test_moduli_at_small_strain() -> None:
    along, across = knitted(0.0).moduli
    h = MEMBRANE.fabric.thickness
    assert free_across(1 + 1e-5, 0.0)[1] == pytest.approx(1e-5 * along * h, rel=1e-4)
    assert free_across(1 + 1e-5, np.pi / 2)[1] == pytest.approx(1e-5 * across * h, rel=1e-4)
    assert along / across == pytest.approx(RATIO, rel=1e-14)
    assert MEMBRANE.moduli == (0.1e6, 0.1e6)
    assert MEMBRANE.threads == (None, None)


def test_threads_that_stiffen_and_shear(alone: MPI.Comm) -> None:
    """Energy of a sheet under a uniform gradient, by hand; courses and wales change places."""
    skin, F, angle = sew(alone, square(size=SIZE)), np.array([[1.3, 0.2], [-0.1, 0.9]]), 0.7
    fixed = np.zeros((len(skin.pattern.points), 3), dtype=bool)
    fixed[[0, 1, 10]] = True
    course, wale, shear = Threads(40.0, 0.3), Threads(15.0, 0.5), 6.0
    gradient = np.vstack([F, [0.0, 0.0]])

    def energy(knit: Knit | None) -> float:
        model = make_model(skin, replace(MEMBRANE, knit=knit), Supports(fixed))
        model.set_density(np.zeros(len(skin.owned_cells)))
        return model.energy(affine(model, gradient)) / SIZE**2

    d, n = (np.array([np.cos(at), np.sin(at)]) for at in (angle, angle + np.pi / 2))
    expected = shear / 2 * (F @ d @ (F @ n)) ** 2
    for way, threads in ((d, course), (n, wale)):
        strain = np.linalg.norm(F @ way) - 1
        k, s = threads.stiffness, float(threads.strain)
        expected += k / 2 * s**2 * np.expm1((strain / s) ** 2)
    full = energy(Knit(grain=angle, course=course, wale=wale, shear=shear))
    assert full - energy(None) == pytest.approx(expected, rel=1e-10)
    turned = energy(Knit(grain=angle - np.pi / 2, course=wale, wale=course, shear=shear))
    assert turned == pytest.approx(full, rel=1e-12)
    # Over a large strain they hardly stiffen.
    loose, plain = (energy(Knit(course=Threads(40.0, s))) for s in (100.0, None))
    assert loose == pytest.approx(plain, rel=1e-5)
    with pytest.raises(ParameterError, match="both say how stiff the courses"):
        Knit(2.0, course=course)


@pytest.fixture(scope="module")
def pair(short_tube: Skin) -> list[SkinModel]:
    """The tube with bending, of knitted and of isotropic fabric."""
    models = []
    for knit in (Knit(RATIO, 0.4), None):
        composite = Composite(knit=knit)
        model = model_on_base(short_tube, composite)
        pressurize(model, 2e3)
        models.append(model)
    return models


def test_printed_fabric_stays_what_it_is(pair: list[SkinModel], alone: MPI.Comm) -> None:
    """And between both, stiffness is linear in the density."""
    state, cells = bent_tube(pair[0]), len(pair[0].skin.owned_cells)
    gaps = []
    for density in (1.0, 0.25, 0.0):
        residuals = []
        for model in pair:
            model.set_density(np.full(cells, density))
            residuals.append(model.residual(state))
        gaps.append(residuals[0] - residuals[1])
        moduli = [model.mean_modulus() for model in pair]
        added = (1 - density) * course_stiffness(pair[0].composite)
        assert moduli[0] - moduli[1] == pytest.approx(added, rel=1e-9, abs=1e-9)
    scale = norm(alone, gaps[2])
    assert scale > 0
    assert norm(alone, gaps[0]) < 1e-10 * scale
    assert norm(alone, gaps[1] - 0.75 * gaps[2]) < 1e-10 * scale


def test_courses_bend(alone: MPI.Comm) -> None:
    """A sheet rolled around a tube: k h²/12 more along its courses, nothing across them."""
    pattern = cylinder(alone, 0.06, 0.02, 4e-3, mesh="structured", caps=None)
    # Without Poisson's ratio the free ends of the prism want no other angle than they have.
    cloth, strip = Material(0.1e6, 0.0, 0.5e-3), Material(26e6, 0.0, 0.5e-3)
    plain = Composite(fabric=cloth, reinforcement=strip, bending=Bending("average"))
    skin, energies = sew(alone, pattern), []
    for knit in (None, Knit(RATIO), Knit(RATIO, np.pi / 2)):
        model = make_model(skin, replace(plain, knit=knit), clamp(pattern, ["wall"]))
        model.set_density(np.zeros(len(skin.owned_cells)))
        energies.append(model.energy(model.assembled))
    assert energies[1] == pytest.approx(RATIO * energies[0], rel=1e-9)
    assert energies[2] == pytest.approx(energies[0], rel=1e-9)


def test_lines_on_a_knit(alone: MPI.Comm) -> None:
    """The gaps between the lines take the stretch of the courses too."""
    pattern = square(size=SIZE)
    fixed = np.zeros(pattern.points.shape, dtype=bool)
    fixed[[0, 1, 10]] = True
    skin, angle = sew(alone, pattern), 0.7
    F = np.array([[1.2, 0.15], [-0.1, 0.8], [0.2, 0.1]])
    design, energies, moduli = line_design(skin, 2, 2), [], []
    for composite in (knitted(angle), MEMBRANE):
        model = relaxed_model(skin, composite, Supports(fixed), 2)
        model.set_density(design)
        energies.append(model.energy(affine(model, F)))
        moduli.append(model.mean_modulus())
    part = (1 - design[:, 0]) / (1 - design[:, 1:3].sum(axis=1)) * pattern.areas[skin.owned_cells]
    k = course_stiffness(knitted(angle)) * total(alone, part.sum())
    stretch = np.linalg.norm(F @ [np.cos(angle), np.sin(angle)])
    assert energies[0] - energies[1] == pytest.approx(k / 2 * (stretch - 1) ** 2, rel=1e-9)
    assert moduli[0] - moduli[1] == pytest.approx(k / SIZE**2, rel=1e-9)


def test_refinement_keeps_the_grain(alone: MPI.Comm) -> None:
    """A strip pulled across its courses, as told by panel, is affine, on a finer mesh too."""
    pattern = square(n=3, size=SIZE)
    points = pattern.points
    fixed = np.zeros(points.shape, dtype=bool)
    fixed[:, 2], fixed[0, 1] = True, True
    pulled = points[:, 0] > SIZE * (1 - 1e-9)
    fixed[(points[:, 0] < 1e-9) | pulled, 0] = True
    supports = Supports(fixed, displacement=np.where(pulled[:, None], [0.2 * SIZE, 0, 0], 0))
    skin = sew(alone, pattern)
    composite = replace(MEMBRANE, knit=Knit(RATIO, {pattern.panel_names[0]: np.pi / 2}))
    solver = EquilibriumSolver(skin, composite, supports)
    density = np.zeros(len(skin.owned_cells))
    result = solver.solve(density, 0.0)

    expected = free_across(1.2, np.pi / 2)[0][1, 1]
    assert np.ptp(skin.gather_vertices(result.positions)[:, 1]) / SIZE == pytest.approx(
        expected, abs=1e-7
    )
