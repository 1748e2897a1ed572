"""Result of the design of an actuator: its print, how it was searched, its errors, its curve."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, ClassVar, Protocol

import numpy as np

from toros_fem.measures.figures import Figure, State, overall
from toros_fem.products.actuators.discovery import Discovery
from toros_fem.products.actuators.estimates import MetricErrors
from toros_fem.products.actuators.pressure import CurveFigures
from toros_fem.results.result import PrintedResult


@dataclass(frozen=True, eq=False)
class SearchRecord:
    """How a design was searched.

    Attributes:
        seed: Seed of the start that led to it.
        start: What it began with: "random", "pattern" (a given density), "print" (of another
            design) or "relaxed" (line families from a random start).
        rounds: How often it was asked again for what its print missed.
        tried: Ways that were tried because printable lines had lost the shape, one after the other.
        starts: Objective of each start by seed, infinite without an equilibrium; None of one start.
        lines: The lines that it was made of; None of densities.
        densities_kept: Whether densities that began with these lines were better.
    """

    seed: int
    start: str
    rounds: int
    starts: Mapping[int, float] | None = None
    lines: Discovery | None = None
    densities_kept: bool = False
    tried: tuple[str, ...] = ()

    @property
    def laid(self) -> bool:
        """Whether the print is one of laid lines, beside which there is no design by densities."""
        return self.lines is not None and not self.densities_kept

    def entries(self) -> dict[str, Any]:
        """Return it as summaries hold it."""
        found: dict[str, Any] = {"seed": self.seed, "start": self.start, "rounds": self.rounds}
        if self.starts is not None:
            found["starts"] = {
                str(seed): value if np.isfinite(value) else None
                for seed, value in self.starts.items()
            }
        if self.tried:
            found["tried"] = list(self.tried)
        if self.lines is not None:
            found |= {**self.lines.figures(), "densities_kept": self.densities_kept}
        return found


class TrialResult(Protocol):
    """What the print was simulated at, beyond its curve."""

    NAME: ClassVar[str]  # its entry in summaries

    @property
    def figures(self) -> tuple[Figure, ...]:
        """The most important numbers."""

    @property
    def words(self) -> str:
        """It in words."""

    @property
    def notes(self) -> Sequence[str]:
        """What is not as usual there, as sentences."""

    def entries(self) -> dict[str, Any]:
        """Return it as summaries hold it."""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class SkinDesign(PrintedResult):
    """The design of an actuator and its print, how it was found, and what the print does.

    Attributes:
        search: How it was found.
        errors: Errors of its metrics; None if they were not estimated.
        curve: What the print does over the pressure; None if this was left out.
        trial: What it was simulated at besides, of a walker or a gripper for instance.
        corrections: How often it could be asked again for what its print missed.
        pose_doubts: Further poses that inflating from rest does not reach, as sentences.
    """

    search: SearchRecord
    errors: MetricErrors | None = None
    curve: CurveFigures | None = None
    trial: TrialResult | None = None
    corrections: int = 0
    pose_doubts: Sequence[str] = ()

    def with_errors(self, errors: MetricErrors) -> SkinDesign:
        """Return it with errors, and with the values and the shape that they tell."""
        told = errors.told
        metrics, shape = (
            {k: told.get(k, v) for k, v in x.items()} for x in (self.metrics, self.shape)
        )
        return replace(
            self,
            errors=errors,
            intervals=errors.intervals,
            metrics=metrics,
            shape=shape,
            finer=errors.shape,
        )

    @property
    def figures(self) -> tuple[Figure, ...]:
        """Metrics, pressure and volume of the print, and those of its trial."""
        return (*super().figures, *(() if self.trial is None else self.trial.figures))

    @property
    def notes(self) -> list[str]:
        """What is not as usual in the equilibria of the print, its curve and its trial."""
        curve = super().notes if self.curve is None else self.curve.notes
        return [*curve, *(() if self.trial is None else self.trial.notes)]

    @property
    def binding(self) -> tuple[str, ...]:
        """What keeps the print from its targets, as of `PrintedResult`, and its corrections."""
        found, rounds, state = list(super().binding), self.search.rounds, overall(self.figures)
        if self.search.tried and state in (State.MISSED, State.NOT_CERTAIN):
            found.append(f"printable lines lost the shape; tried: {', '.join(self.search.tried)}")
        if rounds >= self.corrections > 0 and state in (State.MISSED, State.NOT_CERTAIN):
            found.append(f"all {rounds} corrections are used")
        elif rounds and state is State.MISSED:
            found.append(f"correction {rounds} hardly helped")
        if self.curve is not None and self.curve.doubt is not None:
            found.append(self.curve.doubt)
        return (*found, *self.pose_doubts)

    def entries(self) -> dict[str, Any]:
        """Return design, print, search, errors, curve and cost."""
        found = {**self.search.entries(), **super().entries()}
        if self.errors is not None:
            found["errors"] = self.errors.as_dict()
        if self.curve is not None:
            found["curve"] = asdict(self.curve)
            del found["curve"]["notes"]  # they are with the warnings
        if self.trial is not None:
            found[self.trial.NAME] = self.trial.entries()
        return found

    def description(self) -> str:
        """Return metrics, pressure and cost in a sentence."""
        told = super().description()
        if self.search.laid and self.search.lines is not None:
            laid = len(self.search.lines.rounds)
            words = [figure.words for figure in self.metric_figures]
            told = self.told(words, f"lines laid {laid} times")
        doubt = "" if self.errors is None else self.errors.words
        tried = "" if self.trial is None else self.trial.words
        start = f"from a {self.search.start} start, seed {self.search.seed}"
        if self.search.start == "print":
            start = "from the print of another design"
        return "; ".join(filter(None, (told, start, doubt, tried)))
