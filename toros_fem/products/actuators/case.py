"""Case of an actuator: its pattern, its target and the parts of the objective."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from mpi4py import MPI
from shapely.geometry.base import BaseGeometry

from toros_fem.base.array_types import Floats
from toros_fem.measures.alignment import AlignedObjective
from toros_fem.measures.cross_sections import CrossSectionObjective, CrossSections
from toros_fem.measures.gap import Body, GapObjective
from toros_fem.measures.metrics import Metric
from toros_fem.measures.mirrored import MirroredObjective
from toros_fem.measures.shape import Nodes, Objective, ShapeObjective, SumObjective, checked_target
from toros_fem.mechanics.contact.settings import Contact
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes.mirror import mirrored
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.skin import Skin
from toros_fem.meshes.snap import snapped
from toros_fem.meshes.transfer import make_transfer


@dataclass(frozen=True, eq=False)
class Touching:
    """A body that some vertices of the skin should touch, a term of the objective.

    Attributes:
        body: The body.
        weights: Weight of each assembled vertex's distance from its surface, (n,), ≥ 0.
        factor: Factor on this term of the objective.
    """

    body: Body
    weights: Floats
    factor: float


@dataclass(frozen=True, eq=False)
class ActuatorCase:
    """A pattern, its target shape and the objective; the numbers are in `ActuatorScene`.

    Attributes:
        pattern: Panels and seams.
        target: Target positions of all assembled vertices, (n, 3), in m.
        supports: Fixed components and directions.
        metrics: Numbers that the design is judged by, the most important first.
        passive: Prescribed density of all triangles, (t,), NaN where it is designed.
        weights, relative: Factors on each vertex in the objective, as of `ShapeObjective`. If both
            are None and there is another objective, that of the whole shape is left out.
        cross_sections: Cross-sections whose positions and orientations count; None for none.
        start: Density of all triangles to start from, (t,), within [0.1, 0.9]: noise of 0.1 is
            added. None starts from 0.5.
        symmetry: Axes of the planes that the pattern is cut at, as of `meshes.mirrored`: pictures
            and prints show the whole.
        objective_of_whole: Whether the objective is that of the whole skin. `weights`,
            `relative`, `cross_sections` and the weights of `touching` then have an entry for each
            vertex of `mirrored(pattern, symmetry)`.
        chambers: Pressure chambers; None for one.
        touching: A body to touch, in the objective; None for none.
        further: Makes a further term of the objective from the skin; None for none.
        contact: What the skin cannot pass through; None for nothing.
        aligned: Whether a rigid motion of the whole skin costs nothing.
    """

    pattern: Pattern
    target: Floats
    supports: Supports
    metrics: tuple[Metric, ...]
    passive: Floats | None = None
    weights: Floats | None = None
    relative: Floats | None = None
    cross_sections: CrossSections | None = None
    start: Floats | None = None
    symmetry: tuple[int, ...] = ()
    objective_of_whole: bool = False
    chambers: Chambers | None = None
    touching: Touching | None = None
    further: Callable[[Nodes], Objective] | None = None
    contact: Contact | None = None
    aligned: bool = False

    def objective(self, skin: Skin) -> Objective:
        """Return the objective on the sewn skin, the sum of all terms that are given."""
        if not (self.symmetry and self.objective_of_whole):
            return self._objective(skin, self.target)
        whole = mirrored(self.pattern, self.symmetry)
        target = whole.at_vertices(checked_target(skin, self.target))
        return MirroredObjective(skin, whole, lambda nodes: self._objective(nodes, target))

    def following(self, comm: MPI.Comm, regions: Sequence[BaseGeometry]) -> ActuatorCase:
        """Return the same case on a mesh whose edges follow polygons, by `snapped` (collective).

        Args:
            comm: Communicator.
            regions: Polygons on each panel of the pattern, in m.

        Raises:
            PanelError: The number of regions is not that of the panels.
        """
        return self.on(snapped(comm, self.pattern, regions))

    def on(self, pattern: Pattern) -> ActuatorCase:
        """Return the same case on the same triangles, whose vertices have moved.

        Args:
            pattern: The pattern after the move, by `with_flat_points` for instance.
        """
        # All else belongs to vertices and triangles, which keep their numbers.
        moved = np.any(pattern.points != self.pattern.points, axis=1)
        target = make_transfer(self.pattern, pattern).positions(self.target)
        target = np.where(moved[:, None], target, self.target)
        return replace(self, pattern=pattern, target=target)

    def _objective(self, nodes: Nodes, target: Floats) -> Objective:
        terms: list[Objective] = []
        if self.cross_sections is not None:
            terms.append(CrossSectionObjective(nodes, target, self.cross_sections))
        if self.touching is not None:
            t = self.touching
            terms.append(GapObjective(nodes, t.body, t.weights, t.factor))
        if self.further is not None:
            terms.append(self.further(nodes))
        if not terms or self.weights is not None or self.relative is not None:
            terms.append(ShapeObjective(nodes, target, self.weights, self.relative))
        found = terms[0] if len(terms) == 1 else SumObjective(*terms)
        return AlignedObjective(nodes, target, found) if self.aligned else found
