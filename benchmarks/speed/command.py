"""The benchmark `speed`: solves that are replayed, and their counts.

    python -m benchmarks speed
    python -m benchmarks speed --against ../other --rounds 10

Seconds are CPU seconds of one thread. Two designs that differ by rounding take different steps, so
that their times compare luck; here both states of the code solve the same equilibria. With
`--against` each replay is solved in turn by this checkout and by another one, whose package is
imported in its place. Printed is this one's time over the other's, with the interval that holds
its mean with 95 %, from the pairs of a round; and how many Newton steps, factorisations and linear
solves more or less it takes. The first round warms up and does not count.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import t as student

from benchmarks.bench import ROOT, Case, Command, Row, show, write
from benchmarks.speed.replays import ANSWER, QUICK, REPLAYS

COUNTS = ("Newton steps", "factorisations", "linear solves")
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def ratio_interval(
    one: Sequence[float], other: Sequence[float], level: float = 0.95
) -> tuple[float, float, float]:
    """Return the ratio of paired times, one over other, and the ends of its interval.

    Logarithms of ratios are averaged: a slow machine makes both of a pair slow. With a single pair
    the interval is everything.
    """
    logs = np.log(np.asarray(one) / np.asarray(other))
    mean, count = float(logs.mean()), len(logs)
    if count < 2:
        return float(np.exp(mean)), 0.0, float("inf")
    half = float(student.ppf((1 + level) / 2, count - 1) * logs.std(ddof=1) / np.sqrt(count))
    return float(np.exp(mean)), float(np.exp(mean - half)), float(np.exp(mean + half))


class Player:
    """A process that plays replays with the package of a checkout."""

    def __init__(self, checkout: Path) -> None:
        script = Path(__file__).with_name("replays.py")
        environment = {**os.environ, **ONE_THREAD, "PYTHONPATH": str(checkout)}
        self._process = subprocess.Popen(
            [sys.executable, str(script)], env=environment, cwd=checkout,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        package = Path(str(self._answer()["package"]))
        if not package.is_relative_to(checkout.resolve()):
            raise RuntimeError(f"{checkout} holds no package: that of {package} was imported")

    def __enter__(self) -> Player:
        return self

    def __exit__(self, *_: object) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()

    def play(self, name: str) -> dict[str, Any]:
        """Return what a replay takes."""
        assert self._process.stdin is not None
        print(name, file=self._process.stdin, flush=True)
        found = self._answer()
        if "failure" in found:
            raise RuntimeError(f"{name}: {found['failure']}")
        return found

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if line.startswith(ANSWER):
                found: dict[str, Any] = json.loads(line.removeprefix(ANSWER))
                return found
        raise RuntimeError("the process of the replays ended")


def compare(checkout: Path, names: Sequence[str], rounds: int) -> list[Row]:
    """Return the ratio of times and the differences of counts to another checkout."""
    found: dict[str, list[tuple[dict[str, Any], dict[str, Any]]]] = {name: [] for name in names}
    with Player(ROOT) as here, Player(checkout) as there:
        for number in range(rounds + 1):
            for name in names:
                # Who begins changes from round to round.
                order = (here, there) if number % 2 else (there, here)
                played = {player: player.play(name) for player in order}
                if number:
                    found[name].append((played[here], played[there]))
    rows = []
    total = np.zeros((2, rounds))
    for name, pairs in found.items():
        spent = np.array([[pair[side]["seconds"] for pair in pairs] for side in (0, 1)])
        total += spent
        one, other = pairs[0]
        if abs(one["volume"] / other["volume"] - 1) > 1e-6:
            print(f"{name}: ANOTHER equilibrium, {one['volume']:.6g} and {other['volume']:.6g} m³")
        rows.append(_ratio(name, spent))
        rows += [
            Row("comparison", name, "", count, one[count], reference=other[count])
            for count in COUNTS
        ]
    return [*rows, _ratio("all", total)]


def _ratio(name: str, spent: Any) -> Row:
    ratio, low, high = ratio_interval(*spent)
    note = f"95 %: {low:.3f} to {high:.3f}"
    return Row("comparison", name, "", "time ratio", ratio, seconds=spent[0].mean(), note=note)


def options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the comparison."""
    parser.add_argument("--against", type=Path, metavar="CHECKOUT", help="compare with this one")
    parser.add_argument("--rounds", type=int, default=5, help="of a comparison")


def instead(given: argparse.Namespace) -> bool:
    """Compare two checkouts if the command line asks for it."""
    if given.against is None:
        return False
    names = [name for name in (QUICK if given.quick else REPLAYS) if given.only in name]
    rows = compare(given.against.resolve(), names, given.rounds)
    show(rows)
    if given.rows:
        write(given.rows, rows)
    return True


def replayed(name: str, rounds: int) -> Iterator[Row]:
    """Return what a replay takes, the fastest of some rounds; the first one warms up."""
    from benchmarks.speed.replays import play

    found = min((play(name) for _ in range(rounds + 1)), key=lambda one: one["seconds"])
    place = ("replay", name, f"{found['triangles']}")
    yield Row(*place, "CPU time", found["seconds"], "s")
    for count in COUNTS:
        yield Row(*place, count, found[count])
    yield Row(*place, "residual", found["residual"], "", 0.0)


def cases(quick: bool) -> list[Case]:
    """Return a case for each replay."""
    names, rounds = (QUICK, 1) if quick else (tuple(REPLAYS), 3)
    return [Case("replay", partial(replayed, name, rounds), name) for name in names]


COMMAND = Command(
    about=__doc__,
    cases=cases,
    serial=True,
    options=options,
    instead=instead,
)
