"""Round sheets on a clamped border, and the pressure at which one lifts a weight."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from benchmarks.measured.compared import Bools, Floats, secant
from benchmarks.measured.skins import Held, border
from toros_fem.base.errors import NoEquilibriumError
from toros_fem.materials.sheet import Composite
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes import Pattern
from toros_fem.meshes.sheets import one_panel

# Part of the weight by which the force may differ.
CLOSE = 2e-4


def rings(radii: Sequence[float], around: int) -> Pattern:
    """Mesh a disc by rings of vertices at these radii, a little raised: flat it carries nothing."""
    turn = 2 * np.pi * (np.arange(around) + np.arange(len(radii))[:, None] / 2) / around
    circles = np.array(radii)[:, None, None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    flat = np.concatenate([np.zeros((1, 2)), circles.reshape(-1, 2)])
    here, after = np.arange(around), (np.arange(around) + 1) % around
    triangles = [np.column_stack([0 * here, 1 + here, 1 + after])]
    for begin in 1 + around * np.arange(len(radii) - 1):
        a, b = begin + here, begin + after
        triangles += [np.column_stack([a, a + around, b]),
                      np.column_stack([b, a + around, b + around])]  # fmt: skip

    def raised(points: Floats) -> Floats:
        height = 1e-3 * radii[-1] * (1 - (points**2).sum(axis=1) / radii[-1] ** 2)
        return np.column_stack([points, height])

    return one_panel(flat, np.concatenate(triangles), raised)


def divided(borders: Sequence[float], edge: float) -> list[float]:
    """Return radii that have these among them, no further apart than about an edge, in m."""
    found = [borders[0]]
    for inner, outer in pairwise(borders):
        count = max(1, round((outer - inner) / edge))
        found += [inner + (outer - inner) * (k + 1) / count for k in range(count)]
    return found


def lifting_pressures(
    pattern: Pattern, composite: Composite, disc: float,
    stiff: Callable[[Floats], Bools] | None, weight: float, measured: Floats,
) -> list[float]:  # fmt: skip
    """Return the pressures in kPa at which a rigid disc carries a weight, by measured points.

    Args:
        disc: Its radius in m; the sheet does not slip on it.
        stiff: Returns for radii in m which triangles are stiff.
        weight: In N.
        measured: Heights in mm and pressures in kPa, (n, 2); secants begin there.
    """
    far = np.linalg.norm(pattern.points[:, :2], axis=1)
    inner = (far <= disc * (1 + 1e-6))[:, None]
    middle = np.linalg.norm(pattern.flat_points[pattern.flat_triangles].mean(axis=1), axis=1)
    held = border(pattern) | Supports(np.repeat(inner, 3, axis=1))
    skin = Held(pattern, composite, held, stiff(middle) if stiff else None)
    found, ratio = [], 1.02
    for height, known in measured[:, :2]:
        moved = inner * ([0.0, 0.0, 1e-3 * height] - pattern.points * [0.0, 0.0, 1.0])

        def miss(pressure: float, moved: Floats = moved) -> float:
            _, forces = skin.under(Load(1e3 * pressure, displacement=moved))
            return float(-(inner * forces)[:, 2].sum() / weight - 1)

        try:
            found.append(secant(miss, ratio * known, 0.995 * ratio * known, CLOSE))
            ratio = found[-1] / known
        except (NoEquilibriumError, ValueError):
            found.append(np.nan)
            skin.last = None
    return found
