"""A part at its symmetry planes does what the whole does: shape, volumes, energy and metrics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from helpers.scenes import TABLE_A, box, part_of
from helpers.symmetry import rests
from mpi4py import MPI

from toros_fem.materials.sheet import Bending, Bladder, Composite, Knit
from toros_fem.measures.metrics import Metric, bend_angle, shortening, swelling
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.supports import Supports, clamp, symmetry_plane
from toros_fem.meshes import Pattern, cylinder, mirrored, sew, walker

Places = Callable[[Pattern], np.ndarray]
Held = Callable[[Pattern, tuple[int, ...]], Supports]
LENGTH, RADIUS = 0.03, 0.01


def tube(planes: tuple[int, ...], mesh: str = "structured", **more: Any) -> Pattern:
    return cylinder(MPI.COMM_SELF, 0.04, 0.02, 5e-3, mesh=mesh, planes=planes, **more)


def section() -> Pattern:
    """Half of an open tube, to be held between two planes across it."""
    comm = MPI.COMM_SELF
    return cylinder(comm, LENGTH, 2 * RADIUS, 6e-3, mesh="structured", caps=None, planes=(1,))


def end() -> Pattern:
    """The tip of a tube, which a plane cuts at its lower end."""
    return cylinder(MPI.COMM_SELF, LENGTH, 2 * RADIUS, 5e-3, mesh="structured", caps="tip")


def corner(planes: tuple[int, ...]) -> Pattern:
    whole = box()
    middle = whole.points[whole.triangles].mean(axis=1)
    return part_of(whole, np.all([middle[:, k] > 0 for k in planes], axis=0))


def clamped(panels: Sequence[str], pattern: Pattern, planes: tuple[int, ...]) -> Supports:
    """The panels, and those that are mirror images of them."""
    names = [name for name in pattern.panel_names if name.split(" ")[0] in panels]
    return clamp(pattern, names)


def rims(pattern: Pattern, planes: tuple[int, ...]) -> Supports:
    """Fix y where the lower and the upper rim meet y = 0, and x at one of these vertices."""
    x, y, z = pattern.points.T
    fixed = np.zeros((len(x), 3), dtype=bool)
    fixed[np.isclose(np.abs(x), RADIUS) & np.isclose(y, 0), 1] = True
    fixed[np.argmin(np.abs(pattern.points - [-RADIUS, 0, LENGTH]).sum(axis=1)), 0] = True
    ends = {float(h) for h in (z.min(), z.max()) if not (planes == (2,) and h == 0)}
    supports = Supports(fixed)
    for height in sorted(ends):
        supports |= symmetry_plane(pattern, 2, height)
    return supports


def middle(pattern: Pattern, planes: tuple[int, ...]) -> Supports:
    """A tube that is held where its middle is, in or out of the plane."""
    x, _, z = pattern.points.T
    ring = np.flatnonzero(np.isclose(z, 0.0))
    fixed = np.zeros((len(x), 3), dtype=bool)
    fixed[ring[np.argsort(x[ring])[[0, -1]]], 1] = True
    fixed[ring[np.argmin(x[ring])], 0] = True
    fixed[ring, 2] = True
    return Supports(fixed)


def wavy(places: np.ndarray) -> np.ndarray:
    """A density of a part that is neither 0 nor constant at its cuts."""
    return 0.5 + 0.5 * np.sin(300 * places[:, 0] + 1) * np.cos(
        170 * places[:, 2] + 40 * places[:, 1]
    )


def along(axis: int, at: float, places: np.ndarray) -> np.ndarray:
    return np.asarray(places[:, axis] > at).astype(int)


@dataclass(frozen=True)
class Scene:
    """A part and the planes that mirror it.

    Attributes:
        part: The part; its planes go through the origin.
        planes: Normals of the planes across which the whole goes on.
        held: Supports of part or whole; not the planes, which are given where they are free.
        composite: The materials.
        pressures: In Pa, one for each chamber.
        chamber: Chamber of each triangle by its middle; None for one.
        at: Where all is moved to, in m.
        metrics: Of the whole.
        many: Whether there are several equilibria: then the whole starts from the part's.
    """

    part: Callable[[], Pattern]
    planes: tuple[int, ...]
    held: Held
    composite: Composite = field(default_factory=Composite)
    pressures: tuple[float, ...] = (2e3,)
    chamber: Callable[[np.ndarray], np.ndarray] | None = None
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    metrics: tuple[Callable[..., float], ...] = ()
    many: bool = False

    def solver(
        self, comm: MPI.Comm, pattern: Pattern, planes: tuple[int, ...]
    ) -> EquilibriumSolver:
        """Return the solver of a part that is cut by these planes, or with none of the whole."""
        supports = self.held(pattern, planes)
        more: dict[str, Any] = {}
        if self.chamber is not None:
            which = self.chamber(pattern.points[pattern.triangles].mean(axis=1))
            more["chambers"] = Chambers(("one", "other"), which)
        moved = replace(pattern, points=pattern.points + self.at)
        shifted = tuple((axis, height + self.at[axis]) for axis, height in supports.planes)
        supports = replace(supports, planes=shifted)
        for axis in planes:
            supports |= symmetry_plane(moved, axis, self.at[axis])
        return EquilibriumSolver(sew(comm, moved), self.composite, supports, **more)


BASE = partial(clamped, ["base"])
BENT = (bend_angle, shortening, swelling)
CLOTH = Composite(bending=Bending(seams="hinged"))
SHEET = Composite(bending=None, fabric=TABLE_A)
LEVEL, UPRIGHT = partial(along, 2, 0.01), partial(along, 0, 0.0)
AWAY = (0.03, -0.02, 0.05)
HALF = partial(Scene, partial(tube, (1,)), (1,), BASE)
SECTION = partial(Scene, section, held=rims, pressures=(3e3,))
BOX = partial(Scene, composite=SHEET, held=partial(clamped, ["bottom"]), pressures=(900.0, 300.0))
ROWS = {
    "half, membrane": HALF(Composite(bending=None), metrics=BENT),
    "half, midedge": HALF(metrics=BENT),
    "half, average": HALF(Composite(bending=Bending("average"))),
    "half, unstructured": Scene(partial(tube, (1,), "unstructured"), (1,), BASE, metrics=BENT),
    "half, knit along": HALF(Composite(knit=Knit(2.5, 0.0))),
    "half, knit across": HALF(Composite(knit=Knit(2.5, np.pi / 2))),
    "half, bladder": HALF(replace(Composite(), bladder=Bladder(0.29e6, 0.2e-3))),
    "quarter": Scene(partial(tube, (0, 1)), (0, 1), BASE, metrics=(shortening, swelling)),
    "quarter of a walker": Scene(
        lambda: walker(MPI.COMM_SELF, 7e-3, planes=(0, 1)), (0, 1), rests, CLOTH, many=True
    ),
    "section, twice as long": SECTION(planes=(2,)),
    "section, both halves": SECTION(planes=(1,)),
    "section elsewhere": SECTION(planes=(1,), at=AWAY),
    "end of a tube": Scene(end, (2,), middle, at=(0.0, 0.0, 0.02)),
    **{
        f"box, wall {name}, {len(planes)} planes{' elsewhere' * (at != (0, 0, 0))}": BOX(
            partial(corner, planes), planes, chamber=chamber, at=at
        )
        for name, chamber, planes in (
            ("level", LEVEL, (1,)), ("level", LEVEL, (0, 1)), ("upright", UPRIGHT, (1,))
        )
        for at in ((0.0, 0.0, 0.0), AWAY)
    },
}  # fmt: skip


@pytest.mark.parametrize("scene", ROWS.values(), ids=ROWS)
def test_part_is_whole(scene: Scene, comm: MPI.Comm) -> None:
    part, count = scene.part(), 2 ** len(scene.planes)
    images = mirrored(part, scene.planes)
    density = wavy(part.points[part.triangles].mean(axis=1))
    if scene.chamber is not None:
        density = 0.1 * density
    found = []
    shapes: list[np.ndarray] = []
    for pattern, planes, here in (
        (part, scene.planes, density), (images.pattern, (), images.at_cells(density))
    ):  # fmt: skip
        solver = scene.solver(comm, pattern, planes)
        rest = solver.model.volumes(solver.model.assembled).sum()
        start = None
        if scene.many and not planes:
            start = images.at_vertices(shapes[0])[solver.skin.owned_vertices]
        result = solver.solve(here[solver.skin.owned_cells], scene.pressures, start)
        found.append((rest, result))
        shapes.append(solver.skin.gather_vertices(result.positions) - scene.at)
    (rest, one), (whole_rest, other) = found
    size = images.pattern.size
    assert count * rest == pytest.approx(whole_rest, rel=1e-12)
    assert count * np.array(one.volumes) == pytest.approx(np.array(other.volumes), rel=1e-8)
    assert count * one.energy == pytest.approx(other.energy, rel=1e-8)
    assert images.at_vertices(shapes[0]) == pytest.approx(shapes[1], abs=1e-8 * size)
    assert np.abs(shapes[0] - part.points).max() > 5e-3 * size, "it is deformed"
    for measure in scene.metrics:
        value = Metric("some", "unit", 0.0, measure).of_whole(scene.planes).measure(part, shapes[0])
        assert value == pytest.approx(measure(images.pattern, shapes[1]), rel=1e-6, abs=1e-9)
