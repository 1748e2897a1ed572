"""The design problem of a tile: a density towards a profile of stiffness, and its print."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any, override

import numpy as np
import shapely
from mpi4py import MPI
from shapely.affinity import translate
from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import NoEquilibriumError, PatternError
from toros_fem.base.keys import Count, Flag, In, Number, Positive, Table, key
from toros_fem.base.mpi import together
from toros_fem.base.scene import Scene
from toros_fem.base.validation import Bools, Floats, Ints
from toros_fem.design.density.filters import group_mean, make_filter
from toros_fem.design.density.length_scale import LengthScale, LengthScaleConstraints
from toros_fem.design.density.perimeter import Perimeter
from toros_fem.design.loop.fields import DensityFields
from toros_fem.design.loop.loop import DesignResult
from toros_fem.design.loop.problem import DesignProblem, ObjectiveTerm
from toros_fem.making.as_printed import cleaned_print
from toros_fem.making.cleaning import Panels
from toros_fem.making.contours import Widths, measure_widths
from toros_fem.making.printability import PanelRegion, PrintLimits, with_more
from toros_fem.materials.sheet import Bending
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.iteration import NewtonStep
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.readings.error_estimate import edge_of, half_width
from toros_fem.mechanics.terms.periodic import Periodic
from toros_fem.meshes.panels import Affine
from toros_fem.meshes.skin import sew
from toros_fem.meshes.tiles import SYMMETRIES, Tile, tile
from toros_fem.meshes.triangles import edges_of, following, linked
from toros_fem.products.actuators.estimates import COARSER, COARSER_MESHES
from toros_fem.products.common.tables import FilterTable, PrinterTable, Sheets
from toros_fem.products.tiles.stiffness_profile import (
    Profile,
    ProfileObjective,
    ProfileSolver,
    ProfileTarget,
    profiles,
    tile_solver,
)

# Number of strains at which the stress curves of a print are computed.
CURVE_POINTS = 4
# Angle in degrees between the directions of a print's whole profile, and for each symmetry that
# after which it repeats them, and whether mirrored.
ANGLE_STEP = 7.5
PERIODS = {
    "none": (180, False),
    "orthotropic": (90, True),
    "chiral": (90, False),
    "tetragonal": (45, True),
}
# Directions closer than this, in rad, are the same.
SAME_ANGLE = 1e-9
# What no coarser mesh tells, at edges as long as the tile: of a stiffness as a part of it.
UNSEEN = {"stiffness": 0.2, "contraction": 0.1}
# Units of the figures of a profile.
UNITS = {"stiffness": "n_per_m", "contraction": "fraction"}
log = logging.getLogger(__name__)
# Number of tiles along each side where lines and gaps are measured; one lies in the middle.
SIDE = 3
# Contours of neighbouring tiles meet within rounding; this is the grid to merge them on, relative
# to the tile.
SNAP = 1e-7


class PullTable(Table):
    """Pull test."""

    strain: Annotated[float, In(above=-1)] = key(0.1, "strain λ − 1 at which stiffness is computed")


class Searching(FilterTable):
    """Steps, filter and start of the design.

    A printed stiffness within `tolerance` of its target needs no correction. A design ends early
    where its objective is at most the square of half the tolerance.
    """

    power: Annotated[float, In(at_least=1, at_most=10)] = key(
        1.0, "power q of the projection: 1 as in the paper; more takes stiffness from grey print"
    )
    starts: Count = key(12, "largest number of random starts, lines and waves by turns")
    trial_iterations: Count = key(
        12,
        "largest number of steps of each start, at β and again at 4 β",
        free=True,
    )
    draft_iterations: Count = key(
        40,
        "largest number of further steps of the two best starts, coarse mesh",
        free=True,
    )
    finish_iterations: Count = key(
        30,
        "largest number of steps on the design's mesh",
        free=True,
    )
    corrections: Number = key(
        3,
        "largest number of corrections of the target by the print's deviation",
        free=True,
    )
    correction_iterations: Count = key(
        15, "largest number of steps after each correction", free=True
    )
    tolerance: Positive = key(
        0.02, "relative deviation of a print; corrections go on to half of it"
    )
    constrained: Flag = key(True, "width constraints in all steps")


class TileDesignScene(Scene):
    """Strain, materials, search and printer of a tile design."""

    material: Sheets = Sheets()
    pull: PullTable = PullTable()
    design: Searching = Searching(filter_radius=0.7e-3)
    print: PrinterTable = PrinterTable(island_area=0.1e-6)


@dataclass(frozen=True, eq=False)
class TileCase:
    """A tile and its target.

    Attributes:
        comm: Communicator whose ranks share the directions.
        size, edge_length, mesh: Sides of the tile and edge length of its mesh in m, and the kind
            of this mesh, as for `meshes.tile.tile`.
        symmetry: Symmetry of design and mesh.
        angles: Directions of the objective, (k,), in rad; of a symmetric design only those that
            its symmetry does not repeat.
        objective: Objective of the profile in these directions.
    """

    comm: MPI.Comm
    size: tuple[float, float]
    edge_length: float
    mesh: str
    symmetry: str
    angles: Floats
    objective: ProfileObjective

    @cached_property
    def tile(self) -> Tile:
        """The tile on the mesh of the design (collective)."""
        return tile(self.comm, self.size, self.edge_length, self.mesh, self.symmetry)

    @cached_property
    def coarse(self) -> TileCase:
        """The same with edges twice as long, for the starts."""
        return replace(self, edge_length=2 * self.edge_length)

    @property
    def target(self) -> ProfileTarget | None:
        """The objective where it is a target profile; None where it is another objective."""
        return self.objective if isinstance(self.objective, ProfileTarget) else None


@dataclass(eq=False)
class TileProblem(DesignProblem[Profile]):
    """A tile whose print is designed so that its profile minimises an objective.

    Attributes:
        goal: Target profile for the metric "worst_percent", the largest relative deviation; None
            leaves the metric out. The objective may ask for another one.
    """

    fields: DensityFields
    physics: ProfileSolver
    goal: ProfileTarget | None = None

    def metrics_of(self, response: Profile) -> dict[str, float]:
        """Return the largest deviation from the target in %; nothing without a target."""
        if self.goal is None:
            return {}
        return {"worst_percent": 100 * self.goal.largest_deviation(response)}


def tile_problem(
    case: TileCase,
    config: TileDesignScene,
    log: Callable[[NewtonStep | str], None] | None = None,
) -> TileProblem:
    """Build the design problem of a tile, which each rank sews as a whole (collective)."""
    design, patch, lattice = config.design, case.tile, case.tile.lattice
    skin = sew(MPI.COMM_SELF, patch.pattern)
    solver = tile_solver(skin, config.material.composite, Periodic(patch), log=log)
    every = group_mean(skin, patch.symmetry_maps(case.symmetry))
    smooth = make_filter(design.filter, skin, design.filter_radius, lattice).after(every)
    projection, terms = design.projection, []
    if design.perimeter_weight is not None:
        window = design.perimeter_window * design.filter_radius
        perimeter = Perimeter(skin, window, design.perimeter_sharpness, beyond=lattice)
        price = design.perimeter_weight / patch.pattern.size
        terms = [ObjectiveTerm("perimeter", perimeter, price)]
    problem = TileProblem(
        DensityFields(skin, smooth, projection),
        ProfileSolver(solver, case.angles, config.pull.strain, case.comm),
        case.objective,
        terms,
        goal=case.target,
    )
    if design.constrained:
        widths = LengthScale(line_width=design.line_width, gap_width=design.gap_width)
        problem.length_scale = LengthScaleConstraints(
            skin, smooth, widths, problem.designed, projection
        )
    return problem


@dataclass(frozen=True, eq=False)
class TileResult:
    """A design of a tile and its print.

    Attributes:
        case, config: Tile and target, and the numbers of the design.
        problem: The design problem, with the objective of the case.
        result: Density, history and the reason why the loop ended.
        region: The print of this density on the tile, in m.
        cells: Whether each triangle of the mesh along the print is printed, (t,).
        solver: Solver on this mesh, in the directions of the objective, which the ranks share.
        profile: Profile of the print; None if it has no equilibrium.
        failure: Why there is no profile; empty if there is one.
        printability: Islands, lines and gaps of the print in the endless sheet.
        trials: The random starts, "lines" or "waves", after their first steps: T, islands and
            narrow places of each.
        deviations: That of each print, before and after each correction; empty without a target.
    """

    case: TileCase
    config: TileDesignScene
    problem: TileProblem
    result: DesignResult
    region: BaseGeometry
    cells: Bools
    solver: ProfileSolver
    profile: Profile | None
    failure: str
    printability: TilePrintability
    trials: Sequence[Mapping[str, Any]] = ()
    deviations: tuple[float, ...] = ()

    @property
    def tile(self) -> Tile:
        """The tile on the mesh along the print."""
        return self.solver.images.periodic.tile

    @property
    def density(self) -> Floats:
        """Density, 0 or 1, of this rank's triangles of this mesh."""
        return self.cells[self.solver.tile.skin.owned_cells].astype(np.float64)

    @property
    def deviation(self) -> float:
        """Largest relative deviation of this print from the target, 0 without one.

        Without an equilibrium it is infinite.
        """
        goal, profile = self.problem.goal, self.profile
        if profile is None:
            return np.inf
        return 0.0 if goal is None else goal.largest_deviation(profile)


def simulated_print(
    case: TileCase, config: TileDesignScene, problem: TileProblem, result: DesignResult
) -> TileResult:
    """Print a design, and simulate the print on a mesh along its borders (collective).

    Printed triangles are quadratic. The ranks of the case share the directions of the objective.

    Raises:
        PatternError: Borders of the print meet each other.
    """
    print_, domain = config.print, RepeatedTile(case.tile, case.symmetry)
    cleaned = cleaned_print(
        problem, result, print_.limits, island_area=print_.island_area, domain=domain
    )
    (region,) = cleaned.regions
    solver, cells = _solver_of(case, config, region, 1.0)
    widths = tile_printability(solver.images.periodic.tile, region, cells, print_.limits)
    made = TileResult(case, config, problem, result, region, cells, solver, None, "", widths)
    try:
        return replace(made, profile=solver.solve(made.density, gradients=False))
    except NoEquilibriumError as caught:  # raised by all ranks or by none
        return replace(made, failure=str(caught))


def _solver_of(
    case: TileCase, config: TileDesignScene, region: BaseGeometry, coarser: float
) -> tuple[ProfileSolver, Bools]:
    """Return the solver of a print, and whether each triangle of its mesh is printed, (t,)."""
    edge = coarser * case.edge_length
    tile, cells = case.tile.following(case.comm, region, edge, coarser=coarser)
    skin = sew(MPI.COMM_SELF, tile.pattern)
    one = tile_solver(skin, config.material.composite, Periodic(tile), quadratic=cells)
    return ProfileSolver(one, case.angles, config.pull.strain, case.comm), cells


@dataclass(frozen=True, eq=False)
class PrintMeasurement:
    """The response of a printed tile over directions and strains.

    Attributes:
        profile: Profile at all angles that the case's symmetry does not repeat.
        curves: Profiles in the directions of the objective at increasing strains, the design's
            strain last.
        fabric_stiffness: Stiffness of the fabric without print, in N/m.
        buckling: Whether the flat sheet buckles at this strain in each direction of the objective,
            so that a real one wrinkles, (k,).
        intervals: Half-widths of the intervals of stiffness in N/m and of contraction in these
            directions, (k,) each, by name; empty if there is no other mesh to compare with.
    """

    profile: Profile
    curves: tuple[Profile, ...]
    fabric_stiffness: float
    buckling: Bools
    intervals: Mapping[str, Floats]


def measure_print(made: TileResult) -> PrintMeasurement | None:
    """Compute profile, stress curves, buckling and intervals of a print (collective).

    The result is None if the print has no equilibrium in one of the directions.
    """
    designed = made.profile
    if designed is None:
        return None
    tile, batch, strain = made.solver.tile, made.solver.batch, designed.strain
    density, angles = made.density, directions(made.case.symmetry)
    others = angles[np.abs(angles[:, None] - designed.angles).min(axis=1) >= SAME_ANGLE]
    try:
        profile = designed
        if len(others):
            more = ProfileSolver(tile, others, strain, batch).solve(density, gradients=False)
            profile = merged(designed, more)
        fabric = ProfileSolver(tile, [0.0], strain, batch)
        unprinted = fabric.solve(np.zeros_like(density), gradients=False)
        strains = strain * np.arange(1, CURVE_POINTS) / CURVE_POINTS
        curves = profiles(tile, density, designed.angles, strains, batch)
    except NoEquilibriumError:  # raised by all ranks or by none
        return None
    stiffness = float(unprinted.stiffness[0])
    buckling = _buckling(made, designed)
    intervals = _intervals(made, designed)
    return PrintMeasurement(profile, (*curves, designed), stiffness, buckling, intervals)


def directions(symmetry: str) -> Floats:
    """Return directions in rad that a symmetry does not repeat."""
    period, mirrored = PERIODS[symmetry]
    return np.radians(ANGLE_STEP * np.arange(round(period / ANGLE_STEP) + mirrored))


def merged(one: Profile, other: Profile) -> Profile:
    """Return the values of two profiles of one tile and strain, sorted by direction, no states."""
    order = np.argsort(np.concatenate([one.angles, other.angles]))
    values: dict[str, Any] = {
        name: np.concatenate([getattr(one, name), getattr(other, name)])[order]
        for name in ("angles", "stress", "tangent", "contraction", "shear")
    }
    values["steps"] = one.steps + other.steps
    values["factorisations"] = one.factorisations + other.factorisations
    return Profile(strain=one.strain, states=(), gradients=(), **values)


def lifted(solver: EquilibriumSolver, flat: Equilibrium) -> Floats:
    """Return the state of a tile that may leave its plane from that of one kept there."""
    state, count = np.zeros(solver.model.size_local), flat.positions.size
    state[:count] = flat.state[:count]
    # Rotations of edges, which are 0, come between the positions and all else.
    others = flat.state[count:]
    state[len(state) - len(others) :] = others
    return state


def _intervals(made: TileResult, profile: Profile) -> dict[str, Floats]:
    """Return half-widths of a profile, as of `PrintMeasurement`, from coarser meshes (collective).

    A mesh on which the print has no equilibrium, or its borders meet, is left out.
    """
    case, others = made.case, {}
    for ratio in (COARSER ** (k + 1) for k in range(COARSER_MESHES)):
        try:
            solver, cells = _solver_of(case, made.config, made.region, ratio)
            density = cells[solver.tile.skin.owned_cells].astype(np.float64)
            others[ratio] = solver.solve(density, gradients=False)
        except (NoEquilibriumError, PatternError) as caught:  # raised by all ranks or by none
            if case.comm.rank == 0:
                log.warning("a coarser mesh is left out of the intervals: %s", caught)
    if not others:
        return {}
    extents, edge = (0.0, *case.size), edge_of(made.tile.pattern.areas)

    def widths(name: str, unit: str) -> Floats:
        values = getattr(profile, name)
        changes = {ratio: np.abs(getattr(one, name) - values) for ratio, one in others.items()}
        told = [
            half_width({r: change[k] for r, change in changes.items()}, unit, extents, edge)
            for k in range(len(values))
        ]
        size = np.abs(values) if name == "stiffness" else 1.0
        return np.array(told) + UNSEEN[name] * edge / min(case.size) * size

    return {name: widths(name, f"{name}_{unit}") for name, unit in UNITS.items()}


def _buckling(made: TileResult, profile: Profile) -> Bools:
    """Return whether the print buckles in each direction of its profile."""
    tile, batch = made.solver.tile, made.solver.batch
    found = np.zeros(len(profile.angles), dtype=bool)
    with together(batch):
        composite = replace(tile.model.composite, bending=Bending())
        around = Periodic(made.tile, flat=False)
        solver = tile_solver(tile.skin, composite, around, quadratic=made.cells)
        for k, flat in enumerate(profile.states):
            if flat is not None:
                found[k] = not solver.stable(made.density, flat.load, lifted(solver, flat))
    return np.asarray(batch.allreduce(found.astype(int)) > 0)


# ----------------------------------------------------------------- its print in the endless sheet


@dataclass(frozen=True, eq=False)
class TilePrintability:
    """Islands of a tile among its equals, in m², and its widths.

    A narrow place on the tile's border may be listed on both sides.
    """

    island_areas: Floats
    lines: Widths
    gaps: Widths

    @property
    def clean(self) -> bool:
        """Whether there are no islands, and no lines or gaps under the limit."""
        return not (len(self.island_areas) or self.narrow_places)

    @property
    def narrow_places(self) -> int:
        """Number of places where lines or gaps are under the limit."""
        return len(self.lines.narrow) + len(self.gaps.narrow)

    def summary(self) -> dict[str, Any]:
        """Return all results as plain numbers; each key ends in its unit."""
        line, gap = self.lines.smallest, self.gaps.smallest
        return {
            "islands": len(self.island_areas),
            "island_areas_mm2": (1e6 * self.island_areas).tolist(),
            "smallest_width_mm": line and 1e3 * line.width,
            "smallest_gap_mm": gap and 1e3 * gap.width,
            "narrow_places": len(self.lines.narrow),
            "tight_places": len(self.gaps.narrow),
        }


def tile_printability(
    tile: Tile, region: BaseGeometry, printed: Bools, limits: PrintLimits
) -> TilePrintability:
    """Measure the printability of a tile, its printed region in m and triangles (t,).

    Lines and gaps are measured in the middle one of `SIDE` × `SIDE` tiles: they continue.
    """
    sides, detail = np.diagonal(tile.lattice), limits.resolution
    middle = (SIDE // 2) * sides
    # Widths in the middle of a place on the border are counted on either side, not on neither.
    window = shapely.box(*(middle - detail), *(middle + sides + detail))
    many, sheet = repeated(region, tile, SIDE, SIDE), shapely.box(0, 0, *(SIDE * sides))
    widths = measure_widths(many, sheet, 0, limits.width, limits.gap, detail, window)
    return TilePrintability(island_areas(tile, printed), *widths)


class RepeatedTile(Panels):
    """`SIDE` × `SIDE` tiles, which are cleaned together, and of which the middle one is kept.

    Lines and gaps so go on across a tile's border. Pieces that end inside are islands: they do not
    reach their own images.

    Args:
        symmetry: Symmetry that the print keeps exactly, as for `Tile.symmetry_maps`.
    """

    repeats, sewn = True, False

    def __init__(self, tile: Tile, symmetry: str) -> None:
        self.pattern, self._tile = tile.pattern, tile
        self._sides = sides = np.diagonal(tile.lattice)
        self._operations = SYMMETRIES[symmetry]
        # Its images are the tile: all of it, a quarter, or an eighth.
        self.parts = [shapely.box(*(0 * sides if symmetry == "none" else sides / 2), *sides)]
        if symmetry == "tetragonal":
            self.parts = [shapely.Polygon([sides / 2, sides * [1, 0.5], sides])]
        self.outlines = [shapely.box(0, 0, *(SIDE * sides))]

    @override
    def laid(self, regions: Sequence[BaseGeometry]) -> list[BaseGeometry]:
        return [repeated(region, self._tile, SIDE, SIDE) for region in regions]

    @override
    def islands(self, laid: Sequence[BaseGeometry], limits: PrintLimits) -> list[PanelRegion]:
        pieces = shapely.get_parts(laid[0])
        loose = ~shapely.dwithin(self.outlines[0].boundary, pieces, limits.resolution)
        # Centroids of images differ by rounding; of those on two borders of the tile one counts.
        places = shapely.get_coordinates(shapely.centroid(pieces)) + limits.resolution
        home = np.all(places // self._sides == SIDE // 2, axis=1)
        chosen = pieces[loose & home]
        order = np.argsort(-shapely.area(chosen), kind="stable")
        return [PanelRegion(0, piece, main=False, attached=False) for piece in chosen[order]]

    @override
    def images(self, shape: BaseGeometry) -> BaseGeometry:
        most = 2 * SIDE - 1
        steps = self._sides * (_steps(most, most) + 1 - SIDE)
        return shapely.union_all([translate(shape, *step) for step in steps])

    @override
    def part(self, laid: Sequence[BaseGeometry], detail: float) -> list[BaseGeometry]:
        shift = SIDE // 2 * self._sides
        one = translate(laid[0], *-shift) & shapely.box(0, 0, *self._sides)
        (kept,) = self.parts
        own = one & kept
        for operation in self._operations[1:]:
            own = with_more(own, self._image(one, operation), kept, detail)
        return [own]

    @override
    def whole(self, own: Sequence[BaseGeometry]) -> list[BaseGeometry]:
        images = [self._image(own[0], operation) for operation in self._operations]
        return [shapely.union_all(images, grid_size=SNAP * float(self._sides.max()))]

    def _image(self, shape: BaseGeometry, operation: Ints) -> BaseGeometry:
        """Return a shape turned or mirrored about the tile's middle."""
        offset = self._sides / 2 - operation @ (self._sides / 2)
        return Affine(operation.astype(np.float64), offset).region(shape)


def _steps(along: int, across: int) -> Ints:
    return np.array(list(np.ndindex(along, across)))


def repeated(region: BaseGeometry, tile: Tile, along: int, across: int) -> BaseGeometry:
    """Return the union of copies of a tile's region in m along both lattice vectors."""
    copies = [translate(region, *(steps @ tile.lattice)) for steps in _steps(along, across)]
    return shapely.union_all(copies, grid_size=SNAP * float(np.abs(tile.lattice).max()))


def island_areas(tile: Tile, printed: Bools) -> Floats:
    """Return the areas in m² of the islands of printed triangles (t,), the largest first.

    Printed triangles belong to one component if they share edges. A component that reaches its own
    image in a neighbouring tile is a line or a net through the whole sheet; any other is an island.
    A line leads from a triangle to an image of it an odd number of tiles away along x or y. So the
    copies of a triangle on the torus of 2 × 2 tiles belong to one component on a line, and to four
    on an island.
    """
    count = len(printed)
    one, two = edges_of(tile.pattern.triangles).twins.T
    # The half-edge that follows the second of twins begins where the first does.
    shift = tile.wraps.reshape(-1, 2)[one] - tile.wraps.reshape(-1, 2)[following(two)]
    both = printed[one // 3] & printed[two // 3]
    one, two, shift = one[both] // 3, two[both] // 3, shift[both]
    home = _steps(2, 2)[:, None]
    there = (home + shift) % 2 @ [2, 1]
    body = linked(
        (one + count * np.arange(4)[:, None]).ravel(), (two + count * there).ravel(), 4 * count
    ).reshape(4, count)
    island = printed & (body[1:] != body[0]).all(axis=0)
    areas = np.bincount(body.min(axis=0)[island], tile.pattern.areas[island])
    return np.asarray(np.sort(areas[areas > 0])[::-1], dtype=np.float64)
