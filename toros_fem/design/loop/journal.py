"""What a run keeps of its design loops on disk, as the loops see it."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from mpi4py import MPI

from toros_fem.base.archive import Archive
from toros_fem.base.array_types import Floats
from toros_fem.base.errors import CheckpointError
from toros_fem.design.loop.options import Iteration
from toros_fem.design.loop.problem import DesignProblem, Evaluation
from toros_fem.design.loop.variables import by_cell

# Kind of the archives: states that any number of ranks can go on from, equal on all ranks.
KIND = "checkpoint"


class JournalEntry(Protocol):
    """The place of one design loop or simulation in a journal; all methods are collective."""

    def saved(self) -> Archive | None:
        """Return the last checkpoint of an earlier, interrupted run; None without.

        From now on a stop waits for the next `offer`.

        Raises:
            CheckpointError: It cannot be read, or belongs to something else.
        """

    def offer(self, make: Callable[[], Archive], *, last: bool) -> None:
        """Offer a checkpoint, which is made and written if it is due.

        Args:
            make: Returns the checkpoint (collective).
            last: Whether it is the last one of this entry, which is always written.

        Raises:
            RunStoppedError: A signal asked for an end; the checkpoint is written.
            OutputError: It cannot be written.
        """

    def close(self) -> None:
        """Say that no checkpoint will come soon, so that a stop need not wait for it."""


class Journal(Protocol):
    """A sequence of entries, the same in a run that is resumed as in one that was not stopped."""

    def entry(self, comm: MPI.Comm, signature: str) -> JournalEntry:
        """Return the next entry (collective).

        Args:
            comm: Communicator of what it is for.
            signature: Tells what it is for, as of `signature_of`.
        """

    def branch(self, name: str) -> Journal:
        """Return a journal inside this one, with a sequence of its own."""


def signature_of(problem: DesignProblem, *parts: object) -> str:
    """Return a text that tells a problem and further values from others.

    Args:
        problem: The problem; its mesh counts.
        parts: Values whose `repr` tells them apart, options for instance.
    """
    found, pattern = hashlib.sha256(), problem.skin.pattern
    for array in (pattern.points, pattern.triangles, pattern.flat_points, pattern.flat_triangles):
        found.update(np.ascontiguousarray(array).tobytes())
    found.update(repr((type(problem).__name__, *parts)).encode())
    return found.hexdigest()


def kept_evaluation(
    journal: Journal | None, problem: DesignProblem, simulate: Callable[[], Evaluation]
) -> Evaluation:
    """Return an evaluation, from a journal if it is there already (collective).

    Args:
        journal: The journal; None keeps nothing.
        problem: The problem that is simulated.
        simulate: Returns the evaluation; it ends in a complete solve.

    Raises:
        NoEquilibriumError: As `simulate` does; a failure is not kept.
    """
    if journal is None:
        return simulate()
    entry = journal.entry(problem.comm, signature_of(problem))
    saved = entry.saved()
    if saved is not None:
        found = restored_evaluation(problem, saved)
        entry.close()
        return found
    entry.close()  # a stop need not wait for the simulation
    found = simulate()
    entry.offer(lambda: Archive(KIND, *saved_evaluation(problem, found)), last=True)
    return found


def saved_evaluation(
    problem: DesignProblem, evaluation: Evaluation
) -> tuple[dict[str, Floats], dict[str, Any]]:
    """Return arrays and numbers of an evaluation, without its gradients (collective).

    Args:
        problem: The problem, whose last simulation it is.
        evaluation: The evaluation.
    """
    e, skin = evaluation, problem.skin
    unknowns, response = problem.save_response(e.equilibrium)
    arrays = {
        "density": by_cell(skin, e.density),
        "filtered": by_cell(skin, e.filtered),
        "projected": by_cell(skin, e.projected),
        "unknowns": unknowns,
    }
    variants = problem.save_variants(e.variants)
    arrays |= {f"unknowns_{k}": state for k, (state, _) in enumerate(variants)}
    numbers = {
        "objective": e.objective,
        "shape": e.shape,
        "perimeter": e.perimeter,
        "length_scale": None if e.length_scale is None else [float(g) for g in e.length_scale],
        "dimensions": [np.ndim(a) for a in (e.density, e.filtered, e.projected)],
        "response": response,
        "spread": e.spread,
        "variants": [of_variant for _, of_variant in variants],
    }
    return arrays, numbers


def restored_evaluation(problem: DesignProblem, saved: Archive) -> Evaluation:
    """Return a saved evaluation, as if it had just been made (collective).

    Args:
        problem: The problem, on any number of ranks.
        saved: A checkpoint with what `saved_evaluation` returned.

    Raises:
        CheckpointError: It does not fit the problem.
    """
    numbers, skin = saved.numbers, problem.skin
    try:
        names = ("density", "filtered", "projected")
        rows = [saved.arrays[name][skin.owned_cells] for name in names]
        fields = [
            own.ravel() if dimension == 1 else own
            for own, dimension in zip(rows, numbers["dimensions"], strict=True)
        ]
        widths = numbers["length_scale"]
        response = problem.restore_response(
            fields[2], saved.arrays["unknowns"], numbers["response"]
        )
        variants = [
            (saved.arrays[f"unknowns_{k}"], of_variant)
            for k, of_variant in enumerate(numbers["variants"])
        ]
        return Evaluation(
            problem=problem,
            objective=float(numbers["objective"]),
            shape=float(numbers["shape"]),
            perimeter=numbers["perimeter"],
            length_scale=None if widths is None else np.array(widths),
            gradient=None,
            pressure_gradient=None,
            length_scale_gradients=None,
            residuals=None,
            density=fields[0],
            filtered=fields[1],
            projected=fields[2],
            equilibrium=response,
            seconds={},
            variants=problem.restore_variants(fields[1], variants),
            spread=numbers["spread"],
        )
    except (KeyError, IndexError, TypeError, ValueError) as fault:
        raise CheckpointError(f"a checkpoint does not fit its problem: {fault}") from None


def saved_rows(rows: Sequence[Iteration]) -> list[dict[str, Any]]:
    """Return rows of a history as JSON has them."""
    return [{**vars(row), "metrics": dict(row.metrics)} for row in rows]


def restored_rows(rows: Sequence[Mapping[str, Any]]) -> list[Iteration]:
    """Return rows of a history from JSON."""
    return [Iteration(**row) for row in rows]
