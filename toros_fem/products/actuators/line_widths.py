"""Widths of printed lines that mend what their print misses."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from toros_fem.base.array_types import Bools, Floats
from toros_fem.base.mpi import on_first_rank
from toros_fem.design.lines.laid_lines import LaidLines, widened
from toros_fem.design.lines.widths import WidthChanges, width_changes, within_bounds
from toros_fem.making.print.regions import regions_on
from toros_fem.products.actuators.line_print import LinePrint
from toros_fem.products.actuators.space_mapping import Aim

# Number of smooth functions by which the widths of each family change.
FUNCTIONS = 16
# Largest relative change of a width in one step.
LARGEST = 0.3
# Passes at most: after each, widths that would leave their bounds are held, and the others do more.
# They end once the rates promise all but this fraction.
PASSES = 3
ENOUGH = 0.1
# A step that takes away less of the error than this fraction is not worth a print.
WORTH = 0.4


def mended_widths(made: LinePrint, lines: LaidLines, aims: Mapping[str, Aim]) -> LaidLines | None:
    """Return the lines with the least change of widths that takes their print to its targets.

    A Gauss-Newton step: metrics are linear in the widths, by one solve with the print's tangent
    for each of the smooth functions of `width_changes`. None where the widths cannot take away a
    fair part of the error. It is collective.

    Args:
        made: The print of the lines; nothing else was simulated with its problem since.
        lines: The lines.
        aims: Targets of its metrics, by key.
    """
    problem, evaluation, mesh = made.problem, made.printed.evaluation, lines.mesh
    if mesh is None or evaluation is None or not aims:
        return None
    comm, metrics = problem.comm, made.metrics
    pattern, cells = problem.skin.pattern, problem.skin.owned_cells

    def changes_there() -> WidthChanges:
        under = [regions_on(lines.pattern, family.under, pattern) for family in lines.families]
        return width_changes(mesh, pattern, under, FUNCTIONS)

    changes = on_first_rank(comm, changes_there)
    scales = np.array([aim.scale for aim in aims.values()])
    missing = np.array([aim.target - metrics[key] for key, aim in aims.items()]) / scales

    def rates(densities: list[Floats]) -> Floats:
        found = problem.metric_derivatives(evaluation, densities)
        return np.array([found[key] for key in aims]) / scales[:, None]

    free: Bools = np.ones((len(lines.families), mesh.size), dtype=bool)
    amounts = np.zeros(len(free) * changes.functions.shape[1])
    promised: Floats = np.zeros(len(aims))
    for _ in range(PASSES):
        slope = rates(changes.densities(cells, free))
        amounts = amounts + np.linalg.lstsq(slope, missing - promised, rcond=1e-6)[0]
        largest = float(np.abs(changes.change(amounts)).max())
        amounts *= min(1.0, np.log1p(LARGEST) / max(largest, 1e-12))
        wanted = changes.change(amounts)
        change = within_bounds(lines, wanted)
        promised = rates([changes.density(cells, change)])[:, 0]
        left = float(np.abs(missing - promised).max() / np.abs(missing).max())
        if left < ENOUGH:
            break
        free = np.abs(change - wanted) < 1e-9
    if left > 1 - WORTH:
        return None
    return on_first_rank(comm, lambda: widened(lines, np.exp(change)))
