"""A shape design: its problem on an inflated skin, and what makes densities printable."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from mpi4py import MPI
from shapely.geometry.base import BaseGeometry

from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import (
    NAMES,
    Floats,
    Ints,
    checked_axes,
    checked_floats,
    checked_list,
    require_callable,
    require_kind,
    require_positive,
    shown,
)
from toros_fem.design.density.filters import make_filter, require_radius
from toros_fem.design.density.length_scale import LengthScale, LengthScaleConstraints
from toros_fem.design.density.perimeter import SHARPNESS, Perimeter
from toros_fem.design.density.projection import Projection
from toros_fem.design.loop.case import Case
from toros_fem.design.loop.fields import DensityFields
from toros_fem.design.loop.physics import InflatedSkin
from toros_fem.design.loop.problem import DesignProblem, Evaluation, ObjectiveTerm
from toros_fem.materials.sheet import Composite
from toros_fem.measures.metrics import check_metrics
from toros_fem.measures.shape import checked_target, require_near
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.mechanics.equilibrium.iteration import NewtonStep
from toros_fem.mechanics.equilibrium.newton import NewtonOptions
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.skin import Skin, sew
from toros_fem.meshes.triangles import gradients

# Power q of the projection: with 2 bends need less print than with 1, and are nearer to their
# targets (docs/theory/design.md).
POWER = 2.0
# Largest displacement in differences of metrics, over the size of the skin.
METRIC_STEP = 1e-5
# Largest move of a flat point in differences of forces, over the size of the least triangle.
FLAT_STEP = 1e-3
# Volume of a flat skin at rest, at most, over its area to the power of 3/2: layers lie apart by
# about a thickness, which makes 0.003; long tubes have 0.01.
FLAT = 0.005
TINY = float(np.finfo(float).tiny)


@dataclass(frozen=True)
class Regularisation:
    """Filter, projection, widths and perimeter of a design of densities.

    Only what is given is built: no perimeter without a weight. `ShapeDesign` checks the values.

    Attributes:
        filter_radius: R of the density filter in m.
        filter: "cone" or "helmholtz".
        projection: Smoothed step from ρ̃ to ρ̄, by default that of the paper with the power 2.
        length_scale: Widths of lines and gaps that constrained stages enforce; None leaves the
            constraints out.
        perimeter_weight: Weight of the perimeter term; None leaves it out.
        perimeter_window: Radius of its window in m; None takes R.
        perimeter_sharpness: w of eq. (15), as of `Perimeter`.
    """

    filter_radius: float
    filter: str = "cone"
    projection: Projection = field(default_factory=lambda: Projection(power=POWER))
    length_scale: LengthScale | None = field(default_factory=LengthScale)
    perimeter_weight: float | None = None
    perimeter_window: float | None = None
    perimeter_sharpness: float = SHARPNESS

    def require_possible(self, size: float) -> None:
        """Check what is known without a mesh, on a skin of a size in m.

        Raises:
            ParameterError: The filter is larger than the skin, or cannot enforce widths.
        """
        require_radius(self.filter_radius, size)
        if self.length_scale is not None:
            self.length_scale.thresholds(self.filter, self.filter_radius, self.projection.eta)

    @property
    def plain(self) -> Regularisation:
        """Filter and projection alone, for a mesh on which nothing is designed."""
        return replace(self, length_scale=None, perimeter_weight=None)

    def scaled(self, factor: float) -> Regularisation:
        """Return the same on a mesh whose edges are longer by a factor: all lengths follow it."""
        widths, window = self.length_scale, self.perimeter_window
        return replace(
            self,
            filter_radius=factor * self.filter_radius,
            length_scale=None if widths is None else widths.scaled(factor),
            perimeter_window=None if window is None else factor * window,
        )


@dataclass(eq=False)
class ShapeProblem(DesignProblem[Equilibrium]):
    """A skin under pressure, designed towards the shape that it shall take, eqs. (17-19)."""

    physics: InflatedSkin

    @property
    def solver(self) -> EquilibriumSolver:
        """Equilibrium solver of the skin."""
        return self.physics.solver

    @property
    def flat_at_rest(self) -> bool:
        """Whether a closed skin encloses nothing at rest, as two layers do (collective)."""
        model, area = self.solver.model, float(self.skin.pattern.areas.sum())
        if model.pressure is None:
            return False
        return float(np.abs(model.volumes(model.assembled)).sum()) < FLAT * area**1.5

    def metrics_at(self, owned: Floats) -> dict[str, float]:
        """Return the values of all metrics for positions of the owned nodes (collective)."""
        if not self.metrics:
            return {}
        positions, pattern = self.skin.gather_vertices(owned), self.skin.pattern
        return {m.key: m.value(pattern, positions) for m in self.metrics}

    def shape_derivatives(
        self,
        evaluation: Evaluation[Equilibrium],
        moves: Sequence[Floats],
        values: Callable[[Floats], Floats],
    ) -> Floats:
        """Return the derivatives of values along moves of the flat points, (j, m) (collective).

        K y = −(∂f/∂X) δX with the last tangent gives the motion y of the vertices. Points of the
        material, by which shapes are compared, move by y − F δX. Forces are differenced in the flat
        points, values along the motion.

        Args:
            evaluation: A simulation of this problem.
            moves: δX of the pattern's flat points, (k, 2), in m, one array for each of m
                derivatives. Both sides of a seam move alike.
            values: Function of the positions of all vertices, (n, 3), in m, that returns j numbers.
        """
        at, skin, model = evaluation.equilibrium, self.skin, self.solver.model
        pattern, places = skin.pattern, skin.mesh.geometry.x
        self.solver.tangent_at(at)
        here, rest, flat = skin.gather_vertices(at.positions), places.copy(), _flat_points(skin)
        least = FLAT_STEP * float(np.sqrt(pattern.areas.min()))

        def put(way: Floats | None) -> None:
            places[:] = rest
            if way is not None:
                places[: len(flat), :2] += way[flat]
            for term in model.terms:
                term.after_move()

        def force(way: Floats) -> Floats:
            put(way)
            return np.array(model.residual(at.state))

        steps = [least / max(float(np.abs(move).max()), TINY) for move in moves]
        try:
            pushes = [
                np.asarray((force(-step * move) - force(step * move)) / (2 * step))
                for step, move in zip(steps, moves, strict=True)
            ]
        finally:
            put(None)
        columns = []
        for push, move in zip(pushes, moves, strict=True):
            motion = skin.gather_vertices(model.positions(self.solver.solve_tangent(push, at)))
            motion = motion - carried_along(pattern, here, move)
            step = METRIC_STEP * pattern.size / max(float(np.abs(motion).max()), TINY)
            ends = (values(here + sign * step * motion) for sign in (1, -1))
            columns.append(np.subtract(*ends) / (2 * step))
        return np.stack(columns, axis=1)


def _flat_points(skin: Skin) -> Ints:
    """Return the pattern's flat point at each corner of this rank's triangles, (3 c,)."""
    cell = skin.cell[skin.density_space.dofmap.list.ravel()]
    vertex = skin.vertex[skin.position_space.dofmap.list]
    there = skin.pattern.triangles[cell]
    corner = np.argmax(there[:, None, :] == vertex[:, :, None], axis=2)
    points: Ints = np.take_along_axis(skin.pattern.flat_triangles[cell], corner, axis=1).ravel()
    return points


def carried_along(pattern: Pattern, positions: Floats, motion: Floats) -> Floats:
    """Return F δX at the vertices, (n, 3): their way if flat points move with the material.

    F is the mean over the triangles around a vertex, by area. Positions are those of all vertices,
    (n, 3), the motion is δX of the flat points, (k, 2), in m.
    """
    corners = positions[pattern.triangles]
    gradient = np.einsum("tci,tcj->tij", corners, gradients(pattern.corners))
    each = np.einsum("tij,tcj->tci", gradient, motion[pattern.flat_triangles])
    weight, vertex = np.repeat(pattern.areas, 3), pattern.triangles.ravel()
    size = len(pattern.points)
    total = np.bincount(vertex, weight, size)
    rows = (np.bincount(vertex, weight * way, size) for way in each.reshape(-1, 3).T)
    return np.stack([row / total for row in rows], axis=1)


class ShapeDesign(ShapeProblem):
    """A pattern whose print is designed so that the inflated skin takes a target shape.

    Only what is given is built: no pressure unknowns without bounds, no perimeter without a weight.

    Args:
        comm: Communicator.
        case: The skin, what acts on it, and its target.
        regularisation: Filter, projection, widths and perimeter.
        options: Options of the equilibrium solver.
        log: Called with each Newton step, on every rank.
        among: The design of the first pose, whose skin and fields a further one takes; None for the
            first one.

    Attributes:
        case, regularisation: As given, or as they were changed by the methods of this class. What
            else `changed` gives holds on this mesh alone, but for metrics. Where nothing is
            designed, as in a print, width constraints and perimeter are left out.
        fields: DensityFields, filter and projection.
        poses: Designs of the further poses.

    Raises:
        TorosError: An argument does not fit the pattern or is out of its bounds; the message names
            the value, the bound and the remedy.
    """

    fields: DensityFields
    poses: Sequence[ShapeDesign]

    def __init__(
        self,
        comm: MPI.Comm,
        case: Case,
        regularisation: Regularisation,
        *,
        options: NewtonOptions | None = None,
        log: Callable[[NewtonStep | str], None] | None = None,
        among: ShapeDesign | None = None,
    ) -> None:
        require_kind("case", case, Case, "a Case")
        require_kind("regularisation", regularisation, Regularisation, "a Regularisation")
        _check_kinds(case, regularisation, log)
        passive = _given_density(case)
        if passive is not None and not np.isnan(passive).any():
            regularisation = regularisation.plain
        self.case, self.regularisation, self._log = case, regularisation, log
        skin = sew(comm, case.pattern) if among is None else among.skin
        goal = checked_target(skin, case.goal)
        require_near(case.pattern, goal)
        force, whole, r = case.force, case.whole, regularisation
        if force is not None:
            places = case.pattern.points.shape
            force = checked_floats("force", force, f"finite and of shape {places}, in N", places)
        solver = EquilibriumSolver(
            skin,
            Composite() if case.composite is None else case.composite,
            case.supports,
            options,
            log,
            chambers=case.chambers,
            weight=case.weight,
            contact=case.contact,
            quadratic=case.quadratic,
        )
        physics = InflatedSkin(solver, case.pressure, case.pressure_bounds, force)
        beyond = whole if whole.parts > 1 else None
        if among is None:
            density_filter = make_filter(r.filter, skin, r.filter_radius, beyond)
            passive = None if passive is None else passive[skin.owned_cells]
            fields = DensityFields(skin, density_filter, r.projection, passive, case.start)
        else:
            fields = among.fields
        super().__init__(
            fields,
            physics,
            case.objective(skin),
            metrics=case.judged,
            whole=whole,
            target=goal,
            pressure_weight=case.pressure_weight,
            importance=case.importance,
        )
        if among is None:
            _require_poses(case)
        self.poses = [
            (pose.blocked.design if pose.blocked is not None else ShapeDesign)(
                comm, pose, r.plain, options=options, log=log, among=self
            )
            for pose in poses_of(case)
        ]
        check_metrics(self.all_metrics)
        self._of_case = self.objective, self.metrics
        if r.perimeter_weight is not None:
            require_positive(perimeter_weight=r.perimeter_weight)
            window = r.filter_radius if r.perimeter_window is None else r.perimeter_window
            perimeter = Perimeter(skin, window, r.perimeter_sharpness, beyond=beyond)
            weight = r.perimeter_weight * self.parts / whole.pattern.size
            self.terms = [ObjectiveTerm("perimeter", perimeter, weight)]
        if r.length_scale is not None:
            self.length_scale = LengthScaleConstraints(
                skin,
                fields.filter,
                r.length_scale,
                self.designed,
                r.projection,
                parts=self.parts,
            )

    @property
    def on_one_path(self) -> bool:
        """Whether further poses are at other pressures, and nothing else acts on them."""
        return all(map(self.case.differs_in_pressure_alone, self.case.poses))

    def towards(self, case: Case) -> Self:
        """Return the same design with the target and the parts of another case (collective).

        All other parts are shared; the metrics and the target in pictures stay.

        Args:
            case: A case on the same pattern.
        """
        given = replace(
            self.case,
            target=case.target,
            parts=case.parts,
            parts_of_whole=case.parts_of_whole,
            poses=case.poses,
        )
        if len(case.poses) != len(self.poses):
            raise ParameterError(
                f"the case has {len(case.poses)} further poses, the design {len(self.poses)}; give "
                "as many."
            )
        made = case.objective(self.skin)
        poses = [own.towards(pose) for own, pose in zip(self.poses, case.poses, strict=True)]
        of_case = made, self._of_case[1]
        return self.changed(objective=made, case=given, _of_case=of_case, poses=poses)

    def on(self, pattern: Pattern) -> ShapeDesign:
        """Return the same design on the same triangles, whose vertices have moved (collective).

        Args:
            pattern: The pattern after the move, by `meshes.moving.with_flat_points` for instance.

        Raises:
            TorosError: A part of the objective does not fit the moved skin.
        """
        return self._with(self.case.on(pattern), self.regularisation)

    def for_print(self, regions: Sequence[BaseGeometry]) -> ShapeDesign:
        """Return the design on a mesh whose edges are the borders of a print (collective).

        Args:
            regions: Print on each panel of the pattern, polygons in m.
        """
        return self._with(self.case.following(self.comm, regions), self.regularisation)

    def refined(self) -> ShapeDesign:
        """Return the same design on the refined pattern, with half of all lengths (collective).

        See `Case.refined` and `Regularisation.scaled`.

        Raises:
            ParameterError: The sheet is moulded in its assembled shape.
            TorosError: A part of the objective does not fit the refined skin.
        """
        return self._with(self.case.refined(), self.regularisation.scaled(0.5))

    def _with(self, case: Case, regularisation: Regularisation) -> ShapeDesign:
        objective, metrics = self._of_case
        if self.objective is not objective:
            raise ParameterError(
                "the objective was changed, and is known on its own mesh only: give a case that "
                "makes it, towards(case)."
            )
        if self.metrics is not metrics:
            case = replace(case, metrics=self.metrics)
        now = replace(regularisation, projection=self.fields.projection)
        return ShapeDesign(self.comm, case, now, options=self.solver.options, log=self._log)


def _check_kinds(
    case: Case, regularisation: Regularisation, log: Callable[[NewtonStep | str], None] | None
) -> None:
    """Check what comes before a part is made of it."""
    checked_axes("symmetry", case.symmetry)
    if case.metrics is not None:
        check_metrics(case.metrics)
    if not isinstance(case.parts, list | tuple) or not case.parts:
        raise ParameterError(
            f"parts = {shown(case.parts)} must be a list, with ShapePart() for instance."
        )
    for part in case.parts:
        require_callable("parts", part, "functions of the nodes and their target")
    if log is not None:
        require_callable("log", log, "a function, or None")
    require_kind("projection", regularisation.projection, Projection, "a Projection")
    what = "a LengthScale, or None"
    require_kind("length_scale", regularisation.length_scale, (LengthScale, type(None)), what)


def poses_of(case: Case) -> list[Case]:
    """Return the further poses of a case, on its print, with their names before their metrics."""
    made = []
    for number, pose in enumerate(case.poses, 2):
        name = pose.name or f"pose_{number}"
        judged = pose.judged if pose.blocked is None else ()
        metrics = [replace(metric, name=f"{name}_{metric.name}") for metric in judged]
        made.append(
            replace(
                pose,
                name=name,
                metrics=metrics,
                passive=case.passive,
                printed_panels=case.printed_panels,
                start=None,
                quadratic=case.quadratic,
            )
        )
    return made


def _require_poses(case: Case) -> None:
    """Check that the poses of a case are those of one skin, with pressures that are given."""
    poses = [pose for pose in case.poses if isinstance(pose, Case)]
    require_positive(importance=case.importance)
    if len(poses) < len(case.poses):
        raise ParameterError(f"poses = {shown(case.poses)} must be a list of Cases.")
    if case.blocked is not None:
        raise ParameterError("blocked is given to the first pose; give it to one of `poses`.")
    names = [pose.name for pose in poses_of(case)]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ParameterError(
            f"two poses are named {twice!r}: figures of one would overwrite those of the other. "
            "Give each its own name."
        )
    for pose in poses:
        if pose.blocked is not None and pose.contact is not None:
            raise ParameterError(
                f"the pose {pose.name!r} has a blocked panel and contact, and the stiffness of a "
                "panel in contact is not known. Leave one of them out."
            )
        if pose.poses:
            raise ParameterError("a pose has poses of its own: give all of them to the first case.")
        if not (
            np.array_equal(pose.pattern.points, case.pattern.points)
            and np.array_equal(pose.pattern.triangles, case.pattern.triangles)
        ):
            raise ParameterError(
                f"a pose has another pattern, of {len(pose.pattern.triangles)} triangles, than the "
                f"first case, of {len(case.pattern.triangles)}; give all poses the same."
            )
        sheets = [one.composite or Composite() for one in (case, pose)]
        if sheets[0] != sheets[1] or tuple(pose.symmetry) != tuple(case.symmetry):
            raise ParameterError(
                "a pose has another composite or other symmetry planes than the first case: one "
                "skin has one of each. Give all poses the same."
            )
    bounded = [one for one in (case, *poses) if poses and one.pressure_bounds is not None]
    if bounded:
        raise ParameterError(
            f"pressure_bounds = {shown(bounded[0].pressure_bounds)}, but pressures of poses are "
            "prescribed. Give pressure_bounds = None, and the pressure of each pose."
        )


def _given_density(case: Case) -> Floats | None:
    """Return the prescribed density of all triangles, (t,); None if there is none."""
    checked_list("printed_panels", case.printed_panels, str, NAMES)
    count, passive = len(case.pattern.triangles), case.passive
    if passive is not None:
        what = "one density for each triangle, NaN where it is designed"
        checked_floats("passive", passive, f"({count},), {what}", (count,), finite=False)
    return case.prescribed
