"""A shape design from a pattern, a target and numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import DensityError
from toros_fem.base.mpi import require_alike
from toros_fem.base.validation import (
    checked_axes,
    checked_floats,
    real_numbers,
    require_callable,
    require_kind,
    require_names,
)
from toros_fem.design.density.filters import make_filter
from toros_fem.design.density.length_scale import LengthScale, LengthScaleConstraints
from toros_fem.design.density.perimeter import SHARPNESS, Perimeter
from toros_fem.design.density.projection import Projection
from toros_fem.design.loop.problem import Bounds, Pressure
from toros_fem.design.loop.robust import Variants, WidthTolerance
from toros_fem.design.loop.shape_problem import ShapeProblem
from toros_fem.materials.sheet import Composite
from toros_fem.measures.metrics import Metric, check_metrics, distance
from toros_fem.measures.shape import Objective, ShapeObjective, checked_target, require_near
from toros_fem.mechanics.contact.settings import Contact
from toros_fem.mechanics.equilibrium.newton import NewtonStep
from toros_fem.mechanics.equilibrium.options import NewtonOptions
from toros_fem.mechanics.equilibrium.solver import EquilibriumSolver
from toros_fem.mechanics.skin.chambers import Chambers
from toros_fem.mechanics.skin.dead_loads import Weight, refined_force
from toros_fem.mechanics.skin.supports import Supports
from toros_fem.meshes.mirror import mirrored
from toros_fem.meshes.pattern import Pattern
from toros_fem.meshes.refine import refine
from toros_fem.meshes.skin import Skin, sew
from toros_fem.meshes.transfer import make_transfer

DEFAULT_LENGTH_SCALE = LengthScale()


class ShapeDesign(ShapeProblem):
    """A pattern whose print is designed so that the inflated skin takes a target shape.

    Only what is given is built: no pressure unknowns without bounds, no perimeter without a weight.

    Args:
        comm: Communicator.
        pattern: Panels and seams.
        target: Target positions of all assembled vertices, (n, 3), in m, or a map from assembled
            positions to them, `meshes.bend` for instance.
        supports: Fixed components and directions.
        filter_radius: R of the density filter in m.
        pressure: In Pa, of all chambers or of each; the first guess where it is designed.
        composite: Fabric, reinforcement and stretch bounds.
        pressure_bounds: Least and largest pressure in Pa, of all chambers or of each; None
            prescribes it.
        printed_panels: Names of panels that are printed all over.
        passive: Prescribed density of all triangles, (t,), NaN where it is designed; the printed
            panels come on top.
        filter: "cone" or "helmholtz".
        projection: Smoothed step from ρ̃ to ρ̄.
        length_scale: Widths of lines and gaps that constrained stages enforce; None leaves the
            constraints out.
        perimeter_weight: Weight of the perimeter term; None leaves it out.
        perimeter_window: Radius of its window in m; None takes R.
        perimeter_sharpness: w of eq. (15), as of `Perimeter`.
        weights, relative: Factors on each vertex in the objective, as of `ShapeObjective`.
        objective: Makes another objective of the sewn skin; None takes `ShapeObjective`.
        metrics: Numbers that the design is judged by, the most important first; None takes the
            root mean square distance from the target in mm.
        start: Density of all triangles to start from, (t,), within [0.1, 0.9]; None: 0.5.
        symmetry: Axes of the planes that the pattern is cut at, as of `meshes.mirrored`: filters,
            pictures and prints see the whole skin.
        chambers: Pressure chambers; None for one.
        weight: The skin's own weight; None leaves it out.
        contact: What the skin cannot pass through; None for nothing.
        force: Dead forces in N on all assembled vertices, (n, 3).
        width_tolerance: How far the widths of printed lines may be off, for a design whose shape
            changes little by it; None leaves this out.
        options: Options of the equilibrium solver.
        log: Called with each Newton step, on every rank.

    Raises:
        TorosError: An argument does not fit the pattern or is out of its bounds; the message names
            the value, the bound and the remedy.
    """

    def __init__(
        self,
        comm: MPI.Comm,
        pattern: Pattern,
        *,
        target: Floats | Callable[[Floats], Floats],
        supports: Supports,
        filter_radius: float,
        pressure: Pressure,
        composite: Composite | None = None,
        pressure_bounds: Bounds | Sequence[Bounds | None] | None = None,
        printed_panels: Sequence[str] = (),
        passive: Floats | None = None,
        filter: str = "cone",
        projection: Projection | None = None,
        length_scale: LengthScale | None = DEFAULT_LENGTH_SCALE,
        perimeter_weight: float | None = None,
        perimeter_window: float | None = None,
        perimeter_sharpness: float = SHARPNESS,
        weights: Floats | None = None,
        relative: Floats | None = None,
        objective: Callable[[Skin], Objective] | None = None,
        metrics: Sequence[Metric] | None = None,
        start: Floats | None = None,
        symmetry: Sequence[int] = (),
        chambers: Chambers | None = None,
        weight: Weight | None = None,
        contact: Contact | None = None,
        force: Floats | None = None,
        width_tolerance: WidthTolerance | None = None,
        options: NewtonOptions | None = None,
        log: Callable[[NewtonStep | str], None] | None = None,
    ) -> None:
        self._given: dict[str, Any] = {
            "target": target,
            "supports": supports,
            "filter_radius": filter_radius,
            "pressure": pressure,
            "composite": composite,
            "pressure_bounds": pressure_bounds,
            "printed_panels": printed_panels,
            "passive": passive,
            "filter": filter,
            "length_scale": length_scale,
            "perimeter_weight": perimeter_weight,
            "perimeter_window": perimeter_window,
            "perimeter_sharpness": perimeter_sharpness,
            "weights": weights,
            "relative": relative,
            "objective": objective,
            "metrics": metrics,
            "start": start,
            "symmetry": symmetry,
            "chambers": chambers,
            "weight": weight,
            "contact": contact,
            "force": force,
            "width_tolerance": width_tolerance,
            "options": options,
            "log": log,
        }
        require_alike(comm, **self._given)
        if metrics is not None:
            check_metrics(metrics)
        skin = sew(comm, pattern)
        goal = checked_target(skin, target(pattern.points) if callable(target) else target)
        require_near(pattern, goal)
        for name, made in (("objective", objective), ("log", log)):
            if made is not None:
                require_callable(name, made, "a function, or None")
        for name, kind, value in (
            ("projection", Projection, projection),
            ("length_scale", LengthScale, length_scale),
            ("width_tolerance", WidthTolerance, width_tolerance),
        ):
            require_kind(name, value, (kind, type(None)), f"a {kind.__name__}, or None")
        planes = checked_axes("symmetry", symmetry)
        whole = mirrored(pattern, planes) if planes else None
        if force is not None:
            places = pattern.points.shape
            force = checked_floats("force", force, f"finite and of shape {places}, in N", places)
        composite = Composite() if composite is None else composite
        parts: dict[str, Any] = {"chambers": chambers, "weight": weight, "contact": contact}
        solver = EquilibriumSolver(skin, composite, supports, options, log, **parts)
        density_filter = make_filter(filter, skin, filter_radius, whole=whole)
        perimeter = None
        if perimeter_weight is not None:
            window = filter_radius if perimeter_window is None else perimeter_window
            perimeter = Perimeter(skin, window, perimeter_sharpness, whole=whole)
        given = _given_density(pattern, passive, printed_panels)
        projection = projection or Projection()
        robust = None
        if width_tolerance is not None:
            robust = Variants(
                width_tolerance,
                density_filter,
                projection.eta,
                lambda: EquilibriumSolver(skin, composite, supports, options, **parts),
            )
        super().__init__(
            solver=solver,
            objective=(
                ShapeObjective(skin, goal, weights, relative)
                if objective is None
                else objective(skin)
            ),
            filter=density_filter,
            pressure=pressure,
            projection=projection,
            passive=None if given is None else given[skin.owned_cells],
            pressure_bounds=pressure_bounds,
            perimeter=perimeter,
            perimeter_weight=perimeter_weight,
            force=force,
            whole=whole,
            target=goal,
            metrics=(_distance_metric(target),) if metrics is None else tuple(metrics),
            start=start,
            robust=robust,
        )
        if length_scale is not None:
            self.length_scale = LengthScaleConstraints(
                skin,
                density_filter,
                length_scale,
                self.designed,
                projection,
                parts=1 if whole is None else len(whole.cell) // len(pattern.triangles),
            )

    def on(self, pattern: Pattern) -> ShapeDesign:
        """Return the same design on the same triangles, whose vertices have moved (collective).

        A target that is a map is evaluated again, one of positions is interpolated; all else
        belongs to vertices and triangles, which keep their numbers.

        Args:
            pattern: The pattern after the move, by `meshes.snap.snapped` for instance.

        Raises:
            TorosError: An objective of your own does not fit the moved skin.
        """
        given = {**self._given, "projection": self.projection}
        if not callable(given["target"]):
            transfer = make_transfer(self.skin.pattern, pattern)
            given["target"] = transfer.positions(np.asarray(given["target"]))
        return ShapeDesign(self.comm, pattern, **given)

    def refined(self) -> ShapeDesign:
        """Return the same design on the refined pattern, with half the filter radius (collective).

        Each triangle is divided into four. A target that is a map is evaluated again, one of
        positions is interpolated, as are weights; supports, chambers, forces and densities are
        carried over. Widths and the perimeter's window are halved with the radius.

        Raises:
            ParameterError: The sheet is moulded in its assembled shape.
            TorosError: An objective of your own does not fit the refined skin.
        """
        self.solver.model.composite.require_refinable()
        pattern, given = self.skin.pattern, dict(self._given)
        finer = refine(pattern)
        given["projection"], given["filter_radius"] = self.projection, given["filter_radius"] / 2
        if given["perimeter_window"] is not None:
            given["perimeter_window"] /= 2
        if given["length_scale"] is not None:
            given["length_scale"] = _halved(given["length_scale"])
        if not callable(given["target"]):
            given["target"] = finer.at_vertices(given["target"])
        for name in ("weights", "relative"):
            given[name] = None if given[name] is None else finer.at_vertices(given[name])
        for name in ("passive", "start"):
            given[name] = None if given[name] is None else given[name][finer.cell]
        if given["force"] is not None:
            given["force"] = refined_force(finer, pattern, given["force"])
        given["supports"] = given["supports"].refined(finer)
        given["chambers"] = given["chambers"] and given["chambers"].refined(finer)
        return ShapeDesign(self.comm, finer.pattern, **given)


def _halved(widths: LengthScale) -> LengthScale:
    """Return the constraints at half the scale."""
    line, gap, decay = widths.line_width, widths.gap_width, widths.decay
    return replace(
        widths,
        line_width=None if line is None else line / 2,
        gap_width=None if gap is None else gap / 2,
        decay=None if decay is None else decay / 4,
    )


def _given_density(
    pattern: Pattern, passive: Floats | None, printed_panels: Sequence[str]
) -> Floats | None:
    """Return the prescribed density of all triangles, (t,); None if there is none."""
    require_names("printed_panels", printed_panels)
    count = len(pattern.triangles)
    if passive is not None:
        what = "one density for each triangle, NaN where it is designed"
        passive = real_numbers("passive", passive, what, DensityError)
    if passive is not None and passive.shape != (count,):
        raise DensityError(
            f"passive has shape {passive.shape}; it must be ({count},), one density for each "
            "triangle of the pattern, NaN where it is designed."
        )
    if passive is None and not printed_panels:
        return None
    given = np.full(count, np.nan) if passive is None else np.array(passive, dtype=np.float64)
    for name in printed_panels:
        given[pattern.cells_of(name)] = 1.0
    return given


def _distance_metric(target: Floats | Callable[[Floats], Floats]) -> Metric:
    """Root mean square distance; from a map also on other meshes, for `estimate_error`."""

    def measure(pattern: Pattern, positions: Floats) -> float:
        goal = target(pattern.points) if callable(target) else np.asarray(target)
        return 1e3 * distance(pattern, positions, goal)

    return Metric("distance", "mm", 0.0, measure)
