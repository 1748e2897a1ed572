"""Skins that are not made as drawn, simulated from the equilibrium of the drawn one."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import NoEquilibriumError
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.validation import require_kind
from toros_fem.design.loop.problem import Evaluation
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.making.as_printed.as_printed import PrintedDesign
from toros_fem.making.print.printability import PrintLimits, printability
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium, EquilibriumError
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load
from toros_fem.meshes.moving import border_motion, with_flat_points
from toros_fem.meshes.pattern import Pattern, Regions
from toros_fem.meshes.transfer import make_transfer
from toros_fem.products.options import ToleranceConfig
from toros_fem.products.tolerance.moved_skin import MovedSkin, values_at
from toros_fem.products.tolerance.result import Tolerances, Variant
from toros_fem.products.tolerance.worn import broken_lines, offset_print

# Parts of the materials that may be off: what they are called, and material and field.
STIFFNESSES = (
    ("fabric modulus", "fabric", "young"),
    ("fabric thickness", "fabric", "thickness"),
    ("print modulus", "reinforcement", "young"),
    ("print thickness", "reinforcement", "thickness"),
)


@dataclass(frozen=True, eq=False)
class Drawn:
    """A print on a whole skin, and where its simulation starts.

    Attributes:
        whole: The whole pattern, and the print on each of its panels.
        limits: Limits of the printer.
        near: Pattern of the part and positions of all its vertices, (n, 3), in m, to start from;
            None starts from the assembled shape.
        pressures: In Pa, of each chamber.
        own_mesh: Metrics by key on the mesh of the design, to compare with, as far as known.
    """

    whole: tuple[Pattern, Regions]
    limits: PrintLimits
    near: tuple[Pattern, Floats] | None
    pressures: Sequence[float]
    own_mesh: Mapping[str, float]


def tolerances(
    problem: ShapeDesign, printed: PrintedDesign, config: ToleranceConfig | None = None
) -> Tolerances:
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
    drawn = Drawn(
        (printed.pattern, printed.regions),
        printed.limits,
        (part, problem.physics.shape_of(made.equilibrium)),
        made.equilibrium.pressures,
        problem.metrics_of(made.equilibrium),
    )
    return simulated_tolerances(problem, drawn, config)


def simulated_tolerances(
    problem: ShapeDesign, drawn: Drawn, config: ToleranceConfig | None = None
) -> Tolerances:
    """Return the same of a problem that is on a mesh along the print (collective).

    Raises:
        NoEquilibriumError: The print has no equilibrium.
    """
    begin = time.perf_counter()
    study = _Study(problem, drawn)
    middle = time.perf_counter()
    variants = tuple(study.variants(config or ToleranceConfig()))
    as_drawn = on_first_rank(problem.comm, lambda: printability(*drawn.whole, drawn.limits))
    return Tolerances(
        metrics=tuple(problem.metrics),
        nominal=study.nominal,
        own_mesh=drawn.own_mesh,
        drawn=as_drawn,
        pressure=study.equilibrium.pressure,
        variants=variants,
        triangles=len(problem.skin.pattern.panel),
        steps=(study.equilibrium.steps, sum(v.steps for v in variants)),
        seconds=(middle - begin, time.perf_counter() - middle),
    )


class _Study:
    """The drawn skin at its equilibrium, and its variants; all methods are collective."""

    def __init__(self, problem: ShapeDesign, drawn: Drawn) -> None:
        self.problem, self.drawn = problem, drawn
        skin, start = problem.skin, None
        self.pattern, self.comm = skin.pattern, skin.comm
        if drawn.near is not None:
            positions = make_transfer(drawn.near[0], self.pattern).positions(drawn.near[1])
            start = problem.physics.state_at(positions)
        made: Evaluation[Equilibrium] = problem.simulate_binary(
            np.zeros(len(skin.owned_cells)), start=start, pressure=drawn.pressures
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
        (pattern, regions), limits = self.drawn.whole, self.drawn.limits
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
