"""Planes in which supports hold a skin, and how they close its free borders for its volume."""

from __future__ import annotations

import numpy as np

from toros_fem.base.array_types import Bools, Ints
from toros_fem.base.errors import ParameterError
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes.mirror import FLAT
from toros_fem.meshes.pattern import Pattern


class Planes:
    """Planes that close free borders: symmetry planes, and coordinate planes through the origin.

    A border is closed by a plane in which it is fixed. A cone from the origin over what is missing
    in a plane through the origin has no volume. Where planes cut the skin on both sides, as z = 0
    and z = L do, one of them does not contain the origin: there a lid must be counted.

    Attributes:
        origin: Point from which cones are taken, (3,), in m: in one plane across each axis that
            has symmetry planes, if possible at 0.
    """

    def __init__(self, pattern: Pattern, supports: Supports) -> None:
        self._pattern, self._supports = pattern, supports
        self.origin = np.zeros(3)
        for axis in range(3):
            found = [at for k, at in supports.planes if k == axis]
            self.origin[axis] = min(found, key=abs, default=0.0)
        # Axis, −1 for none, and coordinate of the plane that closes each free edge. Planes through
        # the origin come last and win: there nothing is missing from the volume.
        ends = pattern.free_edges
        self._axis, self._at = np.full(len(ends), -1), np.zeros(len(ends))
        planes = [*supports.planes, *((k, 0.0) for k in range(3))]
        for k, at in sorted(planes, key=lambda plane: plane[1] == self.origin[plane[0]]):
            held = self._held(k, at)
            # A sheet that lies in the plane as a whole encloses nothing with it.
            inside = held[ends].all(axis=1) & ~held.all()
            self._axis[inside], self._at[inside] = k, at

    @property
    def close(self) -> bool:
        """Whether a pressure can act: the skin is closed, or planes close it."""
        return bool((self._axis >= 0).all())

    def lids(self) -> list[tuple[int, float, Ints]]:
        """Return axis and coordinate in m of each lid, and the free half-edges around it, (k,)."""
        pattern, axis, position = self._pattern, self._axis, self._at
        half = pattern.edges.twins[pattern.edges.border, 0]
        off = (axis >= 0) & (position != self.origin[axis])
        borders = np.full(len(pattern.points), -1)
        found = []
        for k, at in sorted(set(zip(axis[off].tolist(), position[off].tolist(), strict=True))):
            there = off & (axis == k) & (position == at)
            edges = pattern.free_edges[there]
            for j, other in self._supports.planes:
                if (j, other) != (k, at) and self._held(j, other)[edges].all(axis=1).any():
                    raise ParameterError(
                        f"a free edge lies in both planes {'xyz'[k]} = {at:g} m and {'xyz'[j]} = "
                        f"{other:g} m, so that what closes it is not unique. Move a plane."
                    )
            before = borders[edges]
            if ((before >= 0) & (before != k)).any():
                raise ParameterError(
                    f"planes cut the skin on both sides along {'xyz'[k]} and along "
                    f"{'xyz'[before[before >= 0].max()]}, and a border runs from the one to the "
                    "other. Let one of the four planes be no symmetry plane: simulate more."
                )
            borders[edges] = k
            found.append((k, at, half[there]))
        return found

    def through_origin(self) -> Bools:
        """Return whether each vertex is held in a plane through the origin across x, y, z, (n, 3).

        Where edges are guided their normals decide, since a clamp may fix more components.
        """
        supports = self._supports
        across = np.zeros(supports.fixed.shape, dtype=bool)
        lengths = np.linalg.norm(supports.normals, axis=1)[:, None]
        for k in range(2):
            along = np.abs(supports.normals) > 0.999 * lengths
            np.logical_or.at(across, supports.guided[:, k], along)
        guided = np.asarray(across.any(axis=1))[:, None]
        held = [self._held(k, at) for k, at in enumerate(self.origin)]
        return np.asarray(np.stack(held, axis=1) & (across | ~guided))

    def of_symmetry(self) -> Bools:
        """Return whether each vertex is held in a symmetry plane across x, y or z, (n, 3)."""
        found = np.zeros(self._supports.fixed.shape, dtype=bool)
        for axis, at in self._supports.planes:
            found[:, axis] |= self._held(axis, at)
        return found

    def _held(self, axis: int, at: float) -> Bools:
        """Whether each vertex is fixed in a plane, and stays there."""
        supports, near = self._supports, FLAT * self._pattern.size
        rest = self._pattern.points[:, axis] - at
        moved = rest if supports.displacement is None else rest + supports.displacement[:, axis]
        return np.asarray(
            supports.fixed[:, axis] & (np.abs(rest) <= near) & (np.abs(moved) <= near)
        )
