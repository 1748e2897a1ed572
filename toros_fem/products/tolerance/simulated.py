"""Skins that are not made as drawn, simulated from the equilibrium of the drawn one."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats, Ints
from toros_fem.base.errors import NoEquilibriumError
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.validation import require_kind
from toros_fem.design.loop.problem import Evaluation
from toros_fem.design.loop.shape_design import ShapeDesign, carried_along
from toros_fem.making.as_printed import PrintedDesign
from toros_fem.making.print.contours import fabric_of
from toros_fem.making.print.printability import PrintLimits, printability
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium, EquilibriumError
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load
from toros_fem.meshes.moving import border_motion, with_flat_points
from toros_fem.meshes.pattern import Pattern, Regions
from toros_fem.meshes.transfer import make_transfer
from toros_fem.products.options import ToleranceConfig
from toros_fem.products.tolerance.result import OBJECTIVE, ToleranceResult, Variant

# Parts of the materials that may be off: what they are called, and material and field.
STIFFNESSES = (
    ("fabric modulus", "fabric", "young"),
    ("fabric thickness", "fabric", "thickness"),
    ("print modulus", "reinforcement", "young"),
    ("print thickness", "reinforcement", "thickness"),
)


def tolerances(
    problem: ShapeDesign, printed: PrintedDesign, config: ToleranceConfig | None = None
) -> ToleranceResult:
    """Return how a printed design moves if it is not made as drawn (collective).

    The print is simulated on a mesh along its borders. Where lines are wider or narrower,
    the vertices on these borders move, and the triangles stay the same: differences are not those
    of two meshes. Each variant starts from the drawn skin's equilibrium.

    Args:
        problem: The design problem.
        printed: Its print, by `as_printed` or `printed_lines`.
        config: How far what is off; None takes the defaults.

    Raises:
        NoEquilibriumError: The print has no equilibrium.
        ParameterError: An argument has another type.
    """
    require_kind("problem", problem, ShapeDesign, "a ShapeDesign")
    require_kind("printed", printed, PrintedDesign, "a PrintedDesign, by as_printed")
    require_kind("config", config, (ToleranceConfig, type(None)), "a ToleranceConfig, or None")
    made = printed.evaluation
    if made is None:
        raise NoEquilibriumError(f"the print has no equilibrium: {printed.failure}")
    require_kind("the problem of the print", made.problem, ShapeDesign, "a ShapeDesign")
    assert isinstance(made.problem, ShapeDesign)
    problem, part = made.problem, made.problem.skin.pattern
    return simulated_tolerances(
        problem,
        config,
        whole=(printed.pattern, printed.regions),
        limits=printed.limits,
        near=(part, problem.physics.shape_of(made.equilibrium)),
        pressures=made.equilibrium.pressures,
        own_mesh=problem.metrics_of(made.equilibrium),
    )


def simulated_tolerances(
    problem: ShapeDesign,
    config: ToleranceConfig | None,
    *,
    whole: tuple[Pattern, Regions],
    limits: PrintLimits,
    near: tuple[Pattern, Floats] | None,
    pressures: Sequence[float],
    own_mesh: Mapping[str, float],
) -> ToleranceResult:
    """Return the same of a problem that is on a mesh along the print (collective).

    Args:
        problem: The design problem.
        config: How far what is off; None takes the defaults.
        whole: The whole pattern, and the print on each of its panels.
        limits: Limits of the printer.
        near: Pattern of the part and positions of all its vertices, (n, 3), in m, to start from;
            None starts from the assembled shape.
        pressures: In Pa, of each chamber.
        own_mesh: Metrics by key on the mesh of the design, to compare with, as far as known.

    Raises:
        NoEquilibriumError: The print has no equilibrium.
    """
    begin = time.perf_counter()
    study = _Study(problem, whole, limits, near, pressures)
    middle = time.perf_counter()
    variants = tuple(study.variants(config or ToleranceConfig()))
    as_drawn = on_first_rank(problem.comm, lambda: printability(*whole, limits))
    return ToleranceResult(
        metrics=tuple(problem.metrics),
        nominal=study.nominal,
        own_mesh=own_mesh,
        drawn=as_drawn,
        pressure=study.equilibrium.pressure,
        variants=variants,
        triangles=len(problem.skin.pattern.panel),
        steps=(study.equilibrium.steps, sum(v.steps for v in variants)),
        seconds=(middle - begin, time.perf_counter() - middle),
    )


class _Study:
    """The drawn skin at its equilibrium, and its variants; all methods are collective."""

    def __init__(
        self,
        problem: ShapeDesign,
        whole: tuple[Pattern, Regions],
        limits: PrintLimits,
        near: tuple[Pattern, Floats] | None,
        pressures: Sequence[float],
    ) -> None:
        self.problem, self.whole, self.limits = problem, whole, limits
        skin, start = problem.skin, None
        self.pattern, self.comm = skin.pattern, skin.comm
        if near is not None:
            positions = make_transfer(near[0], self.pattern).positions(near[1])
            start = problem.physics.state_at(positions)
        made: Evaluation[Equilibrium] = problem.simulate_binary(
            np.zeros(len(skin.owned_cells)), start=start, pressure=pressures
        )
        self.density, self.equilibrium = made.projected, made.equilibrium
        self.density_of_all = skin.gather_cells(self.density)
        self.nominal = values_at(problem, self.equilibrium.positions)

    def variants(self, config: ToleranceConfig) -> Iterator[Variant]:
        """Yield all variants by quantity, from less to more."""
        if config.width is not None:
            yield from self._widths(config.width)
        sizes = {"young": config.modulus, "thickness": config.thickness}
        for name, material, part in STIFFNESSES:
            if (size := sizes[part]) is not None:
                yield from self._stiffnesses(name, material, part, size)
        if config.pressure_change is not None:
            yield from self._pressures(config.pressure_change)

    def _widths(self, width: float) -> Iterator[Variant]:
        pattern, unknowns = (
            self.pattern,
            self.problem.solver.model.patch.gather(self.equilibrium.state),
        )
        printed = self.density_of_all > 0.5
        motion = on_first_rank(self.comm, lambda: border_motion(pattern, printed, width))

        for factor in (-2, -1, 1, 2):
            # A line is wider by twice the way of its borders.
            way = factor * width / 2 * motion
            other = on_first_rank(
                self.comm, partial(with_flat_points, pattern, pattern.flat_points + way)
            )
            skin = MovedSkin(self.problem.on(other), pattern, way, unknowns)
            found = self._solved("print width", factor * width, moved=skin)
            yield self._worn(found, skin)

    def _stiffnesses(self, name: str, material: str, part: str, size: float) -> Iterator[Variant]:
        composite = self.problem.solver.model.composite

        def changed(factor: float) -> Composite:
            sheet = getattr(composite, material)
            other = replace(sheet, **{part: factor * getattr(sheet, part)})
            return replace(composite, **{material: other})

        for amount in (-size, size):
            solver = self.problem.solver.like(composite=changed(1 + amount), log=None)
            yield self._solved(name, amount, solver)

    def _pressures(self, size: float) -> Iterator[Variant]:
        for amount in (-size, size):
            pressures = [(1 + amount) * p for p in self.equilibrium.pressures]
            yield self._solved("pressure", amount, pressures=pressures)

    def _solved(
        self,
        quantity: str,
        amount: float,
        solver: EquilibriumSolver | None = None,
        pressures: Sequence[float] | None = None,
        moved: MovedSkin | None = None,
    ) -> Variant:
        """Return a variant, at the places of the skin as drawn.

        Solver and pressures are those of the drawn skin, if the quantity changes no others.
        """
        density, start = self.density, self.equilibrium.state.copy()
        if moved is not None:
            solver, start = moved.problem.solver, moved.state()
            density = self.density_of_all[moved.problem.skin.owned_cells]
        solver = solver or self.problem.solver
        load = Load(pressures or self.equilibrium.pressures, self.problem.physics.force)
        try:
            found = solver.solve(density, load, start if solver.model.admits(start) else None)
        except EquilibriumError as caught:  # raised by all ranks or by none
            return Variant(quantity, amount, {}, (str(caught),), caught.steps)
        notes = (found.condition.sentences,) if found.condition.sentences else ()
        places = found.positions
        if moved is not None:
            places = moved.before(places)[self.problem.skin.owned_vertices]
        values = values_at(self.problem, places)
        return Variant(quantity, amount, values, notes, found.steps)

    def _worn(self, variant: Variant, skin: MovedSkin) -> Variant:
        """Return a variant with what its lines and gaps have become."""
        (pattern, regions), limits = self.whole, self.limits
        printed, own = self.density_of_all > 0.5, self.pattern

        def measure() -> Variant:
            made = offset_print(pattern, regions, variant.change / 2, limits.resolution)
            notes = broken_lines(pattern, regions, made, limits.resolution)
            polygons = sum(a.area - b.area for a, b in zip(made, regions, strict=True))
            areas = skin.problem.skin.pattern.areas - own.areas
            mesh = float(areas[printed].sum() * (pattern.areas.sum() / own.areas.sum()))
            return replace(
                variant,
                notes=(*notes, *variant.notes),
                made=printability(pattern, made, limits),
                areas=(polygons, mesh),
            )

        return on_first_rank(self.comm, measure)


def offset_print(
    pattern: Pattern, regions: Regions, offset: float, resolution: float
) -> list[BaseGeometry]:
    """Return a print whose borders have moved outwards; the panel's border is none of them.

    Args:
        pattern: The pattern.
        regions: Print on each panel, polygons in m.
        offset: Way of each border in m, below 0 inwards: a line gets wider by twice as much.
        resolution: Distance of samples in m, as of `PrintLimits`.
    """
    found = []
    for panel, region in enumerate(regions):
        outline = pattern.outline(panel)
        if offset >= 0:
            found.append(region.buffer(offset) & outline)
        else:
            found.append(region.difference(fabric_of(region, outline, resolution).buffer(-offset)))
    return found


def broken_lines(
    pattern: Pattern,
    drawn: Regions,
    made: Regions,
    resolution: float,
) -> list[str]:
    """Return what vanishes, parts or merges between a print as drawn and as made, as sentences."""
    lines: Ints = np.zeros(3, dtype=np.int64)
    gaps: Ints = np.zeros(3, dtype=np.int64)
    for panel, (one, two) in enumerate(zip(drawn, made, strict=True)):
        outline = pattern.outline(panel)
        lines += _events(one, two)
        gaps += _events(*(fabric_of(region, outline, resolution) for region in (one, two)))
    # A ring of print that opens joins the fabric inside to that around it, and the reverse.
    events = (
        (lines[0], "line vanishes", "lines vanish"),
        (lines[1] + gaps[2], "line parts", "lines part"),
        (gaps[0], "gap closes", "gaps close"),
        (gaps[1] + lines[2], "line touches another", "lines touch others"),
    )
    return [f"{n} {one if n == 1 else several}." for n, one, several in events if n]


def _events(before: BaseGeometry, after: BaseGeometry) -> Ints:
    """Return the numbers of pieces that vanish, that part and that merge, (3,)."""
    one, two = (shapely.get_parts(shape) for shape in (before, after))
    one, two = (parts[shapely.area(parts) > 0] for parts in (one, two))
    pairs = shapely.STRtree(two).query(one, predicate="intersects")
    shares = shapely.area(shapely.intersection(one[pairs[0]], two[pairs[1]])) > 0
    here, there = (np.unique(own) for own in pairs[:, shares])
    count = int(shares.sum())
    return np.array([len(one) - len(here), count - len(here), count - len(there)])


class MovedSkin:
    """The same skin with its print's borders moved (all methods are collective).

    Attributes:
        problem: Its design problem.
        unknowns: Where the equilibrium's unknowns go with the mesh, by original index.

    Args:
        problem: The problem on the moved pattern.
        nominal: The pattern before.
        motion: Way of the flat points, (m, 2), in m.
        unknowns: Unknowns of the equilibrium before, as of `Patch.gather`.
    """

    def __init__(
        self, problem: ShapeDesign, nominal: Pattern, motion: Floats, unknowns: Floats
    ) -> None:
        self.problem, self._nominal, self._motion = problem, nominal, motion
        count = 3 * len(nominal.points)
        places = unknowns[:count].reshape(-1, 3)
        moved = places + self._carried(nominal, places)
        self.unknowns = np.concatenate([moved.ravel(), unknowns[count:]])

    def state(self) -> Floats:
        """Return the state of this rank."""
        return self.problem.solver.model.patch.scatter(self.unknowns)

    def before(self, owned: Floats) -> Floats:
        """Return where all vertices' places before the move are in a shape, (n, 3), in m.

        Metrics and objectives sort vertices by their places; so these stay the same ones. Ranks may
        own others than those of the skin before the move.
        """
        skin = self.problem.skin
        positions = skin.gather_vertices(owned)
        return np.asarray(positions - self._carried(skin.pattern, positions))

    def _carried(self, pattern: Pattern, positions: Floats) -> Floats:
        """Return the way of all vertices with the deformed mesh, (n, 3)."""
        way = carried_along(pattern, positions, self._motion)
        # What is held stays where the supports have it.
        held = self.problem.skin.pattern.points - self._nominal.points
        fixed = self.problem.solver.model.supports.fixed
        return np.where(fixed, held, way)


def values_at(problem: ShapeDesign, owned: Floats) -> dict[str, float]:
    """Return objective and metrics at positions of the owned nodes, by key (collective)."""
    return {OBJECTIVE: problem.objective.forward(owned), **problem.metrics_at(owned)}
