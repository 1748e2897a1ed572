"""Skins that are not made as drawn, simulated from the equilibrium of the drawn one."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import NoEquilibriumError
from toros_fem.base.mpi import on_first_rank, require_alike
from toros_fem.base.validation import require_kind
from toros_fem.design.loop.problem import Evaluation, Pressure
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.making.as_printed.as_printed import PrintedDesign
from toros_fem.making.print.printability import (
    Printability,
    PrintLimits,
    printability,
    printed_cells,
)
from toros_fem.making.print.regions import part_regions
from toros_fem.making.print.widths import LocalWidth
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.equilibrium.solver import (
    EquilibriumError,
    EquilibriumResult,
    EquilibriumSolver,
)
from toros_fem.meshes.border_motion import border_motion
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.snap import snapped, with_flat_points
from toros_fem.meshes.transfer import make_transfer
from toros_fem.products.tolerance.rates import (
    MovedSkin,
    Rate,
    TangentRates,
    other_solver,
    values_at,
)
from toros_fem.products.tolerance.result import Tolerances, Variant
from toros_fem.products.tolerance.settings import ToleranceConfig
from toros_fem.products.tolerance.worn import broken_lines, offset_print

Remake = Callable[[Pattern], ShapeDesign]
# Step of differences by the way of the borders, over the way that is simulated: on stiff triangles
# the residual is far from linear in it.
BORDER_STEP = 1e-2
# Parts of the materials that may be off: what they are called, and material and field.
STIFFNESSES = (
    ("fabric modulus", "fabric", "young"),
    ("fabric thickness", "fabric", "thickness"),
    ("print modulus", "reinforcement", "young"),
    ("print thickness", "reinforcement", "thickness"),
)


@dataclass(frozen=True, eq=False)
class Drawn:
    """A print on a part of a skin and on the whole, and where its simulation starts.

    Attributes:
        regions: Print on each panel of the part that is simulated, polygons in m.
        whole: The whole pattern, and the print on each of its panels.
        limits: Limits of the printer.
        near: Pattern of the part and positions of all its vertices, (n, 3), in m, to start from;
            None starts from the assembled shape.
        pressure: In Pa, of all chambers or of each; None takes the problem's own.
        own_mesh: Metrics by key on the mesh of the design, to compare with; empty if not known.
    """

    regions: Sequence[BaseGeometry]
    whole: tuple[Pattern, Sequence[BaseGeometry]]
    limits: PrintLimits
    near: tuple[Pattern, Floats] | None
    pressure: Pressure | None
    own_mesh: Mapping[str, float] = field(default_factory=dict)


def tolerances(
    problem: ShapeDesign,
    printed: PrintedDesign,
    config: ToleranceConfig | None = None,
) -> Tolerances:
    """Return how a printed design moves if it is not made as drawn (collective).

    The print is simulated on a mesh that follows its borders. Where lines are wider or narrower,
    the vertices on these borders move, and the triangles stay the same: differences are not those
    of two meshes. Each variant starts from the drawn skin's equilibrium and its first-order change.

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
    require_alike(problem.comm, config=config)
    made, part = printed.evaluation, problem.skin.pattern
    if made is None:
        raise NoEquilibriumError(f"the print has no equilibrium: {printed.failure}")
    drawn = Drawn(
        on_first_rank(problem.comm, lambda: part_regions(part, printed.regions)),
        (printed.pattern, printed.regions),
        printed.limits,
        (part, problem.shape_of(made.equilibrium)),
        made.equilibrium.pressures,
        problem.metrics_of(made.equilibrium),
    )
    begin = time.perf_counter()
    following = problem.on(snapped(problem.comm, part, drawn.regions))
    return simulated_tolerances(following, problem.on, drawn, config, begin=begin)


def simulated_tolerances(
    problem: ShapeDesign,
    remake: Remake,
    drawn: Drawn,
    config: ToleranceConfig | None = None,
    *,
    begin: float,
) -> Tolerances:
    """Return how a print moves if it is not made as drawn (collective).

    Args:
        problem: The design problem, on a mesh that follows the print.
        remake: Returns the problem on a pattern with the same triangles, whose vertices have moved.
        drawn: The print.
        config: How far what is off; None takes the defaults.
        begin: When the work on the problem began, by `time.perf_counter`.

    Raises:
        NoEquilibriumError: The print has no equilibrium.
    """
    study = _Study(problem, remake, drawn, config or ToleranceConfig())
    middle = time.perf_counter()
    variants = tuple(study.variants())
    before = study.nominal_print
    return Tolerances(
        metrics=problem.metrics,
        nominal=study.nominal,
        own_mesh=drawn.own_mesh,
        smallest_width=_width(before.smallest_width),
        smallest_gap=_width(before.smallest_gap),
        pressure=study.evaluation.equilibrium.pressure,
        variants=variants,
        triangles=len(problem.skin.pattern.panel),
        steps=(study.evaluation.equilibrium.steps, sum(v.steps for v in variants)),
        seconds=(middle - begin, time.perf_counter() - middle),
    )


class _Study:
    """The drawn skin at its equilibrium, and its variants; all methods are collective."""

    def __init__(
        self, problem: ShapeDesign, remake: Remake, drawn: Drawn, config: ToleranceConfig
    ) -> None:
        self.problem, self.remake, self.drawn, self.config = problem, remake, drawn, config
        skin = problem.skin
        self.pattern, self.comm = skin.pattern, skin.comm
        cells = on_first_rank(self.comm, lambda: printed_cells(self.pattern, drawn.regions))
        start = None
        if drawn.near is not None:
            positions = make_transfer(drawn.near[0], self.pattern).positions(drawn.near[1])
            start = problem.state_at(positions)
        self.evaluation: Evaluation[EquilibriumResult] = problem.simulate_binary(
            cells[skin.owned_cells], start=start, pressure=drawn.pressure
        )
        self.density = self.evaluation.projected
        self.equilibrium = self.evaluation.equilibrium
        self.nominal = values_at(problem, self.equilibrium.positions)
        self.printed = skin.gather_cells(self.density) > 0.5
        self.rates = TangentRates(problem, self.density, self.equilibrium)
        self.nominal_print = on_first_rank(
            self.comm, lambda: printability(*drawn.whole, drawn.limits)
        )

    def variants(self) -> Iterator[Variant]:
        """Yield all variants by quantity, from less to more."""
        config = self.config
        if config.width is not None:
            yield from self._widths(config.width)
        for name, material, part in STIFFNESSES:
            size = config.modulus if part == "young" else config.thickness
            if size is not None:
                yield from self._stiffnesses(name, material, part, size)
        if config.pressure_change is not None:
            yield from self._pressures(config.pressure_change)

    def _widths(self, width: float) -> Iterator[Variant]:
        drawn, pattern = self.drawn, self.pattern
        motion = on_first_rank(
            self.comm, lambda: border_motion(pattern, drawn.regions, self.printed, width)
        )
        unknowns = self.problem.solver.model.gather(self.equilibrium.state)

        def moved(offset: float) -> MovedSkin:
            flat = pattern.flat_points + offset * motion
            other = on_first_rank(self.comm, lambda: with_flat_points(pattern, flat))
            return MovedSkin(self.remake(other), pattern, offset * motion, unknowns)

        # A line is wider by twice the way of its borders.
        step = BORDER_STEP * width / 2
        rate = self.rates.by_borders(moved(-step), moved(step), step)
        for factor in (-2, -1, 1, 2):
            offset = factor * width / 2
            yield self._width(moved(offset), factor * width, offset, rate)

    def _width(self, skin: MovedSkin, change: float, offset: float, rate: Rate) -> Variant:
        problem, drawn = skin.problem, self.drawn
        resolution = drawn.limits.resolution

        def measure() -> tuple[Printability, list[str], tuple[float, float]]:
            pattern, regions = drawn.whole
            made = offset_print(pattern, regions, offset, resolution)
            notes = broken_lines(pattern, regions, made, resolution)
            polygons = sum(a.area - b.area for a, b in zip(made, regions, strict=True))
            mesh = float((problem.skin.pattern.areas - self.pattern.areas)[self.printed].sum())
            mesh *= float(pattern.areas.sum() / self.pattern.areas.sum())
            return printability(pattern, made, drawn.limits), notes, (polygons, mesh)

        made, notes, areas = on_first_rank(self.comm, measure)
        along = offset * self.problem.solver.model.gather(rate.motion)
        density = self.problem.skin.gather_cells(self.density)[problem.skin.owned_cells]
        own = self.problem.skin.owned_vertices
        variant = self._solved(
            "print width", change, offset, rate, problem.solver, density,
            [skin.state(along), skin.state()], self.equilibrium.pressures,
            lambda found: skin.before(found.positions)[own],
        )  # fmt: skip
        return replace(
            variant,
            notes=(*notes, *variant.notes),
            smallest_width=_width(made.smallest_width),
            smallest_gap=_width(made.smallest_gap),
            areas=areas,
        )

    def _stiffnesses(self, name: str, material: str, part: str, size: float) -> Iterator[Variant]:
        composite = self.problem.solver.model.composite

        def changed(factor: float) -> Composite:
            sheet = getattr(composite, material)
            other = replace(sheet, **{part: factor * getattr(sheet, part)})
            return replace(composite, **{material: other})

        rate = self.rates.by_composite(changed)
        for change in (-size, size):
            solver = other_solver(self.problem, changed(1 + change))
            yield self._solved(
                name, change, change, rate, solver, self.density,
                self._starts(change, rate), self.equilibrium.pressures,
            )  # fmt: skip

    def _pressures(self, size: float) -> Iterator[Variant]:
        rate = self.rates.by_pressure()
        for change in (-size, size):
            pressures = [(1 + change) * p for p in self.equilibrium.pressures]
            yield self._solved(
                "pressure", change, change, rate, self.problem.solver, self.density,
                self._starts(change, rate), pressures,
            )  # fmt: skip

    def _starts(self, way: float, rate: Rate) -> list[Floats]:
        state = self.equilibrium.state
        return [state + way * rate.motion, state.copy()]

    def _solved(
        self,
        quantity: str,
        change: float,
        way: float,
        rate: Rate,
        solver: EquilibriumSolver,
        density: Floats,
        starts: Sequence[Floats],
        pressures: Sequence[float],
        places: Callable[[EquilibriumResult], Floats] = lambda found: found.positions,
    ) -> Variant:
        """Return a variant, from the first of the starts that bounds and contact admit.

        Args:
            quantity, change: What is off, and by how much.
            way: The same in the unit of the rate.
            rate: Derivatives.
            solver: Solver of the variant.
            density: Density of its owned triangles.
            starts: States to start from.
            pressures: In Pa, of each chamber.
            places: Returns positions of the owned nodes of the drawn skin.
        """
        predicted = {key: value + way * rate.values[key] for key, value in self.nominal.items()}
        model = solver.model
        inside = [s for s in starts if model.admits(s)]
        try:
            found = solver.solve(
                density,
                pressures,
                force=self.problem.force,
                start=inside[0] if inside else None,
            )
        except EquilibriumError as caught:  # raised by all ranks or by none
            return Variant(quantity, change, {}, predicted, (str(caught),), caught.steps)
        sentences = found.condition.sentences
        return Variant(
            quantity,
            change,
            values_at(self.problem, places(found)),
            predicted,
            (sentences,) if sentences else (),
            found.steps,
        )


def _width(place: LocalWidth | None) -> float | None:
    return None if place is None else place.width
