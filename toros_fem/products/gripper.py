"""A gripper whose fingers close on an object when inflated, and lift it (paper Fig. 1).

Each finger is flat, made of two panels, and clamped at its root in a mount. The mount also carries
the inner panel on a stem: held in a flat line alone the finger would turn about it like a hinge.
Three fingers stand around a sphere, four around a box. Half a finger is designed, by symmetry, in
contact with the object, which is held in its place. A line along the inner panel is always printed,
so that this panel keeps its length. The target shape goes around the object. The objective also
asks for a holding force, that of the normal forces upwards and of the friction that they allow.

The printed gripper then lifts the object from a thin post, see `load.py`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import Distance, Factor, In, Length, OneOf, Positive, Table, Text, key
from toros_fem.base.validation import Bools, Floats
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.problem import Evaluation
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.measures.figures import Figure
from toros_fem.measures.metrics import Metric
from toros_fem.measures.regions import SHAPES, Body, GapObjective, mean_gap
from toros_fem.measures.shape import Nodes, Objective
from toros_fem.mechanics.contact.bodies import Ground
from toros_fem.mechanics.contact.contact import Contact
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.readings.holding import HoldingObjective
from toros_fem.mechanics.skin.supports import Supports, symmetry_plane
from toros_fem.mechanics.terms.loads import GRAVITY
from toros_fem.meshes.outlines import finger, plane_centroids
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.targets import curl
from toros_fem.products.actuators.estimates import COARSER, OnOtherMesh
from toros_fem.products.actuators.legs import Leg, LegWeights
from toros_fem.products.actuators.result import SkinDesign
from toros_fem.products.actuators.scene import ActuatorScene, Level
from toros_fem.products.common.plausibility import Group, Inflated, angle_group
from toros_fem.products.common.tables import ContactTable, DesignTable, PressureTable, SkinSheets
from toros_fem.products.gripper_load import (
    ALONG,
    TOWARD,
    LiftResult,
    grip_of,
    lift,
    lift_figures,
    solid,
)

WRAP_ANGLE = {"sphere": 90.0, "box": 60.0}  # in degrees
FINGERS = {"sphere": 3, "box": 4}  # as many as its sides, so that each finger does the same
TOUCHING_WIDTH = 1 / 3  # of the finger's width, which is to lie on the object
MIDDLE = 1 / 4  # of that width, whose gap is told: an inflated finger is round
TOUCHING_GAP = 0.5e-3  # m; where the target is nearer to a box, the finger is to touch it
# Ribs around the outer panel that a design starts from, so that it stretches along and not around:
# their period over the finger's width, and the least and largest density.
RIBS, RIB_DENSITIES = 0.4, (0.12, 0.65)
TIP_TWELFTHS = 3  # of the finger beyond its root, whose angle is measured
ROUNDING = 1 + 1e-9  # of lengths up to which a vertex is held


class GripTarget(Table):
    """Shape that is asked for."""

    wrap_angle: Annotated[float, In("deg", above=0, at_most=360)] | None = key(
        None,
        "angle by which a finger goes around the object; none takes 90 at a sphere and 60 at a box",
    )
    tip_angle: Annotated[float, In("deg", above=0, at_most=360)] | None = key(
        None,
        "angle by which the finger's outer quarter is to turn; none takes that at the object",
        metric="angle",
    )
    edge_bend_radius: Length = key(
        0.03, "radius around which a finger bends at a box, whose edges are sharper"
    )
    edge_angle: Annotated[float, In("deg", above=0, at_most=180)] = key(
        45.0, "angle by which a finger has turned where it touches a box's edge"
    )
    tail_length: Distance = key(0.01, "length of a finger that is straight below a box")
    inflated_depth: Distance = key(
        0.016, "depth of the inflated finger where it is straight, a first guess"
    )

    NEEDS: ClassVar = dict.fromkeys(
        ("edge_bend_radius", "edge_angle", "tail_length"), ("shape", ("box",))
    )


class Gripped(Table):
    """What is gripped."""

    shape: Annotated[str, OneOf(SHAPES)] = key("sphere", "shape of the object")
    size: Length = key(0.05, "diameter of the sphere or edge of the box")
    mass: Annotated[float, In("kg", above=0)] = key(0.1, "mass of the object")
    object_mesh: Text | None = key(
        None,
        "mesh file of an object to be lifted in the place of the shape that is designed for, its z "
        "upwards; none lifts that shape",
    )
    object_scale: Length = key(1e-3, "length of the mesh file's unit")
    lift_distance: Length | None = key(
        0.05, "distance by which the mounts move up; none leaves the lift out"
    )
    slip_limit: Length = key(5e-3, "sliding of the object up to which it counts as held")

    NEEDS: ClassVar = {
        "object_scale": ("object_mesh", ()),
        "slip_limit": ("lift_distance", ()),
    }


class FingerSizes(Table):
    """Sizes and mesh."""

    finger_length: Length = key(0.09, "length of a finger")
    finger_width: Length = key(0.02, "width of a finger")
    root_length: Length = key(0.015, "length of a finger in the mount")
    stem_length: Length = key(
        0.025, "length of a finger whose inner panel the mount's stem carries"
    )
    backbone_width: Distance = key(
        6e-3, "width of the line along the inner panel that is always printed"
    )
    edge_length: Length = key(1.2e-3, "edge length of the mesh")


class GripWeights(LegWeights):
    """What counts in the objective."""

    contact_weight: Factor = key(100.0, "weight of the inner panel's distance from the object")
    holding_factor: Positive = key(
        1.5, "holding force that the design asks for, over the object's weight"
    )
    holding_weight: Factor = key(0.1, "weight of the holding force that is missing")


class GripperScene(ActuatorScene):
    """The gripper.

    Raises:
        ParameterError: As in `ActuatorScene`, the finger would bend inside its mount, or the stem
            ends before the root or beyond the finger.
    """

    target: GripTarget = GripTarget()
    object: Gripped = Gripped()
    skin: FingerSizes = FingerSizes()
    material: SkinSheets = SkinSheets(seams="hinged")
    # The paper states none.
    pressure: PressureTable = PressureTable(pressure=15e3)
    contact: ContactTable = ContactTable(friction=0.6)
    objective: GripWeights = GripWeights(
        orientation_length=0.02, cross_sections=4, centreline_weight=0.3
    )
    # Steps that only raise the holding force are small.
    design: DesignTable = DesignTable(levels=1, min_decrease=None, polish_iterations=40)

    KIND: ClassVar = "gripper"
    FEW: ClassVar = (
        "shape", "size", "mass", "finger_length", "finger_width", "pressure", "friction",
        "edge_length", "seed",
    )  # fmt: skip
    TRIAL_MESH: ClassVar = 1 / COARSER  # a lift costs little, and coarse fingers slip off
    COARSE: ClassVar = {"edge_length": 1.5, "filter_radius": 3 / 2}
    OUTLINE: ClassVar = {"root": "root_length"}

    def __post_init__(self) -> None:
        super().__post_init__()
        sizes = self.skin
        if not sizes.root_length <= sizes.stem_length < sizes.finger_length:
            raise ParameterError(
                f"stem_length = {sizes.stem_length} m must be at least root_length = "
                f"{sizes.root_length} m and less than finger_length = {sizes.finger_length} m.",
                "stem_length",
            )
        if self.bend_start < sizes.root_length:
            raise ParameterError(
                f"around an object of size = {self.object.size:.3g} m the finger starts to bend "
                f"at {self.bend_start:.3g} m, inside its mount, which ends at root_length = "
                f"{sizes.root_length:.3g} m. Give a larger finger_length, a smaller object or "
                "wrap_angle, or around a box a smaller edge_bend_radius or tail_length."
            )

    @property
    def radius(self) -> float:
        """Radius in m of the inflated finger: two flat layers become round."""
        return self.skin.finger_width / np.pi

    @property
    def coarsest_edge(self) -> float:
        """Longest edge length in m of a useful mesh: four edges across half a finger."""
        return self.skin.finger_width / 8

    def groups_of(self, skin: Inflated) -> Iterator[Group]:
        """Yield the dimensionless groups of the scene."""
        yield from super().groups_of(skin)
        yield skin.slenderness("finger_length", self.skin.finger_length)
        for name in ("wrap_angle", "tip_angle", "edge_angle"):
            if (angle := self.value(name)) is not None:
                yield angle_group(name, angle)

    @property
    def fingers(self) -> int:
        """Number of fingers around the object."""
        return FINGERS[self.object.shape]

    @property
    def leg(self) -> Leg:
        """The finger beyond its root."""
        return Leg(ALONG, TOWARD, self.skin.root_length)

    @property
    def bend_angle(self) -> float:
        """Angle in rad by which a finger goes around the object."""
        return float(np.radians(self.target.wrap_angle or WRAP_ANGLE[self.object.shape]))

    @property
    def bend_radius(self) -> float:
        """Radius in m around which the inner panel bends."""
        return self.target.edge_bend_radius if self.object.shape == "box" else self.object.size / 2

    @property
    def bend_start(self) -> float:
        """Distance in m from the root at which a finger starts to bend.

        The inner panel keeps its length and goes around the object; its tip ends where it should.
        """
        tail = self.target.tail_length if self.object.shape == "box" else 0.0
        return float(self.skin.finger_length - tail - self.bend_angle * self.bend_radius)

    @property
    def body(self) -> Body:
        """The object inside the bend; a box touches with its edge."""
        free = Body(self.object.shape, self.object.size, (0.0, 0.0, 0.0))
        # The edge's arc touches the bend from inside; a sphere fills it.
        turn, inside = np.radians(self.target.edge_angle), self.bend_radius - free.radius
        core = self.object.size / 2 - free.radius
        x = self.bend_start + inside * np.sin(turn) - core
        z = self.target.inflated_depth / 2 + self.bend_radius - inside * np.cos(turn) + core
        return replace(free, centre=(float(x), 0.0, float(z)))

    @property
    def held_contact(self) -> Contact:
        """Contact with the object, which is held, and with the next finger, without friction.

        By symmetry fingers meet in planes through the object's axis.
        """
        body, half = self.body, np.pi / self.fingers
        between = Ground((0.0, 0.0, body.centre[2]), (0.0, -np.cos(half), -np.sin(half)))
        return Contact(
            ground=between,
            bodies=[solid(body)],
            self_contact=False,
            distance=self.contact.contact_distance,
        )

    def touching(self, edge: float) -> tuple[float, float]:
        """Return from where to where the inner panel is to touch, in m from the root.

        Args:
            edge: Edge length of the mesh in m, which a short way is not under.
        """
        if self.object.shape == "sphere":
            return self.bend_start, self.skin.finger_length - self.skin.finger_width / 4
        middle = self.bend_start + np.radians(self.target.edge_angle) * self.bend_radius
        # An arc leaves another one of radius r by s²/2 (1/r − 1/R) at the distance s.
        sharper = 1 / self.body.radius - 1 / self.bend_radius
        half = max(np.sqrt(2 * TOUCHING_GAP / sharper), edge)
        return float(middle - half), float(middle + half)

    def touching_vertices(self, pattern: Pattern, edge: float, part: float = 1.0) -> Bools:
        """Return which vertices are to touch: a strip along the inner panel's middle, (n,).

        Of the strip's width the middle part counts.
        """
        (begin, end), (x, y, _) = self.touching(edge), pattern.points.T
        middle = np.abs(y) < part * TOUCHING_WIDTH * self.skin.finger_width / 2
        return np.asarray(on_inner(pattern) & (x > begin) & (x < end) & middle)

    def mounted(self, pattern: Pattern) -> Supports:
        """Return the supports by the mount: root and stem."""
        x, sizes = pattern.points[:, 0], self.skin
        held = x <= sizes.root_length * ROUNDING
        held |= on_inner(pattern) & (x <= sizes.stem_length * ROUNDING)
        return Supports(np.repeat(held[:, None], 3, axis=1))

    def case(self, comm: MPI.Comm, level: Level) -> Case:
        """Return half a finger and its target (collective)."""
        assert level.edge_length is not None
        edge, sizes, goal = level.edge_length, self.skin, self.objective
        pattern = finger(
            comm,
            edge,
            length=sizes.finger_length,
            width=sizes.finger_width,
            root=sizes.root_length,
            planes=(1,),
        )
        target, angle = self._bent(pattern)
        inner = pattern.panel == pattern.panel_index("top")
        off_middle = np.abs(plane_centroids(pattern)[:, 1])
        contact, body = self.held_contact, self.body
        contact_sizes = contact.sizes(self.material.composite)
        if not self.touching_vertices(pattern, edge).any():
            raise ParameterError(
                f"size = {self.object.size:.3g} m: no vertex of the fingers would touch an object "
                f"as small as this with edges of {edge:.3g} m. Take a larger one, or a smaller "
                "edge_length.",
                "size",
            )
        # Upwards, and towards the object's axis as far as friction makes use of it.
        direction = (self.contact.friction or 0.0) * np.asarray(TOWARD) - np.asarray(ALONG)
        force = goal.holding_factor * self.object.mass * GRAVITY / (2 * self.fingers)

        def held(pattern: Pattern) -> Supports:
            return self.mounted(pattern) | symmetry_plane(pattern, 1)

        def touching(nodes: Nodes, target: Floats) -> Objective:
            strip = self.touching_vertices(nodes.pattern, edge).astype(np.float64)
            return GapObjective(nodes, body, strip, goal.contact_weight)

        def holding(nodes: Nodes, target: Floats) -> Objective:
            fixed, weight = held(nodes.pattern).fixed, goal.holding_weight
            return HoldingObjective(nodes, contact, contact_sizes, fixed, direction, force, weight)

        def gap(pattern: Pattern, positions: Floats) -> float:
            middle = self.touching_vertices(pattern, edge, MIDDLE)
            return 1e3 * mean_gap(body, pattern, positions, middle)

        low, high = RIB_DENSITIES
        along = pattern.centroids[:, 0] / (RIBS * sizes.finger_width)
        ribs = low + (high - low) * (0.5 + 0.5 * np.cos(2 * np.pi * along))
        return replace(
            self.loaded(pattern, target, held(pattern), (1,)),
            parts=[self.leg.sections(pattern, goal), touching, holding],
            metrics=(Metric("gap", "mm", 0.0, gap, scale=1e3 * self.object.size), angle),
            passive=np.where(inner & (off_middle < sizes.backbone_width / 2), 1.0, np.nan),
            # Without this hint the start is the same in and out.
            start=np.where(inner, high, ribs),
            contact=contact,
        )

    def _bent(self, pattern: Pattern) -> tuple[Floats, Metric]:
        """Return the target positions of half a finger, and the angle of its tip."""
        angle = self.leg.angle_metric(0.0, outer_count=TIP_TWELFTHS)

        def around(turn: float) -> Floats:
            deform = curl(
                turn,
                self.bend_angle * self.bend_radius,
                origin=(self.bend_start, 0, self.target.inflated_depth / 2),
                along=ALONG,
                toward=TOWARD,
            )
            return deform(pattern.points)

        target, asked = around(self.bend_angle), self.target.tip_angle
        tip = angle.measure(pattern, target)
        if asked is None:
            return target, replace(angle, target=tip)
        # The outer quarter turns by a fixed part of the whole angle; the object stays.
        return around(self.bend_angle * asked / tip), replace(angle, target=asked)

    def trial(
        self,
        comm: MPI.Comm,
        output: Path,
        made: SkinDesign,
        other: OnOtherMesh | None = None,
    ) -> LiftResult | None:
        """Let the gripper lift its object (collective)."""
        if self.object.lift_distance is None:
            return None
        return lift(comm, output, self, made, other)

    def trial_figures(self, comm: MPI.Comm, made: Evaluation[Equilibrium]) -> tuple[Figure, ...]:
        """Return held mass, slip and smallest distance of fingers with this print (collective)."""
        assert isinstance(made.problem, ShapeDesign)
        found = grip_of(comm, made.problem, self).pull_of(made).figures
        return () if found.failure else lift_figures(found, {})


def on_inner(pattern: Pattern) -> Bools:
    """Return which vertices lie on a finger's inner panel, (n,)."""
    return np.isin(np.arange(len(pattern.points)), pattern.vertices_of("top"))
