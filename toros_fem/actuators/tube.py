"""The capped tube that bends, shortens or twists (paper Fig. 8): what its demos share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from toros_fem._types import Floats
from toros_fem._validate import require_between, require_count, require_positive
from toros_fem.actuators.case import ActuatorCase
from toros_fem.mechanics.supports import Supports, clamp
from toros_fem.meshes.cylinder import BASE, TIP, WALL, cylinder
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.targets import Deformer
from toros_fem.objectives.cross_sections import CrossSections, label_cross_sections
from toros_fem.objectives.metrics import Metric, bend_angle, shortening, twist_angle

TUBE: dict[str, Any] = {
    "length": 0.15,  # m
    "diameter": 0.02,  # m
    "edge_length": 1.4e-3,  # m
    "mesh": "unstructured",
    "tip_weight": 1.0,  # of the tip's place in the objective, over that of all the rest
    "lever": 0.03,  # m; turning the tip by 0.1 rad counts as if the whole skin were off by 3 mm
}
# The same on a small mesh, in a minute or two.
COARSE_TUBE: dict[str, Any] = {
    "edge_length": 2.85e-3,
    "radius": 4.4e-3,
    "iterations": 40,
    "constrained": 30,
}
# What demos whose skin may swell as it likes have besides.
SECTIONS: dict[str, Any] = {
    "sections": 12,  # along the wall; the far border makes one more
    "along": 1.0,  # weight of the sections' places along the tube, over that across it
    "helices": 0,  # lines around the tube in the first guess; 0 starts from 0.5 everywhere
    "helix_angle": 0.0,  # to the axis, in degrees; right-handed ones are positive
    "helix_width": 3e-3,  # m
    "crossed": 0,  # 1 crosses them with left-handed ones
}


def _degrees(measure: Callable[[Pattern, Floats], float]) -> Callable[[Pattern, Floats], float]:
    return lambda pattern, positions: float(np.degrees(measure(pattern, positions)))


def bend_metric(asked: float) -> Metric:
    """The bend angle of a tube's tip, in degrees, `measure.bend_angle`."""
    return Metric("angle", "deg", asked, _degrees(bend_angle))


def twist_metric(asked: float) -> Metric:
    """The twist of a tube's tip, in degrees, `measure.twist_angle`."""
    return Metric("twist", "deg", asked, _degrees(twist_angle))


def shortening_metric(asked: float) -> Metric:
    """How much closer a tube's ends are, in per cent, `measure.shortening`."""
    return Metric("shortening", "percent", asked, lambda of, x: 100 * shortening(of, x))


def tube_scene(
    comm: MPI.Comm, inputs: dict[str, Any], target: Deformer, metrics: Sequence[Metric]
) -> ActuatorCase:
    """A tube along z, its base clamped, its end caps printed all over, its wall designed.

    All vertices are wanted where the target has them, the end plate's more than the rest.

    Args:
        comm: Communicator.
        inputs: Values for the names in `TUBE`.
        target: What the assembled tube is to become.
        figures: What the run is judged by.

    Raises:
        ParameterError: A number is out of bounds.
    """
    o = inputs
    pattern = _tube(comm, o)
    plate, area = pattern.vertices_of(TIP), pattern.vertex_areas
    weights = np.ones(len(pattern.points))
    weights[plate] += o["tip_weight"] * area.sum() / area[plate].sum()
    # The ring, not the plate, which bulges. Turned by a small angle about a diameter it moves by
    # angle · radius/√2 in root mean square.
    ring = np.intersect1d(plate, pattern.vertices_of(WALL))
    relative = np.zeros(len(pattern.points))
    ratio = np.sqrt(2) * o["lever"] / (o["diameter"] / 2)
    relative[ring] = ratio**2 * (area @ weights) / area[ring].sum()
    return replace(_free_scene(pattern, target, metrics), weights=weights, relative=relative)


def section_scene(
    comm: MPI.Comm, inputs: dict[str, Any], target: Deformer, metrics: Sequence[Metric]
) -> ActuatorCase:
    """As `tube_scene`, but only the places and orientations of cross-sections are wanted.

    The skin may swell as it likes. With `along` = 0 it may lengthen and shorten too. The far
    border's place counts `tip_weight` times as much as the mean over all slabs.

    Args:
        comm: Communicator.
        inputs: Values for the names in `TUBE` and `SECTIONS`.
        target: What the assembled tube is to become.
        figures: What the run is judged by.

    Raises:
        ParameterError: A number is out of bounds.
    """
    o = inputs
    require_between(0.0, np.inf, along=o["along"])
    pattern = _tube(comm, o)
    start = None
    if o["helices"]:
        lines = [
            helices(pattern, o["helices"], np.radians(angle), o["helix_width"])
            for angle in {o["helix_angle"], o["helix_angle"] * (-1 if o["crossed"] else 1)}
        ]
        start = np.where(np.any(lines, axis=0), 0.7, 0.3)
    count = o["sections"]
    share = np.append(np.full(count, 1 / count), o["tip_weight"])
    return replace(
        _free_scene(pattern, target, metrics),
        start=start,
        sections=CrossSections(
            label_cross_sections(pattern, pattern.vertices_of(WALL), (0, 0, 1), count),
            np.outer(share, [1.0, 1.0, o["along"]]),
            # If each of n sections is off by δ/n from the one before, the tip is off by δ.
            np.full(count + 1, (count + 1) * o["tip_weight"] * (o["lever"] / pattern.size) ** 2),
        ),
    )


def plain_tube(comm: MPI.Comm, inputs: dict[str, Any]) -> tuple[Pattern, Supports, Floats]:
    """The tube without reinforcement: pattern, what is held, and the density of all triangles.

    Args:
        comm: Communicator.
        inputs: Values for the names in `TUBE`.
    """
    pattern = _tube(comm, inputs)
    return pattern, clamp(pattern, [BASE]), np.nan_to_num(_caps(pattern), nan=0.0)


def helices(pattern: Pattern, count: int, angle: float, width: float) -> npt.NDArray[np.bool_]:
    """Which triangles lie on helical lines around the tube, (t,).

    Args:
        pattern: The tube.
        count: Number of lines around.
        angle: Their angle to the axis in rad; those of a positive angle are right-handed.
        width: Of each line, in m.
    """
    require_count(1, count=count)
    require_positive(width=width)
    u, v = pattern.centroids.T
    cells = pattern.cells_of(WALL)
    pitch = np.ptp(pattern.corners[cells, :, 0]) / count
    phase = (u - np.tan(angle) * v) % pitch
    off = np.minimum(phase, pitch - phase) * np.cos(angle)
    return np.asarray((pattern.panel == pattern.panel_index(WALL)) & (off < width / 2))


def _tube(comm: MPI.Comm, o: dict[str, Any]) -> Pattern:
    require_between(0.0, np.inf, tip_weight=o["tip_weight"], orientation_length=o["lever"])
    return cylinder(comm, o["length"], o["diameter"], o["edge_length"], mesh=o["mesh"])


def _free_scene(pattern: Pattern, target: Deformer, metrics: Sequence[Metric]) -> ActuatorCase:
    """A tube clamped at its base, nothing said yet of what counts how much."""
    return ActuatorCase(
        pattern=pattern,
        target=target(pattern.points),
        supports=clamp(pattern, [BASE]),
        metrics=tuple(metrics),
        passive=_caps(pattern),
    )


def _caps(pattern: Pattern) -> Floats:
    """Given densities: end plates printed all over, the wall designed."""
    return np.where(pattern.panel == pattern.panel_index(WALL), np.nan, 1.0)
