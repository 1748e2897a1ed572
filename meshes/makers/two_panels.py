"""Skins of two equal flat panels, sewn along their outline: a walker, a finger, a gripper.

The paper shows the walker (Figs. 9, 10) and the gripper (Fig. 1) without sizes: all sizes are ours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from toros_fem.base.array_types import Bools, Floats, Ints
from toros_fem.base.errors import OutlineError
from toros_fem.base.mpi import on_root
from toros_fem.base.validation import (
    checked_axes,
    checked_list,
    require_count,
    require_finite,
    require_kind,
    require_positive,
)
from toros_fem.meshes.makers.planar import Line, arc, region_mesh, rounded
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.triangles import flat_areas, laplacian, spd_factor

TOP, BOTTOM = "top", "bottom"
# Root mean square slope of the pillow. The mean strain of the assembled panels is half its square.
SLOPE = 0.02


@on_root
def two_panels(
    comm: MPI.Comm,
    outline: npt.ArrayLike,
    edge_length: float,
    *,
    lines: Sequence[Line] = (),
    planes: Sequence[int] = (),
) -> Pattern:
    """Make two equal panels, "top" and "bottom", sewn along an outline (collective).

    Both have the same mesh, so that they fit vertex by vertex. The assembled skin lies in the plane
    z = 0, apart from a slight pillow with the top at z > 0, which defines the inside.
    The stress-free shape is flat. The first two coordinates of `Pattern.points` are the place in
    the outline on either panel. The flat coordinates of the bottom are mirrored, (x, −y).

    Args:
        outline: Points (k, 2) in m of the whole closed outline: corners, and points on arcs. A
            point where it turns by more than 20° is a corner. Between corners it is divided evenly.
        lines: Straight lines from border to border of the whole outline, ((x, y), (x, y)) in m,
            along which both panels get mesh edges.
        planes: Symmetry planes that cut the skin: 0 keeps x ≥ 0, 1 keeps y ≥ 0. The cut is not
            sewn: `symmetry_plane` supports it, `mirrored` completes the skin.

    Raises:
        OutlineError: The outline crosses itself, is not symmetric, or does not fit its lines or
            the edge length.
    """
    lines = checked_list("lines", lines, object, "lines, () for none", OutlineError)
    planes = checked_axes("planes", planes, (0, 1), OutlineError)
    flat, triangles, seam = region_mesh(outline, edge_length, lines, planes)
    count = len(flat)
    height = _pillow(flat, triangles, seam)
    above, below = (np.column_stack([flat, sign * height]) for sign in (1, -1))
    other = np.where(seam, np.arange(count), count + np.cumsum(~seam) - 1)
    return Pattern(
        flat_points=np.concatenate([flat, flat * [1, -1]]),
        flat_triangles=np.concatenate([triangles, count + triangles[:, ::-1]]),
        panel=np.repeat([0, 1], len(triangles)),
        sewn=np.concatenate([np.arange(count), other]),
        points=np.concatenate([above, below[~seam]]),
        panel_names=(TOP, BOTTOM),
    )


def plane_centroids(pattern: Pattern) -> Floats:
    """Return the place of each triangle in the outline, (t, 2), in m, the same on both panels.

    `Pattern.centroids` are in each panel's own coordinates, which are mirrored on the bottom.
    """
    require_kind("pattern", pattern, Pattern, "a Pattern")
    return pattern.points[pattern.triangles, :2].mean(axis=1)


def _pillow(flat: Floats, triangles: Ints, seam: Bools) -> Floats:
    """Return heights (m,) of a membrane under pressure, −Δu = 1, fixed at the seam only."""
    stiffness, area = laplacian(flat[triangles], triangles), flat_areas(flat[triangles])
    load = np.bincount(triangles.ravel(), np.repeat(area / 3, 3))
    height = np.zeros(len(flat))
    height[~seam] = spd_factor(stiffness[~seam][:, ~seam]).solve(load[~seam])
    # ∫ |∇u|² = ∫ u hardly depends on the mesh. The steepest slope, at inner corners, would.
    return np.asarray(SLOPE * height / np.sqrt(load @ height / area.sum()))


@dataclass(frozen=True)
class Star:
    """A round body with equal arms that end in half circles.

    Attributes:
        arms: Number of arms, at least 2.
        arm_length: Length of an arm from the body's circle to the tip, in m.
        arm_width, body_radius: Width of an arm and radius of the body in m.
        corner_radius: Radius of the fillets between arm and body, or between two arms, in m.
        angle: Angle from the x axis to the first arm, in rad.
    """

    arms: int
    arm_length: float
    arm_width: float
    body_radius: float
    corner_radius: float
    angle: float = 0.0

    def __post_init__(self) -> None:
        require_count(2, arms=self.arms)
        names = ("arm_length", "arm_width", "body_radius", "corner_radius")
        require_positive(**{name: getattr(self, name) for name in names})
        require_finite(angle=self.angle)
        if self.arm_width > 2 * self.body_radius:
            raise OutlineError(
                f"arm_width = {self.arm_width} m must be at most the body's diameter, twice "
                f"body_radius = {self.body_radius:.6g} m."
            )
        room = self.reach - self.arm_width / 2 - self.root
        if room <= 0:
            raise OutlineError(
                f"arm_length = {self.arm_length} m must exceed {self.arm_length - room:.6g} m, "
                "where the fillet ends and the round tip begins. Lengthen the arms, or lower "
                "corner_radius or arm_width."
            )

    @property
    def reach(self) -> float:
        """Distance of the tips from the centre in m."""
        return self.body_radius + self.arm_length

    @property
    def root(self) -> float:
        """Distance from the centre in m beyond which the arms have their width."""
        return float(self._fillet[0])

    @property
    def directions(self) -> Floats:
        """Unit vectors along the arms, (arms, 2), counter-clockwise."""
        angle = self.angle + 2 * np.pi * np.arange(self.arms) / self.arms
        return np.column_stack([np.cos(angle), np.sin(angle)])

    @property
    def roots(self) -> tuple[Line, ...]:
        """Lines across the arms at their roots, in m."""
        aside = self.directions[:, ::-1] * [-1, 1] * (self.arm_width / 2)
        middle = self.root * self.directions
        ends: Any = np.concatenate([middle - aside, middle + aside], axis=1).tolist()
        return tuple(((a, b), (c, d)) for a, b, c, d in ends)

    @property
    def outline(self) -> Floats:
        """Points of the outline, (k, 2), in m, counter-clockwise."""
        half, step, centre = self.arm_width / 2, np.pi / self.arms, self._fillet
        tip = arc([self.reach - half, 0], half, 0, np.pi / 2)
        # The body's circle and the fillet touch on the line between their centres.
        touch = np.arctan2(centre[1], centre[0])
        fillet = arc(centre, self.corner_radius, -np.pi / 2, min(touch, step) - np.pi)
        body = arc([0, 0], self.body_radius, touch, step)[1:] if touch < step else fillet[:0]
        upper = np.concatenate([tip, fillet, body])
        # The last point is on the border to the next sector, the first on the arm's axis.
        sector = np.concatenate([upper[:0:-1] * [1, -1], upper])[1:]
        left = self.directions[:, ::-1] * [-1, 1]
        turned = sector[:, 0, None] * self.directions[:, None] + sector[:, 1, None] * left[:, None]
        return turned.reshape(-1, 2)

    @property
    def _fillet(self) -> Floats:
        """Centre of the fillet on the left of an arm along x, (2,), in m."""
        aside = self.arm_width / 2 + self.corner_radius
        out = np.sqrt((self.body_radius + self.corner_radius) ** 2 - aside**2)
        # Where the arms meet before they reach the body, the fillet touches both.
        return np.array([max(out, aside / np.tan(np.pi / self.arms)), aside])


# Four arms, as the walker of the paper has them, Figs. 9 and 10.
WALKER = Star(4, 0.06, 0.024, 0.02, 6e-3, np.pi / 4)
# Three fingers, as the gripper of the paper has them, Fig. 1.
GRIPPER = Star(3, 0.09, 0.025, 0.025, 6e-3)


def walker(
    comm: MPI.Comm, edge_length: float, star: Star = WALKER, *, planes: Sequence[int] = ()
) -> Pattern:
    """Make a body with legs, by default four along the diagonals (paper Figs. 9, 10).

    Mesh edges separate body and legs: a triangle with the `plane_centroids` c belongs to leg k
    where c · star.directions[k] > star.root. Planes are () for the whole, (0,) or (1,) for half of
    it, (0, 1) for a quarter with one leg.
    """
    require_kind("star", star, Star, "a Star")
    return two_panels(comm, star.outline, edge_length, lines=star.roots, planes=planes)


def gripper(
    comm: MPI.Comm, edge_length: float, star: Star = GRIPPER, *, planes: Sequence[int] = ()
) -> Pattern:
    """Make a palm with fingers, by default three at 120° (paper Fig. 1), the first along +x.

    Arguments are those of `walker`; planes: () for the whole, (1,) for the half at y ≥ 0.
    """
    return walker(comm, edge_length, star, planes=planes)


def finger(
    comm: MPI.Comm,
    edge_length: float,
    *,
    length: float = 0.09,
    width: float = 0.025,
    root: float = 0.015,
    corner_radius: float = 4e-3,
    planes: Sequence[int] = (),
) -> Pattern:
    """Make a straight finger along +x from x = 0, sewn all around, with a half circle as its tip.

    The sizes, in m, are ours: the paper gives none. `root` is the length of the part that a mount
    holds; a line of mesh edges ends it. The corner radius is that of the two corners at x = 0.
    Planes are () for the whole, (1,) for the half at y ≥ 0.
    """
    require_positive(length=length, width=width, root=root, corner_radius=corner_radius)
    half = width / 2
    if not corner_radius < root < length - half:
        raise OutlineError(
            f"root = {root} m must lie between the corners' arcs and the round tip, "
            f"{corner_radius:.6g} to {length - half:.6g} m."
        )
    corners = [(0.0, -half), (length, -half), (length, half), (0.0, half)]
    outline = rounded(corners, (corner_radius, half, half, corner_radius))
    line = ((root, -half), (root, half))
    return two_panels(comm, outline, edge_length, lines=[line], planes=planes)
