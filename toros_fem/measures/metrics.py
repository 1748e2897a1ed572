"""Metrics of a simulated shape: angles in rad, fractions as pure numbers, lengths in m."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import (
    Floats,
    Ints,
    checked_floats,
    is_number,
    require_callable,
    require_finite,
    require_kind,
    require_positive,
    shown,
    vector,
)
from toros_fem.measures.cross_sections import label_cross_sections, section_vertices
from toros_fem.measures.figures import TOLERANCE, Figure, formatted, unit_of
from toros_fem.measures.shape import axial, best_rotation, polar_rotation
from toros_fem.meshes.pattern import Pattern, mirrored

# Columns of the history and entries of the summary that a metric's key could hide.
RESERVED = frozenset((
    "arc_length", "g_r", "g_t", "gradient_norm", "gradient_norm_first",
    "gradient_norm_last", "grey_level", "kkt_residual", "length_scale", "linear_solver",
    "load_factor", "negative_eigenvalues", "newton_steps", "objective_first",
    "objective_last", "parts_by_symmetry", "perimeter_m", "pressure_pa", "printed_failure",
    "printed_objective", "stretch_use", "volume_fraction", "volume_m3",
))  # fmt: skip

# Least tolerance by unit: 5 % of the pressure move a tube that bends by 4.5°.
LEAST = {"deg": 3.0, "percent": 0.5}
# Size of a metric whose target is 0 and that has no scale, by unit: a right angle, and the whole.
# A length has none: it depends on the skin.
SCALES = {"deg": 90.0, "percent": 100.0, "ratio": 1.0}
# A target below this part of its metric's scale counts as 0.
TINY = 0.01

MetricFunction = Callable[[Pattern, Floats], float]
"""Function of a pattern and the deformed positions, (n, 3), of all its vertices in m."""


@dataclass(frozen=True)
class Metric:
    """Number that a run is judged by, listed in history, summary and pictures.

    Attributes:
        name: Its name, such as "angle"; an identifier.
        unit: Its unit as written in names: "deg", "percent" or "mm"; an identifier.
        target: Target value in that unit; None if the number is only watched.
        measure: Function that returns the computed value in that unit.
        scale: Distance from the target that counts as much as the whole target of another metric;
            None takes the size of the target.
        at_least: Whether more than the target is as good.
    """

    name: str
    unit: str
    target: float | None
    measure: MetricFunction
    scale: float | None = None
    at_least: bool = False

    def __post_init__(self) -> None:
        for name in ("name", "unit"):
            require_kind(name, getattr(self, name), str, "a word, such as 'angle' or 'deg'")
        if not (self.name.isidentifier() and self.unit.isidentifier()):
            raise ParameterError(
                f"name = {self.name!r} and unit = {self.unit!r} must be identifiers, since they "
                "name a column of the history. Use letters, digits and underscores."
            )
        if self.target is not None:
            require_finite(**{f"target of the metric {self.name}": self.target})
        if self.scale is not None:
            require_positive(**{f"scale of the metric {self.name}": self.scale})
        require_callable("measure", self.measure, "a function of a pattern and positions (n, 3)")

    @property
    def key(self) -> str:
        """Name in files, such as "angle_deg"."""
        return f"{self.name}_{self.unit}"

    def value(self, pattern: Pattern, positions: Floats) -> float:
        """Return the value at deformed positions of all vertices, (n, 3), in m."""
        found = self.measure(pattern, positions)
        if isinstance(found, np.ndarray) and found.ndim == 0:
            found = found[()]
        if not (is_number(found) and np.isfinite(found)):
            raise ParameterError(
                f"metric {self.key!r} returned {shown(found)}; it must return one finite number "
                "for every shape. Correct its function."
            )
        return float(found)

    def of_whole(self, planes: Sequence[int]) -> Metric:
        """Return the same metric of the whole skin, as a function of its part.

        `planes` are the axes of the planes that the part is cut at, as of `meshes.mirrored`.
        """

        def measure(pattern: Pattern, positions: Floats) -> float:
            whole = mirrored(pattern, planes)
            return self.measure(whole.pattern, whole.at_vertices(positions))

        return replace(self, measure=measure) if planes else self

    @property
    def label(self) -> str:
        """Name in pictures, such as "angle in degrees"."""
        if self.unit == "ratio":
            return f"{self.name} over its rest value"
        return f"{self.name} in {unit_of(self.unit).words}"

    def formatted(self, value: float | None, digits: int = 3, *, sign: bool = False) -> str:
        """Return a value with its unit, as the function `formatted` does."""
        return formatted(value, self.unit, digits, sign=sign)

    def figure(
        self, value: float | None, interval: float | None = None, tolerance: float = TOLERANCE
    ) -> Figure:
        """Return the figure of a value and the half-width of its interval, None where unknown.

        `tolerance` is the part of the target that counts as reached. Where the target is 0, or less
        than `TINY` of the scale, it is that part of the scale. By default it is at least what a
        maker can tell apart, `LEAST`; with another part of the target this follows.
        """
        allowed = None
        if self.target is not None:
            scale = self.scale or SCALES.get(self.unit, 0.0)
            size = abs(self.target) if abs(self.target) > TINY * scale else scale
            allowed = tolerance * max(size, LEAST.get(self.unit, 0.0) / TOLERANCE) or None
        told = value, interval, self.target, allowed, self.at_least
        return Figure(self.name, self.unit, *told)


def check_metrics(metrics: Sequence[Metric]) -> None:
    """Check that metrics come as a list and have different keys."""
    require_kind("metrics", metrics, (list, tuple), "a list of Metrics")
    for metric in metrics:
        require_kind("metrics", metric, Metric, "Metrics, by Metric(name, unit, target, function)")
    keys = [metric.key for metric in metrics]
    taken = next((key for key in keys if key in RESERVED), None)
    if taken is not None:
        raise ParameterError(
            f"a metric is named {taken!r}, which tables and summaries hold already. Choose another "
            "name or unit."
        )
    twice = next((key for key in keys if keys.count(key) > 1), None)
    if twice is not None:
        raise ParameterError(
            f"two metrics are named {twice!r}: one would overwrite the other; each needs its own "
            "name."
        )


@dataclass(frozen=True)
class Measurement:
    """Measured value of a metric, that a simulation is compared with.

    Attributes:
        key: The metric's key.
        target: Target that the measured actuator was designed for, in the metric's unit.
        pressure: Pressure in Pa.
        value: The value, in the metric's unit.
        source: Who measured it, as legends say it.
    """

    key: str
    target: float
    pressure: float
    value: float
    source: str

    def __post_init__(self) -> None:
        for name in ("key", "source"):
            require_kind(name, getattr(self, name), str, "a text")
        require_finite(target=self.target, pressure=self.pressure, value=self.value)

    def belongs_to(self, metric: Metric) -> bool:
        """Return whether this is a value of a metric with the same target."""
        return self.key == metric.key and self.target == metric.target


def turn_angle(
    pattern: Pattern,
    positions: Floats,
    sections: Sequence[Ints],
    along: npt.ArrayLike,
    toward: npt.ArrayLike,
) -> float:
    """Return the angle in rad by which the last of a body's cross-sections has turned in a plane.

    Each section's best rigid rotation turns the direction `along` into n; its angle is
    atan2(n·toward, n·along). It is continued from section to section, so that it may exceed 180°.
    `sections` are the vertices of each, starting at the body's root. The axis of the assembled body
    and the direction that it bends towards are perpendicular unit vectors, (3,).
    """
    plane = np.stack([vector("toward", toward), vector("along", along)])
    rotations = _rotations(pattern, positions, sections)
    angles = [np.arctan2(*(plane @ (rotation @ plane[1]))) for rotation in rotations]
    return float(np.unwrap(np.array(angles))[-1])


def bend_angle(
    pattern: Pattern, positions: Floats, panel: str = "wall", sections: int = 12
) -> float:
    """Return the angle in rad by which a tube along z bends in the x-z plane towards +x.

    It is the `turn_angle` of the ring at the tip, where the wall, a panel, is cut into slabs of
    equal length along the assembled z from z = 0; each should contain at least one ring of
    vertices. This is the angle of `meshes.bend`. Positions are those of all assembled vertices, (n,
    3), in m.
    """
    positions = _checked(pattern, positions)
    rings = _rings(pattern, panel, sections)
    return turn_angle(pattern, positions, rings, (0, 0, 1), (1, 0, 0))


def twist_angle(
    pattern: Pattern, positions: Floats, panel: str = "wall", sections: int = 24
) -> float:
    """Return the angle in rad by which a tube along z is twisted about its axis, counter-clockwise.

    The relative rotation RₖᵀRₖ₊₁ between two sections is the product of a swing, which bends the
    axis, and a twist about it, 2 atan2(q_z, q_w) of its quaternion q. The twists are summed;
    between neighbours they must stay under 180°. The first section is compared with its assembled
    state, so the base must be fixed: a rotation of the whole tube would count as twist. For a
    straight tube the result is the angle by which the tip has turned, as in `meshes.twist`. Bending
    does not count as twist. The arguments are of `bend_angle`.
    """
    positions = _checked(pattern, positions)
    return turn_about(pattern, positions, _rings(pattern, panel, sections), (0, 0, 1))


def turn_about(
    pattern: Pattern, positions: Floats, sections: Sequence[Ints], along: npt.ArrayLike
) -> float:
    """Return the twist in rad of a body about its axis, as of `twist_angle`.

    `sections` are the vertices of each cross-section, starting at the body's root, and `along` is
    the unit vector along the assembled body, (3,).
    """
    axis = vector("along", along)
    rotations = [np.eye(3), *_rotations(pattern, positions, sections)]
    turns = 2 * np.array([np.arctan2(*swing_free(a.T @ b, axis)) for a, b in pairwise(rotations)])
    return float(((turns + np.pi) % (2 * np.pi) - np.pi).sum())


def _rotations(pattern: Pattern, positions: Floats, sections: Sequence[Ints]) -> list[Floats]:
    return [best_rotation(pattern.points[ring], positions[ring]) for ring in sections]


def length_ratio(pattern: Pattern, positions: Floats, panel: str = "wall") -> float:
    """Return the straight distance between a tube's two ends over the assembled one.

    The ends are the means of the wall's two borders across z. The arguments are of `bend_angle`.
    """
    positions = _checked(pattern, positions)
    wall = pattern.vertices_of(panel)
    height = pattern.points[wall, 2]
    low, high = height.min(), height.max()
    room = 1e-9 * (high - low)
    base, tip = wall[height < low + room], wall[height > high - room]
    ends = positions[tip].mean(axis=0) - positions[base].mean(axis=0)
    return float(np.linalg.norm(ends) / (high - low))


def shortening(pattern: Pattern, positions: Floats, panel: str = "wall") -> float:
    """Return 1 − `length_ratio`: the decrease of the distance between a tube's two ends."""
    return 1 - length_ratio(pattern, positions, panel)


def swelling(pattern: Pattern, positions: Floats, panel: str = "wall") -> float:
    """Return the radius of the middle third of a tube along z, over its assembled radius.

    The radius is the mean distance of the vertices from the line through the means of the third's
    two ends. The arguments are of `bend_angle`.
    """
    positions = _checked(pattern, positions)
    slab = label_cross_sections(pattern, pattern.vertices_of(panel), (0, 0, 1), 12)
    rings = section_vertices(np.where((slab >= 4) & (slab < 8), slab, -1), least=6)
    if len(rings) < 2:
        raise ParameterError(
            f"the middle third of panel {panel!r} has {len(rings)} rings of six vertices or more, "
            "and its radius is known from two. Refine the mesh."
        )
    ring = np.unique(np.concatenate(rings))

    def radius(points: Floats) -> float:
        base, tip = (points[of].mean(axis=0) for of in (rings[0], rings[-1]))
        along = (tip - base) / np.linalg.norm(tip - base)
        arm = points[ring] - base
        return float(np.linalg.norm(arm - np.outer(arm @ along, along), axis=1).mean())

    return radius(positions) / radius(pattern.points)


def distance(
    pattern: Pattern, positions: Floats, target: Floats, *, aligned: bool = False
) -> float:
    """Return the root mean square distance from a target in m, each vertex by its flat area.

    Positions and target are those of all vertices, (n, 3), in m. If `aligned`, the best-fitting
    rigid motion is removed first (Kabsch 1976).
    """
    if target.shape != positions.shape:
        raise ParameterError(
            f"the target has shape {target.shape}; the positions have {positions.shape}. On "
            "another mesh, as for an error estimate, measure by a target that is a function of "
            "the assembled positions, or by metrics of your own."
        )
    weight = pattern.vertex_areas / pattern.vertex_areas.sum()
    moved = positions
    if aligned:
        arm, goal = positions - weight @ positions, target - weight @ target
        rotation, _ = polar_rotation((weight[:, None] * goal).T @ arm)
        moved = arm @ rotation.T + weight @ target
    return float(np.sqrt(weight @ ((moved - target) ** 2).sum(axis=1)))


def _checked(pattern: Pattern, positions: Floats) -> Floats:
    """Return deformed positions of all vertices, (n, 3), in m, as an array."""
    require_kind("pattern", pattern, Pattern, "a Pattern")
    shape = pattern.points.shape
    return checked_floats("positions", positions, f"{shape}, in m", shape, finite=False)


def _rings(pattern: Pattern, panel: str, count: int) -> list[Ints]:
    """Return the vertices of a panel by slabs along z, and those of its far end."""
    labels = label_cross_sections(pattern, pattern.vertices_of(panel), (0, 0, 1), count)
    return section_vertices(labels, least=6)


def swing_free(rotation: Floats, axis: Floats) -> tuple[float, float]:
    """Return q·axis and q_w of a rotation's quaternion, up to a common factor."""
    # q·a/q_w of the twist about a is axial(R)·a/(1 + tr R), without dividing where tr R = −1.
    z, w = axial(rotation) @ axis, 1 + np.trace(rotation)
    if w > 1e-6:
        return float(z), float(w)
    half = np.sqrt(max(0.0, 1 + 2 * axis @ rotation @ axis - np.trace(rotation)))
    return float(half), 0.0
