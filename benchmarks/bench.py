"""The harness of all benchmarks: cases, rows, processes, tables in pages.

    python -m benchmarks accuracy --only disc --rows output/disc.csv
    python -m benchmarks stability --workers 2 --cases 500 --rows output/stability.csv
    python -m benchmarks stability --rows output/stability.csv --page

Rows are printed as they are found. With `--rows FILE` they are kept as well, and what is in the
file is not run again: remove it after a change of the code. `--page` runs nothing. It condenses the
rows of the file, puts them in the place of those of the same cases in `benchmarks/rows/NAME.csv`,
and writes the tables of the pages in docs/ from there. Without `--rows` it writes the tables alone.
"""

from __future__ import annotations

import argparse
import csv
import importlib
import multiprocessing
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, fields, replace
from datetime import date
from functools import cache
from pathlib import Path
from signal import ITIMER_REAL, SIGALRM, setitimer, signal
from types import FrameType
from typing import Any, TypeVar

import numpy as np
from mpi4py import MPI

ROOT = Path(__file__).parent.parent
ROWS = ROOT / "benchmarks" / "rows"
COMMANDS = {
    "accuracy": "benchmarks.accuracy.command",
    "stability": "benchmarks.stability.command",
    "speed": "benchmarks.speed.command",
    "scale": "benchmarks.scale",
    "seeds": "benchmarks.seeds",
    "figures": "benchmarks.figures",
    "intervals": "benchmarks.intervals",
    "prints": "benchmarks.prints",
    "fits": "benchmarks.fits",
    "measured": "benchmarks.measured.command",
}
# Variables by which a child process would take itself for a rank of this one.
RANK_VARIABLES = ("OMPI_COMM", "PMIX", "PRTE")
# Ending of the name of a case that holds the counts of another one.
IN_ALL = ", in all"
T = TypeVar("T")


@dataclass(frozen=True)
class Row:
    """One figure.

    Attributes:
        case, variant, size: What was measured: name of the case, its variant, its refinement.
        figure: Name of the value.
        value: The value; None where there is none, the width of a gap without gaps for instance.
        unit: Unit of the value, SI but where the figure is published in another one.
        reference: What the value should be; None where that is not known.
        seconds: What it took; the case says of which clock.
        machine: Processor, cores and version of dolfinx.
        measured: Day, and short hash of the commit.
        note: What a number cannot say.
    """

    case: str
    variant: str
    size: str
    figure: str
    value: float | None
    unit: str = ""
    reference: float | None = None
    seconds: float | None = None
    machine: str = ""
    measured: str = ""
    note: str = ""


Rows = Sequence[Row]
COLUMNS = tuple(column.name for column in fields(Row))
NUMBERS = ("value", "reference", "seconds")


@dataclass(frozen=True)
class Case:
    """What runs as one, and is not repeated once its rows are known.

    Attributes:
        name, variant: As in its rows.
        run: Returns the rows (collective).
        alone: Whether it needs a process of its own, for its memory or its environment.
        environment: Of that process, as it differs.
    """

    name: str
    run: Callable[[], Iterable[Row]]
    variant: str = ""
    alone: bool = False
    environment: Mapping[str, str] = field(default_factory=dict)

    @property
    def key(self) -> str:
        """Name and variant."""
        return f"{self.name}: {self.variant}" if self.variant else self.name


@dataclass(frozen=True)
class Table:
    """A table in a page, between two marks.

    Attributes:
        page: File in docs/.
        mark: Word of the marks.
        text: Returns the table from the committed rows.
    """

    page: str
    mark: str
    text: Callable[[Rows], str]


@dataclass(frozen=True)
class Command:
    """A benchmark.

    Attributes:
        about: Help.
        cases: Returns its cases, a quick selection of them if the argument is True.
        tables: Tables of its committed rows.
        condense: Returns the rows that are committed; leaves those that are condensed as they are.
        bad: Whether a row says that something is wrong; the exit code tells.
        serial: Whether it runs on one rank only.
        options: Adds options of its own.
        instead: Runs in the place of the cases if its options ask for it, and returns True.
    """

    about: str
    cases: Callable[[bool], Sequence[Case]]
    tables: Sequence[Table] = ()
    condense: Callable[[Rows], Rows] = lambda rows: rows
    bad: Callable[[Row], bool] = lambda row: False
    serial: bool = False
    options: Callable[[argparse.ArgumentParser], None] = lambda parser: None
    instead: Callable[[argparse.Namespace], bool] = lambda options: False


def key_of(row: Row) -> str:
    """Return the key of the case of a row."""
    return Case(row.case, list, row.variant).key


def command_of(name: str) -> Command:
    """Return a benchmark by its name."""
    found: Command = importlib.import_module(COMMANDS[name]).COMMAND
    return found


def read(file: Path) -> list[Row]:
    """Return the rows of a file; a last line that was cut off is left out."""
    if not file.exists():
        return []
    text = file.read_text(encoding="utf-8")
    lines = csv.DictReader(text[: text.rfind("\n") + 1].splitlines())
    return [
        Row(**{k: (float(v) if v else None) if k in NUMBERS else v for k, v in line.items()})
        for line in lines
    ]


def write(file: Path, rows: Rows, *, append: bool = False) -> None:
    """Write rows into a file, or behind those that it has, whose cut last line is dropped."""
    file.parent.mkdir(parents=True, exist_ok=True)
    fresh = not append or not file.exists()
    if not fresh:
        content = file.read_bytes()
        file.write_bytes(content[: content.rfind(b"\n") + 1])
    with file.open("w" if fresh else "a", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
        if fresh:
            writer.writeheader()
        writer.writerows(
            {k: v if v is None or k not in NUMBERS else repr(float(v)) for k, v in cells.items()}
            for cells in map(asdict, rows)
        )


@cache
def machine() -> str:
    """Return processor, number of cores and version of dolfinx."""
    import dolfinx

    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return f"{(names or ['unknown'])[0]}, {os.cpu_count()} cores, dolfinx {dolfinx.__version__}"


@cache
def measured() -> str:
    """Return the day, and the short hash of the commit if this is a checkout."""
    git = ["git", "-C", str(ROOT), "rev-parse", "--short", "HEAD"]
    done = subprocess.run(git, capture_output=True, text=True)
    return f"{date.today()} {done.stdout.strip()}".strip()


@cache
def known_cases(name: str, quick: bool) -> dict[str, Case]:
    """Return the cases of a benchmark by their keys."""
    return {case.key: case for case in command_of(name).cases(quick)}


def played(name: str, quick: bool, key: str, inside: bool = False) -> list[Row]:
    """Run a case and return its rows (collective); `inside` keeps it in this process."""
    case = known_cases(name, quick)[key]
    if case.alone and not inside:
        return _alone(name, quick, case)
    stamp = {"machine": machine(), "measured": measured()}
    return [replace(row, **stamp) for row in case.run()]


def _alone(name: str, quick: bool, case: Case) -> list[Row]:
    own = {k: v for k, v in os.environ.items() if not k.startswith(RANK_VARIABLES)}
    path = os.pathsep.join([str(ROOT), own.get("PYTHONPATH", "")])
    environment = {**own, "OMP_NUM_THREADS": "1", "PYTHONPATH": path, **case.environment}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "rows.csv"
        command = [sys.executable, "-m", "benchmarks", name, "--key", case.key]
        command += ["--rows", str(file), *(["--quick"] if quick else [])]
        done = subprocess.run(command, env=environment, capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError((done.stderr.strip() or "no message").splitlines()[-1])
        return read(file)


def complete(
    name: str, quick: bool, keys: Sequence[str], file: Path | None, workers: int = 1,
    report: Callable[[Rows], None] = lambda rows: None, *, inside: bool = False,
) -> int:  # fmt: skip
    """Run the cases that the file has no rows of (collective); return how many failed.

    Args:
        name: Of the benchmark.
        quick: As of the command line.
        keys: Of the cases.
        file: To which rows are added as they are found; None keeps none.
        workers: Number of processes, on one rank.
        report: Called with the new rows of a case on the first rank.
        inside: Whether cases run in this process that ask for one of their own.
    """
    comm, failed = MPI.COMM_WORLD, 0
    rows = read(file) if file and comm.rank == 0 else []
    found = {key_of(row) for row in rows}
    todo = comm.bcast([key for key in keys if key not in found], root=0)
    for key, outcome in _outcomes(name, quick, todo, workers, inside):
        if isinstance(outcome, Exception):
            failed += 1
            print(f"{key} FAILED: {type(outcome).__name__}: {outcome}", file=sys.stderr, flush=True)
        elif comm.rank == 0:
            if file:
                write(file, outcome, append=True)
            report(outcome)
    return failed


def _outcomes(
    name: str, quick: bool, keys: Sequence[str], workers: int, inside: bool
) -> Iterator[tuple[str, list[Row] | Exception]]:
    if workers == 1:
        for key in keys:
            try:
                yield key, played(name, quick, key, inside)
            except Exception as error:  # other cases still count
                if MPI.COMM_WORLD.size > 1:
                    raise
                yield key, error
        return
    # MPI does not survive a fork: every process starts afresh.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context) as pool:
        running = {pool.submit(played, name, quick, key): key for key in keys}
        for future in as_completed(running):
            error = future.exception()
            yield running[future], error if isinstance(error, Exception) else future.result()


@contextmanager
def deadline(seconds: float) -> Iterator[None]:
    """Raise TimeoutError in the block after a wall time: a hang must not stop the others."""

    def ring(number: int, frame: FrameType | None) -> None:
        raise TimeoutError(f"gave up after {seconds:g} s")

    before = signal(SIGALRM, ring)
    setitimer(ITIMER_REAL, seconds)
    try:
        yield
    finally:
        setitimer(ITIMER_REAL, 0)
        signal(SIGALRM, before)


def timed(work: Callable[[], T], clock: Callable[[], float] = time.perf_counter) -> tuple[T, float]:
    """Return the result of a call and its time in s."""
    begin = clock()
    result = work()
    return result, clock() - begin


def markdown(head: Sequence[str], lines: Iterable[Sequence[Any]]) -> str:
    """Return a Markdown table."""
    parts = [head, ["---"] * len(head), *lines]
    return "\n".join("| " + " | ".join(map(str, cells)) + " |" for cells in parts)


def values_of(rows: Rows, start: str) -> dict[tuple[str, str, str], dict[str, float | None]]:
    """Return the figures by case, variant and size, of cases whose name has this start."""
    found: dict[tuple[str, str, str], dict[str, float | None]] = {}
    for row in rows:
        if row.case.startswith(start):
            found.setdefault((row.case, row.variant, row.size), {})[row.figure] = row.value
    return found


def with_table(page: str, mark: str, text: str) -> str:
    """Return a page with another text between the marks of a table.

    Raises:
        ValueError: The page has no such marks.
    """
    begin, end = f"<!-- {mark} -->", f"<!-- end of {mark} -->"
    before, found, rest = page.partition(begin)
    _, also, after = rest.partition(end)
    if not found or not also:
        raise ValueError(f"the page needs the lines {begin!r} and {end!r}.")
    return f"{before}{begin}\n\n{text}\n\n{end}{after}"


def pages(command: Command, rows: Rows, folder: Path = ROOT / "docs") -> dict[Path, str]:
    """Return the pages of a benchmark with the tables of its rows."""
    found: dict[Path, str] = {}
    for table in command.tables:
        file = folder / table.page
        text = found.get(file) or file.read_text(encoding="utf-8")
        found[file] = with_table(text, table.mark, table.text(rows))
    return found


def publish(name: str, new: Rows) -> None:
    """Put new rows in the place of committed ones of their cases, and write the pages."""
    command = command_of(name)
    file, fresh = ROWS / f"{name}.csv", command.condense(new)
    own = {(row.case, row.variant) for row in fresh}
    counted = {row.case.removesuffix(IN_ALL) for row in fresh if row.case.endswith(IN_ALL)}
    kept = [
        row
        for row in read(file)
        if (row.case, row.variant) not in own and row.case.removesuffix(IN_ALL) not in counted
    ]
    order = {key: number for number, key in enumerate(known_cases(name, False))}
    rows = sorted([*kept, *fresh], key=lambda row: order.get(key_of(row), len(order)))
    texts = pages(command, rows)  # which fails where rows are missing, before anything is written
    if new:
        write(file, rows)
    for page, text in texts.items():
        page.write_text(text, encoding="utf-8")


def show(rows: Rows) -> None:
    """Print rows."""
    for row in rows:
        value = "-" if row.value is None else f"{row.value:.6g}"
        known = "" if row.reference is None else f" of {row.reference:.6g}"
        spent = "" if row.seconds is None else f"  {row.seconds:.2f} s"
        place = " ".join(filter(None, (row.case, row.variant, row.size)))
        print(f"{place}: {row.figure} {value}{known} {row.unit}{spent} {row.note}".rstrip())
    sys.stdout.flush()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    first = argparse.ArgumentParser(add_help=False)
    first.add_argument("name", choices=list(COMMANDS), help="benchmark")
    given = sys.argv[1:] if arguments is None else list(arguments)
    name = next((word for word in given if word in COMMANDS), None)
    command = command_of(name) if name else None
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks", parents=[first],
        description=command.about if command else __doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("--quick", action="store_true", help="few small cases")
    parser.add_argument("--only", default="", help="cases with this in their name or variant")
    parser.add_argument("--cases", type=int, help="so many of the cases, drawn at random")
    parser.add_argument("--workers", type=int, default=1, help="number of processes")
    parser.add_argument("--rows", type=Path, help="CSV file of what is finished")
    parser.add_argument("--page", action="store_true", help="run nothing, write the pages")
    parser.add_argument("--key", help=argparse.SUPPRESS)
    if command:
        command.options(parser)
    options = parser.parse_args(given)
    assert command is not None  # or the parser has ended the program
    if MPI.COMM_WORLD.size > 1 and (command.serial or options.workers > 1):
        parser.error("one rank only. --workers takes processes.")
    if options.page:
        publish(options.name, read(options.rows) if options.rows else [])
        return 0
    if command.instead(options):
        return 0
    keys = [key for key in known_cases(options.name, options.quick) if options.only in key]
    if options.key:
        keys = [options.key]
    if not keys:
        parser.error(f"no case has {options.only!r} in its name.")
    if options.cases is not None:
        # The first of one permutation: more cases are the same and others.
        order = np.random.default_rng(0).permutation(len(keys))
        keys = [keys[k] for k in order[: options.cases]]
    bad: list[Row] = []

    def report(rows: Rows) -> None:
        show(rows)
        bad.extend(row for row in rows if command.bad(row))

    failed = complete(
        options.name, options.quick, keys, options.rows, options.workers, report,
        inside=options.key is not None,
    )  # fmt: skip
    return 1 if bad or failed else 0
