"""Each term of a skin's energy: force, tangent, load and sensitivity are its derivatives."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from helpers.models import dense_tangent
from kit.slopes import slope
from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.materials.sheet import Bending, Bladder, Composite, Knit, Material, Membrane
from toros_fem.mechanics.contact import Contact, Ground, rigid_sphere
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.dead_loads import Weight
from toros_fem.mechanics.skin.load_case import LoadCase
from toros_fem.mechanics.skin.model import SkinModel
from toros_fem.mechanics.skin.relaxed_model import RelaxedModel
from toros_fem.mechanics.skin.supports import Supports, clamp
from toros_fem.meshes import Pattern, cylinder, sew
from toros_fem.meshes.pattern import Panel

pytestmark = pytest.mark.slow
PATTERN = cylinder(MPI.COMM_SELF, 0.06, 0.02, 9e-3, mesh="structured")
CELLS, AREAS = PATTERN.triangles, PATTERN.areas
GRID = np.random.default_rng(1).random(len(CELLS))
NO_LOAD = LoadCase(np.zeros(1))
FORCE = np.random.default_rng(4).uniform(-1e-2, 1e-2, PATTERN.points.shape)
HEAVY = LoadCase(np.zeros(1), weight_fraction=0.7, bodies_fraction=1.0)
BALL = rigid_sphere("ball", 0.008, (0.0, 0.0, 0.0688), mass=0.05, edge_length=4e-3)
WALL = Ground((-0.0104, 0.0, 0.0), (1.0, 0.0, 0.0))
UPPER = (PATTERN.points[CELLS, 2].mean(axis=1) > 0.03).astype(int)
# So thick that stretching does not hide what bending adds.
THICK = Composite(Material(1e5, 0.3, 5e-3), Material(26e5, 0.3, 5e-3))
# Two laws, each with bounds of its own.
OWN_BOUNDS = Composite(Material(1e5, 0.3, 5e-4, 1.9, 2.6), Material(26e6, 0.3, 5e-4, 1.2, 1.35))


def barrier(x: Floats) -> float:
    """Energy of `WALL` (Li et al. 2020, eq. 6, with units): distance 0.25 mm, 1e5 Pa."""
    gap = np.minimum((x[:, 0] + 0.0104 - 2.5e-4) / 2.5e-4, 1.0) ** 2
    return -float((PATTERN.vertex_areas * 2.5e-4 * 1e5 * (gap - 1) ** 2 * np.log(gap)).sum())


def height_times_mass(x: Floats) -> float:
    """Potential of seven tenths of 0.2 kg/m² of fabric and 2 kg/m² of printed fabric."""
    return 0.7 * 9.81 * float(AREAS * (0.2 + 1.8 * GRID) @ x[CELLS, 2].mean(axis=1))


def rubber(x: Floats) -> float:
    """Neo-Hookean and incompressible: μ h/2 (I₁ + 1/det C − 3), μ = E/3."""
    flat = PATTERN.corners[:, 1:] - PATTERN.corners[:, :1]
    F = np.linalg.solve(flat, x[CELLS[:, 1:]] - x[CELLS[:, :1]])  # transposed, (n, 2, 3)
    C = F @ F.transpose(0, 2, 1)
    density = np.trace(C, axis1=1, axis2=2) + 1 / np.linalg.det(C) - 3
    return 0.3e6 / 3 * 5e-4 / 2 * float(AREAS @ density)


def mirrored() -> dict[str, Any]:
    """An open tube whose ends are guided by oblique mirrors, and free to move."""
    pattern = cylinder(MPI.COMM_SELF, 0.06, 0.02, 9e-3, mesh="structured", caps=None)
    points, border = pattern.points, pattern.free_edges
    along = points[border[:, 1]] - points[border[:, 0]]
    along /= np.linalg.norm(along, axis=1)[:, None]
    normals = np.array([0.1, -0.2, 1.0]) - (along @ [0.1, -0.2, 1.0])[:, None] * along
    fixed = np.repeat(np.abs(points[:, 2:] - 0.03) < 6e-3, 3, axis=1)
    return {"pattern": pattern, "supports": Supports(fixed, border, normals)}


def tetrahedron() -> dict[str, Any]:
    """All three flaps of a triangle are one vertex: blocks fall together."""
    points = 0.01 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], dtype=float)
    corners = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
    side = np.linalg.norm(points[1] - points[0])
    flat = side * np.array([[0, 0], [1, 0], [0.5, np.sqrt(0.75)]])
    panels = [Panel(name, flat, np.arange(3)[None], points[k])
              for name, k in zip("abcd", corners, strict=True)]  # fmt: skip
    fixed = np.zeros((4, 3), dtype=bool)
    fixed[:2] = fixed[2, :2] = True
    pattern = Pattern.from_panels(panels, tolerance=1e-6)
    return {"pattern": pattern, "supports": Supports(fixed), "load": LoadCase(np.array([100.0]))}


# What a term adds to the bare skin, how many kinds of unknowns it moves, its energy by hand.
ROWS: dict[str, tuple[dict[str, Any], int, Callable[[Floats], float] | None]] = {
    "sheet": ({}, 2, None),
    "average": ({"composite": replace(THICK, bending=Bending("average"))}, 1, None),
    "hinged": ({"composite": replace(THICK, bending=Bending(seams="hinged"))}, 2, None),
    "assembled": ({"composite": replace(THICK, bending=Bending(rest="assembled"))}, 2, None),
    "quadratic, mirrored": (
        mirrored() | {"composite": replace(THICK, bending=Bending("quadratic"))}, 1, None
    ),
    "outside, mirrored": (
        mirrored() | {"composite": replace(THICK, print_side="outside")}, 2, None
    ),
    "tetrahedron": (tetrahedron() | {"composite": THICK}, 2, None),
    "bladder": ({"composite": Composite(bladder=Bladder(0.3e6, 5e-4))}, 1, rubber),
    "bounds": ({"composite": OWN_BOUNDS}, 1, None),
    "bounds and wrinkles": (
        {"composite": replace(OWN_BOUNDS, membrane=Membrane("tension-field"), bending=None)},
        1,
        None,
    ),
    "bounds and lines": ({"families": 2, "composite": OWN_BOUNDS}, 2, None),
    "knit": ({"composite": Composite(knit=Knit(3.0, 0.4))}, 2, None),
    "print outside": ({"composite": Composite(print_side="outside")}, 2, None),
    "wrinkles": (
        {"composite": Composite(membrane=Membrane("tension-field"), bending=None)}, 1, None
    ),
    "lines": ({"families": 2}, 2, None),
    "lines outside": ({"families": 2, "composite": Composite(print_side="outside")}, 2, None),
    "pressure": (
        {"load": LoadCase(np.array([2e3]))}, 1, lambda x: -2e3 * np.linalg.det(x[CELLS]).sum() / 6
    ),
    "two pressures": (
        {"chambers": Chambers(("lower", "upper"), UPPER), "load": LoadCase(np.array([9e4, 1e4]))},
        1, None,
    ),
    "force": (
        {"load": LoadCase(np.zeros(1), FORCE)}, 1, lambda x: -(FORCE * (x - PATTERN.points)).sum()
    ),
    "weight": ({"weight": Weight(0.2, 2.0), "load": HEAVY}, 1, height_times_mass),
    "wall": ({"contact": Contact(WALL, distance=2.5e-4, stiffness=1e5)}, 1, barrier),
    "ball": (
        {"contact": Contact(bodies=[BALL], distance=1e-3, friction=0.5), "load": HEAVY}, 2, None
    ),
}  # fmt: skip


def model_of(
    load: LoadCase = NO_LOAD,
    composite: Composite | None = None,
    families: int = 0,
    pattern: Pattern = PATTERN,
    supports: Supports | None = None,
    **more: Any,
) -> tuple[Floats, SkinModel, Floats]:
    """A disturbed state, the model of a short tube under one load, and its random design."""
    skin, kind = sew(MPI.COMM_SELF, pattern), RelaxedModel if families else SkinModel
    model = kind(
        skin,
        composite or Composite(),
        supports or clamp(pattern, ["base"]),
        **({"families": families} if families else more),
    )
    rng = np.random.default_rng(3)
    design = np.resize(GRID, len(pattern.triangles))[skin.owned_cells]
    if families:
        lines = rng.uniform(0.1, 0.4, (len(design), 3 * families))
        design = np.column_stack([0.2 * design, lines])
    model.set_density(design)
    model.set_load(load)
    start = model.assembled
    far = 2e-4 if model.contact is None else 3e-5
    state = start + far * rng.uniform(-1, 1, len(start)) * model.free
    if model.contact is not None:
        model.begin_step(None, load)
        model.lag_friction(start)
        model.grow_pairs(state)
    return state, model, design


def ways(model: SkinModel) -> Iterator[Floats]:
    """20 nm along one kind of unknown alone: places, turns of edges, free bodies."""
    ends = [model.positions(model.assembled).size, model.size_local - 6 * model.free_bodies]
    way = 2e-8 * np.random.default_rng(2).uniform(-1, 1, model.size_local) * model.free
    for part in np.split(np.arange(model.size_local), ends):
        yield way * np.isin(np.arange(model.size_local), part)


def energy(model: SkinModel, x: Floats) -> float:
    return model.energy(x)


def residual(model: SkinModel, x: Floats) -> Floats:
    return model.residual(x)


@pytest.mark.parametrize(("adds", "kinds", "by_hand"), ROWS.values(), ids=ROWS)
def test_force_tangent_load_and_sensitivity(
    adds: dict[str, Any], kinds: int, by_hand: Callable[[Floats], float] | None
) -> None:
    state, model, design = model_of(**adds)
    _, bare, _ = model_of()
    same = adds and not {"families", "pattern"} & set(adds) and model.size_local >= bare.size_local
    size = bare.size_local if same else 0

    def alone(of: Callable[..., Any], x: Floats = state) -> Any:
        """What the term adds: the rest of the skin hides nothing."""
        found = np.array(of(model, x))
        if size:
            part = (slice(min(size, len(found))),) * found.ndim if found.ndim else ()
            found[part] -= np.array(of(bare, x[:size]))[part]
        return found

    tangent, force, moved = alone(dense_tangent), alone(residual), 0
    for way in ways(model):
        work, wide = np.abs(force) @ np.abs(way), (np.abs(tangent) @ np.abs(way)).max()
        rise = slope(lambda h, way=way: alone(energy, state + h * way))
        change = slope(lambda h, way=way: alone(residual, state + h * way))
        assert force @ way == pytest.approx(rise, abs=1e-7 * work + 2e-16)  # 1.4e-8 seen
        assert np.abs(tangent @ way - change).max() < 5e-7 * wide + 1e-14  # 5e-8 seen
        moved += work > 1e-12
    assert moved == kinds
    # What Newton's method shifts by is positive; of contact it is all that acts, and made so.
    material = alone(partial(dense_tangent, geometric=0.0))
    if model.contact is None:
        assert np.linalg.eigvalsh(dense_tangent(model, state, 0.0))[0] > 0
    else:
        lowest = np.linalg.eigvalsh(material)
        assert lowest[0] > -1e-12 * lowest[-1]
        assert (np.linalg.eigvalsh(tangent)[0] < -1e-3 * lowest[-1]) == (kinds == 2)  # the ball
        gap = model.contact.convexity_gap(model.positions(state), model.motions(state))
        expected = (material - tangent)[*model.contact.pairs]
        assert gap == pytest.approx(expected, abs=1e-12 * lowest[-1])
    if by_hand:
        wanted = by_hand(model.skin.gather_vertices(model.positions(state)))
        assert alone(energy) == pytest.approx(wanted, rel=1e-9)
    rng = np.random.default_rng(6)
    adjoint = rng.uniform(-1, 1, model.size_local) * model.free

    def sensitivity(of: SkinModel, x: Floats) -> Floats:
        return np.asarray(of.density_sensitivity(x, adjoint[: len(x)]))

    found = alone(sensitivity)
    for columns in [[0]] if design.ndim == 1 else [[0], [1, 2], [3, 4, 5, 6]]:
        step: Floats = np.zeros(found.shape)
        step.reshape(len(step), -1)[:, columns] = 1e-3 * rng.uniform(
            -1, 1, (len(step), len(columns))
        )

        def work_of(h: int) -> float:
            for one in (model, bare) if size else (model,):
                one.set_density(design + h * step)  # noqa: B023
            return float(alone(residual) @ adjoint)

        wide = np.abs(found * step).sum()
        assert (found * step).sum() == pytest.approx(slope(work_of), abs=1e-7 * wide + 1e-14)
        model.set_density(design)
        if design.ndim > 1:
            continue
        along = model.density_variation(state, step) @ adjoint
        assert along == pytest.approx((sensitivity(model, state) * step).sum(), rel=1e-9)
    load, pull = model.applied_load(state), model.residual(state)
    model.set_load(LoadCase(np.zeros_like(model.load.pressures)))
    assert model.residual(state) - pull == pytest.approx(load, abs=1e-12 * np.abs(pull).max())
