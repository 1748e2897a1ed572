"""Mutants: small faults put into the package one at a time, and the tests that see them.

`scripts/mutants` tries each row of tests/mutants.csv again with the test that killed it;
`scripts/mutants --sample 300` draws new ones and adds them. Rows are kept by what a
statement says, not by its line, so that they hold while a file moves on.
"""

from __future__ import annotations

import argparse
import ast
import collections
import copy
import csv
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from queue import Queue
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
TABLE = ROOT / "tests" / "mutants.csv"
COLUMNS = ("file", "old", "new", "killer")
ROOMS = ("mechanics", "measures", "design", "making", "results")
# Seconds of tests that a mutant is given, at first and in all.
FIRST, ALL = 12.0, 80.0
COMPARISONS: dict[type, type] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
ARITHMETIC: dict[type, type] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult,
    ast.Mod: ast.Mult, ast.FloorDiv: ast.Mult,
}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """A statement of a file, what it becomes, and what came of it.

    `killer` is a test, or a sentence that begins with "equivalent", "survives" or "gone".
    """

    file: str
    old: str
    new: str
    killer: str = ""
    kind: str = ""
    lines: tuple[int, ...] = ()

    @property
    def dead(self) -> bool:
        others = ("equivalent", "survives", "gone")
        return bool(self.killer) and not self.killer.startswith(others)


def header(statement: ast.stmt) -> str:
    """Return a statement on one line, of a compound one the part before its body."""
    if not hasattr(statement, "body"):
        return " ".join(ast.unparse(statement).split())
    bare = copy.copy(statement)
    bare.body = [ast.Pass()]  # type: ignore[attr-defined]
    for name in ("orelse", "finalbody", "handlers", "decorator_list"):
        if hasattr(bare, name):
            setattr(bare, name, [])
    if isinstance(bare, ast.Try):
        return "try:"
    return " ".join(ast.unparse(bare).rpartition(":")[0].split()) + ":"


def named_statements(tree: ast.Module) -> Iterator[tuple[str, ast.stmt]]:
    """Yield all statements with their names: a header, numbered from its second time on."""
    times: collections.Counter[str] = collections.Counter()
    for node in ast.walk(tree):
        if isinstance(node, ast.stmt):
            text = header(node)
            times[text] += 1
            yield (text if times[text] == 1 else f"{text} # {times[text]}"), node


def mutations(statement: ast.stmt) -> Iterator[tuple[str, ast.stmt]]:
    """Yield the kind of each mutation of a statement's own part, and the new statement."""
    if isinstance(statement, ast.Raise | ast.Import | ast.ImportFrom | ast.Try | ast.ClassDef):
        return
    if _removable(statement):
        yield "statement", ast.copy_location(ast.Pass(), statement)
    own = _own_nodes(statement)
    for index, node in enumerate(own):
        for kind, change in _changes(node):
            new = copy.deepcopy(statement)
            change(_own_nodes(new)[index])
            yield kind, new
    if isinstance(statement, ast.If | ast.While) and not isinstance(statement.test, ast.Compare):
        new = copy.deepcopy(statement)
        new.test = ast.UnaryOp(ast.Not(), new.test)  # type: ignore[attr-defined]
        yield "condition", new


def _removable(statement: ast.stmt) -> bool:
    if isinstance(statement, ast.Expr):
        return isinstance(statement.value, ast.Call)
    if isinstance(statement, ast.Assign):
        return all(isinstance(to, ast.Attribute | ast.Subscript) for to in statement.targets)
    return isinstance(statement, ast.AugAssign | ast.Continue | ast.Break)


def _own_nodes(statement: ast.stmt) -> list[ast.AST]:
    """Return the nodes of a statement without its body, annotations, decorators and texts."""
    left_out = {
        "body",
        "orelse",
        "finalbody",
        "handlers",
        "decorator_list",
        "annotation",
        "returns",
    }
    nodes: list[ast.AST] = [statement]
    for node in nodes:
        if isinstance(node, ast.JoinedStr):
            continue
        for name, value in ast.iter_fields(node):
            if name in left_out and not isinstance(node, ast.IfExp | ast.Lambda):
                continue
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    nodes.append(child)
    return nodes


def _changes(node: ast.AST) -> Iterator[tuple[str, Callable[[Any], Any]]]:
    """Yield kinds of mutations of a node, and functions that make them in place."""
    if isinstance(node, ast.Compare) and type(node.ops[0]) in COMPARISONS:
        yield "comparison", lambda n: n.ops.__setitem__(0, COMPARISONS[type(n.ops[0])]())
    if isinstance(node, ast.BinOp | ast.AugAssign) and type(node.op) in ARITHMETIC:
        sides = [node.left, node.right] if isinstance(node, ast.BinOp) else [node.value]
        if not any(_is_text(side) for side in sides):
            yield "arithmetic", lambda n: setattr(n, "op", ARITHMETIC[type(n.op)]())
    if isinstance(node, ast.BoolOp):
        other = ast.Or if isinstance(node.op, ast.And) else ast.And
        yield "condition", lambda n: setattr(n, "op", other())
    if isinstance(node, ast.IfExp):
        yield "condition", lambda n: setattr(n, "test", ast.UnaryOp(ast.Not(), n.test))
    if isinstance(node, ast.Constant):
        value = node.value
        if isinstance(value, bool):
            yield "constant", lambda n: setattr(n, "value", not value)
        elif isinstance(value, int):
            yield "constant", lambda n: setattr(n, "value", value + 1)
        elif isinstance(value, float):
            yield "constant", lambda n: setattr(n, "value", 1.5 * value if value else 1.0)


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.JoinedStr) or (
        isinstance(node, ast.Constant) and isinstance(node.value, str)
    )


def drawn(count: int, seed: int) -> list[Mutant]:
    """Draw mutants of the five rooms, as many of each kind, from all that there are."""
    kinds: dict[str, list[Mutant]] = collections.defaultdict(list)
    for room in ROOMS:
        for path in sorted((ROOT / "toros_fem" / room).rglob("*.py")):
            tree = ast.parse(path.read_text(encoding="utf-8"))
            for old, statement in named_statements(tree):
                if "__all__" in old or "TYPE_CHECKING" in old:
                    continue
                last = statement.end_lineno or 0
                if hasattr(statement, "body"):
                    last = max(statement.lineno, statement.body[0].lineno - 1)
                lines = tuple(range(statement.lineno, last + 1))
                for kind, new in mutations(statement):
                    file = path.relative_to(ROOT).as_posix()
                    kinds[kind].append(Mutant(file, old, header(new), kind=kind, lines=lines))
    numbers = random.Random(seed)
    chosen = []
    for place, kind in enumerate(sorted(kinds)):
        share = count // len(kinds) + (place < count % len(kinds))
        chosen += numbers.sample(kinds[kind], min(share, len(kinds[kind])))
    return sorted(chosen, key=lambda mutant: (mutant.file, mutant.lines, mutant.new))


def mutated(mutant: Mutant) -> str | None:
    """Return the text of a mutant's file, None where its statement is gone."""
    path = ROOT / mutant.file
    tree = ast.parse(path.read_text(encoding="utf-8") if path.is_file() else "")
    statement = dict(named_statements(tree)).get(mutant.old)
    if statement is None:
        return None
    text = mutant.new
    if text.startswith("elif "):
        text = text[2:]
    new = ast.parse(text + (" pass" if hasattr(statement, "body") else "")).body[0]
    for name in ("body", "orelse", "decorator_list"):
        if hasattr(statement, name) and hasattr(new, name):
            setattr(new, name, getattr(statement, name))
    for parent in ast.walk(tree):
        for name in ("body", "orelse", "finalbody"):
            children = getattr(parent, name, None)
            if isinstance(children, list) and statement in children:
                children[children.index(statement)] = new
    return ast.unparse(ast.fix_missing_locations(tree))


class Copy:
    """A copy of the checkout in which one mutant at a time is tried."""

    def __init__(self, folder: Path) -> None:
        self.root = folder
        names = subprocess.check_output(["git", "ls-files"], cwd=ROOT, text=True).split("\n")
        for name in filter(None, names):
            if (ROOT / name).is_file():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(ROOT / name, folder / name)

    def pytest(
        self, *words: str, seconds: float, ranks: int = 1, **more: str
    ) -> subprocess.CompletedProcess[str] | None:
        """Run pytest in the copy; None where it takes too long, which is a death as well."""
        path = os.pathsep.join([str(self.root), str(self.root / "tests")])
        environment = {**os.environ, "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"}
        environment |= {"OMP_NUM_THREADS": "1", **more}
        start = ["mpirun", "-n", str(ranks)] if ranks > 1 else []
        try:
            return subprocess.run(
                [*start, sys.executable, "-m", "pytest", "-q", "--color=no", *words],
                cwd=self.root, env=environment, timeout=seconds, text=True, check=False,
                stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return None

    def first_failure(self, tests: list[str], seconds: float, ranks: int = 1) -> str:
        """Return the first of some tests that fails, "" where all pass."""
        listing = self.root / "tests_to_run.txt"
        listing.write_text("\n".join(tests), encoding="utf-8")
        done = self.pytest("-x", f"@{listing}", seconds=5 * seconds + 60, ranks=ranks)
        listing.unlink()
        if done is None:
            return f"{tests[0].split('::')[0]} (does not end)"
        if done.returncode == 0:
            return ""
        if done.returncode in (pytest.ExitCode.USAGE_ERROR, pytest.ExitCode.NO_TESTS_COLLECTED):
            known = [name for name in tests if f"{name}\n" not in done.stdout]
            if known and len(known) < len(tests):
                return self.first_failure(known, seconds, ranks)
            return "gone: no such test"
        for line in done.stdout.splitlines():
            if line.startswith(("FAILED ", "ERROR ")):
                return line.split(" ", 1)[1].split(" - ")[0]
        return f"{tests[0].split('::')[0]} (pytest ends with {done.returncode})"

    def attempt(self, mutant: Mutant, tests: list[list[tuple[str, float]]], ranks: int = 1) -> str:
        """Put a mutant in, run batches of tests until one fails, and take it out again."""
        text = mutated(mutant)
        if text is None:
            return "gone: no such statement"
        place = self.root / mutant.file
        before = place.read_text(encoding="utf-8")
        place.write_text(text, encoding="utf-8")
        try:
            for batch in filter(None, tests):
                names, seconds = [name for name, _ in batch], sum(time for _, time in batch)
                while names and (killer := self.first_failure(names, seconds, ranks)):
                    if killer not in names or self.first_failure([killer], seconds, ranks):
                        return killer
                    names.remove(killer)  # it fails in company only, perhaps without a mutant too
        finally:
            place.write_text(before, encoding="utf-8")
        return ""


def lines_run(mutants: list[Mutant], place: Copy) -> dict[str, dict]:
    """Run the suite once and return which tests run the lines of which mutants."""
    wanted: dict[str, list[int]] = collections.defaultdict(list)
    for mutant in mutants:
        wanted[str(place.root / mutant.file)] += mutant.lines
    folder = place.root / "build" / "lines"
    folder.mkdir(parents=True, exist_ok=True)
    listing = folder.parent / "wanted.json"
    listing.write_text(json.dumps(wanted))
    place.pytest(
        "-p", "kit.lines_run", "-n", "2", "--dist", "loadfile", seconds=7200,
        LINES_WANTED=str(listing), LINES_FOUND=str(folder),
    )  # fmt: skip
    tests: dict[str, dict] = {}
    for path in folder.glob("*.json"):
        tests |= json.loads(path.read_text())
    start = f"{place.root}/"
    for entry in tests.values():
        entry["places"] = [name.removeprefix(start) for name in entry["places"]]
    return {name: entry for name, entry in tests.items() if "failed" not in entry}


def batches(
    mutant: Mutant, tests: dict[str, dict], *, comm: bool = False
) -> list[list[tuple[str, float]]]:
    """Return the tests that run a mutant's line, the nearest and shortest first, in two lots."""
    places = {f"{mutant.file}:{line}" for line in mutant.lines}
    runs = [name for name, entry in tests.items() if places & set(entry["places"])]
    if not runs:  # a module's constant: whatever uses its file
        runs = [name for name, entry in tests.items() if mutant.file in entry["places"]]
    if comm:
        runs = [name for name in runs if tests[name]["comm"]]
    stem = Path(mutant.file).stem
    folder = Path(mutant.file).parent.as_posix().replace("toros_fem", "tests")

    def nearness(name: str) -> tuple[int, float]:
        file = name.split("::")[0]
        near = 0 if Path(file).stem == f"test_{stem}" else 1 if file.startswith(folder) else 2
        return near, tests[name]["seconds"]

    lots: list[list[tuple[str, float]]] = [[], []]
    spent = 0.0
    for name in sorted(runs, key=nearness):
        seconds = float(tests[name]["seconds"]) + 0.02
        if spent + seconds < ALL:
            spent += seconds
            lots[spent > FIRST].append((name, seconds))
    return lots


def try_all(
    mutants: list[Mutant], copies: list[Copy], tests: dict[str, dict] | None
) -> list[Mutant]:
    """Return the mutants with what became of them; tests None tries the known killers only."""
    free: Queue[Copy] = Queue()
    for place in copies:
        free.put(place)

    def attempt(mutant: Mutant) -> Mutant:
        place = free.get()
        try:
            if tests is not None:
                killer = place.attempt(mutant, batches(mutant, tests))
            else:
                killer = place.attempt(mutant, [[(mutant.killer.split(" (")[0], 30.0)]])
        finally:
            free.put(place)
        verdict = killer or "survives"
        print(
            f"{verdict[:60]:60s} {mutant.file}: {mutant.old[:60]} -> {mutant.new[:60]}", flush=True
        )
        return replace(mutant, killer=verdict)

    with ThreadPoolExecutor(len(copies)) as pool:
        found = list(pool.map(attempt, mutants))
    if tests is None:
        return found
    for index, mutant in enumerate(found):  # what one rank does not see
        lots = batches(mutant, tests, comm=True)
        if mutant.killer == "survives" and any(lots):
            killer = copies[0].attempt(mutant, lots, ranks=2)
            if killer:
                found[index] = replace(mutant, killer=f"{killer} (two ranks)")
    return found


def read_table() -> list[Mutant]:
    with TABLE.open(encoding="utf-8", newline="") as file:
        rows = csv.DictReader(file)
        return [Mutant(row["file"], row["old"], row["new"], row["killer"]) for row in rows]


def write_table(mutants: list[Mutant]) -> None:
    with TABLE.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows([getattr(mutant, name) for name in COLUMNS] for mutant in mutants)


def merged(kept: list[Mutant], drawn: list[Mutant]) -> list[Mutant]:
    """Return the rows of a table with those just drawn; a reason that somebody wrote stays."""
    rows = {(row.file, row.old, row.new): row for row in kept}
    for row in drawn:
        name = (row.file, row.old, row.new)
        if row.dead or name not in rows or rows[name].dead:
            rows[name] = row
    return [rows[name] for name in sorted(rows)]


def summary(mutants: list[Mutant]) -> str:
    """Return how many died, and those that did not."""
    real = [mutant for mutant in mutants if not mutant.killer.startswith("equivalent")]
    dead = sum(mutant.dead for mutant in real)
    rows = [f"  {m.file}: {m.old} -> {m.new}\n    {m.killer}" for m in mutants if not m.dead]
    share = f"{dead} of {len(real)} mutants die ({dead / max(len(real), 1):.1%})"
    equivalent = len(mutants) - len(real)
    return "\n".join([f"{share}; {equivalent} more change nothing that a test could see", *rows])


def main() -> None:
    parser = argparse.ArgumentParser(prog="scripts/mutants", description=__doc__)
    parser.add_argument("--sample", type=int, metavar="N", help="draw N and add them to the table")
    parser.add_argument("--seed", type=int, default=48, help="of the draw")
    parser.add_argument("--workers", type=int, default=2, help="mutants tried at a time")
    parser.add_argument("--only", default="", help="files whose path has this part")
    given = parser.parse_args()
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="mutants-") as temporary:
        copies = [Copy(Path(temporary) / str(k)) for k in range(given.workers)]
        if given.sample:
            mutants = [m for m in drawn(given.sample, given.seed) if given.only in m.file]
            found = try_all(mutants, copies, lines_run(mutants, copies[0]))
            write_table(merged(read_table(), found))
        else:
            rows = [row for row in read_table() if given.only in row.file]
            tried = iter(try_all([row for row in rows if row.dead], copies, None))
            found = [next(tried) if row.dead else row for row in rows]
    print(summary(found))
    print(f"{time.monotonic() - began:.0f} s")
    real = [mutant for mutant in found if not mutant.killer.startswith("equivalent")]
    sys.exit(sum(mutant.dead for mutant in real) < 0.9 * len(real))


if __name__ == "__main__":
    main()
