"""A part of a skin at its symmetry planes does what the whole does."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.models import pressurize
from helpers.scenes import TABLE_A, table
from helpers.symmetry import rests
from mpi4py import MPI

from toros_fem import errors
from toros_fem.base.mpi import dot
from toros_fem.materials.sheet import Bending, Composite
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.load_case import make_load_case
from toros_fem.mechanics.skin.model import SkinModel
from toros_fem.mechanics.skin.supports import Supports, clamp, symmetry_plane
from toros_fem.meshes import Mirrored, Pattern, cylinder, mirrored, sew, walker

EDGE = 7e-3
CLOTH = Composite(bending=Bending(seams="hinged"))


def inflated(
    comm: MPI.Comm, pattern: Pattern, planes: tuple[int, ...], density: np.ndarray
) -> tuple[np.ndarray, float]:
    skin = sew(comm, pattern)
    solver = EquilibriumSolver(skin, CLOTH, rests(pattern, planes))
    found = solver.solve(density[skin.owned_cells], 3e3)
    return skin.gather_vertices(found.positions), found.volume


@pytest.mark.parametrize("reinforced", [False, True])
def test_quarter_half_and_whole_agree(comm: MPI.Comm, reinforced: bool) -> None:
    """On meshes that mirror each other to rounding, with a pattern that is not symmetric in z."""
    quarter = walker(comm, EDGE, planes=(0, 1))
    density = np.zeros(len(quarter.panel))
    if reinforced:
        stripe = quarter.centroids @ [0.5**0.5, -(0.5**0.5)]
        density[(quarter.panel == 1) & (stripe > 0.03) & (stripe < 0.05)] = 1.0
    positions, volume = inflated(comm, quarter, (0, 1), density)
    for axes, left in (((0, 1), ()), ((0,), (1,))):
        more: Mirrored = mirrored(quarter, axes)
        whole, enclosed = inflated(comm, more.pattern, left, more.at_cells(density))
        assert enclosed == pytest.approx(2 ** len(axes) * volume, rel=1e-9)
        assert whole == pytest.approx(more.at_vertices(positions), abs=1e-9)
    low, high = positions[:, 2].min(), positions[:, 2].max()
    assert high - low > 0.02
    # Unless it is reinforced, top and bottom inflate alike.
    tip = positions[np.argmax(positions[:, 0] + positions[:, 1]), 2]
    assert (abs(tip - (low + high) / 2) > 1e-4) == reinforced


LENGTH, RADIUS = 0.03, 0.01
# Where z = 0 and z = LENGTH, or the whole, are moved to: planes off the origin, on either side.
PLACES = [(0.0, 0.0, 0.0), (0.01, -0.02, 0.04), (0.0, 0.03, -0.01)]


def moved(pattern: Pattern, by: tuple[float, ...]) -> Pattern:
    return replace(pattern, points=pattern.points + by)


def between(pattern: Pattern, at: tuple[float, ...], heights: tuple[float, float]) -> Supports:
    """Two planes across the tube, at heights over `at`; y fixed where the tube meets y = 0."""
    x, y, _ = (pattern.points - at).T
    fixed = np.zeros((len(x), 3), dtype=bool)
    ends = [np.isclose(np.abs(x), RADIUS) & np.isclose(y, 0)]
    fixed[np.concatenate([np.flatnonzero(rim) for rim in ends]), 1] = True
    fixed[np.argmin(np.abs(pattern.points - at - [-RADIUS, 0, heights[1]]).sum(axis=1)), 0] = True
    supports = Supports(fixed)
    for height in heights:
        supports |= symmetry_plane(pattern, 2, at[2] + height)
    return supports


@pytest.mark.parametrize("at", PLACES)
def test_section_between_two_planes(comm: MPI.Comm, at: tuple[float, ...]) -> None:
    """One of twice the length, mirrored, does the same; with the half at y ≥ 0 too."""
    part = cylinder(comm, LENGTH, 2 * RADIUS, 6e-3, mesh="structured", caps=None, planes=(1,))
    density = np.where(part.points[part.triangles][:, :, 0].mean(axis=1) > 0, 0.3, 0.0)
    scenes = []
    for axes, heights in (((), (0, LENGTH)), ((2,), (-LENGTH, LENGTH)), ((1,), (0, LENGTH))):
        more = mirrored(part, axes)
        pattern = moved(more.pattern, at)
        supports = between(pattern, at, heights)
        if 1 not in axes:
            supports |= symmetry_plane(pattern, 1, at[1])
        skin = sew(comm, pattern)
        solver = EquilibriumSolver(skin, Composite(), supports)
        sides = round(np.pi * RADIUS / 6e-3) * 2
        prism = sides / 2 * np.sin(2 * np.pi / sides) * RADIUS**2 * LENGTH
        rest = solver.model.volume(solver.model.assembled)
        assert rest == pytest.approx(prism / 2 * 2 ** len(axes), rel=1e-12)
        found = solver.solve(more.at_cells(density)[skin.owned_cells], 3e3)
        scenes.append((skin.gather_vertices(found.positions) - at, found.volume, more))
    one = scenes[0]
    for positions, volume, more in scenes[1:]:
        assert volume == pytest.approx(2 * one[1], rel=1e-9)
        assert positions == pytest.approx(more.at_vertices(one[0]), abs=1e-9)


@pytest.mark.parametrize("stretch", ["1.2", "1.4"])
def test_section_of_an_endless_tube(comm: MPI.Comm, stretch: str) -> None:
    """In plane strain: the hoop force N of eq. (1) bears N = P λ c/(2 tan(π/n)) on the n-gon.

    The work of the forces at a further widening is 0 there.
    """
    rows = table("gent_equibiaxial_planestrain")
    row = next(r for r in rows if r["mat"] == "A" and r["stretch"] == stretch)
    at = (0.02, 0.0, 0.03)
    pattern = moved(cylinder(comm, LENGTH, 2 * RADIUS, 6e-3, mesh="left", caps=None), at)
    sides = round(np.pi * 2 * RADIUS / 6e-3)
    chord = 2 * RADIUS * np.sin(np.pi / sides)
    force = float(row["P11_strip_l2=1_Pa"]) * TABLE_A.thickness
    pressure = 2 * force * np.tan(np.pi / sides) / (float(stretch) * chord)
    sheet = Composite(fabric=TABLE_A, c1=1.8, c2=2.0, bending=None)
    skin = sew(comm, pattern)
    model = SkinModel(skin, sheet, between(pattern, at, (0, LENGTH)))
    model.set_density(np.zeros(len(skin.owned_cells)))
    pressurize(model, pressure)
    wider = (model.positions(model.assembled) - at + [RADIUS, 0, 0]) * [1, 1, 0]
    state = model.assembled
    model.positions(state)[:] += (float(stretch) - 1) * wider
    area = sides / 2 * np.sin(2 * np.pi / sides) * (float(stretch) * RADIUS) ** 2
    assert model.volume(state) == pytest.approx(area * LENGTH, rel=1e-12)
    work = dot(comm, model.positions(model.residual(state)).ravel(), wider.ravel())
    assert abs(work) < 1e-7 * pressure * area * LENGTH


def test_one_cap_and_a_plane_are_closed(comm: MPI.Comm) -> None:
    """The tube from its tip to its middle, where a plane cuts it, is half of the whole tube."""
    part = cylinder(comm, LENGTH, 2 * RADIUS, 5e-3, mesh="structured", caps="tip")
    whole = mirrored(part, (2,)).pattern
    volumes = []
    for pattern, planes in ((whole, ()), (moved(part, (0, 0, 0.02)), (0.02,))):
        x, _, z = pattern.points.T
        fixed = np.zeros((len(x), 3), dtype=bool)
        middle = np.flatnonzero(np.isclose(z, 0.02 if planes else 0.0))
        fixed[middle[np.argsort(x[middle])[[0, -1]]], 1] = True
        fixed[middle[np.argmin(x[middle])], 0] = True
        fixed[middle, 2] = True
        supports = Supports(fixed)
        for at in planes:
            supports |= symmetry_plane(pattern, 2, at)
        skin = sew(comm, pattern)
        solver = EquilibriumSolver(skin, Composite(), supports)
        volumes.append(solver.solve(np.zeros(len(skin.owned_cells)), 2e3).volume)
    assert 2 * volumes[1] == pytest.approx(volumes[0], rel=1e-9)
    base = cylinder(comm, LENGTH, 2 * RADIUS, 5e-3, caps="base")
    with pytest.raises(errors.OpenSkinError, match="add a cap, let a symmetry plane close"):
        make_load_case(base, clamp(base, ["base"]), 1, 1e3)


def test_planes_that_do_not_close(comm: MPI.Comm) -> None:
    pattern = cylinder(comm, LENGTH, 2 * RADIUS, 6e-3, mesh="structured", caps=None)
    with pytest.raises(errors.ParameterError, match=r"lies in the plane z = 0.01 m"):
        symmetry_plane(pattern, 2, 0.01)
    with pytest.raises(errors.ParameterError, match="at = nan must be a finite"):
        symmetry_plane(pattern, 2, float("nan"))
    supports = between(pattern, (0, 0, 0), (0, LENGTH))
    away = np.where(supports.fixed & [False, False, True], [0, 0, 1e-3], 0)
    with pytest.raises(errors.ParameterError, match="out of its symmetry plane"):
        make_load_case(pattern, supports, 1, 1e3, displacement=away)
    side = (pattern.points[pattern.triangles][:, :, 0].mean(axis=1) > 0).astype(int)
    with pytest.raises(errors.ParameterError, match="only that nearer to the origin"):
        SkinModel(sew(comm, pattern), Composite(), supports, Chambers(("a", "b"), side))
