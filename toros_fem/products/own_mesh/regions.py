"""Regions of a skin by coordinates or panels."""

from __future__ import annotations

import re

import numpy as np

from toros_fem.base.array_types import Bools, Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import Table, Text, key
from toros_fem.meshes.conditions import AXES, Expression
from toros_fem.meshes.pattern import Pattern


class Region(Table):
    """A region of a skin.

    Raises:
        ParameterError: Neither a condition nor panels are given, or the condition is wrong.
    """

    where: Text | None = key(
        None, 'condition on the coordinates of the assembled skin, "z < 5 mm" for instance'
    )
    panels: Text | None = key(
        None,
        "names of panels, or of parts of the mesh file, with commas between them; with a "
        "condition, where it holds on them",
    )

    def __post_init__(self) -> None:
        if self.where is None and self.panels is None:
            raise ParameterError('a region needs where = "z < 5 mm", for instance, or panels.')
        if self.where is not None:
            try:
                Expression(self.where)
            except ParameterError as caught:
                raise ParameterError(f"where: {caught}", "where") from None

    def vertices(self, pattern: Pattern) -> Bools:
        """Return which assembled vertices lie in the region, (n,).

        Raises:
            ParameterError: None does.
            PanelError: There is no panel of a name.
        """
        inside = np.zeros(len(pattern.points), dtype=bool)
        inside[pattern.triangles[self._on_panels(pattern)]] = True
        return self._checked(pattern, inside, pattern.points)

    def cells(self, pattern: Pattern) -> Bools:
        """Return which triangles have their centroid in the region, (t,)."""
        centroids = pattern.points[pattern.triangles].mean(axis=1)
        return self._checked(pattern, self._on_panels(pattern), centroids)

    def require_symmetric(self, name: str, points: Floats, axis: int) -> None:
        """Check that the condition holds at mirror images too; panels are those of the part.

        Raises:
            ParameterError: It does not.
        """
        if self.where is not None:
            holds, flip = Expression(self.where), np.where(np.arange(3) == axis, -1.0, 1.0)
            if (holds(points) != holds(flip * points)).any():
                raise ParameterError(
                    f"{name}: {self.where!r} is not symmetric about {AXES[axis]} = 0. Write "
                    f"abs({AXES[axis]}), or leave this plane out."
                )

    def _on_panels(self, pattern: Pattern) -> Bools:
        """Return which triangles lie on the panels, (t,).

        A part of a mesh file that was divided has several panels, as "sole-1".
        """
        if self.panels is None:
            return np.ones(len(pattern.panel), dtype=bool)
        found: list[int] = []
        for name in (name.strip() for name in self.panels.split(",")):
            numbered = re.compile(rf"{re.escape(name)}-\d+")
            parts = [panel for panel in pattern.panel_names if numbered.fullmatch(panel)]
            names = [name] if name in pattern.panel_names or not parts else parts
            found += map(pattern.panel_index, names)
        return np.isin(pattern.panel, found)

    def _checked(self, pattern: Pattern, inside: Bools, points: Floats) -> Bools:
        if self.where is not None:
            inside = inside & Expression(self.where)(points)
        if not inside.any():
            low, high = (1e3 * f(axis=0) for f in (pattern.points.min, pattern.points.max))
            ends = zip(AXES, low, high, strict=True)
            spans = ", ".join(f"{name} from {a:.4g} to {b:.4g}" for name, a, b in ends)
            what = repr(self.where) if self.where is not None else f"panels = {self.panels!r}"
            raise ParameterError(f"the region {what} holds nothing; the skin has {spans} mm.")
        return inside
