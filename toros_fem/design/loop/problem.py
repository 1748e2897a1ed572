"""The design problem, made of parts, and its gradient, eqs. (11-19)."""

from __future__ import annotations

import copy
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from operator import is_
from typing import Any, Generic, Protocol, Self

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import NoEquilibriumError
from toros_fem.base.validation import Bools, Floats
from toros_fem.design.density.length_scale import LengthScaleConstraints
from toros_fem.design.loop.fields import Fields
from toros_fem.design.loop.physics import Physics, Pressure, R, Residuals
from toros_fem.measures.metrics import Metric, check_metrics
from toros_fem.meshes.pattern import Mirrored, mirrored
from toros_fem.meshes.skin import Skin


class Measure(Protocol):
    """A number of ρ̄ alone; `forward` and `backward` are a pair (collective)."""

    def forward(self, projected: Floats) -> float:
        """Return the number."""

    def backward(self, projected: Floats) -> Floats:
        """Return its derivative by ρ̄ at owned triangles."""


@dataclass(frozen=True, eq=False)
class ObjectiveTerm:
    """A term price · measure of T, with a price > 0; its name is "perimeter", in m, or "shares"."""

    name: str
    measure: Measure
    price: float


@dataclass(frozen=True, eq=False)
class Slopes:
    """Gradients around a design.

    Attributes:
        gradient: dT/dx by the variables of this rank, zero where they are prescribed.
        pressure_gradient: dT/dP in 1/Pa by the pressure of each chamber, (k,), zero where the
            pressure is prescribed; None without designed pressures.
        length_scale_gradients: dg_r/dx and dg_t/dx, as `gradient`; empty without constraints.
        residuals: Residuals around this design, their gradients by x.
    """

    gradient: Floats
    pressure_gradient: Floats | None
    length_scale_gradients: list[Floats]
    residuals: Residuals


@dataclass(frozen=True, eq=False)
class Evaluation(Generic[R]):
    """One pass ρ → ρ̃ → ρ̄ → x → T.

    Attributes:
        problem: The problem that the design was evaluated in.
        density: ρ, the variables of this rank.
        filtered, projected: ρ̃ and ρ̄ at owned triangles.
        equilibrium: Response to ρ̄: the equilibrium, or the profile of a tile.
        shape: The part of T that measures the distance from the target, of all poses.
        measures: Measure of each term, by name.
        length_scale: (g_r, g_t) of eqs. (13, 14); None without width constraints.
        seconds: Wall time by phase, on this rank.
        poses: Evaluations of the problem's further poses.
    """

    problem: DesignProblem[R]
    density: Floats
    filtered: Floats
    projected: Floats
    equilibrium: R
    shape: float
    measures: Mapping[str, float]
    length_scale: Floats | None
    seconds: Mapping[str, float]
    poses: tuple[Evaluation[R], ...] = ()

    @property
    def every(self) -> tuple[Evaluation[R], ...]:
        """Evaluations of all poses, this one first."""
        return self, *self.poses

    @property
    def start(self) -> Any:
        """What the simulation of a neighbouring design starts from, as of `simulate`."""
        return tuple(one.equilibrium for one in self.every) if self.poses else self.equilibrium

    @property
    def metrics(self) -> dict[str, float]:
        """Metrics of all poses by key, equal on all ranks (collective)."""
        return {
            key: value
            for one in self.every
            for key, value in one.problem.metrics_of(one.equilibrium).items()
        }

    @property
    def objective(self) -> float:
        """T: shape and priced measures together."""
        terms = self.problem.terms
        found = self.shape + sum(term.price * self.measures[term.name] for term in terms)
        return found + self.problem.pressure_cost(self.equilibrium.pressures)

    @property
    def perimeter(self) -> float | None:
        """Length in m of the border of the print; None without a perimeter term."""
        return self.measures.get("perimeter")

    @property
    def steps(self) -> int:
        """Number of Newton steps."""
        return sum(one.equilibrium.steps for one in self.every)

    @property
    def factorisations(self) -> int:
        """Number of factorisations."""
        return sum(one.equilibrium.factorisations for one in self.every)


@dataclass(eq=False)
class DesignProblem(Generic[R]):
    """A skin or tile whose print is designed, made of parts.

    T is the objective of what the physics makes of ρ̄, plus terms of ρ̄ alone. Each part is a pair
    of a forward and a backward pass; `simulate` and `differentiate` chain them. The gradient is the
    discrete adjoint's, tied by tests to differences of the whole chain.

    Attributes:
        fields: Variables, filter and projection: x → ρ̃ → ρ̄.
        physics: ρ̄ and pressures → response.
        objective: Distance from the target, of what the physics lets it observe.
        terms: Further terms of T: perimeter, cost of lines.
        length_scale: Constraints on the widths of lines and gaps; None leaves them out.
        metrics: Numbers that the design is judged by, the most important first.
        whole: The whole skin that the skin is a part of, by `meshes.mirrored`, or the skin itself.
            Prints are drawn and measured on the whole.
        target: Target positions of all assembled vertices, (n, 3), in m, for pictures; None if the
            objective has none.
        pressure_weight: Weight in T of ln(p/p_least) of each designed pressure, so that a design
            takes no more pressure than its target wants; None leaves it out.
        poses: Problems of further poses of the same fields, with physics, objective and metrics of
            their own; their fields and terms are not asked.
        importance: Weight of this pose in the mean of the objectives of all poses.
    """

    fields: Fields
    physics: Physics[R]
    objective: Any
    terms: Sequence[ObjectiveTerm] = ()
    length_scale: LengthScaleConstraints | None = None
    metrics: Sequence[Metric] = ()
    whole: Mirrored = None  # type: ignore[assignment]  # by default the skin itself
    target: Floats | None = None
    pressure_weight: float | None = None
    poses: Sequence[DesignProblem[R]] = ()
    importance: float = 1.0

    def __post_init__(self) -> None:
        self.whole = self.whole or mirrored(self.skin.pattern, ())
        check_metrics(self.metrics)

    def changed(self, **parts: Any) -> Self:
        """Return the same problem with other parts; all others are shared."""
        other = copy.copy(self)
        vars(other).update(parts)
        return other

    @property
    def every(self) -> tuple[DesignProblem[R], ...]:
        """The problems of all poses, this one first."""
        return self, *self.poses

    @property
    def on_one_path(self) -> bool:
        """Whether further poses are at other pressures, and nothing else acts on them."""
        return False

    @property
    def all_metrics(self) -> tuple[Metric, ...]:
        """The metrics of all poses."""
        return tuple(metric for one in self.every for metric in one.metrics)

    @property
    def portions(self) -> list[float]:
        """Portion of each pose in T."""
        total = sum(one.importance for one in self.every)
        return [one.importance / total for one in self.every]

    def pressure_cost(self, pressures: Sequence[float]) -> float:
        """Return the part of T that prefers less of the pressures of all chambers, in Pa."""
        if self.pressure_weight is None:
            return 0.0
        pairs = zip(pressures, self.physics.pressure_ranges, strict=True)
        logarithms = [np.log(p / bounds[0]) for p, bounds in pairs if bounds and p > 0]
        return self.pressure_weight * float(sum(logarithms))

    @property
    def skin(self) -> Skin:
        """The skin whose triangles are designed."""
        return self.fields.skin

    @property
    def comm(self) -> MPI.Comm:
        """Communicator of all ranks that take part."""
        return self.physics.comm

    @property
    def designed(self) -> Bools:
        """Whether each owned triangle is designed."""
        return self.fields.designed

    @property
    def parts(self) -> int:
        """Number of equal parts of the skin, of which one is designed."""
        return self.whole.parts

    def metrics_of(self, response: R) -> dict[str, float]:
        """Return the values of all metrics by key, equal on all ranks (collective).

        A print has a mesh, and so a problem, of its own: see `PrintedDesign.metrics`.
        """
        if not self.metrics:
            return {}
        found = self.physics.shape_of(response)
        assert found is not None
        return {m.key: m.value(self.skin.pattern, found) for m in self.metrics}

    def simulate(
        self,
        density: Floats,
        start: Any = None,
        pressure: Pressure | None = None,
        *,
        trial: bool = False,
    ) -> Evaluation[R]:
        """Evaluate T, without its gradient, eq. (17) (collective).

        Args:
            density: ρ, the variables of this rank, in [0, 1].
            start: State to start from, of all poses as a tuple, or of the first one.
            pressure, trial: As of `Physics.respond`. Pressures of further poses change by the same
                factor.

        Raises:
            ParameterError: The density does not fit or leaves [0, 1].
            NoEquilibriumError: There is no equilibrium for this design.
        """
        begin = time.perf_counter()
        density = self.fields.with_passive(self.fields.checked(density))
        filtered, projected = self.fields.forward(density)
        return self._evaluated(density, filtered, projected, (start, pressure), begin, trial=trial)

    def simulate_binary(
        self,
        printed: Floats | Bools,
        like: Evaluation[R] | None = None,
        *,
        start: Any = None,
        pressure: Pressure | None = None,
    ) -> Evaluation[R]:
        """Evaluate a print (collective).

        Args:
            printed: Printed part of each owned triangle; prescribed densities are kept, which in a
                print are all.
            like: The design that it came from: its densities, its pressure, and its state to start
                from. None for a pattern that was drawn: it is its own density.
            start: State to start from; None takes that of `like`.
            pressure: In Pa, of all chambers or of each; None takes that of `like`, or else the
                problem's own.

        Raises:
            NoEquilibriumError: There is no equilibrium for this pattern.
        """
        begin = time.perf_counter()
        projected = self.fields.with_passive(np.asarray(printed, dtype=np.float64))
        density = filtered = projected
        if like is not None:
            density, filtered = like.density, like.filtered
            start = like.start if start is None else start
            pressure = like.equilibrium.pressures or None if pressure is None else pressure
        return self._evaluated(density, filtered, projected, (start, pressure), begin)

    def _evaluated(
        self,
        density: Floats,
        filtered: Floats,
        projected: Floats,
        near: tuple[Any, Pressure | None],
        begin: float,
        *,
        trial: bool = False,
    ) -> Evaluation[R]:
        middle = time.perf_counter()
        responses = self._responses(projected, *near, trial=trial)
        seconds = {"filter": middle - begin, "equilibrium": time.perf_counter() - middle}
        return self.told(density, filtered, projected, responses, seconds)

    def _responses(
        self, projected: Floats, start: Any, pressure: Pressure | None, *, trial: bool
    ) -> list[R]:
        """Return the response of each pose."""
        starts = start if isinstance(start, tuple) else (start,)
        responses = [self.physics.respond(projected, starts[0], pressure, trial=trial)]
        factor = self._factor(responses[0].pressures)
        for number, (pose, near) in enumerate(zip_longest(self.poses, starts[1:]), 2):
            pressures = [factor * own for own in pose.physics.pressures]
            try:
                responses.append(pose.physics.respond(projected, near, pressures, trial=trial))
            except NoEquilibriumError as caught:  # raised by all ranks or by none
                caught.args = (f"pose {number}: {caught}", *caught.args[1:])
                raise
        return responses

    def _factor(self, pressures: Sequence[float]) -> float:
        """Return the factor by which pressures differ from those of the problem."""
        given = max(self.physics.pressures, default=0.0)
        return max(pressures) / given if given > 0 else 1.0

    def told(
        self,
        density: Floats,
        filtered: Floats,
        projected: Floats,
        responses: Sequence[R],
        seconds: dict[str, float],
    ) -> Evaluation[R]:
        """Return the evaluation of fields and of the response of each pose to them (collective).

        The seconds are those that both took; those of the measures are added.
        """
        begin = time.perf_counter()
        measures = {term.name: term.measure.forward(projected) for term in self.terms}
        widths = None
        if self.length_scale is not None:
            widths = self.length_scale.forward(density, filtered, projected)
        seconds["filter"] += time.perf_counter() - begin
        first, *others = responses
        own = self.objective.forward(self.physics.observed(first))
        poses = tuple(
            pose.told(density, filtered, projected, [response], {"filter": 0.0})
            for pose, response in zip(self.poses, others, strict=True)
        )
        shape = self.mean([own, *(pose.shape for pose in poses)])
        fields = density, filtered, projected
        return Evaluation(self, *fields, first, shape, measures, widths, seconds, poses)

    def shape_of_poses(self, evaluation: Evaluation[R]) -> float:
        """Return the part of T that measures the distance from the target, by its weights.

        Those of the evaluation may be others, in a stage where one pose counts most.
        """
        if not evaluation.poses:
            return evaluation.shape
        every = [(one.problem, one.equilibrium) for one in evaluation.every]
        return self.mean(
            [problem.objective.forward(problem.physics.observed(at)) for problem, at in every]
        )

    def mean(self, shapes: Sequence[float]) -> float:
        """Return the mean of the objectives of all poses, weighted by their importance."""
        if len(shapes) == 1:
            return shapes[0]
        return float(np.dot(self.portions, shapes))

    def finish(self, evaluation: Evaluation[R]) -> Evaluation[R]:
        """Complete a trial, so that it can be differentiated (collective).

        Raises:
            ParameterError: The solver has been used for other designs since.
            NoEquilibriumError: There is no stable equilibrium near.
        """
        begin, e = time.perf_counter(), evaluation
        response = self.physics.finish(e.equilibrium)
        poses = tuple(pose.problem.finish(pose) for pose in e.poses)
        if response is e.equilibrium and all(map(is_, poses, e.poses)):
            return evaluation
        own = self.objective.forward(self.physics.observed(response))
        shape = self.mean([own, *(pose.shape for pose in poses)])
        seconds = {"equilibrium": time.perf_counter() - begin}
        return replace(e, equilibrium=response, shape=shape, seconds=seconds, poses=poses)

    def differentiate(self, evaluation: Evaluation[R]) -> Slopes:
        """Return the gradients of the last simulation, by adjoint solves, eqs. 18, 19 (collective).

        Raises:
            ParameterError: The solver has been used for another design since.
        """
        e, fields = evaluation, self.fields
        by_projected, by_pressure = self._pulled_back(e.equilibrium)
        if e.poses:  # whose pressures are prescribed
            own, *others = self.portions
            by_projected = own * by_projected
            for portion, pose in zip(others, e.poses, strict=True):
                by_projected += portion * pose.problem._pulled_back(pose.equilibrium)[0]
        if by_pressure is not None and self.pressure_weight is not None:
            pairs = zip(e.equilibrium.pressures, self.physics.pressure_ranges, strict=True)
            slopes = [self.pressure_weight / p if bounds else 0.0 for p, bounds in pairs]
            by_pressure = by_pressure + np.array(slopes)
        for term in self.terms:
            by_projected = by_projected + term.price * term.measure.backward(e.projected)
        widths = []
        if self.length_scale is not None:
            parts = self.length_scale.backward(e.density, e.filtered, e.projected)
            widths = [
                fields.backward(e.filtered, by_print, by_smooth) + by_density * self.designed
                for by_density, by_smooth, by_print in parts
            ]
        found = self.physics.residuals(e.equilibrium, self.objective)
        rows = [fields.backward(e.filtered, row) for row in found.gradients]
        return Slopes(
            fields.backward(e.filtered, by_projected),
            by_pressure,
            widths,
            replace(found, gradients=rows),
        )

    def _pulled_back(self, response: R) -> tuple[Floats, Floats | None]:
        """Return the gradients of the objective by ρ̄ and by the pressures (collective)."""
        by_seen = self.objective.backward(self.physics.observed(response))
        return self.physics.pull_back(response, by_seen)

    def evaluate(
        self, density: Floats, start: Any = None, pressure: Pressure | None = None
    ) -> tuple[Evaluation[R], Slopes]:
        """Return T and its gradients: `simulate`, then `differentiate` (collective)."""
        found = self.simulate(density, start, pressure)
        return found, self.differentiate(found)
