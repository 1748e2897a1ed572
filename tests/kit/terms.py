"""Skins that differ in one energy term each: what contracts/test_terms.py tries."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.materials.sheet import (
    Bending,
    Bladder,
    Composite,
    Knit,
    Material,
    Membrane,
    Threads,
)
from toros_fem.mechanics.contact.bodies import Ground
from toros_fem.mechanics.contact.contact import Contact
from toros_fem.mechanics.contact.sliding import Pads
from toros_fem.mechanics.contact.solids import rigid_sphere
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.designs import LineDesign
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Supports, clamp, symmetry_plane
from toros_fem.mechanics.terms.loads import Weight
from toros_fem.mechanics.terms.model import SkinModel, make_model
from toros_fem.mechanics.terms.periodic import Periodic
from toros_fem.meshes import Pattern, Skin, cylinder, sew, tile
from toros_fem.meshes.pattern import Panel

ALONE = MPI.COMM_SELF
# Structured: the same points and edges on every machine.
SKIN = sew(ALONE, cylinder(ALONE, 0.06, 0.02, 9e-3, mesh="structured"))
BASED, OPEN = (
    sew(ALONE, cylinder(ALONE, 0.06, 0.02, 9e-3, mesh="structured", caps=caps))
    for caps in ("base", None)
)
HALF = sew(ALONE, cylinder(ALONE, 0.06, 0.02, 9e-3, mesh="structured", planes=(1,)))
CELLS, AREAS = SKIN.pattern.triangles, SKIN.pattern.areas
SHEET = Composite()
GRID = np.random.default_rng(1).uniform(0.05, 0.6, len(CELLS))
TOP = SKIN.pattern.points[CELLS].mean(axis=1)[:, 2] > 0.03
PRESSURE, FABRIC, PRINT = 2e3, 0.2, 2.0
FORCE = np.random.default_rng(4).uniform(-1e-2, 1e-2, SKIN.pattern.points.shape)
NONE = Load(np.zeros(1))
PRESSED = Load(np.array([PRESSURE]))
HEAVY = Load(np.zeros(1), weight_fraction=1.0)
DISTANCE, STIFFNESS = 2.5e-4, 1e5
WALL = Ground((-0.0104, 0.0, 0.0), (1.0, 0.0, 0.0))
BALL = replace(rigid_sphere("ball", 0.008, (0.0, 0.0, 0.0688), edge_length=4e-3), free=True)
TIGHT = replace(SHEET, reinforcement=replace(SHEET.reinforcement, c1=1.2, c2=1.35))


@dataclass(frozen=True)
class Term:
    """What a row adds to the bare skin.

    Attributes:
        adds: Further arguments of the model.
        load: Its load.
        composite: Materials other than the default ones.
        kinds: How many kinds of unknowns the term moves: positions, turns, lattice, bodies.
        by_hand: Its energy in J by the positions of the vertices, where a formula is short.
        lines: Number of line families of a relaxed model.
        skin, supports: Others than those of a closed tube with a held base.
        free: Whether a rotation of the whole leaves its energy as it is.
        width: Of the tube in the state over that at rest.
    """

    adds: dict[str, Any] | None = None
    load: Load = NONE
    composite: Composite = SHEET
    kinds: int = 1
    by_hand: Callable[[np.ndarray], float] | None = None
    lines: int = 0
    skin: Skin = SKIN
    supports: Supports | None = None
    free: bool = True
    width: float = 1.0


def volume_work(x: np.ndarray) -> float:
    return float(-PRESSURE * np.linalg.det(x[CELLS]).sum() / 6)


def height_times_mass(x: np.ndarray) -> float:
    return float(9.81 * AREAS * (FABRIC + (PRINT - FABRIC) * GRID) @ x[CELLS, 2].mean(axis=1))


def work_of_force(x: np.ndarray) -> float:
    return float(-(FORCE * (x - SKIN.pattern.points)).sum())


def barrier(x: np.ndarray) -> float:
    """Return the energy of `WALL`, Li et al. 2020, eq. 6, as a pressure on the vertex areas."""
    gap = np.minimum((x[:, 0] + 0.0104 - DISTANCE) / DISTANCE, 1.0) ** 2
    density = -DISTANCE * STIFFNESS * (gap - 1) ** 2 * np.log(gap)
    return float(SKIN.pattern.vertex_areas @ density)


def rubber(x: np.ndarray) -> float:
    """Return the energy of an incompressible neo-Hookean bladder, μ = E/3."""
    return float(0.3e6 / 3 * 5e-4 / 2 * AREAS @ invariants(x))


def stiffening_rubber(x: np.ndarray) -> float:
    """Return the same of Yeoh's law."""
    invariant = invariants(x)
    return rubber(x) + float(5e-4 * AREAS @ (-4e3 * invariant**2 + 7e3 * invariant**3))


def invariants(x: np.ndarray) -> np.ndarray:
    """Return I₁ − 3 of incompressible triangles, (t,)."""
    flat, there = SKIN.pattern.points[CELLS], x[CELLS]
    metric = []
    for corners in (flat, there):
        sides = corners[:, 1:] - corners[:, :1]
        metric.append(sides @ np.swapaxes(sides, 1, 2))
    C = np.linalg.solve(metric[0], metric[1])
    thin = np.linalg.det(C)
    return np.asarray(np.trace(C, axis1=1, axis2=2) + 1 / thin - 3)


def oblique(skin: Skin) -> Supports:
    """Return a mirror across the border's edges, oblique to them; the border itself is free."""
    points, border = skin.pattern.points, skin.pattern.free_edges
    along = points[border[:, 1]] - points[border[:, 0]]
    along /= np.linalg.norm(along, axis=1)[:, None]
    tilted = np.array([0.1, -0.2, 1.0])
    normals = tilted - (along @ tilted)[:, None] * along
    fixed = np.repeat(np.abs(points[:, 2:] - 0.03) < 6e-3, 3, axis=1)
    return Supports(fixed, border, normals)


def tetrahedron() -> tuple[Skin, Supports]:
    """Return a skin whose triangles see one vertex in all three flaps: blocks fall together."""
    points = 0.01 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], dtype=float)
    corners = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
    side = float(np.linalg.norm(points[1] - points[0]))
    flat = side * np.array([[0, 0], [1, 0], [0.5, np.sqrt(0.75)]])
    panels = [
        Panel(name, flat, np.arange(3)[None], points[k])
        for name, k in zip("abcd", corners, strict=True)
    ]
    fixed = np.zeros((4, 3), dtype=bool)
    fixed[:2] = fixed[2, :2] = True
    return sew(ALONE, Pattern.from_panels(panels, tolerance=1e-6)), Supports(fixed)


FOUR, HELD = tetrahedron()


def bent(*bending: str, side: str | None = None, skin: Skin = SKIN) -> Term:
    """Return a row of a sheet so thick that stretching does not hide its bending."""
    sheet = Composite(
        Material(1e5, 0.3, 5e-3), Material(26e5, 0.3, 5e-3),
        bending=Bending(*bending), print_side=side,
    )  # fmt: skip
    supports = oblique(OPEN) if skin is OPEN else None
    turns = bending[0] == "midedge"
    return Term(composite=sheet, kinds=1 + turns, skin=skin, supports=supports, free=skin is SKIN)


THREADS = Knit(grain=0.4, course=Threads(20.0, 0.2), wale=Threads(8.0, 0.4), shear=3.0)
TERMS = {
    "sheet": Term(kinds=2),
    "membrane": Term(composite=replace(SHEET, bending=None)),
    "tension field": Term(
        composite=replace(SHEET, bending=None, membrane=Membrane("tension-field", 1e-3))
    ),
    "own bounds": Term(composite=TIGHT, kinds=2),
    "own bounds of a tension field": Term(
        composite=replace(TIGHT, bending=None, membrane=Membrane("tension-field", 1e-3))
    ),
    "average curvature": bent("average"),
    "average curvature at a mirror": bent("average", skin=OPEN),
    "hinged seams": bent("midedge", "hinged"),
    "assembled rest at a mirror": bent("midedge", "continuous", "assembled", skin=OPEN),
    "average curvature, printed outside": bent("average", side="outside"),
    "free end, printed inside": bent("midedge", side="inside", skin=BASED),
    "mirror, printed outside": bent("midedge", side="outside", skin=OPEN),
    "four triangles": Term(None, Load(np.array([100.0])), kinds=2, skin=FOUR, supports=HELD,
                           free=False),
    "bladder": Term({}, composite=replace(SHEET, bladder=Bladder(0.3e6, 5e-4)), by_hand=rubber),
    "bladder that stiffens": Term(
        {}, composite=replace(SHEET, bladder=Bladder(0.3e6, 5e-4, -4e3, 7e3)),
        by_hand=stiffening_rubber,
    ),
    "knit": Term({}, composite=replace(SHEET, knit=Knit(3.0, 0.4)), kinds=2),
    "threads that stiffen": Term(
        {}, composite=replace(SHEET, knit=THREADS), kinds=2
    ),
    "threads of a membrane": Term(
        composite=replace(SHEET, bending=None, knit=replace(THREADS, wale=None))
    ),
    "print on one face": Term({}, composite=replace(SHEET, print_side="outside"), kinds=2),
    "lines": Term({}, lines=2, kinds=2),
    "lines on a knit": Term({}, composite=replace(SHEET, knit=Knit(3.0, 0.4)), lines=2, kinds=2),
    "lines with a side": Term(
        {}, composite=replace(SHEET, print_side="inside"), lines=2, kinds=2
    ),
    "quadratic": Term({"quadratic": TOP}, kinds=2),
    "quadratic membrane": Term(
        {"quadratic": TOP}, composite=replace(SHEET, bending=None), kinds=2
    ),
    "quadratic, own bounds": Term({"quadratic": TOP}, composite=TIGHT, kinds=2),
    "quadratic tension field": Term(
        {"quadratic": TOP}, kinds=2,
        composite=replace(SHEET, bending=None, membrane=Membrane("tension-field", 1e-3)),
    ),
    "quadratic, printed outside, knit": Term(
        {"quadratic": TOP}, kinds=2,
        composite=replace(SHEET, print_side="outside", knit=Knit(3.0, 0.4)),
    ),
    "pressure": Term({}, PRESSED, by_hand=volume_work),
    "pressure on a half": Term(
        None, PRESSED, skin=HALF, kinds=2, free=False,
        supports=clamp(HALF.pattern, ["base"]) | symmetry_plane(HALF.pattern, 1),
    ),
    "chambers": Term(
        {"chambers": Chambers(("lower", "upper"), TOP.astype(int))},
        Load(np.array([8e4, 1e4])),
    ),
    "weight": Term({"weight": Weight(FABRIC, PRINT)}, HEAVY, by_hand=height_times_mass, free=False),
    "force": Term({}, Load(np.zeros(1), FORCE), by_hand=work_of_force, free=False),
    "wall": Term(
        {"contact": Contact(WALL, distance=DISTANCE, stiffness=STIFFNESS)},
        by_hand=barrier, free=False,
    ),
    "friction": Term(
        {"contact": Contact(WALL, distance=DISTANCE, stiffness=STIFFNESS, friction=0.5)},
        free=False,
    ),
    "pads": Term(
        {
            "contact": Contact(
                WALL, distance=DISTANCE, stiffness=STIFFNESS, friction=0.5,
                pads=Pads(SKIN.pattern.points[:, 2] < 0.03, (0.0, 0.0, 1.0), 0.1, 0.4),
            )
        },
        free=False,
    ),
    "ball": Term(
        {"contact": Contact(bodies=[BALL], distance=1e-3, friction=0.5)}, kinds=2, free=False
    ),
    "the skin itself": Term(
        {"contact": Contact(distance=6e-3, stiffness=1e5)}, width=0.3
    ),
}  # fmt: skip


def design_of(term: Term, shift: float = 0.0, seed: int = 7) -> np.ndarray:
    """Return a random design of the owned triangles, moved along a random direction."""
    cells, count = term.skin.owned_cells, len(term.skin.pattern.panel)
    numbers = np.random.default_rng(seed)
    density = GRID[:count] + shift * numbers.uniform(-0.3, 0.3, count)
    if not term.lines:
        return np.asarray(density[cells])
    shares = 0.2 + (0.1 + 0.1 * shift) * numbers.uniform(-1, 1, (count, term.lines))
    angles = (1 + 0.2 * shift) * numbers.uniform(-1.5, 1.5, (count, term.lines))
    columns = [density, shares, np.cos(2 * angles), np.sin(2 * angles)]
    return np.asarray(np.column_stack(columns)[cells])


def model_of(term: Term) -> tuple[np.ndarray, SkinModel]:
    """Return a disturbed state and the model of a row under its load."""
    pattern, adds = term.skin.pattern, term.adds or {}
    supports = term.supports or clamp(pattern, ["base"])
    design = partial(LineDesign, families=term.lines) if term.lines else None
    model = make_model(term.skin, term.composite, supports, design=design, **adds)
    model.set_density(design_of(term))
    model.set_load(term.load)
    start = model.assembled
    noise = np.random.default_rng(3).uniform(-1, 1, len(start))
    state = start + 3e-5 * noise * model.free
    places = model.positions(state)
    if "contact" not in adds:  # stretched and bent, within all bounds
        x, y, z = places.T.copy()
        places.T[:] = 1.08 * x + 0.005 * (z / 0.06) ** 2, 1.04 * y, 1.12 * z
        places[model.fixed[: places.size].reshape(-1, 3)] = model.positions(start)[
            model.fixed[: places.size].reshape(-1, 3)
        ]
    places[:, 0] *= term.width
    if model.contact is not None:
        model.contact.begin_step(None, term.load)
        model.contact.lag_friction(start)
    for each in model.terms:
        each.grow(state)
    return state, model


def periodic(composite: Composite = SHEET) -> tuple[np.ndarray, SkinModel]:
    """Return a disturbed state and the model of a tile whose mean gradient is free in the plane."""
    found = tile(ALONE, (0.01, 0.01), 2.5e-3)
    skin = sew(ALONE, found.pattern)
    fixed = np.zeros(found.pattern.points.shape, dtype=bool)
    fixed[0] = True
    turns = ((False, False), (True, False), (True, True))
    tiled = Periodic(found, turns)
    model = make_model(skin, composite, Supports(fixed), periodic=tiled)
    model.set_density(np.random.default_rng(5).uniform(0, 1, len(found.wraps)))
    model.images.turn(0.4)
    state, gradient = model.assembled, np.array([[1.08, 0.06], [-0.03, 0.95], [0.0, 0.0]])
    model.positions(state)[:] = model.positions(state)[:, :2] @ gradient.T
    state += 3e-5 * np.random.default_rng(3).uniform(-1, 1, len(state)) * model.free
    model.images.set_mean_gradient(state, gradient)
    return state, model
