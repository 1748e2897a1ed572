"""A print on another mesh than its own, to compare with or to start from."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import ParameterError, TorosError
from toros_fem.base.mpi import free_dropped
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.problem import Evaluation
from toros_fem.design.loop.regularisation import Regularisation
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.making.as_printed.as_printed import PrintedDesign, Shape, state_near
from toros_fem.making.print.regions import case_of_print
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.meshes.pattern import Pattern, Regions
from toros_fem.products.actuators.job import Job

if TYPE_CHECKING:
    from toros_fem.products.actuators.scene import DesignScene, Level

# Number of coarser meshes that a print is simulated on, where there are so many.
COARSER_MESHES = 2
# A pattern and the print on each of its panels, polygons in m.
Printed = tuple[Pattern, Regions]


@dataclass(frozen=True, eq=False)
class SimulatedPrint:
    """What is simulated again, on another mesh.

    Attributes:
        near: The shape that the simulation starts from.
        printed: The print; None for a skin without one.
        pressures: Pressure of each chamber in Pa; None takes those of the scene.
    """

    near: Shape
    printed: Printed | None
    pressures: Sequence[float] | None

    @classmethod
    def of(cls, printed: PrintedDesign) -> SimulatedPrint:
        """Return a print that has an equilibrium, which is where it starts (collective)."""
        assert printed.evaluation is not None
        pressures = printed.evaluation.equilibrium.pressures
        return cls(_shape(printed.evaluation), (printed.pattern, printed.regions), pressures)


def simulated_on(
    job: Job, level: Level, simulated: SimulatedPrint, ratio: float
) -> Evaluation[Equilibrium]:
    """Simulate a print on another mesh (collective).

    Args:
        level: The mesh.
        simulated: The print.
        ratio: How much longer its edges are than those of the print's own mesh.

    Raises:
        NoEquilibriumError: There is none.
    """
    case, rules = job.scene.case(job.comm, level), level.regularisation
    return simulated_again(job.comm, case, rules, simulated, ratio)


def simulated_again(
    comm: MPI.Comm, case: Case, rules: Regularisation, simulated: SimulatedPrint, ratio: float
) -> Evaluation[Equilibrium]:
    """Simulate a print on the mesh of a case, as `simulated_on` does (collective)."""
    if simulated.printed is not None:
        case = case_of_print(comm, case, *simulated.printed, coarser=ratio)
    problem = ShapeDesign(comm, case, rules.plain)
    start, plain = state_near(problem, *simulated.near), np.zeros(len(problem.designed))
    return problem.simulate_binary(plain, start=start, pressure=simulated.pressures)


def coarser_levels(scene: DesignScene, level: Level) -> dict[float, Level]:
    """Return coarser meshes, by their edge length over that of a level.

    Raises:
        ParameterError: There is none.
    """
    found: dict[float, Level] = {}
    ratio = 1.0
    for _ in range(COARSER_MESHES):
        try:
            more, level = scene.coarser(level)
        except ParameterError:
            if not found:
                raise
            break
        ratio *= more
        found[ratio] = level
    return found


def near_on_coarser(job: Job, level: Level, simulated: SimulatedPrint) -> Shape:
    """Return the shape of a print on a coarser mesh, or the given one without any (collective).

    The steps from a far start are cheap there. The coarsest mesh comes first.
    """
    others: dict[float, Level] = {}
    with suppress(TorosError):  # raised by all ranks or by none, as below
        others = coarser_levels(job.scene, level)
    for ratio, other in reversed(others.items()):
        with suppress(TorosError):
            simulated = replace(simulated, near=_shape(simulated_on(job, other, simulated, ratio)))
        free_dropped(job.comm)
    return simulated.near


def _shape(made: Evaluation[Equilibrium]) -> Shape:
    skin = made.problem.skin
    return skin.pattern, skin.gather_vertices(made.equilibrium.positions)
