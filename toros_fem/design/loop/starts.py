"""Several random starts on a coarse mesh, shared out over the ranks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import NoEquilibriumError
from toros_fem.base.mpi import raise_together, together
from toros_fem.design.loop.carried import CarriedDesign
from toros_fem.design.loop.journal import Journal
from toros_fem.design.loop.levels import gathered
from toros_fem.design.loop.loop import DesignResult, optimize
from toros_fem.design.loop.options import DesignOptions
from toros_fem.design.loop.problem import DesignProblem


@dataclass(frozen=True, eq=False)
class BestStart:
    """The best of several starts.

    Attributes:
        design: Its design, on every rank.
        seed: Its seed.
        objectives: Final T of each seed; infinite without an equilibrium.
    """

    design: CarriedDesign
    seed: int
    objectives: dict[int, float]


def best_start(
    comm: MPI.Comm,
    make: Callable[[MPI.Comm], DesignProblem],
    options: DesignOptions,
    seeds: Sequence[int],
    journal: Journal | None = None,
) -> BestStart:
    """Design each of several random starts on one rank alone; return the best (collective).

    The ranks share out the seeds. A design whose widths are satisfied is better than one whose are
    not; of these the one with the lower T is, and of equals the one that comes first. The result
    does not depend on the number of ranks, where each has as many threads.

    Args:
        make: Makes the problem on a communicator of one rank.
        seeds: Seeds of the noise, none of them twice.
        journal: Each seed has a branch of its own.

    Raises:
        NoEquilibriumError: No start has an equilibrium.
    """
    found: dict[int, tuple[bool, float]] = {}
    best: CarriedDesign | None = None
    failure: NoEquilibriumError | None = None
    with together(comm):
        mine = seeds[comm.rank :: comm.size]
        problem = make(MPI.COMM_SELF) if mine else None
        for seed in mine:
            assert problem is not None
            try:
                part = (journal or Journal()).branch(f"seed-{seed}")
                result = optimize(problem, options, seed=seed, journal=part)
            except NoEquilibriumError as caught:
                failure = caught
                continue
            score = _score(result, options)
            if not found or score < min(found.values()):
                best = gathered(result)
            found[seed] = score
    every: dict[int, tuple[bool, float]] = {}
    for part in comm.allgather(found):
        every.update(part)
    if not every:
        raise_together(comm, failure)
    seed = min((s for s in seeds if s in every), key=lambda s: every[s])
    owner = list(seeds).index(seed) % comm.size
    design = comm.bcast(best if comm.rank == owner else None, root=owner)
    assert design is not None
    return BestStart(design, seed, {s: every[s][1] if s in every else np.inf for s in seeds})


def _score(result: DesignResult, options: DesignOptions) -> tuple[bool, float]:
    """Return whether the widths are violated, and T: smaller is better."""
    limits, widths = result.problem.length_scale, result.final.length_scale
    violated = False
    if options.stages[-1].constrained and limits is not None and widths is not None:
        violated = bool(np.any(widths > limits.epsilon))
    return violated, result.final.objective
