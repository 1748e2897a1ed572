"""The design problem of a tile: a density towards a profile of stiffness, and its numbers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated

from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.base.keys import Count, Flag, In, Number, Positive, Table, key
from toros_fem.base.scene import Scene
from toros_fem.design.density.filters import group_mean, make_filter
from toros_fem.design.density.length_scale import LengthScale, LengthScaleConstraints
from toros_fem.design.density.perimeter import Perimeter
from toros_fem.design.loop.fields import DensityFields
from toros_fem.design.loop.problem import DesignProblem, ObjectiveTerm
from toros_fem.mechanics.equilibrium.continuation import NewtonStep
from toros_fem.mechanics.skin.periodicity import Periodic
from toros_fem.meshes.makers.tile import Tile, tile
from toros_fem.meshes.skin import sew
from toros_fem.products.tables.sheets import Sheets
from toros_fem.products.tables.steps import FilterTable, PrinterTable
from toros_fem.products.tiles.stiffness_profile import (
    Profile,
    ProfileObjective,
    ProfileSolver,
    ProfileTarget,
    tile_solver,
)


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
