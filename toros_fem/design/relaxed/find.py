"""The relaxed design in two stages: which families of lines a skin needs, from a random start."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import Count, Length, Positive, Table, key
from toros_fem.base.mpi import on_first_rank
from toros_fem.base.validation import Floats, Ints, require_count, require_kind
from toros_fem.design.lines.field import LineField
from toros_fem.design.loop.fields import CarriedDesign
from toros_fem.design.loop.journal import Journal
from toros_fem.design.loop.loop import Callback, optimize
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.design.loop.shape_design import ShapeProblem
from toros_fem.design.loop.steps import by_cell
from toros_fem.design.mma.optimizer import MMAOptions
from toros_fem.design.relaxed.problem import (
    Directions,
    FixedDirections,
    FreeDirections,
    LineShares,
    Share,
    relaxed_problem,
)
from toros_fem.mechanics.skin.designs import crossing_of_widths
from toros_fem.meshes.pattern import Pattern

# Largest change of a variable in one step.
MOVE = 0.1
# A stage ends when T falls by a smaller fraction in ten steps.
LEAST_DECREASE = 0.05


class RelaxedOptions(Table):
    """Numbers of the relaxed design."""

    directions: Directions = key(12, "number of fixed directions of the first stage")
    share_limit: Share = key(0.35, "limit on the sum of their shares")
    family_limits: tuple[Share, Share] = key(
        (0.3, 0.3), "limits on the shares of the two families of the second stage"
    )
    radius: Length | None = key(
        None, "radius of the smoothing; none takes a tenth of the skin's size"
    )
    share_weight: Positive | None = key(
        None, "factor on the mean sum of shares in T; none leaves this cost out"
    )
    iterations: tuple[Count, Count] = key((40, 40), "largest number of steps of either stage")
    more_iterations: Count = key(15, "largest number of steps where an earlier result is continued")
    width_ratio: Positive = key(
        1.0,
        "width that the lines of one family will have over that of the other: where few wide lines "
        "cross many thin ones, crossings stiffen less",
    )

    def __post_init__(self) -> None:
        FreeDirections(self.family_limits)

    def stage(self, number: int) -> DesignOptions:
        """Return the options of the design loop in one of the two stages."""
        return DesignOptions(
            (Stage(self.iterations[number]),),
            min_relative_decrease=LEAST_DECREASE,
            mma=MMAOptions(move=MOVE),
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class RelaxedResult(CarriedDesign):
    """The result of a relaxed design, which another one may go on from.

    Its density holds the variables of the second stage, before smoothing, (t, 6); its history and
    seconds are those of both stages.

    Attributes:
        start: Families of the random start: those of all fixed directions.
        field: Share and direction of the two families in each triangle.
        reason: Why the second stage ended, as a sentence.
    """

    positions: Floats
    start: LineField
    field: LineField
    reason: str


def find_lines(
    design: ShapeProblem,
    options: RelaxedOptions | None = None,
    *,
    seed: int = 0,
    callback: Callback | None = None,
    after: RelaxedResult | None = None,
    journal: Journal | None = None,
) -> RelaxedResult:
    """Find line families that take a skin to its target, from random ones (collective).

    First the shares of fixed directions are designed: the problem is then nearly convex, and
    coherent families appear from noise. Two families are fitted to them, whose shares and
    continuous directions are designed on.

    Args:
        design: What is to be designed, on a coarse mesh: target, supports, loads and prescribed
            densities. Its filter and its width constraints play no part.
        options: Numbers of the relaxed design; None takes the defaults.
        seed: Seed of the random start; the same on any number of ranks.
        callback: Called after each iteration, on every rank.
        after: A result on the same mesh, of another target for instance, whose second stage is
            continued; `seed` then plays no part.
        journal: As of `optimize`, for both stages.

    Raises:
        NoEquilibriumError: There is no equilibrium for the start.
    """
    begin = time.perf_counter()
    require_kind("design", design, ShapeProblem, "a ShapeProblem, a ShapeDesign for instance")
    skin = design.skin
    options, seed = on_first_rank(skin.comm, partial(_settings, options, seed))
    count = len(skin.pattern.panel)
    if after is not None and len(after.density) != count:
        raise ParameterError(
            f"after is a result on {len(after.density)} triangles; this mesh has {count}. "
            "Continue it on its own mesh."
        )
    radius = options.radius or skin.pattern.size / 10
    cost = options.share_weight
    crossing = crossing_of_widths(options.width_ratio)
    free, rules = FreeDirections(options.family_limits), options.stage(1)
    run = partial(optimize, callback=callback, journal=journal)
    if after is None:
        fixed = FixedDirections(options.directions, options.share_limit)
        first = relaxed_problem(design, fixed, radius, cost, crossing)
        drawn = first.fields.start(seed)
        start = _field(first, first.fields.forward(drawn)[1])
        found = run(first, options.stage(0), start=drawn)
        field = fitted_pair(_field(first, found.final.projected))
        carried = CarriedDesign(
            skin.pattern,
            free.variables(field.shares, field.angles),
            found.pressures,
            first.physics.shape_of(found.final.equilibrium),
            history=found.history,
        )
    else:
        start, carried = after.start, after
        rules = replace(rules, stages=(Stage(options.more_iterations),))
    second = relaxed_problem(design, free, radius, cost, crossing)
    result = run(second, rules, after=carried)
    return RelaxedResult(
        skin.pattern,
        by_cell(skin, result.density),
        result.pressures,
        positions=second.physics.shape_of(result.final.equilibrium),
        history=result.history,
        seconds={"relaxed": time.perf_counter() - begin},
        start=start,
        field=_field(second, result.final.projected),
        reason=result.reason,
    )


def _field(problem: ShapeProblem, material: Floats) -> LineField:
    """Return the line families of a relaxed problem, on every rank (collective)."""
    assert isinstance(problem.fields, LineShares)
    return problem.fields.line_field(material)


def _settings(options: RelaxedOptions | None, seed: int) -> tuple[RelaxedOptions, int]:
    """Return options and seed, checked."""
    require_count(0, seed=seed)
    require_kind("options", options, (RelaxedOptions, type(None)), "RelaxedOptions, or None")
    return options or RelaxedOptions(), seed


# Number of directions that are tried for the pair to start from.
TRIED = 90
# Steps of the search for the nearest two directions of each triangle.
STEPS = 30
# Weight of the starting pair against the shares, so that a family without lines has a direction.
PRIOR = 1e-9


def fitted_pair(field: LineField) -> LineField:
    """Return two families that stand for many, for each triangle.

    In each triangle every direction goes to the nearer of two; these are then the means of their
    directions by double angles, weighted by the shares, and so on. The search starts from the best
    pair of the whole panel, so that a family is the same one all over it. The first is the one
    nearer to the second axis of the first panel's chart. Panels that are sewn together exchange
    their pairs where the directions fit better so.
    """
    pattern, areas = field.pattern, field.pattern.areas
    shares = np.zeros((len(areas), 2))
    angles = np.zeros((len(areas), 2))
    for panel in range(len(pattern.panel_names)):
        cells = np.flatnonzero(pattern.panel == panel)
        s, t = field.shares[cells], field.angles[cells]
        shares[cells], angles[cells] = _pair_of_cells(s, t, _pair_of_all(s, t, areas[cells]))
    _match_panels(pattern, shares, angles)
    return LineField(pattern, shares, angles % np.pi)


def _pair_of_all(shares: Floats, angles: Floats, areas: Floats) -> Floats:
    """Return the two directions that are nearest to all lines of a panel, (2,).

    The one nearer to the second axis of the chart comes first.
    """
    tried = np.pi * np.arange(TRIED) / TRIED
    weight = (areas[:, None] * shares).ravel()
    # Lines by direction, so that the cost does not depend on the number of triangles.
    place = np.round(angles.ravel() % np.pi / np.pi * TRIED).astype(int) % TRIED
    histogram = np.bincount(place, weight, minlength=TRIED)
    near = np.cos(2 * (tried[:, None] - tried))
    quality = np.maximum(near[:, None, :], near[None, :, :]) @ histogram
    first, second = np.unravel_index(int(np.argmax(quality)), quality.shape)
    pair = tried[[first, second]]
    return pair[np.argsort(-np.abs(np.sin(pair)), kind="stable")]


def _pair_of_cells(shares: Floats, angles: Floats, start: Floats) -> tuple[Floats, Floats]:
    """Return shares and angles of the two families of each triangle, both (n, 2)."""
    pair = np.tile(start, (len(shares), 1))
    double, prior = np.exp(2j * angles), PRIOR * np.exp(2j * start)
    mine: Floats = np.zeros((len(shares), 2, shares.shape[1]))
    for step in range(STEPS + 1):
        near = [np.cos(2 * (pair[:, k, None] - angles)) for k in range(2)]
        first = near[0] >= near[1]
        mine = np.stack([shares * first, shares * ~first], axis=1)
        if step < STEPS:
            pair = np.angle((mine * double[:, None]).sum(axis=2) + prior) / 2
    return mine.sum(axis=2), pair


def _match_panels(pattern: Pattern, shares: Floats, angles: Floats) -> None:
    """Exchange the families of panels, in place, so that they fit across the seams."""
    sides, turns = pattern.edges.sides[pattern.edges.inner], pattern.chart_turns
    panels: Ints = pattern.panel[sides]
    known = {0}
    while len(known) < len(pattern.panel_names):
        gain: dict[int, float] = {}
        for order in (1, -1):
            here, there = sides[:, ::order].T
            at = np.isin(panels[:, ::order][:, 0], list(known))
            at &= ~np.isin(panels[:, ::order][:, 1], list(known))
            a, b = here[at], there[at]
            turned = angles[a] + order * turns[at, None]
            weight = np.sqrt(shares[a][:, :, None] * shares[b][:, None, :])
            fit = weight * np.cos(2 * (turned[:, :, None] - angles[b][:, None, :]))
            score = fit[:, 0, 0] + fit[:, 1, 1] - fit[:, 0, 1] - fit[:, 1, 0]
            for panel in np.unique(pattern.panel[b]):
                part = float(score[pattern.panel[b] == panel].sum())
                gain[int(panel)] = gain.get(int(panel), 0.0) + part
        if not gain:  # a skin of several pieces
            known.add(next(p for p in range(len(pattern.panel_names)) if p not in known))
            continue
        panel = max(gain, key=lambda p: abs(gain[p]))
        if gain[panel] < 0:
            cells = pattern.panel == panel
            shares[cells], angles[cells] = shares[cells][:, ::-1], angles[cells][:, ::-1]
        known.add(panel)
