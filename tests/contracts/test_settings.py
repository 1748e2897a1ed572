"""Each key of each settings class takes what its type says, and refuses all else by name."""

import json
import math
from collections.abc import Iterator
from dataclasses import MISSING
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from toros_fem.base.errors import ParameterError
from toros_fem.base.keys import MANY, NONE, Key, Real, Table
from toros_fem.base.scene import Scene
from toros_fem.cli.commands.main import COMMANDS, command_of
from toros_fem.design.loop.options import DesignOptions, Stage
from toros_fem.design.mma.optimizer import MMAOptions
from toros_fem.materials.library.files import read_library
from toros_fem.materials.library.material import LibraryMaterial
from toros_fem.mechanics.paths import arc_length  # noqa: F401
from toros_fem.products.kinds import KINDS


def tables(of: type[Table] = Table) -> Iterator[type[Table]]:
    for one in of.__subclasses__():
        own = one.__module__.startswith("toros_fem.")
        if own and not issubclass(one, Scene) and one.described():
            yield one
        yield from tables(one)


SCENES = [*KINDS.values(), *map(command_of, COMMANDS)]  # all settings are loaded
TABLES = sorted(set(tables()), key=lambda one: (one.__module__, one.__name__))
OF_TABLES = pytest.mark.parametrize("table", TABLES, ids=lambda one: one.__name__)
OTHERS: dict[type, tuple[Any, ...]] = {
    float: ("5", None, True, [1.0], {}, math.nan, math.inf, -math.inf, 10**400, 1j),
    int: ("5", None, True, [1], 2.0, math.nan, 10**400, np.float64(3)),
    bool: ("true", None, 1, 0, [True]),
    **dict.fromkeys((str, Path), (5, True, [""], 1.0, b"x")),
    tuple: ("5", None, 1.0, [1.0], [1.0, True], [1.0, "2"], (1, math.nan), [1.0, 10**400]),
}


MORE: dict[type, list[Any]] = {
    float: [0.1234567890123456, 7, np.float32(0.5)],
    int: [np.int64(3)],
    bool: [True, False],
    str: ['a "b" \\ ü', ""],
    Path: [Path("ü b/c"), "a"],
    tuple: [(1, 0.1), np.array([1, 2])],
}


def near(key: Key) -> Iterator[tuple[float, bool]]:
    """Yield numbers at and beside each bound, and whether they are allowed."""
    step = 1 if key.kind is int else 1e-9
    for name in ("above", "below", "at_least", "at_most"):
        bound = getattr(key.within, name)
        if math.isfinite(bound):
            outwards = -1 if name in ("above", "at_least") else 1
            yield bound, name.startswith("at_")
            yield bound + outwards * step * max(1, abs(bound)), False
            if bound - outwards * step * max(1, abs(bound)) in key.within:
                inside = bound - outwards * step * max(1, abs(bound))
                yield inside, key.kind is int or abs(inside) >= key.within.sizes[0]
    if key.kind is int and key.within.at_least == 1:
        yield MANY + 1, False
    if key.kind is float:
        least, most = key.within.sizes
        yield from ((size, size in key.within) for size in (least, most))
        yield from ((size, False) for size in (0.9 * least, 1.1 * most, 1e300, 10**400))


def values_of(table: type[Table]) -> list[Key]:
    """Return the keys of a table that hold no tables: those stand in no file."""
    return [key for key in table.described().values() if key.kind in OTHERS]


def test_settings_are_found() -> None:
    assert len(TABLES) > 25
    assert {"PressureTable", "FitOptions", "ManufactureOptions"} <= {one.__name__ for one in TABLES}


@OF_TABLES
def test_wrong_values_are_refused_by_name(table: type[Table]) -> None:
    for key in values_of(table):
        wrong = [value for value in OTHERS[key.kind] if not (value is None and key.one.optional)]
        wrong += [value for value, allowed in near(key) if not allowed]
        wrong += ["no such word"] if key.words else []
        wrong = [[value] for value in wrong] + [5] if key.several else wrong
        for value in wrong:
            with pytest.raises(ParameterError, match=rf"^{key.name} = ") as caught:
                key.read(value)
            assert caught.value.key == key.name
            assert len(str(caught.value)) < 400


@OF_TABLES
def test_values_are_written_and_read_again(table: type[Table]) -> None:
    """Of numpy's types too, which become plain ones; what is read from a file is in its unit."""
    for key in values_of(table):
        values: list[Any] = [*key.words, *([None] if key.optional else [])]
        values += [] if key.default is MISSING or key.several else [key.default]
        values += [value for value, allowed in near(key) if allowed]
        pair = key.kind is tuple and key.hint != tuple[Real, Real]
        values += [] if key.words or pair else MORE[key.kind]
        for value in values:
            plain = isinstance(value, str | bool | Path | None) or key.kind is tuple
            if plain or value in key.within:
                found = key.one.read(value)
                assert isinstance(found, key.kind | None)
                found = (found, found) if key.several else found
                assert key.read(json.loads(key.written(found))) == found
        if key.optional:
            assert key.read(NONE.upper()) is None


@OF_TABLES
def test_tables_are_values(table: type[Table]) -> None:
    """With the defaults of their own, which need not fit each other for all of them."""
    conditions = table.described().keys() & {"where", "of"}
    needed: dict[str, Any] = dict.fromkeys(conditions, "z < 5 mm")
    for one in table.described().values():
        if one.default is MISSING and one.name not in needed:
            text = one.words[0] if one.words else ["a"] if one.several else "a"
            needed[one.name] = {float: 0.5, int: 1}.get(one.kind, text)
    made = read_library()["rib-knit"] if table is LibraryMaterial else table(**needed)
    plain = {one.name: getattr(made, one.name) for one in values_of(table)}
    assert made == table(**json.loads(json.dumps(plain, default=str)))
    assert hash(made) == hash(made.updated())
    with pytest.raises(ParameterError, match=r"unknown parameter 'sise'; (did you mean|known are)"):
        made.updated(sise=1.0)
    for one in table.described().values():
        assert one.meaning[0].islower() or one.meaning[0] in "EFPXYZTwY'", one.meaning
        assert not one.meaning.endswith("."), one.meaning


def test_tables_of_tables_are_read_again() -> None:
    options = DesignOptions(
        (Stage(3), Stage(2, beta=4.0, constrained=True)), mma=MMAOptions(move=0.1)
    )
    assert DesignOptions(**json.loads(json.dumps(options.as_dict()))) == options
