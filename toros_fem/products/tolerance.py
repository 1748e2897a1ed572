"""Skins that are not made as drawn, simulated from the equilibrium of the drawn one."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import NoEquilibriumError
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.validation import Floats, Ints, require_kind
from toros_fem.design.loop.problem import Evaluation
from toros_fem.design.loop.shape_design import ShapeDesign, carried_along
from toros_fem.making.as_printed import PrintedDesign
from toros_fem.making.contours import fabric_of
from toros_fem.making.printability import Printability, PrintLimits, printability
from toros_fem.materials.sheet import Composite
from toros_fem.measures.figures import NONE
from toros_fem.measures.metrics import Metric
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium, EquilibriumError
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.load import Load
from toros_fem.meshes.panels import border_motion, with_flat_points
from toros_fem.meshes.pattern import Pattern, Regions
from toros_fem.meshes.transfer import make_transfer
from toros_fem.products.common.options import ToleranceConfig

# What is off, and how it reads where it is less and where it is more.
WORDS = {
    "print width": ("a print {} too narrow", "a print {} too wide"),
    "fabric modulus": ("fabric {} too soft", "fabric {} too stiff"),
    "fabric thickness": ("fabric {} too thin", "fabric {} too thick"),
    "print modulus": ("a print {} too soft", "a print {} too stiff"),
    "print thickness": ("a print {} too thin", "a print {} too thick"),
    "pressure": ("a pressure {} too low", "a pressure {} too high"),
}
OBJECTIVE = "objective"
# Parts of the materials that may be off: what they are called, and material and field.
STIFFNESSES = (
    ("fabric modulus", "fabric", "young"),
    ("fabric thickness", "fabric", "thickness"),
    ("print modulus", "reinforcement", "young"),
    ("print thickness", "reinforcement", "thickness"),
)


@dataclass(frozen=True, eq=False)
class Variant:
    """A skin of which one quantity is off.

    Attributes:
        quantity: What is off, a key of `WORDS`.
        change: By how much: a width in m, all else as a fraction.
        values: Objective and metrics by key, simulated; empty without an equilibrium.
        notes: What is not as usual, as sentences: lines that vanish or merge, another equilibrium.
        steps: Number of Newton steps.
        made: Lines and gaps of the print; None where it is as drawn.
        areas: Change of the printed area in m², of the polygons and of the mesh; None where the
            print is as drawn.
    """

    quantity: str
    change: float
    values: Mapping[str, float]
    notes: tuple[str, ...] = ()
    steps: int = 0
    made: Printability | None = None
    areas: tuple[float, float] | None = None

    @property
    def amount(self) -> str:
        """Size of the change without its sign, such as "0.1 mm" or "20 %"."""
        size = abs(self.change)
        return f"{1e3 * size:g} mm" if self.quantity == "print width" else f"{100 * size:g} %"

    @property
    def label(self) -> str:
        """Change with its sign, such as "+0.1 mm"."""
        return f"{'−' if self.change < 0 else '+'}{self.amount}"

    @property
    def words(self) -> str:
        """The change in words, such as "a print 0.1 mm too narrow"."""
        return WORDS[self.quantity][self.change > 0].format(self.amount)


@dataclass(frozen=True, eq=False)
class ToleranceResult:
    """What a skin does that is not made as drawn.

    Attributes:
        metrics: Numbers that the design is judged by, the most important first.
        nominal: Objective and metrics by key as drawn, on the mesh along the print.
        own_mesh: Metrics by key on the mesh of the design; empty if not known.
        drawn: Lines and gaps of the print as drawn.
        pressure: Pressure in Pa.
        variants: All variants, by quantity and change.
        triangles: Number of triangles of the mesh.
        steps: Number of Newton steps as drawn, and of all variants together.
        seconds: Wall time as drawn, on its mesh, and of all variants together.
    """

    metrics: tuple[Metric, ...]
    nominal: Mapping[str, float]
    own_mesh: Mapping[str, float]
    drawn: Printability
    pressure: float
    variants: tuple[Variant, ...]
    triangles: int
    steps: tuple[int, int]
    seconds: tuple[float, float]

    def change(self, variant: Variant, key: str) -> float | None:
        """Return by how much a metric, or the objective, moves; None without an equilibrium."""
        found = variant.values.get(key)
        return None if found is None else found - self.nominal[key]

    def worst(self, key: str) -> Variant | None:
        """Return the variant that moves a metric most: one without an equilibrium before all."""
        failed = [v for v in self.variants if not v.values]
        if failed:
            return failed[0]
        nominal = self.nominal[key]
        return max(self.variants, key=lambda v: abs(v.values[key] - nominal), default=None)

    def sentence(self, variant: Variant, metric: Metric) -> str:
        """Return what a variant does to a metric, such as "… costs 4° of the angle"."""
        words = variant.words[:1].upper() + variant.words[1:]
        if not variant.values:
            return f"{words} has no equilibrium: {' '.join(variant.notes)}"
        before, after = self.nominal[metric.key], variant.values[metric.key]
        change = after - before
        what = f"changes the {metric.name} by {metric.formatted(change, 2, sign=True)}"
        if metric.target is not None and abs(after) < abs(before) <= abs(metric.target):
            what = f"costs {metric.formatted(abs(change), 2)} of the {metric.name}"
        return (
            f"{words} {what}: {metric.formatted(before, 4)} becomes {metric.formatted(after, 4)}."
        )

    @property
    def worst_of_each(self) -> list[tuple[Metric, Variant]]:
        """The variant that moves each metric most; empty without variants."""
        found = [(metric, self.worst(metric.key)) for metric in self.metrics]
        return [(metric, variant) for metric, variant in found if variant is not None]

    @property
    def worst_sentences(self) -> list[str]:
        """What moves each metric most, as sentences."""
        return list(dict.fromkeys(self.sentence(v, metric) for metric, v in self.worst_of_each))

    def report(self) -> str:
        """Return what a reader is told: as drawn, a table of all variants, the worst of them."""
        drawn, own = (
            ", ".join(f"{m.name} {m.formatted(v[m.key], 4)}" for m in self.metrics if m.key in v)
            for v in (self.nominal, self.own_mesh)
        )
        ways = zip(("line", "gap"), _thinnest(self.drawn).values(), strict=True)
        thinnest = [f"{name} {way:.2f} mm" for name, way in ways if way is not None]
        rows = [["", "", *(m.name for m in self.metrics), "objective", "line, gap (mm)"]]
        lines = [
            f"As drawn: {drawn} at {self.pressure / 1e3:.2f} kPa, {self.triangles} triangles that "
            f"follow the print; on the mesh of the design {own}.",
            *([f"Thinnest {', '.join(thinnest)}."] if thinnest else []),
            "Changes as simulated:",
            *_aligned([*rows, *map(self._cells, self.variants)]),
            *(f"{v.words}: {note}" for v in self.variants for note in v.notes),
            *self.worst_sentences,
            f"{self.seconds[0]:.1f} s and {self.steps[0]} Newton steps as drawn, "
            f"{self.seconds[1]:.1f} s and {self.steps[1]} for {len(self.variants)} variants",
        ]
        return "\n".join(lines)

    def _cells(self, v: Variant) -> list[str]:
        """Return the cells of a variant in the table of the report."""
        changes = [m.formatted(self.change(v, m.key), sign=True) for m in self.metrics]
        change = self.change(v, OBJECTIVE)
        objective = NONE if change is None else f"{change:+.2e}".replace("-", "−")
        ways = [] if v.made is None else _thinnest(v.made).values()
        made = ", ".join(NONE if way is None else f"{way:.2f}" for way in ways)
        return [v.quantity, v.label, *changes, objective, made]

    def rows(self) -> list[dict[str, Any]]:
        """Return a row for each variant, as tables have them."""
        found = []
        for v in self.variants:
            row: dict[str, Any] = {"quantity": v.quantity, "change": v.label}
            for key in self.nominal:
                row[key] = v.values.get(key)
                row[f"{key}_change"] = self.change(v, key)
            found.append(row | _thinnest(v.made) | {"newton_steps": v.steps})
        return found

    def summary(self) -> dict[str, Any]:
        """Return all figures as plain numbers; keys end in their units."""
        rows = self.rows()
        for row, v in zip(rows, self.variants, strict=True):
            row["relative" if v.quantity != "print width" else "change_m"] = v.change
            row["words"], row["notes"] = v.words, list(v.notes)
            if v.areas is not None:
                polygons, mesh = v.areas
                row["printed_area_change_mm2"] = {"polygons": 1e6 * polygons, "mesh": 1e6 * mesh}
        return {
            "pressure_pa": self.pressure,
            "nominal": dict(self.nominal),
            "own_mesh": dict(self.own_mesh),
            "targets": {m.key: m.target for m in self.metrics},
            **_thinnest(self.drawn),
            "variants": rows,
            "worst": {
                metric.key: {
                    "quantity": v.quantity,
                    "change": v.label,
                    "value_change": self.change(v, metric.key),
                    "sentence": self.sentence(v, metric),
                }
                for metric, v in self.worst_of_each
            },
            "triangles": self.triangles,
            "newton_steps": {"nominal": self.steps[0], "variants": self.steps[1]},
            "seconds": {"nominal": self.seconds[0], "variants": self.seconds[1]},
        }


def _aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return rows of cells as lines, the first two columns to the left and others to the right."""
    columns = []
    for k, column in enumerate(zip(*rows, strict=True)):
        width = max(map(len, column))
        columns.append([cell.ljust(width) if k < 2 else cell.rjust(width) for cell in column])
    return ["  ".join(cells).rstrip() for cells in zip(*columns, strict=True)]


def _thinnest(made: Printability | None) -> dict[str, float | None]:
    """Return the thinnest line and gap in mm; None where there is none, or no other print."""
    found = {} if made is None else made.summary()
    return {key: found.get(key) for key in ("smallest_width_mm", "smallest_gap_mm")}


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
