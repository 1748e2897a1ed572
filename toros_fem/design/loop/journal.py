"""What a run keeps of its design loops on disk, as the loops see it."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import CheckpointError, NoEquilibriumError
from toros_fem.base.files import Archive
from toros_fem.base.packages import __version__
from toros_fem.base.validation import Floats
from toros_fem.design.loop.problem import DesignProblem, Evaluation
from toros_fem.design.loop.steps import by_cell

# Kind of the archives: states that any number of ranks can go on from, equal on all ranks.
KIND = "checkpoint"
# Number of an archive that holds why a simulation has no equilibrium, and nothing else.
FAILURE = "failure"


class JournalEntry:
    """The place of one design loop or simulation in a journal; this one keeps nothing.

    All methods are collective.
    """

    def saved(self) -> Archive | None:
        """Return the last checkpoint of an earlier, interrupted run; None without.

        From now on a stop waits for the next `offer`.

        Raises:
            CheckpointError: It cannot be read, or belongs to something else.
        """
        return None

    def offer(self, make: Callable[[], Archive], *, last: bool) -> None:
        """Offer a checkpoint, which is made and written if it is due, or if it is the last one.

        Raises:
            RunStoppedError: A signal asked for an end; the checkpoint is written.
            OutputError: It cannot be written.
        """

    def close(self) -> None:
        """Say that no checkpoint will come soon, so that a stop need not wait for it."""


class Journal:
    """A sequence of entries, the same in a run that is resumed as in one that was not stopped.

    This one keeps nothing.
    """

    def entry(self, comm: MPI.Comm, signature: str) -> JournalEntry:
        """Return the next entry; `signature_of` tells what it is for (collective)."""
        return JournalEntry()

    def branch(self, name: str) -> Journal:
        """Return a journal inside this one, with a sequence of its own."""
        return self


def signature_of(problem: DesignProblem, *parts: object) -> str:
    """Return a text that tells a problem, its mesh, and further values by `repr` from others."""
    found, pattern = hashlib.sha256(), problem.skin.pattern
    for array in (pattern.points, pattern.triangles, pattern.flat_points, pattern.flat_triangles):
        found.update(np.ascontiguousarray(array).tobytes())
    kinds = type(problem).__name__, type(problem.fields).__name__
    poses = [len(problem.poses)] if problem.poses else []
    found.update(repr((kinds, *poses, *parts)).encode())
    return found.hexdigest()


def content_of(density: Floats) -> str:
    """Return a text that tells densities of all triangles from others."""
    return hashlib.sha256(np.ascontiguousarray(density).tobytes()).hexdigest()


def kept_evaluation(
    journal: Journal | None,
    problem: DesignProblem,
    simulate: Callable[[], Evaluation],
    like: Evaluation | None = None,
) -> Evaluation:
    """Return an evaluation, from a journal if it is there already (collective).

    `simulate` makes it, and ends in a complete solve. `like` is the design that it belongs to, on
    the mesh of the problem, if there is one.

    Raises:
        NoEquilibriumError: There is none; this is kept too, for the same version of the package.
    """
    of = [] if like is None else [content_of(by_cell(problem.skin, like.density))]
    entry = (journal or Journal()).entry(problem.comm, signature_of(problem, *of))
    saved = entry.saved()
    entry.close()  # a stop need not wait for the simulation
    if saved is not None:
        if FAILURE not in saved.numbers:
            return restored_evaluation(problem, saved)
        if saved.written_by == __version__:  # another one may find what this one did not
            raise NoEquilibriumError(saved.numbers[FAILURE])
    try:
        found = simulate()
    except NoEquilibriumError as caught:  # raised by all ranks or by none
        failure = {FAILURE: str(caught)}
        entry.offer(lambda: Archive(KIND, {}, failure), last=True)
        raise
    entry.offer(lambda: Archive(KIND, *saved_evaluation(found)), last=True)
    return found


def saved_evaluation(evaluation: Evaluation) -> tuple[dict[str, Floats], dict[str, Any]]:
    """Return arrays and numbers of the last simulation of its problem (collective)."""
    e, problem = evaluation, evaluation.problem
    fields = {"density": e.density, "filtered": e.filtered, "projected": e.projected}
    arrays = {name: by_cell(problem.skin, field) for name, field in fields.items()}
    arrays["unknowns"], response = problem.physics.save(e.equilibrium)
    numbers = {"dimensions": [field.ndim for field in fields.values()], "response": response}
    for number, pose in enumerate(e.poses, 2):
        own = pose.problem.physics.save(pose.equilibrium)
        arrays[f"unknowns_{number}"], numbers[f"response_{number}"] = own
    return arrays, numbers


def restored_evaluation(problem: DesignProblem, saved: Archive) -> Evaluation:
    """Return what `saved_evaluation` kept, as if it had just been made (collective).

    Raises:
        CheckpointError: It does not fit the problem.
    """
    skin, numbers = problem.skin, saved.numbers
    with fitting("problem"):
        names = ("density", "filtered", "projected")
        rows = [saved.arrays[name][skin.owned_cells] for name in names]
        density, filtered, projected = (
            own.ravel() if dimension == 1 else own
            for own, dimension in zip(rows, numbers["dimensions"], strict=True)
        )
        ends = ["", *(f"_{number}" for number, _ in enumerate(problem.poses, 2))]
        responses = [
            pose.physics.restore(
                projected, saved.arrays[f"unknowns{end}"], numbers[f"response{end}"]
            )
            for pose, end in zip(problem.every, ends, strict=True)
        ]
    seconds = {"filter": 0.0, "equilibrium": 0.0}
    return problem.told(density, filtered, projected, responses, seconds)


@contextmanager
def fitting(what: str) -> Iterator[None]:
    """Raise a CheckpointError where the content of a checkpoint does not fit a loop or problem."""
    try:
        yield
    except (KeyError, IndexError, TypeError, ValueError) as fault:
        raise CheckpointError(f"a checkpoint does not fit its {what}: {fault}") from None
