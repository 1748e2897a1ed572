"""Result of a run: its figures, its summary.json, and how a notebook shows it; that of a print."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import OutputError, ParameterError
from toros_fem.base.files import guarded, write_json
from toros_fem.base.keys import Table
from toros_fem.base.packages import versions
from toros_fem.base.scene import Scene
from toros_fem.base.validation import Floats, require_kind
from toros_fem.design.loop.loop import DesignResult
from toros_fem.design.loop.miss import prefix_of
from toros_fem.design.loop.options import LOST, Iteration, growth_of_miss
from toros_fem.design.loop.shape_design import ShapeDesign, ShapeProblem
from toros_fem.making.as_printed import PrintedDesign
from toros_fem.measures.figures import DEFAULT, Figure, State, Tolerances, overall, verdict_of
from toros_fem.measures.miss import shape_figures
from toros_fem.mechanics.equilibrium.equilibrium import Equilibrium
from toros_fem.results.report.page_file import EmbeddedPage, view_of
from toros_fem.results.report.tables import as_text
from toros_fem.results.runs.open_run import require_open, run_of
from toros_fem.results.runs.stored_run import SUMMARY, Summary, figures_html, notes_at, warnings_of

# A pressure this near to its bound, over it, is at it; so much of the stretch bounds is nearly all.
NEAR_BOUND, STRETCHED = 1e-3, 0.97
# What is advised where the pressure is at its bound, over this.
MORE = 1.5


class RunResult(ABC):
    """What a run has found.

    Attributes:
        folder: Where its files are; None before its summary is written.
    """

    folder: Path | None = None

    @property
    @abstractmethod
    def figures(self) -> tuple[Figure, ...]:
        """The numbers that it tells, the most important first."""

    @abstractmethod
    def entries(self) -> dict[str, Any]:
        """Return the further entries of its summary; keys of numbers end in their units."""

    @abstractmethod
    def description(self) -> str:
        """Return it in a sentence."""

    @property
    def binding(self) -> Sequence[str]:
        """What keeps it from its targets, as far as it is known."""
        return ()

    @property
    def notes(self) -> Sequence[str]:
        """What is not as usual in its equilibria, as sentences."""
        return ()

    def sentence(self) -> str:
        """Return whether all targets are reached, what binds, and the description."""
        verdict, binds = verdict_of(self.figures), "; ".join(self.binding)
        said = (verdict, binds and f"What binds: {binds}", self.description())
        return ". ".join(filter(None, said))

    def value(self, key: str) -> float | None:
        """Return the value of a figure by its key, such as "angle_deg"; KeyError without it."""
        return {figure.key: figure for figure in self.figures}[key].value

    def summary(self) -> dict[str, Any]:
        """Return the content of summary.json: the list "figures", "verdict", further entries."""
        figures = self.figures
        verdict = {
            "state": overall(figures),
            "words": verdict_of(figures) or None,
            "binding": list(self.binding),
        }
        return {"figures": [one.as_dict() for one in figures], "verdict": verdict, **self.entries()}

    def show(self, height: int = 640) -> EmbeddedPage:
        """Return the skin in space, as of `StoredRun.show`; its files must be written."""
        if self.folder is None:
            raise OutputError("this result has no files yet: write them by write_summary.")
        return view_of(self.folder, height)

    def __repr__(self) -> str:
        # Not its fields, which are all arrays of the run; nor its sentence, which ranks share.
        return f"{type(self).__name__}({'' if self.folder is None else repr(str(self.folder))})"

    def __str__(self) -> str:
        content = {**self.summary(), "warnings": list(self.notes)}
        del content["figures"]
        return as_text(Summary({figure.key: figure for figure in self.figures}, content))

    def _repr_html_(self) -> str:
        return figures_html(self.figures)


def state_figures(pressure: float, state: Equilibrium | None, parts: int) -> tuple[Figure, ...]:
    """Return the figures of an equilibrium that every skin has, of one of its equal parts.

    The pressure is in Pa. Others are unknown where there is no equilibrium.
    """
    return (
        Figure("pressure", "pa", pressure),
        Figure("volume", "m3", None if state is None else parts * state.volume),
        Figure("stretch", "use", None if state is None else state.stretch_use),
    )


def write_summary(comm: MPI.Comm, folder: Path | str, result: RunResult) -> dict[str, Any]:
    """Write summary.json and return its content, the first rank's on all ranks (collective).

    Raises:
        OutputError: It cannot be written; on all ranks. The folder holds a run that is not open; on
            all ranks.
    """
    folder = Path(folder)
    content = {**result.summary(), "ranks": comm.size, "versions": versions()}
    run = run_of(folder)
    logged = [] if run is None else run.warnings.texts
    said = [*logged, *result.notes, *warnings_of(content)]
    content["warnings"] = list(dict.fromkeys(said))
    content = dict(comm.bcast(content, root=0))  # each rank has its own clock

    def write() -> None:
        require_open(folder)
        write_json(folder / SUMMARY, content)

    guarded(comm, folder, write)
    object.__setattr__(result, "folder", folder)  # of frozen dataclasses, which it is no field of
    return content


def shape_problem(result: DesignResult) -> ShapeProblem:
    """Return the problem of a result, which must be the design of a shape, or a ParameterError."""
    require_kind("result", result, DesignResult, "the DesignResult of optimize")
    if not isinstance(result.problem, ShapeProblem):
        raise ParameterError(
            f"the result is that of a {type(result.problem).__name__}; only the design of a shape "
            "has these files. For a tile use toros_fem.products.tiles."
        )
    return result.problem


def level_figures(history: Sequence[Iteration]) -> list[dict[str, float]]:
    """Return steps, cost and last objective on each mesh, the coarsest first."""
    figures = []
    for level in sorted({row.level for row in history}):
        rows = [row for row in history if row.level == level]
        figures.append(
            {
                "iterations": rows[-1].iteration - rows[0].iteration,
                "objective_first": rows[0].objective,
                "objective_last": rows[-1].objective,
                **_cost_of(rows),
                "seconds": sum(row.seconds for row in rows),
            }
        )
    return figures


def _cost_of(rows: Sequence[Iteration]) -> dict[str, int]:
    names = ("rejected", "newton_steps", "factorisations")
    return {name: sum(getattr(row, name) for row in rows) for name in names}


@dataclass(frozen=True, eq=False, repr=False)
class PrintedResult(RunResult):
    """The design of a shape and its print: what `write_results` writes.

    Attributes:
        metrics: Metrics of the print, by key; empty without an equilibrium.
        intervals: Half-width of the interval of each metric, by key, as far as they are known.
        shape: How far its shape is from the target, as of `Miss.values`; empty if the design
            compares no positions, and without an equilibrium.
        tolerances: What counts as reached.
        finer: Positions that a finer mesh tells, at all vertices of the print's mesh, (n, 3), in m;
            None shows those of the print's mesh.
    """

    design: DesignResult
    printed: PrintedDesign
    metrics: Mapping[str, float]
    intervals: Mapping[str, float] = field(default_factory=dict)
    config: Scene | Table | None = None
    seconds: Mapping[str, float] = field(default_factory=dict)
    shape: Mapping[str, float] = field(default_factory=dict)
    tolerances: Tolerances = DEFAULT
    finer: Floats | None = None

    @property
    def problem(self) -> ShapeProblem:
        """The design problem."""
        return shape_problem(self.design)

    @property
    def figures(self) -> tuple[Figure, ...]:
        """Metrics, miss of the shape, pressure and volume of the print."""
        made = self.printed.evaluation
        state = None if made is None else made.equilibrium
        shape = shape_figures(self.shape, self.intervals, self.tolerances)
        of_state = state_figures(self.pressure, state, self.problem.parts)
        poses = [
            Figure(f"{prefix_of(one.problem)}pressure", "pa", one.equilibrium.pressure)
            for one in (() if made is None else made.poses)
        ]
        return (*self.metric_figures, *shape, *of_state, *poses)

    @property
    def pressure(self) -> float:
        """Pressure of the print in Pa, the largest of all chambers; that of the design without."""
        return max(self.pressures, default=0.0)

    @property
    def pressures(self) -> tuple[float, ...]:
        """Pressure of each chamber of the print in Pa; those of the design without."""
        return (self.printed.evaluation or self.design.final).equilibrium.pressures

    @property
    def most_pressure(self) -> float:
        """Largest pressure in Pa that the problem allows, of all chambers."""
        physics = self.problem.physics
        pairs = zip(physics.pressures, physics.pressure_ranges, strict=True)
        return max((bounds[1] if bounds else most for most, bounds in pairs), default=0.0)

    @property
    def metric_figures(self) -> tuple[Figure, ...]:
        """The metrics of the print."""
        return tuple(
            metric.figure(
                self.metrics.get(metric.key),
                self.intervals.get(metric.key),
                self.tolerances.figure,
            )
            for metric in self.problem.all_metrics
        )

    @property
    def binding(self) -> tuple[str, ...]:
        """What keeps the print from its targets, as far as it is known."""
        state = overall(self.figures)
        if state in (None, State.REACHED):
            return ()
        found = [*self._pressures_at_bounds(), *self._stretched(), *self._cleaned_away()]
        if (growth := growth_of_miss(self.design.history, self.design.final.shape)) > LOST:
            found.append(f"widths: printable lines miss the target {growth:.1f} times as much")
        if state is State.NOT_CERTAIN:
            known = all(figure.interval is not None for figure in self.figures if figure.state)
            wide = "its interval reaches over the tolerance"
            found.append(f"error by the mesh: {wide if known else 'it is not estimated'}")
        return tuple(found)

    @property
    def notes(self) -> list[str]:
        """What is not as usual in the equilibrium of the print."""
        made = self.printed.evaluation
        if made is None:
            return []
        states = [one.equilibrium for one in made.every]
        return notes_at([(state.pressure, state.condition.sentences) for state in states])

    @property
    def shown_metrics(self) -> Mapping[str, float]:
        """Metrics of the print by key, those of the design where it has no equilibrium."""
        made = self.printed.evaluation is not None
        return self.metrics if made else self.design.history[-1].metrics

    def entries(self) -> dict[str, Any]:
        """Return design, print and cost."""
        design, simulated = self.design, self.printed.evaluation
        return {
            "pressures_pa": list(self.pressures),
            "equilibrium": simulated and simulated.equilibrium.reason,
            "printed_objective": simulated and simulated.shape,
            "printed_failure": self.printed.failure or None,
            **self._poses(),
            **self._designed(),
            **self._cleaned(),
            **self._cost(),
            "seconds": {**design.seconds, **self.seconds},
            "inputs": None if self.config is None else self.config.as_dict(),
        }

    def description(self) -> str:
        """Return metrics, pressure and cost in a sentence."""
        first, last = (self.design.history[k].objective for k in (0, -1))
        designed = self.design.history[-1].metrics
        told = []
        for metric, figure in zip(self.problem.all_metrics, self.metric_figures, strict=True):
            beside = f" ({metric.formatted(designed[metric.key])} as designed)"
            told.append(figure.words + (beside if metric.key in designed else ""))
        steps = f"objective down {first / last:.0f} times" if last > 0 else f"objective {last:g}"
        return self.told(told, steps)

    def told(self, metrics: Sequence[str], steps: str) -> str:
        """Return a sentence of what is said of the metrics and of the steps of the design."""
        shape = shape_figures(self.shape, self.intervals, self.tolerances)
        said = [*metrics, *(figure.words for figure in shape if figure.state)]
        at = f"{self.pressure / 1e3:.2f} kPa"
        if self.pressure < (1 - NEAR_BOUND) * self.most_pressure:
            at += f" (the pump gives {self.most_pressure / 1e3:g} kPa)"
        return (
            f"{', '.join(said)} as printed at {at}, {steps}, "
            f"{self.printed.after.summary()['islands']} islands, "
            f"{self.seconds.get('total', 0.0):.0f} s"
        )

    def _poses(self) -> dict[str, Any]:
        """Return the states of further poses, by their names; nothing without any."""
        made = self.printed.evaluation
        if made is None or not made.poses:
            return {}
        first = made.problem
        found = {}
        for one in made.poses:
            problem, state = one.problem, one.equilibrium
            assert isinstance(problem, ShapeDesign)
            assert isinstance(first, ShapeDesign)
            found[str(problem.case.name)] = {
                "pressures_pa": list(state.pressures),
                "volume_m3": problem.parts * state.volume,
                "stretch_use": state.stretch_use,
                "equilibrium": state.reason,
                "on_the_curve": first.case.differs_in_pressure_alone(problem.case),
            }
        return {"poses": found}

    def _pressures_at_bounds(self) -> list[str]:
        ranges = self.problem.physics.pressure_ranges
        key = "pressure_bounds up to" if self.config is None else "pressure ="
        advised = not self._stretched()
        return [
            f"pressure at its bound, {bounds[1] / 1e3:g} kPa"
            + f'. If the pump gives more: {key} "{MORE * bounds[1] / 1e3:.3g} kPa"' * advised
            for pressure, bounds in zip(self.pressures, ranges, strict=True)
            if bounds and abs(pressure - bounds[1]) < NEAR_BOUND * bounds[1]
        ]

    def _stretched(self) -> list[str]:
        made = self.printed.evaluation
        used = 0.0 if made is None else max(one.equilibrium.stretch_use for one in made.every)
        return [f"{used:.0%} of the stretch bounds are used"] if used >= STRETCHED else []

    def _cleaned_away(self) -> list[str]:
        """Return how cleaning changed the print."""
        cleaned, before, after = self.printed.cleaned, self.printed.before, self.printed.after
        counts = (
            (len(cleaned.dropped), "island", "removed"),
            (len(cleaned.bridged), "island", "joined"),
            (len(cleaned.filled), "hole", "filled"),
            (len(before.lines.narrow) - len(after.lines.narrow), "narrow line", "widened"),
            (len(before.gaps.narrow) - len(after.gaps.narrow), "narrow gap", "changed"),
        )
        told = [f"{n} {what}{'s' * (n > 1)} {done}" for n, what, done in counts if n > 0]
        return [f"print limits: {', '.join(told)}"] if told else []

    def _designed(self) -> dict[str, Any]:
        """Return what is known of the design with its grey borders."""
        problem, final, history = self.problem, self.design.final, self.design.history
        first, last = history[0], history[-1]
        limits, widths = problem.length_scale, final.length_scale
        return {
            "objective_first": first.objective,
            "objective_last": last.objective,
            "design": {
                **last.metrics,
                "shape": last.shape,
                "perimeter_m": final.perimeter and self.problem.parts * final.perimeter,
                "volume_m3": self.problem.parts * final.equilibrium.volume,
                "kkt_residual": last.kkt if np.isfinite(last.kkt) else None,
            },
            "gradient_norm_first": first.gradient_norm,
            "gradient_norm_last": last.gradient_norm,
            "volume_fraction": last.volume_fraction,
            "grey_level": last.grey_level,
            "length_scale": None if limits is None or widths is None else limits.summary(widths),
        }

    def _cleaned(self) -> dict[str, Any]:
        """Return widths and islands of the print, before and after it was cleaned."""
        printed = self.printed
        return {
            "manufacture": printed.after.summary(),
            "dropped": {
                "islands": len(printed.cleaned.dropped),
                "islands_mm2": 1e6 * sum(piece.area for piece in printed.cleaned.dropped),
                "islands_bridged": len(printed.cleaned.bridged),
                "holes_filled": len(printed.cleaned.filled),
                "before": printed.before.summary(),
            },
        }

    def _cost(self) -> dict[str, Any]:
        """Return sizes, steps and the reason of the end."""
        history, skin = self.design.history, self.problem.skin
        return {
            "iterations": history[-1].iteration,
            "levels": level_figures(history),
            **_cost_of(history),
            "triangles": len(skin.pattern.panel),
            "vertices": len(skin.pattern.points),
            "parts_by_symmetry": self.problem.parts,
            "linear_solver": self.problem.solver.linear_solver,
            "reason": self.design.reason,
        }
