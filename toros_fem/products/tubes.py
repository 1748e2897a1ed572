"""Capped tubes that bend, shorten, twist, or bend and twist at once (paper Fig. 8)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Annotated, ClassVar

import numpy as np
from mpi4py import MPI

from toros_fem.base.keys import Flag, In, Length, OneOf, Place, Positive, Table, key
from toros_fem.base.validation import Floats
from toros_fem.design.lines.field import LineOptions
from toros_fem.design.loop.blocked import Blocked
from toros_fem.design.loop.case import Case
from toros_fem.materials.sheet import Bending
from toros_fem.measures.cross_sections import label_cross_sections
from toros_fem.measures.metrics import (
    Measurement,
    Metric,
    MetricFunction,
    bend_angle,
    length_ratio,
    shortening,
    twist_angle,
)
from toros_fem.measures.shape import Part
from toros_fem.mechanics.paths.rigid_panels import pose_of_panel
from toros_fem.mechanics.skin.supports import Supports, clamp, symmetry_planes
from toros_fem.mechanics.terms.loads import GRAVITY
from toros_fem.meshes.pattern import Pattern, mirrored, require_symmetric_map
from toros_fem.meshes.sheets import BASE, TIP, WALL, cylinder
from toros_fem.meshes.targets import Deformer, bend, compose, contract, twist
from toros_fem.products.actuators.scene import ActuatorScene, Level
from toros_fem.products.common.plausibility import Group, Inflated, bend_strain
from toros_fem.products.common.tables import (
    BendAngle,
    DesignTable,
    LineTable,
    PressureTable,
    SectionWeights,
    Shortening,
    TipWeights,
    TwistAngle,
    bend_key,
    shortening_key,
    twist_key,
)

# Number of edges around the tube on the coarsest of several meshes: from one with 11 the bend came
# out with lines twice as wide, and T half as large again. The same along a tube that is short.
LEAST_AROUND, LEAST_ALONG = 18, 6
# A length that is off by so much counts like a twist or an angle that is not there at all.
LENGTH_SCALE = 0.2
# Width of the helices over that asked, if the length is kept: thin ones hold the axial lines less.
HELICES = 0.78
# Number of lines along the tube, if the length is kept. It bends about a single one, and about two
# in a plane; more of them hold the helices more.
ALONG = 3
# Components of a blocked tip's pose that are free: it slides along z, and turns about y.
SLIDES_AND_TURNS = (False, False, True, False, True, False)


class Tube(Table):
    """Sizes and mesh."""

    length: Length = key(0.15, "length of the tube")
    diameter: Length = key(0.02, "diameter of the tube")
    edge_length: Length = key(1.4e-3, "edge length of the mesh")
    mesh: Annotated[str, OneOf(("unstructured", "structured"))] = key(
        "unstructured", "mesh of the wall"
    )

    def pattern(self, comm: MPI.Comm, edge: float, planes: tuple[int, ...]) -> Pattern:
        """Return the tube with edges of a length in m, cut at planes (collective)."""
        return cylinder(comm, self.length, self.diameter, edge, mesh=self.mesh, planes=planes)


class SymmetricTube(Tube):
    """Sizes and mesh."""

    whole: Flag = key(False, "simulate the whole tube and not its part between the planes")

    @property
    def planes(self) -> tuple[int, ...]:
        """Planes of symmetry that the tube is cut at: y = 0, or none."""
        return () if self.whole else (1,)


class TubeScene(ActuatorScene):
    """A designed tube whose shape counts."""

    skin: Tube = Tube()
    objective: TipWeights = TipWeights()

    COARSE: ClassVar = {
        "edge_length": 2.0,
        "filter_radius": 88 / 43,
        "iterations": 2 / 3,
        "constrained_iterations": 3 / 4,
        "relaxed_edge_length": 5 / 4,
        "laid_width": 4 / 3,
        "second_laid_width": 4 / 3,
        "print_edge_length": 10 / 7,
        "curve_steps": 1 / 2,
    }

    @property
    def coarsest_edge(self) -> float:
        """Longest edge length in m of a useful mesh: eighteen edges around, and some along."""
        around = float(np.pi * self.skin.diameter / LEAST_AROUND)
        return min(around, self.skin.length / LEAST_ALONG)

    @property
    def radius(self) -> float:
        """Radius in m of the tube."""
        return self.skin.diameter / 2

    def groups_of(self, skin: Inflated) -> Iterator[Group]:
        """Yield the dimensionless groups of the scene."""
        yield skin.slenderness("length", self.skin.length)
        yield Group("size", "length", self.skin.length)
        yield from super().groups_of(skin)

    def part(self, pattern: Pattern) -> Part:
        """Return the objective of a whole tube: all its vertices count, those of the tip more."""
        plate = pattern.vertices_of(TIP)
        # The ring and not the plate, which bulges.
        ring = np.intersect1d(plate, pattern.vertices_of(WALL))
        return self.objective.shape_part(pattern, plate, ring, self.skin.diameter / 2)

    def tube_case(
        self,
        comm: MPI.Comm,
        level: Level,
        deform: Deformer,
        metrics: Sequence[Metric],
        planes: tuple[int, ...] = (),
    ) -> Case:
        """Return a tube along z whose base is held and whose caps are printed (collective).

        Args:
            deform: Maps assembled to target positions.
            metrics: Numbers that the design is judged by, as functions of the whole tube. The
                `length_metric` is watched too if it is not among them.
            planes: Symmetry planes of the target that the tube is cut at, as of `meshes.cylinder`.
                Objective and metrics are those of the whole tube.

        Raises:
            ParameterError: A size is too large for the tube, or the knit is not symmetric. The
                target is not symmetric.
        """
        assert level.edge_length is not None
        pattern = self.skin.pattern(comm, level.edge_length, planes)
        require_symmetric_map(pattern.points, planes, deform)
        supports = _supports(pattern, planes, self.material.seams)
        length = length_metric(None)
        watched = [] if length.key in {metric.key for metric in metrics} else [length]
        return replace(
            self.loaded(pattern, deform(pattern.points), supports, planes),
            parts=[self.part(mirrored(pattern, planes).pattern)],
            metrics=tuple(metric.of_whole(planes) for metric in (*metrics, *watched)),
            passive=_printed_caps(pattern),
            parts_of_whole=True,
        )


class SectionTubeScene(TubeScene):
    """A designed tube that may swell freely."""

    objective: SectionWeights = SectionWeights()
    # From noise, densities of these tubes end in traps.
    design: DesignTable = DesignTable(start="relaxed", corrections=8)

    def part(self, pattern: Pattern) -> Part:
        """Return the objective of a whole tube: positions and orientations of its cross-sections.

        With an axial weight of 0 it may also lengthen and shorten. The position of the tip counts
        `tip_weight` times as much as the mean over all other cross-sections.
        """
        wall, count = pattern.vertices_of(WALL), self.objective.cross_sections
        labels = label_cross_sections(pattern, wall, (0, 0, 1), count)
        return self.objective.sections_part(pattern, labels, 2)


def bend_metric(target: float) -> Metric:
    """Return the bend angle of a tube's tip in degrees, by `bend_angle`."""
    return Metric("angle", "deg", target, _in_degrees(bend_angle))


def twist_metric(target: float | None) -> Metric:
    """Return the twist of a tube's tip in degrees, by `measures.twist_angle`; None: no target."""
    return Metric("twist", "deg", target, _in_degrees(twist_angle))


def shortening_metric(target: float) -> Metric:
    """Return the shortening of a tube in per cent, by `measures.shortening`."""
    return Metric("shortening", "percent", target, lambda of, x: 100 * shortening(of, x))


def length_metric(target: float | None) -> Metric:
    """Return the distance of a tube's ends over the assembled one; None: no target."""
    return Metric("length", "ratio", target, length_ratio, LENGTH_SCALE)


def plain_tube(
    comm: MPI.Comm, sizes: Tube, planes: tuple[int, ...] = (), *, seams: str = Bending.seams
) -> tuple[Pattern, Supports, Floats]:
    """Return a tube with a plain wall: pattern, supports, and density of all triangles, (t,).

    Args:
        planes: Symmetry planes that it is cut at, as of `meshes.cylinder`.
        seams: How seams carry moments, as of `Bending`.

    Raises:
        ParameterError: A size is too large for the tube.
    """
    pattern = sizes.pattern(comm, sizes.edge_length, planes)
    density = np.nan_to_num(_printed_caps(pattern), nan=0.0)
    return pattern, _supports(pattern, planes, seams), density


def plain_planes(seams: str) -> tuple[int, ...]:
    """Return the symmetry planes of a tube without a pattern; seams as of `Bending`."""
    return (0, 1) if seams == "continuous" else (1,)


def _in_degrees(measure: Callable[[Pattern, Floats], float]) -> MetricFunction:
    return lambda pattern, positions: float(np.degrees(measure(pattern, positions)))


def _supports(pattern: Pattern, planes: tuple[int, ...], seams: str) -> Supports:
    """Return supports at the base and in the planes."""
    hinged = seams != "continuous"
    return clamp(pattern, [BASE]) | symmetry_planes(pattern, planes, hinged=hinged)


def _printed_caps(pattern: Pattern) -> Floats:
    """Return prescribed densities: end plates printed all over, the wall designed."""
    return np.where(pattern.panel == pattern.panel_index(WALL), np.nan, 1.0)


# ------------------------------------------------------------------------------------------- bend


class BendTarget(Table):
    """Shape that is asked for."""

    angle: BendAngle = bend_key(180.0)
    neutral: Place = key(
        0.01, "distance of the line that keeps its length from the axis, towards the inner side"
    )

    def strain(self, radius: float, length: float) -> float:
        """Return the strain of the outer side of a tube of a radius and a length in m."""
        return bend_strain(self.angle, length, radius + self.neutral)

    def groups(self, skin: Inflated, length: float) -> Iterator[Group]:
        """Yield the groups of the bend of a tube of a length in m."""
        yield from skin.bend("angle", self.angle, length, skin.radius + self.neutral)


class TipLoad(Table):
    """What acts on the tip. The tube lies and x points up, so that a bend lifts it."""

    hung_mass: Annotated[float, In("kg", above=0)] | None = key(
        None, "mass that hangs from the tip; none for none"
    )
    blocked_angle: Annotated[float, In("deg", above=0, at_most=180)] | None = key(
        None,
        "of a further pose: angle of the bend that takes the tip where it is held along x; it may "
        "slide along z and turn; none leaves it free",
    )
    blocked_force: Annotated[float, In("N", above=0)] = key(
        1.0, "least force along x with which the tip shall push where it is held"
    )

    NEEDS: ClassVar = {"blocked_force": ("blocked_angle", ())}

    def force(self, pattern: Pattern, parts: int) -> Floats | None:
        """Return dead forces in N on the vertices of one of some equal parts, (n, 3)."""
        if self.hung_mass is None:
            return None
        tip, force = pattern.vertices_of(TIP), np.zeros_like(pattern.points)
        areas = pattern.vertex_areas[tip]
        force[tip, 0] = -self.hung_mass * GRAVITY / parts * areas / areas.sum()
        return force

    def blocked(self, pattern: Pattern, neutral: float) -> Blocked | None:
        """Return the blocked tip, whose push is the goal; None where it is free."""
        if self.blocked_angle is None:
            return None
        length = float(np.ptp(pattern.points[:, 2]))
        bent = bend(np.radians(self.blocked_angle), length, neutral=neutral)(pattern.points)
        pose = pose_of_panel(pattern, TIP, bent)
        return Blocked(TIP, tuple(pose), (1.0, 0.0, 0.0), self.blocked_force, SLIDES_AND_TURNS)


class BendScene(TubeScene):
    """The bending tube.

    The tube lies along z and its end z = 0 is clamped. Its caps are printed, its wall is designed.
    The target bends towards +x, and the inner side of the bend keeps its length. The end plate at
    the tip counts as much as all the rest. The target is symmetric about y = 0, so half the tube is
    designed.
    """

    target: BendTarget = BendTarget()
    load: TipLoad = TipLoad()
    skin: SymmetricTube = SymmetricTube()
    # With a perimeter: fewer islands, a shorter border, and nearer to the target
    # (docs/optimisation.md).
    design: DesignTable = DesignTable(perimeter_weight=1e-4)

    KIND: ClassVar = "bend"
    FEW: ClassVar = (
        "angle", "neutral", "length", "diameter", "edge_length", "pressure", "hold_pressure",
        "seed",
    )  # fmt: skip
    MEASURED: ClassVar = (Measurement("angle_deg", 180.0, 13e3, 150.0, "paper, measured"),)

    @property
    def needed_strain(self) -> float:
        """Strain of the outer side of the bend."""
        return self.target.strain(self.radius, self.skin.length)

    def groups_of(self, skin: Inflated) -> Iterator[Group]:
        """Yield the dimensionless groups of the scene."""
        yield from super().groups_of(skin)
        yield from self.target.groups(skin, self.skin.length)

    def case(self, comm: MPI.Comm, level: Level) -> Case:
        """Return half the tube, or the whole, and its target."""
        asked = self.target
        deform = bend(np.radians(asked.angle), self.skin.length, neutral=asked.neutral)
        metrics = [bend_metric(asked.angle)]
        case = self.tube_case(comm, level, deform, metrics, self.skin.planes)
        return replace(
            case,
            force=self.load.force(case.pattern, case.whole.parts),
            blocked=self.load.blocked(case.pattern, asked.neutral),
        )


# --------------------------------------------------------------------------------- bend and twist


class BendTwistTarget(BendTarget):
    """Shape that is asked for."""

    twist: TwistAngle = twist_key(60.0)


class BendTwistScene(SectionTubeScene):
    """The tube that bends and twists.

    The positions and orientations of cross-sections and of the tip count; the skin may swell
    freely.
    """

    target: BendTwistTarget = BendTwistTarget(angle=90.0)
    # Many lines, also where few are asked for, and with room for other widths: of a few wide ones
    # each decides about the shape.
    lines: LineTable = LineTable(
        share_weight=1e-3, relaxed_iterations=60, least_share=0.012, spread=2.0
    )

    KIND: ClassVar = "bend-twist"
    COARSE: ClassVar = {**SectionTubeScene.COARSE, "laid_width": 1.0, "second_laid_width": 1.0}
    FEW: ClassVar = (
        "angle", "twist", "neutral", "length", "diameter", "edge_length", "pressure", "seed",
    )  # fmt: skip

    def groups_of(self, skin: Inflated) -> Iterator[Group]:
        """Yield the dimensionless groups of the scene."""
        yield from super().groups_of(skin)
        yield from self.target.groups(skin, self.skin.length)
        yield from skin.twist("twist", self.target.twist, self.skin.length)

    def case(self, comm: MPI.Comm, level: Level) -> Case:
        """Return the tube and its target."""
        asked, length = self.target, self.skin.length
        twisted = twist(np.radians(asked.twist), length)
        bent = bend(np.radians(asked.angle), length, neutral=asked.neutral)
        metrics = [bend_metric(asked.angle), twist_metric(asked.twist)]
        return self.tube_case(comm, level, compose(twisted, bent), metrics)


# --------------------------------------------------------------------------------------- contract


class ContractTarget(Table):
    """Shape that is asked for."""

    contraction: Shortening = shortening_key(8.0)


class ContractScene(SectionTubeScene):
    """The tube that shortens.

    It may swell freely. The positions of cross-sections and of the end plate along the axis count,
    and that all of them stay perpendicular to it. Half the tube is designed, by symmetry.
    """

    target: ContractTarget = ContractTarget()
    skin: SymmetricTube = SymmetricTube()
    objective: SectionWeights = SectionWeights(tip_weight=10.0)
    design: DesignTable = DesignTable(start="relaxed", corrections=8, iterations=90)

    KIND: ClassVar = "contract"
    FEW: ClassVar = ("contraction", "length", "diameter", "edge_length", "pressure", "seed")
    MEASURED: ClassVar = (Measurement("shortening_percent", 8.0, 10e3, 7.8, "paper, measured"),)

    def groups_of(self, skin: Inflated) -> Iterator[Group]:
        """Yield the dimensionless groups of the scene."""
        yield from super().groups_of(skin)
        yield from skin.shortening("contraction", self.target.contraction / 100)

    def case(self, comm: MPI.Comm, level: Level) -> Case:
        """Return half the tube, or the whole, and its target."""
        asked = self.target.contraction
        metrics = [shortening_metric(asked), twist_metric(None)]
        return self.tube_case(comm, level, contract(1 - asked / 100), metrics, self.skin.planes)


# ------------------------------------------------------------------------------------------ twist


class TwistTarget(Table):
    """Shape that is asked for."""

    twist: TwistAngle = twist_key(300.0)
    keep_length: Flag = key(
        False, "let the tube keep its length, or have the one given; else axial_weight is 0"
    )
    length_ratio: Positive = key(
        1.0, "length of the target over that of the tube, if the length is kept", metric="length"
    )


class TwistScene(SectionTubeScene):
    """The twisting tube.

    The end plate is to turn about the axis, and each cross-section in proportion to its height. The
    skin may swell freely. It may lengthen too, unless it is asked to keep its length.
    """

    target: TwistTarget = TwistTarget()
    pressure: PressureTable = PressureTable(pressure=15e3)
    objective: SectionWeights = SectionWeights(axial_weight=60.0)

    KIND: ClassVar = "twist"
    FEW: ClassVar = (
        "twist", "keep_length", "length", "diameter", "edge_length", "pressure", "seed",
    )  # fmt: skip
    NEEDS: ClassVar = dict.fromkeys(("length_ratio", "axial_weight"), ("keep_length", (True,)))
    MEASURED: ClassVar = (Measurement("twist_deg", 300.0, 15e3, 300.0, "paper, measured"),)

    @property
    def laid_widths(self) -> tuple[float, float]:
        """Width in m of the lines along either family."""
        first, second = self.lines.widths
        thinner = self.target.keep_length and self.lines.second_laid_width is None
        return first, HELICES * second if thinner else second

    @property
    def line_options(self) -> LineOptions:
        """Widths and limits of the lines that are laid."""
        options = super().line_options
        if not self.target.keep_length:
            return options
        return replace(options, spacings=(2 * np.pi * self.radius / ALONG, None))

    def groups_of(self, skin: Inflated) -> Iterator[Group]:
        """Yield the dimensionless groups of the scene."""
        yield from super().groups_of(skin)
        asked = self.target
        yield from skin.twist("twist", asked.twist, self.skin.length)
        if asked.keep_length and asked.length_ratio != 1:
            yield from skin.shortening("length_ratio", 1 - asked.length_ratio)

    def case(self, comm: MPI.Comm, level: Level) -> Case:
        """Return the tube and its target."""
        asked, length = self.target, self.skin.length
        deform, metrics = twist(np.radians(asked.twist), length), [twist_metric(asked.twist)]
        if not asked.keep_length:
            return self.updated(axial_weight=0.0).tube_case(comm, level, deform, metrics)
        deform = compose(deform, contract(asked.length_ratio))
        metrics.append(length_metric(asked.length_ratio))
        return self.tube_case(comm, level, deform, metrics)
