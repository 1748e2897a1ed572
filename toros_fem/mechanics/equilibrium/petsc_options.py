"""Options of PETSc with the prefix "toros_": defaults, refusals, and options that nothing uses."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from mpi4py import MPI
from petsc4py import PETSc

from toros_fem.base.compat import option_used
from toros_fem.base.errors import ParameterError, TorosWarning
from toros_fem.base.mpi import warn_together

PREFIX = "toros_"
# The line search halves a step until the energy falls. PETSc's fits of higher order, and its test
# of sufficient decrease, take the slope of an objective with the wrong sign.
DEFAULTS = {
    "snes_linesearch_type": "bt",
    "snes_linesearch_order": 1,
    "snes_linesearch_alpha": 0.0,
    "snes_linesearch_minlambda": 1e-10,
}


@contextmanager
def with_defaults() -> Iterator[None]:
    """Give the line search its defaults, where the user has not set them, in the block."""
    options = PETSc.Options(PREFIX)
    lacking = {name: value for name, value in DEFAULTS.items() if not options.hasName(name)}
    for name, value in lacking.items():
        options[name] = value
    try:
        yield
    finally:
        for name in lacking:
            options.delValue(name)


@contextmanager
def given_options(text: str) -> Iterator[None]:
    """Add options to PETSc's database in the block, as the variable PETSC_OPTIONS would.

    Raises:
        ParameterError: One of them has no value of an option, or another prefix.
    """
    options = PETSc.Options()
    before = options.getAll()
    known = before.items()
    options.insertString(text)
    added = [name for name, value in options.getAll().items() if (name, value) not in known]
    try:
        others = [name for name in added if not name.startswith(PREFIX)]
        words = [word for word in text.split() if word.startswith("-")]
        if others or (text.strip() and not words):
            raise ParameterError(
                f"PETSc's options {text!r} must each begin with -{PREFIX}, such as "
                f"-{PREFIX}snes_monitor or -{PREFIX}snes_max_it 100."
            )
        yield
    finally:
        for name in added:
            options.delValue(name)
            if name in before:
                options[name] = before[name]


@contextmanager
def refusals() -> Iterator[None]:
    """Turn an error of PETSc in the block into a ParameterError that names the options.

    What a hook raised passes as it is.
    """
    try:
        yield
    except PETSc.Error as error:
        if error.__cause__ is not None:
            raise error.__cause__ from None
        given = PETSc.Options(PREFIX).getAll()
        if not given:
            raise
        named = ", ".join(f"-{PREFIX}{name} {value}".strip() for name, value in given.items())
        lines = str(error).splitlines()
        raise ParameterError(
            f"PETSc refuses one of the options {named}: {lines[-1].split('] ')[-1]}. "
            "Options and values are in docs/reference/petsc_options.md."
        ) from None


def tell_unused(comm: MPI.Comm) -> None:
    """Warn of options with the prefix that nothing has asked for, once a solve is done."""
    names = [f"{PREFIX}{name}" for name in PETSc.Options(PREFIX).getAll()]
    found = comm.allgather([f"-{name}" for name in names if not option_used(name)])
    unused = [name for name in found[0] if all(name in others for others in found)]
    if unused:
        warn_together(
            comm,
            f"nothing uses the PETSc options {', '.join(unused)}: a misspelling, or an option of "
            "another solver. Options are in docs/reference/petsc_options.md.",
            TorosWarning,
        )
