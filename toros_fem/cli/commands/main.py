"""The command line `toros`: finds the command, runs it, prints its answer or its error."""

from __future__ import annotations

import contextlib
import io
import json
import logging
import math
import os
import sys
import traceback
import warnings
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from mpi4py import MPI

from toros_fem.base.errors import OutputError, RunStoppedError, TorosError
from toros_fem.base.mpi import ending_together
from toros_fem.base.validation import shown
from toros_fem.base.versions import __version__
from toros_fem.cli.command_line.command import Answer, Command, add_options
from toros_fem.cli.command_line.exit_codes import (
    DONE,
    INTERNAL,
    INTERRUPTED,
    MEANING,
    MISSING,
    NOT_WRITTEN,
    exit_code,
    tell_alone,
)
from toros_fem.cli.command_line.parser import SuggestingParser, UsageError
from toros_fem.cli.commands.check import Check
from toros_fem.cli.commands.design import Design
from toros_fem.cli.commands.doctor import Doctor
from toros_fem.cli.commands.export import Export
from toros_fem.cli.commands.fit import Fit
from toros_fem.cli.commands.materials import Materials
from toros_fem.cli.commands.new import New
from toros_fem.cli.commands.resume import Resume
from toros_fem.cli.commands.simulate import Simulate
from toros_fem.cli.commands.study import Study
from toros_fem.cli.commands.tolerance import Tolerance
from toros_fem.cli.commands.unwrap import Unwrap
from toros_fem.cli.commands.view import View

# The commands by their words, in the order of the help.
COMMANDS: Mapping[str, type[Command]] = MappingProxyType(
    {
        one.__name__.lower(): one
        for one in (
            New, Materials, Check, Simulate, Design, Study, Resume, View, Export,
            Tolerance, Unwrap, Fit, Doctor,
        )
    }
)  # fmt: skip
ABOUT = "Designs robotic skins: printed patterns that make an inflated fabric bend, twist or grip."
OUTPUT = {
    "--json": "print the result as JSON on stdout, and all else on stderr; default no",
    "--quiet": "no progress, only warnings; default no",
}


def run(comm: MPI.Comm, words: Sequence[str]) -> int:
    """Run the command that the words name, and return its exit code (collective).

    Args:
        comm: Communicator; its first rank prints.
        words: The words after `toros`.
    """
    as_json, quiet = "--json" in words, "--quiet" in words
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # which may lack letters
            stream.reconfigure(errors="backslashreplace")
    with open(os.devnull, "w") as nowhere:
        # What is printed meanwhile is kept from an answer that a program reads.
        place = nowhere if quiet else sys.stderr if as_json else sys.stdout
        with contextlib.redirect_stdout(place), _spoken(comm, quiet=quiet):
            try:
                answer = _answer(comm, words)
            except (Exception, KeyboardInterrupt, RunStoppedError) as error:
                answer = _failed(comm, error)
    code = DONE if answer is None else answer.code
    if comm.rank == 0:
        try:
            if answer is not None:
                name = next((word for word in words if word in COMMANDS), None)
                _print(name, answer, as_json=as_json)
            sys.stdout.flush()
        except OSError as fault:
            if not isinstance(fault, BrokenPipeError):  # of a reader that has gone, as `head` does
                print(f"the answer cannot be written: {fault}", file=sys.stderr)
                code = code or NOT_WRITTEN
            # What the stream still holds would fail again when Python ends.
            with open(os.devnull, "w") as nothing:
                os.dup2(nothing.fileno(), sys.stdout.fileno())
    return code


def _answer(comm: MPI.Comm, words: Sequence[str]) -> Answer | None:
    """Return what the command answers; None for --help and --version, which are printed here."""
    for word in words:
        if not word.isascii() and word.encode(errors="replace").decode() != word:
            raise UsageError(f"{word!r} is no UTF-8; give files and folders other names.")
    try:
        given = vars(_parser(comm).parse_args(list(words)))
    except SystemExit:
        return None
    command = COMMANDS[given["command"]]
    known = command.described()
    made = command.of_given(**{name: value for name, value in given.items() if name in known})
    try:
        with ending_together(comm, lambda error: tell_alone(comm, error)):
            return made(comm)
    except OSError as caught:
        # Of a name that is too long, or a folder that is closed, where it is only looked at.
        if isinstance(caught, TorosError) or caught.filename is None:
            raise
        raise OutputError(
            f"{shown(str(caught.filename))}: {caught.strerror}. Give another name, or see who may "
            "use it."
        ) from caught


def _failed(comm: MPI.Comm, error: BaseException) -> Answer:
    """Return the answer of an error; a fault ends all ranks, since others may wait for this one."""
    kind = type(error).__name__
    plain = isinstance(error, UsageError | RunStoppedError)
    text = str(error) if plain else f"{kind}: {error}"
    if exit_code(error) == MISSING:
        text += ". `toros doctor` says what to do."
    if isinstance(error, KeyboardInterrupt):
        text = told = "stopped"
    else:
        told = f"rank {comm.rank}: {''.join(traceback.format_exception(error))}"
    code = exit_code(error)
    if code == INTERNAL or (code == INTERRUPTED and comm.size > 1):
        print(told, file=sys.stderr, flush=True)
        if comm.size > 1:
            comm.Abort(code)
    names = {"file": "path", "line": "line", "key": "key"}
    places = {name: getattr(error, of, None) for name, of in names.items()}
    known = {name: place for name, place in places.items() if place is not None}
    return Answer(text, {"error": {"type": kind, "message": str(error), **known}}, code)


def _print(name: str | None, answer: Answer, *, as_json: bool) -> None:
    if as_json:
        content = {"command": name, "exit_code": answer.code, **answer.figures}
        print(json.dumps(_plain(content), indent=2, ensure_ascii=False), flush=True)
    if answer.text and (answer.code or not as_json):
        print(answer.text, file=sys.stderr if answer.code else sys.stdout, flush=True)


def _plain(value: Any) -> Any:
    """Return a value of JSON: numpy's numbers and paths become plain, what is not finite None."""
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(entry) for entry in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if isinstance(value, str | int | float | None) else str(value)


def _parser(comm: MPI.Comm) -> SuggestingParser:
    """Return the parser of `toros`."""
    first = comm.rank == 0
    codes = "\n".join(f"  {code:3d}  {text}" for code, text in MEANING.items())
    parser = SuggestingParser(
        prog="toros",
        first_rank=first,
        description=f"{ABOUT}\n\n`toros COMMAND --help` tells about one command.",
        epilog=f"exit codes:\n{codes}\n\nUnder MPI: mpirun -n 2 toros COMMAND …",
    )
    parser.add_argument("--version", action="version", version=f"toros_fem {__version__}")
    commands = parser.add_subparsers(
        dest="command", metavar="COMMAND", title="commands", required=True
    )
    for word, command in COMMANDS.items():
        about, examples = command.holds(), "\n".join(f"  {line}" for line in command.EXAMPLES)
        sub = commands.add_parser(word, first_rank=first, help=about[:1].lower() + about[1:])
        sub.description = f"{about}.\n\n{command.details()}"
        sub.epilog = f"examples:\n{examples}"
        add_options(sub, command)
        group = sub.add_argument_group("output of the command")
        for flag, text in OUTPUT.items():
            group.add_argument(flag, action="store_true", help=text)
    return parser


@contextlib.contextmanager
def _spoken(comm: MPI.Comm, *, quiet: bool) -> Iterator[None]:
    """Show the package's log and its warnings on the first rank, as lines on stderr.

    Lines of a batch job have the time.
    """
    logger = logging.getLogger("toros_fem")
    handler: logging.Handler = logging.NullHandler()
    if comm.rank == 0:
        handler = logging.StreamHandler(sys.stderr)
        stamp = "" if sys.stderr.isatty() else "%(asctime)s "
        handler.setFormatter(logging.Formatter(stamp + "%(message)s", "%Y-%m-%d %H:%M:%S"))
    level, spread = logger.level, logger.propagate
    logger.addHandler(handler)
    logger.setLevel(logging.WARNING if quiet else logging.INFO)
    logger.propagate = False

    def show(message: Warning | str, *_: Any, **__: Any) -> None:
        logger.warning("warning: %s", message)

    try:
        with warnings.catch_warnings():
            warnings.showwarning = show
            yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)
        logger.propagate = spread
