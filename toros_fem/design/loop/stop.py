"""When a stage of the design loop ends."""

from __future__ import annotations

from collections.abc import Sequence

from toros_fem.design.density.length_scale import LengthScaleConstraints
from toros_fem.design.loop.options import DesignOptions, Iteration, Stage

# Number of steps over which T must fall.
LOOK_BACK = 10


def reason_to_end(
    rows: Sequence[Iteration],
    stage: Stage,
    options: DesignOptions,
    limits: LengthScaleConstraints | None,
) -> str | None:
    """Return why a stage of these rows, the start included, ends, as a sentence; None to go on."""
    o, now, steps = options, rows[-1], len(rows) - 1

    def kept(row: Iteration) -> bool:
        if not stage.constrained or limits is None:
            return True
        return bool(row.g_r <= limits.epsilon[0] and row.g_t <= limits.epsilon[1])

    def slow() -> bool:
        before, fraction = rows[-1 - LOOK_BACK], o.min_relative_decrease
        if fraction is None or not (kept(before) and kept(now)):
            return False
        return now.objective > before.objective - fraction * abs(before.objective)

    if steps > 0 and now.kkt < o.kkt_tol:
        return f"The KKT residual is under {o.kkt_tol:g}."
    if steps > 0 and now.change < o.x_tol:
        return f"No variable changes by more than {o.x_tol:g} any more."
    if o.target_objective is not None and now.objective <= o.target_objective and kept(now):
        return f"T is at most {o.target_objective:g}."
    if steps >= LOOK_BACK and slow():
        return f"T fell by less than {o.min_relative_decrease:g} of it in {LOOK_BACK} steps."
    if steps == stage.iterations:
        return f"All {stage.iterations} iterations are done."
    return None
