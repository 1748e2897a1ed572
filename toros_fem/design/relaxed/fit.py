"""Two families of lines that stand for shares in many directions."""

from __future__ import annotations

import numpy as np

from toros_fem.base.array_types import Floats, Ints
from toros_fem.design.lines.field import LineField
from toros_fem.meshes.pattern import Pattern

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
