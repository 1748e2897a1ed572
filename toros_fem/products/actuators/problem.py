"""The density problem of an actuator's case."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from mpi4py import MPI

from toros_fem.design.density.projection import Projection
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.making.print.cleaning import require_island_area
from toros_fem.products.actuators.case import ActuatorCase
from toros_fem.products.actuators.scene import ActuatorScene
from toros_fem.results.console import print_step

C = TypeVar("C", bound=ActuatorScene)
# Makes the case of a configuration, on the mesh of its edge length.
CaseMaker = Callable[[MPI.Comm, C], ActuatorCase]


def actuator_problem(
    comm: MPI.Comm, case: ActuatorCase, config: ActuatorScene, *, verbose: bool = False
) -> ShapeDesign:
    """Return the design problem of a case (collective).

    Raises:
        TorosError: A number is out of its bounds, or does not fit the case.
    """
    require_island_area(case.pattern, config.print.island_area)
    return ShapeDesign(
        comm,
        case.pattern,
        target=case.target,
        supports=case.supports,
        filter_radius=config.design.filter_radius,
        pressure=config.pressure.pressure,
        composite=config.material.composite,
        pressure_bounds=config.pressure.bounds,
        passive=case.passive,
        filter=config.design.filter,
        projection=Projection(config.design.beta, config.design.eta),
        length_scale=config.design.length_scale,
        perimeter_weight=config.design.perimeter_weight,
        perimeter_window=config.design.perimeter_window * config.design.filter_radius,
        perimeter_sharpness=config.design.perimeter_sharpness,
        objective=case.objective,
        metrics=case.metrics,
        start=case.start,
        symmetry=case.symmetry,
        chambers=case.chambers,
        contact=case.contact,
        width_tolerance=config.design.robust_against,
        log=print_step(comm) if verbose else None,
    )
