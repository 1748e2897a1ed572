"""Which vertices are held, and where."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from toros_fem.errors import ParameterError
from toros_fem.meshes.pattern import Pattern


@dataclass(frozen=True, eq=False)
class Supports:
    """Held position components.

    Attributes:
        held: For each assembled vertex and component x, y, z whether it keeps its assembled
            position, shape (n, 3).
    """

    held: npt.NDArray[np.bool_]

    def require_no_rigid_motion(self, pattern: Pattern) -> None:
        """Check that no rigid motion of the assembled skin is left free.

        Raises:
            ParameterError: The supports are made for another pattern, or leave a rigid motion.
        """
        points = pattern.points
        if self.held.shape != points.shape:
            raise ParameterError(
                f"supports.held has shape {self.held.shape}; this skin needs {points.shape}. "
                "Make the supports from its own pattern."
            )
        arm = (points - points.mean(axis=0)) / pattern.size
        shifts = np.broadcast_to(np.eye(3), (len(points), 3, 3))
        turns = np.stack([np.cross(axis, arm) for axis in np.eye(3)], axis=2)
        motions = np.concatenate([shifts, turns], axis=2)[self.held]
        rank = np.linalg.matrix_rank(motions, tol=1e-6) if len(motions) else 0
        if rank < 6:
            raise ParameterError(
                f"the supports hold {self.held.sum()} components and leave {6 - rank} of the 6 "
                "rigid motions free, so that the skin could float away. Hold more of it."
            )


def clamp(pattern: Pattern, panels: Sequence[str]) -> Supports:
    """Hold every vertex of the named panels in all three components.

    Raises:
        PanelError: A panel of that name does not exist.
        ParameterError: No panel is named, so that the skin could move as a rigid body.
    """
    if not panels:
        raise ParameterError("panels = () holds nothing; name a panel to clamp.")
    held = np.zeros((len(pattern.points), 3), dtype=bool)
    for name in panels:
        held[pattern.vertices_of(name)] = True
    return Supports(held)
