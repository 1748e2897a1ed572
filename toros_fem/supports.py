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
