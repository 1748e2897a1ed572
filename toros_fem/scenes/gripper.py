"""A gripper of three fingers that close on a sphere or a box when inflated (paper Fig. 1).

Each finger is flat, made of two panels, and clamped at its root in a mount. Three of them hang
around the object at 120°. Half a finger is designed, by symmetry. A line along its inner panel is
always printed, so that this panel keeps its length. The target follows from the object. Around a
sphere the finger goes as far as it reaches. The edges of a box are sharper than a finger can bend:
its outer panel would have to stretch fourfold. So the finger bends evenly from its root on, touches
the lower edge, and its tip ends below the box. The distance of the inner panel from the object,
where it is to touch, also counts. The printed finger is simulated again. The summary gives the
remaining gap, and how it changes when the object's weight hangs on the fingers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from toros_fem.actuators.case import ActuatorCase, Touching
from toros_fem.actuators.config import ActuatorConfig, TipWeights
from toros_fem.actuators.gripper import write_grasp
from toros_fem.actuators.legs import leg_cross_sections, tip_angle_metric
from toros_fem.actuators.run import ActuatorResult, design_actuator, summary_sentence
from toros_fem.config import quantity
from toros_fem.equilibrium.solver import EquilibriumError
from toros_fem.errors import ParameterError
from toros_fem.mechanics.supports import Supports, symmetry_plane
from toros_fem.meshes import Pattern, curl, finger, plane_centroids
from toros_fem.objectives.gap import SHAPES, Body
from toros_fem.objectives.metrics import Metric

ALONG, TOWARD = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
WRAP_ANGLE = {"sphere": 90.0, "box": 75.0}  # in degrees
TOUCHING_WIDTH = 1 / 3  # of the finger's width, which is to lie on the object
TOUCHING_GAP = 0.5e-3  # m; where the target is nearer to a box, the finger is to touch it
BEARING_TURN = np.pi / 6  # rad; a finger that has turned by more than this bears weight
TIP_TWELFTHS = 3  # of the finger beyond its root, whose angle is measured
GRAVITY = 9.81  # m/s²


@dataclass(frozen=True)
class GripperConfig(ActuatorConfig):
    """Numbers of the gripper; SI units.

    Raises:
        ParameterError: As in `ActuatorConfig`, or the finger would bend inside its mount.
    """

    shape: str = quantity("sphere", "shape of the object", choices=SHAPES)
    size: float = quantity(0.04, "diameter of the sphere or edge of the box", "m", above=0)
    finger_length: float = quantity(0.09, "length of a finger", "m", above=0)
    finger_width: float = quantity(0.025, "width of a finger", "m", above=0)
    root_length: float = quantity(0.015, "length of a finger in the mount", "m", above=0)
    backbone_width: float = quantity(
        6e-3, "width of the line along the inner panel that is always printed", "m", at_least=0
    )
    edge_length: float = quantity(1.2e-3, "edge length of the mesh", "m", above=0)
    inflated_depth: float = quantity(
        0.016, "depth of the inflated finger where it is straight, a first guess", "m", at_least=0
    )
    wrap_angle: float | None = quantity(
        None,
        "angle by which a finger goes around the object; none takes 90 at a sphere and 75 at a box",
        "deg",
        above=0,
        at_most=360,
    )
    tip_angle: float | None = quantity(
        None,
        "angle by which the finger's outer quarter is to turn; none takes that at the object",
        "deg",
        above=0,
        at_most=360,
    )
    edge_bend_radius: float = quantity(
        0.047, "radius around which a finger bends at a box, whose edges are sharper", "m", above=0
    )
    edge_angle: float = quantity(
        60.0,
        "angle by which a finger has turned where it touches a box's edge",
        "deg",
        above=0,
        at_most=180,
    )
    tail_length: float = quantity(
        0.01, "length of a finger that is straight below a box", "m", at_least=0
    )
    cross_sections: int = quantity(4, "number of cross-sections of a finger", at_least=1)
    centreline_weight: float = quantity(
        0.05, "weight of the finger's centre line over that of its orientation", at_least=0
    )
    orientation_length: float = TipWeights.redefault("orientation_length", 0.02)
    contact_weight: float = quantity(
        5.0, "weight of the inner panel's distance from the object", at_least=0
    )
    mass: float = quantity(0.03, "mass of the object", "kg", at_least=0)
    seams: str = ActuatorConfig.redefault("seams", "hinged")
    levels: int | None = ActuatorConfig.redefault("levels", 1)
    pressure: float = ActuatorConfig.redefault("pressure", 10e3)
    corrections: int = ActuatorConfig.redefault("corrections", 4)
    polish_iterations: int = ActuatorConfig.redefault("polish_iterations", 40)
    # The paper states none.
    design_pressure: bool = ActuatorConfig.redefault("design_pressure", True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.bend_start < self.root_length:
            raise ParameterError(
                f"the finger starts to bend at {self.bend_start:.3g} m, inside its mount, which "
                f"ends at root_length = {self.root_length:.3g} m. Give a longer finger, a smaller "
                "object or wrap_angle, or around a box a smaller edge_bend_radius or tail_length."
            )

    TARGETS: ClassVar[Mapping[str, str]] = {"angle_deg": "tip_angle"}

    @property
    def coarsest_edge(self) -> float:
        """Longest edge length in m of a useful mesh: four edges across half a finger."""
        return self.finger_width / 8

    @property
    def bend_angle(self) -> float:
        """Angle in rad by which a finger goes around the object."""
        return float(np.radians(self.wrap_angle or WRAP_ANGLE[self.shape]))

    @property
    def bend_radius(self) -> float:
        """Radius in m around which the inner panel bends."""
        return self.edge_bend_radius if self.shape == "box" else self.size / 2

    @property
    def bend_start(self) -> float:
        """Distance in m from the root at which a finger starts to bend.

        The inner panel keeps its length and goes around the object; its tip ends where it should.
        """
        tail = self.tail_length if self.shape == "box" else 0.0
        return float(self.finger_length - tail - self.bend_angle * self.bend_radius)

    @property
    def body(self) -> Body:
        """The object inside the bend; a box touches with its edge."""
        free = Body(self.shape, self.size, (0.0, 0.0, 0.0))
        # The edge's arc touches the bend from inside; a sphere fills it.
        turn, inside = np.radians(self.edge_angle), self.bend_radius - free.radius
        core = self.size / 2 - free.radius
        x = self.bend_start + inside * np.sin(turn) - core
        z = self.inflated_depth / 2 + self.bend_radius - inside * np.cos(turn) + core
        return Body(self.shape, self.size, (float(x), 0.0, float(z)))

    @property
    def touching(self) -> tuple[float, float]:
        """First and last distance in m from the root at which the inner panel is to touch."""
        if self.shape == "sphere":
            return self.bend_start, self.finger_length - self.finger_width / 4
        middle = self.bend_start + np.radians(self.edge_angle) * self.bend_radius
        # An arc leaves another one of radius r by s²/2 (1/r − 1/R) at the distance s.
        sharper = 1 / self.body.radius - 1 / self.bend_radius
        half = max(np.sqrt(2 * TOUCHING_GAP / sharper), self.edge_length)
        return float(middle - half), float(middle + half)


def coarse(config: GripperConfig) -> GripperConfig:
    """Return the same design on a coarse mesh with few steps; it takes a minute or two."""
    return config.updated(
        edge_length=2.4e-3,
        filter_radius=3.7e-3,
        levels=1,
        iterations=40,
        constrained_iterations=30,
    )


def touching_vertices(pattern: Pattern, config: GripperConfig) -> npt.NDArray[np.bool_]:
    """Return which vertices are to touch: a strip along the inner panel's middle, (n,)."""
    inner = np.zeros(len(pattern.points), dtype=bool)
    inner[pattern.vertices_of("top")] = True
    x, y, _ = pattern.points.T
    begin, end = config.touching
    middle = np.abs(y) < TOUCHING_WIDTH * config.finger_width / 2
    return np.asarray(inner & (x > begin) & (x < end) & middle)


def gap_metric(config: GripperConfig) -> Metric:
    """Return the mean distance in mm of the touching strip from the object, inside or outside."""
    body = config.body

    def measure(pattern: Pattern, positions: npt.NDArray[np.float64]) -> float:
        touching = touching_vertices(pattern, config)
        distance, _ = body.distance(positions[touching])
        return float(1e3 * np.average(np.abs(distance), weights=pattern.vertex_areas[touching]))

    return Metric("gap", "mm", 0.0, measure, scale=1e3 * config.size)


def case(comm: MPI.Comm, config: GripperConfig) -> ActuatorCase:
    """Return half a finger and its target."""
    root, angle = config.root_length, config.bend_angle
    pattern = finger(
        comm,
        config.edge_length,
        length=config.finger_length,
        width=config.finger_width,
        root=root,
        planes=(1,),
    )
    tip_angle = tip_angle_metric(0.0, ALONG, TOWARD, root, outer_count=TIP_TWELFTHS)

    def around(turn: float) -> npt.NDArray[np.float64]:
        deform = curl(
            turn,
            angle * config.bend_radius,
            origin=(config.bend_start, 0, config.inflated_depth / 2),
            along=ALONG,
            toward=TOWARD,
        )
        return deform(pattern.points)

    target = around(angle)
    tip = tip_angle.measure(pattern, target)
    if config.tip_angle is not None:
        # The outer quarter turns by a fixed part of the whole angle; the object stays.
        target, tip = around(angle * config.tip_angle / tip), config.tip_angle
    inner = pattern.panel == pattern.panel_index("top")
    off_middle = np.abs(plane_centroids(pattern)[:, 1])
    fixed = np.zeros((len(pattern.points), 3), dtype=bool)
    fixed[pattern.points[:, 0] <= root * (1 + 1e-9)] = True
    touching = touching_vertices(pattern, config).astype(np.float64)
    return ActuatorCase(
        pattern=pattern,
        target=target,
        supports=Supports(fixed) | symmetry_plane(pattern, 1),
        passive=np.where(inner & (off_middle < config.backbone_width / 2), 1.0, np.nan),
        metrics=(
            gap_metric(config),
            replace(tip_angle, target=tip),
        ),
        cross_sections=leg_cross_sections(
            pattern,
            ALONG,
            root,
            config.cross_sections,
            config.centreline_weight,
            config.orientation_length,
        ),
        touching=Touching(config.body, touching, config.contact_weight),
        # The outer panel is to stretch; without this hint the start is the same in and out.
        start=np.where(inner, 0.65, 0.35),
        symmetry=(1,),
    )


def lift(
    comm: MPI.Comm, output: Path, config: GripperConfig, pattern: Pattern, design: ActuatorResult
) -> dict[str, Any]:
    """Simulate the printed finger under a third of the object's weight; return its figures.

    Args:
        comm: Communicator.
        output: Folder for pictures and figures.
        config: Numbers of the gripper.
        pattern: Half a finger.
        design: The designed finger.
    """
    shown, problem = design.printed.evaluation or design.result.final, design.problem
    skin = problem.skin
    # Half a finger bears a sixth.
    turned = config.bend_start + BEARING_TURN * config.bend_radius
    bearing = touching_vertices(pattern, config) & (pattern.points[:, 0] > turned)
    weight = pattern.vertex_areas * bearing
    force = np.outer(weight / weight.sum(), [config.mass * GRAVITY / 6, 0, 0])
    try:
        found = problem.solver.solve(
            shown.projected,
            shown.equilibrium.pressures,
            force=force,
            start=shown.equilibrium.positions,
        )
    except EquilibriumError as caught:  # raised by all ranks or by none
        return {"mass_kg": config.mass, "failure": str(caught)}
    free = skin.gather_vertices(shown.equilibrium.positions)
    loaded = skin.gather_vertices(found.positions)
    sag = np.average((loaded - free)[:, 0], weights=weight)
    gap = gap_metric(config).measure(pattern, loaded)
    figures = {"mass_kg": config.mass, "sag_mm": 1e3 * float(sag), "gap_mm": gap}
    whole = problem.whole
    assert whole is not None
    positions, regions = whole.at_vertices(free), design.printed.regions
    write_grasp(comm, output, whole.pattern, positions, regions, config.body, figures)
    return figures


def run(
    comm: MPI.Comm,
    output: Path | str,
    config: GripperConfig | None = None,
    *,
    verbose: bool = False,
) -> dict[str, Any]:
    """Design the finger and load it; return the summary, with the load's figures under "load".

    Args:
        comm: Communicator.
        output: Folder for summary, history, pattern, fields and pictures.
        config: Numbers of this design; None takes the defaults.
        verbose: Whether to print every Newton step.
    """
    config = config or GripperConfig()
    made = design_actuator(comm, output, case, config, verbose=verbose)
    half = made.problem.skin.pattern
    return {**made.summary, "load": lift(comm, Path(output), config, half, made)}


def sentence(summary: dict[str, Any]) -> str:
    """Return the result in words."""
    load = summary["load"]
    grams = f"{1e3 * load['mass_kg']:.0f} g "
    lifted = f"sag by {load['sag_mm']:.1f} mm" if "sag_mm" in load else "cannot be held"
    return f"{summary_sentence(summary)}; {grams}{lifted}"
