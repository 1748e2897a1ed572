"""Distortion between flat panels and the surface that they cover."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from toros_fem.base.array_types import Floats, Ints
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.triangles import corner_angles


@dataclass(frozen=True, eq=False)
class Distortion:
    """Deformation from the flat panels, which are unstressed, to the assembled surface.

    Attributes:
        panel: Panel of each triangle, shape (t,).
        panel_names: A name for each panel.
        weight: Area of each triangle on the surface, shape (t,), in m², the weight in means.
        stretches: Principal stretches of each triangle, the larger first, shape (t, 2).
        area_ratio: Area on the surface over flat area, shape (t,).
        angle_error: Largest change of a triangle's angles, shape (t,), in rad.
        seam_gap: Relative difference of length of two edges sewn together, shape (s,).
    """

    panel: Ints
    panel_names: tuple[str, ...]
    weight: Floats
    stretches: Floats
    area_ratio: Floats
    angle_error: Floats
    seam_gap: Floats

    @property
    def strain(self) -> Floats:
        """Stretch or compression of each triangle, (t,): largest of λ − 1 and 1/λ − 1."""
        return np.maximum(self.stretches[:, 0], 1 / self.stretches[:, 1]) - 1

    @property
    def worst_stretch(self) -> float:
        """Largest stretch or compression, 0 for an isometric map."""
        return float(self.strain.max())

    @property
    def mean_stretch(self) -> float:
        """Mean stretch or compression."""
        return float(np.average(self.strain, weights=self.weight))

    @property
    def worst_seam(self) -> float:
        """Largest relative difference of length at a seam, 0 if there is none."""
        return float(self.seam_gap.max(initial=0.0))

    def table(self) -> str:
        """Return the worst and mean values of each panel and of all, as lines of text."""
        head = (
            "panel             triangles  area/cm²   stretch        area ratio     angle error\n"
            "                                       worst   mean    min    max     worst   mean"
        )
        rows = [self._row(name, self.panel == k) for k, name in enumerate(self.panel_names)] + [
            self._row("all", np.ones(len(self.panel), dtype=bool))
        ]
        return "\n".join([head, *rows, f"longest difference at a seam: {self.worst_seam:.2%}"])

    def _row(self, name: str, cells: np.ndarray) -> str:
        weight, ratio = self.weight[cells], self.area_ratio[cells]
        strain, angle = self.strain[cells], np.degrees(self.angle_error[cells])
        return (
            f"{name[:16]:16s}  {cells.sum():9d}  {1e4 * weight.sum():8.2f}"
            f"  {strain.max():6.2%} {np.average(strain, weights=weight):6.2%}"
            f"  {ratio.min():5.3f}  {ratio.max():5.3f}"
            f"  {angle.max():6.2f}°  {np.average(angle, weights=weight):5.2f}°"
        )


def distortion(pattern: Pattern) -> Distortion:
    """Return the distortion between the flat and the assembled shape of a pattern.

    Args:
        pattern: Any pattern.
    """
    ends = pattern.flat_points[pattern.seams]
    length = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)
    stretches = triangle_stretches(pattern.corners, pattern.points[pattern.triangles])
    ratio = stretches.prod(axis=1)
    angle = corner_angles(pattern.points, pattern.triangles) - corner_angles(
        pattern.flat_points, pattern.flat_triangles
    )
    return Distortion(
        panel=pattern.panel,
        panel_names=pattern.panel_names,
        weight=ratio * pattern.areas,
        stretches=stretches,
        area_ratio=ratio,
        angle_error=np.abs(angle).max(axis=1),
        seam_gap=np.abs(length[:, 0] - length[:, 1]) / length.max(axis=1),
    )


def triangle_stretches(flat: Floats, corners: Floats) -> Floats:
    """Return the singular values of F = ∂x/∂x̄ of each triangle, the larger first, (t, 2).

    Args:
        flat: Flat corners (t, 3, 2).
        corners: Corners in space (t, 3, 3).
    """
    before = np.stack([flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]], axis=2)
    after = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
    return np.linalg.svd(after @ np.linalg.inv(before), compute_uv=False)
