"""Documented entries that all ranks call compare their arguments, or a row here says why not."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import re
import sys
from collections.abc import Callable, Iterator
from fnmatch import fnmatch
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints

import pytest
from helpers.scenes import ROOT

import toros_fem
from toros_fem.base.mpi import Distributed

ROOM = re.compile(r"^```\{public-names\} (\S+)\n(.*?)```", re.DOTALL | re.MULTILINE)
# What has a communicator.
CARRIER = re.compile(r"MPI\.Comm\b|\b(Skin|SkinModel|\w*Solver|\w*Problem|ShapeDesign)\b")
# What each rank has its own part of, or what all of them found together.
OWNED = re.compile(
    r"^(Floats|Bools|Ints|Evaluation|Equilibrium|DesignResult|PrintedDesign|TileResult|Functions)\b"
)
MODEL = "parts of a model: `make_model` compares what they are made of"
SOLVE = "steps of a solve, whose arguments `EquilibriumSolver` compares"
EVALUATION = "steps of an evaluation, whose arguments `DesignProblem` and `optimize` compare"
# Entries that compare nothing themselves, and why.
EXEMPT = {
    "toros_fem.mechanics.terms.*": MODEL,
    "toros_fem.mechanics.skin.designs.*": MODEL,
    "toros_fem.mechanics.assembly.model.SkinModel.*": SOLVE,
    "toros_fem.mechanics.equilibrium.newton.*": SOLVE,
    "toros_fem.mechanics.equilibrium.ways.*": SOLVE,
    "toros_fem.mechanics.equilibrium.diagnostics.*": SOLVE,
    "toros_fem.mechanics.paths.trace_point.until_failure": "takes a path that `trace` makes",
    "toros_fem.measures.*": "parts of an objective, which `Case.objective` makes",
    "toros_fem.products.actuators.estimates.*": "takes what a run made, but for `print_intervals`",
    "toros_fem.products.tiles.solver.TileSolver.*": "take a state that `solve` found",
    "toros_fem.products.tiles.stiffness_profile.ProfileSolver.*": EVALUATION,
    "toros_fem.design.density.linear.*": "parts of a filter, whose maker compares",
    "toros_fem.design.loop.fields.*": EVALUATION,
    "toros_fem.design.loop.physics.*": EVALUATION,
    "toros_fem.design.loop.problem.*": EVALUATION,
    "toros_fem.design.mma.optimizer.*": EVALUATION,
    "toros_fem.design.loop.levels.optimize_levels": "compares once it has its first problem",
    "toros_fem.meshes.skin.concatenated_index_map": "takes unknowns of each rank",
    "toros_fem.results.reporter.DesignReporter.*": "takes rows that a design made",
    "toros_fem.results.runs.folder.OpenRun.*": "made by `open_run`, which compares",
}


def modules() -> list[str]:
    """Modules of the reference, and those of the names of `toros_fem`."""
    pages = (page.read_text(encoding="utf-8") for page in (ROOT / "docs/reference").glob("*.md"))
    rooms = [found for text in pages for found in ROOM.findall(text)]
    listed = {f"{room}.{name}" for room, names in rooms for name in names.split()}
    listed |= {room for room, names in rooms if not names.split()}
    public = (getattr(toros_fem, name) for name in toros_fem.__all__)
    return sorted(listed | {thing.__module__ for thing in public if hasattr(thing, "__module__")})


def callables(module: str) -> Iterator[tuple[str, Callable[..., Any]]]:
    """Yield functions, methods and constructors of the public names of a module, by their names."""
    room = importlib.import_module(module)
    for name in getattr(room, "__all__", None) or vars(room):
        thing = getattr(room, name)
        home = str(getattr(thing, "__module__", ""))
        listed = home.startswith("toros_fem.") if "__all__" in vars(room) else home == module
        if name[0] == "_" or not listed:
            continue
        if inspect.isfunction(thing):
            yield f"{home}.{name}", thing
        elif inspect.isclass(thing):
            record = dataclasses.is_dataclass(thing) and issubclass(thing, Distributed)
            for own, value in vars(thing).items():
                method = getattr(value, "__func__", value)
                public = own[0] != "_" or own in ("__init__", "__call__")
                made = record and own == "__init__" and not compares(method)
                if inspect.isfunction(method) and public and not made:
                    yield f"{home}.{name}.{own}", method


def compares(entry: Callable[..., Any]) -> bool:
    """Whether an entry is decorated by `collective` or `on_root`."""
    return hasattr(entry, "__wrapped__") and entry.__code__.co_name == "checked"


def to_compare(entry: Callable[..., Any]) -> list[str]:
    """Return the arguments that must be equal on all ranks, of an entry that they call together."""
    known = inspect.signature(entry).parameters
    kinds = {n: str(one.annotation) for n, one in known.items() if n not in ("self", "cls")}
    owner = getattr(sys.modules[entry.__module__], entry.__qualname__.split(".")[0])
    together = any("collective" in (of.__doc__ or "") for of in (entry, owner))
    if not together and not any(map(CARRIER.search, kinds.values())):
        return []
    return [n for n, kind in kinds.items() if not CARRIER.search(kind) and not OWNED.match(kind)]


ENTRIES = {name: entry for module in modules() for name, entry in callables(module)}
UNCOMPARED = {name: to_compare(entry) for name, entry in ENTRIES.items() if not compares(entry)}
LACKING = {name: found for name, found in UNCOMPARED.items() if found}


def test_entries_compare_their_arguments() -> None:
    assert sum(map(compares, ENTRIES.values())) > 100, "the walk misses most of them"
    open_ = {name: of for name, of in LACKING.items() if not any(fnmatch(name, e) for e in EXEMPT)}
    assert open_ == {}, "decorate them by `collective`, or say in EXEMPT why not"


@pytest.mark.parametrize("pattern", EXEMPT)
def test_exempt_entries_are_there(pattern: str) -> None:
    assert any(fnmatch(name, pattern) for name in LACKING)


def test_parts_of_ranks_are_arguments() -> None:
    """A name in `owned` that no argument has would let what differs be refused."""
    for name, entry in ENTRIES.items():
        if compares(entry):
            inside = inspect.getclosurevars(entry).nonlocals
            known = inspect.signature(entry).parameters
            assert {inside["first"], *inside["owned"]} <= set(known), name


def hints(of: Any) -> dict[str, Any]:
    """Types of arguments or attributes; none where one is imported for type checkers alone."""
    try:
        return get_type_hints(of)
    except NameError:
        return {}


def classes_in(hint: Any) -> list[type]:
    """Return the classes of a type, [] of one that is a protocol's variable or not known."""
    parts = get_args(hint) if isinstance(hint, UnionType) else (hint,)
    plain = [get_origin(one) or one for one in parts]
    return [one for one in plain if inspect.isclass(one) and one is not type(None)]


def types_of(kind: type, name: str) -> list[type]:
    """Return the classes that an attribute of a class may have, [] where that is not written.

    Raises:
        AssertionError: It has no such attribute.
    """
    known = inspect.getattr_static(kind, name, None)
    known = getattr(known, "fget", None) or getattr(known, "func", known)
    found = hints(known).get("return", hints(kind).get(name)) if known else hints(kind).get(name)
    bodies = [inspect.getsource(c) for c in kind.__mro__ if c.__module__.startswith("toros_fem")]
    assert known or found or any(f"self.{name}" in body for body in bodies), (kind, name)
    return classes_in(found)


def test_communicators_are_where_decorators_look() -> None:
    """Where none is found, nothing is compared."""
    for entry in ENTRIES.values():
        while compares(entry):
            inside = inspect.getclosurevars(entry).nonlocals
            entry = entry.__wrapped__  # type: ignore[attr-defined]
            owner = getattr(sys.modules[entry.__module__], entry.__qualname__.split(".")[0], None)
            given = {**hints(owner), **hints(entry), "self": owner}
            kinds = classes_in(given.get(inside["first"]))
            for part in inside["path"]:
                kinds = types_of(kinds[0], part) if kinds else []
