"""The force of a blocked panel as the goal of a pose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import (
    Floats,
    Ints,
    checked_bools,
    checked_floats,
    require_kind,
    require_positive,
)
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.physics import InflatedSkin, Pressure, Residuals, Saved
from toros_fem.design.loop.shape_design import ShapeDesign
from toros_fem.measures.metrics import Metric
from toros_fem.measures.shape import ShapePart
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.paths.rigid_panels import (
    pose_of_panel,
    solve_rigid,
    wrench,
    wrench_sensitivity,
)
from toros_fem.mechanics.skin.load import Load
from toros_fem.mechanics.skin.supports import (
    clamp,
    rigid_displacement,
    vertices_of_panels,
)
from toros_fem.meshes.pattern import Pattern


@dataclass(frozen=True)
class Blocked:
    """A panel that is held where it is put, and the force with which the skin shall push there.

    Attributes:
        panel: Name of the panel, which is as stiff as a plate.
        pose: Shift in m of the centre of its area and rotation vector in rad, (6,), from where it
            is assembled; where a free component begins.
        direction: Direction that the push is counted along, (3,), of any length.
        force: Least force in N of the whole skin that is asked for, > 0.
        free: Whether x, y, z of the centre and the turns about x, y, z are free, (6,).

    Raises:
        ParameterError: A value is out of its bounds.
    """

    panel: str
    pose: tuple[float, ...]
    direction: tuple[float, float, float]
    force: float
    free: tuple[bool, ...] = (False,) * 6

    def __post_init__(self) -> None:
        require_kind("panel", self.panel, str, "the name of a panel")
        checked_floats("pose", self.pose, "a finite pose (6,), in m and rad", (6,))
        checked_bools("free", np.asarray(self.free), "component of the pose", (6,))
        way = checked_floats("direction", self.direction, "a finite vector (3,)", (3,))
        require_positive(force=self.force)
        if not np.linalg.norm(way) > 0:
            raise ParameterError("direction = (0, 0, 0) is none; give the direction of the push.")

    @property
    def way(self) -> Floats:
        """Unit vector along the direction, (3,)."""
        return np.asarray(self.direction) / np.linalg.norm(self.direction)

    @property
    def design(self) -> type[BlockedDesign]:
        """The problem of a pose with it."""
        return BlockedDesign

    def displacement(self, pattern: Pattern, pose: Floats) -> Floats:
        """Return the displacement in m of all vertices, (n, 3), at a pose of the panel."""
        return rigid_displacement(pattern, [self.panel], pose[:3], pose[3:])

    def pose_at(self, pattern: Pattern, positions: Floats) -> Floats:
        """Return the pose of the panel at positions of all vertices, (n, 3), in m."""
        return pose_of_panel(pattern, self.panel, positions)


@dataclass(frozen=True, eq=False)
class ForceObjective:
    """Half the square of what the push lacks, over the force that is asked for."""

    blocked: Blocked
    parts: int

    def push(self, of_supports: Floats) -> float:
        """Return the push of the whole skin in N, from the wrench of the supports of a part."""
        return -self.parts * float(self.blocked.way @ of_supports[:3])

    def miss(self, of_supports: Floats) -> float:
        """Return what the push is over the force that is asked for, less 1; 0 beyond it."""
        return min(self.push(of_supports) / self.blocked.force - 1, 0.0)

    def forward(self, of_supports: Floats) -> float:
        """Return the objective of the wrench of the supports, (6,)."""
        return 0.5 * self.miss(of_supports) ** 2

    def backward(self, of_supports: Floats) -> Floats:
        """Return its derivative by the wrench, (6,)."""
        by_push = self.miss(of_supports) / self.blocked.force
        slope = -self.parts * self.blocked.way * by_push
        return np.concatenate([slope, np.zeros(3)])


@dataclass(frozen=True, eq=False)
class BlockedSkin(InflatedSkin):
    """Equilibrium of a skin under pressure with a blocked panel; it observes the panel's wrench."""

    blocked: Blocked = None  # type: ignore[assignment]  # follows fields with defaults

    def respond(
        self, projected: Floats, start: Any, pressure: Pressure | None, *, trial: bool
    ) -> Equilibrium:
        """Return the equilibrium of ρ̄, with the panel where it rests (collective)."""
        blocked, pattern = self.blocked, self.solver.skin.pattern
        pose, load = np.array(blocked.pose), self.load(pressure)
        if not any(blocked.free):
            load = replace(load, displacement=blocked.displacement(pattern, pose))
            # The force of a trial would be that of an incomplete equilibrium.
            return self.solver.solve(projected, load, start)
        positions = None
        if isinstance(start, Equilibrium):
            positions = self.solver.positions(start)
        elif start is not None and np.ndim(start) == 2:  # positions of the owned nodes
            positions = self.solver.skin.gather_vertices(start)
        if positions is not None:
            pose = np.where(blocked.free, blocked.pose_at(pattern, positions), pose)
        panels = [blocked.panel]
        found, _ = solve_rigid(
            self.solver, projected, load, panels, free=blocked.free, pose=pose, start=start
        )
        return found

    def observed(self, response: Equilibrium) -> Floats:
        """Return the wrench of the supports of the panel, (6,), in N and N m (collective)."""
        return wrench(self.solver, response, [self.blocked.panel])

    def pull_back(self, response: Equilibrium, by_observed: Floats) -> tuple[Floats, Floats | None]:
        """Return the gradient by ρ̄ from that by the wrench (collective)."""
        blocked = self.blocked
        panels = [blocked.panel]
        found = wrench_sensitivity(self.solver, response, panels, by_observed, free=blocked.free)
        return found, None

    def residuals(self, response: Equilibrium, objective: Any) -> Residuals:
        """Return none: pressures are prescribed."""
        return Residuals(lambda _: np.zeros(0), [], np.zeros((0, len(self.pressures))))

    def save(self, response: Equilibrium) -> Saved:
        """Return the unknowns by original index, the numbers, and how the panel is moved."""
        unknowns, numbers = self.solver.save(response)
        moved = response.load.displacement
        assert moved is not None
        return unknowns, {**numbers, "moved": moved[self._vertices].tolist()}

    @property
    def _vertices(self) -> Ints:
        return vertices_of_panels(self.solver.skin.pattern, [self.blocked.panel])

    def restore(
        self, projected: Floats, unknowns: Floats, numbers: Mapping[str, Any]
    ) -> Equilibrium:
        """Return the equilibrium, with its tangent factorised (collective)."""
        moved = np.zeros_like(self.solver.skin.pattern.points)
        moved[self._vertices] = numbers["moved"]
        load = Load(0.0, self.force, moved)
        return self.solver.restore(projected, unknowns, numbers, load)


class BlockedDesign(ShapeDesign):
    """The design of a pose whose goal is the push of a blocked panel; arguments are its own."""

    physics: BlockedSkin

    def __init__(self, comm: MPI.Comm, case: Case, *given: Any, **named: Any) -> None:
        blocked, pattern = case.blocked, case.pattern
        assert blocked is not None
        held = case.supports | clamp(pattern, [blocked.panel])
        still = replace(
            case, supports=held, target=pattern.points, parts=(ShapePart(),), metrics=()
        )
        super().__init__(comm, still, *given, **named)
        self.physics = BlockedSkin(
            self.solver, self.physics.pressure, None, self.physics.force, blocked
        )
        self.objective, self.target = ForceObjective(blocked, self.parts), None
        name = f"{case.name}_force"
        self.metrics = [Metric(name, "n", blocked.force, lambda *_: float("nan"), at_least=True)]
        self._of_case = self.objective, self.metrics

    def metrics_of(self, response: Equilibrium) -> dict[str, float]:
        """Return the push in N by its key (collective)."""
        return {self.metrics[0].key: self.objective.push(self.physics.observed(response))}

    def towards(self, case: Case) -> Self:
        """Return the same design with the force of another case."""
        assert case.blocked is not None
        goal = ForceObjective(case.blocked, self.parts)
        return self.changed(objective=goal, case=replace(self.case, blocked=case.blocked))
