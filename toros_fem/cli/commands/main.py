"""The command line `toros`: finds the command, runs it, prints its answer or its error."""

from __future__ import annotations

import contextlib
import importlib
import inspect
import io
import json
import logging
import math
import os
import re
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from toros_fem.base.errors import OutputError, RunStoppedError, TorosError
from toros_fem.base.packages import __version__
from toros_fem.cli.process import (
    DONE,
    INTERNAL,
    INTERRUPTED,
    MEANING,
    MISSING,
    NOT_WRITTEN,
    UsageError,
    exit_code,
    tell_alone,
)

if TYPE_CHECKING:
    from cyclopts import App
    from mpi4py import MPI

    from toros_fem.cli.command import Answer, Command

# The commands by their words, and what each does, in the order of the help.
COMMANDS: Mapping[str, str] = MappingProxyType(
    {
        "new": "Writes a commented scene file",
        "materials": "Lists materials that scenes know by name",
        "check": "Reads a scene file and says what is wrong, or how large the design will be",
        "simulate": "Inflates a plain skin or a given pattern",
        "design": "Designs the pattern of a scene",
        "study": "Runs a scene with all combinations of some values, and tabulates the results",
        "resume": "Continues a run that was stopped, or one that should go further",
        "view": "Writes the report of a run, a page for the browser",
        "export": "Writes the files for printer and cutter again",
        "tolerance": "Simulates a print with wrong widths, materials and pressure",
        "force": "Says how the free end of a design pushes if blocked, and how stiff it is",
        "unwrap": "Cuts a surface along seams and lays it flat as a sewing pattern",
        "fit": "Fits a material to tensile tests, or to an inflated skin",
        "doctor": "Says what the package runs on, and tries it",
    }
)
# The files of commands that share one.
FILES: Mapping[str, str] = MappingProxyType(
    {
        **dict.fromkeys(("check", "simulate", "resume", "study"), "design"),
        "view": "export",
        "fit": "materials",
    }
)
ABOUT = "Designs robotic skins: printed patterns that make an inflated fabric bend, twist or grip."


def command_of(word: str) -> type[Command]:
    """Return the class of a command, which is loaded."""
    module = importlib.import_module(f"toros_fem.cli.commands.{FILES.get(word, word)}")
    found: type[Command] = getattr(module, word.capitalize())
    return found


def overview() -> str:
    """Return the help of `toros`, which is there at once: no command is loaded."""
    commands = "\n".join(f"  {word:10s} {about}" for word, about in COMMANDS.items())
    codes = "\n".join(f"  {code:3d}  {text}" for code, text in MEANING.items())
    return f"""\
Usage: toros COMMAND [OPTIONS]

{ABOUT}

Commands:
{commands}

  --help, -h            show this text; after a command, what it does and takes
  --version             show the version
  --install-completion  let the shell complete commands and options

Exit codes:
{codes}

Under MPI: mpirun -n 2 toros COMMAND …"""


def application(name: str) -> App:
    """Return the parser of `toros`: the named command is loaded, the others if cyclopts asks."""
    from cyclopts import App, Parameter

    app = App(
        name="toros",
        help=ABOUT,
        help_format="plaintext",
        version=f"toros_fem {__version__}",
        default_parameter=Parameter(negative=(), show_default=False, show_choices=False),
    )
    for word, about in COMMANDS.items():
        if word != name:
            app.command(f"{__name__}:{word}", name=word, help=about)
            continue
        command = command_of(word)
        # Lines of a docstring become those of the terminal.
        text = re.sub(r"(?<=\S)\n(?=\S)", " ", inspect.cleandoc(command.__doc__ or ""))
        examples = "\n".join(f"  {line}" for line in command.EXAMPLES)
        app.command(
            _reader(command), name=word, help=text, help_epilogue=f"Examples:\n\n{examples}"
        )
    app.register_install_completion_command()
    return app


def _reader(command: type[Command]) -> Callable[..., Command]:
    """Return the function that makes a command of words, with the signature that cyclopts needs."""

    def made(*words: Any, json: bool = False, quiet: bool = False, **options: Any) -> Command:
        return command.of_words(dict(zip(command.WORDS, words, strict=False)) | options)

    made.__signature__ = signature = command.signature()  # type: ignore[attr-defined]
    made.__annotations__ = {name: one.annotation for name, one in signature.parameters.items()}
    return made


def __getattr__(word: str) -> Any:
    """Return the function of a command, for cyclopts."""
    if word in COMMANDS:
        return _reader(command_of(word))
    raise AttributeError(f"module {__name__!r} has no attribute {word!r}")


def parsed(words: Sequence[str], *, first: bool) -> Command | None:
    """Return the command that words name; None for --help, --version and completion.

    These are done here, on the first rank. A UsageError tells words that are not understood.
    """
    for word in words:
        if not word.isascii() and word.encode(errors="replace").decode() != word:
            raise UsageError(f"{word!r} is no UTF-8; give files and folders other names.")
    if not words:
        raise UsageError("toros: name a command; toros --help lists all.")
    if words[0] in ("--help", "-h", "--version"):
        if first:
            print(f"toros_fem {__version__}" if words[0] == "--version" else overview())
        return None
    name = next((word for word in words if not word.startswith("-")), "")
    place = f"toros {name}" if name in COMMANDS else "toros"
    from cyclopts import CycloptsError

    try:
        act, bound, _ = application(name).parse_args(
            list(words), exit_on_error=False, print_error=False
        )
    except CycloptsError as caught:
        change = next((word for word in words[2:] if re.match(r"[\w.]+=", word)), None)
        if change is not None and "--set" not in words[words.index(change) - 1]:
            told = f"{change} stands alone; write --set before each KEY=VALUE."
        else:
            told = str(caught)
        raise UsageError(f"{place}: {told}") from None
    if act.__module__ == __name__:
        made: Command = act(*bound.args, **bound.kwargs)
        return made
    if first:
        act(*bound.args, **bound.kwargs)
    return None


def run(comm: MPI.Comm, words: Sequence[str]) -> int:
    """Run the command that the words name, and return its exit code (collective).

    Args:
        comm: Communicator; its first rank prints.
        words: The words after `toros`.
    """
    as_json, quiet = "--json" in words, "--quiet" in words
    _take_all_letters()
    with open(os.devnull, "w") as nowhere:
        # What is printed meanwhile is kept from an answer that a program reads.
        place = nowhere if quiet else sys.stderr if as_json else sys.stdout
        with contextlib.redirect_stdout(place), _spoken(comm, quiet=quiet):
            try:
                answer = _answer(comm, words)
            except (Exception, KeyboardInterrupt, RunStoppedError) as error:
                answer = _failed(comm, error)
    code = DONE if answer is None else answer.code

    def tell() -> None:
        if answer is not None:
            name = next((word for word in words if word in COMMANDS), None)
            _print(name, answer, as_json=as_json)

    return _printed(tell, code) if comm.rank == 0 else code


def help_at_once(word: str) -> int:
    """Do --help or --version in a process without others, and return the exit code.

    Neither NumPy nor MPI is loaded.
    """
    _take_all_letters()
    return _printed(lambda: parsed([word], first=True), DONE)


def _take_all_letters() -> None:
    """Let streams write what they have no letters for in another way."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _printed(tell: Callable[[], object], code: int) -> int:
    """Print the end of a command, and return its exit code, if nothing else has failed."""
    try:
        tell()
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
    """Return what the command answers; None for what is printed while words are parsed."""
    from toros_fem.base.mpi import ending_together
    from toros_fem.base.validation import shown

    command = parsed(words, first=comm.rank == 0)
    if command is None:
        return None
    try:
        with ending_together(comm, lambda error: tell_alone(comm, error)):
            return command(comm)
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
    from toros_fem.cli.command import Answer

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
    import numpy as np

    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(entry) for entry in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if isinstance(value, str | int | float | None) else str(value)


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
