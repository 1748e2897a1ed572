"""Dead loads: the skin's own weight, and forces that keep their direction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from toros_fem._types import Floats
from toros_fem._validate import require_between
from toros_fem.errors import ParameterError
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.refine import Refinement


@dataclass(frozen=True)
class Weight:
    """Weight of the skin itself, which changes with the design.

    Attributes:
        fabric, reinforcement: Mass per flat area in kg/m² of the plain and of the reinforced
            fabric; linear in ρ̄ between them, as the stiffness is.
        gravity: Acceleration in m/s², (gx, gy, gz).

    Raises:
        ParameterError: A mass is negative, or gravity is no finite vector.
    """

    fabric: float
    reinforcement: float
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)

    def __post_init__(self) -> None:
        require_between(0.0, np.inf, fabric=self.fabric, reinforcement=self.reinforcement)
        if np.shape(self.gravity) != (3,) or not np.isfinite(self.gravity).all():
            raise ParameterError(
                f"gravity = {self.gravity} must be a finite vector of three components, in m/s²."
            )
        object.__setattr__(self, "fabric", float(self.fabric))  # forms take no integers
        object.__setattr__(self, "reinforcement", float(self.reinforcement))


def refined_force(finer: Refinement, pattern: Pattern, force: Floats) -> Floats:
    """Return dead forces in N on a refined pattern, (n, 3), with the same total.

    Force per area is interpolated.

    Args:
        finer: The refinement.
        pattern: The coarse pattern.
        force: Forces on its assembled vertices, (m, 3).
    """
    density = finer.at_vertices(force / pattern.vertex_areas[:, None])
    return np.asarray(density * finer.pattern.vertex_areas[:, None])


def spread_force(pattern: Pattern, panel: str, force: Sequence[float] | Floats) -> Floats:
    """Return dead forces that spread one force over a panel by flat area.

    Args:
        pattern: The pattern.
        panel: Name of the panel.
        force: The total force in N, (3,).

    Returns:
        Forces in N on all assembled vertices, (n, 3).

    Raises:
        PanelError: There is no such panel.
        ParameterError: The force is no finite vector.
    """
    total = np.asarray(force, dtype=np.float64)
    if total.shape != (3,) or not np.isfinite(total).all():
        raise ParameterError(f"force = {force} must be a finite vector (3,), in N.")
    cells = pattern.cells_of(panel)
    third = np.repeat(pattern.areas[cells] / 3, 3)
    areas = np.bincount(pattern.triangles[cells].ravel(), third, minlength=len(pattern.points))
    return np.asarray(np.outer(areas / areas.sum(), total))
