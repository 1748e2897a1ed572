"""Reductions, gathers, and errors that all ranks raise together."""

from __future__ import annotations

import dataclasses
import functools
import gc
import hashlib
import inspect
import logging
import os
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Generic, NoReturn, ParamSpec, TypeVar, cast

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from toros_fem.base.array_types import Floats
from toros_fem.base.errors import ParameterError
from toros_fem.base.validation import is_number, require_kind, shown

# Time in s that a rank with an error waits for the others before it ends them all.
PATIENCE = 10.0

# Folders of the package: warnings point at the code that calls it.
_PACKAGE = Path(__file__).parents[1]
OWN = (f"{_PACKAGE}{os.sep}", f"{_PACKAGE.parent / 'meshes'}{os.sep}")

T = TypeVar("T")
R = TypeVar("R")
P = ParamSpec("P")
E = TypeVar("E", bound=Callable[..., Any])


def total(comm: MPI.Comm, value: float) -> float:
    """Return the sum of a number over the ranks."""
    return float(comm.allreduce(float(value), op=MPI.SUM))


def sum_over_ranks(comm: MPI.Comm, local: Floats) -> Floats:
    """Return the entrywise sum of small arrays over the ranks."""
    out = np.empty_like(local)
    comm.Allreduce(np.ascontiguousarray(local), out)
    return out


def largest(comm: MPI.Comm, value: float) -> float:
    """Return the maximum of a number over the ranks."""
    return float(comm.allreduce(float(value), op=MPI.MAX))


def smallest(comm: MPI.Comm, value: float) -> float:
    """Return the minimum of a number over the ranks."""
    return float(comm.allreduce(float(value), op=MPI.MIN))


def dot(comm: MPI.Comm, a: Floats, b: Floats) -> float:
    """Return the inner product of two vectors given by their owned entries."""
    return total(comm, float(np.vdot(a, b)))


def norm(comm: MPI.Comm, owned: Floats) -> float:
    """Return the Euclidean norm of a vector given by its owned entries."""
    return float(np.sqrt(dot(comm, owned, owned)))


def raise_together(comm: MPI.Comm, error: Exception | None) -> None:
    """Raise on every rank the error of the lowest rank that has one (collective)."""
    errors = comm.allgather(error)
    for found in errors:
        if found is not None:
            raise found


@contextmanager
def together(comm: MPI.Comm) -> Iterator[None]:
    """Let all ranks raise what one of them raises in the block (collective at its end).

    The block itself has no collective call: the others would wait there.
    """
    error = None
    try:
        yield
    except Exception as caught:  # raised on all ranks, so that none waits
        error = caught
    raise_together(comm, error)


def on_first_rank(comm: MPI.Comm, action: Callable[[], T]) -> T:
    """Run an action on the first rank; return its result or raise its error on all (collective)."""
    require_comm(comm)
    result = None
    with together(comm):
        if comm.rank == 0:
            result = action()
    found: T = comm.bcast(result, root=0)
    return found


class OnFirst(Generic[T]):
    """A serial object on the first rank, which all ranks ask together (collective).

    Errors of the object reach all ranks.
    """

    def __init__(self, comm: MPI.Comm, make: Callable[[], T]) -> None:
        self._comm, self._made = comm, list[T]()
        on_first_rank(comm, lambda: self._made.append(make()))

    def __call__(self, ask: Callable[[T], R]) -> R:
        """Return on all ranks what the object answers."""
        return on_first_rank(self._comm, lambda: ask(self._made[0]))

    def alone(self, ask: Callable[[T], R], other: R) -> R:
        """Return what the object answers on the first rank, and `other` on the others."""
        answers = [other]
        self(lambda made: answers.append(ask(made)))
        return answers[-1]


def require_comm(comm: Any) -> None:
    """Check that a value is a communicator."""
    require_kind("comm", comm, MPI.Comm, "an MPI communicator, one of mpi4py.MPI")


class Distributed:
    """Base of classes whose objects hold what their rank owns; of those only the type is compared.

    Their numbers that are equal on all ranks were found by all of them together.
    """


def require_alike(comm: MPI.Comm, **arguments: Any) -> None:
    """Check that a communicator is one, and that arguments are equal on all its ranks (collective).

    Of functions, of `Distributed` and of other objects only the type is compared. It comes before
    any other check: what one rank alone refuses would leave the others waiting. A ParameterError
    is raised on all ranks; of settings it names the field.
    """
    require_comm(comm)
    if comm.size == 1:
        return
    digests = comm.allgather({name: _digest(value) for name, value in arguments.items()})
    for name in dict.fromkeys(name for own in digests for name in own):  # some may leave it out
        first = digests[0].get(name)
        other = next((rank for rank, own in enumerate(digests) if own.get(name) != first), 0)
        if other:
            _tell_different(comm, name, arguments.get(name), other)


def collective(comm: str, *, owned: Sequence[str] = ()) -> Callable[[E], E]:
    """Decorate an entry that all ranks call: its arguments must be equal on all of them.

    An entry is a function, a method, or a class, whose objects all ranks make.

    `comm` says where its communicator is: an argument and attributes, as "self.skin.comm". Where it
    cannot be found, or is None, the entry is called as it is, and refuses what it was given. Of the
    arguments in `owned` each rank has its own part: their type is compared, of arrays also the
    number of axes.
    """
    first, *path = comm.split(".")

    def decorate(entry: E) -> E:
        if isinstance(entry, type):
            entry.__init__ = decorate(entry.__init__)  # type: ignore[misc]
            return entry
        signature = inspect.signature(entry)
        known = signature.parameters.values()
        several = next((one.name for one in known if one.kind == one.VAR_KEYWORD), "")

        @functools.wraps(entry)
        def checked(*args: Any, **kwargs: Any) -> Any:
            try:
                bound = signature.bind(*args, **kwargs)
                bound.apply_defaults()  # ranks may differ in what they leave out
                given = bound.arguments
                over = functools.reduce(getattr, path, given[first])
            except (TypeError, KeyError, AttributeError):
                return entry(*args, **kwargs)
            if over is None:
                return entry(*args, **kwargs)
            require_comm(over)
            if over.size > 1:
                given |= given.pop(several, {})
                given.pop(first)
                if (owner := given.pop("self", None)) is not None:
                    given[type(owner).__name__] = owner
                alike = {n: _Owned(one) if n in owned else one for n, one in given.items()}
                require_alike(over, **alike)
            return entry(*args, **kwargs)

        return cast(E, checked)

    return decorate


def on_root(entry: Callable[P, T]) -> Callable[P, T]:
    """Decorate an entry that all ranks call, and that the first rank of its `comm` alone runs.

    Its arguments must be equal on all ranks, which return the same and raise the same.
    """

    @functools.wraps(entry)
    def shared(*args: P.args, **kwargs: P.kwargs) -> T:
        comm: Any = kwargs.get("comm", args[0] if args else None)
        return on_first_rank(comm, lambda: entry(*args, **kwargs))

    return collective("comm")(shared)


class _Owned:
    """What one rank has of an argument."""

    def __init__(self, value: Any) -> None:
        self.value = value

    def __repr__(self) -> str:
        return shown(self.value)

    @property
    def kind(self) -> str:
        """What is equal on all ranks."""
        return f"{type(self.value).__qualname__} {getattr(self.value, 'ndim', '')}"


def _tell_different(comm: MPI.Comm, name: str, value: Any, other: int) -> NoReturn:
    """Raise on all ranks that an argument differs, by the part of it that does (collective)."""
    parts = {f"{name}.{field}": one for field, one in _fields(value).items()}
    if len(set(comm.allgather((type(value).__qualname__, *parts)))) == 1:
        require_alike(comm, **parts)
    texts = comm.allgather(shown(value))
    raise ParameterError(
        f"{name} differs between the ranks: {texts[0]} on rank 0, {texts[other]} on rank {other}. "
        "Give the same on all ranks: draw or read it on one and bcast it."
    )


def _fields(value: Any) -> dict[str, Any]:
    """Return the fields of settings by name; of other objects none."""
    if not dataclasses.is_dataclass(value) or isinstance(value, Distributed | type):
        return {}
    return {one.name: getattr(value, one.name, None) for one in dataclasses.fields(value)}


def _digest(value: Any) -> bytes:
    """Return a hash of a value that does not depend on the rank or the run."""
    found = hashlib.blake2b(digest_size=16)
    parts: Iterable[Any] = ()
    if isinstance(value, np.ndarray) and value.dtype != object:
        found.update(f"{value.dtype.kind}{value.shape}".encode())
        found.update(value.tobytes())
    elif isinstance(value, _Owned):
        found.update(value.kind.encode())
    elif is_number(value):
        found.update(repr(float(value)).encode())
    elif isinstance(value, str | bytes | bool | Path | None):
        found.update(repr(value).encode())
    elif isinstance(value, Mapping):
        parts = value.items()
    elif isinstance(value, list | tuple):
        found.update(str(len(value)).encode())
        parts = value
    else:
        found.update(f"{type(value).__module__}.{type(value).__qualname__}".encode())
        if isinstance(value, functools.partial):
            parts = (value.args, value.keywords)
        elif isinstance(wkb := getattr(value, "wkb", None), bytes):  # a shape of Shapely
            found.update(wkb)
        else:
            parts = _fields(value).values()
    for part in parts:
        found.update(_digest(part))
    return found.digest()


def warn_together(comm: MPI.Comm, message: str, kind: type[Warning]) -> None:
    """Warn on the first rank, at the line of the user's code (collective).

    Where Python's filters make errors of such warnings, all ranks raise it.
    """

    def warn() -> None:
        _give_warnings_back()
        warnings.warn(message, kind, skip_file_prefixes=OWN)

    on_first_rank(comm, warn)


def _give_warnings_back() -> None:
    """Let Python show warnings again: FFCx sends them to a logger, where nobody may listen."""
    listening = [logging.root, logging.getLogger("py.warnings")]
    heard = [h for of in listening for h in of.handlers if not isinstance(h, logging.NullHandler)]
    if not heard:
        logging.captureWarnings(False)


@contextmanager
def ending_together(comm: MPI.Comm, tell: Callable[[Exception], None]) -> Iterator[None]:
    """End all ranks where one leaves the block by an error that the others do not share.

    Errors that all ranks raise pass through. `tell` prints an error of some alone, which after
    `PATIENCE` ends the program, since the others wait for these ranks.
    """
    if comm.size == 1:
        yield
        return
    own = comm.Dup()  # what is under way on the other one does not matter here
    try:
        yield
    except Exception as error:
        request, begin = own.Ibarrier(), time.monotonic()
        while not request.Test():
            if time.monotonic() - begin > PATIENCE:
                tell(error)
                own.Abort(1)
            time.sleep(0.01)
        own.Free()
        raise
    own.Ibarrier().Wait()
    own.Free()


def gather_by_index(
    comm: MPI.Comm, index: npt.NDArray[np.int64], values: Floats, size: int
) -> Floats:
    """Assemble an array of `size` rows on every rank from (global index, row) pairs.

    Rows that several ranks give must be equal; rows that none gives are zero.
    """
    values = np.ascontiguousarray(values, dtype=np.float64)
    out = np.zeros((size, *values.shape[1:]))
    for rows, part in zip(comm.allgather(index), comm.allgather(values), strict=True):
        out[rows] = part
    return out


def free_dropped(comm: MPI.Comm) -> None:
    """Free problems that were dropped (collective).

    Their parts refer to each other, and their factors are large. PETSc keeps distributed objects
    until all ranks have dropped them and meet here.
    """
    from petsc4py import PETSc  # what only reads files and help does without

    gc.collect()
    PETSc.garbage_cleanup(comm)
    gc.collect()  # what these objects held
