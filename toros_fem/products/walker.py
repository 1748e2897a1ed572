"""An X-shaped walker that stands up or crawls when inflated (paper Figs. 9, 10).

A quarter with one leg is designed, by symmetry: for the shape of its legs, or for the stride of its
gait. The whole robot is printed. Half of it, front and rear leg on one side, then walks on the
ground, with its own weight, friction and self-contact, through cycles of a gait: chambers are
filled and emptied fully. A gait is a path of equilibria, without inertia.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import Count, In, Length, OneOf, Place, Positive, Table, key
from toros_fem.base.validation import Bools, Floats
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.problem import Evaluation
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.measures.cross_sections import CrossSections
from toros_fem.measures.figures import Figure
from toros_fem.measures.metrics import Metric
from toros_fem.mechanics.contact.bodies import Ground, ipctk
from toros_fem.mechanics.contact.contact import Contact
from toros_fem.mechanics.contact.sliding import Pads
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.paths.trace import trace
from toros_fem.mechanics.paths.trace_point import until_failure
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.supports import symmetry_plane
from toros_fem.mechanics.terms.loads import Weight
from toros_fem.meshes.outlines import Star, plane_centroids, walker
from toros_fem.meshes.pattern import Pattern, mirrored
from toros_fem.meshes.skin import sew
from toros_fem.meshes.targets import stand
from toros_fem.products.actuators.estimates import OnOtherMesh, trial_intervals
from toros_fem.products.actuators.legs import Leg, LegWeights, rest_on_body
from toros_fem.products.actuators.result import SkinDesign
from toros_fem.products.actuators.scene import ActuatorScene, Level
from toros_fem.products.common.plausibility import Group, Inflated, angle_group
from toros_fem.products.common.tables import (
    ContactTable,
    DesignTable,
    PressureTable,
    ResultTable,
    SkinSheets,
)
from toros_fem.products.gait import Gait, Walk, flat_on_ground, walk_of, write_gait

AIMS = ("shape", "stride")
ANGLE = {"stand": 90.0, "crawl": 60.0}  # of the legs, in degrees
CHAMBERS = ("body", "front", "rear")
# Phases of the gait: pressure of each chamber at their ends, over the full one.
PHASES = {
    # Bent legs draw the rear feet up to the front ones; emptied, these push the front ones ahead.
    "one-way": np.array([[1, 1, 1], [1, 0, 0]]),
    # Rear feet grip, the body reaches out, front feet grip, rear feet let go, the body draws in.
    "nonslip": np.array([[0, 0, 1], [1, 0, 1], [1, 1, 1], [1, 1, 0], [0, 1, 0], [0, 1, 1]]),
}
# Part of the shape in the objective of a stride: it tells down from up.
SHAPE_IN_STRIDE = 0.1
DOWN = (0.0, 0.0, -1.0)
# Fig. 10 of the paper: distance in m by which the crawling robot gets ahead in a cycle.
MEASURED_STRIDE = ("paper, measured", 0.025)


class LegTarget(Table):
    """Shape that is asked for."""

    motion: Annotated[str, OneOf(tuple(ANGLE))] = key("stand", "what the legs are designed for")
    aim: Annotated[str, OneOf(AIMS)] = key(
        "shape", "what is designed: the shape of the legs, or the stride"
    )
    angle: Annotated[float, In("deg", above=0)] | None = key(
        None, "angle by which legs bend; none takes 90 to stand and 60 to crawl", metric="angle"
    )
    reach: Place = key(
        6e-3, "distance along x by which the body reaches out to either side if it crawls"
    )
    bent_length: Length = key(
        0.03, "length of a leg that bends, from its root; the rest stays straight"
    )


class WalkerSizes(Table):
    """Sizes and mesh."""

    leg_length: Length = key(0.06, "length of a leg from the body's circle")
    leg_width: Length = key(0.024, "width of a leg")
    body_radius: Length = key(0.02, "radius of the body")
    fillet: Length = key(6e-3, "radius of the fillets between body and legs")
    foot_length: Length | None = key(
        None, "length of a leg's end that is printed; none leaves it to the design"
    )
    edge_length: Length = key(1.8e-3, "edge length of the mesh")


class WalkerSheets(SkinSheets):
    """Fabric, print and bladder."""

    fabric_mass: Annotated[float, In("kg/m²", at_least=0)] = key(
        0.25, "mass of the fabric and of a bladder, by area"
    )
    print_mass: Annotated[float, In("kg/m²", at_least=0)] = key(0.6, "mass of the print, by area")


class Feet(ContactTable):
    """Contact and friction."""

    feet: Annotated[str, OneOf(tuple(PHASES))] = key(
        "one-way", "feet with pads that slide forwards, or without"
    )
    pad_friction: Positive = key(
        0.2,
        "coefficient of friction of the pads that slide forwards; backwards it is that of "
        "all faces",
    )
    pad_length: Length = key(0.015, "length of a leg's end that carries pads")


class WalkerResultTable(ResultTable):
    """What is simulated of the print."""

    gait_steps: Count | None = key(
        8,
        "number of equilibria in each phase of the gait; none leaves the gait out",
        free=True,
    )


class WalkerScene(ActuatorScene):
    """The walker.

    Raises:
        ParameterError: As in `ActuatorScene`, or a part of a leg is longer than the leg.
    """

    target: LegTarget = LegTarget()
    skin: WalkerSizes = WalkerSizes()
    material: WalkerSheets = WalkerSheets(seams="hinged")
    pressure: PressureTable = PressureTable(pressure=20e3)
    contact: Feet = Feet(friction=0.8)
    objective: LegWeights = LegWeights()
    design: DesignTable = DesignTable(levels=1, filter_radius=2.75e-3)
    results: WalkerResultTable = WalkerResultTable()

    KIND: ClassVar = "walker"
    FEW: ClassVar = (
        "motion", "aim", "leg_length", "leg_width", "body_radius", "pressure", "feet", "friction",
        "edge_length", "seed",
    )  # fmt: skip
    COARSE: ClassVar = {
        "edge_length": 14 / 9,
        "filter_radius": 86 / 55,
        "iterations": 2 / 3,
        "constrained_iterations": 3 / 4,
    }

    POSE_TABLES: ClassVar = ("target", "pressure")  # the gait alone knows contact
    OUTLINE: ClassVar = {
        "arm_length": "leg_length",
        "arm_width": "leg_width",
        "corner_radius": "fillet",
        "arms": "legs",
    }
    NEEDS: ClassVar = {
        "reach": ("motion", ("crawl",)),
        **dict.fromkeys(("pad_friction", "pad_length"), ("feet", ("one-way",))),
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        pads = ("pad_length",) if self.contact.feet == "one-way" else ()
        for name in ("foot_length", "bent_length", *pads):
            length, leg = self.value(name), self.skin.leg_length
            if length is not None and length > leg:
                raise ParameterError(
                    f"{name} = {length} m must be at most leg_length = {leg} m. Give a shorter "
                    "one, or longer legs.",
                    name,
                )

    def coarse_values(self) -> dict[str, Any]:
        """Return the values of the quick variant by key, with feet that are printed."""
        # T hardly depends on the print in the feet: few steps leave holes and blobs there.
        feet = self.skin.foot_length or self.skin.leg_length / 4
        return {**super().coarse_values(), "foot_length": feet}

    @property
    def radius(self) -> float:
        """Radius in m of the inflated leg: two flat layers become round."""
        return self.skin.leg_width / np.pi

    @property
    def coarsest_edge(self) -> float:
        """Longest edge length in m of a useful mesh: six edges across a leg."""
        return self.skin.leg_width / 6

    def groups_of(self, skin: Inflated) -> Iterator[Group]:
        """Yield the dimensionless groups of the scene."""
        yield from super().groups_of(skin)
        asked, sizes = self.target, self.skin
        yield skin.slenderness("leg_length", sizes.leg_length)
        yield angle_group("angle", self.leg_angle)
        if asked.motion == "crawl":
            yield skin.reach("reach", abs(asked.reach) / sizes.body_radius)

    @property
    def star(self) -> Star:
        """Outline of the robot."""
        sizes, angle = self.skin, np.pi / 4
        return Star(4, sizes.leg_length, sizes.leg_width, sizes.body_radius, sizes.fillet, angle)

    @property
    def leg_angle(self) -> float:
        """Angle in degrees by which legs are to bend."""
        return ANGLE[self.target.motion] if self.target.angle is None else self.target.angle

    @property
    def legs(self) -> list[Leg]:
        """The four legs, that of the quarter first."""
        star = self.star
        return [Leg((*map(float, d), 0.0), DOWN, star.root) for d in star.directions]

    def reach(self, points: Floats) -> Floats:
        """Return how far points in the plane, (n, 2), lie out along the nearest leg, (n,), in m."""
        return (points @ self.star.directions.T).max(axis=1)

    def contact_on(self, pattern: Pattern, height: float) -> Contact:
        """Return ground at a height in m, friction and pads, and the contact of layers."""
        feet, pads = self.contact, None
        if feet.feet == "one-way":
            on_feet = self.reach(pattern.points[:, :2]) > self.star.reach - feet.pad_length
            backward = feet.pad_friction if feet.friction is None else feet.friction
            pads = Pads(on_feet, (1.0, 0.0, 0.0), feet.pad_friction, backward)
        ground, distance = Ground((0.0, 0.0, height)), feet.contact_distance
        return Contact(ground, friction=feet.friction, pads=pads, distance=distance)

    def case(self, comm: MPI.Comm, level: Level) -> Case:
        """Return a quarter of the robot and its target (collective)."""
        assert level.edge_length is not None
        star, leg, asked = self.star, self.legs[0], self.target
        pattern = walker(comm, level.edge_length, star, planes=(0, 1))
        directions = star.directions[:1]
        deform = stand(
            np.radians(self.leg_angle), asked.bent_length, directions=directions, root=star.root
        )
        target = deform(pattern.points)
        if asked.motion == "crawl":
            target = target + [asked.reach, 0, 0]
        sections, metric = leg.sections(pattern, self.objective), leg.angle_metric(self.leg_angle)
        centroids, apart = plane_centroids(pattern), None
        if asked.aim == "stride":
            sections, target = self._stride(sections, target)
            metric = self._foot_metric(leg)
            if not self.pressure.hold_pressure:  # of both chambers, for the gait
                in_leg = centroids @ directions[0] > star.root
                apart = Chambers(("body", "leg"), in_leg.astype(np.int64))
        foot, passive = self.skin.foot_length, None
        if foot is not None:
            passive = np.where(self.reach(centroids) > star.reach - foot, 1.0, np.nan)
        return replace(
            self.loaded(pattern, target, rest_on_body(pattern, star.body_radius, (0, 1)), (0, 1)),
            parts=[sections],
            metrics=(metric,),
            passive=passive,
            # The top is to stretch; without this hint the start does not tell up from down.
            start=np.where(pattern.panel == pattern.panel_index("top"), 0.35, 0.65),
            chambers=apart,
        )

    def _stride(self, sections: CrossSections, target: Floats) -> tuple[CrossSections, Floats]:
        """Return the cross-sections whose objective is the stride of the gait, and their target.

        An emptied leg lies flat whatever its print, so that the stride of feet that do not slide
        backwards is twice the way along x by which a full leg draws its foot in. The foot, the last
        cross-section, is to come as near to the plane between front and rear legs as these are
        wide. The shape counts less: it tells down from up.
        """
        positions = SHAPE_IN_STRIDE * sections.position_weights
        positions[-1, 0] = 1.0
        foot, target = sections.labels == len(positions) - 1, target.copy()
        target[foot, 0] += self.skin.leg_width / 2 - target[foot, 0].mean()
        weights = SHAPE_IN_STRIDE * sections.orientation_weights
        return CrossSections(sections.labels, positions, weights), target

    def _foot_metric(self, leg: Leg) -> Metric:
        """Return the distance in mm of the foot from the plane between front and rear legs."""
        count = self.objective.cross_sections

        def measure(pattern: Pattern, positions: Floats) -> float:
            foot = leg.labels(pattern, count) == count - 1
            return 1e3 * float(positions[foot, 0].mean())

        return Metric("foot", "mm", 1e3 * self.skin.leg_width / 2, measure)

    def require_trial(self) -> None:
        """Check that the library of contact is there, which the gait needs."""
        if self.results.gait_steps is not None:
            ipctk()

    @property
    def trial_size(self) -> tuple[int, float]:
        """Equilibria of a cycle, and the half of the robot over the quarter that is designed."""
        steps = self.results.gait_steps
        return (0 if steps is None else 1 + steps * len(PHASES[self.contact.feet])), 2.0

    def trial(
        self,
        comm: MPI.Comm,
        output: Path,
        made: SkinDesign,
        other: OnOtherMesh | None = None,
    ) -> Walk | None:
        """Let the printed robot walk on the ground through its gait (collective)."""
        if self.results.gait_steps is None:
            return None
        found = self._walk(comm, made.printed.evaluation or made.design.final)
        if found.complete:
            intervals = trial_intervals(comm, self, found.figures, other, found.uncertain)
            found = replace(found, intervals=intervals)
        if found.points:
            write_gait(comm, output, found, made.printed.regions)
        return found

    def trial_figures(self, comm: MPI.Comm, made: Evaluation[Equilibrium]) -> tuple[Figure, ...]:
        """Return stride, slip and smallest distance of a robot with this print (collective)."""
        found = self._walk(comm, made)
        return found.figures if found.complete else ()

    def _walk(self, comm: MPI.Comm, shown: Evaluation[Equilibrium]) -> Walk:
        """Return what the robot does whose quarter has the print of a simulation (collective)."""
        assert self.results.gait_steps is not None
        full = [shown.equilibrium.pressures[k] for k in (0, -1, -1)]
        phases = PHASES[self.contact.feet].astype(np.float64)
        gait = Gait(CHAMBERS, phases, self.results.gait_steps)
        # The triangles and vertices of the half come first, as in the whole that is printed.
        skin = shown.problem.skin
        quarter = skin.gather_cells(shown.projected)
        half = mirrored(skin.pattern, (0,))
        density, problem = half.at_cells(quarter), shown.problem
        assert isinstance(problem, ShapeDesign)
        quadratic = problem.case.quadratic
        quadratic = None if quadratic is None else quadratic[half.cell]
        return self.follow(comm, gait, half.pattern, density, full, quadratic)

    def follow(
        self,
        comm: MPI.Comm,
        gait: Gait,
        half: Pattern,
        density: Floats,
        pressures: Sequence[float],
        quadratic: Bools | None = None,
    ) -> Walk:
        """Simulate half of a robot on the ground through one cycle of a gait (collective).

        It begins flat on the ground, and fills what the end of the last phase has filled. The other
        half is its mirror image.

        Args:
            half: Half of the robot, at y ≥ 0.
            density: Printed part of each triangle of the half, (t,).
            pressures: Full pressure of each chamber in Pa, (3,).
            quadratic: As of `Case`.
        """
        skin, supports, sheets = sew(comm, half), symmetry_plane(half, 1), self.material
        sizes = self.contact_on(half, 0.0).sizes(sheets.composite)
        start, height = flat_on_ground(comm, half, supports, sizes)
        solver = EquilibriumSolver(
            skin,
            sheets.composite,
            supports,
            chambers=chambers(half, self.star),
            weight=Weight(sheets.fabric_mass, sheets.fabric_mass + sheets.print_mass),
            contact=self.contact_on(half, height),
            quadratic=quadratic,
        )
        legs = [
            leg.angle_metric(self.leg_angle, name=f"leg_{k}")
            for k, leg in enumerate(self.legs)
            if self.star.directions[k, 1] > 0
        ]
        levels = [[*map(float, row)] for row in np.asarray(pressures) * gait.pressure_fractions]
        points, failure = until_failure(
            trace(solver, density[skin.owned_cells], levels, legs, start[skin.owned_vertices])
        )
        reach, whole = sizes.thickness / 2 + sizes.distance, mirrored(half, (1,))
        return replace(
            walk_of(gait, points, whole, self.star.directions, height, reach),
            pressures=tuple(pressures),
            failure=failure,
            measured=MEASURED_STRIDE if self.target.motion == "crawl" else None,
        )


def chambers(pattern: Pattern, star: Star) -> Chambers:
    """Return three chambers: the body, the legs at x > 0, and those at x < 0."""
    centroids = plane_centroids(pattern)
    leg = (centroids @ star.directions.T > star.root).any(axis=1)
    return Chambers(CHAMBERS, np.where(leg, np.where(centroids[:, 0] > 0, 1, 2), 0))
