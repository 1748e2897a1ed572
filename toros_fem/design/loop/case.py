"""What a shape design takes: a skin, what acts on it, and the shape that it should take."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from mpi4py import MPI
from shapely.geometry.base import BaseGeometry

from toros_fem.base.validation import Bools, Floats
from toros_fem.design.loop.physics import Bounds, Pressure
from toros_fem.materials.sheet import Composite
from toros_fem.measures.metrics import Metric, distance
from toros_fem.measures.miss import MirroredObjective
from toros_fem.measures.shape import (
    Nodes,
    Objective,
    Part,
    ShapePart,
    SumObjective,
    checked_target,
    require_objective,
)
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.dead_loads import carried_force
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.mechanics.terms.loads import Weight
from toros_fem.meshes.border_mesh import bordered
from toros_fem.meshes.pattern import Mirrored, Pattern, mirrored
from toros_fem.meshes.skin import Skin
from toros_fem.meshes.transfer import OtherMesh, make_transfer, refine

if TYPE_CHECKING:
    from toros_fem.design.loop.blocked import Blocked
    from toros_fem.mechanics.contact.contact import Contact

# Weight of ln p in T: one per cent of the pressure is worth as much as a change of the miss from
# 2.2 to 2.25 % of the skin's length. Ten times less drifts to much print under much pressure.
PRESSURE_WEIGHT = 1e-3


@dataclass(frozen=True, eq=False)
class Case:
    """A skin, what acts on it, and the shape that it should take.

    `ShapeDesign` checks that all fit each other.

    Attributes:
        pattern: Panels and seams.
        target: Target positions of all assembled vertices, (n, 3), in m, or a map from assembled
            positions to them, `meshes.bend` for instance.
        supports: Fixed components and directions.
        pressure: In Pa, of all chambers or of each; where a designed one starts.
        pressure_bounds: Least and largest pressure in Pa, of all chambers or of each; None
            prescribes it.
        pressure_weight: As of `DesignProblem`; None prefers no pressure to another. The default
            suits parts of the order of half the square of a miss over the skin's size.
        composite: Fabric, reinforcement and stretch bounds; None takes those of the paper.
        parts: Make the parts of the objective, which is their sum: `ShapePart`, or a function of
            the vertices of the sewn skin and their target positions.
        metrics: Numbers that the design is judged by, the most important first; None takes the
            root mean square distance from the target in mm.
        printed_panels: Names of panels that are printed all over.
        passive: Prescribed density of all triangles, (t,), NaN where it is designed; the printed
            panels come on top.
        start: Density of all triangles to start from, (t,), within [0.1, 0.9]: noise of 0.1 is
            added. None starts from 0.5.
        symmetry: Axes of the planes that the pattern is cut at, as of `meshes.mirrored`: filters,
            pictures and prints see the whole skin.
        parts_of_whole: Whether the parts of the objective are those of the whole skin. What they
            hold then has an entry for each vertex of `whole`.
        chambers: Pressure chambers; None for one.
        weight: The skin's own weight; None leaves it out.
        contact: What the skin cannot pass through; None for nothing.
        force: Dead forces in N on all assembled vertices, (n, 3).
        quadratic: Whether the displacement in the plane of each triangle, (t,), is quadratic, as it
            is in the lines of a print; None where none is.
        blocked: Of a further pose: a panel that is held, and whose push is the goal in the place of
            target, parts and metrics; None without one.
        poses: Further poses of the same skin and print: cases on the same pattern with pressures,
            loads, supports and targets of their own. Pressures of poses are prescribed. The shape
            part of T is the mean over all poses, weighted by `importance`.
        importance: Weight of this pose.
        name: Name of a further pose, an identifier, before the names of its metrics; None takes
            "pose_2" and so on.
    """

    pattern: Pattern
    target: Floats | Callable[[Floats], Floats]
    supports: Supports
    pressure: Pressure
    pressure_bounds: Bounds | Sequence[Bounds | None] | None = None
    pressure_weight: float | None = PRESSURE_WEIGHT
    composite: Composite | None = None
    parts: Sequence[Part] = (ShapePart(),)
    metrics: Sequence[Metric] | None = None
    printed_panels: Sequence[str] = ()
    passive: Floats | None = None
    start: Floats | None = None
    symmetry: Sequence[int] = ()
    parts_of_whole: bool = False
    chambers: Chambers | None = None
    weight: Weight | None = None
    contact: Contact | None = None
    force: Floats | None = None
    quadratic: Bools | None = None
    blocked: Blocked | None = None
    poses: Sequence[Case] = ()
    importance: float = 1.0
    name: str | None = None

    @cached_property
    def whole(self) -> Mirrored:
        """The skin with its mirror images; itself where it is not cut."""
        return mirrored(self.pattern, self.symmetry)

    @property
    def prescribed(self) -> Floats | None:
        """Prescribed density of all triangles, (t,), with printed panels; None without any."""
        if self.passive is None and not self.printed_panels:
            return None
        given = np.full(len(self.pattern.panel), np.nan)
        if self.passive is not None:
            given[:] = self.passive
        for name in self.printed_panels:
            given[self.pattern.cells_of(name)] = 1.0
        return given

    @property
    def goal(self) -> Floats:
        """Target positions of all assembled vertices, (n, 3), in m."""
        target = self.target
        return target(self.pattern.points) if callable(target) else target

    @property
    def judged(self) -> tuple[Metric, ...]:
        """The metrics; where there are none given, the distance from the target."""
        if self.metrics is not None:
            return tuple(self.metrics)
        target = self.target

        def measure(pattern: Pattern, positions: Floats) -> float:
            # A map is known on other meshes too, as those of prints.
            goal = target(pattern.points) if callable(target) else np.asarray(target)
            return 1e3 * distance(pattern, positions, goal)

        length = 1e3 * float(np.ptp(self.whole.pattern.points, axis=0).max())
        return (Metric("distance", "mm", 0.0, measure, length),)

    @property
    def asks(self) -> Floats:
        """What is asked for: `goal`, or the force in N of a blocked panel, ()."""
        return self.goal if self.blocked is None else np.array(self.blocked.force)

    def asking(self, goal: Floats) -> Case:
        """Return the same pose with another goal, as of `asks`."""
        if self.blocked is None:
            return replace(self, target=goal)
        return replace(self, blocked=replace(self.blocked, force=float(goal)))

    def differs_in_pressure_alone(self, other: Case) -> bool:
        """Return whether another pose is on the same path over the pressure: but for its target."""
        force, supports = self._acting, self.supports
        return (
            other.blocked is None
            and self.chambers is None
            and np.array_equal(force, other._acting)
            and np.array_equal(supports.fixed, other.supports.fixed)
            and supports.displacement is other.supports.displacement
            and (self.weight, self.contact) == (other.weight, other.contact)
        )

    @property
    def _acting(self) -> Floats:
        """Dead forces in N on all assembled vertices, (n, 3)."""
        return np.zeros_like(self.pattern.points) if self.force is None else np.asarray(self.force)

    def objective(self, skin: Skin) -> Objective:
        """Return the objective on the sewn skin, the sum of its parts (collective).

        Raises:
            ParameterError: The target does not fit the skin. A part is no objective.
        """
        goal = checked_target(skin, self.goal)
        whole = self.whole
        if whole.parts == 1 or not self.parts_of_whole:
            return self._sum(skin, goal)
        goal_of_whole = whole.at_vertices(goal)
        return MirroredObjective(skin, whole, lambda nodes: self._sum(nodes, goal_of_whole))

    def following(
        self,
        comm: MPI.Comm,
        regions: Sequence[BaseGeometry],
        *,
        printed: bool = True,
        coarser: float = 1.0,
    ) -> Case:
        """Return the same case on a mesh whose edges are the borders of a print (collective).

        Each triangle is printed or not, by its prescribed density. In print its displacement is
        quadratic, but in panels that are printed all over.

        Args:
            comm: Communicator.
            regions: Print on each panel of the pattern, polygons in m.
            printed: Whether this is the print; if not, densities are designed on its mesh.
            coarser: As of `bordered`.

        Raises:
            PanelError: The number of regions is not that of the panels.
            PatternError: Borders of the print meet each other.
        """
        finer, inside = bordered(comm, self.pattern, regions, coarser=coarser)
        made, panel = self.on_finer(finer), finer.pattern.panel
        if not printed:
            return made
        bare = np.bincount(panel, ~inside, minlength=len(regions)) > 0
        given, quadratic = inside.astype(np.float64), inside & bare[panel]
        return replace(made, passive=given, start=None, quadratic=quadratic)

    def on(self, pattern: Pattern) -> Case:
        """Return the same case on the same triangles, whose vertices have moved.

        A target that is a map is evaluated again, one of positions is interpolated; all else
        belongs to vertices and triangles, which keep their numbers.

        Args:
            pattern: The pattern after the move, by `with_flat_points` for instance.
        """
        target = self.target
        if not callable(target):
            moved = np.any(pattern.points != self.pattern.points, axis=1)
            there = make_transfer(self.pattern, pattern).positions(np.asarray(target))
            target = np.where(moved[:, None], there, target)
        poses = [pose.on(pattern) for pose in self.poses]
        return replace(self, pattern=pattern, target=target, poses=poses)

    def refined(self) -> Case:
        """Return the same case on the refined pattern.

        Each triangle is divided into four. A target that is a map is evaluated again, one of
        positions is interpolated; supports, chambers, forces and densities are carried over. A part
        that has a method `refined`, as `ShapePart` and `CrossSections` have, is asked for the one
        on the refined pattern; others are taken as they are.

        Raises:
            ParameterError: The sheet is moulded in its assembled shape.
        """
        if self.composite is not None:
            self.composite.require_refinable()
        return self.on_finer(refine(self.pattern))

    def on_finer(self, finer: OtherMesh) -> Case:
        """Return the same case on a finer mesh of its pattern, as `refined` does."""
        target = self.target
        if not callable(target):
            there = make_transfer(self.pattern, finer.pattern)
            target = there.positions(np.asarray(target))
        passive, start, force, of_parts = self.passive, self.start, self.force, finer
        if len(self.symmetry) and self.parts_of_whole:
            of_parts = self.whole.refined(finer, self.symmetry)
        return replace(
            self,
            pattern=finer.pattern,
            target=target,
            supports=self.supports.refined(finer),
            parts=[p.refined(of_parts) if hasattr(p, "refined") else p for p in self.parts],
            passive=None if passive is None else np.asarray(passive)[finer.cell],
            start=None if start is None else np.asarray(start)[finer.cell],
            chambers=self.chambers and self.chambers.refined(finer),
            quadratic=None if self.quadratic is None else self.quadratic[finer.cell],
            force=None if force is None else carried_force(finer, np.asarray(force)),
            poses=[pose.on_finer(finer) for pose in self.poses],
        )

    def _sum(self, nodes: Nodes, target: Floats) -> Objective:
        made = [part(nodes, target) for part in self.parts]
        for one in made:
            require_objective("parts", one)
        return made[0] if len(made) == 1 else SumObjective(*made)
