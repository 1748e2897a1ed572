"""Errors of the mesh: from a refined one, and half-widths of intervals from coarser ones."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.mpi import collective
from toros_fem.base.validation import require_callable, require_kind, shown
from toros_fem.measures.figures import split_key
from toros_fem.measures.metrics import MetricFunction
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium, EquilibriumError
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.transfer import refine
from toros_fem.meshes.triangles import EQUILATERAL

# A refinement removes half of the error at order 1 and three quarters at order 2. On tubes with
# stiff lines, whose bending locks, it removed as little as a third.
CAUTION = 3.0
# Residual over the load on the refined mesh: what it leaves is far below any estimate.
TOLERANCE = 1e-6

# Part of the error that coarser meshes tell.
SHARE = 0.65
# What no coarser mesh tells, by unit: bending beside stiff lines above all, in layers of 0.2 mm. Of
# lengths it is a part of the skin's size, in m. Angles are those of a skin as slender, length over
# width, as the tubes of the study. All are of the study's edges in m, and shrink with shorter ones.
UNSEEN = {"deg": 0.5, "percent": 0.45, "ratio": 0.0045}
LENGTHS = {"m": 0.006, "mm": 6.0}
SLENDER = 2.1
EDGE = 1.2e-3


@dataclass(frozen=True)
class ErrorEstimate:
    """A quantity on the given mesh and on a refined one.

    Attributes:
        value: Value on the given mesh.
        refined: Value with each triangle divided into four.
        error: Estimate of |value − exact|: `CAUTION` times the difference of the two.
        seconds: Wall time of the refined simulation, on this rank.
    """

    value: float
    refined: float
    error: float
    seconds: float

    def __str__(self) -> str:
        return (
            f"{self.value:.6g}, {self.refined:.6g} on the refined mesh: "
            f"off by about {self.error:.2g}"
        )


@collective("solver.skin.comm", owned=("result",))
def estimate_error(
    solver: EquilibriumSolver,
    result: Equilibrium,
    quantities: Sequence[MetricFunction],
    force: Callable[[Pattern], Floats] | None = None,
    supports: Callable[[Pattern], Supports] | None = None,
    *,
    direct: bool = False,
) -> list[ErrorEstimate]:
    """Estimate the discretisation error of quantities by one uniform refinement (collective).

    The design stays the same: each quarter of a triangle has its density. The estimate is that of
    the simulation on the given flat panels; it does not contain the error of a polygon against a
    round outline.

    Args:
        solver: The solver that found the result.
        result: The equilibrium; its load acts on the refined skin too, with weights, moved supports
            and bodies.
        quantities: Functions of a pattern and the positions of all its vertices, (n, 3).
        force: Dead forces in N on all assembled vertices of a pattern, (n, 3), as a function of the
            pattern, of a result with such forces.
        supports: Supports as a function of the pattern; None takes `Supports.refined`.
        direct: Whether to give up where the refined equilibrium is not found at once from the given
            shape. By default the load is raised anew there, which can take many times as long.

    Raises:
        ParameterError: The result is no equilibrium; or the sheet is moulded in its assembled
            shape, which is not known between the vertices.
        EquilibriumError: The refined skin has no equilibrium; with `direct`, none near.
    """
    require_kind("solver", solver, EquilibriumSolver, "an EquilibriumSolver")
    require_kind("result", result, Equilibrium, "an Equilibrium of the solver")
    if not isinstance(quantities, list | tuple):
        raise ParameterError(
            f"quantities = {shown(quantities)} must be a list of functions of a pattern and "
            "positions: [bend_angle]."
        )
    for number, quantity in enumerate(quantities):
        require_callable(f"quantities[{number}]", quantity, "a function of pattern and positions")
    for name, made in (("force", force), ("supports", supports)):
        if made is not None:
            require_callable(name, made, "a function of the pattern, or None")
    skin, load = solver.skin, result.load
    solver.model.composite.require_refinable()
    if not result.converged:
        raise ParameterError(f"the result is no equilibrium to refine: {result.reason}")
    if load.force is not None and force is None:
        raise ParameterError(
            "the result was found with dead forces; give them as a function of the pattern, "
            "force = …, so that they act on the refined one too."
        )
    begin = time.perf_counter()
    finer, moved = refine(skin.pattern), load.displacement
    options = replace(solver.options, tolerance=max(solver.options.tolerance, TOLERANCE))
    fixed = supports(finer.pattern) if supports else None
    fine = solver.refined(finer, supports=fixed, options=options)
    load = replace(
        load,
        force=None if force is None else force(finer.pattern),
        displacement=None if moved is None else finer.at_vertices(moved),
    )
    density = skin.gather_cells(result.density)[finer.cell][fine.skin.owned_cells]
    positions = skin.gather_vertices(result.positions)
    divided = finer.at_vertices(positions)[fine.skin.owned_vertices]
    # Around shorter edges less of the sheet is left out of contact.
    refused = fine.model.refusal(fine.model.state_of(divided)) is not None
    start = None if refused else divided
    try:
        found = fine.finish(fine.solve(density, load, start, trial=True))
    except EquilibriumError:  # raised by all ranks or by none
        if direct:
            raise
        found = fine.solve(density, load, start)
    fine_positions = fine.skin.gather_vertices(found.positions)
    seconds = time.perf_counter() - begin
    estimates = []
    for quantity in quantities:
        value = quantity(skin.pattern, positions)
        refined = quantity(finer.pattern, fine_positions)
        estimates.append(ErrorEstimate(value, refined, CAUTION * abs(refined - value), seconds))
    return estimates


def half_width(
    changes: Mapping[float, float], key: str, extents: Sequence[float], edge: float
) -> float:
    """Return the half-width of an interval, from how far coarser meshes tell otherwise.

    An error that grows with the edge length as far as a coarser mesh tells is c/(r − 1), with the
    change c to edges r times as long. The half-width is a part of the largest of these, and what no
    coarser mesh tells. Both were fitted to prints of many kinds (docs/accuracy.md).

    Args:
        changes: The changes, by the edge length of the coarser mesh over that of the mesh.
        key: Name and unit of the value, such as "angle_deg".
        extents: Extents of the skin along three axes in m.
        edge: Edge length of the mesh in m, as of `edge_of`.
    """
    known, (_, wide, size) = split_key(key), sorted(extents)
    unit = known[1] if known else ""
    least = UNSEEN.get(unit, LENGTHS.get(unit, 0.0) * size)
    if unit == "deg":  # turns add up along the skin, those of its parts not alike
        least *= max(1.0, size / wide / SLENDER) ** 0.5
    told = max(change / (ratio - 1) for ratio, change in changes.items())
    return SHARE * told + least * min(1.0, edge / EDGE)


def edge_of(areas: Floats) -> float:
    """Return the edge length of equilateral triangles of the mean of areas, (t,), in m."""
    return float(np.sqrt(np.mean(areas) / EQUILATERAL))
