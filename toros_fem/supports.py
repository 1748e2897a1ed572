"""Which vertices are held, and where."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from toros_fem.errors import ParameterError
from toros_fem.meshes.pattern import Pattern

# How far from a symmetry plane a vertex may lie, over the size of the skin.
FLAT = 1e-6


@dataclass(frozen=True, eq=False)
class Supports:
    """Held position components.

    Attributes:
        held: For each assembled vertex and component x, y, z whether it keeps its assembled
            position, shape (n, 3).
    """

    held: npt.NDArray[np.bool_]

    def __or__(self, other: Supports) -> Supports:
        """What either holds."""
        return Supports(self.held | other.held)

    def close(self, pattern: Pattern) -> bool:
        """Whether a pressure can act: the skin is closed, or symmetry planes close it.

        The wall missing in a coordinate plane through the origin has no share in the volume of
        eq. (7).
        """
        ends = pattern.free_edges
        there = self.held & (np.abs(pattern.points) <= FLAT * pattern.size)
        return bool((there[ends[:, 0]] & there[ends[:, 1]]).any(axis=1).all())

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


def symmetry_plane(pattern: Pattern, axis: int) -> Supports:
    """Hold the free border of half a skin in the coordinate plane that it is mirrored at.

    The border slides in the plane. No moment acts across it: the whole skin is hinged there.

    Args:
        pattern: Half a skin, or a quarter; the plane goes through the origin.
        axis: 0, 1 or 2 for the plane x = 0, y = 0 or z = 0.

    Raises:
        ParameterError: No free edge lies in the plane.
    """
    if axis not in (0, 1, 2):
        raise ParameterError(f"axis = {axis!r} must be 0, 1 or 2, for x, y or z.")
    ends = pattern.free_edges
    flat = np.abs(pattern.points[:, axis]) <= FLAT * pattern.size
    border = ends[flat[ends].all(axis=1)]
    if len(border) == 0:
        raise ParameterError(
            f"no free edge lies in the plane {'xyz'[axis]} = 0: cut the skin there, and put the "
            "plane through the origin."
        )
    held = np.zeros((len(pattern.points), 3), dtype=bool)
    held[border.ravel(), axis] = True
    return Supports(held)
